"""A law as a policy of an environment is the law that the engine flies by itself.

The environment is stepped at the laws' own sample period, so the only difference from
`drm_env.simulate` is that observations and actions pass through single precision.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import drm_env

METRICS = ("tip_error_rms", "peak_slew_angle", "residual_rms", "wheel_effort")


@pytest.mark.parametrize(
    ("law", "arm"),
    [
        ("linear", {"mass_error": 0.15}),
        ("lyapunov", {"mass_error": 0.15}),
        # where the wheels do not saturate: at their limits the rounding of an observation grows
        ("servo", {"mass_error": 0.02, "plant": "consistent", "damping_ratio": 0.005}),
    ],
    ids=["linear", "lyapunov", "servo"],
)
def test_law_as_policy_flies_the_simulated_manoeuvre(law: str, arm: dict[str, Any]) -> None:
    env = drm_env.DrmEnv(task="slew_thesis", **arm)
    control = drm_env.ControlLaw(law, task="slew_thesis", **arm)
    assert control.control_period == env.control_period == 0.002
    observation, _ = env.reset(seed=0)
    state, start = control.initial_state(1), np.array([True])
    truncated = False
    while not truncated:
        measured = control.measurements(observation[None])
        torques, state = control.torques(measured, state, start)
        start[:] = False
        action = torques[0] / control.torque_limits
        observation, _, _, truncated, info = env.step(action.astype(np.float32))
    expected = drm_env.simulate(env.scenario(), law=law).metrics
    # single precision has 6e-8; the clipped effort of the linear law amplifies it, and the servo
    # divides differences of the wheels' momentum by 2 ms
    within = 1e-3 if law == "servo" else 1e-4
    for name in METRICS:
        assert info[f"metrics/{name}"] == pytest.approx(expected[name], rel=within), name


def random_rows(n: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    spread = {
        "slew_error": 0.1,
        "slew_error_rate": 0.02,
        "link2_deflection": 0.05,
        "link2_deflection_rate": 0.5,
        "reference_rate": 0.1,
        "slew_torque": 500.0,
        "root_momentum": 100.0,
    }
    middle = {"extension": 5.0, "payload_mass": 200.0, "payload_length": 1.0, "payload_width": 0.5}
    names = drm_env.ControlLaw.MEASUREMENTS
    scale = [spread.get(name, 0.0) for name in names]
    offset = [middle.get(name, 0.0) for name in names]
    return np.asarray(rng.normal(size=(n, len(names))) * scale + offset)


@pytest.mark.parametrize("law", ["none", "linear", "lyapunov", "servo"])
def test_rows_do_not_touch_each_other(law: str) -> None:
    control = drm_env.ControlLaw(law)
    rows = random_rows(7)
    state, start = control.initial_state(7), np.ones(7, bool)
    alone = [control.initial_state(1) for _ in range(7)]
    for _ in range(3):
        torques, state = control.torques(rows, state, start)
        for i in range(7):
            one, alone[i] = control.torques(rows[i : i + 1], alone[i], start[i : i + 1])
            np.testing.assert_array_equal(one[0], torques[i])
            np.testing.assert_array_equal(alone[i][0], state[i])
        start = np.zeros(7, bool)
        rows = rows[::-1].copy()


def test_start_forgets_the_previous_rates() -> None:
    control = drm_env.ControlLaw("lyapunov")
    rows = random_rows(2)
    fresh, _ = control.torques(rows, control.initial_state(2), np.ones(2, bool))
    _, used = control.torques(rows * 2, control.initial_state(2), np.ones(2, bool))
    again, _ = control.torques(rows, used, np.array([True, False]))
    assert (again[0] == fresh[0]).all()
    assert again[1, 0] != fresh[1, 0]


def test_linear_law_is_its_formula() -> None:
    """T1 = -8e4 e' - 8e3 e and T2 = -500 beta' (thesis section 4.6.1), beta half the deflection."""
    rows = random_rows(20)
    control = drm_env.ControlLaw("linear")
    torques, _ = control.torques(rows, control.initial_state(20), np.ones(20, bool))
    np.testing.assert_allclose(torques[:, 0], -8e4 * rows[:, 1] - 8e3 * rows[:, 0], rtol=1e-13)
    np.testing.assert_allclose(torques[:, 1], -500.0 * rows[:, 3] / 2.0, rtol=1e-13)


def test_wrong_shapes_and_laws_are_refused() -> None:
    control = drm_env.ControlLaw("linear")
    with pytest.raises(drm_env.SimulationError, match=r"measurements must have shape \[2, 18\]"):
        control.torques(np.zeros((2, 5)), np.zeros((2, 3)), np.ones(2, bool))
    with pytest.raises(drm_env.SimulationError, match=r"state must have shape \[2, 22\]"):
        control.torques(np.zeros((2, 18)), np.zeros((3, 3)), np.ones(2, bool))
    with pytest.raises(drm_env.ConfigError, match="pid"):
        drm_env.ControlLaw("pid")


def test_servo_finds_the_true_mass_while_it_flies() -> None:
    """What the filter believes at the end of a slew, against the payload that was drawn."""
    options: dict[str, Any] = {"task": "slew_flexible", "control_period": 0.002, "horizon": 14.0}
    env = drm_env.DrmVectorEnv(6, **options)
    control = drm_env.ControlLaw("servo", **options)
    observation, info = env.reset(seed=3)
    state, start = control.initial_state(6), np.ones(6, bool)
    for _ in range(6500):
        measured = control.measurements(observation)
        torques, state = control.torques(measured, state, start)
        start[:] = False
        action = np.clip(torques / control.torque_limits, -1.0, 1.0)
        observation = env.step(action.astype(np.float32))[0]
    reported, true = info["context/reported_payload_mass"], info["context/payload_mass"]
    believed = reported * (1.0 + state[:, 4])
    assert (np.abs(reported / true - 1.0) > 0.03).any()
    np.testing.assert_allclose(believed, true, rtol=0.03)


def test_servo_keeps_the_flexible_arm_still() -> None:
    """Against the thesis' linear law on the same twelve episodes."""
    config = drm_env.resolve("drm_env/SlewFlexible-v0", horizon=30.0)
    scenarios = drm_env.sample_scenarios(config=config, seed=11, n=12)
    error = {
        law: np.median(drm_env.rollout(scenarios, law=law, seed=0)["tip_error_rms"])
        for law in ("linear", "servo")
    }
    assert error["servo"] < error["linear"] / 10.0
