"""The teacher: plans for training manoeuvres by somebody who knows the true payload.

A plan is the solution of the convex programme with the inner law in the loop, smooth in time so
that a network can follow it, with the linear-quadratic feedback around it: where the student has
gone astray, the teacher shows the way back. What the teacher knows beforehand the student has to
find out from how the arm answers.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.optimal_control.quadratic_program import (
    Programme,
    closed_loop,
    linear_feedback,
    torque_limits,
)
from drm_baselines.optimal_control.tvlqr import feedback_around, saturation
from drm_baselines.suites import STRATA, suite_named
from drm_baselines.support import storage
from drm_baselines.support.processes import process_pool
from drm_baselines.support.seeds import TRAINING_SEED
from drm_env.constants import LAW_PERIOD

PLANS_FORMAT = "drm-teacher-plans 3"


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
        Share of the torque limits that a plan uses: the rest is for who flies it and errs.
    effort
        Tip error (m) that a wheel's full torque is worth in a plan: small, but it brings the wheels
        to rest where nothing is to be gained.
    softness
        Tip error (m) that a deviation from a plan's torque by the whole limit is worth: sets the
        stiffness of the feedback around the plan.
    overshoot
        What is asked for beyond the limit where a plan saturates a wheel, as a fraction of it, so
        that a student who is not exact saturates it too.
    waiting
        Decisions at the beginning at which the advice is to do nothing: what the teacher would do
        depends on what nobody else can know yet.
    wheel_scale
        Torque of a wheel at an action of 1, in multiples of its limit: enough to overrule the inner
        law where a plan saturates the wheels, in spite of the vibration that the slew begins with.
    identified
        Whether the student is shown the identified error of the reported mass.
    history
        Observations that the student sees at a time, this one and those before it: where the arm is
        going, and what is not measured.
    preview_times
        How far ahead the student sees the reference and the extension, s.
    """

    suite: str = "robust"
    scenarios: int = 800
    first_seed: int = TRAINING_SEED
    inner_law: Mapping[str, Any] = field(
        default_factory=lambda: {
            "name": "linear",
            "root": {"rate_gain": 1.0e4, "angle_gain": 0.0},
            "tip": {"rate_gain": 100.0},
        }
    )
    hold: int = 10
    smoothing: float = 5.0e-4
    authority: float = 0.99
    effort: float = 1.0e-4
    softness: float = 1.0e-2
    overshoot: float = 0.2
    waiting: int = 3
    wheel_scale: float = 4.0
    identified: bool = True
    history: int = 3
    preview_times: tuple[float, ...] = (0.1, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)

    def task(self) -> dict[str, Any]:
        """Return the task part of the student's environment."""
        return {
            "control_period": self.hold * LAW_PERIOD,
            "inner_law": {**self.inner_law},
            "wheel_scale": self.wheel_scale,
            "observe_identified": self.identified,
            "observation_history": self.history,
            "preview_times": list(self.preview_times),
        }

    def config(self, stratum: int) -> dict[str, Any]:
        """Return the configuration of the student's environment in one stratum."""
        return {**suite_named(self.suite).stratum_config(stratum), "task": self.task()}

    def seeds(self, stratum: int, scenarios: int | None = None) -> range:
        """Return the seeds of a stratum's manoeuvres, of so many in all strata."""
        first = self.first_seed + 100_000 * stratum
        return range(first, first + (scenarios or self.scenarios) // len(STRATA))


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A plan of one manoeuvre.

    Attributes
    ----------
    torques
        Fractions of the wheels' limits beyond the inner law, not limited, (intervals, 2).
    states
        Deviation from the undeflected arm at the reference at the instants, (intervals, 6).
    gains
        Of the deviation from ``states``, fractions of the limits, (intervals, 2, 6).
    saturated
        Sign of the torque where a wheel is at its limit, else 0, (intervals, 2).
    solved
        Whether the solver reached its tolerance.
    """

    torques: NDArray[np.float32]
    states: NDArray[np.float32]
    gains: NDArray[np.float32]
    saturated: NDArray[np.int8]
    solved: bool = True


@dataclass(frozen=True, kw_only=True)
class Plans:
    """Plans of the manoeuvres of one stratum: see :class:`Plan`, with a leading axis."""

    stratum: int
    seeds: NDArray[np.int64]
    torques: NDArray[np.float32]
    states: NDArray[np.float32]
    gains: NDArray[np.float32]
    saturated: NDArray[np.int8]


_PARTS = ("torques", "states", "gains", "saturated")


def plan_of(scenario: Mapping[str, Any], teaching: Teaching) -> Plan:
    """Return the plan of a manoeuvre."""
    feedback, limits = linear_feedback(teaching.inner_law), torque_limits(scenario)
    model = closed_loop(drm_env.transitions(scenario, hold=1), feedback, teaching.hold)
    programme = Programme(
        model,
        limits,
        feedback=feedback,
        smoothing=np.full(2, teaching.smoothing),
        effort=teaching.effort,
        authority=teaching.authority,
    )
    held, states, solved = programme.solve(model.error_offset)
    saturated = saturation(held, states, feedback, limits, teaching.authority)
    gains = feedback_around(model, limits, feedback, saturated, teaching.softness)
    return Plan(
        torques=(held / limits).astype(np.float32),
        states=states.astype(np.float32),
        gains=gains.astype(np.float32),
        saturated=saturated,
        solved=solved,
    )


def advise(
    plans: Plans, k: int, states: NDArray[np.float64], teaching: Teaching
) -> NDArray[np.float32]:
    """Return what the teacher would do at decision k in these states (n, 6): actions (n, 2)."""
    deviation = states - plans.states[:, k]
    torques = plans.torques[:, k] + np.einsum("nij,nj->ni", plans.gains[:, k], deviation)
    torques = torques + teaching.overshoot * plans.saturated[:, k]
    if k < teaching.waiting:
        torques = np.zeros_like(torques)
    actions: NDArray[np.float32] = np.clip(torques / teaching.wheel_scale, -1.0, 1.0)
    return actions.astype(np.float32)


# What is done with the plans later, and does not change them.
_LATER = ("overshoot", "waiting", "wheel_scale", "identified", "history", "preview_times")


def digest_of(teaching: Teaching) -> str:
    """Return a text that says what plans were made with."""
    content = {"format": PLANS_FORMAT, **asdict(teaching)}
    return json.dumps({k: v for k, v in content.items() if k not in _LATER}, sort_keys=True)


def make_plans(
    teaching: Teaching, *, progress: Callable[[int, int], None] | None = None
) -> list[Plans]:
    """Plan all manoeuvres, side by side; one that was not solved is left out."""
    plans = []
    done = 0
    with process_pool() as pool:
        for stratum in range(len(STRATA)):
            seeds = teaching.seeds(stratum)
            scenarios = drm_env.sample_scenarios(
                config=teaching.config(stratum), seed=seeds[0], n=len(seeds)
            )
            found = []
            for plan in pool.map(plan_of, scenarios, [teaching] * len(scenarios), chunksize=4):
                found.append(plan)
                done += 1
                if progress is not None:
                    progress(done, teaching.scenarios)
            solved = np.array([plan.solved for plan in found])
            plans.append(
                Plans(
                    stratum=stratum,
                    seeds=np.asarray(seeds, dtype=np.int64)[solved],
                    **{
                        name: np.array([getattr(plan, name) for plan in found])[solved]
                        for name in _PARTS
                    },
                )
            )
    return plans


def save_plans(path: Path, plans: Sequence[Plans], teaching: Teaching) -> Path:
    """Write plans to a NumPy archive without pickles, replacing an older one in one rename."""
    arrays = {
        f"{name}{plan.stratum}": getattr(plan, name)
        for plan in plans
        for name in ("seeds", *_PARTS)
    }
    return storage.save_arrays(path, arrays, digest_of(teaching))


def load_plans(path: Path, teaching: Teaching) -> list[Plans] | None:
    """Read plans back; none if the file is missing or was made with other settings.

    Raises
    ------
    RunError
        The file is damaged.
    """
    arrays = storage.load_arrays(path, digest_of(teaching))
    if arrays is None:
        return None
    return [
        Plans(stratum=stratum, **{name: arrays[f"{name}{stratum}"] for name in ("seeds", *_PARTS)})
        for stratum in range(len(STRATA))
    ]
