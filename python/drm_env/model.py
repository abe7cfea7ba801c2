"""The equations of motion as matrices, for analysis and control design: the code that steps."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env import _engine
from drm_env.configuration import to_data

__all__ = ["Energy", "Linearization", "Matrices", "Model"]


class Matrices(NamedTuple):
    """M q'' + C q' + K q = Q at one length, q = (slew angle, alpha, beta), each of shape (3, 3).

    Attributes
    ----------
    M
        mass, symmetric.
    C
        of the velocities, from the changing length; not symmetric. 1/s times mass.
    K
        stiffness, with the deployment's terms and, at the given slew rate, the axial load.
    """

    M: NDArray[np.float64]
    C: NDArray[np.float64]
    K: NDArray[np.float64]


class Energy(NamedTuple):
    """Energies, J.

    Attributes
    ----------
    kinetic
        of the transverse motion.
    potential
        of bending and axial load.
    total
        their sum.
    """

    kinetic: float
    potential: float
    total: float


class Linearization(NamedTuple):
    """x' = A x + B u about the undeformed arm, x = (q, q'), u = (slew, root, tip torque).

    Attributes
    ----------
    A
        shape (6, 6).
    B
        shape (6, 3), per N m.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]


class Model:
    """The arm with one payload.

    Parameters
    ----------
    payload
        ``mass`` (kg), ``length`` and ``width`` (m), ``inertia`` ("full" or "slender"), as
        in a scenario; what is left out has its default.
    arm
        ``link1`` and ``link2`` as in a scenario.
    plant
        ``"thesis"``.
    dynamics
        switches of the equations of motion as in a scenario.

    Lengths are those of link 2 outside link 1 (the extension), m; q = (slew angle, alpha, beta) in
    rad, m, m, where alpha and beta are half the tip deflections of the links.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value, here or in any call.
    """

    def __init__(
        self,
        payload: Mapping[str, Any] | None = None,
        *,
        arm: Mapping[str, Any] | None = None,
        plant: str = "thesis",
        dynamics: Mapping[str, Any] | None = None,
    ) -> None:
        """Makes the model; see the class for the arguments."""
        parts = {"payload": payload, "arm": arm, "plant": plant, "dynamics": dynamics}
        given = {name: part for name, part in parts.items() if part is not None}
        self._model = _engine.Model(json.dumps(to_data(given)))

    def matrices(
        self, extension: float, rate: float = 0.0, accel: float = 0.0, slew_rate: float = 0.0
    ) -> Matrices:
        """The matrices at an extension (m), its rate (m/s) and acceleration (m/s^2).

        Parameters
        ----------
        extension
            length of link 2 outside link 1, m.
        rate
            its rate, m/s.
        accel
            its acceleration, m/s^2.
        slew_rate
            at which the axial load's stiffening is taken, rad/s.
        """
        return Matrices(*self._model.matrices(extension, rate, accel, slew_rate))

    def acceleration(
        self,
        q: ArrayLike,
        q_rate: ArrayLike,
        extension: float,
        *,
        rate: float = 0.0,
        accel: float = 0.0,
        slew_torque: float = 0.0,
        root_torque: float = 0.0,
        tip_torque: float = 0.0,
    ) -> NDArray[np.float64]:
        """Q'' of shape (3,) in the state q, q' (shape (3,) each) under torques in N m."""
        return self._model.acceleration(
            _vector(q),
            _vector(q_rate),
            (extension, rate, accel),
            (slew_torque, root_torque, tip_torque),
        )

    def energy(
        self, q: ArrayLike, q_rate: ArrayLike, extension: float, *, rate: float = 0.0
    ) -> Energy:
        """Energies of a state, by quadrature over the velocity field."""
        return Energy(*self._model.energy(_vector(q), _vector(q_rate), extension, rate))

    def angular_momentum(
        self, q: ArrayLike, q_rate: ArrayLike, extension: float, *, rate: float = 0.0
    ) -> float:
        """Angular momentum about the shoulder, N m s."""
        return self._model.angular_momentum(_vector(q), _vector(q_rate), extension, rate)

    def natural_frequencies(self, extension: float) -> NDArray[np.float64]:
        """The two elastic natural frequencies at a fixed length, rising, Hz, shape (2,)."""
        return self._model.modes(extension)[0] / (2.0 * np.pi)

    def mode_shapes(self, extension: float) -> NDArray[np.float64]:
        """Elastic modes at a fixed length, shape (2, 3): one q a row, unit tip displacement."""
        return self._model.modes(extension)[1]

    def linearize(
        self, extension: float, rate: float = 0.0, accel: float = 0.0, slew_rate: float = 0.0
    ) -> Linearization:
        """The linear system about the undeformed arm; arguments as for `matrices`."""
        return Linearization(*self._model.linearize(extension, rate, accel, slew_rate))


def _vector(values: ArrayLike) -> NDArray[np.float64]:
    return np.ascontiguousarray(values, dtype=np.float64)
