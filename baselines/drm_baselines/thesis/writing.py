"""Results as files: pictures, one CSV table and one HTML page that holds everything."""

from __future__ import annotations

import contextlib
import csv
import io
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

# matplotlib cannot be installed without it
from PIL import Image, ImageColor

from drm_baselines.errors import ExistingResultError
from drm_baselines.pages import blocks, writer
from drm_baselines.support import storage, workplace
from drm_baselines.support.palette import OKABE_ITO
from drm_baselines.thesis.results import Entry, Grid, Outcome, Row, Verdict

Results = Sequence[tuple[Entry, Outcome]]

COLUMNS = (
    "entry", "title", "section", "quantity", "unit", "published", "ours", "difference",
    "difference_percent", "verdict", "reason",
)  # fmt: skip
"""Columns of the CSV table."""


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


_TONES = {
    Verdict.REPRODUCED: "good",
    Verdict.INFERRED: "middling",
    Verdict.NOT_REPRODUCED: "bad",
    Verdict.UNPUBLISHED: "plain",
}

_KINDS = (
    ("table", "Tables"),
    ("figure", "Figures"),
    ("claim", "Claims of the text"),
    ("erratum", "Errata"),
    ("consistent", "The consistent plant"),
)


def _tag(verdict: Verdict) -> str:
    return verdict.value.replace(" ", "-")


def _grid_table(grid: Grid) -> blocks.Table:
    return blocks.Table(headings=[blocks.Cell(text=name) for name in grid.columns], rows=grid.lines)


def _rows_table(rows: Sequence[Row]) -> blocks.Table:
    """Quantities; a reason stands below its quantity, for most have none."""
    lines: list[list[blocks.Cell | str]] = [
        [
            blocks.Cell(text=row.quantity, detail=row.reason),
            row.unit,
            shown(row.published),
            shown(row.ours),
            percent(row),
            blocks.Cell(text=row.verdict.value, tone=_TONES[row.verdict]),
        ]
        for row in rows
    ]
    heads = ("quantity", "unit", "published", "ours", "difference", "verdict")
    return blocks.Table(
        headings=[blocks.Cell(text=name) for name in heads],
        rows=lines,
        left=2,
        tags=[_tag(row.verdict) for row in rows],
    )


def _section(entry: Entry, outcome: Outcome, heading: str, data: bytes | None) -> blocks.Section:
    parts: list[blocks.Block] = []
    if outcome.note:
        parts.append(blocks.Text(lines=[outcome.note]))
    if data is not None:
        parts.append(blocks.Picture(data=smaller(data), title=entry.title))
    if outcome.grid is not None:
        parts.append(_grid_table(outcome.grid))
    elif outcome.rows:
        parts.append(_rows_table(outcome.rows))
    found = {row.verdict for row in outcome.rows}
    worst = (
        Verdict.NOT_REPRODUCED,
        Verdict.INFERRED,
        Verdict.REPRODUCED,
        Verdict.UNPUBLISHED,
    )
    return blocks.Section(
        name=entry.name,
        title=f"{entry.name}: {entry.title}",
        subtitle=_place(entry),
        brief=entry.title,
        group=heading,
        blocks=parts,
        tags=sorted(_tag(verdict) for verdict in found),
        tone=next((_TONES[verdict] for verdict in worst if verdict in found), "plain"),
    )


_COLOURS = 64
"""Colours of a picture in the page: anti-aliased lines in few hues need no more."""


def smaller(data: bytes) -> bytes:
    """Return a picture (PNG) as WebP in few colours, which takes about a quarter."""
    stream = io.BytesIO()
    with Image.open(io.BytesIO(data)) as opened:
        picture = opened.convert("RGB")
        width, height = picture.size
        # so much of each colour of the palette that no thin line is given another's
        patch = max(8, height // 12)
        sheet = Image.new("RGB", (width, height + patch * len(OKABE_ITO)), "white")
        sheet.paste(picture)
        for index, colour in enumerate(OKABE_ITO.values()):
            top = height + patch * index
            sheet.paste(ImageColor.getrgb(colour), (0, top, width, top + patch))
        palette = sheet.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT)
        few = picture.quantize(palette=palette, dither=Image.Dither.NONE)
        few.convert("RGB").save(stream, format="WEBP", lossless=True, method=2)
    return stream.getvalue()


def _overview(results: Results) -> blocks.Section:
    """How many quantities of each kind have which verdict."""
    rows = []
    for kind, heading in _KINDS:
        found = Counter(
            row.verdict for entry, outcome in results if entry.kind == kind for row in outcome.rows
        )
        if found:
            cells = (str(found[verdict]) if found[verdict] else "" for verdict in Verdict)
            rows.append([heading, str(sum(found.values())), *cells])
    return blocks.Section(
        name="overview",
        title="Overview",
        blocks=[
            blocks.Text(lines=[summary(results)]),
            blocks.Table(
                headings=[
                    blocks.Cell(text=""),
                    blocks.Cell(text="quantities"),
                    *(blocks.Cell(text=verdict.value, tone=_TONES[verdict]) for verdict in Verdict),
                ],
                rows=rows,
                note="Choose a verdict in the contents to see the quantities that have it.",
            ),
        ],
    )


def page_text(results: Results, pictures: dict[str, bytes]) -> str:
    """Return one page with all rows and pictures, which needs no other file."""
    found = Counter(
        row.verdict for _, outcome in results if outcome.grid is None for row in outcome.rows
    )
    return writer.page_text(
        blocks.Page(
            title="The thesis, computed again",
            subtitle="Every table, figure and claim beside what this project computes.",
            choices=[
                blocks.Choice(
                    tag=_tag(verdict),
                    label=verdict.value,
                    tone=_TONES[verdict],
                    count=found[verdict],
                )
                for verdict in Verdict
                if found[verdict]
            ],
            sections=[
                _overview(results),
                *(
                    _section(entry, outcome, heading, pictures.get(entry.name))
                    for kind, heading in _KINDS
                    for entry, outcome in results
                    if entry.kind == kind
                ),
            ],
        )
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
