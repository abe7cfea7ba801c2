"""The tools that people have, used as docs/ecosystem.md says; what is not installed is skipped."""

from __future__ import annotations

import importlib
import importlib.util
import multiprocessing
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from gymnasium.wrappers import vector as wrappers

import drm_env  # noqa: F401  # registers the ids

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "ecosystem.md").read_text(encoding="utf-8")
SMALLER = {
    "range(250)": "range(25)",
    ".learn(100_000)": ".learn(600)",
    ".learn(50_000)": ".learn(120)",
    ".learn(250_000": ".learn(8_000",
    "rollout(250,": "rollout(25,",
    "episodes=100": "episodes=3",
}
"""What the page has, and what it is run with."""
CODE = re.findall(r"^```python\n(.*?)^```$", PAGE, re.S | re.M)


def libraries(code: str) -> list[str]:
    return re.findall(r"^(?:from|import) (\w+)", code, re.M)


def name_of(code: str) -> str:
    own = {"gymnasium", "numpy", "drm_env", "drm_baselines"}
    found = dict.fromkeys(name for name in libraries(code) if name not in own)
    return "-".join(found) or "gymnasium"


def test_the_page_has_what_is_made_smaller() -> None:
    assert len(CODE) >= 9
    assert all(large in PAGE for large in SMALLER)


