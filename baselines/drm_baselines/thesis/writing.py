"""Results as files: pictures, one CSV table and one HTML page that holds everything."""

from __future__ import annotations

import base64
import contextlib
import csv
import html
import io
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from string import Template

from matplotlib.figure import Figure

from drm_baselines.errors import ExistingResultError
from drm_baselines.support import storage, workplace
from drm_baselines.thesis.results import Entry, Grid, Outcome, Row, Verdict

Results = Sequence[tuple[Entry, Outcome]]

COLUMNS = (
    "entry", "title", "section", "quantity", "unit", "published", "ours", "difference",
    "difference_percent", "verdict", "reason",
)  # fmt: skip
"""Columns of the CSV table."""

_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 62rem; padding: 0 1rem;
       color: #222; background: #fff; }
h2 { margin-top: 2.5rem; border-bottom: 1px solid #ccc; }
h3 { margin: 2rem 0 .2rem; }
p.where { color: #666; margin: 0 0 .5rem; }
table { border-collapse: collapse; font-size: 13px; margin: .5rem 0; width: 100%; }
th, td { border: 1px solid #ddd; padding: .15rem .45rem; text-align: left; vertical-align: top; }
td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
img { max-width: 100%; height: auto; }
.reproduced { background: #e3f4e8; } .inferred { background: #fdf3d8; }
.not-reproduced { background: #fbe0dc; } .no-published-value { background: #f2f2f2; }
nav a { margin-right: .8rem; white-space: nowrap; }
</style>
</head>
<body>
<h1>$title</h1>
<p>$summary</p>
<nav>$contents</nav>
$sections
</body>
</html>
""")


def shown(value: float | str | None, digits: int = 6) -> str:
    """Return a value as text; nothing for None."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    return f"{value:.{digits}g}" if math.isfinite(value) else str(value)


def percent(row: Row) -> str:
    """Return the difference of a row in percent, or in its unit where percent means nothing."""
    if row.difference_percent is not None and row.unit != "%":
        return f"{row.difference_percent:+.2f} %"
    return "" if row.difference is None else f"{row.difference:+.3g}"


def picture(figure: Figure) -> bytes:
    """Return a figure as PNG; the same figure gives the same bytes."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=100, metadata={"Software": None})
    return stream.getvalue()


def table_text(results: Results) -> str:
    """Return all rows as CSV, full precision."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for entry, outcome in results:
        for row in outcome.rows:
            writer.writerow(
                (
                    entry.name, entry.title, entry.section, row.quantity, row.unit,
                    shown(row.published, 12), shown(row.ours, 12), shown(row.difference, 6),
                    shown(row.difference_percent, 6), row.verdict.value, row.reason,
                )
            )  # fmt: skip
    return stream.getvalue()


def counts(results: Results) -> Counter[Verdict]:
    """Return how many rows have each verdict.

    Errata show the wrong beside the right, and studies are not of the thesis; they count only
    where there is nothing else.
    """
    published = ("table", "figure", "claim")
    chosen = [item for item in results if item[0].kind in published] or list(results)
    return Counter(row.verdict for _, outcome in chosen for row in outcome.rows)


def summary(results: Results) -> str:
    """Return the counts in a sentence."""
    found = counts(results)
    parts = [f"{found[verdict]} {verdict.value}" for verdict in Verdict if found[verdict]]
    return f"{sum(found.values())} quantities: {', '.join(parts)}."


def _html_grid(grid: Grid) -> str:
    head = "".join(f"<th>{html.escape(name)}</th>" for name in grid.columns)
    lines = [
        "".join(f'<td class="n">{html.escape(text)}</td>' for text in line) for line in grid.lines
    ]
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _html_rows(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    lines = []
    for row in rows:
        cells = [
            f"<td>{html.escape(row.quantity)}</td>",
            f"<td>{html.escape(row.unit)}</td>",
            *(
                f'<td class="n">{html.escape(text)}</td>'
                for text in (shown(row.published), shown(row.ours), percent(row))
            ),
            f'<td class="{row.verdict.value.replace(" ", "-")}">{row.verdict.value}</td>',
            f"<td>{html.escape(row.reason)}</td>",
        ]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    heads = ("quantity", "unit", "published", "ours", "difference", "verdict", "reason")
    head = "".join(f"<th>{name}</th>" for name in heads)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def page_text(results: Results, pictures: dict[str, bytes]) -> str:
    """Return one page with all rows and pictures, which needs no other file."""
    sections, contents = [], []
    kinds = (
        ("table", "Tables"),
        ("figure", "Figures"),
        ("claim", "Claims of the text"),
        ("erratum", "Errata"),
        ("consistent", "The consistent plant"),
    )
    for kind, heading in kinds:
        chosen = [(entry, outcome) for entry, outcome in results if entry.kind == kind]
        if not chosen:
            continue
        sections.append(f"<h2>{heading}</h2>")
        for entry, outcome in chosen:
            contents.append(f'<a href="#{entry.name}">{entry.name}</a>')
            sections.append(
                f'<h3 id="{entry.name}">{entry.name}: {html.escape(entry.title)}</h3>'
                f'<p class="where">{html.escape(_place(entry))}</p>'
            )
            if outcome.note:
                sections.append(f"<p>{html.escape(outcome.note)}</p>")
            if entry.name in pictures:
                data = base64.b64encode(pictures[entry.name]).decode("ascii")
                alt = html.escape(entry.title, quote=True)
                sections.append(f'<img alt="{alt}" src="data:image/png;base64,{data}">')
            if outcome.grid is not None:
                sections.append(_html_grid(outcome.grid))
            else:
                sections.append(_html_rows(outcome.rows))
    return _PAGE.substitute(
        title="The thesis, computed again",
        summary=html.escape(summary(results)),
        contents=" ".join(contents),
        sections="\n".join(sections),
    )


def _place(entry: Entry) -> str:
    if not entry.section:
        return "Not in the thesis"
    word = "" if entry.section[0].isalpha() else "section "
    return f"Thesis, {word}{entry.section}"


def claimed(out: Path, *, force: bool = False) -> contextlib.AbstractContextManager[bool]:
    """Return a context that holds the directory ``out``; earlier results there may be renewed.

    So may those that were interrupted.

    Raises
    ------
    ExistingResultError
        It holds something else and ``force`` is false.
    BusyError
        Another process works there.
    """
    ours = any((out / f"{stem}.csv").is_file() for stem in ("reproduction", "selection"))
    if out.exists() and not out.is_dir():
        raise ExistingResultError(f"{out} is a file, not a directory")
    return workplace.working(out, workplace.Work("drm reproduce"), force=force or ours)


def write_results(
    chosen: Sequence[Entry],
    out: Path,
    *,
    complete: bool,
    progress: Callable[[str], object] = lambda _: None,
) -> tuple[list[tuple[Entry, Outcome]], list[Path]]:
    """Compute entries and write pictures, table and page into ``out``.

    Parameters
    ----------
    chosen
        What to compute.
    out
        Directory, see `claimed`.
    complete
        Whether these are all entries: the table and the page are then called
        ``reproduction``, else ``selection``.
    progress
        Called with the name of each entry before it is computed.

    Returns
    -------
    results, files
        What the entries gave, without the figures, which are in the files; paths of the files.
    """
    results: list[tuple[Entry, Outcome]] = []
    written: list[Path] = []
    pictures: dict[str, bytes] = {}
    for entry in chosen:
        progress(entry.name)
        outcome = entry.build()
        if outcome.figure is not None:
            pictures[entry.name] = picture(outcome.figure)
            path = out / f"{entry.name}.png"
            with storage.atomic_path(path, overwrite=True) as temporary:
                temporary.write_bytes(pictures[entry.name])
            written.append(path)
        results.append((entry, replace(outcome, figure=None)))
    stem = "reproduction" if complete else "selection"
    table, page = table_text(results), page_text(results, pictures)
    written.append(storage.write_text(out / f"{stem}.csv", table, overwrite=True))
    written.append(storage.write_text(out / f"{stem}.html", page, overwrite=True))
    return results, written
