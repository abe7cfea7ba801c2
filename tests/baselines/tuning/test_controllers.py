"""``drm tune receding``: a search flies training manoeuvres, and what it takes has to be better."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from drm_baselines.cli import app
from drm_baselines.evaluation.statistics import interquartile_mean
from drm_baselines.optimal_control.mpc import Receding, fly_all
from drm_baselines.policies.gains import load_settings
from drm_baselines.support import seeds
from drm_baselines.tuning import controllers
from drm_baselines.tuning.controllers import ControllerRequest, Flown, in_turn, tune_controller
from drm_baselines.tuning.laws import training_scenarios
from drm_baselines.tuning.space import SETTINGS

pytest.importorskip("optuna")

START = {each.name: each.start for each in SETTINGS["receding"]}
SMALL = ControllerRequest(scenarios=8, trials=3)


class Sky:
    """Flights in no time: the tip error is what ``error`` makes of settings and place."""

    def __init__(self, error: Any, settled: Any = lambda _: 1.0) -> None:
        self.error, self.settled = error, settled
        self.flights: list[tuple[dict[str, float], list[int]]] = []

    def __call__(
        self,
        settings: Mapping[str, float],
        scenarios: Sequence[Any],
        seeds: Sequence[int],
        processes: int | None = 1,
    ) -> Flown:
        self.flights.append((dict(settings), list(seeds)))
        return Flown(
            errors=np.array([self.error(settings, seed) for seed in seeds]),
            settled=np.full(len(seeds), self.settled(settings)),
            cost={"episodes": len(seeds)},
        )


def smoother(settings: Mapping[str, float], seed: int) -> float:
    """The error of a manoeuvre, which is less the less smoothing there is."""
    return 1e-4 * (1.0 + seed % 7) * (1.0 + np.log10(settings["smoothing"] / 1e-6))


def test_one_manoeuvre_of_each_stratum_in_turn() -> None:
    assert in_turn(8) == [0, 2, 4, 6, 1, 3, 5, 7]


def test_a_trial_is_flown_by_the_controller(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The objective of the first trial by hand, with nothing in the place of flights."""
    monkeypatch.setattr(controllers, "FRESH", 1)
    request = ControllerRequest(scenarios=4, trials=1)
    content = tune_controller(tmp_path, request).content
    drawn = training_scenarios("robust", 4).scenarios
    metrics = fly_all(
        drawn, seeds=[seeds.TUNING_SEED + place for place in range(4)], settings=Receding(**START)
    )
    assert content["objective"]["value"] == interquartile_mean(metrics["tip_error_rms"]) * 1e3
    assert content["objective"]["first"] == content["objective"]["value"]
    assert content["budget"]["plans"] == metrics["plans"].sum()
    # nothing but the first trial was there to be better than itself
    assert not content["confirmation"]["taken"] and content["settings"] == START


def test_the_better_settings_are_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sky = Sky(smoother)
    monkeypatch.setattr(controllers, "fly", sky)
    content = tune_controller(tmp_path, ControllerRequest(scenarios=8, trials=12)).content
    found = content["confirmation"]
    assert content["parameters"]["smoothing"] < START["smoothing"]
    assert found["taken"] and content["settings"] == content["parameters"]
    assert found["difference"]["high"] < 0.0 and found["value"] < found["first"]
    # fresh manoeuvres, other seeds than those of the trials, all of them kept for tuning
    fresh, tried = set(sky.flights[-1][1]), {s for _, flown in sky.flights[:-2] for s in flown}
    assert not fresh & tried and fresh | tried <= set(seeds.RANGES["tuning"])
    rows = [*content["scenarios"]["strata"], *found["strata"]]
    drawn = [s for row in rows for s in range(row["first_seed"], row["first_seed"] + row["count"])]
    assert len(drawn) == len(set(drawn)) == 24 and set(drawn) <= set(seeds.RANGES["tuning"])


@pytest.mark.parametrize("why", ["luck", "unsettled"])
def test_no_others_are_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, why: str) -> None:
    """Best among the trials is not enough, nor is a smaller error that does not settle."""

    def error(settings: Mapping[str, float], seed: int) -> float:
        if why == "unsettled":
            return smoother(settings, seed)
        # better on the manoeuvres of the search, worse on as many of the fresh ones
        fresh = seed >= seeds.TUNING_SEED + controllers._FRESH_SEED
        sign = (-1.0) ** seed if fresh else 1.0
        return 1e-3 + sign * 1e-4 * np.log10(settings["smoothing"])

    def settled(settings: Mapping[str, float]) -> float:
        return 1.0 if why == "luck" or settings == START else 0.5

    monkeypatch.setattr(controllers, "fly", Sky(error, settled))
    content = tune_controller(tmp_path, ControllerRequest(scenarios=8, trials=12)).content
    assert content["parameters"] != START and content["objective"]["value"] is not None
    assert not content["confirmation"]["taken"] and content["settings"] == START


def test_the_hopeless_do_not_fly_to_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def error(settings: Mapping[str, float], _: int) -> float:
        return 1e-3 if settings == START else 1.6e-3

    sky = Sky(error)
    monkeypatch.setattr(controllers, "fly", sky)
    content = tune_controller(tmp_path, ControllerRequest(scenarios=12, trials=3)).content
    assert content["trials"] == {"count": 3, "pruned": 2, "best": 0}
    assert content["budget"]["episodes"] == 12 + 2 * 4
    assert [len(flown) for _, flown in sky.flights] == [4, 4, 8, 4, 4, 24]
    text = (tmp_path / "trials.csv").read_text()
    assert "1.6 mm over the first 4 manoeuvres, more than 1.5 mm" in text


def test_a_search_goes_on_and_is_confirmed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(controllers, "fly", Sky(smoother))
    whole = tune_controller(tmp_path / "whole", SMALL).content
    one = ControllerRequest(scenarios=8, trials=1)
    tune_controller(tmp_path / "parts", one)
    parts = tune_controller(tmp_path / "parts", SMALL)
    assert parts.found == 1
    for name in ("parameters", "settings", "objective", "confirmation"):
        assert parts.content[name] == whole[name]
    sky = Sky(smoother)
    monkeypatch.setattr(controllers, "fly", sky)
    assert tune_controller(tmp_path / "parts", SMALL).content == parts.content
    # only how far hopeless trials may go
    assert len(sky.flights) == 1


def test_the_command_says_what_was_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(controllers, "fly", Sky(smoother))
    arguments = ["tune", "receding", "--scenarios", "8", "--trials", "2", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "on 16 fresh manoeuvres" in result.stdout and "settings are taken" in result.stdout
    content = json.loads((tmp_path / "gains.json").read_text())
    assert content["command"] == (
        "drm tune receding --suite robust --scenarios 8 --trials 2 --seed 0"
    )
    refused = CliRunner().invoke(app, ["tune", "receding", "--steps", "5"])
    assert refused.exit_code == 2 and "--steps means nothing for receding" in refused.stderr


def test_what_is_searched_are_settings_of_the_controller() -> None:
    assert set(START) <= set(asdict(Receding()))
    for each in SETTINGS["receding"]:
        assert each.low < each.start < each.high and each.reason and each.unit


def test_the_controller_flies_with_what_the_search_took() -> None:
    content = load_settings("receding")
    assert {name: asdict(Receding())[name] for name in START} == content["settings"]
    taken = content["confirmation"]["taken"]
    assert content["settings"] == (content["parameters"] if taken else START)
    assert taken == (
        content["confirmation"]["difference"]["high"] < 0.0
        and content["confirmation"]["settled"]["difference"]["value"] >= 0.0
    )
