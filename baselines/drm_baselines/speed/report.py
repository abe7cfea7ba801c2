"""The benchmark's results as tables for the terminal, CSV, JSON and Markdown."""

from __future__ import annotations

import contextlib
import csv
import importlib.metadata
import platform
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drm_baselines.speed.measure import Spread
from drm_baselines.speed.results import (
    Bench,
    Row,
    Section,
    cores,
)
from drm_baselines.support import provenance, storage
from drm_baselines.support.extras import needing
from drm_baselines.support.format import significant
from drm_baselines.support.markers import marked_range

with needing("a table", "cli"):
    from rich.table import Table

_CPU_INFO = Path("/proc/cpuinfo")


def spread_text(spread: Spread) -> str:
    """Return ``median [low, high]``, or the median alone where nothing spreads."""
    if spread.low == spread.high:
        return significant(spread.median)
    return f"{significant(spread.median)} [{significant(spread.low)}, {significant(spread.high)}]"


def cells(row: Row) -> tuple[str, str, str, str, str]:
    """Return a row as it is printed: what, value, unit, ratio, relative to."""
    ratio = "" if row.ratio is None else spread_text(row.ratio)
    return row.what, spread_text(row.value), row.unit, ratio, row.relative_to


def terminal_table(section: Section) -> Table:
    """Return one section as a table, its notes below."""
    table = Table(title=section.title, title_justify="left", header_style="bold")
    table.add_column("what")
    table.add_column("measured", justify="right")
    table.add_column("unit")
    table.add_column("ratio", justify="right")
    table.add_column("relative to")
    for row in section.rows:
        table.add_row(*cells(row))
    table.caption = "\n".join(section.notes)
    table.caption_justify = "left"
    return table


def ratio_table(sections: Sequence[Section]) -> Table:
    """Return all ratios of all sections as one table."""
    table = Table(title="All ratios", title_justify="left", header_style="bold")
    table.add_column("section")
    table.add_column("what")
    table.add_column("ratio", justify="right")
    table.add_column("relative to")
    for section in sections:
        for row in section.rows:
            if row.ratio is not None:
                what, _, _, ratio, partner = cells(row)
                table.add_row(section.name, what, ratio, partner)
    return table


def processor() -> str:
    """Return the name of the processor as the system gives it."""
    try:
        match = re.search(r"^model name\s*:\s*(.+)$", _CPU_INFO.read_text("utf-8"), re.MULTILINE)
    except OSError:
        match = None
    return match[1].strip() if match else platform.processor() or platform.machine()


def data(sections: Sequence[Section], bench: Bench) -> dict[str, Any]:
    """Return everything for JSON; headline figures of the sections are at the top level."""
    content: dict[str, Any] = {}
    for section in sections:
        content.update(section.headline)
    content["repeats"] = bench.repeats
    content["processor"] = processor()
    content["cores"] = cores()
    content["provenance"] = provenance.provenance()
    for name in ("numba", "psutil"):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            content["provenance"]["versions"][name] = importlib.metadata.version(name)
    content["sections"] = {section.name: section.data() for section in sections}
    return content


def write_csv(path: Path, sections: Sequence[Section], *, overwrite: bool = False) -> Path:
    """Write all rows as CSV; return ``path``."""
    names = ["section", "what", "median", "low", "high", "unit"]
    names += ["ratio", "ratio_low", "ratio_high", "relative_to"]
    with (
        storage.atomic_path(path, overwrite=overwrite) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(names)
        for section in sections:
            for row in section.rows:
                value, ratio = row.value, row.ratio
                ratios = ("", "", "") if ratio is None else (ratio.median, ratio.low, ratio.high)
                start = (section.name, row.what, value.median, value.low, value.high, row.unit)
                writer.writerow((*start, *ratios, row.relative_to))
    return path


def marker(name: str, edge: str) -> str:
    """Return the comment at the beginning or end of a section in a Markdown file."""
    return f"<!-- drm bench: {edge} {name} -->"


def markdown_block(section: Section, bench: Bench) -> str:
    """Return a section as Markdown between its markers."""
    lines = [
        "| what | measured | unit | ratio | relative to |",
        "|---|---:|---|---:|---|",
        *("| " + " | ".join(text.replace("|", "\\|") for text in cells(row)) + " |"
          for row in section.rows),
        "",
        *(f"- {note}" for note in section.notes),
        f"- Median [smallest, largest] of {bench.repeats} runs; {processor()}, {cores()} core(s), "
        f"{platform.system()}. Counts and memory are taken as the rows say.",
    ]  # fmt: skip
    if not section.rows:
        lines = lines[3:]
    return "\n".join((marker(section.name, "begin"), *lines, marker(section.name, "end")))


def _place(text: str, name: str) -> tuple[int, int] | None:
    begin, end = (marker(name, edge) for edge in ("begin", "end"))
    return marked_range(text, begin, end, where=f"markers of section {name}")


def with_sections(text: str, sections: Sequence[Section], bench: Bench) -> str:
    """Return a Markdown text with the sections between their markers.

    A section without markers in ``text`` is added at the end under a heading of its own; everything
    else stays as it is.

    Raises
    ------
    BaselineError
        A marker without its partner, twice, or in the wrong order.
    """
    for section in sections:
        block = markdown_block(section, bench)
        place = _place(text, section.name)
        if place is None:
            above = text.rstrip("\n")
            text = (f"{above}\n\n" if above else "") + f"## {section.title}\n\n{block}\n"
        else:
            text = text[: place[0]] + block + text[place[1] :]
    return text


def check_markdown(path: Path, names: Sequence[str]) -> None:
    """Refuse a Markdown file whose markers are damaged, before anything is measured.

    Raises
    ------
    BaselineError
        Damaged markers of one of the sections ``names``.
    """
    if path.exists():
        text = path.read_text(encoding="utf-8")
        for name in names:
            _place(text, name)


def update_markdown(path: Path, sections: Sequence[Section], bench: Bench) -> Path:
    """Write the sections into a Markdown file, new or existing; return ``path``.

    Raises
    ------
    BaselineError
        Damaged markers; the file is as it was.
    """
    old = path.read_text(encoding="utf-8") if path.exists() else ""
    return storage.write_text(path, with_sections(old, sections, bench), overwrite=True)
