"""What a manoeuvre needs of the rigid arm, in closed form."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drm_env.configuration import to_data
from drm_env.errors import ConfigError
from drm_env.kinematics import ArmPosition, inverse_kinematics, lengths
from drm_env.model import Model
from drm_env.profiles import prescribed
from drm_env.resolution import resolve
from drm_env.slew_limits import LIMITED

if TYPE_CHECKING:
    from drm_env._config import Scenario

__all__ = ["slew_demands"]

_PLACES = 801
"""Even places in time at which peaks are looked for."""
_BESIDE = 1e-8
"""How long before a switch it is looked at once more, of the final time."""


class Manoeuvre(NamedTuple):
    """What is to be done, without how fast."""

    scenario: dict[str, Any]
    angle: float
    start: ArmPosition
    goal: ArmPosition
    errors: tuple[float, ...]
    moving_mass: float
    payload_mass: float
    inertias: tuple[NDArray[np.float64], ...]
    """I(a) as polynomials, highest power first: with each reported mass of `errors`, and last of
    the payload as it is."""

    @property
    def travel(self) -> float:
        return self.goal.extension - self.start.extension


def _inertia(scenario: Mapping[str, Any], payload: Mapping[str, Any]) -> NDArray[np.float64]:
    """Moment of inertia of the rigid arm about the shoulder over the extension: a parabola."""
    model = Model(payload, arm=scenario["arm"])
    link1, link2 = lengths(scenario["arm"])
    places = np.linspace(max(link2 - link1, 0.1 * link2), link2, 3)
    values = [model.matrices(float(place)).M[0, 0] for place in places]
    return np.polyfit(places, values, 2)


def _complete(scenario: Any) -> dict[str, Any]:
    """A scenario with all of its parts, checked.

    Raises
    ------
    ConfigError
        what cannot be flown.
    """
    whole = resolve("slew_thesis", config={"scenario": scenario}).to_dict()["scenario"]
    return dict(whole)


def manoeuvre_of(
    scenario: Any,
    start: tuple[float, float] | None,
    goal: tuple[float, float] | None,
    mass_error: float,
) -> Manoeuvre:
    data = to_data({} if scenario is None else scenario)
    if not isinstance(data, dict):
        raise ConfigError(
            f"scenario must be a mapping or a Scenario, got {type(scenario).__name__}"
        )
    if not (math.isfinite(mass_error) and 0.0 <= mass_error < 1.0):
        raise ConfigError(f"mass_error must be at least 0 and below 1, got {mass_error!r}")
    if data.get("mass_error") or (data.get("reported_payload") or {}).get("mass") is not None:
        raise ConfigError(
            "scenario: a plan is made for the payload as it is; give the largest error of the "
            "reported mass as mass_error"
        )
    if (start is None) != (goal is None):
        raise ConfigError("give both start and goal, or neither")
    usual = _complete({**data, "slew": {"angle": 1.0}})
    arm = usual["arm"]
    deployment = usual["deployment"]
    if start is not None and goal is not None:
        here = inverse_kinematics(*_point("start", start), arm, name="start")
        there = inverse_kinematics(*_point("goal", goal), arm, name="goal")
        # the shorter way round
        angle = math.remainder(there.angle - here.angle, math.tau)
    else:
        end = deployment["start" if deployment["mode"] == "none" else "end"]
        given = data.get("slew") or {}
        standard = resolve("slew_thesis").to_dict()["scenario"]["slew"]
        angle = float(given.get("angle", standard["angle"]))
        if not math.isfinite(angle):
            raise ConfigError(f"slew.angle must be finite, got {angle!r}")
        here = ArmPosition(0.0, deployment["start"])
        there = ArmPosition(angle, end)
    # what rounding leaves of the same angle or length is no manoeuvre
    if abs(angle) < 1e-9:
        angle = 0.0
    if abs(there.extension - here.extension) < 1e-9:
        there = there._replace(extension=here.extension)
    if angle == 0.0 and there.extension == here.extension:
        raise ConfigError("start and goal are the same: there is nothing to plan")
    payload = {name: usual["payload"][name] for name in ("mass", "length", "width", "inertia")}
    context = resolve("slew_thesis", config={"scenario": {"payload": payload}}).context
    payload |= {name: context[f"payload_{name}"] for name in ("length", "width")}
    errors = (0.0, -mass_error, mass_error) if mass_error > 0.0 else (0.0,)
    reported = [{**payload, "mass": payload["mass"] * (1.0 + error)} for error in errors]
    link2 = arm["link2"]
    return Manoeuvre(
        scenario=usual,
        angle=angle,
        start=here,
        goal=there,
        errors=errors,
        moving_mass=link2["length"] * link2["mass_per_length"] + payload["mass"],
        payload_mass=payload["mass"],
        inertias=tuple(_inertia(usual, each) for each in (*reported, payload)),
    )


def _point(name: str, point: Any) -> tuple[float, float]:
    try:
        x, y = (float(value) for value in point)
    except (TypeError, ValueError):
        raise ConfigError(f"{name} must be a point (x, y) in m, got {point!r}") from None
    return x, y


def demands_of(job: Manoeuvre, profile: str, smoothing: float) -> dict[str, float]:
    """What the rigid arm needs in a slew of 1 s; see `slew_demands`."""
    start, goal = job.start.extension, job.goal.extension
    deployment: dict[str, Any] = {"mode": "none", "start": start}
    if start != goal:
        deployment = {"mode": "coincident", "start": start, "end": goal}
    planned = {
        "arm": job.scenario["arm"],
        "slew": {
            "angle": job.angle, "final_time": 1.0, "profile": profile, "smoothing": smoothing,
        },
        "deployment": deployment,
    }  # fmt: skip
    switches = prescribed(planned).switches
    # both sides of each switch, further off than what counts as on it
    around = np.concatenate([switches - _BESIDE, switches])
    places = np.unique(np.concatenate([np.linspace(0.0, 1.0, _PLACES), around]).clip(0.0, 1.0))
    motion = prescribed(planned, places)
    _, rate, accel, extension, speed, push = motion.motion
    slopes = [np.polyder(inertia) for inertia in job.inertias]
    torques, momenta = [], []
    for inertia, slope in zip(job.inertias, slopes, strict=True):
        momenta.append(np.polyval(inertia, extension) * rate)
        torques.append(
            np.polyval(inertia, extension) * accel + np.polyval(slope, extension) * speed * rate
        )
    # d/dt (m a') - dI/da theta'^2 / 2: link 2 and payload are pulled outward as they turn
    pull = 0.5 * np.polyval(slopes[-1], extension) * rate**2
    force = job.moving_mass * push - pull

    def largest(arrays: Sequence[NDArray[np.float64]]) -> float:
        return float(max(np.abs(values).max() for values in arrays))

    return {
        "acceleration": motion.largest_accel,
        "motor_torque": largest(torques[:-1]),
        # the joint transmits what the motor gives, and the shoulder has no hub
        "root_bending_moment": largest(torques[:-1]),
        "motor_rate": largest([rate]),
        "deployment_force": largest([force]),
        "root_wheel_torque": largest([torque - torques[-1] for torque in torques[:-1]]),
        "root_wheel_momentum": largest([momentum - momenta[-1] for momentum in momenta[:-1]]),
    }


def slew_demands(
    scenario: Scenario | Mapping[str, Any] | None = None,
    *,
    final_time: float,
    profile: str = "min_time",
    smoothing: float = 0.0,
    start: tuple[float, float] | None = None,
    goal: tuple[float, float] | None = None,
    mass_error: float = 0.0,
) -> dict[str, float]:
    """What a manoeuvre needs of the rigid arm, in closed form.

    Parameters
    ----------
    scenario, start, goal, mass_error
        as for `plan_slew`.
    final_time
        of slew and deployment, s.
    profile, smoothing
        as ``slew_profile`` and ``slew_smoothing`` of an environment.

    Returns
    -------
    demands
        peaks by the names of `LIMITED`: acceleration, motor's torque and rate, root bending moment
        (the motor's torque), deployment force, and torque and momentum of the root wheel. The
        wheel's are what the motor gives too much or too little because of the mass error,
        (I_reported - I) theta' and its rate; a wheel whose torque does not suffice takes up less.

    Raises
    ------
    ConfigError
        an impossible value.

    Examples
    --------
    >>> import drm_env
    >>> needed = drm_env.slew_demands({"payload": {"mass": 500.0}}, final_time=13.211,
    ...                               mass_error=0.15)
    >>> f"{needed['root_wheel_momentum']:.0f} N m s"  # thesis' Payload 3, reported 15 % too large
    '1556 N m s'
    """
    if not (math.isfinite(final_time) and final_time > 0.0):
        raise ConfigError(f"final_time must be positive and finite, got {final_time!r}")
    job = manoeuvre_of(scenario, start, goal, mass_error)
    return {
        name: value / final_time ** LIMITED[name].power
        for name, value in demands_of(job, profile, smoothing).items()
    }
