"""Per-episode records: the raw material of every table and figure.

One row an episode and policy, in SI units and radians. Tables and plots are made from records
only, so that they can be made again, or differently, without flying the episodes again. The
settings shared by all rows (configuration, versions, platform) travel in a JSON file beside a
CSV file, and in the file's own metadata for Parquet.
"""

from __future__ import annotations

import csv
import html
import importlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.errors import BaselineError
from drm_baselines.evaluation import statistics
from drm_baselines.evaluation.metrics import HEADLINE, describe
from drm_baselines.support import storage
from drm_baselines.support.extras import needing

_FRACTIONS = ("settled", "saturation", "diverged")


@dataclass(frozen=True, kw_only=True)
class Episodes:
    """The episodes that one policy flew.

    Attributes
    ----------
    label
        Name of the policy in tables.
    control_period
        Time between two decisions of the policy, in s.
    seeds
        Seed of each episode, shape ``(n,)``.
    metrics
        Engine metrics by name, each of shape ``(n,)``, SI units.
    context
        Drawn parameters of the episodes by name, each of shape ``(n,)``, SI units.
    details
        What else identifies the policy (law and parameters, run directory, digest).
    """

    label: str
    control_period: float
    seeds: Sequence[int]
    metrics: Mapping[str, NDArray[np.float64]]
    context: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that every column has one value an episode."""
        for group in (self.metrics, self.context):
            for name, values in group.items():
                if np.shape(values) != (len(self.seeds),):
                    raise ValueError(
                        f"{name} has shape {np.shape(values)} for {len(self.seeds)} episodes"
                    )

    def __len__(self) -> int:
        """Return the number of episodes."""
        return len(self.seeds)

    def _repr_html_(self) -> str:
        """What Jupyter shows: every metric's aggregate with its interval."""
        rows = []
        for name in self.metrics:
            shown = describe(name)
            found = self.estimate(name).scaled(shown.scale)
            cells = (
                shown.label,
                shown.unit,
                f"{found.value:.4g}",
                f"{found.low:.4g} to {found.high:.4g}",
            )
            rows.append("".join(f"<td>{html.escape(cell)}</td>" for cell in cells))
        heads = ("metric", "unit", "interquartile mean", "95 % interval")
        head = "".join(f"<th>{html.escape(name)}</th>" for name in heads)
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return (
            f"<p><b>{html.escape(self.label)}</b>: {len(self)} episodes</p>"
            f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        )

    def judged(self, name: str) -> NDArray[np.float64]:
        """Return a metric with every episode given a value that can be compared.

        A settling time that is censored (never settled) counts as the whole time from the end
        of the slew to the end of the episode, its lower bound; the settled fraction stands
        beside it. Signed errors count by magnitude. Any other value that is not a number
        belongs to a diverged episode and counts as infinitely bad.
        """
        values = np.asarray(self.metrics[name], dtype=np.float64).copy()
        metric = describe(name)
        missing = np.isnan(values)
        if name == "settling_time" and {"duration", "slew_end_time"} <= self.metrics.keys():
            observed = self.metrics["duration"] - self.metrics["slew_end_time"]
            # Of an episode that ended before its slew did, not even a lower bound is known.
            censored = missing & (observed > 0.0)
            values[censored] = observed[censored]
            missing = np.isnan(values)
        values[missing] = -math.inf if metric.better == "higher" else math.inf
        return np.abs(values) if metric.magnitude else values

    def estimate(self, name: str) -> statistics.Estimate:
        """Return the aggregate of one metric in SI: interquartile mean, or a plain fraction."""
        values = self.judged(name)
        if name in _FRACTIONS:
            return statistics.mean_estimate(values)
        return statistics.interquartile_estimate(values)

    def summary(self) -> dict[str, Any]:
        """Return the aggregates of all metrics as plain values for JSON."""
        return {
            "label": self.label,
            "control_period": self.control_period,
            "episodes": len(self),
            "details": dict(self.details),
            "metrics": {
                name: self.estimate(name).to_dict()
                for name in self.metrics
                if name not in ("duration", "slew_end_time")
            },
        }


