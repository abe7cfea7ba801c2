"""The Stable-Baselines3 adapter against `DummyVecEnv` around single environments; training."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import drm_env

sb3 = pytest.importorskip("stable_baselines3")

from stable_baselines3.common.env_util import make_vec_env  # noqa: E402
from stable_baselines3.common.evaluation import evaluate_policy  # noqa: E402
from stable_baselines3.common.monitor import Monitor, load_results  # noqa: E402
from stable_baselines3.common.vec_env import (  # noqa: E402
    DummyVecEnv,
    VecEnv,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
)

from drm_env.sb3 import DrmSB3VecEnv, make_sb3_vec, native_batch  # noqa: E402

ID = "drm_env/Slew-v0"
WHOLE_EPISODE = ("metrics/", "diverged", "is_success")
STAGGERED: dict[str, Any] = {
    "horizon": 0.4,
    "initial_beta": (0.0, 0.02),
    "limits": {"tip_deflection": 0.03},
}


def dummy(n: int, **options: Any) -> DummyVecEnv:
    return DummyVecEnv([lambda: gym.make(ID, **options)] * n)


def assert_same_infos(actual: list[dict[str, Any]], expected: list[dict[str, Any]]) -> None:
    """The same keys and numbers, but what is said of the whole episode in the last info alone."""
    assert len(actual) == len(expected)
    for one, other in zip(actual, expected, strict=True):
        over = "terminal_observation" in other
        keys = {key for key in other if over or not key.startswith(WHOLE_EPISODE)}
        assert one.keys() == keys
        for key in keys:
            assert isinstance(other[key], type(one[key])), key
            np.testing.assert_equal(one[key], other[key], err_msg=key)


@pytest.mark.parametrize("options", [{"horizon": 0.12}, STAGGERED], ids=["together", "staggered"])
def test_equals_dummy_vec_env(options: dict[str, Any]) -> None:
    ours, theirs = make_sb3_vec(ID, n_envs=4, monitor=False, **options), dummy(4, **options)
    assert ours.seed(30) == theirs.seed(30)
    observations = ours.reset()
    np.testing.assert_array_equal(observations, theirs.reset())
    assert_same_infos(ours.reset_infos, theirs.reset_infos)
    rng = np.random.default_rng(0)
    finished = terminated = 0
    for _ in range(100):
        actions = rng.uniform(-1, 1, (4, 2)).astype(np.float32)
        step, expected = ours.step(actions), theirs.step(actions)
        for one, other in zip(step[:3], expected[:3], strict=True):
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other)
        assert_same_infos(step[3], expected[3])
        assert_same_infos(ours.reset_infos, theirs.reset_infos)
        for done, info in zip(step[2], step[3], strict=True):
            assert ("terminal_observation" in info) == bool(done)
            finished += bool(done)
            terminated += bool(done) and not info["TimeLimit.truncated"]
    assert finished > 8
    if options is STAGGERED:
        assert 0 < terminated < finished


def test_seeds_and_options_are_used_once() -> None:
    env = make_sb3_vec(ID, n_envs=2, monitor=False, horizon=0.1)
    env.seed(5)
    env.set_options([{"payload_mass": 60.0}, {"payload_mass": 70.0}])
    env.reset()
    masses = [info["context/payload_mass"] for info in env.reset_infos]
    assert masses == [60.0, 70.0]
    single = drm_env.DrmEnv(horizon=0.1)
    single.reset(seed=5)
    env.reset()
    assert_same_infos(env.reset_infos[:1], [single.reset()[1]])


def test_seed_of_make_reaches_the_first_reset() -> None:
    env = make_sb3_vec(ID, n_envs=3, seed=12, horizon=0.1)
    first = env.reset()
    single = drm_env.DrmEnv(horizon=0.1)
    for index in range(3):
        np.testing.assert_array_equal(first[index], single.reset(seed=12 + index)[0])


def test_returned_arrays_are_never_written_again() -> None:
    env = make_sb3_vec(ID, n_envs=2, monitor=False, horizon=0.05)
    env.seed(0)
    kept = [env.reset()]
    copies = [kept[0].copy()]
    infos: list[dict[str, Any]] = []
    for _ in range(12):
        observations, rewards, dones, step_infos = env.step(np.ones((2, 2), np.float32))
        kept += [observations, rewards, dones]
        copies += [observations.copy(), rewards.copy(), dones.copy()]
        infos += step_infos
    for one, other in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(one, other)
    assert len({id(info) for info in infos}) == len(infos)


def test_lean_infos_hold_everything_at_the_end_of_an_episode() -> None:
    full = make_sb3_vec(ID, n_envs=2, monitor=False, horizon=0.05)
    lean = make_sb3_vec(ID, n_envs=2, monitor=False, horizon=0.05, step_context=False)
    for env in (full, lean):
        env.seed(3)
        env.reset()
    for _ in range(11):
        actions = np.ones((2, 2), np.float32)
        _, _, dones, expected = full.step(actions)
        infos = lean.step(actions)[3]
        if dones.all():
            assert_same_infos(infos, expected)
        else:
            assert set(infos[0]) == {key for key in expected[0] if not key.startswith("context/")}


def test_attributes_and_methods_of_sub_environments() -> None:
    env = make_sb3_vec(ID, n_envs=3, monitor=False, horizon=0.1)
    env.seed(0)
    env.reset()
    assert env.get_attr("control_period") == [0.01] * 3
    assert env.get_attr("control_period", indices=1) == [0.01]
    env.set_attr("label", "right", indices=[2])
    assert env.get_attr("label", indices=2) == ["right"]
    with pytest.raises(AttributeError):
        env.get_attr("label", indices=0)
    assert not env.has_attr("nothing")
    env.env_method("set_context", indices=[0, 2], payload_mass=88.0)
    env.reset()
    masses = [info["context/payload_mass"] for info in env.reset_infos]
    assert masses[0] == masses[2] == 88.0 != masses[1]
    (snapshot,) = env.env_method("get_state", indices=0)
    assert isinstance(snapshot, bytes)
    assert env.env_is_wrapped(Monitor) == [False] * 3
    assert env.env_is_wrapped(Monitor, indices=[0]) == [False]


def test_images() -> None:
    env = make_sb3_vec(ID, n_envs=2, monitor=False, render_mode="rgb_array")
    env.reset()
    images = env.get_images()
    assert [image.shape for image in images if image is not None] == [images[0].shape] * 2  # type: ignore[union-attr]
    mosaic = env.render()
    assert mosaic is not None and mosaic.dtype == np.uint8
    silent = make_sb3_vec(ID, n_envs=2, monitor=False)
    silent.reset()
    with pytest.warns(UserWarning, match=r"rgb_array"):
        assert silent.get_images() == [None, None]


def test_monitor_is_added_unless_declined() -> None:
    assert isinstance(make_sb3_vec(ID, n_envs=2), VecMonitor)
    assert isinstance(make_sb3_vec(ID, n_envs=2, monitor=False), DrmSB3VecEnv)


def test_environments_of_others_are_refused() -> None:
    with pytest.raises(drm_env.ConfigError, match=r"Pendulum-v1"):
        make_sb3_vec("Pendulum-v1")


def test_wrappers_of_stable_baselines3() -> None:
    env = VecNormalize(VecFrameStack(make_sb3_vec(ID, n_envs=2, seed=0, **STAGGERED), 3))
    observations = env.reset()
    assert observations.shape == (2, 3 * env.unwrapped.observation_space.shape[0])  # type: ignore[index]
    for _ in range(60):
        observations, _, dones, infos = env.step(np.zeros((2, 2), np.float32))
        for done, info in zip(dones, infos, strict=True):
            if done:
                assert info["terminal_observation"].shape == observations[0].shape
                assert info["episode"]["l"] > 0
    assert np.isfinite(observations).all()


def test_evaluate_policy_gives_the_returns_of_the_metrics() -> None:
    env = make_sb3_vec(ID, n_envs=2, seed=0, horizon=0.1)
    model = sb3.PPO("MlpPolicy", env, n_steps=16, batch_size=16, device="cpu", seed=0)
    returns: list[float] = []

    def record(local: dict[str, Any], _: dict[str, Any]) -> None:
        if local["done"]:
            returns.append(local["info"]["metrics/episode_return"])

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        rewards, lengths = evaluate_policy(
            model, env, n_eval_episodes=4, return_episode_rewards=True, callback=record
        )
    assert lengths == [10] * 4
    np.testing.assert_allclose(rewards, returns, rtol=1e-5)


def test_ppo_and_sac_learn_with_it() -> None:
    env = make_sb3_vec(ID, n_envs=4, seed=0, horizon=0.2)
    ppo = sb3.PPO("MlpPolicy", env, n_steps=32, batch_size=64, device="cpu", seed=0)
    before = [parameter.detach().clone() for parameter in ppo.policy.parameters()]
    ppo.learn(512)
    assert any((a != b).any() for a, b in zip(before, ppo.policy.parameters(), strict=True))
    assert len(ppo.ep_info_buffer) > 0 and ppo.ep_info_buffer[0]["l"] == 20
    assert len(ppo.ep_success_buffer) > 0
    env = make_sb3_vec(ID, n_envs=2, seed=0, horizon=0.2)
    sac = sb3.SAC("MlpPolicy", env, learning_starts=64, batch_size=32, device="cpu", seed=0)
    sac.learn(300)
    assert sac.replay_buffer is not None and sac.replay_buffer.size() == 150
    # time limits are told apart from ends, so that values are bootstrapped
    assert sac.replay_buffer.timeouts[:150].sum() == sac.replay_buffer.dones[:150].sum() == 14


def test_action_errors_leave_the_batch_as_it_was() -> None:
    env = make_sb3_vec(ID, n_envs=2, monitor=False, horizon=0.1)
    with pytest.raises(drm_env.ResetNeededError):
        env.step(np.zeros((2, 2), np.float32))
    env.seed(0)
    env.reset()
    before = env.env_method("get_state")
    with pytest.raises(drm_env.ActionError, match=r"finite"):
        env.step(np.array([[0.0, 0.0], [0.0, np.nan]], np.float32))
    assert env.env_method("get_state") == before


def test_a_native_batch_takes_the_place_of_single_environments(tmp_path: Path) -> None:
    """As RL Baselines3 Zoo makes them: with options, seeds, a step limit and files of Monitor."""

    def singles(folder: str) -> VecEnv:
        spec = gym.spec("drm_env/Slew-v1")
        return make_vec_env(
            lambda **options: spec.make(**options), n_envs=3, seed=7,
            monitor_dir=str(tmp_path / folder),
            env_kwargs={"payload_mass": (60.0, 400.0), "max_episode_steps": 6},
        )  # fmt: skip

    theirs, ours = singles("theirs"), native_batch(singles("ours"))
    assert isinstance(ours.unwrapped, DrmSB3VecEnv)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    rng = np.random.default_rng(0)
    for _ in range(15):
        actions = rng.uniform(-1, 1, (3, 2)).astype(np.float32)
        for one, other in zip(ours.step(actions)[:3], theirs.step(actions)[:3], strict=True):
            np.testing.assert_array_equal(one, other)
    ours.close()
    theirs.close()
    kept, expected = load_results(str(tmp_path / "ours")), load_results(str(tmp_path / "theirs"))
    assert len(kept) == len(expected) == 6
    np.testing.assert_allclose(sorted(kept["r"]), sorted(expected["r"]), rtol=1e-5)
    assert [path.name for path in (tmp_path / "ours").iterdir()] == ["0.monitor.csv"]


def test_what_a_native_batch_cannot_be_is_refused() -> None:
    different = DummyVecEnv([lambda m=m: gym.make(ID, payload_mass=m) for m in (60.0, 70.0)])
    with pytest.raises(drm_env.ConfigError, match=r"1 has .*70\.0"):
        native_batch(different)
    different.reset()  # still open
    with pytest.raises(drm_env.ConfigError, match="CartPole"):
        native_batch(DummyVecEnv([lambda: gym.make("CartPole-v1")]))
    wrapped = DummyVecEnv([lambda: gym.wrappers.ClipReward(gym.make(ID), -1.0)])
    with pytest.raises(drm_env.ConfigError, match="ClipReward"):
        native_batch(wrapped)
