"""The thesis' slew profiles, as the engine has them: times, accelerations, and the motion between.

Every profile has a shape p(u) of unit size over u = t / t_f, so that with its integrals P and Q

    theta'' = A p(u)      theta' = A t_f P(u)      theta = A t_f^2 Q(u)      Q(1) = c

and one equation, angle = A t_f^2 c, ties acceleration and final time together: either is given and
the other follows (thesis section 3.2.4, equation 3.2.7).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env import _engine
from drm_env._manoeuvres import engine_scenario
from drm_env.errors import ConfigError

__all__ = ["SlewMotion", "slew_acceleration", "slew_final_time", "slew_motion"]


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


class Prescribed(NamedTuple):
    """What a manoeuvre prescribes.

    Attributes
    ----------
    final_time, largest_accel
        of the slew, s and rad/s^2.
    switches
        instants at which an acceleration changes its formula, s.
    motion
        a row each of angle, rate and acceleration of the reference and of length, rate and
        acceleration of the extension; a column a time, after a switch that falls on it.
    """

    final_time: float
    largest_accel: float
    switches: NDArray[np.float64]
    motion: NDArray[np.float64]


def prescribed(scenario: Any, times: ArrayLike = ()) -> Prescribed:
    """What a manoeuvre prescribes at the given times, s.

    Raises
    ------
    ConfigError
        a manoeuvre that there is not.
    """
    at = np.ascontiguousarray(times, dtype=np.float64)
    final, largest, switches, rows = _engine.prescribed(engine_scenario(scenario), at)
    return Prescribed(final, largest, np.array(switches), rows.T)


def _slew(profile: str, smoothing: float, **entries: float) -> dict[str, Any]:
    return {"slew": {"profile": profile, "smoothing": smoothing, **entries}}


def check_profile(profile: str, smoothing: float) -> None:
    """Refuses a profile that there is not.

    Raises
    ------
    ConfigError
        an unknown family, or a smoothing that it does not have.
    """
    prescribed(_slew(profile, smoothing))


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
    slew = _slew(profile, smoothing, angle=angle, max_accel=max_accel)
    return prescribed(slew).final_time


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
    >>> f"{drm_env.slew_acceleration(1.0, 10.0, 'min_energy'):.3f}"  # 6 angle / t_f^2
    '0.060'
    """
    slew = _slew(profile, smoothing, angle=angle, final_time=final_time)
    return prescribed(slew).largest_accel


def slew_motion(u: ArrayLike, profile: str = "min_time", smoothing: float = 0.0) -> SlewMotion:
    """A profile at places ``u`` = t / t_f from 0 to 1, of any shape; at 1 the arm is at rest.

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
    slew = _slew(profile, smoothing, angle=1.0, final_time=1.0)
    angle, rate, acceleration = prescribed(slew, places.ravel()).motion[:3]
    return SlewMotion(*(each.reshape(places.shape) for each in (acceleration, rate, angle)))
