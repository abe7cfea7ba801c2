"""The thesis' slew profiles in closed form: final time, acceleration and the motion between.

Every profile has a shape p(u) of unit size over u = t / t_f, so that with its integrals P and Q

    theta'' = A p(u)      theta' = A t_f P(u)      theta = A t_f^2 Q(u)      Q(1) = c

and one equation, angle = A t_f^2 c, ties acceleration and final time together: either is given and
the other follows (thesis section 3.2.4, equation 3.2.7).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env.errors import ConfigError

__all__ = ["SlewMotion", "slew_acceleration", "slew_final_time", "slew_motion"]

_LIMITS = {"min_time": 0.25, "min_energy": 0.5}
"""Smoothing that each profile stays below."""

_STEP = np.polynomial.Polynomial([0.0, 0.0, 3.0, -2.0])
"""The smooth step of the thesis from 0 to 1."""


class SlewMotion(NamedTuple):
    """A profile at places u = t / t_f of a slew of unit angle and unit final time.

    Attributes
    ----------
    acceleration, rate, angle
        theta'' t_f^2 / angle, theta' t_f / angle and theta / angle, each with the shape of u.
    """

    acceleration: NDArray[np.float64]
    rate: NDArray[np.float64]
    angle: NDArray[np.float64]


class _Piece(NamedTuple):
    start: float
    acceleration: np.polynomial.Polynomial
    rate: np.polynomial.Polynomial
    angle: np.polynomial.Polynomial


def _accelerations(profile: str, phi: float) -> list[tuple[float, np.polynomial.Polynomial]]:
    """Starts in u of the pieces of p, and p as polynomials of the distance from there."""
    line = np.polynomial.Polynomial

    def step(length: float) -> np.polynomial.Polynomial:
        return _STEP(line([0.0, 1.0 / length]))

    if profile == "min_time":
        if phi == 0.0:
            return [(0.0, line([1.0])), (0.5, line([-1.0]))]
        return [
            (0.0, step(phi)),
            (phi, line([1.0])),
            (0.5 - phi, 1.0 - 2.0 * step(2.0 * phi)),
            (0.5 + phi, line([-1.0])),
            (1.0 - phi, step(phi) - 1.0),
        ]
    ramp = line([1.0, -2.0 / (1.0 - 2.0 * phi)])
    if phi == 0.0:
        return [(0.0, ramp)]
    return [(0.0, step(phi)), (phi, ramp), (1.0 - phi, step(phi) - 1.0)]


@lru_cache(maxsize=256)
def _pieces(profile: str, phi: float) -> tuple[_Piece, ...]:
    pieces: list[_Piece] = []
    accelerations = _accelerations(profile, phi)
    rate, angle = 0.0, 0.0
    for place, (start, acceleration) in enumerate(accelerations):
        end = accelerations[place + 1][0] if place + 1 < len(accelerations) else 1.0
        rates = acceleration.integ(k=rate)
        angles = rates.integ(k=angle)
        pieces.append(_Piece(start, acceleration, rates, angles))
        rate, angle = float(rates(end - start)), float(angles(end - start))
    return tuple(pieces)


def check_profile(profile: str, smoothing: float) -> None:
    """Refuses a profile that there is not.

    Raises
    ------
    ConfigError
        an unknown family, or a smoothing that it does not have.
    """
    if profile not in _LIMITS:
        raise ConfigError(f"profile must be one of {', '.join(_LIMITS)}, got {profile!r}")
    if not 0.0 <= smoothing < _LIMITS[profile]:
        raise ConfigError(
            f"smoothing must be at least 0 and below {_LIMITS[profile]} for {profile}, got "
            f"{smoothing!r}"
        )


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise ConfigError(f"{name} must be positive and finite, got {value!r}")
    return float(value)


def shape_constant(profile: str, smoothing: float) -> float:
    """Q(1): the angle of a slew of unit acceleration and unit final time.

    Raises
    ------
    ConfigError
        a profile that there is not.
    """
    check_profile(profile, smoothing)
    last = _pieces(profile, float(smoothing))[-1]
    return float(last.angle(1.0 - last.start))


def slew_final_time(
    angle: float, max_accel: float, profile: str = "min_time", smoothing: float = 0.0
) -> float:
    """The time that a slew takes, s.

    Parameters
    ----------
    angle
        rad; its sign does not matter.
    max_accel
        largest acceleration, rad/s^2.
    profile, smoothing
        as ``slew_profile`` and ``slew_smoothing`` of an environment.

    Raises
    ------
    ConfigError
        an acceleration that is not positive, an angle that is not finite, an unknown profile.

    Examples
    --------
    >>> import math
    >>> import drm_env
    >>> f"{drm_env.slew_final_time(math.radians(50.0), 0.02):.3f}"
    '13.211'
    """
    if not math.isfinite(angle):
        raise ConfigError(f"angle must be finite, got {angle!r}")
    constant = shape_constant(profile, smoothing)
    return math.sqrt(abs(angle) / (_positive("max_accel", max_accel) * constant))


def slew_acceleration(
    angle: float, final_time: float, profile: str = "min_time", smoothing: float = 0.0
) -> float:
    """The largest acceleration of a slew that takes a given time, rad/s^2; never negative.

    With it as ``slew_max_accel`` the slew ends at ``final_time``: the final time as an input, which
    thesis section 3.2.4 offers beside the acceleration.

    Parameters
    ----------
    angle
        rad; its sign does not matter.
    final_time
        s.
    profile, smoothing
        as ``slew_profile`` and ``slew_smoothing`` of an environment.

    Raises
    ------
    ConfigError
        a time that is not positive, an angle that is not finite, an unknown profile.

    Examples
    --------
    >>> import drm_env
    >>> drm_env.slew_acceleration(1.0, 10.0, "min_energy")  # 6 angle / t_f^2
    0.06
    """
    if not math.isfinite(angle):
        raise ConfigError(f"angle must be finite, got {angle!r}")
    constant = shape_constant(profile, smoothing)
    return abs(angle) / (_positive("final_time", final_time) ** 2 * constant)


def slew_motion(u: ArrayLike, profile: str = "min_time", smoothing: float = 0.0) -> SlewMotion:
    """A profile at places ``u`` = t / t_f from 0 to 1, of any shape.

    Raises
    ------
    ConfigError
        a place outside 0 to 1, an unknown profile.

    Examples
    --------
    >>> import drm_env
    >>> half = drm_env.slew_motion(0.5)
    >>> float(half.rate), float(half.angle)  # bang-bang: twice the mean rate, half of the angle
    (2.0, 0.5)
    """
    places = np.asarray(u, dtype=np.float64)
    if not bool(((places >= 0.0) & (places <= 1.0)).all()):
        raise ConfigError("u must be from 0 to 1")
    constant = shape_constant(profile, smoothing)
    pieces = _pieces(profile, float(smoothing))
    starts = np.array([piece.start for piece in pieces])
    which = np.searchsorted(starts, places, side="right") - 1
    found = [np.zeros(places.shape) for _ in range(3)]
    for index, piece in enumerate(pieces):
        here = which == index
        distance = places[here] - piece.start
        for values, series in zip(found, piece[1:], strict=True):
            values[here] = series(distance)
    return SlewMotion(*(values / constant for values in found))


def profile_places(profile: str, smoothing: float, count: int) -> NDArray[np.float64]:
    """Places u from 0 to 1 on which peaks are looked for: even ones, and both sides of switches."""
    starts = np.array([piece.start for piece in _pieces(profile, float(smoothing))])
    before = np.nextafter(starts[1:], 0.0)
    half = np.array([np.nextafter(0.5, 0.0), 0.5])
    return np.unique(np.concatenate([np.linspace(0.0, 1.0, count), starts, before, half]))
