"""``drm tune``: searches finish, repeat to the digit and go on where they stopped; laws fly."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import signal
import time
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import drm_env
from drm_baselines import suites
from drm_baselines.cli import app
from drm_baselines.errors import BaselineError, ExistingResultError
from drm_baselines.evaluation.environments import environment_config
from drm_baselines.evaluation.statistics import interquartile_mean
from drm_baselines.optimal_control import scheduled_lqr
from drm_baselines.policies import gains
from drm_baselines.policies.pilots import runs_in, shipped_runs
from drm_baselines.rl import hyperparameters
from drm_baselines.rl.hyperparameters import toml
from drm_baselines.rl.request import Point
from drm_baselines.support.seeds import TRAINING_SEED
from drm_baselines.tuning import (
    laws,
    learners,
    packaging,
    space,
    trials,
)
from drm_baselines.tuning.laws import LawRequest, tune_law
from drm_baselines.tuning.space import GAINS, LEARNING, SETTINGS, Dimension

optuna = pytest.importorskip("optuna")

SCENARIOS = 16


def request(law: str = "linear", **changes: Any) -> LawRequest:
    return dataclasses.replace(LawRequest(law=law, scenarios=SCENARIOS, trials=3), **changes)


def drm(*arguments: str | Path | float) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def tiny(law: str, out: Path, *more: str | float) -> Result:
    return drm("tune", law, "--scenarios", SCENARIOS, "--trials", 3, "--out", out, *more)


def rows(directory: Path) -> list[dict[str, str]]:
    """The record of a search without what differs from run to run."""
    with (directory / "trials.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    for row in table:
        del row["seconds"]
    return table


def flown_anew(law: Any, suite: str = "robust") -> float:
    """The objective by hand."""
    scenarios = [
        scenario
        for stratum in range(4)
        for scenario in drm_env.sample_scenarios(
            config=suites.SUITES[suite].stratum_config(stratum),
            seed=TRAINING_SEED + 500_000_000 + 4 * stratum,
            n=4,
        )
    ]
    metrics = drm_env.rollout(scenarios, law=law)
    assert not metrics["diverged"].any()
    return 1e3 * interquartile_mean(metrics["tip_error_rms"])


@pytest.mark.parametrize("law", GAINS)
def test_a_search_finishes_and_its_law_flies(tmp_path: Path, law: str) -> None:
    outcome = tune_law(tmp_path / "new" / law, request(law))
    assert (outcome.found, outcome.interrupted) == (0, False)
    content = json.loads((tmp_path / "new" / law / "gains.json").read_text())
    assert (content["format"], content["name"]) == ("drm-gains", law)
    assert content["trials"]["count"] == 3
    assert content["parameters"].keys() == {dimension.name for dimension in GAINS[law]}
    assert flown_anew(content["law"]) == content["objective"]["value"]
    table = rows(tmp_path / "new" / law)
    assert [row["number"] for row in table] == ["0", "1", "2"]
    values = [float(row["value"]) for row in table if row["state"] == "complete"]
    assert min(values) == content["objective"]["value"]
    for row in table:
        assert all(dimension.holds(float(row[dimension.name])) for dimension in GAINS[law])


@pytest.mark.parametrize("law", ["linear", "lyapunov"])
def test_the_first_trial_is_the_law_of_the_thesis(tmp_path: Path, law: str) -> None:
    outcome = tune_law(tmp_path, request(law, trials=1))
    assert flown_anew(law) == outcome.content["objective"]["value"]
    assert outcome.content["objective"]["first"] == outcome.content["objective"]["value"]
    assert float(rows(tmp_path)[0]["value"]) == outcome.content["objective"]["value"]


def test_the_budget_is_what_was_flown(tmp_path: Path) -> None:
    budget = tune_law(tmp_path, request()).content["budget"]
    assert budget["episodes"] == 3 * SCENARIOS
    assert budget["simulated_seconds"] == pytest.approx(3 * SCENARIOS * suites.HORIZON)
    assert budget["integrator_steps"] == 3 * SCENARIOS * suites.HORIZON / 5e-4


def test_a_seed_repeats_its_search_to_the_digit(tmp_path: Path) -> None:
    # beyond the ten trials that TPE draws at random
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        tune_law(tmp_path / name, request(trials=14, seed=seed))
    assert rows(tmp_path / "a") == rows(tmp_path / "b")
    assert rows(tmp_path / "a")[1:] != rows(tmp_path / "c")[1:]


def test_a_search_goes_on_to_the_same_digits(tmp_path: Path) -> None:
    whole = tune_law(tmp_path / "whole", request(trials=14))
    tune_law(tmp_path / "parts", request(trials=12))
    journal = (tmp_path / "parts" / "journal.log").read_bytes()
    before = rows(tmp_path / "parts")
    outcome = tune_law(tmp_path / "parts", request(trials=14))
    assert outcome.found == 12
    assert (tmp_path / "parts" / "journal.log").read_bytes().startswith(journal)
    assert rows(tmp_path / "parts")[:12] == before
    assert rows(tmp_path / "parts") == rows(tmp_path / "whole")
    assert outcome.content["law"] == whole.content["law"]
    assert outcome.content["budget"]["episodes"] == whole.content["budget"]["episodes"]


@pytest.mark.parametrize("at", [0, 2])
def test_an_interruption_keeps_what_is_there(tmp_path: Path, at: int) -> None:
    def interrupt(label: str, done: int, total: int, note: str) -> None:
        if done == at:
            os.kill(os.getpid(), signal.SIGINT)

    if at == 0:
        with pytest.raises(BaselineError, match="interrupted before"):
            tune_law(tmp_path / "parts", request(trials=4), progress=interrupt)
    else:
        outcome = tune_law(tmp_path / "parts", request(trials=4), progress=interrupt)
        assert outcome.interrupted
        assert outcome.content["trials"]["count"] == at
        with pytest.raises(BaselineError, match="interrupted"):
            packaging.package(outcome)
    assert len(rows(tmp_path / "parts")) == at
    assert tune_law(tmp_path / "parts", request(trials=4)).found == at
    tune_law(tmp_path / "whole", request(trials=4))
    assert rows(tmp_path / "parts") == rows(tmp_path / "whole")


@pytest.mark.parametrize("first", [True, False], ids=["in the first trial", "later"])
def test_a_killed_process_costs_one_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: bool
) -> None:
    class Killed(BaseException):
        pass

    fly, flown = laws.fly, 0

    def killing(law: Mapping[str, Any], scenarios: Any) -> trials.Verdict:
        nonlocal flown
        flown += 1
        if flown == (1 if first else 3):
            raise Killed
        return fly(law, scenarios)

    with monkeypatch.context() as patch:
        patch.setattr(laws, "fly", killing)
        # the process is gone before it can say that its trial failed
        patch.setattr(optuna.study.Study, "tell", _unless_failed(optuna.study.Study.tell))
        with pytest.raises(Killed):
            tune_law(tmp_path / "parts", request(trials=4))
    with (tmp_path / "parts" / "journal.log").open("ab") as stream:
        stream.write(b'{"op_code":6,"wor')
    assert tune_law(tmp_path / "parts", request(trials=4)).found == (0 if first else 2)
    tune_law(tmp_path / "whole", request(trials=4))
    assert rows(tmp_path / "parts") == rows(tmp_path / "whole")


def _unless_failed(tell: Any) -> Any:
    def quiet(self: Any, *arguments: Any, **options: Any) -> Any:
        if options.get("state") != optuna.trial.TrialState.FAIL:
            tell(self, *arguments, **options)

    return quiet


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"law": "lyapunov"}, "law 'linear', not 'lyapunov'"),
        ({"suite": "heavy"}, "suite 'robust', not 'heavy'"),
        ({"scenarios": 8}, "scenarios 16, not 8"),
        ({"seed": 1}, "seed 0, not 1"),
    ],
)
def test_changed_settings_are_refused(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    tune_law(tmp_path, request(trials=1))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(BaselineError, match=message):
        tune_law(tmp_path, request(**change))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert tune_law(tmp_path, request(**change), force=True).found == 0


def test_a_changed_space_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tune_law(tmp_path, request(trials=1))
    wider = dataclasses.replace(GAINS["linear"][0], high=1e6)
    monkeypatch.setitem(space.GAINS, "linear", (wider, *GAINS["linear"][1:]))
    with pytest.raises(BaselineError, match="in its space"):
        tune_law(tmp_path, request(trials=2))


def test_other_results_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ExistingResultError, match="not empty"):
        tune_law(tmp_path, request())
    tune_law(tmp_path, request(trials=1), force=True)
    assert (tmp_path / "thesis.txt").read_text() == "mine"


def test_two_searches_do_not_share_a_directory(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    refused = []

    def second(label: str, done: int, total: int, note: str) -> None:
        with pytest.raises(BaselineError, match="is in use by drm tune"):
            tune_law(tmp_path, request())
        refused.append(done)

    tune_law(tmp_path, request(trials=1), progress=second)
    assert refused == [0, 1]


def test_a_stale_lock_of_optuna_is_no_wait(tmp_path: Path) -> None:
    """A process that is killed while Optuna writes leaves Optuna's lock: 30 s of silence."""
    tune_law(tmp_path, request(trials=1))
    journal = tmp_path / "journal.log"
    (tmp_path / "journal.log.lock").symlink_to(journal)
    (tmp_path / "journal.log.lock0.rename").symlink_to(journal)
    began = time.monotonic()
    assert tune_law(tmp_path, request(trials=2)).found == 1
    assert time.monotonic() - began < 25
    assert not list(tmp_path.glob("journal.log.lock*"))


