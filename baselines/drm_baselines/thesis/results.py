"""What a reproduced table or figure consists of: rows with verdicts, and perhaps a picture."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure


class Verdict(enum.StrEnum):
    """How a published figure and ours compare."""

    REPRODUCED = "reproduced"
    """Within the tolerance, by what the thesis states."""
    INFERRED = "inferred"
    """Within the tolerance after a choice that the thesis does not state; the reason names it."""
    NOT_REPRODUCED = "not reproduced"
    """Outside the tolerance."""
    UNPUBLISHED = "no published value"
    """Ours alone."""


@dataclass(frozen=True)
class Row:
    """One quantity.

    Attributes
    ----------
    quantity, unit
        What and in which unit; an empty unit is a ratio or a count.
    published
        Value or words of the thesis; None if it has none.
    ours
        Our value.
    verdict, reason
        How they compare and why, where that needs words.
    """

    quantity: str
    unit: str
    published: float | str | None
    ours: float
    verdict: Verdict
    reason: str = ""

    @property
    def difference(self) -> float | None:
        """Ours minus published, or None where no number is published."""
        return self.ours - self.published if isinstance(self.published, float) else None

    @property
    def difference_percent(self) -> float | None:
        """The difference in percent of the published value, or None."""
        if isinstance(self.published, float) and self.published != 0.0:
            return 100.0 * (self.ours / self.published - 1.0)
        return None


def ours_only(quantity: str, unit: str, value: float, reason: str = "") -> Row:
    """Return the row of a quantity that the thesis does not publish."""
    return Row(quantity, unit, None, float(value), Verdict.UNPUBLISHED, reason)


def judged(
    quantity: str,
    unit: str,
    published: float | str,
    ours: float,
    *,
    met: bool,
    status: str = Verdict.REPRODUCED,
    reason: str = "",
) -> Row:
    """Return a row whose verdict is ``status`` if the tolerance is met.

    A value that is not finite never meets it.
    """
    verdict = Verdict(status) if met and math.isfinite(ours) else Verdict.NOT_REPRODUCED
    return Row(quantity, unit, published, float(ours), verdict, reason)


@dataclass(frozen=True)
class Grid:
    """Rows of an entry laid out for reading: quantities side by side.

    Attributes
    ----------
    columns
        Headings with units.
    lines
        As many texts each as there are columns.
    """

    columns: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Outcome:
    """What computing an entry gives.

    Attributes
    ----------
    rows
        Quantities with verdicts.
    note
        What was computed, in a sentence or two.
    figure
        The picture, if the entry has one.
    grid
        Shown in place of the rows, which are then in the CSV table alone.
    """

    rows: tuple[Row, ...] = ()
    note: str = ""
    figure: Figure | None = None
    grid: Grid | None = None


@dataclass(frozen=True)
class Entry:
    """A table, figure, claim, erratum or study under the name by which it is asked for.

    Attributes
    ----------
    name
        Such as ``table-2-9``, ``figure-4.63``, ``claim-one-function``, ``erratum-tip-law`` or
        ``consistent-laws``.
    title
        One line.
    section
        Where in the thesis; empty for what it does not have.
    build
        Computes it.
    """

    name: str
    title: str
    section: str
    build: Callable[[], Outcome]

    @property
    def kind(self) -> str:
        """``table``, ``figure``, ``claim``, ``erratum`` or ``consistent``."""
        return self.name.partition("-")[0]
