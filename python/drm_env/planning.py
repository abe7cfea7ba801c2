"""Manoeuvres planned within limits, and flown before they are called good.

A slew of given shape and given ends has one number left: its final time. What the rigid arm asks
for falls with it, torques and forces by its square, rates and momenta by itself, so that every
limit states a shortest time in closed form. The elastic arm swings beyond that; therefore each
candidate is flown on the plant, under the law and with the errors of the payload's mass that it
has to hold for, and made slower until nothing passes its limit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drm_env._slew_search import Progress, SlewCandidate, SlewSearch
from drm_env.configuration import to_data
from drm_env.errors import ConfigError, InfeasibleError
from drm_env.kinematics import ArmPosition, tip_position
from drm_env.profiles import check_profile, slew_acceleration
from drm_env.rigid_demands import manoeuvre_of
from drm_env.simulation import LawLike
from drm_env.slew_limits import SlewLimits

if TYPE_CHECKING:
    from drm_env._config import Scenario

__all__ = ["OBJECTIVES", "SHAPES", "SlewCandidate", "SlewPlan", "plan_slew"]

OBJECTIVES = {"fastest": "final_time", "cheapest": "energy", "calmest": "vibration"}
"""What a plan can be best in, and the value that is then smallest."""

SHAPES: tuple[tuple[str, float], ...] = (
    *(("min_time", phi) for phi in (0.0, 0.01, 0.05, 0.1, 0.2)),
    *(("min_energy", phi) for phi in (0.0, 0.01, 0.05, 0.1, 0.2, 0.3)),
)
"""Profile and smoothing of the candidates: the thesis' four families."""