def test_an_impossible_design_is_a_pruned_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scheduled, designs = scheduled_lqr.scheduled_law, 0

    def failing(weights: Mapping[str, float]) -> dict[str, Any]:
        nonlocal designs
        designs += 1
        if designs in (1, 3):
            raise BaselineError("no regulator for 50.0 kg")
        return scheduled(weights)

    monkeypatch.setattr(scheduled_lqr, "scheduled_law", failing)
    outcome = tune_law(tmp_path, request("lqr"))
    assert [row["state"] for row in rows(tmp_path)] == ["pruned", "complete", "pruned"]
    assert rows(tmp_path)[0]["reason"] == "no regulator for 50.0 kg"
    assert outcome.content["trials"] == {"count": 3, "pruned": 2, "best": 1}


def test_no_design_at_all_is_a_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(weights: Mapping[str, float]) -> dict[str, Any]:
        raise BaselineError("no regulator for 50.0 kg")

    monkeypatch.setattr(scheduled_lqr, "scheduled_law", failing)
    with pytest.raises(BaselineError, match="no trial that flew: no regulator for 50"):
        tune_law(tmp_path, request("lqr"))
    assert len(rows(tmp_path)) == 3


def test_lost_manoeuvres_count_ten_metres(monkeypatch: pytest.MonkeyPatch) -> None:
    scenarios = [{"sample_period": 2e-3, "integrator_step": 5e-4}] * 4
    metrics = {
        "tip_error_rms": np.array([0.1, np.nan, 0.3, np.inf]),
        "diverged": np.array([0.0, 0.0, 1.0, 0.0]),
        "duration": np.full(4, 0.1),
    }
    monkeypatch.setattr(drm_env, "rollout", Mock(return_value=metrics))
    verdict = laws.fly({"name": "linear"}, scenarios)
    assert verdict.value == 1e3 * interquartile_mean([0.1, 10.0, 10.0, 10.0])
    assert verdict.cost["diverged"] == 3
    assert verdict.cost["integrator_steps"] == 4 * 200


