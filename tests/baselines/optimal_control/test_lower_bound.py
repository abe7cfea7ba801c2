"""The bound: what the programme predicts is what the engine flies, and nobody is better."""

from __future__ import annotations

import numpy as np
import pytest

import drm_env
from drm_baselines import suites
from drm_baselines.optimal_control import lower_bound
from drm_baselines.optimal_control.quadratic_program import (
    closed_loop,
    linear_feedback,
    propagate,
    rms,
)

# Wheels that saturate (about every fourth manoeuvre of the suite), and wheels that do not.
SOME = suites.load("robust").scenarios[::143]


@pytest.fixture(scope="module")
def bounds() -> list[lower_bound.Bound]:
    return lower_bound.bounds_of(SOME)


def test_flight_gives_the_predicted_error(bounds: list[lower_bound.Bound]) -> None:
    for found in bounds:
        assert found.solved
        assert found.flown == pytest.approx(found.predicted, rel=0.02, abs=2e-6)


def test_torques_are_within_the_limits(bounds: list[lower_bound.Bound]) -> None:
    for found in bounds:
        assert (np.abs(found.torques) <= [100.0, 10.0]).all()


@pytest.mark.parametrize("law", ["none", "linear", "lyapunov"])
def test_no_law_is_better(bounds: list[lower_bound.Bound], law: str) -> None:
    flown = drm_env.rollout(SOME, law=law)["tip_error_rms"]
    assert (np.array([found.flown for found in bounds]) < flown).all()


def test_no_small_change_of_the_torques_is_better(bounds: list[lower_bound.Bound]) -> None:
    """First-order optimality of a saturated manoeuvre, by flights."""
    index = int(np.argmax([found.flown for found in bounds]))
    scenario, best = SOME[index], bounds[index]
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(20, *best.torques.shape)) * [3.0, 0.3]
    torques = np.clip(best.torques + noise, [-100.0, -10.0], [100.0, 10.0])
    flown = drm_env.rollout([scenario] * 20, torques=torques, hold=lower_bound.HOLD)[
        "tip_error_rms"
    ]
    assert (flown >= best.flown * (1.0 - 1e-3)).all()


def test_thesis_manoeuvre_is_possible_within_a_tenth_of_a_millimetre() -> None:
    found = lower_bound.bound_of({"payload": {"mass": 200.0}})
    assert found.flown < 1e-4


def test_wheels_of_the_bound_are_ideal() -> None:
    scenario = {
        "horizon": 20.0,
        "sensors": {"angle_noise": 1e-3},
        "root_wheel": {"lag": 0.1, "torque_limit": 50.0},
    }
    assert lower_bound.ideal(scenario) == {"horizon": 20.0, "root_wheel": {"torque_limit": 50.0}}


def test_closed_loop_model_is_the_law_in_the_loop() -> None:
    """Where no wheel saturates, the model with a law inside is a flight under the law."""
    scenario = {"payload": {"mass": 100.0}, "mass_error": 0.01, "slew": {"smoothing": 0.1}}
    law = {
        "name": "linear",
        "root": {"rate_gain": 5.0e4, "angle_gain": 2.0e3},
        "tip": {"rate_gain": 100.0},
    }
    fine = drm_env.transitions(scenario, hold=1)
    model = closed_loop(fine, linear_feedback(law), 10)
    _, errors = propagate(model, np.zeros((len(model.offset), 2)))
    flown = drm_env.rollout([scenario], law=law)
    assert flown["saturation"][0] == 0.0
    assert rms(errors) == pytest.approx(flown["tip_error_rms"][0], rel=1e-3)
