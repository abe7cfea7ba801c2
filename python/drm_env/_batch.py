"""Arguments and results of a batch: what `DrmVectorEnv` checks and how its infos are made."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from drm_env._common import finite
from drm_env.configuration import flat_options, is_sequence
from drm_env.errors import ConfigError

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


# -- Arguments -------------------------------------------------------------------------------


def count(name: str, value: Any) -> int:
    """A positive integer argument.

    Raises
    ------
    ConfigError
        anything else.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = 0
    if number < 1 or isinstance(value, bool):
        raise ConfigError(f"{name} must be a positive integer, got {value!r}")
    return number


def seed_list(seed: Any, num_envs: int) -> list[int | None]:
    """One seed, or ``None``, for each sub-environment: an integer s stands for s, s + 1, ...

    Raises
    ------
    ConfigError
        A list of another length.
    gymnasium.error.Error
        A negative seed.
    """
    if seed is None:
        return [None] * num_envs
    if isinstance(seed, (list, tuple, np.ndarray)):
        seeds = [None if value is None else operator.index(value) for value in seed]
        if len(seeds) != num_envs:
            raise ConfigError(f"seed must have {num_envs} entries, got {len(seeds)}")
    else:
        first = operator.index(seed)
        seeds = [first + index for index in range(num_envs)]
    for value in seeds:
        if value is not None and value < 0:
            raise gym.error.Error(f"seed must not be negative, got {value}")
    return seeds


def reset_mask(mask: Any, num_envs: int) -> Mask:
    """A copy of a checked ``reset_mask``.

    Raises
    ------
    TypeError, ValueError
        As Gymnasium's own vector environments.
    """
    if not isinstance(mask, np.ndarray):
        raise TypeError(f"options['reset_mask'] must be a numpy array, got {type(mask)}")
    if mask.shape != (num_envs,):
        raise ValueError(f"options['reset_mask'] must have shape ({num_envs},), got {mask.shape}")
    if mask.dtype != np.bool_:
        raise TypeError(f"options['reset_mask'] must have dtype bool, got {mask.dtype}")
    if not mask.any():
        raise ValueError("options['reset_mask'] must be true somewhere")
    return mask.copy()


def lane_options(
    options: Mapping[str, Any] | Sequence[Mapping[str, Any] | None] | None, num_envs: int
) -> list[str | None]:
    """JSON text of flat parameters for each sub-environment.

    ``options`` are those of all, with an array of shape (num_envs,) where each has its own value,
    or a sequence with the options (or ``None``) of each.

    Raises
    ------
    ConfigError
        An array of another shape, a sequence of another length, an unknown name or a value without
        a JSON form.
    """
    if options is None:
        return [None] * num_envs
    if not isinstance(options, Mapping):
        if not is_sequence(options):
            raise ConfigError(
                f"options must be a mapping, or a sequence of {num_envs} mappings, "
                f"got {type(options).__name__}"
            )
        if len(options) != num_envs:
            raise ConfigError(f"options must have {num_envs} entries, got {len(options)}")
        return [flat_options(item) for item in options]
    arrays = {}
    for name, value in options.items():
        if isinstance(value, np.ndarray) and value.ndim > 0:
            if value.shape != (num_envs,):
                raise ConfigError(
                    f"{name} must be one value or an array of shape ({num_envs},), "
                    f"got shape {value.shape}"
                )
            arrays[name] = value
    if not arrays:
        return [flat_options(options)] * num_envs
    return [
        flat_options({**options, **{name: array[index] for name, array in arrays.items()}})
        for index in range(num_envs)
    ]


# -- Infos -----------------------------------------------------------------------------------


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