def test_the_manoeuvres_are_those_of_training() -> None:
    draw = laws.training_scenarios("robust", 400)
    seeds = [
        seed
        for row in draw.strata
        for seed in range(row["first_seed"], row["first_seed"] + row["count"])
    ]
    assert seeds == list(range(1_500_000_000, 1_500_000_400))
    assert min(seeds) >= TRAINING_SEED > suites.SUITE_SEED
    masses = {scenario["payload"]["mass"] for scenario in draw.scenarios}
    of_suite = {scenario["payload"]["mass"] for scenario in suites.load("robust").scenarios}
    assert len(masses) == 400
    assert not masses & of_suite
    for number in (0, 2, 402):
        with pytest.raises(BaselineError, match="multiple of 4"):
            laws.training_scenarios("robust", number)
    with pytest.raises(BaselineError, match="lists its manoeuvres"):
        laws.training_scenarios("thesis", 4)
    with pytest.raises(BaselineError, match="no suite 'nonsense'"):
        laws.training_scenarios("nonsense", 4)


@pytest.mark.parametrize("law", GAINS)
def test_packaged_gains_fly_better_than_the_first_trial(law: str) -> None:
    content = gains.load_gains(law)
    objective = content["objective"]
    assert objective["first"] is None or objective["value"] < objective["first"]
    assert laws.law_of(law, content["parameters"]).keys() == content["law"].keys()
    if content["scenarios"]["suite"] == "robust":
        thesis = "linear" if law == "lqr" else law
        assert flown_anew(content["law"]) < flown_anew(thesis)
    else:  # where the thesis' gains lose the arm
        assert flown_anew(content["law"], "flexible") < flown_anew("none", "flexible")
    assert "/" not in " ".join(content["provenance"]["command"])


