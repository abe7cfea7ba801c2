"""What a planned manoeuvre may need at most."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from drm_env.errors import ConfigError

__all__ = ["LIMITED", "Limited", "SlewLimits"]


class Limited(NamedTuple):
    """Something that a limit can be put on.

    Attributes
    ----------
    unit
        SI unit.
    power
        of the final time with which it falls on the rigid arm.
    description
        what it is.
    """

    unit: str
    power: int
    description: str


LIMITED: dict[str, Limited] = {
    "acceleration": Limited("rad/s^2", 2, "acceleration of the slew"),
    "motor_torque": Limited("N m", 2, "torque of the slew motor at the shoulder"),
    "motor_rate": Limited("rad/s", 1, "rate of the shoulder, which the slew motor turns"),
    "deployment_force": Limited("N", 2, "force that moves link 2 and payload along the arm"),
    "root_wheel_torque": Limited("N m", 2, "torque of the root wheel that the mass error takes"),
    "root_wheel_momentum": Limited("N m s", 1, "momentum stored in the root wheel"),
    "tip_wheel_momentum": Limited("N m s", 1, "momentum stored in the tip wheel"),
    "deflection": Limited("m", 2, "deflection of the tip"),
    "residual": Limited("m", 2, "deflection of the tip after the slew"),
    "root_bending_moment": Limited("N m", 2, "bending moment at the root of link 1"),
    "root_shear": Limited("N", 2, "shear force at the root of link 1"),
    "link2_bending_moment": Limited("N m", 2, "bending moment at the root of link 2"),
    "link2_shear": Limited("N", 2, "shear force at the root of link 2"),
}
"""What `SlewLimits` can limit, besides the final time."""

_ROUNDS = 25
"""Most times that a candidate is made slower; each time it is slower by what it lacks."""
_PATIENCE = 4
"""Times that slowness may not help before a candidate is given up."""
_LONGEST = 3600.0
"""Longest slew that is thought of, s."""
_MARGIN = 1e-4
"""Part by which candidates are slower than the rigid arm allows: peaks lie between places."""
_PLACES = 801
_CHUNK = 256
"""Flights of one call: their signals take some hundred megabytes."""


@dataclass(frozen=True, kw_only=True)
class SlewLimits:
    """The most that a manoeuvre may need, all positive, SI units; ``None`` is no limit.

    Attributes
    ----------
    final_time
        longest time of the manoeuvre, s.
    acceleration
        of the slew, rad/s^2.
    motor_torque
        of the slew motor at the shoulder, N m.
    motor_rate
        of the shoulder, rad/s.
    deployment_force
        along link 2, N: with the pull of the turning arm.
    root_wheel_torque
        of the root wheel, N m: its torque limit, which must be enough to make up for the mass error
        on the rigid arm.
    root_wheel_momentum, tip_wheel_momentum
        stored in the wheels, N m s.
    deflection, residual
        of the tip at any time and after the slew, m.
    root_bending_moment, root_shear
        at the root of link 1, N m and N.
    link2_bending_moment, link2_shear
        at the root of link 2, N m and N.
    """

    final_time: float | None = None
    acceleration: float | None = None
    motor_torque: float | None = None
    motor_rate: float | None = None
    deployment_force: float | None = None
    root_wheel_torque: float | None = None
    root_wheel_momentum: float | None = None
    tip_wheel_momentum: float | None = None
    deflection: float | None = None
    residual: float | None = None
    root_bending_moment: float | None = None
    root_shear: float | None = None
    link2_bending_moment: float | None = None
    link2_shear: float | None = None

    def __post_init__(self) -> None:
        """Refuses limits that are not positive.

        Raises
        ------
        ConfigError
            one of them, by name.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None:
                continue
            number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
            if not number or not math.isfinite(value) or not value > 0.0:
                raise ConfigError(
                    f"limits.{field.name} must be a positive number or None, got {value!r}"
                )

    @classmethod
    def of(cls, limits: SlewLimits | Mapping[str, float | None] | None) -> SlewLimits:
        """Limits given as such, as a mapping or not at all.

        Raises
        ------
        ConfigError
            an unknown name, or a limit that is not positive.
        """
        if isinstance(limits, cls):
            return limits
        given: object = {} if limits is None else limits
        if not isinstance(given, Mapping):
            raise ConfigError(f"limits must be a mapping or SlewLimits, got {limits!r}")
        known = [field.name for field in fields(cls)]
        for name in given:
            if name not in known:
                raise ConfigError(f"limits.{name} is unknown; there are {', '.join(known)}")
        return cls(**given)

    def given(self) -> dict[str, float]:
        """Those that there are, by name, without the final time."""
        found = {name: getattr(self, name) for name in LIMITED}
        return {name: float(value) for name, value in found.items() if value is not None}
