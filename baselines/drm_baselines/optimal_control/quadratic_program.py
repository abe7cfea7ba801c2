"""The convex programme behind the bound and the teacher of learned policies.

A manoeuvre is linear in the wheel torques (:func:`drm_env.transitions`). With torques u = F x +
r, where F is a linear law that acts at every sample and r is what is sought, held for a number
of samples, the mean squared error of the tip is a convex quadratic function of r and the torque
limits are linear constraints. Clarabel solves the programme of a whole manoeuvre in a fraction
of a second.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import drm_env

_Array = NDArray[np.float64]

_LARGEST_ERROR = 3.0  # m
_LARGEST_STATE = 1.0  # rad, m and their rates
_SMALLEST_STATE = 1e-9
# Torques that do not matter are zero.
_EFFORT = 1e-8


def torque_limits(scenario: Mapping[str, Any]) -> _Array:
    """Return the torque limits of root and tip wheel of a scenario, N m, shape (2,)."""
    default = drm_env.default_config().scenario
    limits = {
        "root_wheel": default.root_wheel.torque_limit,
        "tip_wheel": default.tip_wheel.torque_limit,
    }
    return np.array(
        [float(scenario.get(name, {}).get("torque_limit", limit)) for name, limit in limits.items()]
    )


def linear_feedback(law: Mapping[str, Any]) -> _Array:
    """Return F of the thesis plant under a ``linear`` law, N m per entry of the state, (2, 6)."""
    feedback = np.zeros((2, 6))
    feedback[0, 0] = -float(law["root"]["angle_gain"])
    feedback[0, 3] = -float(law["root"]["rate_gain"])
    feedback[1, 5] = -float(law["tip"]["rate_gain"])
    return feedback


def closed_loop(model: drm_env.Transitions, feedback: _Array, hold: int) -> drm_env.Transitions:
    """Return the model with a law acting at each of its instants and r held for ``hold`` of them.

    Parameters
    ----------
    model
        At every sample (``hold=1``), with N of them.
    feedback
        F, shape (2, n).
    hold
        Samples that r is held for; it divides N.
    """
    count, size = len(model.offset) // hold, model.start.size
    shape = (count, hold)
    step = (model.transition + model.input @ feedback).reshape(*shape, size, size)
    given = model.input.reshape(*shape, size, 2)
    offset = model.offset.reshape(*shape, size)
    seen = (model.error_state[:, 0] + model.error_input[:, 0] @ feedback).reshape(*shape, size)
    direct = model.error_input[:, 0].reshape(*shape, 2)
    constant = model.error_offset[:, 0].reshape(shape)

    state = np.broadcast_to(np.eye(size), (count, size, size))
    torque, drift = np.zeros((count, size, 2)), np.zeros((count, size))
    rows: list[tuple[_Array, _Array, _Array]] = []
    for i in range(hold):
        row = seen[:, i, None, :]
        rows.append(
            (
                (row @ state)[:, 0],
                (row @ torque)[:, 0] + direct[:, i],
                (row[:, 0] * drift).sum(axis=1) + constant[:, i],
            )
        )
        state = step[:, i] @ state
        torque = step[:, i] @ torque + given[:, i]
        drift = np.einsum("kij,kj->ki", step[:, i], drift) + offset[:, i]
    return drm_env.Transitions(
        start=model.start,
        transition=state,
        input=torque,
        offset=drift,
        error_state=np.stack([row[0] for row in rows], axis=1),
        error_input=np.stack([row[1] for row in rows], axis=1),
        error_offset=np.stack([row[2] for row in rows], axis=1),
    )


def propagate(model: drm_env.Transitions, held: _Array) -> tuple[_Array, _Array]:
    """Return the states at each instant and the tip error (m) at each sample by the linear model.

    ``held`` (N m) has shape (intervals, 2); states have shape (intervals, n), errors
    (intervals, samples).
    """
    states = np.empty((len(held), model.start.size))
    state = model.start
    for k, torque in enumerate(held):
        states[k] = state
        state = model.transition[k] @ state + model.input[k] @ torque + model.offset[k]
    errors = (
        np.einsum("kij,kj->ki", model.error_state, states)
        + np.einsum("kij,kj->ki", model.error_input, held)
        + model.error_offset
    )
    return states, errors


def rms(errors: _Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(errors))))


class Programme:
    """The quadratic programme of one manoeuvre; its linear term alone changes between solutions.

    The unknowns are, instant by instant, the scaled state and r as fractions of the torque limits.
    Scales matter: with states of order a hundred the solver takes thirty iterations even where the
    wheels are saturated throughout; with states of order one it fails there.

    Parameters
    ----------
    model
        In closed loop if there is feedback, see :func:`closed_loop`.
    limits
        Torque limits, N m, shape (2,).
    feedback
        F at the instants, shape (2, n); none: u = r.
    smoothing
        Tip error (m) that a change of r by the whole limit from one interval to the next is worth,
        for each wheel, shape (2,); zero: r may jump.
    effort
        Tip error (m) that a wheel's full torque is worth; where nothing else tells them, torques
        are zero.
    authority
        Share of the torque limits that the programme may use: what is left is for whoever flies
        the plan and has gone astray.
    unit, scale
        Unit of the tip error and scale of the states, as fractions of what happens with r = 0.
    """

    def __init__(
        self,
        model: drm_env.Transitions,
        limits: _Array,
        *,
        feedback: _Array | None = None,
        smoothing: _Array | None = None,
        effort: float = 0.0,
        authority: float = 1.0,
        unit: float = 1.0,
        scale: float = 1e-2,
    ) -> None:
        count, size = len(model.offset), model.start.size
        states, errors = propagate(model, np.zeros((count, 2)))
        self.limits, self.size = limits, size
        # The linear arm with a heavy payload is unstable while it extends: left alone it may go to
        # astronomical numbers.
        self.unit = max(min(rms(errors), _LARGEST_ERROR) * unit, 1e-6)
        largest = np.clip(np.abs(states).max(axis=0), _SMALLEST_STATE, _LARGEST_STATE)
        self.scale = largest * scale
        self._rows = (
            np.concatenate([model.error_state * self.scale, model.error_input * limits], axis=2)
            / self.unit
        )
        self._samples = model.error_offset.shape[1]
        weight = np.zeros(2) if smoothing is None else 2.0 * np.square(smoothing / self.unit)
        law = np.zeros((2, size)) if feedback is None else feedback
        self._fractions = np.concatenate(
            [law * self.scale / self.limits[:, None], np.eye(2)], axis=1
        )
        self._cost = self._hessian(count, weight, (effort / self.unit) ** 2)
        self._constraints = self._equations(model)
        driven = np.concatenate([model.start[None], model.offset[:-1]]) / self.scale
        self._sides = np.concatenate([driven.ravel(), np.full(4 * count, authority)])
        self._cones = [clarabel.ZeroConeT(count * size), clarabel.NonnegativeConeT(4 * count)]

    def _hessian(self, count: int, smoothing: _Array, effort: float) -> sparse.csc_matrix:
        size, width = self.size, self.size + 2
        blocks = 2.0 / self._samples * np.einsum("kia,kib->kab", self._rows, self._rows)
        blocks += 2.0 * effort * self._fractions.T @ self._fractions
        wheels = range(size, width)
        blocks[:, wheels, wheels] += 2.0 * _EFFORT
        blocks[:-1, wheels, wheels] += smoothing
        blocks[1:, wheels, wheels] += smoothing
        upper = np.triu_indices(width)
        first = (np.arange(count) * width)[:, None]
        now = (first[:-1] + np.arange(size, width)).ravel()
        return sparse.csc_matrix(
            (
                np.concatenate(
                    [blocks[:, upper[0], upper[1]].ravel(), np.tile(-smoothing, count - 1)]
                ),
                (
                    np.concatenate([(first + upper[0]).ravel(), now]),
                    np.concatenate([(first + upper[1]).ravel(), now + width]),
                ),
            ),
            shape=(count * width, count * width),
        )

    def _equations(self, model: drm_env.Transitions) -> sparse.csc_matrix:
        count, size, width = len(model.offset), self.size, self.size + 2
        first = (np.arange(count) * width)[:, None]
        step = np.concatenate(
            [
                model.transition * self.scale / self.scale[:, None],
                model.input * self.limits / self.scale[:, None],
            ],
            axis=2,
        )[:-1]
        rows, columns = np.broadcast_arrays(
            np.arange(size, count * size).reshape(count - 1, size, 1),
            first[:-1, :, None] + np.arange(width),
        )
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
        wheels = sparse.kron(sparse.eye_array(count), self._fractions, format="csc")
        return sparse.csc_matrix(sparse.vstack([motion, wheels, -wheels]))

    def solve(self, error_offset: _Array) -> tuple[_Array, _Array, bool]:
        """Return r (N m), the states at the instants, and whether the solver reached its tolerance.

        ``error_offset`` has the shape of the model's.
        """
        linear = 2.0 / self._samples * np.einsum("kia,ki->ka", self._rows, error_offset / self.unit)
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.max_iter = 100
        solution = clarabel.DefaultSolver(
            self._cost, linear.ravel(), self._constraints, self._sides, self._cones, settings
        ).solve()
        values = np.asarray(solution.x).reshape(len(error_offset), -1)
        good = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
        return (
            values[:, self.size :] * self.limits,
            values[:, : self.size] * self.scale,
            solution.status in good,
        )