def test_missing_gains_say_how_to_make_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gains, "resources", Mock(files=Mock(return_value=tmp_path)))
    with pytest.raises(BaselineError, match="drm tune lqr --package makes them"):
        gains.load_gains("lqr")
    (tmp_path / "gains").mkdir()
    (tmp_path / "gains" / "lqr.json").write_text("[]")
    with pytest.raises(BaselineError, match="not of format"):
        gains.load_gains("lqr")
    (tmp_path / "gains" / "lqr.json").write_text("{")
    with pytest.raises(BaselineError, match="cannot be read"):
        gains.load_gains("lqr")
    with pytest.raises(BaselineError, match="'pid' cannot be tuned"):
        gains.load_gains("pid")


def test_packaging_makes_what_is_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packaging, "resources", Mock(files=Mock(return_value=tmp_path)))
    result = tiny("linear", tmp_path / "out", "--package")
    assert result.exit_code == 0, result.output
    monkeypatch.setattr(gains, "resources", Mock(files=Mock(return_value=tmp_path)))
    assert gains.load_gains("linear") == json.loads((tmp_path / "out" / "gains.json").read_text())


def test_the_command_tells_what_it_found(tmp_path: Path) -> None:
    result = tiny("linear", tmp_path)
    assert result.exit_code == 0, result.output
    assert "root.rate_gain" in result.stdout
    assert "trial" in result.stdout
    assert "went on" not in result.stderr
    again = tiny("linear", tmp_path, "--json")
    assert again.exit_code == 0, again.output
    assert "3 trials were there, 0 are new" in " ".join(again.stderr.split())
    content = json.loads(again.stdout)
    assert content == json.loads((tmp_path / "gains.json").read_text())
    assert content["command"] == "drm tune linear --suite robust --scenarios 16 --trials 3 --seed 0"


