"""How the tip error and the state depend on what is done from one decision to the next.

Within an interval the inner law acts at every sample of the engine and the wheels may reach their
limits. Where they do not, the interval is linear and known beforehand; where they do, it is
followed sample by sample with the wheels that are at their limit left out of the derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

import drm_env
from drm_baselines.imitation.teacher import Teaching, digest_of
from drm_baselines.optimal_control.quadratic_program import (
    closed_loop,
    linear_feedback,
    torque_limits,
)
from drm_baselines.suites import STRATA
from drm_baselines.support import storage
from drm_baselines.support.processes import process_pool
from drm_env.constants import LAW_PERIOD

_FORMAT = "drm-sensitivities 2"
_CHUNK = 2048  # intervals at a time: what fits into the cache


@dataclass(frozen=True, kw_only=True)
class Intervals:
    """The intervals of one or more manoeuvres, one after the other.

    Attributes
    ----------
    counts
        Intervals of each manoeuvre, (manoeuvres,).
    ends
        The first of them that begins after the slew, (manoeuvres,).
    onward
        While no wheel saturates: next state, momenta of the wheels and their last torques, by state
        (6) and action (2), (n, 10, 8).
    errors
        The same for the tip errors (m) at the samples, with the constant part last, (n, hold, 9).
    transition, given, drift
        From sample to sample, the matrices taken in the middle of the interval: (n, 6, 6),
        (n, 6, 2) per N m, (n, hold, 6).
    error_state, error_input, error_drift
        The tip's error likewise: (n, 6), (n, 2), (n,).
    """

    counts: NDArray[np.int64]
    ends: NDArray[np.int64]
    onward: NDArray[np.float32]
    errors: NDArray[np.float32]
    transition: NDArray[np.float32]
    given: NDArray[np.float32]
    drift: NDArray[np.float32]
    error_state: NDArray[np.float32]
    error_input: NDArray[np.float32]
    error_drift: NDArray[np.float32]

    def of(self, manoeuvres: NDArray[np.int64]) -> Intervals:
        """Return copies of the intervals of some manoeuvres, in the order given."""
        last = np.cumsum(self.counts)
        rows = np.concatenate([np.arange(last[i] - self.counts[i], last[i]) for i in manoeuvres])
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        each = {name: getattr(self, name)[manoeuvres] for name in _EACH}
        return Intervals(**each, **arrays)


_EACH = ("counts", "ends")
_ARRAYS = (
    "onward", "errors", "transition", "given", "drift", "error_state", "error_input", "error_drift",
)  # fmt: skip


def intervals_of(scenario: Mapping[str, Any], teaching: Teaching, tail: float) -> Intervals:
    """Return the intervals of a manoeuvre until ``tail`` seconds after the slew."""
    feedback, hold = linear_feedback(teaching.inner_law), teaching.hold
    scale = teaching.wheel_scale * torque_limits(scenario)  # N m of an action of 1
    model = drm_env.transitions(scenario, hold=1)
    end = float(drm_env.rollout([scenario], law={"name": "none"})["slew_end_time"][0])
    period = hold * LAW_PERIOD
    count = min(len(model.offset) // hold, int(np.ceil((end + tail) / period)))
    model = drm_env.Transitions(model.start, *(part[: count * hold] for part in model[1:]))
    whole = closed_loop(model, feedback, hold)
    # the wheels' torques at the samples, and what they add up to
    step = (model.transition + model.input @ feedback).reshape(count, hold, 6, 6)
    given = (model.input * scale).reshape(count, hold, 6, 2)
    state = np.broadcast_to(np.eye(6, 8), (count, 6, 8))
    direct = np.concatenate([np.zeros((2, 6)), np.diag(scale)], axis=1)
    momentum = np.zeros((count, 2, 8))
    for j in range(hold):
        torque = feedback @ state + direct
        momentum -= LAW_PERIOD * torque
        state = step[:, j] @ state
        state[:, :, 6:] += given[:, j]
    middle = slice(hold // 2, None, hold)
    arrays = {
        "onward": np.concatenate([state, momentum, torque], axis=1),
        "errors": np.concatenate(
            [whole.error_state, whole.error_input * scale, whole.error_offset[:, :, None]], axis=2
        ),
        "transition": model.transition[middle],
        "given": model.input[middle],
        "drift": model.offset.reshape(count, hold, 6),
        "error_state": model.error_state[middle, 0],
        "error_input": model.error_input[middle, 0],
        "error_drift": model.error_offset.reshape(count, hold).mean(axis=1),
    }
    return Intervals(
        counts=np.array([count], dtype=np.int64),
        ends=np.array([min(count, int(np.ceil(end / period)))], dtype=np.int64),
        **{name: array.astype(np.float32) for name, array in arrays.items()},
    )


def prepare(
    path: Path,
    teaching: Teaching,
    manoeuvres: int,
    tail: float,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Intervals:
    """Return the intervals of the manoeuvres of a refinement; kept in a file, read if it fits.

    Raises
    ------
    RunError
        The file is damaged.
    """
    digest = f"{_FORMAT} {manoeuvres} {tail} {teaching.wheel_scale} {digest_of(teaching)}"
    arrays = storage.load_arrays(path, digest)
    if arrays is not None:
        return Intervals(**arrays)
    found: list[Intervals] = []
    with process_pool() as pool:
        for stratum in range(len(STRATA)):
            seeds = teaching.seeds(stratum, manoeuvres)
            scenarios = drm_env.sample_scenarios(
                config=teaching.config(stratum), seed=seeds[0], n=len(seeds)
            )
            count = len(scenarios)
            for one in pool.map(
                intervals_of, scenarios, [teaching] * count, [tail] * count, chunksize=4
            ):
                found.append(one)
                if progress is not None:
                    progress(len(found), manoeuvres)
    joined = {
        name: np.concatenate([getattr(one, name) for one in found]) for name in (*_EACH, *_ARRAYS)
    }
    storage.save_arrays(path, joined, digest)
    return Intervals(**joined)


class Derivatives(NamedTuple):
    """Of intervals as they were flown, by state (6) and action (2).

    Attributes
    ----------
    onward
        Next state, momenta and last torques of the wheels, (n, 10, 8).
    cost
        Mean squared tip error of the interval, (n, 8), m^2.
    squared
        That error itself, (n,), m^2.
    """

    onward: torch.Tensor
    cost: torch.Tensor
    squared: torch.Tensor


def derivatives(
    intervals: Intervals, states: torch.Tensor, actions: torch.Tensor, teaching: Teaching,
    limits: torch.Tensor,
) -> Derivatives:  # fmt: skip
    """Return the derivatives of intervals that begin in these states (n, 6) with actions (n, 2).

    ``limits`` (N m) are the wheels'.
    """
    feedback = torch.from_numpy(linear_feedback(teaching.inner_law).astype(np.float32))
    torques = actions * teaching.wheel_scale * limits
    transition, given, drift = (
        torch.from_numpy(part) for part in (intervals.transition, intervals.given, intervals.drift)
    )
    hold = drift.shape[1]
    # where does a wheel reach its limit
    limited = torch.zeros(len(states), dtype=torch.bool)
    state = states
    for j in range(hold):
        wanted = state @ feedback.T + torques
        limited |= (wanted.abs() >= limits).any(dim=1)
        state = _next(transition, given, drift[:, j], state, _saturated(wanted, limits))

    onward = torch.from_numpy(intervals.onward.copy())
    errors = torch.from_numpy(intervals.errors)
    at = torch.cat([states, actions], dim=1)
    error = (errors[:, :, :8] @ at[:, :, None])[:, :, 0] + errors[:, :, 8]
    cost = 2.0 / hold * (error[:, None] @ errors[:, :, :8])[:, 0]
    squared = error.square().mean(dim=1)

    rows = torch.nonzero(limited)[:, 0]
    for start in range(0, len(rows), _CHUNK):
        chosen = rows[start : start + _CHUNK]
        parts = [part[chosen] for part in (transition, given, drift)]
        seen = [
            torch.from_numpy(part)[chosen]
            for part in (intervals.error_state, intervals.error_input, intervals.error_drift)
        ]
        found = _followed(
            parts, seen, states[chosen], torques[chosen], feedback, limits, teaching.wheel_scale
        )
        onward[chosen], cost[chosen], squared[chosen] = found
    return Derivatives(onward, cost, squared)


def _saturated(wanted: torch.Tensor, limits: torch.Tensor) -> torch.Tensor:
    return torch.minimum(torch.maximum(wanted, -limits), limits)


def _next(
    transition: torch.Tensor, given: torch.Tensor, drift: torch.Tensor, state: torch.Tensor,
    torque: torch.Tensor,
) -> torch.Tensor:  # fmt: skip
    moved = (transition @ state[:, :, None])[:, :, 0]
    driven: torch.Tensor = moved + (given @ torque[:, :, None])[:, :, 0] + drift
    return driven


def _followed(
    parts: list[torch.Tensor], seen: list[torch.Tensor], state: torch.Tensor,
    torques: torch.Tensor, feedback: torch.Tensor, limits: torch.Tensor, wheel_scale: float,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:  # fmt: skip
    """Return onward, cost and squared error of intervals, sample by sample."""
    transition, given, drift = parts
    error_state, error_input, error_drift = seen
    count, hold = len(state), drift.shape[1]
    by = torch.zeros(count, 6, 8)
    by[:, range(6), range(6)] = 1.0
    direct = torch.zeros(2, 8)
    direct[0, 6], direct[1, 7] = wheel_scale * limits
    cost, momentum = torch.zeros(count, 8), torch.zeros(count, 2, 8)
    squared = torch.zeros(count)
    torque_by = momentum
    for j in range(hold):
        wanted = state @ feedback.T + torques
        free = (wanted.abs() < limits).float()
        torque = _saturated(wanted, limits)
        torque_by = (feedback @ by + direct) * free[:, :, None]
        error = (error_state * state).sum(dim=1) + (error_input * torque).sum(dim=1) + error_drift
        error_by = (error_state[:, None] @ by)[:, 0] + (error_input[:, None] @ torque_by)[:, 0]
        cost += 2.0 / hold * error[:, None] * error_by
        squared += error.square() / hold
        momentum = momentum - LAW_PERIOD * torque_by
        state = _next(transition, given, drift[:, j], state, torque)
        by = transition @ by + given @ torque_by
    return torch.cat([by, momentum, torque_by], dim=1), cost, squared
