"""The benchmark from flights to tables: what one command does.

The records of a suite are files, one a policy. A policy that has flown already is not flown
again, unless its law, its weights, the suite or the engine's version have changed or it is
asked for; so an interrupted benchmark goes on where it stopped.
"""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines import storage
from drm_baselines.benchmark import report
from drm_baselines.benchmark.estimates import Estimate, estimate_of
from drm_baselines.benchmark.field import LEARNERS, Competitor, Progress, runs_in
from drm_baselines.benchmark.results import SuiteResult, read_record, write_record
from drm_baselines.benchmark.suites import SUITES, Manoeuvres, load
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.policy_names import title_of
from drm_baselines.reading import read_table
from drm_baselines.runs import EVALUATIONS_FILE

RECORDS = "records"


def fingerprint(competitor: Competitor, manoeuvres: Manoeuvres) -> str:
    """Return a digest of everything that decides what a record holds."""
    weights = {
        str(seed): storage.sha256_of(path / "policy.json") for seed, path in competitor.runs.items()
    }
    flown = len(competitor.episodes(manoeuvres))
    content = json.dumps(
        {
            "suite": manoeuvres.digest,
            "base": dict(manoeuvres.suite.base),
            "kind": competitor.kind,
            "law": None if competitor.law is None else dict(competitor.law),
            **({} if competitor.receding is None else {"receding": asdict(competitor.receding)}),
            **({} if flown == len(manoeuvres) else {"episodes": flown}),
            "runs": weights,
            "engine": drm_env.__version__,
        },
        sort_keys=True,
        default=str,
    )
    return hashlib.sha256(content.encode()).hexdigest()


def record_file(directory: Path, suite: str, policy: str) -> Path:
    """Return where the record of a policy in a suite is."""
    return directory / RECORDS / suite / f"{policy}.parquet"


def fly_suite(
    suite: str,
    everybody: Sequence[Competitor],
    directory: Path,
    *,
    again: bool = False,
    progress: Progress | None = None,
    told: Callable[[str], None] | None = None,
) -> SuiteResult:
    """Fly whoever has not flown a suite yet, and return all records of it.

    ``told`` is called with a line about every policy that is not flown again.
    """
    manoeuvres = load(suite)
    records = []
    for competitor in everybody:
        path = record_file(directory, suite, competitor.policy)
        stamp = path.with_suffix(".json")
        wanted = fingerprint(competitor, manoeuvres)
        if not again and _stamp_of(stamp) == wanted:
            try:
                # a record keeps what flew; its title is today's
                records.append(replace(read_record(path), title=competitor.title))
            except RunError as error:
                if told is not None:
                    told(f"{error}; flown again")
            else:
                continue
        stamp.unlink(missing_ok=True)
        record = competitor.fly(manoeuvres, progress)
        write_record(path, record)
        # last: a record without its stamp is not used
        storage.write_json(stamp, {"fingerprint": wanted}, overwrite=True)
        records.append(record)
    return SuiteResult(suite=suite, title=SUITES[suite].title, records=records)


def _stamp_of(path: Path) -> str | None:
    try:
        found = read_table(path).get("fingerprint")
    except BaselineError:
        return None
    return found if isinstance(found, str) else None


def targets_text(results: Sequence[SuiteResult]) -> str:
    """Return the targets of all suites as a Markdown list."""
    lines = [
        f"- {'**missed**' if verdict == report.MISSED else verdict}: `{result.suite}`: {text}"
        for result in results
        for text, verdict in report.targets(result)
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


def draw(results: Sequence[SuiteResult], directory: Path, learned: Path) -> dict[str, Path]:
    """Draw all figures into a directory, replacing older ones; return caption and file."""
    figures: dict[str, Path] = {}
    for result in results:
        name = result.suite
        figures[f"tip error in {name}"] = report.plot_suite(
            result, directory / f"{name}.png", overwrite=True
        )
        figures[f"performance profiles in {name}"] = report.plot_profiles(
            result, directory / f"{name}_profiles.png", overwrite=True
        )
    if len(results) > 1:
        figures["from suite to suite"] = report.plot_degradation(
            results, directory / "degradation.png", overwrite=True
        )
    robust = [result for result in results if result.suite == "robust"]
    curves = curves_of(learned)
    if robust and curves:
        figures["learning curves"] = report.plot_curves(
            curves, bands_of(robust[0]), directory / "learning_curves.png", overwrite=True
        )
    return figures


def summary(results: Sequence[SuiteResult]) -> dict[str, Any]:
    """Return the aggregates: of one suite as they are, of several under their names."""
    summaries: dict[str, Any] = {result.suite: report.summary(result) for result in results}
    return next(iter(summaries.values())) if len(summaries) == 1 else {"suites": summaries}


def write_summary(path: Path, results: Sequence[SuiteResult], *, overwrite: bool) -> Path:
    """Write what :func:`summary` returns."""
    return storage.write_json(path, summary(results), overwrite=overwrite)


def update_documents(root: Path, results: Sequence[SuiteResult], figures: Path) -> list[Path]:
    """Write the tables between the markers of README.md and docs/benchmark.md."""
    readme, page = root / "README.md", root / "docs" / "benchmark.md"
    written = []
    for result in results:
        report.inject(page, result.suite, report.markdown_table(result))
        if result.suite == "robust":
            written.append(report.inject(readme, "robust", report.markdown_table(result)))
    report.inject(page, "degradation", report.degradation_table(results))
    written.append(report.inject(page, "targets", targets_text(results)))
    images = root / "docs" / "images"
    for name in ("robust", "robust_profiles", "degradation", "learning_curves"):
        source = figures / f"{name}.png"
        if source.is_file():
            target = images / f"benchmark_{name}.png"
            with storage.atomic_path(target, overwrite=True) as temporary:
                temporary.write_bytes(source.read_bytes())
            written.append(target)
    return written
