"""The single environment keeps Gymnasium's contract.

Spaces, types and fresh objects as `check_env` of Gymnasium and of Stable-Baselines3 demand; seeds;
infos; the specification through JSON and pickle; wrappers; rendering; what an import loads.
"""

from __future__ import annotations

import copy
import json
import pickle
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import (
    NormalizeObservation,
    RecordEpisodeStatistics,
    RecordVideo,
    RescaleAction,
    TimeLimit,
)

import drm_env

SHORT = {"horizon": 0.3}

OPTION_SETS: dict[str, dict[str, Any]] = {
    "fixed payload": {"payload_mass": 200.0, "mass_error": 0.0},
    "distributions": {
        "payload_mass": drm_env.LogUniform(20.0, 400.0),
        "slew_angle": drm_env.Normal(0.8, 0.1, low=0.5, high=1.1),
        "deployment_mode": ["coincident", "none"],
    },
    "noisy and late sensors": {
        "angle_noise": 1e-4,
        "rate_noise": 1e-4,
        "deflection_noise": 1e-4,
        "deflection_rate_noise": 1e-3,
        "sensor_delay": 0.01,
        "angle_resolution": 1e-5,
    },
    "history": {"observation_history": 4},
    "true payload": {"observe_payload": "true"},
    "hidden payload": {"observe_payload": "hidden"},
    "rate limit": {"action_rate_limit": 5.0},
    "inner law": {"inner_law": "lyapunov", "control_period": 0.02},
    "no preview": {"preview_times": []},
    "slow wheels": {"root_lag": 0.05, "tip_dead_time": 0.01, "tip_momentum_limit": 5.0},
    "one actuator": {"actuators": ["tip_wheel"]},
    "retraction": {"deployment_start": 8.0, "deployment_end": 1.0, "payload_mass": (100.0, 500.0)},
    "min energy": {"slew_profile": "min_energy", "slew_smoothing": 0.05},
}


def roll(env: gym.Env[Any, Any], actions: int, seed: int = 3) -> list[Any]:
    """Observations, rewards and flags of an episode under seeded random actions."""
    rng = np.random.default_rng(seed)
    observation, info = env.reset(seed=seed)
    records: list[Any] = [(observation, info)]
    for _ in range(actions):
        action = rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)
        records.append(env.step(action))
        if records[-1][2] or records[-1][3]:
            break
    return records


def assert_same_records(left: list[Any], right: list[Any]) -> None:
    assert len(left) == len(right)
    for one, other in zip(left, right, strict=True):
        assert one[0].tobytes() == other[0].tobytes()
        assert one[1:-1] == other[1:-1]
        assert one[-1].keys() == other[-1].keys()
        for key, value in one[-1].items():
            np.testing.assert_equal(value, other[-1][key], err_msg=key)