@pytest.mark.slow
@pytest.mark.parametrize("code", CODE, ids=name_of)
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_a_block_of_the_page_runs(
    code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for library in libraries(code):
        if importlib.util.find_spec(library) is None:
            pytest.skip(f"{library} is not installed")
    if importlib.util.find_spec("torch"):
        importlib.import_module("torch").set_num_threads(1)
    for large, small in SMALLER.items():
        code = code.replace(large, small)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    names: dict[str, Any] = {"__name__": "__main__"}
    start_method = multiprocessing.get_start_method(allow_none=True)
    exec(compile(code, "docs/ecosystem.md", "exec"), names)
    # TorchRL has it spawn from then on
    multiprocessing.set_start_method(start_method, force=True)
    if "minari" in code:
        check_dataset(names)
    if "RecordVideo" in code:
        assert (tmp_path / "videos" / "rl-video-episode-0.mp4").stat().st_size > 10_000
    if "tensorboard_log" in code:
        check_tensorboard(tmp_path / "runs")
    if "torchrl" in code:
        check_torchrl(names)
    if "import control" in code:
        frequencies = np.sort(np.abs(names["control"].poles(names["plant"]).imag)) / (2 * np.pi)
        # Model's own frequencies come from the mass and stiffness matrices
        model = names["drm_env"].Model(payload={"mass": 200.0, "length": 1.0, "width": 0.5})
        np.testing.assert_allclose(frequencies[2::2], model.natural_frequencies(8.0), rtol=1e-6)


def check_dataset(names: dict[str, Any]) -> None:
    """What is kept is what single environments fly."""
    dataset, metadata = names["dataset"], names["metadata"]
    assert dataset.total_episodes == len(metadata) == 3
    env = dataset.recover_environment()
    assert env.unwrapped.control_period == 0.01
    for episode, told in zip(dataset.iterate_episodes(), metadata, strict=True):
        observation, info = env.reset(seed=int(told["seed"]))
        np.testing.assert_array_equal(observation, episode.observations[0])
        assert told["context.payload_mass"] == info["context/payload_mass"]
        assert 50.0 <= told["context.payload_mass"] <= 500.0
        for i, action in enumerate(episode.actions):
            observation, reward, terminated, truncated, info = env.step(action)
            assert (reward, terminated, truncated) == (
                episode.rewards[i], episode.terminations[i], episode.truncations[i],
            )  # fmt: skip
            np.testing.assert_array_equal(observation, episode.observations[i + 1])
        assert terminated or truncated
        assert told["metrics.tip_error_rms"] == info["metrics/tip_error_rms"]


def check_tensorboard(folder: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    (run,) = folder.iterdir()
    events = EventAccumulator(str(run)).Reload()
    assert {"drm/tip_error_mm", "drm/settled", "rollout/ep_rew_mean"} <= set(
        events.Tags()["scalars"]
    )
    assert all(0.0 < point.value < 1e4 for point in events.Scalars("drm/tip_error_mm"))


def check_torchrl(names: dict[str, Any]) -> None:
    """Observations go on from step to step, and rewards are penalties."""
    flown = names["flown"]
    assert tuple(flown.batch_size) == (32, 25)
    before, after = flown["observation"][:, 1:], flown["next", "observation"][:, :-1]
    np.testing.assert_array_equal(before.numpy(), after.numpy())
    rewards = flown["next", "reward"].numpy()
    assert np.isfinite(rewards).all() and (rewards <= 0.0).all() and rewards.std() > 0.0


# --- Gymnasium ------------------------------------------------------------------------------------

ID = "drm_env/Slew-v1"


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_async_vector_env_flies_the_same(context: str) -> None:
    if context not in multiprocessing.get_all_start_methods():
        pytest.skip(f"there is no {context} here")
    options: dict[str, Any] = {"payload_mass": (50.0, 500.0), "horizon": 1.0}
    # a process that is spawned knows the id by the module in it
    makers = [lambda: gym.make(f"drm_env:{ID}", **options)] * 2
    parallel = AsyncVectorEnv(makers, context=context)
    ours = gym.make_vec(ID, num_envs=2, **options)
    try:
        np.testing.assert_array_equal(parallel.reset(seed=4)[0], ours.reset(seed=4)[0])
        for _ in range(25):
            actions = ours.action_space.sample()
            for one, other in zip(parallel.step(actions)[:4], ours.step(actions)[:4], strict=True):
                np.testing.assert_array_equal(one, other)
    finally:
        parallel.close()


@pytest.mark.parametrize(
    "wrap",
    [
        wrappers.NormalizeObservation,
        wrappers.NormalizeReward,
        wrappers.RecordEpisodeStatistics,
        wrappers.DictInfoToList,
        wrappers.ClipAction,
        lambda envs: wrappers.RescaleAction(envs, -2.0, 2.0),
        lambda envs: wrappers.ClipReward(envs, -1.0, 0.0),
        lambda envs: wrappers.TransformObservation(envs, lambda observations: observations / 2),
    ],
)
def test_wrappers_of_batches_say_the_same_of_ours(wrap: Any) -> None:
    options = {"horizon": 1.0}
    ours = wrap(gym.make_vec(ID, num_envs=3, **options))
    theirs = wrap(SyncVectorEnv([lambda: gym.make(ID, **options)] * 3))
    np.testing.assert_array_equal(ours.reset(seed=1)[0], theirs.reset(seed=1)[0])
    ends = 0
    ours.action_space.seed(0)
    for _ in range(25):
        actions = ours.action_space.sample()
        mine, other = ours.step(actions), theirs.step(actions)
        for one, another in zip(mine[:4], other[:4], strict=True):
            np.testing.assert_array_equal(one, another)
        if "episode" in mine[4]:
            np.testing.assert_allclose(mine[4]["episode"]["r"], other[4]["episode"]["r"])
            np.testing.assert_array_equal(mine[4]["_episode"], other[4]["_episode"])
        ends += int((mine[2] | mine[3]).sum())
    assert ends == 6


# --- programs -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_zoo_trains_and_shows(tmp_path: Path) -> None:
    if importlib.util.find_spec("rl_zoo3") is None:
        pytest.skip("rl_zoo3 is not installed")
    (block,) = re.findall(r"^```sh\n(.*?)^```$", PAGE, re.S | re.M)
    train, enjoy = (shlex.split(line) for line in block.strip().splitlines())
    place = train.index("--conf-file") + 1
    train[place] = str(ROOT / train[place])
    said = ""
    # 32 environments, episodes of 200 decisions: each ends once
    for words in ([*train, "-n", "8192", "--eval-freq", "-1", "--seed", "1"], enjoy):
        words = [word.replace("2000", "200") for word in words[1:]]
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr[-2000:]
        said += done.stdout
    assert "fps" in said and "Mean reward" in said
    (run,) = (tmp_path / "logs" / "ppo").iterdir()
    (monitor,) = run.glob("*.monitor.csv")
    assert len(monitor.read_text().splitlines()) > 2  # heading, names, episodes


@pytest.mark.parametrize("name", ["ppo", "sac", "tqc"])
def test_hyperparameter_files_name_environments_and_the_batch(name: str) -> None:
    yaml = pytest.importorskip("yaml")
    text = (ROOT / "baselines/drm_baselines/rl/zoo" / f"{name}.yml").read_text()
    settings = yaml.safe_load(text)
    assert set(settings) == {"drm_env/Slew-v1", "drm_env/SlewResidual-v1"}
    for env_id, each in settings.items():
        gym.spec(env_id)
        module, _, wrapper = each["vec_env_wrapper"].rpartition(".")
        assert callable(getattr(importlib.import_module(module), wrapper))
        assert float(each["n_timesteps"]) >= 1e5
