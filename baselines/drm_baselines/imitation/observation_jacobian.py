"""What a student sees, and how it depends on the arm and on its wheels.

Of an observation eight quantities change with what was done: :data:`SEEN` of the arm's state, and
of each wheel the torque and the momentum that it holds. The rest is known beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_env.constants import FINE_SCALES, LINK_END_DEFLECTION

Array = NDArray[np.float32]

SEEN = (0, 2, 3, 5)
"""Entries of the state (slew error, deflection coordinates, their rates) that sensors measure."""

_MEASURED = (  # entry, its quantity among the eight, what it is of it
    ("slew_error", 0, 1.0),
    ("link2_deflection", 1, LINK_END_DEFLECTION),
    ("slew_error_rate", 2, 1.0),
    ("link2_deflection_rate", 3, LINK_END_DEFLECTION),
)


class Slope(NamedTuple):
    """How one entry of the observations depends on one of the eight quantities.

    Attributes
    ----------
    entry
        Its place in the observation.
    age
        Decisions ago that the quantity was what it tells.
    quantity
        Which: the state's entries :data:`SEEN`, momenta (N m s) of root and tip wheel, and their
        torques (N m).
    slope
        The derivative, (n,).
    """

    entry: int
    age: int
    quantity: int
    slope: Array


class Sensing:
    """The observations of one configuration of the environment.

    Parameters
    ----------
    config
        The environment's configuration, on the thesis plant.
    """

    def __init__(self, config: Mapping[str, Any]) -> None:
        resolved = drm_env.resolve(config=config)
        layout = resolved.observation_layout
        self._resolved = resolved
        self.history = int(resolved.config.task.observation_history)
        self.entries = len(layout)
        self._frame = self.entries // self.history
        newest = layout[self.entries - self._frame :]
        self._index = {entry.name: i for i, entry in enumerate(newest)}
        self._scale = np.array([entry.scale for entry in newest], dtype=np.float32)

    def values(self, observations: Array, name: str, age: int = 0) -> NDArray[np.float64]:
        """Return an entry in its unit, as it was seen ``age`` decisions ago, shape (n,)."""
        column = self.entries - (age + 1) * self._frame + self._index[name]
        return observations[:, column].astype(np.float64) * float(self._scale[self._index[name]])

    def states(self, env: drm_env.DrmVectorEnv, observations: Array) -> NDArray[np.float64]:
        """Return the deviations from the undeflected arm at the reference, shape (n, 6)."""
        states = env.coordinates
        states[:, 0] = self.values(observations, "slew_error")
        states[:, 3] = self.values(observations, "slew_error_rate")
        return states

    def slopes(self, observations: Array) -> list[Slope]:
        """Return all entries that depend on the eight quantities, each on one of them."""
        return [slope for age in range(self.history) for slope in self._slopes(observations, age)]

    def _slopes(self, observations: Array, age: int) -> list[Slope]:
        first = self.entries - (age + 1) * self._frame
        found: list[Slope] = []

        def put(name: str, quantity: int, slope: NDArray[np.float64] | float) -> None:
            row = self._index[name]
            scaled = np.broadcast_to(slope, len(observations)) / float(self._scale[row])
            found.append(Slope(first + row, age, quantity, scaled.astype(np.float32)))

        for name, quantity, share in _MEASURED:
            measured = self.values(observations, name, age)
            put(name, quantity, share)
            put(f"{name}_fine", quantity, share / np.hypot(measured, FINE_SCALES[name]))
        put("slew_angle", 0, 1.0)
        put("slew_rate", 2, 1.0)
        for i, wheel in enumerate(("root", "tip")):
            put(f"{wheel}_momentum", 4 + i, 1.0)
            put(f"{wheel}_torque", 6 + i, 1.0)
        name = "identified_mass_error"
        if name in self._index:
            by_rate, by_momentum = self._identification(observations, age)
            put(name, 2, by_rate)
            put(name, 4, by_momentum)
            put(name, 5, by_momentum)
        return found

    def _identification(
        self, observations: Array, age: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the slopes of the identified mass error by slew rate and by stored momentum."""

        def value(name: str) -> NDArray[np.float64]:
            return self.values(observations, name, age)

        told = [value(f"payload_{name}") for name in ("mass", "length", "width")]
        return self._resolved.identification_slopes(
            value("identified_mass_error"),
            value("slew_rate"),
            value("extension"),
            np.column_stack(told),
        )
