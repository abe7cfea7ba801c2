"""The arm at one length, for analysis and control design: equations of motion and modes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env import _engine
from drm_env._exports import needed
from drm_env.configuration import to_data
from drm_env.errors import ConfigError

__all__ = ["Energy", "Linearization", "Matrices", "ModeShapes", "Model", "SpatialModes"]


class Matrices(NamedTuple):
    """M q'' + C q' + K q = Q about the undeflected arm at one length.

    q is (slew angle, alpha, beta) of the thesis plant, and the slew angle, the coordinates of
    link 1 and those of link 2 of the consistent one with modes (n, m): each matrix has the shape
    (3, 3), or (1 + n + m, 1 + n + m).

    Attributes
    ----------
    M
        mass, symmetric.
    C
        of the velocities, from the changing length and structural damping; not symmetric. 1/s
        times mass.
    K
        stiffness, with the deployment's terms and, at the given slew rate, those of turning: the
        axial load, and in the consistent plant the centrifugal force across the arm.
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
    """x' = A x + B u, y = C x about the undeflected arm at one length, k coordinates.

    The slew rate at which it was taken is part of x, and there is no constant term: every force
    at zero deflection is proportional to the slew rate. While the arm deploys and turns, the
    undeflected arm is no equilibrium: in deviations from it, A @ x0 is the constant term, where x0
    holds the slew rate and zeros.

    Attributes
    ----------
    A
        shape (2 k, 2 k).
    B
        shape (2 k, 3), per N m.
    C
        shape (6, 2 k).
    states
        names of x: "slew_angle" (rad); "alpha" and "beta" (m) of the thesis plant, "link1_1" ...
        and "link2_1" ... of the consistent one; then the rates of all in the same order,
        "slew_rate", "alpha_rate" and so on.
    inputs
        names of u: "slew_torque", "root_torque", "tip_torque", N m.
    outputs
        names of y: "slew_angle" (rad), "slew_rate" (rad/s), "link2_deflection" (m, of link 2's
        tip from link 1's end; 2 beta), "link2_deflection_rate" (m/s), "tip_deflection" (m, of
        the tip from the rotating axis) and "tip_deflection_rate" (m/s).
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def system(self) -> tuple[NDArray[np.float64], ...]:
        """A, B, C and D = 0, as other packages take them.

        ``control.ss(*lin.system)``, ``scipy.signal.StateSpace(*lin.system)``.
        """
        return self.A, self.B, self.C, np.zeros((len(self.C), self.B.shape[1]))

    def to_statespace(self) -> Any:
        """A `control.StateSpace` of python-control, with the names of states, inputs and outputs.

        Raises
        ------
        ImportError
            there is no python-control.
        """
        control = needed("control", "control", "to_statespace()")
        names = {
            "states": list(self.states),
            "inputs": list(self.inputs),
            "outputs": list(self.outputs),
        }
        return control.StateSpace(*self.system, **names, remove_useless_states=False)


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


class SpatialModes(NamedTuple):
    """Natural vibrations in three dimensions, k modes at p places.

    Attributes
    ----------
    frequencies
        natural frequencies, rising, Hz, shape (k,).
    kinds
        what each mode mostly is: "in-plane bending", "out-of-plane bending" or "torsion".
    shares
        parts of the elastic energy in these three, shape (k, 3). A payload off the arm's axis mixes
        them.
    positions
        distances from the shoulder along the undeformed arm, from 0 to the tip, m, shape (p,).
    in_plane, out_of_plane
        displacements along y, where a positive slew goes, and along z, the shoulder's axis, m,
        shape (k, p). The rotation that keeps the angular momentum zero is part of the first.
    twist
        rotation about the arm's axis, rad, shape (k, p). Of a mode the largest magnitude of all
        three is 1.
    """

    frequencies: NDArray[np.float64]
    kinds: tuple[str, ...]
    shares: NDArray[np.float64]
    positions: NDArray[np.float64]
    in_plane: NDArray[np.float64]
    out_of_plane: NDArray[np.float64]
    twist: NDArray[np.float64]


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
          link 2 but does not turn it. With modes (1, 1) of shapes "b8" this is the plant that is
          flown by default, with equations of motion; otherwise it has frequencies and shapes only.
        - ``"consistent"``: assumed modes in which the end slope of link 1 turns link 2, and the
          particles of link 2 are followed. With 1 to 8 modes a link it has matrices and a linear
          form, those of the plant that is flown as ``"consistent"``.
        - ``"finite_element"``: Euler-Bernoulli beam finite elements of the whole arm.
        - ``"exact_rigid_link1"``: roots of the exact characteristic equation of the arm with a
          rigid link 1.
        - ``"spatial"``: finite elements in three dimensions: bending in the plane and out of it,
          torsion, and a payload held anywhere (thesis sections 2.8.2 and 6.3, appendix E). It has
          natural frequencies and `spatial_modes`.
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
        number of finite elements, 3 to 200 (``"spatial"``: to 80), by default 60.
    grapple
        how the arm of ``"spatial"`` holds its payload, in axes of which x points along the arm, y
        where a positive slew goes and z along the shoulder's axis: ``centre``, its centre of mass
        from the tip (three numbers, m; by default half its length along x and its ``offset`` along
        y); ``inertia`` about the centre of mass, the entries xx, yy, zz, xy, xz, yz of the tensor
        (kg m^2; by default of a box as wide as high); ``rotation`` of the payload about its centre
        of mass, axis times angle (rad).
    torsional_stiffness
        G J of link 1 and link 2 of ``"spatial"``, N m^2; by default those of the thesis' tubes
        (table 2-12), in the proportion of the bending stiffness to the thesis'.

    Lengths are those of link 2 outside link 1 (the extension), m; q = (slew angle, alpha, beta) in
    rad, m, m, where alpha and beta are half the tip deflections of the links.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value, here or in any call.

    Examples
    --------
    >>> import drm_env
    >>> model = drm_env.Model({"mass": 200.0, "length": 1.0, "width": 0.5})
    >>> model.natural_frequencies(8.0).shape  # Hz, at an extension of 8 m
    (2,)
    >>> model.linearize(8.0).A.shape
    (6, 6)
    >>> exact = drm_env.Model({"mass": 200.0}, plant="exact_rigid_link1")
    >>> bool(exact.natural_frequencies(8.0)[0] < exact.natural_frequencies(1.0)[0])
    True
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
        grapple: Mapping[str, Any] | None = None,
        torsional_stiffness: Sequence[float] | None = None,
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
            "grapple": grapple,
            "torsional_stiffness": torsional_stiffness,
        }
        given = {name: part for name, part in parts.items() if part is not None}
        self._model = _engine.Model(json.dumps(to_data(given)))
        self._plane = plant != "spatial"

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
            at which the stiffening by turning is taken, rad/s.

        Raises
        ------
        ConfigError
            the plant has no equations of motion.
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
        """Q'' of shape (3,) in the state q, q' (shape (3,) each) under torques in N m.

        Of the thesis plant alone, as are `energy` and `angular_momentum`.
        """
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

    def spatial_modes(self, extension: float, count: int | None = None) -> SpatialModes:
        """Natural vibrations of plant ``"spatial"``; arguments as for `natural_frequencies`.

        Raises
        ------
        ConfigError
            another plant.

        Examples
        --------
        >>> import drm_env
        >>> held = {"centre": [0.5, 0.0, 0.2]}  # 20 cm out of the plane
        >>> arm = drm_env.Model({"mass": 200.0}, plant="spatial", grapple=held)
        >>> for frequency, kind in zip(*arm.spatial_modes(8.0, 3)[:2]):
        ...     print(f"{frequency:.2f} Hz {kind}")
        0.48 Hz out-of-plane bending
        3.40 Hz in-plane bending
        5.35 Hz out-of-plane bending
        """
        angular, kinds, shares, positions, shapes = self._model.spatial_modes(
            extension, _count(count)
        )
        frequencies = angular / (2.0 * np.pi)
        return SpatialModes(frequencies, tuple(kinds), shares, positions, *shapes)

    def mode_kinds(self, extension: float, count: int | None = None) -> tuple[str, ...]:
        """What the modes of `natural_frequencies` are, in their order.

        "in-plane bending" all of them, but for plant ``"spatial"``, which also has "out-of-plane
        bending" and "torsion".
        """
        if self._plane:
            return ("in-plane bending",) * len(self.natural_frequencies(extension, count))
        return self.spatial_modes(extension, count).kinds

    def linearize(
        self, extension: float, rate: float = 0.0, accel: float = 0.0, slew_rate: float = 0.0
    ) -> Linearization:
        """The linear system about the undeflected arm at a length, for control design.

        Its matrices are those of the equations that are flown. They hold at the instant of the
        given extension, rate and acceleration: while the arm deploys they change.

        Parameters
        ----------
        extension
            length of link 2 outside link 1, m.
        rate
            its rate, m/s.
        accel
            its acceleration, m/s^2.
        slew_rate
            rate at which the undeflected arm turns, rad/s.

        Raises
        ------
        ConfigError
            the plant has no equations of motion.
        """
        matrices, names = self._model.linearize(extension, rate, accel, slew_rate)
        states, inputs, outputs = (tuple(of) for of in names)
        return Linearization(*matrices, states, inputs, outputs)


def _vector(values: ArrayLike) -> NDArray[np.float64]:
    return np.ascontiguousarray(values, dtype=np.float64)


def _count(count: int | None) -> int | None:
    if count is None:
        return None
    whole = isinstance(count, (int, np.integer)) and not isinstance(count, bool)
    if not whole or not 1 <= count < 2**31:
        raise ConfigError(f"count must be a positive 32-bit integer, got {count!r}")
    return int(count)
