"""Control laws as policies: the same law as the engine's, in the shapes that SB3 expects."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import drm_env
from drm_baselines import PolicyError, make_policy

# laws at the default period, and observations made up here; that both warn is tested elsewhere
pytestmark = pytest.mark.filterwarnings("ignore::drm_baselines.PolicyWarning")

FEEDBACK = ("linear", "lyapunov")


def observations_of(env_id: str, count: int, **options: Any) -> np.ndarray[Any, Any]:
    """Observations of a flight near the reference (no saturation), shape (count, d)."""
    env = gym.make(env_id, **options)
    env.action_space.seed(1)
    rows = [env.reset(seed=7)[0]]
    while len(rows) < count:
        rows.append(env.step(0.002 * env.action_space.sample())[0])
    env.close()
    return np.array(rows)


@pytest.mark.parametrize("name", ["none", *FEEDBACK])
def test_shapes_and_range(name: str) -> None:
    policy = make_policy(name)
    assert policy.control_period == 0.002
    observations = observations_of("drm_env/Slew-v0", 6)
    single, _ = policy.predict(observations[0])
    batch, _ = policy.predict(observations)
    for action, shape in ((single, (2,)), (batch, (6, 2))):
        assert action.shape == shape
        assert action.dtype == np.float32
        assert np.abs(action).max() <= 1.0


@pytest.mark.parametrize("name", FEEDBACK)
def test_a_batch_is_its_rows_one_by_one(name: str) -> None:
    policy = make_policy(name, env=None)
    first, second = np.split(observations_of("drm_env/Slew-v0", 12), 2)
    _, state = policy.predict(first)
    together, _ = policy.predict(second, state=state)
    for row in range(len(first)):
        _, alone = policy.predict(first[row])
        action, _ = policy.predict(second[row], state=alone)
        np.testing.assert_array_equal(action, together[row])


def test_linear_law_is_its_equation() -> None:
    # T1 = -8e4 e' - 8e3 e, T2 = -500 beta', beta' half of link 2's tip deflection rate.
    layout = {entry.name: index for index, entry in enumerate(drm_env.observation_layout())}
    scale = {entry.name: entry.scale for entry in drm_env.observation_layout()}
    observation = np.zeros(len(layout), dtype=np.float32)
    for name, value in (
        ("slew_error", 1e-3), ("slew_error_rate", 2e-4), ("link2_deflection_rate", 6e-3),
    ):  # fmt: skip
        observation[layout[name]] = value / scale[name]
    action, _ = make_policy("linear").predict(observation)
    np.testing.assert_allclose(action * [100.0, 10.0], [-16.0 - 8.0, -500.0 * 3e-3], rtol=1e-5)


def test_lyapunov_memory_is_cleared_where_an_episode_starts() -> None:
    policy = make_policy("lyapunov")
    names = [entry.name for entry in drm_env.observation_layout()]
    before = np.zeros((2, len(names)), dtype=np.float32)
    before[:, names.index("extension")] = 0.5
    after = before.copy()
    after[:, names.index("slew_error_rate")] = 1e-3
    fresh, _ = policy.predict(after)
    _, state = policy.predict(before)
    cleared, _ = policy.predict(after, state=state, episode_start=np.array([True, False]))
    kept, _ = policy.predict(after, state=state)
    np.testing.assert_array_equal(cleared[0], fresh[0])
    np.testing.assert_array_equal(cleared[1], kept[1])
    assert (kept != fresh).any(), "the difference of rates must matter in this test"


@pytest.mark.parametrize("name", FEEDBACK)
def test_law_from_observations_flies_as_the_law_inside_the_engine(name: str) -> None:
    """One flight with the law as policy, one with it below a zero action, both every 2 ms.

    Observations are float32, so the torques agree to their rounding; the flights stay together
    to well below the size of the manoeuvre's errors.
    """
    options: dict[str, Any] = {
        "payload_mass": 300.0, "mass_error": 0.1, "control_period": 0.002, "horizon": 2.0,
    }  # fmt: skip
    outside = gym.make("drm_env/Slew-v0", **options)
    inside = gym.make("drm_env/Slew-v0", inner_law=name, **options)
    policy = make_policy(name, env=outside)
    observation, _ = outside.reset(seed=1)
    inside.reset(seed=1)
    state, start = None, np.array([True])
    angles, torques = [], []
    for _ in range(900):
        action, state = policy.predict(observation, state=state, episode_start=start)
        start = np.array([False])
        observation, *_ = outside.step(action)
        inside.step(np.zeros(2, np.float32))
        ours, theirs = outside.unwrapped.signals(), inside.unwrapped.signals()  # type: ignore[attr-defined]
        angles.append((ours["slew_angle"], theirs["slew_angle"]))
        torques.append((ours["root_torque"], theirs["root_torque"]))
    difference = np.abs(np.diff(np.array(angles), axis=1)).max()
    error = abs(angles[-1][1] - outside.unwrapped.signals()["reference_angle"])  # type: ignore[attr-defined]
    assert difference < 1e-3 * error
    # The first torque comes from identical states: float32 rounding only.
    np.testing.assert_allclose(torques[0][0], torques[0][1], rtol=1e-6, atol=1e-6)
    assert np.abs(np.array(torques)[:, 1]).max() > 10.0


def test_none_above_an_inner_law_is_zero_action() -> None:
    env = gym.make("drm_env/SlewResidual-v0")
    policy = make_policy("none", env=env)
    observation, _ = env.reset(seed=0)
    action, _ = policy.predict(observation)
    np.testing.assert_array_equal(action, np.zeros(2, np.float32))


def test_newest_frame_of_a_history_is_read() -> None:
    stacked = observations_of("drm_env/Slew-v0", 8, observation_history=3)[-1]
    plain = observations_of("drm_env/Slew-v0", 8)[-1]
    config = gym.make("drm_env/Slew-v0", observation_history=3).unwrapped.config  # type: ignore[attr-defined]
    np.testing.assert_array_equal(
        make_policy("linear", config=config).predict(stacked)[0],
        make_policy("linear").predict(plain)[0],
    )


def test_a_third_actuator_is_left_alone() -> None:
    env = gym.make("drm_env/SlewDirect-v0")
    observation, _ = env.reset(seed=0)
    observation, *_ = env.step(np.array([0.0, 0.0, 0.1], np.float32))
    action, _ = make_policy("linear", env=env).predict(observation)
    assert action.shape == (3,)
    assert action[2] == 0.0


def test_gains_can_be_given() -> None:
    observation = observations_of("drm_env/Slew-v0", 3)[-1]
    without_tip, _ = make_policy("linear", tip=None).predict(observation)
    full, _ = make_policy("linear").predict(observation)
    assert without_tip[1] == 0.0
    assert full[1] != 0.0
    assert without_tip[0] == full[0]
    with pytest.raises(drm_env.ConfigError, match="gain"):
        make_policy("linear", root={"gain": 1.0})


@pytest.mark.parametrize("name", ["pid", "Linear", ""])
def test_unknown_policies_are_refused_with_what_there_is(name: str) -> None:
    with pytest.raises(PolicyError, match="none, linear, lyapunov"):
        make_policy(name)


def test_hidden_payload_is_refused_by_the_law_that_needs_it() -> None:
    env = gym.make("drm_env/Slew-v0", observe_payload="hidden")
    with pytest.raises(PolicyError, match="hidden"):
        make_policy("lyapunov", env=env)
    observation, _ = env.reset(seed=0)
    assert make_policy("linear", env=env).predict(observation)[0].shape == (2,)


def test_a_law_on_top_of_an_inner_law_is_refused() -> None:
    with pytest.raises(PolicyError, match="two laws"):
        make_policy("linear", env=gym.make("drm_env/SlewResidual-v0"))


def test_foreign_environments_observations_and_states_are_refused() -> None:
    with pytest.raises(PolicyError, match="not an environment of drm-env"):
        make_policy("linear", env=gym.make("CartPole-v1"))
    with pytest.raises(PolicyError, match="not both"):
        make_policy("linear", env=gym.make("drm_env/Slew-v0"), config={})
    policy = make_policy("lyapunov")
    size = len(drm_env.observation_layout())
    with pytest.raises(PolicyError, match=f"{size} entries"):
        policy.predict(np.zeros(size + 1))
    _, state = policy.predict(np.zeros((2, size)))
    with pytest.raises(PolicyError, match="3 observations"):
        policy.predict(np.zeros((3, size)), state=state)
    with pytest.raises(PolicyError, match="episode_start"):
        policy.predict(np.zeros((3, size)), episode_start=np.ones(2, bool))


@pytest.mark.filterwarnings("ignore:Evaluation environment is not wrapped")
@pytest.mark.parametrize("name", FEEDBACK)
def test_evaluate_policy_agrees_on_single_and_vector_environments(name: str) -> None:
    """SB3's own evaluator, on the same seed: one environment, and a batch of two."""
    evaluation = pytest.importorskip("stable_baselines3.common.evaluation")
    sb3 = pytest.importorskip("drm_env.sb3")
    options: dict[str, Any] = {"payload_mass": 200.0, "mass_error": 0.05, "control_period": 0.002,
                               "horizon": 1.0}  # fmt: skip
    env = gym.make("drm_env/Slew-v0", **options)
    env.reset(seed=3)
    single, lengths = evaluation.evaluate_policy(
        make_policy(name, env=env), env, n_eval_episodes=1, return_episode_rewards=True
    )
    venv = sb3.make_sb3_vec("drm_env/Slew-v0", n_envs=2, seed=3, **options)
    batch, _ = evaluation.evaluate_policy(
        make_policy(name, env=venv), venv, n_eval_episodes=4, return_episode_rewards=True
    )
    assert lengths == [500]
    # Nothing is random here, so that all episodes are one: also after the automatic reset.
    np.testing.assert_allclose(batch, np.full(4, single[0]), rtol=1e-5)
