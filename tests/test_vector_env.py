"""A batch is the single environments side by side, bit for bit.

`DrmVectorEnv` is compared with `gymnasium.vector.SyncVectorEnv` around single environments in all
three autoreset modes: observations, rewards, flags, infos with their masks. Batch sizes and numbers
of threads must not show in any number.
"""

from __future__ import annotations

import copy
import pickle
import time
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.wrappers.vector import DictInfoToList, NormalizeObservation, RecordEpisodeStatistics

import drm_env

ID = "drm_env/Slew-v0"
# Horizons that the lanes share, so short that several episodes pass; and limits so narrow that
# some lanes end earlier than others.
SHORT: dict[str, Any] = {"horizon": 0.12}
STAGGERED: dict[str, Any] = {
    "horizon": 0.4,
    "initial_beta": (0.0, 0.02),
    "limits": {"tip_deflection": 0.03},
}
MODES = list(AutoresetMode)


def sync(n: int, mode: AutoresetMode, env_id: str = ID, **options: Any) -> SyncVectorEnv:
    return SyncVectorEnv([lambda: gym.make(env_id, **options)] * n, autoreset_mode=mode)


def native(n: int, mode: AutoresetMode, env_id: str = ID, **options: Any) -> VectorEnv:
    return gym.make_vec(env_id, num_envs=n, autoreset_mode=mode, **options)


def actions_of(env: VectorEnv, count: int, seed: int = 5) -> np.ndarray:
    rng = np.random.default_rng(seed)
    shape = (count, *(env.action_space.shape or ()))
    return rng.uniform(-1, 1, shape).astype(np.float32)


def of_whole_episodes(key: str) -> bool:
    """Whether a batch says this of episodes that have ended alone."""
    return key.removeprefix("_").startswith(("metrics/", "diverged", "is_success"))


def assert_same_info(actual: dict[str, Any], expected: dict[str, Any], path: str = "") -> None:
    assert actual.keys() == expected.keys(), path
    for key, value in expected.items():
        where = f"{path}/{key}"
        if of_whole_episodes(key):
            assert actual[key].dtype == value.dtype, where
            if not key.startswith("_"):
                held = actual[f"_{key}"]
                assert (held <= expected[f"_{key}"]).all(), where
                np.testing.assert_array_equal(actual[key][held], value[held], err_msg=where)
            continue
        if isinstance(value, dict):
            assert_same_info(actual[key], value, where)
            continue
        assert actual[key].dtype == value.dtype, where
        assert actual[key].shape == value.shape, where
        if value.dtype == object:
            for one, other in zip(actual[key], value, strict=True):
                assert (one is None) == (other is None), where
                if one is not None:
                    assert one.dtype == other.dtype
                    np.testing.assert_array_equal(one, other, err_msg=where)
        else:
            np.testing.assert_array_equal(actual[key], value, err_msg=where)


