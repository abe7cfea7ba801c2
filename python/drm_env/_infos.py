"""What infos of single environments and batches say: keys, values that do not exist, masks."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drm_env import _engine

CONTEXT_KEYS = tuple(f"context/{name}" for name in _engine.context_names())
REWARD_KEYS = tuple(_engine.reward_names())
METRIC_KEYS = tuple(f"metrics/{name}" for name in _engine.metric_names())
FLAG_KEYS = ("diverged", "is_success")
EPISODE_KEYS = (*METRIC_KEYS, *FLAG_KEYS)
"""What an info says of the episode as a whole."""
REPORT_KEYS = (*REWARD_KEYS, *EPISODE_KEYS)
"""What an info says that changes with every step."""
NO_VALUE = sys.float_info.max
"""What stands in an info for a number that does not exist, the largest there is.

For a limit that is not set, the settling time of an arm that has not settled, the residual
vibration before the slew has ended. Infinite and NaN, which the engine has there, are no JSON.
"""


def finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """A copy with `NO_VALUE` where there is NaN or infinity."""
    # of a number and NaN, fmin takes the number
    return np.fmin(values, NO_VALUE)


def context_info(values: NDArray[np.float64]) -> dict[str, Any]:
    """The true context of an episode as an info dictionary."""
    return dict(zip(CONTEXT_KEYS, finite(values), strict=True))


def info_metrics(info: Mapping[str, Any]) -> dict[str, Any]:
    """The metrics in an info by name, NaN where there is none.

    Parameters
    ----------
    info
        of a single environment, a batch or one of Stable-Baselines3's dictionaries.

    Returns
    -------
    metrics
        A float each, or an array of shape (num_envs,) from the info of a batch, with NaN where no
        episode has ended.

    Examples
    --------
    >>> import drm_env
    >>> env = drm_env.DrmEnv(horizon=0.5, slew_angle=0.001)
    >>> observation, info = env.reset(seed=0)
    >>> truncated = False
    >>> while not truncated:
    ...     _, _, _, truncated, info = env.step([0.0, 0.0])
    >>> round(drm_env.info_metrics(info)["duration"], 3)  # s
    0.5
    """
    metrics: dict[str, Any] = {}
    for key in METRIC_KEYS:
        if key not in info:
            continue
        values = np.asarray(info[key], dtype=np.float64)
        exists = values < NO_VALUE
        if f"_{key}" in info:
            exists &= info[f"_{key}"]
        found = np.where(exists, values, np.nan)
        metrics[key.removeprefix("metrics/")] = found if found.ndim else float(found)
    return metrics


Observations = NDArray[np.float32]


Info = dict[str, Any]


Mask = NDArray[np.bool_]


Rows = NDArray[Any] | Sequence[NDArray[Any]]


class Buffers(NamedTuple):
    """What one step of a batch returns, a row a sub-environment.

    Attributes
    ----------
    observations
        float32, shape (num_envs, n).
    rewards
        float64, shape (num_envs,).
    terminated, truncated
        bool, shape (num_envs,).
    terms
        Terms of the reward, float64, shape (num_envs, 3).
    """

    observations: Observations
    rewards: NDArray[np.float64]
    terminated: Mask
    truncated: Mask
    terms: NDArray[np.float64]


def shared_info(keys: Sequence[str], rows: Rows, everywhere: Mask) -> Info:
    """One row a key, valid in every sub-environment."""
    info: Info = {}
    for key, row in zip(keys, rows, strict=True):
        info[key] = row
        info[f"_{key}"] = everywhere
    return info


def masked_info(keys: Sequence[str], rows: Rows, mask: Mask) -> Info:
    """Arrays that hold where ``mask`` does and are zero elsewhere, with their masks."""
    info: Info = {}
    for key, row in zip(keys, np.where(mask, rows, 0.0), strict=True):
        info[key] = row
        info[f"_{key}"] = mask.copy()
    return info


def episode_rows(
    metrics: NDArray[np.float64], diverged: Mask, settled: Mask
) -> NDArray[np.float64]:
    """What infos say of episodes as a whole, a row a key of `EPISODE_KEYS`."""
    return np.vstack((finite(metrics.T), diverged, settled))


def final_infos(last: Observations, ended: Info, done: Mask) -> Info:
    """``final_obs`` and ``final_info`` of the episodes that ended and were reset in one step."""
    observations = np.full(done.size, None, dtype=object)
    for index in np.flatnonzero(done).tolist():
        observations[index] = last[index].copy()
    return {
        "final_obs": observations,
        "_final_obs": done.copy(),
        "final_info": ended,
        "_final_info": done.copy(),
    }
