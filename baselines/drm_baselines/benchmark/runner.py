"""The benchmark from flights to tables: what one command does.

The records of a suite are files, one a policy. A policy that has flown already is not flown
again, unless its law, its weights, the suite or the engine's version have changed or it is
asked for; so an interrupted benchmark goes on where it stopped.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import drm_env
from drm_baselines.benchmark import pieces
from drm_baselines.benchmark.competitors import Competitor
from drm_baselines.benchmark.pieces import Piece
from drm_baselines.benchmark.records import Record, SuiteResult, read_record, write_record
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.policies.pilots import Metrics, Pilot
from drm_baselines.suites import SUITES, Manoeuvres, load
from drm_baselines.support import storage
from drm_baselines.support.executors import Executor, Here
from drm_baselines.support.reading import read_table

RECORDS = "records"

Progress = Callable[[str, int, int], None]
"""Called with (policy, episodes done, episodes in all)."""


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
    workers: Executor | None = None,
) -> SuiteResult:
    """Fly whoever has not flown a suite yet, and return all records of it.

    Parameters
    ----------
    suite
        Its name.
    everybody
        Who competes.
    directory
        Of the benchmark.
    again
        Whether everybody flies anew, whatever records there are.
    progress
        Called while episodes are flown.
    told
        Called with a line about every record that cannot be read.
    workers
        Who does the flights; this process by default. The records are the same to the bit.
    """
    manoeuvres = load(suite)
    folder = directory / RECORDS / suite
    records: dict[str, Record] = {}
    missing: list[_Missing] = []
    for competitor in everybody:
        path = record_file(directory, suite, competitor.policy)
        wanted = fingerprint(competitor, manoeuvres)
        if not again and _stamp_of(path.with_suffix(".json")) == wanted:
            try:
                # a record keeps what flew; its title is today's
                records[competitor.policy] = replace(read_record(path), title=competitor.title)
            except RunError as error:
                if told is not None:
                    told(f"{error}; flown again")
            else:
                continue
        path.with_suffix(".json").unlink(missing_ok=True)
        if again:
            pieces.forget(folder, competitor.policy)
        missing.append(_Missing(competitor, dict(competitor.pilots()), wanted))
    if missing:
        for each in _flown(folder, manoeuvres, missing, workers or Here(), progress):
            record = each.competitor.record(
                manoeuvres, each.pilots, pieces.joined(each.flown, list(each.pilots))
            )
            path = record_file(directory, suite, record.policy)
            write_record(path, record)
            # last: a record without its stamp is not used
            stamp = {"fingerprint": each.fingerprint}
            storage.write_json(path.with_suffix(".json"), stamp, overwrite=True)
            pieces.forget(folder, record.policy)
            records[record.policy] = record
    return SuiteResult(
        suite=suite,
        title=SUITES[suite].title,
        records=[records[competitor.policy] for competitor in everybody],
    )


@dataclass
class _Missing:
    """A competitor whose record is to be flown, and what has been flown of it."""

    competitor: Competitor
    pilots: dict[int, Pilot]
    fingerprint: str
    flown: dict[Piece, Metrics] = field(default_factory=dict)
    pieces: int = 0


def _flown(
    folder: Path,
    manoeuvres: Manoeuvres,
    missing: Sequence[_Missing],
    workers: Executor,
    progress: Progress | None,
) -> Iterator[_Missing]:
    """Fly what is missing, keep each piece, and yield competitors as they are complete."""
    by_policy = {each.competitor.policy: each for each in missing}

    def shown(policy: str, under_way: int = 0) -> None:
        each = by_policy[policy]
        if progress is not None:
            done = sum(len(piece.episodes) for piece in each.flown) + under_way
            total = len(each.pilots) * len(each.competitor.episodes(manoeuvres))
            progress(each.competitor.title, done, total)

    jobs: list[tuple[Piece, Piece]] = []
    for each in missing:
        for piece in pieces.pieces_of(
            each.competitor, list(each.pilots), manoeuvres, spread=not workers.is_here
        ):
            each.pieces += 1
            found = pieces.kept(folder, piece, each.fingerprint)
            if found is None:
                jobs.append((piece, piece))
            else:
                each.flown[piece] = found
    for each in missing:
        if len(each.flown) == each.pieces:  # it was killed before it wrote the record
            yield each
    squadron = pieces.Squadron(
        suite=manoeuvres.suite.name,
        digest=manoeuvres.digest,
        pilots={
            (each.competitor.policy, seed): pilot
            for each in missing
            for seed, pilot in each.pilots.items()
        },
    )
    told = (lambda piece, done, _: shown(piece.policy, done)) if workers.is_here else None
    for piece, metrics in workers.run(pieces.fly_piece, squadron, jobs, told):
        each = by_policy[piece.policy]
        each.flown[piece] = metrics
        if each.pieces > 1:
            pieces.keep(folder, piece, metrics, each.fingerprint)
        shown(piece.policy)
        if len(each.flown) == each.pieces:
            yield each


def _stamp_of(path: Path) -> str | None:
    try:
        found = read_table(path).get("fingerprint")
    except BaselineError:
        return None
    return found if isinstance(found, str) else None