def headline(flights: Sequence[Episodes]) -> list[str]:
    """Return the headline metrics that all flights have and that say something.

    A metric that is undefined in every episode (nothing flew past the end of the slew) does not.
    """
    return [
        name
        for name in HEADLINE
        if all(name in flight.metrics for flight in flights)
        and any(np.isfinite(flight.judged(name)).any() for flight in flights)
    ]


def comparison(candidate: Episodes, reference: Episodes) -> dict[str, Any]:
    """Return the paired comparison of the headline metrics that both policies have.

    Raises
    ------
    BaselineError
        The two did not fly the same episodes.
    """
    if list(candidate.seeds) != list(reference.seeds):
        raise BaselineError(
            f"{candidate.label!r} and {reference.label!r} flew different episodes: "
            "they cannot be compared in pairs"
        )
    return {
        name: statistics.compare_paired(
            candidate.judged(name),
            reference.judged(name),
            higher_is_better=describe(name).better == "higher",
            trimmed=name not in _FRACTIONS,
        ).to_dict()
        for name in headline([candidate, reference])
    }


def _rows(flights: Sequence[Episodes]) -> tuple[list[str], list[dict[str, Any]]]:
    context = list(dict.fromkeys(name for flight in flights for name in flight.context))
    metrics = list(dict.fromkeys(name for flight in flights for name in flight.metrics))
    columns = [
        "policy",
        "control_period",
        "seed",
        *(f"context/{name}" for name in context),
        *(f"metrics/{name}" for name in metrics),
    ]
    rows = []
    for flight in flights:
        for index, seed in enumerate(flight.seeds):
            row: dict[str, Any] = {
                "policy": flight.label,
                "control_period": flight.control_period,
                "seed": seed,
            }
            for group, values in (("context", flight.context), ("metrics", flight.metrics)):
                for name, column in values.items():
                    row[f"{group}/{name}"] = float(column[index])
            rows.append(row)
    return columns, rows


def write_records(
    path: Path,
    flights: Sequence[Episodes],
    *,
    settings: Mapping[str, Any],
    overwrite: bool = False,
) -> list[Path]:
    """Write one row an episode and policy to ``path`` (``.csv`` or ``.parquet``).

    A missing value is an empty field. ``settings`` goes to ``<name>.settings.json`` beside a CSV
    file and into the metadata of a Parquet file. Returns the files written.

    Raises
    ------
    BaselineError
        Unknown suffix, or Parquet without pyarrow.
    ExistingResultError
        A file exists and ``overwrite`` is false.
    """
    columns, rows = _rows(flights)
    if path.suffix == ".csv":
        beside = path.with_suffix(".settings.json")
        if beside.exists() and not overwrite:
            storage.refuse(beside)
        with (
            storage.atomic_path(path, overwrite=overwrite) as temporary,
            temporary.open("w", newline="", encoding="utf-8") as stream,
        ):
            writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
            writer.writeheader()
            for row in rows:
                writer.writerow(
                    {
                        key: "" if isinstance(value, float) and math.isnan(value) else value
                        for key, value in row.items()
                    }
                )
        return [path, storage.write_json(beside, dict(settings), overwrite=overwrite)]
    if path.suffix == ".parquet":
        with needing("a Parquet file (CSV works without)", "report"):
            pyarrow = importlib.import_module("pyarrow")
            parquet = importlib.import_module("pyarrow.parquet")
        table = pyarrow.table({name: [row.get(name) for row in rows] for name in columns})
        text = json.dumps(storage.plain(dict(settings)), allow_nan=False)
        table = table.replace_schema_metadata({"drm_settings": text})
        with storage.atomic_path(path, overwrite=overwrite) as temporary:
            parquet.write_table(table, temporary)
        return [path]
    raise BaselineError(f"{path}: records are written as .csv or .parquet, not {path.suffix!r}")
