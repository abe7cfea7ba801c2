"""What is possible: the least tip error of a manoeuvre by a convex programme.

With the true payload known and the wheels ideal up to their torque limits, a manoeuvre is linear in the
wheel torques (:func:`drm_env.transitions`). The torques that minimise the mean squared error of the tip
are then the solution of a quadratic programme with bounds, which Clarabel solves in a fraction of a
second. They are flown through the engine, and the part of the error that the linear model misses (the
second order of the axial load) is put back into the programme until model and flight agree: what is
reported is what was flown.

The torques are held for 20 ms, so that the programme is small; a law that acts every 2 ms can be
slightly better where the bound is far below a tenth of a millimetre.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import drm_env
from drm_baselines.errors import BaselineError

HOLD = 10
"""Samples that a torque is held for."""

AGREEMENT = 0.01
"""Relative difference of predicted and flown tip error at which the bound is accepted."""

_ROUNDS = 4
_LARGEST_ERROR = 3.0  # m
_LARGEST_STATE = 1.0  # rad, m and their rates

# Units of the tip error and scales of the states, as fractions of what happens when nobody acts, in
# the order in which they are tried: the first is exact where the bound is micrometres, the others
# are solved where the wheels are saturated throughout.
_SCALINGS = ((1e-2, 1e-3), (0.3, 1e-4), (1.0, 1e-3))
_FLOOR = 1e-7  # m; below a tenth of a micrometre a relative difference says nothing
_WHEELS = ("root_wheel", "tip_wheel")
_DEFAULT_LIMITS = (100.0, 10.0)

_Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Bound:
    """The best torques of one manoeuvre.

    Attributes
    ----------
    torques
        Of root and tip wheel, N m, shape ``(intervals, 2)``, each held for :data:`HOLD` samples.
    predicted
        RMS of the tip error by the programme, m.
    flown
        The same as the engine flew it, m.
    solved
        Whether the solver reached its tolerance.
    """

    torques: _Array
    predicted: float
    flown: float
    solved: bool


def torque_limits(scenario: Mapping[str, Any]) -> _Array:
    """Return the torque limits of root and tip wheel of a scenario, N m."""
    return np.array(
        [
            float(scenario.get(wheel, {}).get("torque_limit", default))
            for wheel, default in zip(_WHEELS, _DEFAULT_LIMITS, strict=True)
        ]
    )


def propagate(model: drm_env.Transitions, torques: _Array) -> tuple[_Array, _Array]:
    """Return the states at each instant and the tip error (m) at each sample by the linear model.

    ``torques`` have shape ``(intervals, 2)``; states ``(intervals, n)``, errors flat.
    """
    states = np.empty((len(torques), model.start.size))
    state = model.start
    for k, torque in enumerate(torques):
        states[k] = state
        state = model.transition[k] @ state + model.input[k] @ torque + model.offset[k]
    errors = (
        np.einsum("kij,kj->ki", model.error_state, states)
        + np.einsum("kij,kj->ki", model.error_input, torques)
        + model.error_offset
    )
    return states, errors.ravel()


class _Programme:
    """The quadratic programme of one manoeuvre; its linear term alone changes between rounds.

    The unknowns are, instant by instant, the scaled state and the torques as fractions of their
    limits. Scales matter: with states of order a hundred the solver takes thirty iterations even
    where the wheels are saturated throughout; with states of order one it fails there.
    """

    def __init__(
        self, model: drm_env.Transitions, limits: _Array, *, unit: float, scale: float
    ) -> None:
        states, errors = propagate(model, np.zeros((len(model.offset), 2)))
        self.limits = limits
        self.size = model.start.size
        # Measured by what happens when nobody acts. The linear arm with a heavy payload is unstable
        # while it extends, so that this may be astronomical.
        idle = min(float(np.sqrt(np.mean(errors**2))), _LARGEST_ERROR)
        self.unit = max(idle * unit, 1e-6)
        self.scale = np.clip(np.abs(states).max(axis=0), 1e-9, _LARGEST_STATE) * scale
        count, size = len(model.offset), self.size
        width = size + 2
        self._rows = (
            np.concatenate([model.error_state * self.scale, model.error_input * limits], axis=2)
            / self.unit
        )
        self._samples = model.error_offset.shape[1]
        hessian = 2.0 / self._samples * np.einsum("kia,kib->kab", self._rows, self._rows)
        # torques that do not matter are zero
        hessian[:, range(size, width), range(size, width)] += 2e-8
        upper = np.triu_indices(width)
        first = (np.arange(count) * width)[:, None]
        self._cost = sparse.csc_matrix(
            (
                hessian[:, upper[0], upper[1]].ravel(),
                ((first + upper[0]).ravel(), (first + upper[1]).ravel()),
            ),
            shape=(count * width, count * width),
        )
        step = np.concatenate(
            [
                model.transition * self.scale / self.scale[:, None],
                model.input * limits / self.scale[:, None],
            ],
            axis=2,
        )[:-1]
        rows = np.arange(size, count * size).reshape(count - 1, size, 1)
        columns = first[:-1, :, None] + np.arange(width)
        rows, columns = np.broadcast_arrays(rows, columns)
        state = (first + np.arange(size)).ravel()
        motion = sparse.csc_matrix(
            (
                np.concatenate([np.ones(count * size), -step.ravel()]),
                (
                    np.concatenate([np.arange(count * size), rows.ravel()]),
                    np.concatenate([state, columns.ravel()]),
                ),
            ),
            shape=(count * size, count * width),
        )
        torque = (first + np.arange(size, width)).ravel()
        wheels = sparse.csc_matrix(
            (np.ones(2 * count), (np.arange(2 * count), torque)), shape=(2 * count, count * width)
        )
        self._constraints = sparse.vstack([motion, wheels, -wheels], format="csc")
        driven = np.concatenate([model.start[None], model.offset[:-1]]) / self.scale
        self._sides = np.concatenate([driven.ravel(), np.ones(4 * count)])
        self._cones = [clarabel.ZeroConeT(count * size), clarabel.NonnegativeConeT(4 * count)]

    def solve(self, error_offset: _Array) -> tuple[_Array, bool]:
        """Return the best torques (N m) for given error offsets, and whether it was solved."""
        linear = (
            2.0 / self._samples * np.einsum("kia,ki->ka", self._rows, error_offset / self.unit)
        )
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.max_iter = 100
        solution = clarabel.DefaultSolver(
            self._cost, linear.ravel(), self._constraints, self._sides, self._cones, settings
        ).solve()
        values = np.asarray(solution.x).reshape(len(error_offset), -1)
        solved = solution.status in (
            clarabel.SolverStatus.Solved,
            clarabel.SolverStatus.AlmostSolved,
        )
        return np.clip(values[:, self.size :], -1.0, 1.0) * self.limits, solved


def ideal(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scenario whose wheels follow at once and store any momentum, as the bound's do."""
    plain = {key: value for key, value in scenario.items() if key != "sensors"}
    for wheel in _WHEELS:
        if wheel in plain:
            kept = ("torque_limit",)
            plain[wheel] = {key: plain[wheel][key] for key in kept if key in plain[wheel]}
    return plain


