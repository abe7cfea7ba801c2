"""The receding-horizon controller: what it reaches, what it finds out, what it must not know."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_baselines import suites
from drm_baselines.benchmark.competitors import BOUND_EPISODES, RECEDING_EPISODES, competitors
from drm_baselines.benchmark.runner import fingerprint
from drm_baselines.errors import BaselineError
from drm_baselines.optimal_control import lower_bound
from drm_baselines.optimal_control.mpc import (
    Controller,
    Receding,
    RecedingPilot,
    fly_all,
    fly_one,
    told,
)

SETTINGS = Receding()
ROBUST = suites.load("robust").scenarios
SHORT = {"payload": {"mass": 200.0}, "slew": {"angle": 0.2}, "horizon": 10.0}


def start(
    scenario: Mapping[str, Any], seed: int = 0
) -> tuple[drm_env.DrmVectorEnv, np.ndarray, Controller]:
    env = drm_env.DrmVectorEnv(1, config=SETTINGS.config(scenario))
    observations, info = env.reset(seed=[seed])
    names = [f"context/reported_payload_{name}" for name in ("mass", "length", "width")]
    whole = asdict(env.config.scenario)
    payload = [float(info[name][0]) for name in names]
    return env, observations, Controller(told(whole, payload), whole["sensors"], SETTINGS)


def flown(scenario: Mapping[str, Any], decisions: int) -> tuple[Controller, np.ndarray, np.ndarray]:
    """Fly some decisions; return the controller, observations and actions."""
    env, observations, controller = start(scenario)
    seen, done = [], []
    for _ in range(decisions):
        seen.append(observations[0].copy())
        done.append(controller.act(observations[0]))
        observations, *_ = env.step(done[-1][None])
    env.close()
    return controller, np.array(seen), np.array(done)


def test_possible_manoeuvre_with_exact_mass_is_near_the_bound() -> None:
    scenario = {"payload": {"mass": 200.0}, "slew": {"smoothing": 0.1}}
    best = lower_bound.bound_of(scenario).flown
    assert fly_one(scenario)["tip_error_rms"] < 5.0 * best + 2e-6


def test_saturated_manoeuvre_with_wrong_mass_is_near_the_bound() -> None:
    index = 0
    best = lower_bound.bound_of(ROBUST[index]).flown
    assert best > 1e-3
    assert best < fly_one(ROBUST[index])["tip_error_rms"] < 1.2 * best


@pytest.mark.parametrize("error", [-0.15, 0.15])
def test_identifies_a_misreported_mass(error: float) -> None:
    controller, _, _ = flown({**SHORT, "mass_error": error}, 25)
    assert controller.identified() == pytest.approx(200.0, rel=0.002)
    assert controller.mass == pytest.approx(200.0, rel=0.005)


def test_state_of_link_1_is_found_without_being_measured() -> None:
    env, observations, controller = start({**SHORT, "mass_error": 0.1, "initial": {"alpha": 1e-3}})
    for _ in range(50):
        observations, *_ = env.step(controller.act(observations[0])[None])
    controller.act(observations[0])
    assert controller.observer.state[1] == pytest.approx(env.coordinates[0, 1], abs=5e-6)
    env.close()


def test_same_observations_give_the_same_torques_whatever_the_truth_is() -> None:
    """Two payloads are reported alike; the controller of one is shown the other's flight."""
    reported = {"mass": 200.0, "length": 1.0, "width": 0.5}
    light = {**SHORT, "payload": {"mass": 180.0}, "reported_payload": reported}
    heavy = {**SHORT, "payload": {"mass": 220.0}, "reported_payload": reported}
    _, seen, done = flown(light, 30)
    _, others, _ = flown(heavy, 30)
    np.testing.assert_array_equal(seen[0], others[0])
    assert not np.array_equal(seen[2], others[2])
    env, _, controller = start(heavy)
    env.close()
    np.testing.assert_array_equal([controller.act(one) for one in seen], done)