def assert_same_step(actual: tuple[Any, ...], expected: tuple[Any, ...]) -> None:
    for one, other in zip(actual[:-1], expected[:-1], strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    assert_same_info(actual[-1], expected[-1])


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("options", [SHORT, STAGGERED], ids=["together", "staggered"])
@pytest.mark.parametrize("n", [1, 3])
def test_autoreset_equals_sync_vector_env(
    n: int, options: dict[str, Any], mode: AutoresetMode
) -> None:
    ours, theirs = native(n, mode, **options), sync(n, mode, **options)
    assert_same_step(ours.reset(seed=21), theirs.reset(seed=21))
    ends = 0
    for actions in actions_of(ours, 90):
        step = ours.step(actions)
        assert_same_step(step, theirs.step(actions))
        done = step[2] | step[3]
        last = step[-1]
        if mode is AutoresetMode.SAME_STEP and done.any():
            last = last["final_info"]
        for key in ("_metrics/duration", "_diverged", "_is_success"):
            np.testing.assert_array_equal(last[key], done)
        ends += int(done.sum())
    assert ends >= 2 * n
    # an unseeded reset goes on with each lane's own stream
    assert_same_step(ours.reset(), theirs.reset())
    assert_same_step(ours.step(actions), theirs.step(actions))


def test_every_id_equals_sync_vector_env(env_id: str) -> None:
    options = {"horizon": 0.06, "control_period": 0.01}
    ours = native(3, AutoresetMode.SAME_STEP, env_id, **options)
    theirs = sync(3, AutoresetMode.SAME_STEP, env_id, **options)
    assert_same_step(ours.reset(seed=0), theirs.reset(seed=0))
    for actions in actions_of(ours, 40):
        assert_same_step(ours.step(actions), theirs.step(actions))


def test_staggered_episodes_end_at_different_steps() -> None:
    env = native(3, AutoresetMode.NEXT_STEP, **STAGGERED)
    env.reset(seed=21)
    partial = terminated = truncated = 0
    for actions in actions_of(env, 90):
        _, _, ended, cut, _ = env.step(actions)
        done = ended | cut
        partial += bool(done.any() and not done.all())
        terminated += int(ended.sum())
        truncated += int(cut.sum())
    assert partial and terminated and truncated


def test_disabled_autoreset_equals_sync_vector_env() -> None:
    ours = native(3, AutoresetMode.DISABLED, **STAGGERED)
    theirs = sync(3, AutoresetMode.DISABLED, **STAGGERED)
    assert_same_step(ours.reset(seed=21), theirs.reset(seed=21))
    resets = 0
    for index, actions in enumerate(actions_of(ours, 90)):
        step = ours.step(actions)
        assert_same_step(step, theirs.step(actions))
        done = step[2] | step[3]
        if done.any():
            resets += 1
            seeds: Any = [100 + index, None, 300 + index]
            options = {"payload_mass": 99.0} if index % 2 else {}
            again = [
                env.reset(seed=seeds, options={**options, "reset_mask": done.copy()})
                for env in (ours, theirs)
            ]
            assert_same_step(again[0], again[1])
    assert resets >= 3


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_masked_reset_amid_autoreset_equals_sync_vector_env(mode: AutoresetMode) -> None:
    ours, theirs = native(3, mode, **STAGGERED), sync(3, mode, **STAGGERED)
    assert_same_step(ours.reset(seed=2), theirs.reset(seed=2))
    for index, actions in enumerate(actions_of(ours, 60)):
        assert_same_step(ours.step(actions), theirs.step(actions))
        if index % 7 == 3:
            mask = np.array([True, index % 2 == 0, False])
            again = [env.reset(options={"reset_mask": mask.copy()}) for env in (ours, theirs)]
            assert_same_step(again[0], again[1])


def test_options_dictionary_of_the_caller_is_left_alone() -> None:
    env = native(2, AutoresetMode.DISABLED, **SHORT)
    env.reset(seed=0)
    options = {"reset_mask": np.array([True, False]), "payload_mass": 77.0}
    _, info = env.reset(options=options)
    assert set(options) == {"reset_mask", "payload_mass"}
    assert info["context/payload_mass"].tolist() == [77.0, 0.0]
    assert info["_context/payload_mass"].tolist() == [True, False]


def lanes_against_singles(n: int, steps: int, num_threads: int | None, **options: Any) -> None:
    batch = drm_env.DrmVectorEnv(n, autoreset_mode="SameStep", num_threads=num_threads, **options)
    singles = [drm_env.DrmEnv(**options) for _ in range(n)]
    observations, _ = batch.reset(seed=1000)
    for index, single in enumerate(singles):
        assert observations[index].tobytes() == single.reset(seed=1000 + index)[0].tobytes()
    for actions in actions_of(batch, steps):
        observations, rewards, terminated, truncated, info = batch.step(actions)
        for index, single in enumerate(singles):
            one = single.step(actions[index])
            assert one[1] == rewards[index]
            assert (one[2], one[3]) == (terminated[index], truncated[index])
            if one[2] or one[3]:
                assert info["final_obs"][index].tobytes() == one[0].tobytes()
                assert observations[index].tobytes() == single.reset()[0].tobytes()
            else:
                assert observations[index].tobytes() == one[0].tobytes()


@pytest.mark.parametrize("n", [1, 3, 64])
def test_lanes_are_the_single_environments(n: int) -> None:
    lanes_against_singles(n, 45, None, **STAGGERED)


@pytest.mark.parametrize(
    "options",
    [
        {"angle_noise": 1e-4, "deflection_rate_noise": 1e-3, "sensor_delay": (0.0, 0.02)},
        {
            "deployment_mode": ["coincident", "none", "force_limited"],
            "slew_max_accel": (0.01, 0.04),
        },
        {"particle_following": True, "axial_load": False, "tip_torque": "tip_only"},
        {"inner_law": "lyapunov", "control_period": 0.02, "action_rate_limit": 4.0},
        {"task": "slew_flexible", "inner_law": "servo"},
        {"root_lag": (0.0, 0.02), "tip_dead_time": (0.0, 0.01), "tip_momentum_limit": 0.2},
    ],
    ids=["sensors", "deployments", "dynamics", "inner law", "flexible", "wheels"],
)
def test_lanes_are_the_single_environments_for_other_options(options: dict[str, Any]) -> None:
    # 13 lanes fill no pack of four or eight evenly
    lanes_against_singles(13, 30, 2, horizon=0.22, **options)


@pytest.mark.slow
def test_lanes_are_the_single_environments_in_a_batch_of_1000() -> None:
    lanes_against_singles(1000, 25, None, **{**STAGGERED, "horizon": 0.2})


@pytest.mark.slow
def test_lanes_are_the_single_environments_over_whole_manoeuvres() -> None:
    lanes_against_singles(11, 2100, 2, control_period=0.01, horizon=20.0)


@pytest.mark.filterwarnings("ignore:num_threads")
@pytest.mark.parametrize("num_threads", [1, 2, 3, 7])
def test_number_of_threads_does_not_show(num_threads: int) -> None:
    reference = drm_env.DrmVectorEnv(50, num_threads=1, **STAGGERED)
    threaded = drm_env.DrmVectorEnv(50, num_threads=num_threads, **STAGGERED)
    assert_same_step(threaded.reset(seed=4), reference.reset(seed=4))
    for actions in actions_of(reference, 60):
        assert_same_step(threaded.step(actions), reference.step(actions))


def test_seed_forms() -> None:
    env = drm_env.DrmVectorEnv(3, **SHORT)
    by_number, _ = env.reset(seed=9)
    by_list, _ = env.reset(seed=[9, 10, 11])
    np.testing.assert_array_equal(by_number, by_list)
    np.testing.assert_array_equal(by_number, env.reset(seed=np.int64(9))[0])  # type: ignore[arg-type]
    one = drm_env.DrmEnv(**SHORT)
    huge = 2**70
    np.testing.assert_array_equal(env.reset(seed=huge)[0][1], one.reset(seed=huge + 1)[0])
    with pytest.raises(drm_env.ConfigError, match=r"seed must have 3 entries, got 2"):
        env.reset(seed=[1, 2])


def test_unseeded_lanes_differ() -> None:
    _, info = drm_env.DrmVectorEnv(16, **SHORT).reset()
    assert len(set(info["context/payload_mass"].tolist())) == 16


def test_returned_arrays_are_never_written_again() -> None:
    env = native(4, AutoresetMode.NEXT_STEP, **STAGGERED)
    kept = [env.reset(seed=1)]
    copies = [copy.deepcopy(kept[0])]
    for actions in actions_of(env, 50):
        kept.append(env.step(actions))
        copies.append(copy.deepcopy(kept[-1]))
    for one, other in zip(kept, copies, strict=True):
        assert_same_step(one, other)


def test_shared_arrays_are_read_only() -> None:
    env = native(2, AutoresetMode.NEXT_STEP, **SHORT)
    _, info = env.reset(seed=0)
    for key in ("context/payload_mass", "_context/payload_mass"):
        with pytest.raises(ValueError, match=r"read-only"):
            info[key][0] = 0


def test_copy_false_reuses_its_arrays_and_gives_the_same_numbers() -> None:
    reused = native(3, AutoresetMode.SAME_STEP, copy=False, **STAGGERED)
    fresh = native(3, AutoresetMode.SAME_STEP, **STAGGERED)
    first = reused.reset(seed=3)
    assert_same_step(first, fresh.reset(seed=3))
    for actions in actions_of(fresh, 60):
        step = reused.step(actions)
        assert step[0] is first[0]
        assert_same_step(step, fresh.step(actions))


def test_spaces_and_metadata() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        env = gym.make_vec(ID, num_envs=5)
    single = gym.make(ID)
    assert env.single_observation_space == single.observation_space
    assert env.single_action_space == single.action_space
    assert env.observation_space.shape == (5, *single.observation_space.shape)  # type: ignore[misc]
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert isinstance(env.unwrapped, drm_env.DrmVectorEnv)
    observations, _ = env.reset(seed=0)
    assert observations in env.observation_space


def test_max_episode_steps_of_make_vec() -> None:
    env = gym.make_vec(ID, num_envs=2, max_episode_steps=7)
    env.reset(seed=0)
    ends = [bool(env.step(actions)[3].all()) for actions in actions_of(env, 7)]
    assert ends == [False] * 6 + [True]
    with pytest.warns(UserWarning, match=r"longer than the horizon"):
        longer = gym.make_vec(ID, num_envs=2, max_episode_steps=700, horizon=0.05)
    longer.reset(seed=0)
    assert [bool(longer.step(a)[3].all()) for a in actions_of(longer, 5)] == [False] * 4 + [True]


def test_specification_makes_the_same_batch_again() -> None:
    options = {"payload_mass": (60.0, 300.0), "deployment_mode": ["coincident", "none"]}
    mode = AutoresetMode.SAME_STEP
    env = gym.make_vec(ID, num_envs=3, autoreset_mode=mode, **SHORT, **options)
    assert env.spec is not None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        again = gym.make_vec(EnvSpec.from_json(env.spec.to_json()))
    assert again.num_envs == 3
    assert again.metadata["autoreset_mode"] is mode
    assert_same_step(env.reset(seed=6), again.reset(seed=6))
    for actions in actions_of(env, 20):
        assert_same_step(env.step(actions), again.step(actions))


def test_record_episode_statistics() -> None:
    env = RecordEpisodeStatistics(native(3, AutoresetMode.NEXT_STEP, **SHORT))
    reference = RecordEpisodeStatistics(sync(3, AutoresetMode.NEXT_STEP, **SHORT))
    env.reset(seed=0)
    reference.reset(seed=0)
    episodes = 0
    for actions in actions_of(env, 30):
        info, expected = env.step(actions)[-1], reference.step(actions)[-1]
        assert ("episode" in info) == ("episode" in expected)
        if "episode" in info:
            episodes += 1
            np.testing.assert_array_equal(info["episode"]["r"], expected["episode"]["r"])
            np.testing.assert_array_equal(info["episode"]["l"], expected["episode"]["l"])
            np.testing.assert_allclose(info["episode"]["r"], info["metrics/episode_return"])
    assert episodes >= 2


def test_other_vector_wrappers() -> None:
    env = DictInfoToList(NormalizeObservation(native(3, AutoresetMode.NEXT_STEP, **STAGGERED)))
    observations, infos = env.reset(seed=0)
    assert len(infos) == 3
    assert all("context/payload_mass" in info for info in infos)  # type: ignore[operator]
    for actions in actions_of(env, 40):
        observations, _, _, _, infos = env.step(actions)
    assert np.isfinite(observations).all()


def test_context_per_sub_environment() -> None:
    env = native(3, AutoresetMode.SAME_STEP, **SHORT).unwrapped
    assert isinstance(env, drm_env.DrmVectorEnv)
    env.set_context(payload_mass=np.array([60.0, 70.0, 80.0]), mass_error=0.1)
    _, info = env.reset(seed=0)
    assert info["context/payload_mass"].tolist() == [60.0, 70.0, 80.0]
    assert info["context/mass_error"].tolist() == [0.1] * 3
    for actions in actions_of(env, 13):
        info = env.step(actions)[-1]
    assert info["context/payload_mass"].tolist() == [60.0, 70.0, 80.0]
    env.envs[1].set_context(payload_mass=222.0)
    _, info = env.reset(options={"slew_angle": np.array([0.5, 0.6, 0.7])})
    assert info["context/payload_mass"].tolist() == [60.0, 222.0, 80.0]
    assert info["context/slew_angle"].tolist() == [0.5, 0.6, 0.7]
    env.set_context()
    _, info = env.reset()
    assert len(set(info["context/payload_mass"].tolist()) | {60.0, 222.0, 80.0}) == 6


def test_attributes_of_sub_environments() -> None:
    env = drm_env.DrmVectorEnv(2, **SHORT)
    env.reset(seed=0)
    assert env.get_attr("control_period") == (0.01, 0.01)
    env.set_attr("label", ["left", "right"])
    assert env.get_attr("label") == ("left", "right")
    assert len(env.call("get_state")) == 2
    with pytest.raises(ValueError, match=r"length 2, got 3"):
        env.set_attr("label", [1, 2, 3])
    with pytest.raises(AttributeError, match=r"no attribute 'nothing'"):
        env.get_attr("nothing")


def test_frames_of_every_sub_environment() -> None:
    env = gym.make_vec(ID, num_envs=3, render_mode="rgb_array")
    env.reset(seed=0)
    frames = env.render()
    assert frames is not None and len(frames) == 3
    single = gym.make(ID, render_mode="rgb_array")
    single.reset(seed=1)
    np.testing.assert_array_equal(frames[1], single.render())
    texts = gym.make_vec(ID, num_envs=2, render_mode="ansi")
    texts.reset(seed=0)
    assert all(isinstance(text, str) for text in texts.render() or ())


@pytest.mark.parametrize("way", ["state", "pickle", "deepcopy"])
@pytest.mark.parametrize("mode", MODES)
def test_snapshot_of_a_batch_continues_with_the_same_bits(mode: AutoresetMode, way: str) -> None:
    options = {**STAGGERED, "angle_noise": 1e-4, "sensor_delay": 0.006}
    env = native(5, mode, **options).unwrapped
    assert isinstance(env, drm_env.DrmVectorEnv)
    env.reset(seed=8)
    actions = actions_of(env, 60)
    taken = 12 if mode is AutoresetMode.DISABLED else 37
    for action in actions[:taken]:
        step = env.step(action)
        if mode is AutoresetMode.DISABLED and (step[2] | step[3]).any():
            env.reset(options={"reset_mask": step[2] | step[3]})
    if way == "state":
        again = native(5, mode, **options).unwrapped
        assert isinstance(again, drm_env.DrmVectorEnv)
        again.set_state(env.get_state())
    elif way == "pickle":
        again = pickle.loads(pickle.dumps(env))  # noqa: S301
    else:
        again = copy.deepcopy(env)
    for action in actions[taken:]:
        step = env.step(action)
        assert_same_step(again.step(action), step)
        if mode is AutoresetMode.DISABLED and (step[2] | step[3]).any():
            mask = step[2] | step[3]
            assert_same_step(
                again.reset(options={"reset_mask": mask}), env.reset(options={"reset_mask": mask})
            )


def test_sub_environment_and_single_environment_exchange_snapshots() -> None:
    batch = drm_env.DrmVectorEnv(5, **SHORT)
    batch.reset(seed=0)
    actions = actions_of(batch, 12)
    for action in actions[:6]:
        batch.step(action)
    single = drm_env.DrmEnv(**SHORT)
    single.set_state(batch.envs[3].get_state())
    batch.envs[1].set_state(single.get_state())
    repeated = actions[6:].copy()
    repeated[:, 1] = repeated[:, 3]
    for action in repeated[:5]:
        observations, rewards, _, _, info = batch.step(action)
        observation, reward, _, _, single_info = single.step(action[3])
        assert observations[3].tobytes() == observations[1].tobytes() == observation.tobytes()
        assert rewards[3] == rewards[1] == reward
        for key, value in single_info.items():
            if not of_whole_episodes(key):
                np.testing.assert_equal(info[key][1], value)


def test_other_vectorizations_of_gymnasium_give_the_same_numbers() -> None:
    env = native(2, AutoresetMode.NEXT_STEP, **STAGGERED)
    others = [
        gym.make_vec(ID, num_envs=2, vectorization_mode=mode, **STAGGERED)
        for mode in ("sync", "async")
    ]
    first = env.reset(seed=1)
    for other in others:
        np.testing.assert_array_equal(other.reset(seed=1)[0], first[0])
    for actions in actions_of(env, 30):
        step = env.step(actions)
        for other in others:
            for one, expected in zip(other.step(actions)[:4], step[:4], strict=True):
                np.testing.assert_array_equal(one, expected)
    for other in others:
        other.close()


def test_interpreter_is_free_during_a_step() -> None:
    """A second Python thread runs while one long call of the engine is under way."""
    import threading

    env = drm_env.DrmVectorEnv(300, num_threads=1, control_period=1.0)
    env.reset(seed=0)
    actions = np.zeros((300, 2), np.float32)
    buffers = env._allocate()
    ticks: list[float] = []
    stop = threading.Event()

    def tick() -> None:
        while not stop.wait(0.0005):
            ticks.append(time.perf_counter())

    thread = threading.Thread(target=tick)
    thread.start()
    begin = time.perf_counter()
    env._engine.step(actions, *buffers)
    end = time.perf_counter()
    stop.set()
    thread.join()
    assert sum(begin < moment < end for moment in ticks) >= 3


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_coordinates_are_the_signals_of_the_manoeuvre(plant: str) -> None:
    options = {"plant": plant, "payload_mass": 300.0, "mass_error": 0.0, "angle_noise": 1e-3}
    env = drm_env.DrmVectorEnv(3, **options)
    env.reset(seed=0)
    np.testing.assert_array_equal(env.coordinates, np.zeros((3, 6)))
    for _ in range(50):
        env.step(np.zeros((3, 2), dtype=np.float32))
    scenario = {"plant": plant, "payload": {"mass": 300.0}}
    names = ("slew_angle", "alpha", "beta", "slew_rate", "alpha_rate", "beta_rate")
    flown = drm_env.simulate(scenario, law="none", decimation=1)
    expected = np.array([flown[name][250] for name in names])
    np.testing.assert_array_equal(env.coordinates, np.tile(expected, (3, 1)))


def test_an_ended_environment_that_is_restored_is_not_stepped() -> None:
    env = drm_env.DrmVectorEnv(3, autoreset_mode=AutoresetMode.DISABLED, **SHORT)
    env.reset(seed=0)
    actions = actions_of(env, 12)
    for action in actions:
        ended = env.step(action)
    assert ended[3].all()
    over = env.get_state()
    env.reset(seed=1)
    env.step(actions[0])
    env.set_state(over)
    with pytest.raises(drm_env.ResetNeededError):
        env.step(actions[0])
    env.reset(seed=1)
    env.step(actions[0])


def test_old_names_of_sub_environments_still_work_and_say_the_new_ones() -> None:
    batch = drm_env.DrmVectorEnv(2)
    with pytest.warns(DeprecationWarning, match="envs"):
        assert batch.lanes == batch.envs
    with pytest.warns(DeprecationWarning, match="reset_envs"):
        observations = batch.reset_lanes([0, 1], [{}, {}])
    np.testing.assert_array_equal(observations, batch.reset(seed=0)[0])
