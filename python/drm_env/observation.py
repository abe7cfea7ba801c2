"""What the entries of an observation are, so that a law can recover SI values from them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drm_env import _engine
from drm_env.configuration import ConfigLike, resolve

if TYPE_CHECKING:
    from typing import Unpack

    from drm_env._options import Options

__all__ = ["ObservationEntry", "observation_layout"]


class ObservationEntry(NamedTuple):
    """One entry of the flat observation.

    Attributes
    ----------
    name
        what it is. With a history, the entries of the past carry the suffix ``[-1]``, ...
    unit
        SI unit of the unscaled value; ``"1"`` for a pure number.
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


def layout_of(config_json: str) -> tuple[ObservationEntry, ...]:
    """The entries of the observation for complete configuration text, in order."""
    return tuple(ObservationEntry(*entry) for entry in _engine.observation_layout(config_json))


def observation_layout(
    task: str = "slew", *, config: ConfigLike = None, **options: Unpack[Options]
) -> tuple[ObservationEntry, ...]:
    """The entries of the observation that an environment with these arguments returns, in order.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value.
    """
    return layout_of(resolve(task, config, options))


def bounds(layout: tuple[ObservationEntry, ...]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Lower and upper bounds of the observation, two arrays of shape (n,)."""
    low = np.array([entry.low for entry in layout], dtype=np.float32)
    high = np.array([entry.high for entry in layout], dtype=np.float32)
    return low, high
