"""The suites are frozen: what is in the files, and that nobody trains on it."""

from __future__ import annotations

import csv
import io
from importlib import resources

import numpy as np
import pytest

import drm_env
from drm_baselines import suites
from drm_baselines.errors import BaselineError
from drm_baselines.support.seeds import TRAINING_SEED

FILES = ("thesis", "robust", "heavy", "rough", "flexible")


@pytest.mark.parametrize("name", FILES)
def test_generator_makes_the_frozen_file(name: str) -> None:
    frozen = (resources.files("drm_baselines.suites") / "data" / f"{name}.csv").read_text(
        encoding="utf-8"
    )
    assert suites.text_of(suites.generate(name)) == frozen


@pytest.mark.parametrize("name", suites.SUITES)
def test_suite_has_its_episodes_and_every_one_can_be_flown(name: str) -> None:
    manoeuvres = suites.load(name)
    assert len(manoeuvres) == manoeuvres.suite.episodes == len(manoeuvres.strata)
    some = [manoeuvres.scenarios[index] for index in range(0, len(manoeuvres), 97)]
    flown = drm_env.rollout([{**scenario, "horizon": 0.02} for scenario in some])
    assert np.isfinite(flown["tip_error_rms"]).all()


def test_draws_are_within_what_the_suites_say() -> None:
    for name, (low, high) in {"robust": (50.0, 500.0), "heavy": (500.0, 3000.0)}.items():
        scenarios = suites.load(name).scenarios
        mass = np.array([scenario["payload"]["mass"] for scenario in scenarios])
        error = np.array([scenario["mass_error"] for scenario in scenarios])
        assert low <= mass.min() < mass.max() <= high
        assert -0.15 <= error.min() < -0.14
        assert 0.14 < error.max() <= 0.15


def test_strata_are_equally_large() -> None:
    manoeuvres = suites.load("robust")
    names, counts = np.unique(manoeuvres.strata, return_counts=True)
    assert sorted(names) == sorted(title for title, _, _ in suites.STRATA)
    assert set(counts) == {250}


def test_flexible_is_the_environment_of_its_name() -> None:
    config = drm_env.resolve("drm_env/SlewFlexible-v0").to_dict()
    drawn = config["randomize"]
    for scenario in suites.load("flexible").scenarios:
        for name in ("root_wheel", "tip_wheel", "sensors", "plant", "modes"):
            assert scenario[name] == config["scenario"][name]
        for name, value in {
            "payload_offset": scenario["payload"]["offset"],
            "link1_bending_stiffness": scenario["arm"]["link1"]["bending_stiffness"],
            "link2_bending_stiffness": scenario["arm"]["link2"]["bending_stiffness"],
            "damping_ratio": scenario["dynamics"]["damping_ratio"],
        }.items():
            low, high = drawn[name]["uniform"]
            assert low <= value <= high


@pytest.mark.slow
def test_wheels_of_flexible_hold_what_the_servo_asks_of_them() -> None:
    """Every twentieth episode, without limits: none needs more than there is, one most of it."""
    scenarios = [dict(scenario) for scenario in suites.load("flexible").scenarios[::20]]
    limits = {name: scenarios[0][f"{name}_wheel"]["momentum_limit"] for name in ("root", "tip")}
    for scenario in scenarios:
        for name in limits:
            wheel = scenario[f"{name}_wheel"]
            scenario[f"{name}_wheel"] = {**wheel, "momentum_limit": None}
    signals = [f"{name}_momentum" for name in limits]
    flown = drm_env.rollout(scenarios, law="servo", seed=0, signals=signals, decimation=25)
    flights = [flown.trajectory(index) for index in range(len(scenarios))]
    for name, limit in limits.items():
        stored = max(float(np.abs(flight[f"{name}_momentum"]).max()) for flight in flights)
        # with -s: what the limits were chosen by
        print(f"{name} wheel: {stored:.0f} of {limit:.0f} N m s")
        assert 0.8 * limit < stored <= limit


def test_unmodelled_flies_the_manoeuvres_of_robust_on_another_plant() -> None:
    for first, second in zip(
        suites.load("robust").scenarios, suites.load("unmodelled").scenarios, strict=True
    ):
        assert second["plant"] == "consistent"
        assert second["modes"] == [4, 4]
        assert first["payload"] == second["payload"]
        assert first["deployment"] == second["deployment"]


def test_seeds_of_the_suites_are_apart_from_training() -> None:
    last = suites.SUITE_SEED + 1_000_000 * len(suites.SUITES)
    assert last < 900_000_000 < TRAINING_SEED


def test_reported_dimensions_do_not_tell_the_true_mass() -> None:
    scenario = suites.load("robust").scenarios[0]
    config = {"scenario": scenario}
    env = drm_env.DrmEnv(config=config)
    try:
        _, info = env.reset(seed=0)
    finally:
        env.close()
    mass = info["context/reported_payload_mass"]
    table = np.interp(mass, [50.0, 200.0, 350.0, 500.0], [0.1, 1.0, 1.5, 2.0])
    assert info["context/reported_payload_length"] == pytest.approx(table, rel=1e-12)
    assert info["context/payload_length"] != info["context/reported_payload_length"]


def test_unknown_suite_is_named() -> None:
    with pytest.raises(BaselineError, match=r"'rubust'.*robust"):
        suites.load("rubust")


def test_file_has_a_row_an_episode() -> None:
    rows = list(csv.DictReader(io.StringIO(suites.text_of(suites.generate("thesis")))))
    assert [int(row["episode"]) for row in rows] == list(range(108))
    assert {row["mass_error"] for row in rows} == {"0.0", "0.15", "-0.15"}
