"""What a section of the benchmark hands back, and what it is given."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drm_baselines.speed.measure import Measured, Spread, interleave


@dataclass(frozen=True)
class Row:
    """One line of the table: a measurement, and its ratio to another of the same run."""

    what: str
    """What was measured."""
    value: Spread
    """The measurement."""
    unit: str
    """Its unit."""
    ratio: Spread | None = None
    """Its ratio, pair by pair, to what ``relative_to`` names."""
    relative_to: str = ""
    """What the ratio is relative to; empty without a ratio."""


@dataclass(frozen=True)
class Curve:
    """A picture of values over a size."""

    name: str
    """Name of its file, without the ending."""
    title: str
    x_label: str
    y_label: str
    lines: Mapping[str, tuple[Sequence[float], Sequence[Spread]]]
    """Places and values of each line, by its label."""


@dataclass(frozen=True)
class Section:
    """The results of one section."""

    name: str
    title: str
    rows: Sequence[Row]
    notes: Sequence[str] = ()
    """How it was measured, and what could not be."""
    headline: Mapping[str, float | None] = field(default_factory=dict)
    """Medians that the JSON file holds at its top level, null if they could not be measured."""
    curves: Sequence[Curve] = ()

    def data(self) -> dict[str, Any]:
        """Return the section as plain data for JSON."""

        def spread(value: Spread | None) -> dict[str, float] | None:
            return None if value is None else vars(value).copy()

        return {
            "title": self.title,
            "rows": [
                {
                    "what": row.what,
                    "value": spread(row.value),
                    "unit": row.unit,
                    "ratio": spread(row.ratio),
                    "relative_to": row.relative_to or None,
                }
                for row in self.rows
            ],
            "notes": list(self.notes),
        }


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _silent(label: str, done: int, total: int) -> None:
    """Show nothing."""


@dataclass(frozen=True)
class Bench:
    """How the sections are to measure."""

    repeats: int = 5
    """Measurements of each candidate."""
    seconds: int = 1
    """About how long one measurement of a stepped environment lasts, s."""
    episodes: int = 10_000
    """Episodes of the ``rollout`` section."""
    long_steps: int = 1_000_000
    """Environment steps over which the ``memory`` section watches for growth."""
    progress: Callable[[str, int, int], None] = _silent
    """Called with a label, the measurements taken and their number."""

    def interleave(self, label: str, candidates: Mapping[str, Callable[[], float]]) -> Measured:
        """Measure the candidates in turn, ``repeats`` times each, and show the progress."""
        total = self.repeats * len(candidates)
        done = 0

        def advance(name: str) -> None:  # noqa: ARG001
            nonlocal done
            done += 1
            self.progress(label, done, total)

        self.progress(label, 0, total)
        return interleave(candidates, self.repeats, advance)
