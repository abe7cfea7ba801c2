"""The linear model of a manoeuvre for any mass of its payload, measured for few of them.

A flight looks at its model for one mass after the other, each nearer to the true one. The models
of masses that lie near one another follow from those that were measured: a parabola through three
of them is as good as a mass that is known to some 1e-4.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import drm_env

_Array = NDArray[np.float64]

FAR, NEAR, APART = 0.03, 0.01, 0.01
"""How far from all measured masses one is measured together with a neighbour, which is ``APART``
from it and tells the slope there, and how far it is measured alone, as fractions."""


class MassModel(NamedTuple):
    """The model for a mass, and how it changes with the mass.

    Attributes
    ----------
    models
        As they were asked for.
    slopes
        Derivatives with respect to the relative change of the mass.
    """

    models: tuple[drm_env.Transitions, ...]
    slopes: tuple[drm_env.Transitions, ...]


class MassModels:
    """Models of a manoeuvre by the mass of its payload.

    Parameters
    ----------
    measure
        Returns the models for a mass (kg), one for each time between instants.
    """

    def __init__(self, measure: Callable[[float], tuple[drm_env.Transitions, ...]]) -> None:
        self._measure = measure
        self._known: list[tuple[float, tuple[drm_env.Transitions, ...]]] = []

    @property
    def measured(self) -> int:
        """Number of masses that were measured."""
        return len(self._known)

    def at(self, mass: float) -> MassModel:
        """Return models and slopes for a mass, kg."""
        if mass == 0.0:
            # no relative change of it is a change
            models = self._measure(mass)
            return MassModel(models, tuple(_mixed([one], [0.0]) for one in models))
        away = min((abs(mass - known) for known, _ in self._known), default=math.inf)
        if away > NEAR * mass:
            self._add(mass)
        if away > FAR * mass:
            self._add((1.0 + APART) * mass)
        nearest = sorted(self._known, key=lambda each: abs(each[0] - mass))[:3]
        values, slopes = weights([known for known, _ in nearest], mass)
        columns = list(zip(*(models for _, models in nearest), strict=True))
        return MassModel(
            tuple(_mixed(column, values) for column in columns),
            tuple(_mixed(column, [mass * each for each in slopes]) for column in columns),
        )

    def _add(self, mass: float) -> None:
        self._known.append((mass, self._measure(mass)))


def weights(places: Sequence[float], at: float) -> tuple[list[float], list[float]]:
    """Return what values at some places count for value and slope of their polynomial elsewhere."""
    values, slopes = [], []
    for index, own in enumerate(places):
        others = [place for other, place in enumerate(places) if other != index]
        scale = float(np.prod([own - other for other in others]))
        values.append(float(np.prod([at - other for other in others])) / scale)
        parts = [
            np.prod([at - other for place, other in enumerate(others) if place != left])
            for left in range(len(others))
        ]
        slopes.append(float(np.sum(parts)) / scale)
    return values, slopes


def merged(model: drm_env.Transitions, count: int) -> drm_env.Transitions:
    """Return the model with ``count`` of its intervals as one, torques being held through it."""
    size = model.start.size
    state = np.eye(size)
    torque, drift = np.zeros((size, 2)), np.zeros((size, 1))
    rows: list[tuple[_Array, _Array, _Array]] = []
    for place in range(count):
        step, given, offset, seen, direct, level = (part[place::count] for part in model[1:])
        rows.append((seen @ state, seen @ torque + direct, (seen @ drift)[..., 0] + level))
        state = step @ state
        torque = step @ torque + given
        drift = step @ drift + offset[..., None]
    return drm_env.Transitions(
        model.start,
        state,
        torque,
        drift[..., 0],
        *(np.concatenate(parts, axis=1) for parts in zip(*rows, strict=True)),
    )


def rest_of(model: drm_env.Transitions) -> int:
    """Return the first interval from which on the model stays as it is."""
    moving = 0
    for part in (model.transition, model.offset):
        away = np.abs(part - part[-1]).reshape(len(part), -1).max(axis=1)
        moved = np.flatnonzero(away > 1e-9 * np.abs(part).max())
        moving = max([moving, *(moved[-1:] + 1)])
    return moving


def prolonged(model: drm_env.Transitions, count: int) -> drm_env.Transitions:
    """Return the model with ``count`` intervals, the last of which are as its last one."""
    more = count - len(model.offset)
    return drm_env.Transitions(
        model.start,
        *(np.concatenate([part, np.repeat(part[-1:], more, axis=0)]) for part in model[1:]),
    )


def _mixed(models: Sequence[drm_env.Transitions], shares: Sequence[float]) -> drm_env.Transitions:
    """Return the sum of models with these shares."""
    return drm_env.Transitions(
        *(
            functools.reduce(
                np.add, [share * part for share, part in zip(shares, parts, strict=True)]
            )
            for parts in zip(*models, strict=True)
        )
    )
