"""Loads of missions: told in the mission's own axes, and balanced over its legs.

What is expected are conservation laws, and what the legs say of themselves.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import drm_env

LEGS = [
    {"kind": "slew", "angle": 0.4, "extension": 3.0},
    {"kind": "wait_for_rest", "most": 2.0},
    {"kind": "grapple", "payload": {"mass": 150.0, "length": 1.0, "width": 0.5}},
    {"kind": "slew", "angle": -0.3, "extension": 4.0},
    {"kind": "hold", "duration": 1.0},
    {"kind": "release"},
    {"kind": "slew", "angle": 0.2},
]


def mission(plant: str) -> dict[str, Any]:
    return {
        "scenario": {
            "plant": plant,
            "deployment": {"start": 2.0},
            "slew": {"smoothing": 0.1},
            "dynamics": {"damping_ratio": 0.005} if plant == "consistent" else {},
        },
        "mission": {"legs": LEGS},
    }


@pytest.fixture(scope="module", params=["thesis", "consistent"])
def flight(request: pytest.FixtureRequest) -> drm_env.Trajectory:
    return drm_env.simulate(mission(request.param), law="linear", loads=True)


def test_the_tip_moves_on_where_a_leg_ends(flight: drm_env.Trajectory) -> None:
    step = np.hypot(np.diff(flight["tip_x"]), np.diff(flight["tip_y"]))
    speed = step / np.diff(flight["time"]).clip(1e-9)
    assert speed.max() < 3.0  # m/s; a leg told in its own axes would jump by metres
    angle = np.unwrap(np.arctan2(flight["tip_y"], flight["tip_x"]))
    np.testing.assert_allclose(angle - angle[0], flight["slew_angle"], atol=0.05)


def test_angular_momentum_is_what_the_base_and_the_payloads_bring(
    flight: drm_env.Trajectory,
) -> None:
    time, torque = flight["time"], flight["base_torque"]
    impulse = np.concatenate(([0.0], np.cumsum(torque[:-1] * np.diff(time))))
    brought = sum(
        leg.momentum * (time >= leg.start - 1e-9) for leg in flight.legs if leg.momentum != 0.0
    )
    momentum = flight["angular_momentum"] - flight["angular_momentum"][0]
    largest = np.abs(impulse).max()
    np.testing.assert_allclose(momentum, impulse + brought, atol=0.02 * largest)


def test_the_motors_energy_adds_up_over_the_legs(flight: drm_env.Trajectory) -> None:
    spent = sum(leg.metrics["slew_energy"] for leg in flight.legs)
    assert flight["motor_energy"][-1] == pytest.approx(spent, rel=1e-9)
    assert (np.diff(flight["motor_energy"]) >= 0.0).all()
    assert flight.metrics["motor_energy_peak"] == pytest.approx(spent, rel=1e-9)


def test_rollouts_keep_the_same_loads(flight: drm_env.Trajectory) -> None:
    plant = "thesis" if flight.metrics["tip_error_rms"] == _thesis() else "consistent"
    flown = drm_env.rollout(
        [mission(plant)] * 3, law="linear", loads=True, signals=["tip_x", "base_torque"]
    )
    rows = flight["time"].size
    for name in ("tip_x", "base_torque"):
        np.testing.assert_array_equal(flown.trajectories[name][2, :rows], flight[name])
    assert flown["base_torque_peak"][1] == flight.metrics["base_torque_peak"]


def _thesis() -> float:
    return drm_env.simulate(mission("thesis"), law="linear").metrics["tip_error_rms"]
