"""The arm at one length, for analysis and control design: equations of motion and modes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env import _engine
from drm_env.configuration import to_data
from drm_env.errors import ConfigError

__all__ = ["Energy", "Linearization", "Matrices", "ModeShapes", "Model"]


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


class ModeShapes(NamedTuple):
    """Natural vibrations as displacements of the arm's axis, k modes at p places.

    Attributes
    ----------
    positions
        distances from the shoulder along the undeformed arm, from 0 to the tip, m, shape (p,).
    displacements
        transverse displacements, shape (k, p), a mode a row. The rotation that keeps the angular
        momentum zero is part of them. Largest magnitude 1, the tip not negative.
    frequencies
        natural frequencies, rising, Hz, shape (k,).
    """

    positions: NDArray[np.float64]
    displacements: NDArray[np.float64]
    frequencies: NDArray[np.float64]


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
        what is known of the bending:

        - ``"thesis"``: assumed modes with the thesis' kinematics; the end of link 1 displaces
          link 2 but does not turn it. With one mode a link this is the plant that is flown, and
          the only one with equations of motion here.
        - ``"consistent"``: assumed modes in which the end slope of link 1 turns link 2.
        - ``"finite_element"``: Euler-Bernoulli beam finite elements of the whole arm.
        - ``"exact_rigid_link1"``: roots of the exact characteristic equation of the arm with a
          rigid link 1.
    dynamics
        switches of the equations of motion as in a scenario.
    modes
        numbers of assumed modes (link 1, link 2), each up to 40, 0 for a rigid link; by default
        (1, 1) for ``"thesis"`` and (4, 4) for ``"consistent"``. Of n modes the lower half is
        worth believing.
    shapes
        assumed shapes: ``"b7"``, ``"b8"``, ``"b9"`` (equations of the thesis' appendix B) or
        ``"mono"``, powers from the second on; by default ``"b8"`` for ``"thesis"`` and ``"mono"``
        for ``"consistent"``.
    elements
        number of finite elements, 3 to 200, by default 60.

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
        modes: Sequence[int] | None = None,
        shapes: str | None = None,
        elements: int | None = None,
    ) -> None:
        """Makes the model; see the class for the arguments."""
        parts = {
            "payload": payload,
            "arm": arm,
            "plant": plant,
            "dynamics": dynamics,
            "modes": modes,
            "shapes": shapes,
            "elements": elements,
        }
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

    def natural_frequencies(
        self, extension: float, count: int | None = None
    ) -> NDArray[np.float64]:
        """Natural frequencies at rest at a fixed length, rising, Hz, shape (count,).

        The rotation of the whole arm about the shoulder, which has none, is left out.

        Parameters
        ----------
        extension
            length of link 2 outside link 1, m.
        count
            how many; by default all of assumed modes and five of the other plants.
        """
        return self._model.natural_frequencies(extension, _count(count)) / (2.0 * np.pi)

    def mode_shapes(self, extension: float, count: int | None = None) -> ModeShapes:
        """Shapes of the natural vibrations; arguments as for `natural_frequencies`."""
        positions, displacements, angular = self._model.mode_shapes(extension, _count(count))
        return ModeShapes(positions, displacements, angular / (2.0 * np.pi))

    def linearize(
        self, extension: float, rate: float = 0.0, accel: float = 0.0, slew_rate: float = 0.0
    ) -> Linearization:
        """The linear system about the undeformed arm; arguments as for `matrices`."""
        return Linearization(*self._model.linearize(extension, rate, accel, slew_rate))


def _vector(values: ArrayLike) -> NDArray[np.float64]:
    return np.ascontiguousarray(values, dtype=np.float64)


def _count(count: int | None) -> int | None:
    if count is None:
        return None
    whole = isinstance(count, (int, np.integer)) and not isinstance(count, bool)
    if not whole or not 1 <= count < 2**31:
        raise ConfigError(f"count must be a positive 32-bit integer, got {count!r}")
    return int(count)