@dataclass(frozen=True, kw_only=True)
class SlewPlan:
    """A manoeuvre within its limits, see `plan_slew`.

    Attributes
    ----------
    scenario
        what `simulate` flies: the whole scenario, with the payload reported as it is.
    best
        the candidate in it, as flown.
    candidates
        all that were flown, the best included.
    objective
        what it is best in.
    limits
        what it stays within.
    start, goal
        how the arm stands at both ends.
    mass_error
        largest error of the reported mass that it holds for.
    law
        under which it was flown.
    """

    scenario: dict[str, Any]
    best: SlewCandidate
    candidates: tuple[SlewCandidate, ...]
    objective: str
    limits: SlewLimits
    start: ArmPosition
    goal: ArmPosition
    mass_error: float
    law: Any

    def tip_path(self, flight: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
        """(x, y) of the tip along a flight of this manoeuvre, m, shape (samples, 2).

        The deflection counts, across the arm.

        Parameters
        ----------
        flight
            signals of `simulate`.
        """
        turn = self.start.angle + flight["slew_angle"]
        arm = self.scenario["arm"]
        across = np.stack([-np.sin(turn), np.cos(turn)], axis=-1)
        along = tip_position(turn, flight["extension"], arm)
        path: NDArray[np.float64] = along + flight["tip_deflection"][:, np.newaxis] * across
        return path

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units and radians."""
        return {
            "objective": self.objective,
            "law": self.law,
            "mass_error": self.mass_error,
            "start": self.start._asdict(),
            "goal": self.goal._asdict(),
            "limits": {
                field.name: getattr(self.limits, field.name)
                for field in fields(self.limits)
                if getattr(self.limits, field.name) is not None
            },
            "best": self.best.to_dict(),
            "candidates": [candidate.to_dict() for candidate in self.candidates],
            "scenario": self.scenario,
        }


def plan_slew(
    scenario: Scenario | Mapping[str, Any] | None = None,
    *,
    start: tuple[float, float] | None = None,
    goal: tuple[float, float] | None = None,
    limits: SlewLimits | Mapping[str, float | None] | None = None,
    final_time: float | None = None,
    objective: str = "fastest",
    mass_error: float = 0.0,
    law: LawLike = "none",
    shapes: Sequence[tuple[str, float]] = SHAPES,
    patience: float = 1.5,
    times: int = 8,
    watch: float = 10.0,
    num_threads: int | None = None,
    progress: Progress | None = None,
) -> SlewPlan:
    """Finds the fastest, cheapest or calmest manoeuvre that keeps within limits when it is flown.

    Parameters
    ----------
    scenario
        arm, payload, plant, wheels and, without ``start`` and ``goal``, the angle of the slew and
        both extensions; what is left out has its default. Acceleration, profile, smoothing and
        horizon are found, and what is given of them does not count.
    start, goal
        places (x, y) of the tip, m from the shoulder, between which the arm turns the shorter way.
    limits
        what the manoeuvre may need at most: `SlewLimits` or a mapping.
    final_time
        exact time of the manoeuvre, s, in place of the shortest that the limits allow.
    objective
        ``"fastest"``; ``"cheapest"``, the least electrical energy of the slew motor; or
        ``"calmest"``, the least RMS deflection of the tip after the slew. The last two take as much
        time as ``limits.final_time`` leaves or, without it, ``patience`` times the fastest.
    mass_error
        largest error of the reported mass, as a part of the true one: limits hold with the mass
        reported right, too small and too large by it.
    law
        that flies, as for `simulate`. Limits of the wheels' momentum ask for one.
    shapes
        profiles with their smoothing to choose from.
    patience
        see ``objective``; at least 1.
    times
        final times that are tried of each shape for ``"cheapest"`` and ``"calmest"``.
    watch
        time after the manoeuvre that is flown, s.
    num_threads
        as for `rollout`.
    progress
        called with what is done, how many flights are done and how many there are.

    Returns
    -------
    plan
        the manoeuvre, what it needs, and all candidates with what they need.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value; limits that bound nothing.
    InfeasibleError
        no candidate keeps within the limits: the limit in the way, what is needed and what is
        allowed; a point outside the workspace.

    Examples
    --------
    >>> import drm_env
    >>> plan = drm_env.plan_slew(start=(8.0, 0.0), goal=(0.0, 14.0), limits={"motor_torque": 900.0},
    ...                          shapes=[("min_time", 0.1)], watch=2.0)
    >>> plan.best.feasible, plan.best.values["motor_torque"] <= 900.0
    (True, True)
    """
    given = SlewLimits.of(limits)
    if objective not in OBJECTIVES:
        raise ConfigError(f"objective must be one of {', '.join(OBJECTIVES)}, got {objective!r}")
    if not shapes:
        raise ConfigError("shapes must not be empty")
    for shape in shapes:
        check_profile(*shape)
    if not (math.isfinite(patience) and patience >= 1.0):
        raise ConfigError(f"patience must be at least 1, got {patience!r}")
    if isinstance(times, bool) or not isinstance(times, int) or times < 1:
        raise ConfigError(f"times must be a positive integer, got {times!r}")
    if not (math.isfinite(watch) and watch > 0.0):
        raise ConfigError(f"watch must be positive and finite, got {watch!r}")
    if final_time is not None:
        slew_acceleration(1.0, final_time)  # refuses the time
        if given.final_time is not None and final_time > given.final_time:
            raise InfeasibleError(
                f"final_time: {final_time:g} s are {final_time - given.final_time:.4g} s more than "
                f"limits.final_time allows ({given.final_time:g} s)",
                limit="final_time", needed=final_time, allowed=given.final_time,
            )  # fmt: skip
    job = manoeuvre_of(scenario, start, goal, mass_error)
    search = SlewSearch(job, given, law, list(dict.fromkeys(shapes)), watch, num_threads, progress)
    best = _searched(search, given, final_time, objective, patience, times)
    whole = search.scenario((best.profile, best.smoothing), best.final_time, 0.0, limited=True)
    return SlewPlan(
        scenario=whole,
        best=best,
        candidates=tuple(search.flown),
        objective=objective,
        limits=given,
        start=job.start,
        goal=job.goal,
        mass_error=mass_error,
        law=to_data(law, "law"),
    )


def _searched(
    search: SlewSearch,
    limits: SlewLimits,
    final_time: float | None,
    objective: str,
    patience: float,
    times: int,
) -> SlewCandidate:
    """The best candidate; see `plan_slew`."""
    judged = OBJECTIVES[objective]

    def best_of(candidates: Sequence[SlewCandidate]) -> SlewCandidate:
        # of several that are alike in it, the calmest
        return min(candidates, key=lambda each: (each.value(judged), each.value("vibration")))

    if final_time is not None:
        return best_of(search.at(final_time))
    unbound = all(search.shortest(shape) <= 0.0 for shape in search.shapes)
    if unbound and limits.final_time is not None and objective != "fastest":
        return best_of(search.at(limits.final_time))
    fast = search.fastest()
    if limits.final_time is not None and fast.final_time > limits.final_time * (1.0 + 1e-12):
        missing = fast.final_time - limits.final_time
        raise InfeasibleError(
            f"limits.final_time: {search.binding(fast)} takes {fast.final_time:.4g} s at least "
            f"({fast.profile}, smoothing {fast.smoothing:g}), {missing:.4g} s "
            f"({100.0 * missing / limits.final_time:.1f} %) more than the {limits.final_time:g} s "
            "allowed",
            limit="final_time", needed=fast.final_time, allowed=limits.final_time,
        )  # fmt: skip
    if objective == "fastest":
        return fast
    longest = limits.final_time or patience * fast.final_time
    wanted = []
    for shape in search.shapes:
        shortest = max(search.shortest(shape), fast.final_time)
        if shortest <= longest:
            even = np.geomspace(shortest, longest, times) if times > 1 else [longest]
            wanted += [(shape, float(time)) for time in dict.fromkeys(even)]
    return best_of([fast, *(each for each in search.fly(wanted, "trade") if each.feasible)])
