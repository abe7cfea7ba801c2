"""What a page is made of. Texts are texts: the writer escapes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A cell of a table.

    Attributes
    ----------
    text, detail
        What stands there, and what stands below it in small letters.
    tone
        ``"best"``, ``"good"``, ``"middling"``, ``"bad"``, ``"plain"`` (a badge without colour), or
        nothing.
    colour, dash, marker
        Colour (``"#RRGGBB"``) of a mark in front of the text: a line of this dash (CSS px).
    order
        What the column is sorted by; by default the number that the text begins with, or the text.
    """

    text: str
    detail: str = ""
    tone: str = ""
    colour: str = ""
    dash: tuple[float, ...] = ()
    order: float | None = None


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table.

    Attributes
    ----------
    headings
        Cells of the head; their tones and orders mean nothing.
    rows
        As many cells each; texts stand for cells of nothing else.
    left
        How many columns hold texts, from the left; the others are aligned like numbers.
    tags
        By row what the page's filter chooses by; none by default.
    note
        Below the table.
    sortable
        Whether a click on a heading sorts.
    """

    kind: ClassVar[str] = "table"
    headings: Sequence[Cell]
    rows: Sequence[Sequence[Cell | str]]
    left: int = 1
    tags: Sequence[str] = ()
    note: str = ""
    sortable: bool = False


@dataclass(frozen=True, kw_only=True)
class Text:
    """Paragraphs, or with ``listed`` a list."""

    kind: ClassVar[str] = "text"
    lines: Sequence[str]
    listed: bool = False


@dataclass(frozen=True, kw_only=True)
class Verdicts:
    """A list of statements, each with a verdict (text, tone)."""

    kind: ClassVar[str] = "verdicts"
    rows: Sequence[tuple[str, str, str]]


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture that is in the page.

    Attributes
    ----------
    data
        PNG or WebP.
    title
        What it shows, also for those who cannot see it.
    """

    kind: ClassVar[str] = "picture"
    data: bytes
    title: str


@dataclass(frozen=True, kw_only=True)
class Folded:
    """Something long that is shown when asked for: a text as it is, or a table."""

    kind: ClassVar[str] = "folded"
    title: str
    text: str = ""
    table: Table | None = None


@dataclass(frozen=True, kw_only=True)
class Data:
    """What a script of the page draws.

    Attributes
    ----------
    script
        Which: ``"flights"`` or ``"episodes"``.
    content
        Plain data for it, without NaN.
    note
        Below it: what was done to the data.
    """

    kind: ClassVar[str] = "data"
    script: str
    content: Mapping[str, Any]
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A figure with its interval, of one row of `Intervals`.

    Attributes
    ----------
    label, colour
        Whose, and its colour.
    value, low, high
        In the unit of the axis; what is not finite is not drawn, but said.
    hollow
        Whether it belongs to fewer episodes than the others.
    """

    label: str
    colour: str
    value: float
    low: float
    high: float
    hollow: bool = False


@dataclass(frozen=True, kw_only=True)
class Intervals:
    """Points with intervals on a logarithmic axis, a row each."""

    kind: ClassVar[str] = "intervals"
    axis: str
    rows: Sequence[Interval]
    line: float | None = None


Block = Table | Text | Verdicts | Picture | Folded | Data | Intervals


@dataclass(frozen=True, kw_only=True)
class Section:
    """A part of a page.

    Attributes
    ----------
    name
        Its address behind ``#``, and what it is called in the index with ``brief``.
    title, subtitle
        Its heading, and what stands below in small letters.
    blocks
        What is in it.
    group
        Heading of the index under which it stands; those of a group follow each other.
    tags
        What the filter chooses by, as in `Table`.
    tone
        Of its mark in the index, as in `Cell`; nothing: no mark.
    """

    name: str
    title: str
    blocks: Sequence[Block]
    subtitle: str = ""
    brief: str = ""
    group: str = ""
    tags: Sequence[str] = ()
    tone: str = ""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """A tag that the filter offers: the tag, its label, its tone, how many rows have it."""

    tag: str
    label: str
    tone: str
    count: int


@dataclass(frozen=True, kw_only=True)
class Page:
    """A report.

    Attributes
    ----------
    title, subtitle
        Its heading and what stands below it.
    sections
        Its parts.
    facts
        Short facts below the heading: name and value.
    choices
        Tags by which sections and rows of tables can be chosen; none: no filter.
    """

    title: str
    sections: Sequence[Section]
    subtitle: str = ""
    facts: Sequence[tuple[str, str]] = ()
    choices: Sequence[Choice] = field(default_factory=tuple)
