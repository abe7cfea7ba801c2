"""What observations and actions are: entries, bounds and Gymnasium's spaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray


class ObservationEntry(NamedTuple):
    """One entry of the flat observation.

    Attributes
    ----------
    name
        what it is. With a history, the entries of the past carry the suffix ``@-1``, ...
    unit
        SI unit of the unscaled value; ``"-"`` or ``"1"`` for a pure number.
    scale
        the observation is the value in ``unit`` divided by ``scale`` (a compressed entry
        says so in its name).
    low
        smallest value in the observation.
    high
        largest value in the observation.
    """

    name: str
    unit: str
    scale: float
    low: float
    high: float


def action_box(size: int) -> gym.spaces.Box[np.float32]:
    """The symmetric action space of ``size`` actuators."""
    return gym.spaces.Box(-1.0, 1.0, (size,), np.float32)


def bounds(layout: Sequence[ObservationEntry]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Lower and upper bounds of the observation, two arrays of shape (n,)."""
    low = np.array([entry.low for entry in layout], dtype=np.float32)
    high = np.array([entry.high for entry in layout], dtype=np.float32)
    return low, high


def observation_box(layout: Sequence[ObservationEntry]) -> gym.spaces.Box[np.float32]:
    """The observation space of a layout, shape (n,)."""
    low, high = bounds(layout)
    return gym.spaces.Box(low, high, dtype=np.float32)


def batch_box(single: gym.spaces.Box[np.float32], num_envs: int) -> gym.spaces.Box[np.float32]:
    """The space of ``num_envs`` values of a space, whose bounds are views of its bounds.

    Gymnasium copies the bounds for each sub-environment, a good part of what a resting one takes.
    """
    # a box makes a box, which its annotation does not say
    batch: gym.spaces.Box[np.float32] = batch_space(single, num_envs)  # type: ignore[assignment]
    for name in ("low", "high", "bounded_below", "bounded_above"):
        setattr(batch, name, np.broadcast_to(getattr(single, name), batch.shape))
    return batch
