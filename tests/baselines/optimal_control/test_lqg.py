"""The LQG: a public state that finds the payload, stability, and how it flies the flexible arm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import drm_env
from drm_baselines.optimal_control.lqg import STATE, Lqg, LqgLaw, LqgPilot
from drm_baselines.policies.pilots import pilot_named
from drm_baselines.stability import Loop, closed_loop, growth_rate
from drm_baselines.stability.closed_loop import STABLE


@pytest.fixture(scope="module")
def law() -> LqgLaw:
    return LqgLaw()


@pytest.fixture(scope="module")
def scenarios() -> list[dict[str, Any]]:
    return drm_env.sample_scenarios("slew_flexible", seed=5, n=4, horizon=16.0)


@pytest.mark.slow
@pytest.mark.parametrize(("stiffness", "mass_error"), [(1.0, 0.0), (0.9, 0.15), (1.1, -0.15)])
def test_the_arm_with_all_its_modes_is_stable(
    law: LqgLaw, stiffness: float, mass_error: float
) -> None:
    """Two modes are designed for; the arm has eight, and half of the damping."""
    loop = Loop(period=law.control_period, stiffness=stiffness, damping_ratio=0.0025)
    for extension, mass in ((1.0, 50.0), (8.0, 50.0), (8.0, 500.0)):
        found = closed_loop(law, extension, mass, reported=mass * (1.0 + mass_error), loop=loop)
        assert growth_rate(found, loop.period) < STABLE


def test_the_state_tells_the_payload(law: LqgLaw, scenarios: list[dict[str, Any]]) -> None:
    state, start = law.initial_state(len(scenarios)), np.ones(len(scenarios), dtype=np.bool_)

    def ask(seen: np.ndarray) -> np.ndarray:
        nonlocal state, start
        torques, state = law.torques(seen, state, start)
        start = np.zeros(len(scenarios), dtype=np.bool_)
        return torques

    flown = drm_env.rollout(scenarios, ask, law_period=law.control_period, seed=1)
    wrong = np.array([scenario["mass_error"] for scenario in scenarios])
    identified = state[:, STATE.index("mass_error")]
    assert np.abs(wrong).max() > 0.05
    # true over reported, less 1
    assert np.abs(identified - (1.0 / (1.0 + wrong) - 1.0)).max() < 0.05
    assert np.isfinite(state).all() and not flown["diverged"].any()


def test_it_holds_the_tip_where_the_open_loop_loses_it(scenarios: list[dict[str, Any]]) -> None:
    flown = LqgPilot().fly(scenarios, seed=1)
    without = drm_env.rollout(scenarios, seed=1)
    assert (flown["tip_error_rms"] < 0.25 * without["tip_error_rms"]).all()
    # what the misreported mass alone would leave, it takes away but for a tenth
    left = np.abs(without["final_slew_error"]).max()
    assert (np.abs(flown["final_slew_error"]) < 0.1 * left).all()


def test_one_flight_is_that_of_many(scenarios: list[dict[str, Any]]) -> None:
    short = [{**scenario, "horizon": 2.0} for scenario in scenarios]
    pilot = pilot_named("lqg")
    together = pilot.fly(short, seed=3)["tip_error_rms"]
    alone = pilot.trajectory(short[1], seed=4).metrics["tip_error_rms"]
    assert together[1] == pytest.approx(alone, rel=1e-9)


def test_weights_without_a_regulator_are_refused() -> None:
    from drm_baselines.errors import BaselineError

    law = LqgLaw(Lqg(root_effort=float("nan")))
    seen = np.zeros((1, len(law.MEASUREMENTS)))
    with pytest.raises(BaselineError, match="no regulator for 35 kg at 1 m"):
        law.torques(seen, law.initial_state(1), [True])
