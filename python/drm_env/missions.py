"""What has been of the legs of a mission."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from drm_env import _engine

__all__ = ["LegRecord"]

_TERMS = tuple(name.removeprefix("reward/") for name in _engine.reward_names())
_METRICS = tuple(_engine.metric_names())


class LegRecord(NamedTuple):
    """One leg of a mission that has been flown, or is being flown.

    Attributes
    ----------
    leg
        its place in the mission's list of legs.
    kind
        ``"slew"``, ``"hold"``, ``"wait_for_rest"`` or ``"desaturate"``. What takes no time
        (``"grapple"`` and ``"release"``) happens at the beginning of the leg that follows.
    start
        beginning, s after that of the mission.
    angle
        reference of the slew angle at the beginning, rad; those within the leg count from it.
    planned_mass
        payload mass that the leg was planned for, kg: the reported or the identified one.
    momentum, energy
        angular momentum about the shoulder (N m s) and energy (J) that a payload brought at the
        beginning, negative where it took them away; and what brakes took that closed on an arm that
        turned.
    reward
        sums of the reward's terms by name; zeros where nothing is paid.
    metrics
        metrics of the leg by name, see `episode_metrics`.
    """

    leg: int
    kind: str
    start: float
    angle: float
    planned_mass: float
    momentum: float
    energy: float
    reward: dict[str, float]
    metrics: dict[str, float]


def leg_records(rows: Sequence[Any]) -> tuple[LegRecord, ...]:
    """Legs as the engine tells them."""
    return tuple(
        LegRecord(
            leg,
            kind,
            start,
            angle,
            planned_mass,
            momentum,
            energy,
            dict(zip(_TERMS, terms, strict=True)),
            dict(zip(_METRICS, metrics, strict=True)),
        )
        for leg, kind, start, angle, planned_mass, (momentum, energy), terms, metrics in rows
    )


def mission_keys(legs: Sequence[int]) -> tuple[str, ...]:
    """Keys of an info that only missions have; ``legs`` are the places of those that take time."""
    if not legs:
        return ()
    terms = (f"leg/{leg}/{term}" for leg in legs for term in _TERMS)
    return ("mission/leg", *terms)
