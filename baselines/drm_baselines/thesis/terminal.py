"""Results as tables for the terminal, whose console takes every string as plain text."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from drm_baselines.thesis.catalogue import entries
from drm_baselines.thesis.results import Entry, Grid, Outcome, Verdict
from drm_baselines.thesis.writing import Results, counts, percent, shown

_COLOURS = {
    Verdict.REPRODUCED: "green",
    Verdict.INFERRED: "yellow",
    Verdict.NOT_REPRODUCED: "red",
    Verdict.UNPUBLISHED: "dim",
}


def _verdict(verdict: Verdict, text: str) -> Text:
    return Text(text, style=_COLOURS[verdict])


def list_table() -> Table:
    """Return the names of all entries with their titles."""
    table = Table(header_style="bold")
    table.add_column("name", no_wrap=True)
    table.add_column("section", no_wrap=True)
    table.add_column("title")
    for entry in entries().values():
        table.add_row(entry.name, entry.section, entry.title)
    return table


def rows_table(entry: Entry, outcome: Outcome) -> Table:
    """Return the rows of one entry, or its grid if it has one."""
    if outcome.grid is not None:
        return _grid_table(entry, outcome, outcome.grid)
    table = Table(title=f"{entry.name}: {entry.title}", title_justify="left", header_style="bold")
    for name in ("quantity", "published", "ours", "difference", "verdict", "reason"):
        numeric = name in ("published", "ours", "difference")
        table.add_column(name, justify="right" if numeric else "left", no_wrap=numeric)
    for row in outcome.rows:
        unit = f" ({row.unit})" if row.unit else ""
        table.add_row(
            row.quantity + unit,
            shown(row.published),
            shown(row.ours),
            percent(row),
            _verdict(row.verdict, row.verdict.value),
            row.reason,
        )
    table.caption = outcome.note
    table.caption_justify = "left"
    return table


def _grid_table(entry: Entry, outcome: Outcome, grid: Grid) -> Table:
    table = Table(title=f"{entry.name}: {entry.title}", title_justify="left", header_style="bold")
    for index, name in enumerate(grid.columns):
        widest = max((len(line[index]) for line in grid.lines), default=0)
        table.add_column(name, justify="right", min_width=widest)
    for line in grid.lines:
        table.add_row(*line)
    table.caption = outcome.note
    table.caption_justify = "left"
    return table


def overview_table(results: Results) -> Table:
    """Return how many rows of each entry have which verdict."""
    table = Table(title="The thesis, computed again", title_justify="left", header_style="bold")
    table.add_column("name", no_wrap=True)
    table.add_column("title")
    for verdict in Verdict:
        table.add_column("\n".join(verdict.value.split(" ", 1)), justify="right")
    for entry, outcome in results:
        found = counts([(entry, outcome)])
        cells = [_verdict(verdict, str(found[verdict] or "")) for verdict in Verdict]
        table.add_row(entry.name, entry.title, *cells)
    return table


def misses_table(results: Results) -> Table:
    """Return what is not reproduced, with the reason."""
    table = Table(title="Not reproduced", title_justify="left", header_style="bold")
    for name in ("name", "quantity", "published", "ours", "reason"):
        numeric = name in ("published", "ours")
        table.add_column(
            name, justify="right" if numeric else "left", no_wrap=numeric or name == "name"
        )
    for entry, outcome in results:
        if entry.kind == "erratum":
            continue
        for row in outcome.rows:
            if row.verdict is Verdict.NOT_REPRODUCED:
                unit = f" ({row.unit})" if row.unit else ""
                table.add_row(
                    entry.name,
                    row.quantity + unit,
                    shown(row.published),
                    shown(row.ours),
                    row.reason,
                )
    return table