def test_ctrl_c_ends_the_command_with_a_way_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fly = laws.fly

    def interrupting(law: Mapping[str, Any], scenarios: Any) -> trials.Verdict:
        os.kill(os.getpid(), signal.SIGINT)
        return fly(law, scenarios)

    monkeypatch.setattr(laws, "fly", interrupting)
    result = tiny("linear", tmp_path)
    assert result.exit_code == 130, result.output
    assert "interrupted after 1 trials; go on with: drm tune linear" in result.stderr
    assert len(rows(tmp_path)) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["pid"], f"'pid' cannot be tuned; there are {', '.join(GAINS)}, receding, ppo, sac"),
        (["linear", "--steps", "5"], "--steps means nothing for linear"),
        (["ppo", "--suite", "robust"], "--suite means nothing for ppo"),
        (["sac", "--scenarios", "8"], "--scenarios means nothing for sac"),
        (["lqr", "--hyperparameters", "a.toml"], "--hyperparameters means nothing for lqr"),
        (["sac", "--hyperparameters", "missing.toml"], "no hyperparameter file missing.toml"),
        (
            ["sac", "--package", "--hyperparameters", str(packaging.learner_file("sac"))],
            "must not be the file that --package overwrites",
        ),
        (["linear", "--env", "drm_env/Slew-v0"], "--env means nothing for linear"),
        (["ppo", "--env", "CartPole-v1"], "no environment 'CartPole-v1'; there are drm_env/"),
        (
            ["ppo", "--env", "drm_env/SlewThesis-v0", "--package"],
            "--package has learners for drm_env/SlewResidual-v0, drm_env/SlewResidual-v1, "
            "drm_env/Slew-v0, drm_env/Slew-v1, got --env "
            "drm_env/SlewThesis-v0",
        ),
        (["linear", "--scenarios", "6"], "multiple of 4"),
        (["linear", "--suite", "thesis"], "lists its manoeuvres"),
    ],
)
def test_what_cannot_be_is_one_clear_line(
    tmp_path: Path, arguments: list[str], message: str
) -> None:
    result = drm("tune", *arguments, "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.stderr.split())
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


def test_help_names_every_option() -> None:
    result = drm("tune", "--help")
    assert result.exit_code == 0
    for option in (
        "--suite", "--scenarios", "--trials", "--steps", "--env", "--seed", "--out", "--package",
    ):  # fmt: skip
        assert option in result.stdout


@pytest.mark.parametrize("space", [*GAINS.values(), *SETTINGS.values(), *LEARNING.values()])
def test_every_dimension_says_what_it_is(space: tuple[Dimension, ...]) -> None:
    for dimension in space:
        assert dimension.unit
        assert dimension.reason
        assert dimension.choices or dimension.low < dimension.high
        assert not dimension.log or dimension.choices or dimension.low > 0.0
        assert dimension.start is None or dimension.holds(dimension.start)


@pytest.mark.parametrize("algorithm", LEARNING)
def test_searched_settings_are_settings(algorithm: str) -> None:
    base = hyperparameters.load_hyperparameters(algorithm)
    assert learners.learning_settings(base, learners.learning_parameters(base)) == base
    for high in (False, True):
        drawn = {
            each.name: (each.choices or (each.low, each.high))[-1 if high else 0]
            for each in LEARNING[algorithm]
        }
        settings = learners.learning_settings(base, drawn)
        assert settings != base
        text = toml.toml_of(settings, "made for\n\na test")
        assert hyperparameters.from_data(tomllib.loads(text)) == settings


def test_toml_holds_whatever_settings_hold() -> None:
    base = hyperparameters.load_hyperparameters("ppo")
    env = {"mass": {"uniform": [1.0, 2.0]}, "a.b": [True, 'it\'s "so"', 1e-7]}
    settings = dataclasses.replace(base, env=env)
    assert hyperparameters.from_data(tomllib.loads(toml.toml_of(settings))) == settings


@pytest.mark.parametrize("environment", [learners.ENV_ID, "drm_env/Slew-v0"])
@pytest.mark.parametrize("algorithm", LEARNING)
def test_packaging_settings_keeps_a_row_a_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, algorithm: str, environment: str
) -> None:
    training = pytest.importorskip("drm_baselines.rl.training")
    base = hyperparameters.load_hyperparameters(algorithm)
    flown = []

    def train(directory: Path, asked: Any, *, watcher: Any, force: bool) -> Any:
        number = len(flown)
        flown.append(asked)
        directory.mkdir()
        if number == 1:
            raise BaselineError("come to NaN")
        metre = Mock(estimate=Mock(return_value=Mock(value=[3e-3, np.nan, 2e-3, np.inf][number])))
        watcher.evaluated(Point(steps=asked.steps, wall_time=0.5, episodes=metre))
        return Mock(status="finished", steps=asked.steps, wall_time=0.5)

    monkeypatch.setattr(training, "train", train)
    monkeypatch.setattr(packaging, "resources", Mock(files=Mock(return_value=tmp_path / "package")))
    given = [] if environment == learners.ENV_ID else ["--env", environment]
    name = f"{algorithm}_direct" if given else algorithm
    monkeypatch.chdir(tmp_path)
    result = drm("tune", algorithm, *given, "--steps", 10, "--trials", 4, "--package")
    assert result.exit_code == 0, result.output
    assert [row["number"] for row in rows(tmp_path / "results" / "tune" / name)] == list("0123")
    assert {asked.env_id for asked in flown} == {environment}
    assert flown[0].settings == base
    judged = algorithm in packaging.JUDGED
    place = ("benchmark", "learners") if judged else ("rl", "hyperparameters")
    folder, stem = tmp_path.joinpath("package", *place), name if judged else algorithm
    assert sorted(file.name for file in folder.iterdir()) == [
        f"{stem}.search.json", f"{stem}.toml",
    ]  # fmt: skip
    record = json.loads((folder / f"{stem}.search.json").read_text())
    found = hyperparameters.load_hyperparameters(algorithm, folder / f"{stem}.toml")
    assert found == flown[2].settings == hyperparameters.from_data(record["settings"])
    assert record["trials"] == {"count": 4, "pruned": 1, "best": 2}
    assert record["objective"]["value"] == pytest.approx(2.0)
    assert record["objective"]["first"] == pytest.approx(3.0)
    assert record["search"]["seed"] == 0
    asked_for = " ".join(["drm tune", algorithm, *given])
    assert record["command"] == f"{asked_for} --steps 10 --trials 4 --seed 0"
    assert record["name"] == name
    values = [row["value"] for row in record["record"]]
    assert values == [pytest.approx(3.0), None, pytest.approx(2.0), 1e3 * trials.LOST]
    assert record["record"][1]["reason"] == "come to NaN"
    for row, asked in zip(record["record"], flown, strict=True):
        assert learners.learning_settings(base, row["parameters"]) == asked.settings
        assert row["seconds"] >= 0.0


