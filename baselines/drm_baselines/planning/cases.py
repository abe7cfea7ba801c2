"""Drawn planning cases, to see whether every plan keeps its limits when it is flown.

A case draws a payload, two places in the workspace, a plant's limits and the error of the mass, all
by its seed. What comes out is flown again, by another door than the planner's (one manoeuvre after
the other), and every limit is looked at in the signals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import drm_env

SHAPES = (("min_time", 0.0), ("min_time", 0.1), ("min_energy", 0.0), ("min_energy", 0.1))
"""One shape of each of the thesis' families."""

_TIGHT = 0.15
"""Share of the cases that also limit the final time to something near what it takes."""

_ROUNDING = 1e-9


class Case(NamedTuple):
    """What is to be planned.

    Attributes
    ----------
    seed
        Of the draw.
    arguments
        For ``drm_env.plan_slew``.
    acceleration_only
        Whether nothing but the acceleration is limited.
    """

    seed: int
    arguments: dict[str, Any]
    acceleration_only: bool


@dataclass(frozen=True, kw_only=True)
class CaseResult:
    """How a case ended.

    Attributes
    ----------
    seed
        Of the draw.
    refused
        The limit in the way, with what is needed and allowed; ``None`` for a plan.
    used
        Largest part of a limit that the flights used; 0 where it was refused.
    tightest
        The limit that this is of.
    slower
        Final time over that of the thesis' closed form, where only the acceleration limits.
    """

    seed: int
    refused: tuple[str, float, float] | None
    used: float
    tightest: str
    slower: float | None

    @property
    def held(self) -> bool:
        """Whether no limit was passed and no time was lost."""
        return self.used <= 1.0 + _ROUNDING and (self.slower is None or self.slower < 1.0 + 1e-9)


@dataclass(frozen=True, kw_only=True)
class Proof:
    """How many cases ended how."""

    plant: str
    results: tuple[CaseResult, ...]

    def counts(self) -> dict[str, Any]:
        """Return numbers of cases, planned, refused, held, and the largest part of a limit used."""
        planned = [each for each in self.results if each.refused is None]
        return {
            "plant": self.plant,
            "cases": len(self.results),
            "planned": len(planned),
            "refused": len(self.results) - len(planned),
            "within_limits": sum(each.used <= 1.0 + _ROUNDING for each in planned),
            "largest_part_used": max((each.used for each in planned), default=0.0),
            "acceleration_only": sum(each.slower is not None for each in planned),
            "slowest_over_closed_form": max(
                (each.slower for each in planned if each.slower is not None), default=None
            ),
            "failed_seeds": [each.seed for each in self.results if not each.held],
        }


def draw_case(seed: int, plant: str) -> Case:
    """Return the case of a seed."""
    rng = np.random.default_rng([seed, 1907])
    ring = drm_env.workspace()
    mass = float(rng.uniform(0.0, 500.0))
    start = float(rng.uniform(ring.hole, ring.edge))
    goal = float(rng.uniform(ring.hole, ring.edge))
    first, turn = float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(0.3, 2.8))
    turn *= float(rng.choice([-1.0, 1.0]))
    scenario: dict[str, Any] = {"plant": plant, "payload": {"mass": mass}}
    if plant == "consistent":
        scenario["dynamics"] = {"damping_ratio": 0.005}
    arguments: dict[str, Any] = {
        "scenario": scenario,
        "start": tuple(map(float, drm_env.tip_position(first, start - 7.0))),
        "goal": tuple(map(float, drm_env.tip_position(first + turn, goal - 7.0))),
        "shapes": SHAPES,
        "watch": 2.0,
    }
    if rng.random() < 0.2:
        arguments["limits"] = {"acceleration": float(rng.uniform(0.01, 0.04))}
        return Case(seed, arguments, True)
    limits: dict[str, float] = {"motor_torque": float(rng.uniform(300.0, 2000.0))}
    for name, low, high in (
        ("acceleration", 0.01, 0.06),
        ("motor_rate", 0.05, 0.25),
        ("deployment_force", 30.0, 250.0),
        ("deflection", 0.01, 0.1),
        ("root_bending_moment", 400.0, 2000.0),
        ("link2_bending_moment", 100.0, 1000.0),
    ):
        if rng.random() < 0.5:
            limits[name] = float(rng.uniform(low, high))
    if plant == "thesis" and rng.random() < 0.3:
        # the thesis' laws are made for its plant
        arguments |= {"law": "linear", "mass_error": float(rng.uniform(0.02, 0.15))}
        limits["root_wheel_momentum"] = float(rng.uniform(100.0, 600.0))
    if rng.random() < _TIGHT:
        limits["final_time"] = float(rng.uniform(8.0, 25.0))
    arguments["limits"] = limits
    return Case(seed, arguments, False)


def _peaks(flight: drm_env.Trajectory) -> dict[str, float]:
    """What a flight used, by the names of the limits that it can be seen in."""
    signals = {
        "motor_torque": "slew_torque",
        "motor_rate": "slew_rate",
        "root_wheel_momentum": "root_momentum",
        "tip_wheel_momentum": "tip_momentum",
        "deflection": "tip_deflection",
        "deployment_force": "deployment_force",
        "root_bending_moment": "root_bending_moment_link1",
        "link2_bending_moment": "root_bending_moment_link2",
    }
    found = {name: float(np.abs(flight[signal]).max()) for name, signal in signals.items()}
    found["acceleration"] = float(np.abs(flight["reference_accel"]).max())
    found["final_time"] = flight.metrics["slew_end_time"]
    return found


def fly_case(case: Case) -> CaseResult:
    """Plan a case and fly what comes out, with the mass right, too small and too large."""
    try:
        plan = drm_env.plan_slew(**case.arguments)
    except drm_env.InfeasibleError as refusal:
        refused = (refusal.limit, refusal.needed, refusal.allowed)
        return CaseResult(seed=case.seed, refused=refused, used=0.0, tightest="", slower=None)
    limits = {**plan.limits.given()}
    if plan.limits.final_time is not None:
        limits["final_time"] = plan.limits.final_time
    used: dict[str, float] = {}
    error = plan.mass_error
    for wrong in (0.0, -error, error) if error else (0.0,):
        scenario = {**plan.scenario, "mass_error": wrong}
        flight = drm_env.simulate(scenario, law=case.arguments.get("law", "none"), loads=True)
        for name, value in _peaks(flight).items():
            if name in limits:
                used[name] = max(used.get(name, 0.0), value / limits[name])
    slower = None
    if case.acceleration_only:
        # the thesis' minimum time: t_f^2 = 4 angle / accel
        shortest = 2.0 * np.sqrt(abs(plan.scenario["slew"]["angle"]) / limits["acceleration"])
        slower = float(plan.best.final_time / shortest)
    tightest = max(used, key=lambda name: used[name])
    return CaseResult(
        seed=case.seed, refused=None, used=used[tightest], tightest=tightest, slower=slower
    )


def fly_cases(
    seeds: Iterable[int], plant: str, tell: Callable[[int], object] | None = None
) -> Proof:
    """Plan and fly many cases; ``tell`` is called with how many are done."""
    results = []
    for done, seed in enumerate(seeds):
        if tell is not None:
            tell(done)
        results.append(fly_case(draw_case(seed, plant)))
    return Proof(plant=plant, results=tuple(results))
