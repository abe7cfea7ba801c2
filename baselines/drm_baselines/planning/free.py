"""A free profile: the acceleration as straight lines between knots, found by a linear programme.

For a given final time T and a deployment that coincides with the slew, everything that the rigid
arm needs is linear in the accelerations x at the knots: the rate is their integral, the motor's
torque is (I theta')' with a known I(t), the wheel's momentum an error of I times the rate. So the
largest angle that can be turned through in T within the limits is a linear programme (HiGHS, by
``scipy.optimize.linprog``), and the shortest T is found by bisection. What comes out uses the motor
to its limit at every length, where the thesis' profiles waste torque while the arm is short.

It is then flown, and stretched in time until the elastic arm keeps its limits, too.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

import drm_env
from drm_baselines.errors import BaselineError

_Array = NDArray[np.float64]

KNOTS = 49
"""Knots of the profile, both ends included: the engine takes 64."""

_ROUNDS = 25
_MARGIN = 2e-4
"""Part of each limit that is kept back: torques are looked at in four places between knots."""
_BETWEEN = 4

_LIMITED = (
    "acceleration", "motor_torque", "motor_rate", "deployment_force", "root_wheel_torque",
    "root_wheel_momentum",
)  # fmt: skip
"""Limits of the rigid arm that the programme knows."""


@dataclass(frozen=True, kw_only=True)
class FreeProfile:
    """A profile beyond the thesis' families.

    Attributes
    ----------
    final_time
        s.
    rigid_time
        What the rigid arm would take, s.
    times, accelerations
        Knots, s, and accelerations at them, rad/s^2, straight lines between.
    used
        Part of each limit that the flights use.
    scenario
        What ``drm_env.simulate`` flies.
    """

    final_time: float
    rigid_time: float
    times: _Array
    accelerations: _Array
    used: dict[str, float]
    scenario: dict[str, Any]


_BOUNDING = ("acceleration", "motor_torque", "motor_rate")
"""Limits of which one is needed: the others bound no slew of the rigid arm."""


def check_limits(limits: Collection[str]) -> None:
    """Refuse limits, by name, within which a rigid arm could turn as fast as it likes.

    Raises
    ------
    BaselineError
        None of them bounds the slew; the message says which do.
    """
    if not set(_BOUNDING) & set(limits):
        given = f"got {', '.join(sorted(limits))} alone" if limits else "got no limit"
        raise BaselineError(
            "a free profile needs a limit on acceleration, motor_torque or motor_rate, "
            f"{given}; add one of them, such as --limit motor_torque=900 "
            "(in Python limits={'motor_torque': 900.0})"
        )


class _Programme:
    """The largest angle in a given time, for one manoeuvre."""

    def __init__(self, plan: drm_env.SlewPlan) -> None:
        scenario = plan.scenario
        arm, payload = scenario["arm"], scenario["payload"]
        self.limits = {
            name: limit * (1.0 - _MARGIN)
            for name, limit in plan.limits.given().items()
            if name in _LIMITED
        }
        check_limits(plan.limits.given())
        intervals = KNOTS - 1
        self.u = np.linspace(0.0, 1.0, KNOTS)
        places = np.linspace(0.0, 1.0, intervals * _BETWEEN + 1)
        # acceleration, rate and angle at the places from the knots, for T = 1
        self.accel = np.stack([np.interp(places, self.u, row) for row in np.eye(KNOTS)], axis=1)
        step = places[1]
        trapezoid = 0.5 * step * (self.accel[1:] + self.accel[:-1])
        self.rate = np.vstack([np.zeros(KNOTS), np.cumsum(trapezoid, axis=0)])
        # of a straight line the integral of the rate is exact with the slope's own term
        parts = step * self.rate[:-1] + step**2 * (2.0 * self.accel[:-1] + self.accel[1:]) / 6.0
        self.angle = parts.sum(axis=0)
        first, last = plan.start.extension, plan.goal.extension
        travel, early = last - first, places < 0.5
        extension = np.where(
            early, first + 2.0 * travel * places**2, last - 2.0 * travel * (1.0 - places) ** 2
        )
        self.speed = 4.0 * travel * np.where(early, places, 1.0 - places)
        self.push = np.where(early, 4.0 * travel, -4.0 * travel)
        link2 = arm["link2"]
        self.moving_mass = link2["length"] * link2["mass_per_length"] + payload["mass"]
        known = drm_env.resolve("slew_thesis", config={"scenario": {"payload": payload}}).context
        errors = (0.0, -plan.mass_error, plan.mass_error)[: 3 if plan.mass_error else 1]
        inertias: list[tuple[Any, Any]] = []
        for error in (*errors, 0.0):
            reported = {
                "mass": payload["mass"] * (1.0 + error),
                "length": known["payload_length"],
                "width": known["payload_width"],
                "inertia": payload["inertia"],
            }
            model = drm_env.Model(reported, arm=arm)
            shortest = drm_env.workspace(arm).hole - arm["link1"]["length"]
            nodes = np.linspace(max(shortest, 0.1 * link2["length"]), link2["length"], 3)
            curve = np.polyfit(nodes, [model.matrices(float(a)).M[0, 0] for a in nodes], 2)
            inertias.append(
                (np.polyval(curve, extension), np.polyval(np.polyder(curve), extension))
            )
        self.reported, self.true = inertias[:-1], inertias[-1]

    def rows(self, time: float) -> tuple[list[_Array], list[_Array]] | None:
        """Matrices and bounds, |matrix x| <= bound; ``None`` if deploying is too much."""
        accel, rate = self.accel, time * self.rate
        speed = (self.speed / time)[:, np.newaxis]
        matrices: list[_Array] = []
        bounds: list[_Array] = []

        def add(matrix: _Array, bound: float | _Array) -> None:
            matrices.append(matrix)
            bounds.append(np.broadcast_to(bound, len(matrix)))

        def torque(inertia: tuple[_Array, _Array]) -> _Array:
            value, slope = (each[:, np.newaxis] for each in inertia)
            return value * accel + slope * speed * rate

        limits = self.limits
        if "acceleration" in limits:
            add(accel, limits["acceleration"])
        if "motor_rate" in limits:
            add(rate, limits["motor_rate"])
        for inertia in self.reported:
            if "motor_torque" in limits:
                add(torque(inertia), limits["motor_torque"])
            wrong = (inertia[0] - self.true[0], inertia[1] - self.true[1])
            if "root_wheel_torque" in limits and np.any(wrong[0]):
                add(torque(wrong), limits["root_wheel_torque"])
            if "root_wheel_momentum" in limits and np.any(wrong[0]):
                add(wrong[0][:, np.newaxis] * rate, limits["root_wheel_momentum"])
        if "deployment_force" in limits:
            # -F <= m a'' - I' theta'^2 / 2 bounds the rate; F bounds the push alone
            inertial = self.moving_mass * self.push / time**2
            room = limits["deployment_force"] + inertial
            if inertial.max() > limits["deployment_force"] or room.min() < 0.0:
                return None
            add(rate, np.sqrt(2.0 * room / self.true[1]))
        return matrices, bounds

    def largest(self, time: float) -> tuple[float, _Array]:
        """Largest angle in a time, rad, and the accelerations at the knots."""
        found = self.rows(time)
        if found is None:
            return 0.0, np.zeros(KNOTS)
        matrix, bound = np.vstack(found[0]), np.concatenate(found[1])
        # from rest to rest, without a jump at the ends
        ends = np.zeros((3, KNOTS))
        ends[0, 0] = ends[1, -1] = 1.0
        ends[2] = self.rate[-1]
        solved = optimize.linprog(
            -(time**2) * self.angle,
            A_ub=np.vstack([matrix, -matrix]),
            b_ub=np.concatenate([bound, bound]),
            A_eq=ends,
            b_eq=np.zeros(3),
            bounds=(None, None),
            method="highs",
        )
        if not solved.success:
            raise BaselineError(f"the programme of the free profile failed: {solved.message}")
        return -float(solved.fun or 0.0), np.asarray(solved.x)


def _scenario(plan: drm_env.SlewPlan, times: _Array, accelerations: _Array) -> dict[str, Any]:
    period = plan.scenario["sample_period"]
    watch = plan.scenario["horizon"] - plan.best.final_time
    return {
        **plan.scenario,
        "slew": {
            "profile": "table",
            "angle": plan.scenario["slew"]["angle"],
            "times": times.tolist(),
            "accelerations": accelerations.tolist(),
        },
        "horizon": float(np.ceil((times[-1] + watch) / period) * period),
    }


def _used(
    plan: drm_env.SlewPlan, scenario: Mapping[str, Any], accelerations: _Array
) -> dict[str, float]:
    """Part of each limit that the flights use, over the errors of the mass."""
    errors = (0.0, -plan.mass_error, plan.mass_error)[: 3 if plan.mass_error else 1]
    free = {
        wheel: {**scenario[wheel], "momentum_limit": None} for wheel in ("root_wheel", "tip_wheel")
    }
    flown = drm_env.rollout(
        [{**scenario, **free, "mass_error": error} for error in errors],
        law=plan.law,
        loads=True,
        signals=["slew_rate"],
    )
    peaks = {
        "acceleration": np.abs(accelerations).max(),
        "motor_torque": flown["motor_torque_peak"],
        "motor_rate": np.nanmax(np.abs(flown.trajectories["slew_rate"]), axis=1),
        "deployment_force": flown["deployment_force_peak"],
        "root_wheel_momentum": flown["root_wheel_momentum_peak"],
        "tip_wheel_momentum": flown["tip_wheel_momentum_peak"],
        "deflection": flown["peak_deflection"],
        "residual": flown["residual_peak"],
        "root_bending_moment": flown["root_bending_moment_link1_peak"],
        "root_shear": flown["root_shear_link1_peak"],
        "link2_bending_moment": flown["root_bending_moment_link2_peak"],
        "link2_shear": flown["root_shear_link2_peak"],
    }
    limits = plan.limits.given()
    parts = {name: float(np.max(peaks[name])) / limits[name] for name in limits if name in peaks}
    # one that diverged is infinitely far beyond
    return {name: part if np.isfinite(part) else np.inf for name, part in parts.items()}


def free_profile(plan: drm_env.SlewPlan) -> FreeProfile:
    """Return the fastest free profile for what a plan was made for, within the same limits.

    Raises
    ------
    BaselineError
        A manoeuvre without a slew, no limit that bounds one (see :func:`check_limits`), or one that
        no slowness brings within its limits.
    """
    angle = plan.scenario["slew"]["angle"]
    if angle == 0.0:
        raise BaselineError("a free profile needs a slew: there is none in this manoeuvre")
    programme = _Programme(plan)
    longest = plan.best.final_time
    while programme.largest(longest)[0] < abs(angle):
        longest *= 1.5
        if longest > 3600.0:
            raise BaselineError("no free profile within the limits in an hour")
    shortest = 0.0
    for _ in range(40):
        middle = 0.5 * (shortest + longest)
        if programme.largest(middle)[0] < abs(angle):
            shortest = middle
        else:
            longest = middle
        if longest - shortest < 1e-6 * longest:
            break
    reached, knots = programme.largest(longest)
    shape = knots * angle / reached
    rigid, time = longest, longest
    for _ in range(_ROUNDS):
        slower = rigid / time
        times, accelerations = programme.u * time, shape * slower**2
        # rounding must not leave a rate at the end
        scenario = _scenario(plan, times, accelerations)
        used = _used(plan, scenario, accelerations)
        worst = max(used.values(), default=0.0)
        if worst <= 1.0 + 1e-9:
            return FreeProfile(
                final_time=time,
                rigid_time=rigid,
                times=times,
                accelerations=accelerations,
                used=used,
                scenario=scenario,
            )
        time *= 1.002 * min(np.sqrt(worst), 2.0)
    raise BaselineError("no free profile within the limits: the flown arm passes them at any time")
