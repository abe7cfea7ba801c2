"""The teacher: plans for training manoeuvres by somebody who knows the true payload.

A plan is the solution of the convex programme with the inner law in the loop, smooth in time so
that a network can follow it, and a feedback on the slew error around it: where the student has
gone astray, the teacher shows the way back. What it knows beforehand the student has to find
out from how the arm answers.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines import storage
from drm_baselines.benchmark.programme import (
    Programme,
    closed_loop,
    linear_feedback,
    torque_limits,
)
from drm_baselines.benchmark.suites import STRATA, suite_named
from drm_baselines.errors import RunError
from drm_baselines.policies import LAW_PERIOD

PLANS_FORMAT = "drm-teacher-plans 1"

_Array = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class Teaching:
    """What the teacher does.

    Attributes
    ----------
    suite
        Suite whose distributions the manoeuvres are drawn from.
    scenarios
        Manoeuvres, a quarter a stratum.
    first_seed
        Seed of the first; strata are 100,000 apart. Beyond all seeds of the suites.
    inner_law
        The linear law that runs below the plan.
    hold
        Samples that a torque of the plan is held for: the student's control period.
    smoothing
        Tip error (m) that a change of a wheel's torque by its limit is worth.
    authority
        Share of the torque limits that a plan uses. A plan at the limit itself cannot be regained
        once it is lost.
    angle_feedback
        Torque of the root wheel per slew error from the plan, N m/rad.
    wheel_scale
        Torque of a wheel at an action of 1, in multiples of its limit: enough to overrule the inner
        law where a plan saturates the wheels.
    identified
        Whether the student is shown the identified error of the reported mass.
    """

    suite: str = "robust"
    scenarios: int = 1600
    first_seed: int = 1_000_000_000
    inner_law: Mapping[str, Any] = field(
        default_factory=lambda: {
            "name": "linear",
            "root": {"rate_gain": 5.0e4, "angle_gain": 2.0e3},
            "tip": {"rate_gain": 500.0},
        }
    )
    hold: int = 10
    smoothing: float = 5.0e-4
    authority: float = 0.93
    angle_feedback: float = 2.0e5
    wheel_scale: float = 4.0
    identified: bool = True

    def task(self) -> dict[str, Any]:
        """Return the task part of the student's environment."""
        return {
            "control_period": self.hold * LAW_PERIOD,
            "inner_law": {**self.inner_law},
            "wheel_scale": self.wheel_scale,
            "observe_identified": self.identified,
        }

    def config(self, stratum: int) -> dict[str, Any]:
        """Return the configuration of the student's environment in one stratum."""
        return {**suite_named(self.suite).stratum_config(stratum), "task": self.task()}

    def seeds(self, stratum: int) -> range:
        """Return the seeds of a stratum's manoeuvres."""
        first = self.first_seed + 100_000 * stratum
        return range(first, first + self.scenarios // len(STRATA))


@dataclass(frozen=True, kw_only=True)
class Plans:
    """Plans of the manoeuvres of one stratum.

    Attributes
    ----------
    stratum, seeds
        Where the manoeuvres come from.
    torques
        Fractions of the wheels' limits beyond the inner law, not limited, (n, intervals, 2).
    angle
        Slew error at the instants, rad, (n, intervals).
    """

    stratum: int
    seeds: NDArray[np.int64]
    torques: _Array
    angle: NDArray[np.float64]


def plan_of(
    scenario: Mapping[str, Any], teaching: Teaching
) -> tuple[_Array, NDArray[np.float64], bool]:
    """Return torque fractions (intervals, 2), slew errors (intervals,), and whether solved."""
    feedback, limits = linear_feedback(teaching.inner_law), torque_limits(scenario)
    fine = drm_env.transitions(scenario, hold=1)
    model = closed_loop(fine, feedback, teaching.hold)
    smoothing = np.full(2, teaching.smoothing)
    programme = Programme(
        model, limits, feedback=feedback, smoothing=smoothing, authority=teaching.authority
    )
    held, states, solved = programme.solve(model.error_offset)
    return (held / limits).astype(np.float32), states[:, 0], solved


def _digest(teaching: Teaching) -> str:
    return json.dumps({"format": PLANS_FORMAT, **asdict(teaching)}, sort_keys=True)


def make_plans(
    teaching: Teaching, *, progress: Callable[[int, int], None] | None = None
) -> list[Plans]:
    """Plan all manoeuvres, side by side; one that was not solved is left out."""
    plans = []
    done = 0
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        for stratum in range(len(STRATA)):
            seeds = teaching.seeds(stratum)
            scenarios = drm_env.sample_scenarios(
                config=teaching.config(stratum), seed=seeds[0], n=len(seeds)
            )
            found = []
            for plan in pool.map(lambda scenario: plan_of(scenario, teaching), scenarios):
                found.append(plan)
                done += 1
                if progress is not None:
                    progress(done, teaching.scenarios)
            solved = np.array([plan[2] for plan in found])
            plans.append(
                Plans(
                    stratum=stratum,
                    seeds=np.asarray(seeds, dtype=np.int64)[solved],
                    torques=np.array([plan[0] for plan in found])[solved],
                    angle=np.array([plan[1] for plan in found])[solved],
                )
            )
    return plans


def save_plans(path: Path, plans: Sequence[Plans], teaching: Teaching) -> Path:
    """Write plans to a NumPy archive without pickles, replacing an older one in one rename."""
    arrays: dict[str, Any] = {"digest": np.array(_digest(teaching))}
    for plan in plans:
        arrays[f"seeds{plan.stratum}"] = plan.seeds
        arrays[f"torques{plan.stratum}"] = plan.torques
        arrays[f"angle{plan.stratum}"] = plan.angle
    with storage.atomic_path(path, overwrite=True) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **arrays)
    return path


def load_plans(path: Path, teaching: Teaching) -> list[Plans] | None:
    """Read plans back; none if the file is missing or was made with other settings.

    Raises
    ------
    RunError
        The file is damaged.
    """
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as arrays:
            if str(arrays["digest"]) != _digest(teaching):
                return None
            return [
                Plans(
                    stratum=stratum,
                    seeds=arrays[f"seeds{stratum}"],
                    torques=arrays[f"torques{stratum}"],
                    angle=arrays[f"angle{stratum}"],
                )
                for stratum in range(len(STRATA))
            ]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise RunError(f"{path} cannot be read: {error}; delete it to plan anew") from error