@pytest.mark.parametrize("name", ["ppo", "ppo_direct", "ppo_robust", "ppo_flexible"])
def test_shipped_policies_were_trained_with_the_settings_of_their_file(name: str) -> None:
    """The task as it comes out: a file may have to say what was a default in their time."""
    settings = hyperparameters.load_hyperparameters("ppo", packaging.learner_file(name))
    runs = runs_in(shipped_runs() / name)
    assert list(runs) == list(range(10))
    for seed, run in runs.items():
        policy = json.loads((run / "policy.json").read_text())
        training = policy["training"]
        assert training["seed"] == seed
        trained = hyperparameters.from_data(training["hyperparameters"])
        assert dataclasses.replace(trained, env=settings.env) == settings
        env = drm_env.DrmEnv(config=policy["config"])
        assert env.config == environment_config(policy["env_id"], settings.env)
        env.close()


def test_what_learns_on_the_flexible_arm_is_what_learns_on_the_thesis_arm() -> None:
    """Settings untouched; the task differs."""
    first, flexible = (
        hyperparameters.load_hyperparameters("ppo", packaging.learner_file(name))
        for name in ("ppo", "ppo_flexible")
    )
    assert dataclasses.replace(flexible, env=first.env) == first


@pytest.mark.parametrize("name", ["sac", "sac_direct"])
def test_learners_of_the_benchmark_are_what_their_search_found(name: str) -> None:
    file = packaging.learner_file(name)
    record = json.loads(file.with_name(f"{name}.search.json").read_text())
    algorithm = name.removesuffix("_direct")
    settings = hyperparameters.load_hyperparameters(algorithm, file)
    assert hyperparameters.from_data(record["settings"]) == settings
    assert record["name"] == name
    start = file.with_name(f"{name}.start.toml")
    assert record["command"].endswith(f"{start.parent.name}/{start.name}")
    assert record["command"].startswith(f"drm tune {algorithm} ")
    assert ("--env drm_env/Slew-v0" in record["command"]) == (name != algorithm)
    values = [row["value"] for row in record["record"]]
    assert record["objective"]["value"] == min(value for value in values if value is not None)
    began = hyperparameters.load_hyperparameters(algorithm, start)
    assert settings == learners.learning_settings(began, record["parameters"])
    known, first = learners.learning_parameters(began), record["record"][0]["parameters"]
    for dimension in LEARNING[algorithm]:
        if dimension.holds(known[dimension.name]):
            assert first[dimension.name] == pytest.approx(known[dimension.name])


