"""What manoeuvres trade against each other: time, energy, vibration and the wheels' momentum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import drm_env


class Traded(NamedTuple):
    """Something that less of is better.

    Attributes
    ----------
    label, unit
        In pictures and tables.
    factor
        Of that unit to SI.
    """

    label: str
    unit: str
    factor: float


TRADED: dict[str, Traded] = {
    "final_time": Traded("time", "s", 1.0),
    "energy": Traded("motor energy", "J", 1.0),
    "vibration": Traded("vibration after the slew, RMS", "mm", 1e-3),
    "momentum": Traded("wheel momentum", "N m s", 1.0),
}
"""By the names of ``drm_env.SlewCandidate``."""


def _table(candidates: Sequence[drm_env.SlewCandidate]) -> NDArray[np.float64]:
    return np.array([[each.value(name) for name in TRADED] for each in candidates])


def front(candidates: Sequence[drm_env.SlewCandidate]) -> list[drm_env.SlewCandidate]:
    """Return the candidates within the limits that no other beats in all that is traded.

    They are sorted by final time.
    """
    feasible = [each for each in candidates if each.feasible]
    if not feasible:
        return []
    # rounding is no advantage
    values = _table(feasible)
    values = np.round(values / np.maximum(np.abs(values).max(axis=0), 1e-300), 9)
    kept = []
    for row, candidate in zip(values, feasible, strict=True):
        beaten = (values <= row).all(axis=1) & (values < row).any(axis=1)
        if not beaten.any():
            kept.append(candidate)
    return sorted(kept, key=lambda each: each.final_time)


def rows(plan: drm_env.SlewPlan) -> list[dict[str, Any]]:
    """Return all candidates as rows in SI units, with whether on the front and whether best."""
    best = {id(each) for each in front(plan.candidates)}
    return [
        {**each.to_dict(), "on_front": id(each) in best, "best": each is plan.best}
        for each in plan.candidates
    ]
