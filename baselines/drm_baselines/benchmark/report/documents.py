"""Everything that is made of the records: aggregates, pictures, places in documents."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.benchmark.competitors import (
    LEARNERS,
    runs_in,
)
from drm_baselines.benchmark.estimates import (
    Estimate,
    estimate_of,
)
from drm_baselines.benchmark.records import SuiteResult
from drm_baselines.benchmark.report import (
    leaderboard,
    plots,
    summaries,
    tables,
    targets,
)
from drm_baselines.errors import BaselineError
from drm_baselines.policies.names import title_of
from drm_baselines.rl.run_record import EVALUATIONS_FILE
from drm_baselines.suites import SUITES
from drm_baselines.support import storage
from drm_baselines.support.markers import marked_range


def inject(path: Path, name: str, text: str) -> Path:
    """Replace what is between two markers of a Markdown file; everything else stays as it is.

    The markers are ``<!-- benchmark:NAME -->`` and ``<!-- /benchmark:NAME -->``.

    Raises
    ------
    BaselineError
        No such file, or markers that are missing, there twice or in the wrong order; the file is
        as it was.
    """
    begin, end = f"<!-- benchmark:{name} -->", f"<!-- /benchmark:{name} -->"
    try:
        old = path.read_text(encoding="utf-8")
    except OSError as error:
        raise BaselineError(f"{path} cannot be read: {error}") from error
    place = marked_range(old, begin, end, where=str(path))
    if place is None:
        raise BaselineError(f"{path}: expected {begin!r} and then {end!r}, found neither")
    body = text.strip("\n")
    new = f"{old[: place[0]]}{begin}\n{body}\n{end}{old[place[1] :]}"
    return storage.write_text(path, new, overwrite=True)


def targets_text(results: Sequence[SuiteResult]) -> str:
    """Return the targets of all suites as a Markdown list."""
    lines = [
        f"- {'**missed**' if verdict == targets.MISSED else verdict}: `{result.suite}`: {text}"
        for result in results
        for text, verdict in targets.targets(result)
    ]
    return "\n".join(lines) if lines else "No suite with targets was flown."


def curves_of(learned: Path) -> dict[str, list[NDArray[np.float64]]]:
    """Return learning curves by method: steps, wall time (s), tip error (m), a row a point."""
    found: dict[str, list[NDArray[np.float64]]] = {}
    for method in LEARNERS:
        for directory in runs_in(learned / method).values():
            path = directory / EVALUATIONS_FILE
            if not path.is_file():
                continue
            with path.open(newline="", encoding="utf-8") as stream:
                rows = [
                    [float(row[name]) for name in ("steps", "wall_time", "tip_error_rms")]
                    for row in csv.DictReader(stream)
                ]
            if rows:
                found.setdefault(title_of(method), []).append(np.array(rows))
    return found


def bands_of(result: SuiteResult) -> dict[str, Estimate]:
    """Return the tip errors of laws and bound, which learning curves are held against."""
    kinds = ("bound", "law", "tuned law")
    return {
        record.title: estimate_of(record, "tip_error_rms")
        for record in result.records
        if record.kind in kinds
    }


LINKED = ("from suite to suite", "learning curves")
"""Captions of the figures that the page shows; it draws the others itself."""


def draw(results: Sequence[SuiteResult], directory: Path, learned: Path) -> dict[str, Path]:
    """Draw all figures into a directory, replacing older ones; return caption and file."""
    figures: dict[str, Path] = {}
    for result in results:
        name = result.suite
        path = figures[f"tip error in {name}"] = directory / f"{name}.png"
        plots.plot_suite(result, path, overwrite=True)
        path = figures[f"performance profiles in {name}"] = directory / f"{name}_profiles.png"
        plots.plot_profiles(result, path, overwrite=True)
    if len(results) > 1:
        path = figures["from suite to suite"] = directory / "degradation.png"
        plots.plot_degradation(results, path, overwrite=True)
    robust = [result for result in results if result.suite == "robust"]
    curves = curves_of(learned)
    if robust and curves:
        path = figures["learning curves"] = directory / "learning_curves.png"
        plots.plot_curves(curves, bands_of(robust[0]), path, overwrite=True)
    return figures


def summary(results: Sequence[SuiteResult]) -> dict[str, Any]:
    """Return the aggregates: of one suite as they are, of several under their names."""
    found: dict[str, Any] = {result.suite: summaries.summary(result) for result in results}
    return next(iter(found.values())) if len(found) == 1 else {"suites": found}


def write_summary(path: Path, results: Sequence[SuiteResult], *, overwrite: bool) -> Path:
    """Write what :func:`summary` returns."""
    return storage.write_json(path, summary(results), overwrite=overwrite)


def update_leaderboard(root: Path, results: Sequence[SuiteResult]) -> list[Path]:
    """Write the tables of docs/leaderboard.md, if the project has that page."""
    board = root / "docs" / "leaderboard.md"
    if not board.is_file():
        return []
    return [inject(board, "leaderboard", leaderboard.leaderboard(results))]


def check_rows(page: Path, results: Sequence[SuiteResult]) -> None:
    """Refuse to write tables that lack rows which the page has: they would be lost.

    Raises
    ------
    BaselineError
        The message names the suite and the policies.
    """
    text = page.read_text(encoding="utf-8") if page.is_file() else ""
    for result in results:
        begin, end = f"<!-- benchmark:{result.suite} -->", f"<!-- /benchmark:{result.suite} -->"
        block = text.partition(begin)[2].partition(end)[0]
        rows = [line.split("|")[1].strip() for line in block.splitlines() if line[:2] == "| "]
        there = {row.removesuffix(" \\*") for row in rows[1:]}
        lost = there - {record.title for record in result.records}
        if lost:
            raise BaselineError(
                f"{page}: the table of {result.suite} has rows that were not flown: "
                f"{', '.join(sorted(lost))}; fly them too, or take them out of the page"
            )


def update_documents(root: Path, results: Sequence[SuiteResult], figures: Path) -> list[Path]:
    """Write the tables between the markers of README.md (a short one) and docs/benchmark.md.

    What needs all suites is written when all have been flown.
    """
    readme, page = root / "README.md", root / "docs" / "benchmark.md"
    check_rows(page, results)
    written = []
    for result in results:
        inject(page, result.suite, tables.markdown_table(result))
        if result.suite == "robust":
            written.append(inject(readme, "robust", tables.short_markdown_table(result)))
    if {result.suite for result in results} == set(SUITES):
        inject(page, "degradation", tables.degradation_table(results))
        inject(page, "targets", targets_text(results))
    written.append(page)
    images = root / "docs" / "images"
    for name in ("robust", "robust_profiles", "degradation", "learning_curves"):
        source = figures / f"{name}.png"
        if source.is_file():
            target = images / f"benchmark_{name}.png"
            with storage.atomic_path(target, overwrite=True) as temporary:
                temporary.write_bytes(source.read_bytes())
            written.append(target)
    return written
