"""What the loads of a manoeuvre are: units, descriptions and formulas.

`simulate` with ``loads=True`` has them as signals, `rollout` keeps them by name, and both state
``<name>_peak``, the largest magnitude, and ``<name>_rms``, the root mean square, over all samples.
Nothing else computes them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drm_env import _engine

__all__ = ["LOAD_SYMBOLS", "LoadEntry", "load_signals"]


class LoadEntry(NamedTuple):
    """One load of a manoeuvre.

    Attributes
    ----------
    name
        what it is called.
    unit
        SI unit.
    description
        what it is.
    formula
        how it is formed, in the symbols of `LOAD_SYMBOLS`.
    """

    name: str
    unit: str
    description: str
    formula: str


LOAD_SYMBOLS = {
    "S, T1, T2": "torques on the arm of slew motor, root and tip wheel, N m",
    "m, r, r''": "mass, place and acceleration in space of a particle; sums are over all of them",
    "out": "link 2 outside link 1, and the payload",
    "moves": "link 2 and the payload",
    "P": "the place where link 2 leaves link 1",
    "e, n": "directions along the arm's rotating axis and across it, n counter-clockwise",
    "n2": "direction across link 2 at P",
    "J, phi'": "the payload's inertia about its centre, its angular acceleration in space",
    "V, a, s": "bending energy; length of link 2 outside; slope of the tip against the axis",
    "h1, h2": "momenta that root and tip wheel have stored, N m s",
    "theta, R, w": "slew angle, reach and deflection of the tip from the rotating axis",
    "ref', ref''": "rate and acceleration of the slew's reference",
    "Ng, kt, kb, Ra": "1845, 0.318 N m/A, 0.318 V s/rad and 5.16 Ohm (thesis Table 4-1)",
    "cv, Im": "drag and inertia of the rotor, see slew_motor.constants",
}
"""Symbols of the formulas."""

_LOADS = (
    LoadEntry(
        "root_bending_moment_link1",
        "N m",
        "Bending moment of link 1 at the shoulder, on the arm.",
        "S + T1",
    ),
    LoadEntry(
        "root_bending_moment_link2",
        "N m",
        "Bending moment of link 2 where it leaves link 1, on what is outside.",
        "sum_out (r - P) x m r'' + J phi'' - T2",
    ),
    LoadEntry(
        "root_shear_link1",
        "N",
        "Shear force of link 1 at the shoulder, on the arm.",
        "n . sum m r''",
    ),
    LoadEntry(
        "root_shear_link2",
        "N",
        "Shear force of link 2 where it leaves link 1, on what is outside.",
        "n2 . sum_out m r''",
    ),
    LoadEntry(
        "payload_acceleration",
        "m/s^2",
        "Acceleration of the payload's centre of mass, its magnitude.",
        "|r''| of the centre",
    ),
    LoadEntry(
        "deployment_force",
        "N",
        "Force that drives link 2 out of link 1, with the centrifugal pull; positive pushes out.",
        "sum_moves m r'' . dr/da + J phi'' ds/da + dV/da - T2 ds/da",
    ),
    LoadEntry(
        "base_force_x",
        "N",
        "Force of the base on the arm, in the direction of the arm at slew angle 0.",
        "x part of sum m r''",
    ),
    LoadEntry(
        "base_force_y",
        "N",
        "Force of the base on the arm, in the direction of the arm at slew angle 90 deg.",
        "y part of sum m r''",
    ),
    LoadEntry("base_torque", "N m", "Torque of the base on the arm with its wheels.", "S"),
    LoadEntry(
        "angular_momentum",
        "N m s",
        "Angular momentum about the shoulder of arm, payload and wheels, by the plant's equations.",
        "dL/dtheta' + h1 + h2",
    ),
    LoadEntry("root_wheel_momentum", "N m s", "Momentum that the root wheel has stored.", "h1"),
    LoadEntry("tip_wheel_momentum", "N m s", "Momentum that the tip wheel has stored.", "h2"),
    LoadEntry(
        "tip_x",
        "m",
        "Place of the tip from the shoulder, in the direction of the arm at slew angle 0.",
        "R cos theta - w sin theta",
    ),
    LoadEntry(
        "tip_y",
        "m",
        "Place of the tip from the shoulder, in the direction of the arm at slew angle 90 deg.",
        "R sin theta + w cos theta",
    ),
    LoadEntry("motor_torque", "N m", "Torque of the slew motor at the shoulder.", "S"),
    LoadEntry(
        "motor_speed",
        "rad/s",
        "Rate of the slew motor at the shoulder: the reference's. The rotor's is Ng times it.",
        "ref'",
    ),
    LoadEntry(
        "motor_current",
        "A",
        "Armature current of the slew motor (thesis section 4.3).",
        "i = (S/Ng + cv Ng ref' + Im Ng ref'')/kt",
    ),
    LoadEntry("motor_voltage", "V", "Armature voltage of the slew motor.", "Ra i + kb Ng ref'"),
    LoadEntry(
        "motor_power",
        "W",
        "Electrical power of the slew motor as the thesis counts it: its heat.",
        "Ra i^2",
    ),
    LoadEntry(
        "motor_energy",
        "J",
        "Electrical energy of the slew motor so far, as the metric slew_energy.",
        "dt sum_k Ra i^2 at the beginning of each sample so far",
    ),
    LoadEntry(
        "motor_input_power",
        "W",
        "Power that the slew motor draws; negative where it brakes.",
        "motor_voltage i",
    ),
    LoadEntry(
        "motor_excess",
        "N m",
        "Torque of the open loop beyond what the motor gives (slew_motor.open_loop_limit).",
        "max(0, |wanted S| - limit)",
    ),
)


def load_signals() -> tuple[LoadEntry, ...]:
    """Every load of a manoeuvre with unit, description and formula, in the engine's order.

    Examples
    --------
    >>> import drm_env
    >>> first = drm_env.load_signals()[0]
    >>> first.name, first.unit, first.formula
    ('root_bending_moment_link1', 'N m', 'S + T1')
    """
    return _LOADS


def metric_items(
    peak: NDArray[np.float64], rms: NDArray[np.float64]
) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Names and values of the metrics of loads, in the engine's order along the last axis."""
    names: Sequence[str] = _engine.load_names()
    for index, name in enumerate(names):
        yield f"{name}_peak", np.array(peak[..., index])
        yield f"{name}_rms", np.array(rms[..., index])
