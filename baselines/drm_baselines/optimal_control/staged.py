"""The programme of a manoeuvre in stages, as it is solved again and again under way.

It is the programme of :mod:`drm_baselines.optimal_control.quadratic_program` without a law
underneath. What depends on the model alone is worked out once and serves all plans; PIQP's
multistage method factorises the programme stage by stage and needs a third of the time of a method
that knows of no stages.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import piqp
from numpy.typing import NDArray
from scipy import sparse

import drm_env
from drm_env.constants import LINK_END_DEFLECTION

_Array = NDArray[np.float64]

_SIZE = 6  # entries of the thesis plant's state
_WIDTH = 8  # with both torques

# Sizes of the state's entries for the solver: rad, m, m and their rates.
_SCALE = np.array([5e-3, 5e-4, 5e-4, 5e-3, 1.5e-2, 1.5e-2])
_ONE = np.array([*_SCALE, 1.0, 1.0])
# The solver converges where the unit of the tip error is some ten times what the error will be.
_UNIT_OF_ERROR = 12.0
_UNITS = (0.03, 30.0)  # m, least and greatest
_OTHER_UNITS = (1.0, 30.0, 1.0 / 30.0, 1000.0)
_TOO_COARSE = 10.0
# Torques that do not matter are zero; squared, in units of the objective.
_EFFORT = 1e-8
_ITERATIONS = 40


@dataclass(frozen=True, kw_only=True)
class Stages:
    """A manoeuvre of the thesis plant, interval by interval; z is the state and both torques.

    Torques are fractions of the limits. With N intervals:

    Attributes
    ----------
    motion, offset
        The next state is ``motion @ z + offset``: shapes (N, 6, 8) and (N, 6).
    weight, slope, level
        The tip's mean squared error in the interval (m^2) is
        ``z @ weight @ z + 2 * slope @ z + level``: shapes (N, 8, 8), (N, 8) and (N,).
    """

    motion: _Array
    offset: _Array
    weight: _Array
    slope: _Array
    level: _Array

    def __len__(self) -> int:
        """Return the number of intervals."""
        return len(self.offset)

    def after(self, count: int) -> Stages:
        """Return what is left after ``count`` intervals."""
        return Stages(
            motion=self.motion[count:],
            offset=self.offset[count:],
            weight=self.weight[count:],
            slope=self.slope[count:],
            level=self.level[count:],
        )

    def errors(self, z: _Array) -> _Array:
        """Return the tip's mean squared error in each interval, m^2, shape (N,)."""
        return np.asarray(
            (z * ((self.weight @ z[:, :, None])[:, :, 0] + 2.0 * self.slope)).sum(axis=1)
            + self.level
        )


def stages_of(model: drm_env.Transitions, limits: _Array, sway: float) -> Stages:
    """Return the stages of a model of the thesis plant, whose ``start`` is not looked at.

    Parameters
    ----------
    model
        See there.
    limits
        Torque limits, N m, shape (2,).
    sway
        Tip error (m) that a rate of the tip's deflection of 1 m/s at an instant is worth, s: the
        slew angle can hide a vibration from the tip.
    """
    rows = np.concatenate([model.error_state, model.error_input * limits], axis=2)
    samples = rows.shape[1]
    across = rows.transpose(0, 2, 1)
    weight = across @ rows / samples
    weight[:, 4:_SIZE, 4:_SIZE] += (LINK_END_DEFLECTION * sway) ** 2
    return Stages(
        motion=np.concatenate([model.transition, model.input * limits], axis=2),
        offset=model.offset,
        weight=weight,
        slope=(across @ model.error_offset[:, :, None])[:, :, 0] / samples,
        level=np.square(model.error_offset).mean(axis=1),
    )


def plan(
    stages: Stages, start: _Array, *, smoothing: float, authority: float, error: float = 0.0
) -> _Array | None:
    """Return the z with the least tip error, shape (N, 8), or None if it was not found.

    Parameters
    ----------
    stages
        What is left of the manoeuvre.
    start
        State at its beginning, shape (6,).
    smoothing
        Tip error (m) that a change of a wheel's torque by its limit from one interval to the next
        is worth.
    authority
        Share of the torque limits that may be used.
    error
        RMS of the tip error (m) that is expected, for the solver's scaling: it may be wrong, which
        takes time.
    """
    guess = _unit(error)
    for unit in dict.fromkeys(_within(guess * factor) for factor in _OTHER_UNITS):
        found = _solve(stages, start, smoothing, authority, unit)
        if found is None:
            continue
        right = _unit(float(np.sqrt(max(stages.errors(found).mean(), 0.0))))
        if unit > _TOO_COARSE * right:
            # solved to a tolerance that is too coarse for so small an error
            finer = _solve(stages, start, smoothing, authority, right)
            return found if finer is None else finer
        return found
    return None


def _within(unit: float) -> float:
    return min(max(unit, _UNITS[0]), _UNITS[1])


def _unit(error: float) -> float:
    """Return the unit of the tip error (m) for the error that comes out."""
    return _within(_UNIT_OF_ERROR * error)


