"""The slew motor's limit in open loop, at every door."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import drm_env

LIMIT = 500.0
FREE: dict[str, Any] = {"horizon": 16.0}
LIMITED: dict[str, Any] = FREE | {"slew_motor": {"open_loop_limit": LIMIT}}


def test_the_torque_is_cut_and_nothing_else() -> None:
    """It is what the planned one is within the limit, and the limit elsewhere."""
    for plant in ("thesis", "consistent"):
        free = drm_env.simulate(FREE | {"plant": plant}, loads=True)
        limited = drm_env.simulate(LIMITED | {"plant": plant}, loads=True)
        planned = free["slew_torque"]
        assert np.abs(planned).max() > 1500.0
        np.testing.assert_array_equal(limited["slew_torque"], planned.clip(-LIMIT, LIMIT))
        excess = np.maximum(np.abs(planned) - LIMIT, 0.0)
        np.testing.assert_allclose(limited["motor_excess"], excess, atol=1e-9)
        assert limited.metrics["motor_excess_peak"] == pytest.approx(np.abs(planned).max() - LIMIT)
        assert not free["motor_excess"].any()
        np.testing.assert_array_equal(limited["reference_angle"], free["reference_angle"])


def test_the_arm_has_the_momentum_that_the_motor_gave() -> None:
    """And stays short of its target: its momentum is the impulse of the torque as it was cut."""
    flown = drm_env.simulate(LIMITED, loads=True)
    time, torque = flown["time"], flown["slew_torque"]
    impulse = np.sum((torque[1:] + torque[:-1]) / 2.0 * np.diff(time))
    assert flown["angular_momentum"][-1] == pytest.approx(impulse, rel=2e-3, abs=5.0)
    assert flown["slew_angle"][-1] < 0.8 * flown["reference_angle"][-1]


def test_a_limit_that_is_not_met_moves_nothing() -> None:
    """Not a bit."""
    free = drm_env.simulate(FREE, "linear")
    wide = drm_env.simulate(FREE | {"slew_motor": {"open_loop_limit": 1e4}}, "linear")
    for name, values in free.items():
        np.testing.assert_array_equal(wide[name], values)
    assert free.metrics == wide.metrics


def test_every_door_flies_the_same() -> None:
    """Simulate, rollout, a network's episode, environments single and many."""
    alone = drm_env.simulate(LIMITED)
    (peak,) = drm_env.rollout([LIMITED])["final_slew_error"]
    assert peak == alone.metrics["final_slew_error"]
    options: dict[str, Any] = {"mass_error": 0.0, "payload_mass": 200.0, "horizon": 16.0}
    env = gym.make("drm_env/Slew-v0", motor_torque_limit=LIMIT, **options)
    env.reset(seed=0)
    vec = gym.make_vec("drm_env/Slew-v0", 2, motor_torque_limit=LIMIT, **options)
    vec.reset(seed=0)
    ended = False
    info: dict[str, Any] = {}
    infos: dict[str, Any] = {}
    while not ended:
        *_, ended, info = env.step(np.zeros(2, np.float32))
        *_, infos = vec.step(np.zeros((2, 2), np.float32))
    assert info["metrics/final_slew_error"] == alone.metrics["final_slew_error"]
    np.testing.assert_array_equal(
        infos["metrics/final_slew_error"], [alone.metrics["final_slew_error"]] * 2
    )
    assert env.observation_space.shape is not None
    size = env.observation_space.shape[0]
    layers = [(np.zeros((2, size), np.float32), np.zeros(2, np.float32))]
    network = drm_env.Network(layers, activation="tanh", output="clip")
    flown = drm_env.rollout([LIMITED], policy=network, task="slew", horizon=16.0)
    assert flown["final_slew_error"][0] == alone.metrics["final_slew_error"]


def test_impossible_limits_are_refused() -> None:
    """By name and value."""
    with pytest.raises(drm_env.ConfigError, match=r"open_loop_limit must be positive.*-1"):
        drm_env.simulate({"slew_motor": {"open_loop_limit": -1.0}})
    with pytest.raises(drm_env.ConfigError, match=r"open_loop_limit must be positive.*0"):
        gym.make("drm_env/Slew-v0", motor_torque_limit=0.0)