def test_check_env_of_gymnasium_has_nothing_to_say(env_id: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        check_env(gym.make(env_id, **SHORT).unwrapped)


def test_check_env_of_stable_baselines3_has_nothing_to_say(env_id: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        checker.check_env(gym.make(env_id, **SHORT).unwrapped, warn=True)


@pytest.mark.parametrize("name", OPTION_SETS)
def test_check_env_has_nothing_to_say_for_other_options(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        env = gym.make("drm_env/Slew-v0", **SHORT, **OPTION_SETS[name])
        check_env(env.unwrapped, skip_render_check=True)


def test_passive_checker_and_order_are_silent_over_an_episode(env_id: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        env = gym.make(env_id, horizon=0.1)
        records = roll(env, 1000)
    assert records[-1][3] is True
    assert records[-1][2] is False


def test_types_and_bounds_over_an_episode(env_id: str) -> None:
    env = gym.make(env_id, horizon=1.0)
    for observation, reward, terminated, truncated, info in roll(env, 10_000)[1:]:
        assert observation.dtype == np.float32
        assert observation in env.observation_space
        assert type(reward) is float
        assert np.isfinite(reward)
        assert type(terminated) is bool
        assert type(truncated) is bool
        assert all(type(value) is np.float64 for value in info.values())


def test_episode_is_truncated_at_the_horizon_and_reports_metrics() -> None:
    env = gym.make("drm_env/Slew-v0", horizon=0.5, control_period=0.01)
    records = roll(env, 1000)
    assert len(records) - 1 == 50
    assert env.spec is not None and env.spec.max_episode_steps == 50
    assert [record[3] for record in records[1:]] == [False] * 49 + [True]
    last = records[-1][4]
    assert last["metrics/duration"] == pytest.approx(0.5)
    assert last["metrics/episode_return"] == pytest.approx(sum(record[1] for record in records[1:]))
    assert last["diverged"] == 0.0
    assert last["is_success"] in (0.0, 1.0)


def test_reward_is_the_sum_of_its_terms(env_id: str) -> None:
    env = gym.make(env_id, horizon=0.3)
    terms = ("reward/tip_vibration", "reward/slew_error", "reward/effort")
    for _, reward, _, _, info in roll(env, 1000)[1:]:
        assert reward == pytest.approx(sum(info[term] for term in terms), rel=1e-12, abs=1e-15)


def test_effort_term_is_zero_without_action_and_negative_with() -> None:
    env = gym.make("drm_env/Slew-v0", **SHORT)
    env.reset(seed=0)
    assert env.step(np.zeros(2, np.float32))[4]["reward/effort"] == 0.0
    assert env.step(np.ones(2, np.float32))[4]["reward/effort"] < 0.0


def test_structural_limit_terminates_with_finite_values() -> None:
    env = gym.make("drm_env/Slew-v0", horizon=5.0, limits={"tip_deflection": 1e-4})
    records = roll(env, 1000)
    observation, reward, terminated, truncated, info = records[-1]
    assert terminated is True
    assert truncated is False
    assert np.isfinite(observation).all() and np.isfinite(reward)
    assert observation in env.observation_space
    assert info["is_success"] == 0.0
    assert info["metrics/tip_error_rms"] > 0.0


def test_same_seed_same_bits_and_other_seed_other_episode(env_id: str) -> None:
    one, other = gym.make(env_id, **SHORT), gym.make(env_id, **SHORT)
    assert_same_records(roll(one, 50, seed=7), roll(other, 50, seed=7))
    if env_id != "drm_env/SlewThesis-v0":
        first = one.reset(seed=7)[1]
        assert first != one.reset(seed=8)[1]
        assert first == one.reset(seed=7)[1]


def test_episodes_of_one_seed_differ_and_repeat() -> None:
    env = gym.make("drm_env/Slew-v0", **SHORT)
    env.reset(seed=11)
    episodes = [env.reset()[1]["context/payload_mass"] for _ in range(4)]
    assert len(set(episodes)) == 4
    env.reset(seed=11)
    assert episodes == [env.reset()[1]["context/payload_mass"] for _ in range(4)]


def test_seeds_of_any_size_are_told_apart() -> None:
    env = gym.make("drm_env/Slew-v0", **SHORT)
    seeds = [0, 1, 2**32, 2**32 + 1, 2**64, 2**64 + 1, 2**64 - 1, 10**40]
    masses = [env.reset(seed=seed)[1]["context/payload_mass"] for seed in seeds]
    assert len(set(masses)) == len(seeds)


def test_numpy_integers_are_seeds() -> None:
    env = drm_env.DrmEnv(**SHORT)
    assert env.reset(seed=np.int64(5))[1] == env.reset(seed=5)[1]  # type: ignore[arg-type]


def test_unseeded_environments_differ() -> None:
    masses = {gym.make("drm_env/Slew-v0").reset()[1]["context/payload_mass"] for _ in range(8)}
    assert len(masses) == 8


def test_infos_and_observations_are_the_callers_own() -> None:
    env = gym.make("drm_env/Slew-v0", **SHORT)
    observation, info = env.reset(seed=1)
    kept, kept_info = observation.copy(), dict(info)
    info.clear()
    observation[:] = 0
    action = np.ones(2, np.float32)
    stepped = env.step(action)
    assert stepped[4].keys() == kept_info.keys()
    action[:] = 0.0
    again, _ = env.reset(seed=1)
    assert again.tobytes() == kept.tobytes()


def test_reserved_info_keys_are_left_to_others(env_id: str) -> None:
    reserved = {"episode", "final_obs", "final_info", "terminal_observation", "TimeLimit.truncated"}
    for record in roll(gym.make(env_id, horizon=0.2), 100):
        assert not reserved & record[-1].keys()


def test_observation_layout_describes_the_observation(env_id: str) -> None:
    env = gym.make(env_id, **SHORT)
    layout = env.unwrapped.observation_layout  # type: ignore[attr-defined]
    assert env.observation_space.shape == (len(layout),)
    assert len({entry.name for entry in layout}) == len(layout)
    for entry, low, high in zip(
        layout, env.observation_space.low, env.observation_space.high, strict=True
    ):
        assert entry.unit and entry.scale > 0
        assert (np.float32(entry.low), np.float32(entry.high)) == (low, high)
        assert low < high


def test_observation_is_signal_over_scale() -> None:
    env = drm_env.DrmEnv(task="slew_thesis", horizon=2.0, initial_beta=0.01)
    layout = env.observation_layout
    observation, _ = env.reset(seed=0)
    for _ in range(200):
        observation = env.step(np.full(2, 0.3, np.float32))[0]
    signals = env.signals()
    compared = 0
    for value, entry in zip(observation, layout, strict=True):
        if entry.name in signals:
            assert value * entry.scale == pytest.approx(
                signals[entry.name], rel=1e-6, abs=1e-6 * entry.scale
            ), entry.name
            compared += 1
    assert compared >= 4


def test_options_are_found_in_the_configuration() -> None:
    env = drm_env.DrmEnv(
        horizon=3.0,
        payload_mass=drm_env.Uniform(60.0, 70.0),
        control_period=0.02,
        reward={"effort": 0.5},
    )
    assert env.config.scenario.horizon == 3.0
    assert env.config.task.control_period == 0.02
    assert env.config.task.reward.effort == 0.5
    assert env.control_period == 0.02
    for seed in range(20):
        assert 60.0 <= env.reset(seed=seed)[1]["context/payload_mass"] <= 70.0


def test_config_as_dataclass_dict_and_file_are_the_same(tmp_path: Path) -> None:
    reference = drm_env.DrmEnv(task="slew_direct", payload_mass=(70.0, 80.0), horizon=2.0)
    text = reference.config_json
    toml = tmp_path / "config.toml"
    toml.write_text(
        "[scenario]\nhorizon = 2.0\n[randomize]\npayload_mass = {uniform = [70.0, 80.0]}\n"
    )
    path = tmp_path / "config.json"
    path.write_text(text)
    for config in (reference.config, json.loads(text), path, str(path)):
        assert drm_env.DrmEnv(config=config).config_json == text
    assert drm_env.DrmEnv(task="slew_direct", config=toml).config_json == text


def test_default_configuration_is_that_of_the_id() -> None:
    assert drm_env.DrmEnv(task="slew").config == drm_env.default_config("slew")
    assert drm_env.default_config("slew_thesis").task.control_period == 0.002


def spec_of(env: gym.Env[Any, Any]) -> EnvSpec:
    assert env.spec is not None
    return env.spec


SPEC_OPTIONS: dict[str, Any] = {
    "payload_mass": (60.0, 300.0),
    "slew_angle": drm_env.Normal(0.8, 0.05, high=1.0),
    "deployment_mode": ["coincident", "none"],
    "tip_lag": drm_env.LogUniform(0.001, 0.01),
    "mass_error": np.float64(0.1),
    "reward": {"effort": 0.02},
    "horizon": 0.2,
}


@pytest.mark.parametrize("way", ["json", "pickle", "deepcopy"])
def test_specification_makes_the_same_environment_again(way: str) -> None:
    env = gym.make("drm_env/Slew-v0", **SPEC_OPTIONS)
    spec = spec_of(env)
    if way == "json":
        restored = EnvSpec.from_json(spec.to_json())
    elif way == "pickle":
        restored = pickle.loads(pickle.dumps(spec))  # noqa: S301
    else:
        restored = copy.deepcopy(spec)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        again = gym.make(restored)
    assert_same_records(roll(env, 100), roll(again, 100))


def test_specification_with_a_config_dataclass_survives_json() -> None:
    config = drm_env.DrmEnv(payload_mass=(60.0, 61.0), horizon=0.2).config
    env = gym.make("drm_env/Slew-v0", config=config)
    again = gym.make(EnvSpec.from_json(spec_of(env).to_json()))
    assert_same_records(roll(env, 100), roll(again, 100))


def test_two_numbers_in_a_list_are_choices_and_warn() -> None:
    with pytest.warns(UserWarning, match=r"payload_mass=\[100.0, 200.0\] is taken as two choices"):
        env = drm_env.DrmEnv(payload_mass=[100.0, 200.0])
    masses = {env.reset(seed=seed)[1]["context/payload_mass"] for seed in range(30)}
    assert masses == {100.0, 200.0}


def test_distributions_survive_asdict() -> None:
    import dataclasses

    for distribution in (
        drm_env.Uniform(1.0, 2.0),
        drm_env.LogUniform(1.0, 2.0),
        drm_env.Normal(100.0, 5.0, low=90.0),
        drm_env.Choices((100.0, 150.0, 200.0)),
    ):
        plain = dataclasses.asdict(distribution)
        assert (
            drm_env.DrmEnv(payload_mass=distribution).config_json
            == drm_env.DrmEnv(payload_mass=plain).config_json
        )


def test_wrappers_of_gymnasium() -> None:
    env = gym.make("drm_env/Slew-v0", horizon=0.2)
    env = RecordEpisodeStatistics(env)
    env = NormalizeObservation(env)
    env = RescaleAction(env, np.float32(-100.0), np.float32(100.0))
    env = TimeLimit(env, 7)
    records = roll(env, 100)
    assert len(records) - 1 == 7 and records[-1][3] is True
    full = RecordEpisodeStatistics(gym.make("drm_env/Slew-v0", horizon=0.2))
    last = roll(full, 100)[-1][4]
    assert last["episode"]["l"] == 20
    assert last["episode"]["r"] == pytest.approx(last["metrics/episode_return"])


def test_max_episode_steps_of_make() -> None:
    env = gym.make("drm_env/Slew-v0", max_episode_steps=9)
    records = roll(env, 100)
    assert len(records) - 1 == 9
    assert spec_of(env).max_episode_steps == 9


def test_rendered_frames_show_the_motion() -> None:
    env = gym.make("drm_env/Slew-v0", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    for _ in range(600):
        env.step(np.zeros(2, np.float32))
    later = env.render()
    assert isinstance(first, np.ndarray) and isinstance(later, np.ndarray)
    assert first.dtype == np.uint8 and first.ndim == 3 and first.shape[2] == 3
    assert first.std() > 1.0
    assert (first != later).any(axis=2).sum() > 500


def test_one_frame_a_step_plays_in_real_time(env_id: str) -> None:
    env = gym.make(env_id)
    period = env.unwrapped.control_period  # type: ignore[attr-defined]
    assert env.metadata["render_fps"] == round(1 / period)
    batch = gym.make_vec(env_id, num_envs=2)
    assert batch.metadata["render_fps"] == round(1 / period)


def test_text_and_lists_of_frames() -> None:
    env = gym.make("drm_env/Slew-v0", render_mode="ansi")
    env.reset(seed=0)
    text = env.render()
    assert isinstance(text, str) and text.count("\n") > 10
    listed = gym.make("drm_env/Slew-v0", render_mode="rgb_array_list")
    listed.reset(seed=0)
    listed.step(np.zeros(2, np.float32))
    assert len(listed.render()) == 2  # type: ignore[arg-type]


def test_human_mode_shows_by_itself(capsys: pytest.CaptureFixture[str]) -> None:
    env = gym.make("drm_env/Slew-v0", render_mode="human", horizon=0.1)
    records = roll(env, 100)
    assert len(records) - 1 == 10
    assert env.render() is None
    env.close()
    try:
        import pygame  # noqa: F401
    except ImportError:
        assert "O" in capsys.readouterr().out


def test_video_is_recorded(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = gym.make("drm_env/Slew-v0", render_mode="rgb_array", horizon=0.05)
    recorded = RecordVideo(env, str(tmp_path), episode_trigger=lambda _: True)
    roll(recorded, 100)
    recorded.close()
    (video,) = tmp_path.glob("*.mp4")
    assert video.stat().st_size > 1000


def test_import_leaves_heavy_libraries_alone() -> None:
    code = (
        "import sys, drm_env, gymnasium\n"
        "gymnasium.make('drm_env/Slew-v0').reset(seed=0)\n"
        "heavy = {'torch', 'stable_baselines3', 'matplotlib', 'pandas', 'scipy', 'pygame'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_public_names_exist() -> None:
    for name in drm_env.__all__:
        assert getattr(drm_env, name) is not None
    assert set(drm_env.__all__) <= set(dir(drm_env))
    with pytest.raises(AttributeError, match=r"no attribute 'nothing'"):
        drm_env.nothing  # noqa: B018
