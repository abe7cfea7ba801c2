"""Results that are made of kept records, and records that are kept of results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from drm_baselines.benchmark import kept
from drm_baselines.benchmark.competitors import Competitor
from drm_baselines.benchmark.records import SuiteResult
from drm_baselines.benchmark.report import documents
from drm_baselines.benchmark.runner import fingerprint
from drm_baselines.suites import SUITES, load


def recorded(
    source: Path,
    suite: str,
    out: Path,
    flown: SuiteResult | None,
    policies: Sequence[str] = (),
) -> SuiteResult:
    """Return a suite's result from records, with strangers' rows.

    Parameters
    ----------
    source
        Directory of kept records; without a file of this suite only strangers' rows are there.
    suite
        The suite's name.
    out
        Directory of the benchmark, where the records of submissions are.
    flown
        What has been flown just now: submissions.
    policies
        Names of the package's policies that are wanted; all by default.

    Raises
    ------
    RunError
        A damaged file, or no record at all.
    """
    found = []
    if flown is None or (source / f"{suite}.parquet").is_file():
        found = list(kept.results_in(source, [suite])[0].records)
    if policies:
        found = [record for record in found if record.policy in policies]
    fresh = [] if flown is None else list(flown.records)
    known = {record.policy for record in (*found, *fresh)}
    earlier = [one for one in kept.submissions_in(out, suite) if one.policy not in known]
    return SuiteResult(suite=suite, title=SUITES[suite].title, records=[*found, *earlier, *fresh])


def places(keep: Path | None, *, package: bool) -> list[Path]:
    """Return the directories that records are kept in."""
    return [*([] if keep is None else [keep]), *([kept.packaged()] if package else [])]


def kept_result(
    directory: Path, result: SuiteResult, everybody: Sequence[Competitor]
) -> SuiteResult:
    """Keep the records of a suite; return its result as the file tells it, with all its rows.

    So tables that are made now are those that anybody makes of the file.
    """
    manoeuvres = load(result.suite)
    stamps = {one.policy: fingerprint(one, manoeuvres) for one in everybody}
    path = kept.keep(directory, result, stamps)
    return replace(result, records=kept.read_kept(path))


def write_summary(directory: Path) -> Path:
    """Write the aggregates of all records of a directory beside them."""
    return documents.write_summary(
        directory / kept.SUMMARY_FILE, kept.results_in(directory), overwrite=True
    )
