"""Seeds of any size, one or many."""

from __future__ import annotations

import operator
from typing import Any

import gymnasium as gym
import numpy as np

from drm_env.configuration import is_sequence
from drm_env.errors import ConfigError


def seed_bytes(seed: int) -> bytes:
    """A non-negative seed of any size as bytes, least significant first; without loss."""
    return seed.to_bytes(max(1, (seed.bit_length() + 7) // 8), "little")


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


def seeds_of(seed: Any, n: int) -> list[bytes]:
    """``seed``, ``seed + 1``, ... as bytes, or those of a sequence of ``n`` seeds.

    Raises
    ------
    ConfigError
        Not a non-negative integer, or a sequence of another length.
    """
    if is_sequence(seed):
        if len(seed) != n:
            raise ConfigError(f"seed must be a number or have {n} entries, got {len(seed)}")
        return [one for each in seed for one in seeds_of(each, 1)]
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ConfigError(f"seed must be a non-negative integer, got {seed!r}")
    return [seed_bytes(int(seed) + index) for index in range(n)]