def _tip_errors(scenario: Mapping[str, Any], torques: _Array) -> _Array:
    names = ["slew_angle", "reference_angle", "tip_deflection", "extension"]
    flown = drm_env.rollout(
        [scenario], torques=torques[None], hold=HOLD, signals=names, num_threads=1
    ).trajectories
    angle, reference, deflection, extension = (flown[name][0, 1:] for name in names)
    link1 = float(scenario.get("arm", {}).get("link1", {}).get("length", 7.0))
    return np.asarray((link1 + extension) * (angle - reference) + deflection)


def bound_of(scenario: Mapping[str, Any]) -> Bound:
    """Return the best torques of one manoeuvre, for its true payload and with ideal wheels.

    Raises
    ------
    drm_env.ConfigError
        A scenario that cannot be flown, or whose samples :data:`HOLD` does not divide.
    """
    plain = ideal(scenario)
    model = drm_env.transitions(plain, hold=HOLD)
    limits = torque_limits(plain)
    best: Bound | None = None
    for unit, scale in _SCALINGS:
        found = _refined(plain, model, _Programme(model, limits, unit=unit, scale=scale))
        if best is None or (found.solved, -found.flown) > (best.solved, -best.flown):
            best = found
        if best.solved:
            break
    assert best is not None, "there is at least one scaling"
    return best


def _refined(
    plain: Mapping[str, Any], model: drm_env.Transitions, programme: _Programme
) -> Bound:
    """Solve, fly, and put what the model missed back into the programme until the two agree."""
    offset = model.error_offset
    best: Bound | None = None
    for _ in range(_ROUNDS):
        torques, solved = programme.solve(offset)
        _, predicted = propagate(model._replace(error_offset=offset), torques)
        errors = _tip_errors(plain, torques)
        found = Bound(
            torques=torques,
            predicted=float(np.sqrt(np.mean(predicted**2))),
            flown=float(np.sqrt(np.mean(errors**2))),
            solved=solved,
        )
        if best is None or found.flown < best.flown:
            best = found
        if not solved:
            break
        if abs(found.flown - found.predicted) <= AGREEMENT * found.flown + _FLOOR:
            break
        offset = offset + (errors - predicted).reshape(offset.shape)
    assert best is not None, "there is at least one round"
    return best


def bounds_of(
    scenarios: Sequence[Mapping[str, Any]],
    *,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Bound]:
    """Return the bounds of many manoeuvres, solved side by side.

    Raises
    ------
    BaselineError
        A programme that was not solved, with the scenario's place.
    """
    found: list[Bound] = []
    with ThreadPoolExecutor(max_workers=threads or drm_env_threads()) as pool:
        for index, bound in enumerate(pool.map(bound_of, scenarios)):
            if not np.isfinite(bound.flown):
                raise BaselineError(f"scenarios[{index}]: the bound's flight diverged")
            found.append(bound)
            if progress is not None:
                progress(index + 1, len(scenarios))
    return found


def drm_env_threads() -> int:
    """Return the number of processors that this process may use."""
    import os

    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
