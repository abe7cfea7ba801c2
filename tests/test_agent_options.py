"""What an agent may see of the payload, and how far it may overrule an inner law."""

from __future__ import annotations

import numpy as np
import pytest

import drm_env
from drm_baselines import PolicyError, make_policy


def identified(error: float, seconds: float, **options: object) -> float:
    env = drm_env.DrmEnv(
        observe_identified=True, payload_mass=300.0, mass_error=error, inner_law="linear", **options
    )
    place = [entry.name for entry in env.unwrapped.observation_layout].index(
        "identified_mass_error"
    )
    scale = env.unwrapped.observation_layout[place].scale
    observation, _ = env.reset(seed=0)
    assert observation[place] == 0.0
    for _ in range(round(seconds / 0.01)):
        observation, *_ = env.step(np.array([0.3, -0.2], dtype=np.float32))
    env.close()
    return float(observation[place]) * scale


@pytest.mark.parametrize("error", [-0.15, -0.05, 0.0, 0.1])
def test_momentum_tells_the_true_mass(error: float) -> None:
    """Dimensions known: what is identified is true / reported - 1, up to the vibration."""
    found = identified(error, 5.0, payload_length=1.0, payload_width=0.5)
    assert found == pytest.approx(1.0 / (1.0 + error) - 1.0, abs=0.01)


def test_identification_needs_an_open_loop_slew() -> None:
    with pytest.raises(drm_env.ConfigError, match="observe_identified"):
        drm_env.DrmEnv(task="slew_direct", observe_identified=True)


def test_entry_is_there_only_when_asked_for() -> None:
    plain = [entry.name for entry in drm_env.observation_layout()]
    shown = [entry.name for entry in drm_env.observation_layout(observe_identified=True)]
    assert "identified_mass_error" not in plain
    assert [name for name in shown if name != "identified_mass_error"] == plain


def test_vector_shows_what_the_single_environment_shows() -> None:
    options = {"observe_identified": True, "wheel_scale": 2.0, "inner_law": "linear"}
    vector = drm_env.DrmVectorEnv(num_envs=3, **options)
    single = drm_env.DrmEnv(**options)
    observations, _ = vector.reset(seed=5)
    observation, _ = single.reset(seed=6)
    action = np.array([0.4, -0.7], dtype=np.float32)
    for _ in range(100):
        observations, *_ = vector.step(np.tile(action, (3, 1)))
        observation, *_ = single.step(action)
    np.testing.assert_array_equal(observations[1], observation)


def test_scaled_action_is_a_larger_torque_and_still_limited() -> None:
    def torque(scale: float, action: float) -> float:
        env = drm_env.DrmEnv(wheel_scale=scale)
        env.reset(seed=0)
        env.step(np.array([action, 0.0], dtype=np.float32))
        return float(env.unwrapped.signals()["root_torque"])

    assert torque(1.0, 0.25) == pytest.approx(25.0)
    assert torque(3.0, 0.25) == pytest.approx(75.0)
    assert torque(3.0, 1.0) == pytest.approx(100.0)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan")])
def test_impossible_scale_is_refused(scale: float) -> None:
    with pytest.raises(drm_env.ConfigError, match="wheel_scale"):
        drm_env.DrmEnv(wheel_scale=scale)


def test_learned_policy_flies_in_its_own_task_alone() -> None:
    policy = make_policy("learned")
    env = drm_env.DrmEnv(config=policy.config)
    again = make_policy("learned", env=env)
    observation, _ = env.reset(seed=0)
    action, _ = again.predict(observation)
    assert action.shape == env.action_space.shape
    with pytest.raises(PolicyError, match="observation"):
        make_policy("learned", config=drm_env.DrmEnv().config)
    with pytest.raises(PolicyError, match="no parameter 'gain'"):
        make_policy("learned", gain=1.0)


@pytest.mark.parametrize("name", ["lqr", "linear_tuned", "lyapunov_tuned"])
def test_tuned_laws_are_policies(name: str) -> None:
    policy = make_policy(name, config=drm_env.DrmEnv(control_period=0.002).config)
    assert policy.control_period == 0.002
    with pytest.raises(PolicyError, match="drm tune"):
        make_policy(name, tip=None)