def test_what_is_told_holds_nothing_of_the_truth() -> None:
    scenario = {
        **SHORT,
        "payload": {"mass": 170.0, "length": 0.9},
        "mass_error": 0.1,
        "initial": {"alpha": 1e-3},
        "plant": "consistent",
    }
    whole = asdict(drm_env.DrmVectorEnv(1, config=SETTINGS.config(scenario)).config.scenario)
    other = copy.deepcopy(whole)
    other["payload"].update(mass=300.0, length=1.7)
    other.update(mass_error=-0.1, plant="thesis", initial={})
    other["dynamics"]["damping_ratio"] = 0.004
    reported = (187.0, 0.9, 0.45)
    found = told(whole, reported)
    assert found == told(other, reported)
    assert found["payload"] == {"inertia": "full", "mass": 187.0, "length": 0.9}


def test_flights_do_not_depend_on_processes() -> None:
    scenarios = [{**SHORT, "mass_error": error} for error in (0.1, -0.1)]
    calls: list[tuple[int, int]] = []
    one = fly_all(scenarios, processes=1, progress=lambda done, total: calls.append((done, total)))
    two = fly_all(scenarios, processes=2)
    assert calls == [(1, 2), (2, 2)]
    assert set(one) == {*drm_env.rollout(scenarios, law="linear"), "plans"} - {"episode_return"}
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name])


def test_noise_lag_and_delay_are_flown() -> None:
    scenario = next(s for s in suites.load("rough").scenarios if s["slew"]["angle"] < 0.5)
    linear = drm_env.rollout([scenario], law="linear")["tip_error_rms"][0]
    assert fly_one(scenario)["tip_error_rms"] < 0.1 * linear


def test_the_flexible_arm_is_flown_though_it_is_damped_as_the_thesis_plant_is_not() -> None:
    scenario = {**SHORT, "plant": "consistent", "dynamics": {"damping_ratio": 0.005}}
    assert fly_one(scenario)["tip_error_rms"] > 0.0


def test_bad_input_is_refused() -> None:
    with pytest.raises(BaselineError, match="none to fly"):
        fly_all([])
    with pytest.raises(BaselineError, match="seeds: 2 of them for 1 scenarios"):
        fly_all([SHORT], seeds=[0, 1])
    with pytest.raises(BaselineError, match="processes must be at least 1, got 0"):
        fly_all([SHORT], processes=0)
    with pytest.raises(BaselineError, match=r"scenarios\[0\].*payload\.mass.*-1"):
        fly_all([{**SHORT, "payload": {"mass": -1.0}}], processes=1)
    with pytest.raises(BaselineError, match=r"sensors\.delay must be at most 0\.02 s"):
        fly_one({**SHORT, "sensors": {"delay": 0.05}})


def test_settings_are_part_of_the_fingerprint_and_episodes_of_the_bounds() -> None:
    controller = next(one for one in competitors() if one.policy == "receding")
    manoeuvres = suites.load("thesis")
    softer = type(controller)(
        policy="receding", pilot=RecedingPilot(settings=Receding(effort=1e-2))
    )
    assert fingerprint(controller, manoeuvres) != fingerprint(softer, manoeuvres)
    for name, suite in suites.SUITES.items():
        total = len(suites.load(suite.name))
        own, bounds = (
            set(range(0, total, total // counts.get(name, total)))
            for counts in (RECEDING_EPISODES, BOUND_EPISODES)
        )
        assert own <= bounds or bounds <= own


def test_an_observer_that_is_lost_gives_no_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    env = drm_env.DrmVectorEnv(1, config=Receding().config({}), num_threads=1)
    observations, _ = env.reset(seed=0)
    whole = asdict(env.config.scenario)
    controller = Controller(told(whole, (200.0, 1.0, 0.5)), whole["sensors"], Receding())
    assert np.isfinite(controller.act(observations[0])).all()
    monkeypatch.setattr(controller.observer, "look", lambda *_: np.full(6, np.nan))
    for _ in range(3):
        np.testing.assert_array_equal(controller.act(observations[0]), np.zeros(2))
    env.close()
