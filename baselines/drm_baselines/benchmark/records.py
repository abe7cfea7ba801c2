"""What a suite's flights left behind: metrics by policy, training seed and episode.

Records are Parquet files, one a policy and suite, a row an episode and seed; they are written
when a policy has flown a suite, so that an interrupted benchmark goes on where it stopped, and
every table and figure is made from them alone.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.errors import RunError
from drm_baselines.support import storage
from drm_baselines.support.extras import needing

FORMAT = "drm-benchmark-records"
FORMAT_VERSION = 1

KINDS = ("bound", "open loop", "law", "tuned law", "shaped law", "controller", "learned")
"""Kinds of policies that the package has, in the order of tables."""

SUBMITTED = "submitted"
"""Kind of a stranger's policy: it comes after all others."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """All flights of one policy over one suite.

    Attributes
    ----------
    policy, title
        Key in files (``"linear_tuned"``) and name in tables.
    kind
        One of :data:`KINDS`, or :data:`SUBMITTED`.
    knows
        What it is told of the payload: ``"reported"``, ``"true"`` or ``"nothing"``.
    control_period
        Time between two decisions, s.
    seeds
        Training seeds, shape (s,); ``[0]`` for what is not trained.
    episodes
        Places of the flown episodes in the suite, shape (n,): all of them, or fewer where flying
        or solving all takes too long.
    strata
        Stratum of each of these episodes.
    metrics
        Engine metrics by name, each of shape (s, n), SI.
    details
        What else identifies the policy and the machine, for the file.
    """

    policy: str
    title: str
    kind: str
    knows: str
    control_period: float
    seeds: Sequence[int]
    episodes: NDArray[np.int64]
    strata: Sequence[str]
    metrics: Mapping[str, NDArray[np.float64]]
    details: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that every metric has a value for each seed and episode."""
        shape = (len(self.seeds), len(self.episodes))
        if len(self.strata) != len(self.episodes):
            raise ValueError(f"{len(self.strata)} strata for {len(self.episodes)} episodes")
        for name, values in self.metrics.items():
            if np.shape(values) != shape:
                raise ValueError(f"{name} has shape {np.shape(values)} instead of {shape}")


@dataclass(frozen=True, kw_only=True)
class SuiteResult:
    """What every policy did in one suite, in the order of tables."""

    suite: str
    title: str
    records: Sequence[Record]


def write_record(path: Path, record: Record) -> Path:
    """Write one record as a Parquet file, replacing an older one in one rename."""
    pyarrow, parquet = _parquet()
    seeds, count = len(record.seeds), len(record.episodes)
    columns: dict[str, Any] = {
        "seed": np.repeat(np.asarray(record.seeds, dtype=np.int64), count),
        "episode": np.tile(record.episodes, seeds),
        "stratum": list(record.strata) * seeds,
        **{f"metrics/{name}": values.reshape(-1) for name, values in record.metrics.items()},
    }
    header = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "policy": record.policy,
        "title": record.title,
        "kind": record.kind,
        "knows": record.knows,
        "control_period": record.control_period,
        "details": storage.plain(dict(record.details)),
    }
    table = pyarrow.table(columns).replace_schema_metadata(
        {"drm_record": json.dumps(header, allow_nan=False)}
    )
    with storage.atomic_path(path, overwrite=True) as temporary:
        parquet.write_table(table, temporary)
    return path


def read_record(path: Path) -> Record:
    """Read a record back.

    Raises
    ------
    RunError
        A file that is missing, damaged or something else.
    """
    pyarrow, parquet = _parquet()
    try:
        table = parquet.read_table(path)
        header = json.loads((table.schema.metadata or {}).get(b"drm_record", b"null"))
    except (OSError, ValueError, pyarrow.ArrowException) as error:
        raise RunError(f"{path} cannot be read: {error}") from error
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise RunError(f"{path} holds no record of a benchmark")
    if header.get("format_version") != FORMAT_VERSION:
        raise RunError(f"{path} has format version {header.get('format_version')!r}")
    try:
        seed = table["seed"].to_numpy()
        seeds = list(dict.fromkeys(int(value) for value in seed))
        count = len(seed) // len(seeds)
        shape = (len(seeds), count)
        return Record(
            policy=header["policy"],
            title=header["title"],
            kind=header["kind"],
            knows=header["knows"],
            control_period=float(header["control_period"]),
            seeds=seeds,
            episodes=table["episode"].to_numpy()[:count].astype(np.int64),
            strata=table["stratum"].to_pylist()[:count],
            metrics={
                name.removeprefix("metrics/"): table[name].to_numpy().reshape(shape)
                for name in table.column_names
                if name.startswith("metrics/")
            },
            details=header["details"],
        )
    except (KeyError, TypeError, ValueError, ZeroDivisionError) as error:
        raise RunError(f"{path} is damaged: {error}") from error


def _parquet() -> tuple[Any, Any]:
    with needing("the benchmark's records", "report"):
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
