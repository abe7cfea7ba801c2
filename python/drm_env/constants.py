"""Numbers and names of the engine that policies, estimators and reports need.

They are asked of the engine, which flies with them: nobody need write them down a second time. What
is part of a configuration is not here (see `drm_env.resolve`), and the scales of observations
are in their layout. Units are SI and radians.
"""

from __future__ import annotations

from drm_env import _engine

__all__ = [
    "COORDINATES",
    "FINE_SCALES",
    "LARGEST_IDENTIFIED_ERROR",
    "LAW_NAMES",
    "LAW_PERIOD",
    "LINK_END_DEFLECTION",
    "LOAD_NAMES",
    "MEASURED_NAMES",
    "PALETTE",
    "PAYLOAD_INERTIAS",
    "SCHEDULED_EXTENSION_SCALE",
    "SCHEDULED_MASS_SCALE",
    "SIGNAL_NAMES",
    "SLOWEST_IDENTIFICATION",
    "TABLE_2_7",
]

COORDINATES: int = _engine.COORDINATES
"""Columns of `DrmVectorEnv.coordinates`: three coordinates and their rates."""

FINE_SCALES: dict[str, float] = dict(_engine.fine_scales())
"""x0 of the entries ``..._fine`` of an observation, which are asinh(x / x0), by the name of x and
in its unit."""

LAW_NAMES: tuple[str, ...] = tuple(_engine.law_names())
"""The control laws that `simulate`, `rollout` and ``inner_law`` know."""

LAW_PERIOD: float = _engine.LAW_PERIOD
"""Sampling period that the thesis' gains were chosen for (thesis section 4.1), s."""

LINK_END_DEFLECTION: float = _engine.LINK_END_DEFLECTION
"""Deflection of a link's end, m, per unit of its coordinate alpha or beta in the thesis' plant: the
assumed shape 3 u^2 - u^3 at u = 1."""

LOAD_NAMES: tuple[str, ...] = tuple(_engine.load_names())
"""The loads of a manoeuvre, in order, which `rollout` can keep too; see `drm_env.load_signals`."""

MEASURED_NAMES: tuple[str, ...] = tuple(_engine.measured_names())
"""What sensors read at each sample, in order, which `rollout` can keep too: slew angle and rate
(rad, rad/s), link-2 tip deflection and its rate (m, m/s), the gyro at the tip wheel (rad/s), the
strain gauges at the roots of link 1 and link 2 (N m) and the accelerometer at the tip (m/s^2)."""

PALETTE: dict[str, str] = {
    name: "#{:02X}{:02X}{:02X}".format(*rgb) for name, rgb in _engine.palette()
}
"""Colours of all pictures, ``"#RRGGBB"`` by name: those of Okabe and Ito, which stay apart for the
colour-blind, and a grey."""

SIGNAL_NAMES: tuple[str, ...] = tuple(_engine.signal_names())
"""The signals of a trajectory, in order: what `rollout` can keep."""

SLOWEST_IDENTIFICATION: float = _engine.SLOWEST_IDENTIFICATION
"""Slew rate below which ``identified_mass_error`` is 0, rad/s."""

LARGEST_IDENTIFIED_ERROR: float = _engine.LARGEST_IDENTIFIED_ERROR
"""Magnitude at which ``identified_mass_error`` is limited."""

SCHEDULED_MASS_SCALE: float = _engine.SCHEDULED_MASS_SCALE
"""Reported mass by which the polynomials of the law ``"scheduled"`` divide, kg."""

SCHEDULED_EXTENSION_SCALE: float = _engine.SCHEDULED_EXTENSION_SCALE
"""Extension by which the polynomials of the law ``"scheduled"`` divide, m."""

TABLE_2_7: tuple[tuple[float, float, float], ...] = tuple(_engine.table_2_7())
"""Mass (kg), length and width (m) of the payloads of the thesis' Table 2-7, preceded by none: what
lengths and widths that are left out are interpolated in."""

PAYLOAD_INERTIAS: tuple[str, ...] = tuple(_engine.payload_inertias())
"""Alternatives of ``payload_inertia``; a context holds the position."""
