"""The feedback around a plan: what to do when the arm is not where it was planned to be.

Around the optimum of the convex programme the best answer to a small deviation is linear as long
as the same wheels saturate: the time-varying linear-quadratic regulator of those that do not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import drm_env

_Array = NDArray[np.float64]


def saturation(
    held: _Array, states: _Array, feedback: _Array, limits: _Array, authority: float
) -> NDArray[np.int8]:
    """Return where a plan is at its limit: the sign of the torque, or 0, shape (intervals, 2).

    Parameters
    ----------
    held, states
        The plan r (N m), shape (intervals, 2), and its states at the instants, (intervals, n).
    feedback, limits, authority
        Of the programme that made it.
    """
    fractions = (held + states @ feedback.T) / limits
    signs: NDArray[np.int8] = np.where(np.abs(fractions) > authority - 1e-3, np.sign(fractions), 0)
    return signs.astype(np.int8)


def feedback_around(
    model: drm_env.Transitions,
    limits: _Array,
    feedback: _Array,
    saturated: NDArray[np.int8],
    effort: float,
) -> _Array:
    """Return the gains of the deviation from a plan, fractions of the limits, (intervals, 2, n).

    Parameters
    ----------
    model
        In closed loop with ``feedback``, see
        :func:`drm_baselines.optimal_control.quadratic_program.closed_loop`.
    limits
        Torque limits, N m, shape (2,).
    feedback
        F at the instants, N m per entry of the state, shape (2, n).
    saturated
        From :func:`saturation`: a wheel at its limit stays there whatever the deviation.
    effort
        Tip error (m) that a deviation of r from its plan by the whole limit is worth.
    """
    count, samples, size = model.error_state.shape
    inputs, direct = model.input * limits, model.error_input * limits
    state_cost = np.einsum("kia,kib->kab", model.error_state, model.error_state) / samples
    cross_cost = np.einsum("kia,kib->kab", direct, model.error_state) / samples
    input_cost = np.einsum("kia,kib->kab", direct, direct) / samples + effort**2 * np.eye(2)
    at_limit = np.abs(saturated).astype(np.float64)
    free = 1.0 - at_limit
    both_free = free[:, :, None] * free[:, None, :]
    fixed = np.einsum("ki,ij->kij", at_limit, -feedback / limits[:, None])
    pinned = np.einsum("ki,ij->kij", at_limit, np.eye(2))

    gains = np.empty((count, 2, size))
    value = np.zeros((size, size))
    for k in range(count - 1, -1, -1):
        towards = inputs[k].T @ value
        curvature = input_cost[k] + towards @ inputs[k]
        cross = cross_cost[k] + towards @ model.transition[k]
        wanted = -free[k, :, None] * (cross + curvature @ fixed[k])
        gain = fixed[k] + np.linalg.solve(curvature * both_free[k] + pinned[k], wanted)
        mixed = gain.T @ cross
        value = (
            state_cost[k]
            + model.transition[k].T @ value @ model.transition[k]
            + gain.T @ curvature @ gain
            + mixed
            + mixed.T
        )
        value = 0.5 * (value + value.T)
        gains[k] = gain
    return gains
