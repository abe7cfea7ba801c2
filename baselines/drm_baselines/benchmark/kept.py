"""Records that last: a small Parquet file a suite, of which tables are made without flying.

    SUITE.parquet   one row an episode, policy and training seed; what is judged, float32
    summary.json    the aggregates of all suites, as ``drm benchmark --json`` writes them

Those of the published tables come with the package. Files of others are data alone: types, sizes
and order are checked before a record is made of them.
"""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.benchmark.records import KINDS, SUBMITTED, Record, SuiteResult, read_record
from drm_baselines.errors import RunError
from drm_baselines.policies.budgets import updates_of
from drm_baselines.policies.names import POLICIES, title_of
from drm_baselines.suites import SUITES
from drm_baselines.support import storage
from drm_baselines.support.extras import needing
from drm_baselines.support.reading import shown

FORMAT = "drm-benchmark-kept"
FORMAT_VERSION = 1

METRICS = (
    "tip_error_rms",
    "residual_rms",
    "settled",
    "settling_time",
    "final_slew_error",
    "wheel_effort",
    "peak_deflection",
    "saturation",
    "slew_end_time",
    "duration",
    "diverged",
    "bound_solved",
    "plans",
)
"""Metrics that are kept, of those that a policy has."""

SUMMARY_FILE = "summary.json"

MAX_BYTES = 64 << 20
"""Largest file of records that is read: 64 MiB."""
MAX_ROWS = 2_000_000
"""Most rows of a file of records that is read."""

_TRAINING = (
    "algorithm", "seed", "steps", "updates", "wall_time", "command", "git_commit",
)  # fmt: skip


def packaged() -> Path:
    """Return the directory of the records that come with the package."""
    return Path(str(resources.files("drm_baselines.benchmark") / "flown"))


def suites_in(directory: Path) -> list[str]:
    """Return the suites that have records in a directory, in the order of tables."""
    return [name for name in SUITES if (directory / f"{name}.parquet").is_file()]


def keep(
    directory: Path, result: SuiteResult, fingerprints: Mapping[str, str] | None = None
) -> Path:
    """Write the records of a suite; those of policies that are not among them stay.

    Parameters
    ----------
    directory
        Where ``SUITE.parquet`` is.
    result
        What was flown.
    fingerprints
        By policy, see :func:`drm_baselines.benchmark.runner.fingerprint`: they tell later whether
        what would fly today is what was flown.
    """
    path = directory / f"{result.suite}.parquet"
    known = {record.policy: record for record in read_kept(path)} if path.is_file() else {}
    for record in result.records:
        stamp = (fingerprints or {}).get(record.policy)
        details = _lasting(record.details)
        if stamp is not None:
            details["fingerprint"] = stamp
        known[record.policy] = replace(record, details=details)
    order = list(POLICIES)
    places = {name: order.index(name) if name in order else len(order) for name in known}
    records = sorted(known.values(), key=lambda one: (places[one.policy], one.policy))
    _write(path, result.suite, records)
    return path


def _lasting(details: Mapping[str, Any]) -> dict[str, Any]:
    """What of a record's details is kept: not the whole description of a training."""
    kept = dict(details)
    training = kept.get("training")
    if isinstance(training, Mapping):
        kept["training"] = {
            str(seed): {
                **{name: each[name] for name in _TRAINING if name in each},
                **({} if (count := updates_of(each)) is None else {"updates": count}),
            }
            for seed, each in training.items()
            if isinstance(each, Mapping)
        }
    return kept


def _write(path: Path, suite: str, records: Sequence[Record]) -> None:
    pyarrow, parquet = _parquet()
    columns: dict[str, list[Any]] = {name: [] for name in ("policy", "seed", "episode", "stratum")}
    values: dict[str, list[NDArray[np.float32]]] = {name: [] for name in METRICS}
    for record in records:
        seeds, count = len(record.seeds), len(record.episodes)
        columns["policy"] += [record.policy] * (seeds * count)
        columns["seed"] += np.repeat(np.asarray(record.seeds), count).tolist()
        columns["episode"] += np.tile(record.episodes, seeds).tolist()
        columns["stratum"] += list(record.strata) * seeds
        for name, parts in values.items():
            given = record.metrics.get(name)
            whole = np.full(seeds * count, np.nan) if given is None else np.ravel(given)
            # beyond single precision is as bad as diverged
            parts.append(np.clip(whole, -3.0e38, 3.0e38).astype(np.float32))
    own = [name for name in METRICS if any(name in record.metrics for record in records)]
    table = pyarrow.table(
        {
            "policy": pyarrow.array(columns["policy"], pyarrow.string()),
            "seed": pyarrow.array(columns["seed"], pyarrow.int16()),
            "episode": pyarrow.array(columns["episode"], pyarrow.int16()),
            "stratum": pyarrow.array(columns["stratum"], pyarrow.string()),
            **{name: pyarrow.array(np.concatenate(values[name])) for name in own},
        }
    )
    header = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "suite": suite,
        "policies": {
            record.policy: {
                "title": record.title,
                "kind": record.kind,
                "knows": record.knows,
                "control_period": record.control_period,
                "metrics": [name for name in own if name in record.metrics],
                "details": storage.plain(dict(record.details)),
            }
            for record in records
        },
    }
    table = table.replace_schema_metadata({"drm_records": json.dumps(header, allow_nan=False)})
    with storage.atomic_path(path, overwrite=True) as temporary:
        parquet.write_table(
            table,
            temporary,
            compression="zstd",
            compression_level=19,
            use_dictionary=["policy", "seed", "episode", "stratum", "slew_end_time", "duration"],
            # the bytes of a float of one rank together: they are alike
            column_encoding={
                name: "BYTE_STREAM_SPLIT"
                for name in own
                if name not in ("slew_end_time", "duration")
            },
            write_statistics=False,
        )