@pytest.mark.slow
def test_settings_of_learning_are_searched(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    arguments: list[Any] = ["tune", "ppo", "--steps", 1, "--out", tmp_path / "a"]
    first = drm(*arguments, "--trials", 1)
    assert first.exit_code == 0, first.output
    kept = (tmp_path / "a" / "trial_000" / "run.json").read_bytes()
    second = drm(*arguments, "--trials", 2, "--json")
    assert second.exit_code == 0, second.output
    assert (tmp_path / "a" / "trial_000" / "run.json").read_bytes() == kept
    content = json.loads(second.stdout)
    table = rows(tmp_path / "a")
    assert [row["state"] for row in table] == ["complete", "complete"]
    for row in table:
        folder = tmp_path / "a" / f"trial_{int(row['number']):03d}"
        with (folder / "evaluations.csv").open(newline="") as stream:
            last = list(csv.DictReader(stream))[-1]
        assert float(row["value"]) == pytest.approx(1e3 * float(last["tip_error_rms"]), rel=1e-12)
        assert int(last["steps"]) >= 1
    best = hyperparameters.load_hyperparameters("ppo", tmp_path / "a" / "best.toml")
    run = tmp_path / "a" / f"trial_{content['trials']['best']:03d}" / "run.json"
    stored = json.loads(run.read_text())["hyperparameters"]
    assert hyperparameters.from_data(stored) == best
    packaged = json.loads((tmp_path / "a" / "trial_000" / "run.json").read_text())
    assert hyperparameters.from_data(packaged["hyperparameters"]) == (
        hyperparameters.load_hyperparameters("ppo")
    )
    refused = drm(*arguments, "--trials", 2, "--seed", 1)
    assert refused.exit_code == 2
    assert "seed 0, not 1" in " ".join(refused.stderr.split())
    whole = drm("tune", "ppo", "--steps", 1, "--out", tmp_path / "b", "--trials", 2)
    assert whole.exit_code == 0, whole.output
    assert rows(tmp_path / "b") == table


@pytest.mark.slow
def test_settings_of_a_file_are_searched_and_packaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("stable_baselines3")
    base = dataclasses.replace(hyperparameters.load_hyperparameters("ppo"), learning_rate=1.5e-3)
    start = tmp_path / "start.toml"
    start.write_text(toml.toml_of(base), encoding="utf-8")
    monkeypatch.setattr(packaging, "resources", Mock(files=Mock(return_value=tmp_path / "package")))
    result = drm(
        "tune", "ppo", "--steps", 1, "--trials", 1, "--hyperparameters", start,
        "--out", tmp_path / "a", "--package",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    folder = tmp_path / "package" / "benchmark" / "learners"
    found = hyperparameters.load_hyperparameters("ppo", folder / "ppo.toml")
    assert found.learning_rate == pytest.approx(1.5e-3)
    record = json.loads((folder / "ppo.search.json").read_text())
    assert [row["trial"] for row in record["record"]] == [0]
    assert record["record"][0]["parameters"]["learning_rate"] == pytest.approx(1.5e-3)
    assert f"--hyperparameters {start}" in record["command"]
