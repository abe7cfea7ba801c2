"""The benchmark from flights to tables: what one command does.

The records of a suite are files, one a policy. A policy that has flown already is not flown
again, unless its law, its weights, the suite or the engine's version have changed or it is
asked for; so an interrupted benchmark goes on where it stopped.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import drm_env
from drm_baselines.benchmark.competitors import (
    Competitor,
    Progress,
)
from drm_baselines.benchmark.records import SuiteResult, read_record, write_record
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.suites import SUITES, Manoeuvres, load
from drm_baselines.support import storage
from drm_baselines.support.reading import read_table

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
            # there whoever flies, as in the fingerprints of the records that there are
            "law": None,
            **competitor.identity,
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
