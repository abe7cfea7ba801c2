"""Episodes as a dataset of Minari, each with its payload and what was measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.policies.law_policy import LawPolicy, Predictor
from drm_baselines.support.extras import needing
from drm_baselines.support.seeds import episode_seeds

if TYPE_CHECKING:
    import minari

_CHUNK = 256


def create_minari_dataset(
    dataset_id: str,
    policy: Predictor,
    env_id: str,
    *,
    seed: int,
    episodes: int,
    label: str = "",
    noise: float = 0.0,
    **options: Any,
) -> minari.MinariDataset:
    """Fly a policy and keep observations, actions and rewards as a dataset of Minari.

    Parameters
    ----------
    dataset_id
        Name and version as Minari wants them, such as ``"drm/slew-linear-v0"``. The dataset is
        written below Minari's own directory (``MINARI_DATASETS_PATH``).
    policy
        Anything with Stable-Baselines3's ``predict``.
    env_id, options
        The environment and options other than its defaults. The dataset keeps them:
        ``recover_environment`` makes the same one.
    seed, episodes
        Episode i is that of ``reset(seed=seed + i)``.
    label
        What Minari calls the algorithm's name; that of the policy's class by default.
    noise
        Standard deviation of normal noise that is added to the actions, as a fraction of the torque
        limits; the recorded actions hold it.

    Returns
    -------
    dataset
        Each episode's metadata have ``context.NAME`` (the true payload, what was reported of it,
        all other parameters) and ``metrics.NAME``. What does not exist, such as the settling time
        of an arm that has not settled, is missing. Units are SI and radians.

    Raises
    ------
    BaselineError
        There is a dataset of this name already.
    MissingPackageError
        Minari is not installed.
    """
    with needing("A dataset of Minari", "data"):
        import minari
        from minari.data_collector import EpisodeBuffer

    seeds = episode_seeds(seed, episodes)
    if dataset_id in minari.list_local_datasets():
        raise BaselineError(
            f"there is a dataset {dataset_id!r} already: minari delete {dataset_id}"
        )
    rng = np.random.default_rng(seed)
    buffers: list[EpisodeBuffer] = []
    metadata: list[dict[str, Any]] = []
    for start in range(0, episodes, _CHUNK):
        part = seeds[start : start + _CHUNK]
        for steps, info in _flown(policy, env_id, part, noise, rng, options):
            buffers.append(EpisodeBuffer(id=len(buffers), seed=seeds[len(buffers)], **steps))
            metadata.append(info)
    # no environment is kept open for its specification
    env = gym.make(env_id, **options)
    dataset = minari.create_dataset_from_buffers(
        dataset_id,
        buffers,
        env=env,
        algorithm_name=label or type(policy).__name__,
        description=f"{episodes} episodes of {env_id}, seeds {seed} and on",
        code_permalink=f"drm-env {drm_env.__version__}",
        author="drm-env contributors",
        author_email="none",
    )
    env.close()
    dataset.storage.update_episode_metadata(metadata)
    return dataset


def _flown(
    policy: Predictor,
    env_id: str,
    seeds: list[int],
    noise: float,
    rng: np.random.Generator,
    options: dict[str, Any],
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """One episode a seed: what Minari calls steps, and its metadata."""
    n = len(seeds)
    envs = gym.make_vec(env_id, num_envs=n, autoreset_mode=AutoresetMode.SAME_STEP, **options)
    if isinstance(policy, LawPolicy):
        policy = policy.acting_in(envs)
    # batches take a seed each, which Gymnasium's annotation leaves out
    observations, _ = envs.reset(seed=seeds)  # type: ignore[arg-type]
    seen: list[Any] = [observations]
    acted: list[Any] = []
    paid: list[Any] = []
    terminations: list[Any] = []
    truncations: list[Any] = []
    lengths = np.zeros(n, np.int64)
    told: list[dict[str, Any]] = [{} for _ in seeds]
    finals: list[Any] = [None] * n
    state: Any = None
    begins = np.ones(n, np.bool_)
    while (lengths == 0).any():
        actions, state = policy.predict(seen[-1], state, begins, deterministic=True)
        if noise:
            actions = actions + rng.normal(0.0, noise, actions.shape)
        actions = np.clip(actions, -1.0, 1.0).astype(np.float32)
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        for values, into in (
            (actions, acted), (rewards, paid), (terminated, terminations),
            (truncated, truncations), (observations, seen),
        ):  # fmt: skip
            into.append(values)
        begins = terminated | truncated
        for index in np.flatnonzero(begins & (lengths == 0)).tolist():
            lengths[index] = len(acted)
            finals[index] = infos["final_obs"][index]
            told[index] = {
                # a slash would be a group of HDF5
                key.replace("/", "."): np.asarray(values)[index].item()
                for key, values in infos["final_info"].items()
                if key.startswith(("context/", "metrics/", "diverged", "is_success"))
                and values[index] != drm_env.NO_VALUE
            }
    envs.close()
    found = []
    for index, length in enumerate(lengths.tolist()):
        rows = [values[index] for values in seen[:length]]
        steps = {
            "observations": np.stack([*rows, finals[index]]),
            "actions": np.stack([values[index] for values in acted[:length]]),
            "rewards": [float(values[index]) for values in paid[:length]],
            "terminations": [bool(values[index]) for values in terminations[:length]],
            "truncations": [bool(values[index]) for values in truncations[:length]],
        }
        found.append((steps, told[index]))
    return found