def read_kept(path: Path) -> list[Record]:
    """Read the records of a suite, in the order of the file.

    Raises
    ------
    RunError
        A file that is missing, too large, damaged or something else; the message names it.
    """
    pyarrow, parquet = _parquet()
    try:
        if path.stat().st_size > MAX_BYTES:
            raise RunError(f"{path} has more than the {MAX_BYTES} bytes that are read")
        file = parquet.ParquetFile(path)
        if file.metadata.num_rows > MAX_ROWS:
            raise RunError(f"{path} has more than the {MAX_ROWS} rows that are read")
        header = json.loads((file.schema_arrow.metadata or {}).get(b"drm_records", b"null"))
        if not isinstance(header, dict) or header.get("format") != FORMAT:
            raise RunError(f"{path} holds no kept records of a benchmark")
        if header.get("format_version") != FORMAT_VERSION:
            raise RunError(f"{path} has format version {shown(header.get('format_version'))}")
        wanted = ["policy", "seed", "episode", "stratum"]
        wanted += [name for name in METRICS if name in file.schema_arrow.names]
        table = file.read(columns=wanted)
    except (OSError, ValueError, RecursionError, pyarrow.ArrowException) as error:
        raise RunError(f"{path} cannot be read: {error}") from error
    try:
        return _records(table, header)
    except (AttributeError, LookupError, TypeError, ValueError, ArithmeticError) as error:
        raise RunError(f"{path} is damaged: {error}") from error


def _records(table: Any, header: Mapping[str, Any]) -> list[Record]:
    """Make records of a file's rows.

    Raises
    ------
    ValueError, KeyError, TypeError, AttributeError
        Rows and header do not belong together.
    """
    policy = np.asarray(table["policy"].to_pylist(), dtype=object)
    stratum = table["stratum"].to_pylist()
    seed, episode = (np.asarray(table[name].to_numpy()) for name in ("seed", "episode"))
    for name, values in (("seed", seed), ("episode", episode)):
        if values.dtype.kind not in "iu" or (values.size and values.min() < 0):
            raise ValueError(f"{name} must be a whole number from 0 in every row")
    columns = {
        name: table[name].to_numpy().astype(np.float64)
        for name in table.column_names
        if name in METRICS
    }
    found = []
    described = header["policies"]
    if set(described) != set(policy.tolist()):
        raise ValueError("the header describes other policies than the rows")
    for name, about in described.items():
        rows = np.flatnonzero(policy == name)
        seeds = list(dict.fromkeys(seed[rows].tolist()))
        count = rows.size // len(seeds)
        shape = (len(seeds), count)
        places = episode[rows].reshape(shape)
        if (
            not np.array_equal(seed[rows].reshape(shape), np.array(seeds)[:, None].repeat(count, 1))
            or not (places == places[0]).all()
            or np.unique(places[0]).size != count
        ):
            raise ValueError(f"the seeds of {name} must have flown the same episodes, each once")
        found.append(
            Record(
                policy=_text(name, "policy"),
                title=title_of(name) if name in POLICIES else _text(about["title"], "title"),
                kind=_one_of(about["kind"], (*KINDS, SUBMITTED), "kind"),
                knows=_one_of(about["knows"], ("reported", "true", "nothing"), "knows"),
                control_period=_time(about["control_period"]),
                seeds=seeds,
                episodes=places[0].astype(np.int64),
                strata=[_text(stratum[row], "stratum") for row in rows[:count].tolist()],
                metrics={
                    metric: columns[metric][rows].reshape(shape)
                    for metric in about["metrics"]
                    if metric in METRICS
                },
                details=dict(about["details"]),
            )
        )
    return found


def _text(value: Any, name: str) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= 200 or not value.isprintable():
        raise ValueError(f"{name} must be printable text, got {shown(value)}")
    return value


def _one_of(value: Any, known: Sequence[str], name: str) -> str:
    if not isinstance(value, str) or value not in known:
        raise ValueError(f"{name} must be one of {', '.join(known)}, got {shown(value)}")
    return value


def _time(value: Any) -> float:
    if type(value) not in (int, float) or not math.isfinite(value) or not 0.0 <= value < 1e6:
        raise ValueError(f"control_period must be a time, got {shown(value)}")
    return float(value)


def results_in(directory: Path, names: Sequence[str] | None = None) -> list[SuiteResult]:
    """Return the results of the suites that have records in a directory.

    Parameters
    ----------
    directory
        With a ``SUITE.parquet`` each.
    names
        The suites that are wanted; all that there are by default.

    Raises
    ------
    RunError
        There are none, one of those wanted is missing, or a file is damaged.
    """
    there = suites_in(directory)
    missing = [name for name in names or () if name not in there]
    if missing or not there:
        what = f"{missing[0]}.parquet" if missing else "SUITE.parquet"
        raise RunError(f"{directory} holds no records of a benchmark: there is no {what}")
    return [
        SuiteResult(
            suite=name,
            title=SUITES[name].title,
            records=read_kept(directory / f"{name}.parquet"),
        )
        for name in there
        if not names or name in names
    ]


def submissions_in(out: Path, suite: str) -> list[Record]:
    """Return what strangers' policies did in a suite, of the records that a benchmark wrote.

    Parameters
    ----------
    out
        Its directory.
    suite
        The suite's name.

    Raises
    ------
    RunError
        A damaged record.
    """
    folder = out / "records" / suite
    records = [read_record(path) for path in sorted(folder.glob("*.parquet"))]
    return [record for record in records if record.kind == SUBMITTED]


def _parquet() -> tuple[Any, Any]:
    with needing("the benchmark's records", "report"):
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
