"""The slew motor's gear and drive shaft, at every door.

The physics of it (momentum, energy, two inertias on a spring) is tested beside the engine.
"""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import drm_env

SHAFT: dict[str, Any] = {"shaft_stiffness": 2e5, "shaft_damping": 500.0}
PLANT: dict[str, Any] = {
    "plant": "consistent", "horizon": 6.0, "dynamics": {"damping_ratio": 0.005},
}  # fmt: skip
FLIGHT: dict[str, Any] = PLANT | {"slew_motor": SHAFT}
OPTIONS: dict[str, Any] = {
    "mass_error": 0.0, "payload_mass": 200.0, "horizon": 6.0, "plant": "consistent",
    "damping_ratio": 0.005, "motor_shaft_stiffness": 2e5, "motor_shaft_damping": 500.0,
}  # fmt: skip


def test_motor_and_wheels_give_the_momentum_of_rotor_and_arm() -> None:
    """The arm's momentum is the impulse of the shaft, which swings about the motor's torque."""
    flown = drm_env.simulate(FLIGHT, loads=True)
    time, shaft, motor = flown["time"], flown["base_torque"], flown["motor_torque"]
    impulse = np.sum((shaft[1:] + shaft[:-1]) / 2.0 * np.diff(time))
    assert flown["angular_momentum"][-1] == pytest.approx(impulse, rel=2e-3)
    np.testing.assert_array_equal(motor, flown["slew_torque"])
    np.testing.assert_array_equal(flown["root_bending_moment_link1"], shaft)
    assert np.abs(shaft - motor).max() > 10.0
    assert abs(np.mean(shaft - motor)) < 0.1 * np.abs(motor).max()
    rigid = drm_env.simulate(PLANT, loads=True)
    np.testing.assert_array_equal(rigid["base_torque"], rigid["motor_torque"])


def test_current_speed_and_power_follow_the_gear_ratio() -> None:
    """Equation (4.3.4): torque over Ng kt, drag and rotor times Ng over kt."""
    thesis, half = (
        drm_env.simulate({"horizon": 6.0, "slew_motor": {"gear_ratio": ratio}}, loads=True)
        for ratio in (1845.0, 922.5)
    )
    default = drm_env.simulate({"horizon": 6.0}, loads=True)
    np.testing.assert_array_equal(thesis["motor_current"], default["motor_current"])
    of_torque = thesis["slew_torque"] / (1845.0 * 0.318)
    of_motion = thesis["motor_current"] - of_torque
    np.testing.assert_allclose(
        half["motor_current"], 2.0 * of_torque + of_motion / 2.0, rtol=1e-9, atol=1e-12
    )
    np.testing.assert_array_equal(thesis["slew_angle"], half["slew_angle"])


def test_every_door_flies_the_same() -> None:
    """Simulate, rollout, a network's episode, environments single and many."""
    alone = drm_env.simulate(FLIGHT)
    expected = alone.metrics["tip_error_rms"]
    assert expected > 2.0 * drm_env.simulate(PLANT).metrics["tip_error_rms"]
    np.testing.assert_array_equal(drm_env.rollout([FLIGHT] * 5)["tip_error_rms"], expected)
    env = gym.make("drm_env/Slew-v0", **OPTIONS)
    env.reset(seed=0)
    vec = gym.make_vec("drm_env/Slew-v0", 3, **OPTIONS)
    vec.reset(seed=0)
    ended, info, infos = False, {}, {}
    while not ended:
        *_, ended, info = env.step(np.zeros(2, np.float32))
        *_, infos = vec.step(np.zeros((3, 2), np.float32))
    assert info["metrics/tip_error_rms"] == expected
    np.testing.assert_array_equal(infos["metrics/tip_error_rms"], [expected] * 3)


def test_arms_with_and_without_a_shaft_fly_side_by_side() -> None:
    mixed = drm_env.rollout([PLANT, FLIGHT, PLANT, FLIGHT], law="linear")["tip_error_rms"]
    for scenario, found in zip([PLANT, FLIGHT], mixed[:2], strict=True):
        assert found == drm_env.simulate(scenario, "linear").metrics["tip_error_rms"]
    np.testing.assert_array_equal(mixed[:2], mixed[2:])


def test_a_snapshot_in_mid_flight_goes_on_with_the_same_bits() -> None:
    """The rotor's angle is part of it."""
    env = drm_env.DrmEnv(**OPTIONS)
    env.reset(seed=3)
    action = np.array([0.3, -0.2], np.float32)
    for _ in range(50):
        env.step(action)
    kept = env.get_state()
    ends = []
    for _ in range(2):
        env.set_state(kept)
        for _ in range(50):
            observation, *_ = env.step(action)
        ends.append(observation)
    np.testing.assert_array_equal(*ends)
    other = drm_env.DrmEnv(**OPTIONS)
    other.reset(seed=9)
    other.set_state(kept)
    for _ in range(50):
        observation, *_ = other.step(action)
    np.testing.assert_array_equal(observation, ends[0])


@pytest.mark.parametrize(
    "motor",
    [
        {"shaft_stiffness": 1.0},
        {"shaft_stiffness": 1e10},
        {"shaft_stiffness": 1e10, "shaft_damping": 1e8},
        {"shaft_stiffness": 1e5, "gear_ratio": 1.0},
        {"shaft_stiffness": 1e5, "gear_ratio": 1e5},
    ],
)
def test_ends_of_the_ranges_fly_and_stay_finite(motor: dict[str, Any]) -> None:
    flown = drm_env.simulate(PLANT | {"slew_motor": motor}, loads=True)
    if flown.metrics["diverged"]:
        # a spring that holds nothing leaves the arm where it is, a reference's turn away
        assert motor["shaft_stiffness"] == 1.0
        return
    assert all(np.isfinite(values).all() for values in flown.values())
    assert np.abs(flown["link2_tip_deflection"]).max() < 0.2


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        ({"slew_motor": SHAFT}, r"shaft_stiffness must be null in the thesis' plant.*200000"),
        (PLANT | {"slew_motor": {"shaft_damping": 5.0}}, r"shaft_damping must be 0 without.*5"),
        (PLANT | {"slew_motor": {"shaft_stiffness": 0.5}}, r"shaft_stiffness must be within.*0\.5"),
        (PLANT | {"slew_motor": SHAFT | {"shaft_damping": -1.0}}, r"shaft_damping.*-1"),
        (PLANT | {"slew_motor": {"shaft_stiffness": math.inf}}, r"shaft_stiffness.*inf"),
        ({"slew_motor": {"gear_ratio": 0.0}}, r"slew_motor\.gear_ratio must be within.*0"),
        (FLIGHT | {"modes": [8, 8]}, r"modes must be at most .* before a drive"),
    ],
)
def test_what_no_motor_has_is_refused(scenario: dict[str, Any], message: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=message):
        drm_env.simulate(scenario)
    with pytest.raises(drm_env.ConfigError, match=message):
        drm_env.rollout([scenario])


def test_as_many_modes_as_there_can_be_need_no_room_for_a_rotor() -> None:
    full = drm_env.simulate(PLANT | {"modes": [8, 8], "horizon": 0.1}, loads=True)
    np.testing.assert_array_equal(full["base_torque"], full["motor_torque"])


def test_a_mission_refuses_a_drive_shaft() -> None:
    content = {
        "scenario": FLIGHT | {"horizon": 20.0},
        "mission": {"legs": [{"kind": "slew", "angle": 0.3}]},
    }
    with pytest.raises(drm_env.ConfigError, match=r"shaft_stiffness must be null in a mission"):
        drm_env.simulate(content)