def _solve(
    stages: Stages, start: _Array, smoothing: float, authority: float, unit: float
) -> _Array | None:
    count = len(stages)
    bounds = np.full((count, _WIDTH), np.inf)
    bounds[:, _SIZE:] = authority
    driven = np.concatenate([start[None], stages.offset[:-1]]) / _SCALE
    solver = piqp.SparseSolver()
    settings = solver.settings
    settings.kkt_solver = piqp.sparse_multistage
    settings.max_iter = _ITERATIONS
    # the scales are right as they are
    settings.preconditioner_iter = 1
    settings.eps_abs = settings.eps_rel = 1e-6
    settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = 1e-6, 1e-4
    solver.setup(
        _cost(stages, smoothing, unit),
        (2.0 / unit**2 * stages.slope * _ONE).ravel(),
        _motion(stages),
        driven.ravel(),
        None,
        None,
        None,
        -bounds.ravel(),
        bounds.ravel(),
    )
    if solver.solve() != piqp.PIQP_SOLVED:
        return None
    found: _Array = np.asarray(solver.result.x).reshape(count, _WIDTH) * _ONE
    return found


def _cost_places() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of a stage's part of the cost, column by column to the diagonal.

    A row of -1 is the product of a torque with the same one a stage earlier.
    """
    places = [
        (row, column)
        for column in range(_WIDTH)
        for row in [*([-1] if column >= _SIZE else []), *range(column + 1)]
    ]
    rows, columns = np.array(places).T
    return rows, columns


_ROWS, _COLUMNS = _cost_places()
_EARLIER = _ROWS < 0
_TORQUES = (_ROWS == _COLUMNS) & (_COLUMNS >= _SIZE)


def _cost(stages: Stages, smoothing: float, unit: float) -> sparse.csc_matrix:
    """Return the upper triangle of the quadratic cost."""
    count, change = len(stages), 2.0 * (smoothing / unit) ** 2
    values = np.empty((count, len(_ROWS)))
    within = ~_EARLIER
    scale = 2.0 / unit**2 * _ONE[_ROWS[within]] * _ONE[_COLUMNS[within]]
    values[:, within] = stages.weight[:, _ROWS[within], _COLUMNS[within]] * scale
    values[:, _EARLIER] = -change
    values[:, _TORQUES] += 2.0 * _EFFORT
    values[1:, _TORQUES] += change
    values[:-1, _TORQUES] += change
    first = _WIDTH * np.arange(count)[:, None]
    there = np.ones(values.shape, dtype=np.bool_)
    there[0] = within
    return _by_columns(
        values[there],
        np.where(_EARLIER, first - _WIDTH + _COLUMNS, first + _ROWS)[there],
        np.bincount((first + _COLUMNS)[there], minlength=_WIDTH * count),
        _WIDTH * count,
    )


def _motion(stages: Stages) -> sparse.csc_matrix:
    """Return the equations of motion: each state less what the stage before makes of it."""
    count = len(stages)
    values = np.empty((count, _WIDTH, 1 + _SIZE))
    values[:, :, 0] = 1.0
    values[:, :, 1:] = -(stages.motion * _ONE / _SCALE[:, None]).transpose(0, 2, 1)
    rows = np.empty(values.shape, dtype=np.int64)
    first = _SIZE * np.arange(count)[:, None]
    rows[:, :, 0] = first + np.arange(_WIDTH)
    rows[:, :, 1:] = (first + np.arange(_SIZE, 2 * _SIZE))[:, None, :]
    there = np.ones(values.shape, dtype=np.bool_)
    there[:, _SIZE:, 0] = False
    there[-1, :, 1:] = False
    return _by_columns(values[there], rows[there], there.sum(axis=2).ravel(), _SIZE * count)


def _by_columns(
    values: _Array, rows: NDArray[np.int64], lengths: NDArray[np.int64], height: int
) -> sparse.csc_matrix:
    starts = np.concatenate([[0], np.cumsum(lengths)])
    return sparse.csc_matrix((values, rows, starts), shape=(height, len(lengths)))


def feedback(stages: Stages, saturated: NDArray[np.int8], effort: float) -> _Array:
    """Return the gains of the deviation from a plan, fractions of the limits, shape (N, 2, 6).

    It is the regulator of :func:`drm_baselines.optimal_control.tvlqr.feedback_around` without a law
    underneath.

    Parameters
    ----------
    stages
        What the plan was made for.
    saturated
        Where it is at its limits, shape (N, 2): there a torque stays whatever the deviation.
    effort
        Tip error (m) that a deviation of a torque by the whole limit is worth.
    """
    gains = np.zeros((len(stages), 2, _SIZE))
    weight = stages.weight.copy()
    weight[:, [6, 7], [6, 7]] += effort**2
    free = (saturated == 0).tolist()
    value = np.zeros((_SIZE, _SIZE))
    for k in range(len(stages) - 1, -1, -1):
        motion, gain = stages.motion[k], gains[k]
        total = motion.T @ (value @ motion) + weight[k]
        across = total[_SIZE:, :_SIZE]
        root, tip = free[k]
        if root and tip:
            (a, b), (_, c) = total[_SIZE:, _SIZE:].tolist()
            scale = 1.0 / (b * b - a * c)
            gain[:] = np.array(((c * scale, -b * scale), (-b * scale, a * scale))) @ across
        elif root:
            gain[0] = across[0] / -total[6, 6]
        elif tip:
            gain[1] = across[1] / -total[7, 7]
        value = total[:_SIZE, :_SIZE]
        if root or tip:
            value = value + across.T @ gain
        value = 0.5 * (value + value.T)
    return gains
