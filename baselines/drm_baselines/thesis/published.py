"""What the thesis publishes, read from ``published.json``."""

from __future__ import annotations

import functools
import importlib.resources
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drm_baselines.thesis.results import Row, judged


@dataclass(frozen=True)
class Group:
    """Values of a table that are computed in one way.

    Exactly one of the tolerances is set: in percent of the published value, or in its unit.

    Attributes
    ----------
    unit
        Unit of its values, if not that of the table.
    exceptions
        By value: the known ``reason`` why it is not met, or ``exchanged`` where the thesis prints
        it in the row of another group.
    """

    name: str
    status: str
    recipe: str
    values: Mapping[str, float]
    tolerance_percent: float | None = None
    tolerance: float | None = None
    unit: str | None = None
    exceptions: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def exchanged(self, key: str) -> bool:
        """Whether the thesis prints this value in the other row."""
        return bool(self.exceptions.get(key, {}).get("exchanged", False))

    def row(self, key: str, unit: str, ours: float, *, label: str) -> Row:
        """Return the row of the value ``key`` with its verdict."""
        published = float(self.values[key])
        share = self.tolerance_percent
        allowed = (self.tolerance or 0.0) if share is None else abs(published) * share / 100.0
        known = self.exceptions.get(key, {})
        met = abs(ours - published) <= allowed
        reason = str(known.get("reason", ""))
        if met and not self.exchanged(key):
            reason = self.recipe if self.status != "reproduced" else ""
        elif not met and not reason:
            reason = f"outside {share:g} %" if share is not None else f"outside {allowed:g}"
        status = str(known.get("status", self.status))
        return judged(
            label, self.unit or unit, published, ours, met=met, status=status, reason=reason
        )


@dataclass(frozen=True)
class Table:
    """A published table."""

    name: str
    title: str
    section: str
    unit: str
    groups: tuple[Group, ...]

    def group(self, name: str) -> Group:
        """Return the group ``name``."""
        return next(group for group in self.groups if group.name == name)


@dataclass(frozen=True)
class Statement:
    """A number or words of the text, with the interval of our value that agrees.

    Attributes
    ----------
    entry
        The figure it belongs to.
    low, high
        Ends of the interval; None is open.
    """

    entry: str
    quantity: str
    unit: str
    published: float | str
    low: float | None
    high: float | None
    status: str
    reason: str = ""

    def row(self, ours: float) -> Row:
        """Return the row with the verdict for our value."""
        met = (self.low is None or ours >= self.low) and (self.high is None or ours <= self.high)
        return judged(
            self.quantity,
            self.unit,
            self.published,
            ours,
            met=met,
            status=self.status,
            reason=self.reason,
        )


@functools.cache
def _content() -> dict[str, Any]:
    text = importlib.resources.files(__package__).joinpath("published.json").read_text("utf-8")
    content: dict[str, Any] = json.loads(text)
    return content


@functools.cache
def tables() -> dict[str, Table]:
    """Return the published tables by name."""
    return {
        name: Table(
            name=name,
            title=entry["title"],
            section=entry["section"],
            unit=entry.get("unit", ""),
            groups=tuple(Group(**group) for group in entry["groups"]),
        )
        for name, entry in _content()["tables"].items()
    }


@functools.cache
def statements() -> dict[str, Statement]:
    """Return the statements of the text by name."""
    return {name: Statement(**entry) for name, entry in _content()["statements"].items()}
