"""What the episodes of a sweep say: figures of each policy, and the map of its tip error.

Only the columns that are needed are read, policy by policy: 40 bytes an episode.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.support import provenance, storage
from drm_baselines.sweep.parts import read_columns
from drm_baselines.sweep.request import Fleet

SUMMARY_FILE = "summary.json"
QUANTILES = (0.5, 0.95, 0.999)
"""Quantiles of the tip error that are stated."""

CELLS = (12, 10)
"""Cells of the map: payload, misreport."""
_LEAST = 3
"""Episodes of which the median of a cell is stated."""

_Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What one policy's episodes say; the tip error is the RMS of an episode, m.

    Attributes
    ----------
    title, episodes
        Who flew how many.
    quantiles
        Of the tip error by level; an episode that diverged counts as infinitely bad.
    median_interval
        Bounds of the median that hold with 95 %: order statistics, whatever the distribution.
    worst, worst_seed
        The largest finite tip error, and the seed of its episode.
    settled, diverged
        Fractions of the episodes.
    cells
        Median of the tip error by payload (rows) and misreport (columns), of shape
        :data:`CELLS`; NaN where fewer than three episodes are.
    """

    title: str
    episodes: int
    quantiles: Mapping[float, float]
    median_interval: tuple[float, float]
    worst: float
    worst_seed: int
    settled: float
    diverged: float
    cells: _Array

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, SI."""
        return {
            "title": self.title,
            "episodes": self.episodes,
            "tip_error_rms": {
                **{f"quantile_{level:g}": value for level, value in self.quantiles.items()},
                "median_ci95": self.median_interval,
                "worst": self.worst,
                "worst_seed": self.worst_seed,
            },
            "settled": self.settled,
            "diverged": self.diverged,
            "median_by_cell": self.cells,
        }


@dataclass(frozen=True, kw_only=True)
class Summary:
    """All policies' figures, with the edges of the map's cells: payload, kg, and misreport."""

    payload_edges: _Array
    error_edges: _Array
    figures: Mapping[str, Figures]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, SI."""
        return {
            "payload_mass_edges": self.payload_edges,
            "mass_error_edges": self.error_edges,
            "policies": {name: each.to_dict() for name, each in self.figures.items()},
        }


def summary_of(directory: Path, fleet: Fleet) -> Summary:
    """Return what the episodes of a sweep say.

    Raises
    ------
    RunError
        A block that is missing or damaged.
    """
    figures: dict[str, Figures] = {}
    edges: tuple[_Array, _Array] | None = None
    for policy, contestant in fleet.contestants.items():
        columns = read_columns(
            directory,
            list(fleet.blocks(policy)),
            ["seed", "payload_mass", "mass_error", "tip_error_rms", "settled", "diverged"],
        )
        if edges is None:  # the manoeuvres are the same for all
            edges = (
                _edges(columns["payload_mass"], CELLS[0]),
                _edges(columns["mass_error"], CELLS[1]),
            )
        figures[policy] = _figures_of(contestant.label, columns, edges)
    assert edges is not None, "somebody flies"
    return Summary(payload_edges=edges[0], error_edges=edges[1], figures=figures)


def _edges(values: _Array, count: int) -> _Array:
    low, high = float(values.min()), float(values.max())
    if low == high:  # it is not drawn
        return np.array([low, np.nextafter(high, math.inf)])
    return np.linspace(low, high, count + 1)


def _figures_of(title: str, columns: Mapping[str, _Array], edges: tuple[_Array, _Array]) -> Figures:
    diverged = columns["diverged"] > 0.0
    error = np.where(diverged | ~np.isfinite(columns["tip_error_rms"]), math.inf,
                     columns["tip_error_rms"])  # fmt: skip
    ordered = np.sort(error)
    count = len(ordered)
    finite = np.where(np.isfinite(error), error, -math.inf)
    worst = int(np.argmax(finite))
    half = 0.98 * math.sqrt(count)  # 1.96 standard deviations of the rank of the median
    low = max(0, math.floor(count / 2 - half))
    high = min(count - 1, math.ceil(count / 2 + half))
    return Figures(
        title=title,
        episodes=count,
        quantiles={level: float(_quantile(ordered, level)) for level in QUANTILES},
        median_interval=(float(ordered[low]), float(ordered[high])),
        worst=float(finite[worst]) if math.isfinite(finite[worst]) else math.nan,
        worst_seed=int(columns["seed"][worst]),
        settled=float(np.mean(columns["settled"])),
        diverged=float(np.mean(diverged)),
        cells=_medians(error, columns["payload_mass"], columns["mass_error"], edges),
    )


def _quantile(ordered: _Array, level: float) -> float:
    # a value that was flown, and no mean of a finite and an infinite one
    return float(ordered[min(len(ordered) - 1, math.ceil(level * len(ordered)) - 1)])


def _medians(error: _Array, payload: _Array, misreport: _Array, edges: Any) -> _Array:
    rows, columns = (
        np.clip(np.searchsorted(edge, values, side="right") - 1, 0, len(edge) - 2)
        for edge, values in zip(edges, (payload, misreport), strict=True)
    )
    shape = (len(edges[0]) - 1, len(edges[1]) - 1)
    cell = rows * shape[1] + columns
    order = np.lexsort((error, cell))
    found = np.full(shape[0] * shape[1], math.nan)
    bounds = np.searchsorted(cell[order], np.arange(len(found) + 1))
    for index, (first, last) in enumerate(itertools.pairwise(bounds)):
        if last - first >= _LEAST:
            found[index] = _quantile(error[order[first:last]], 0.5)
    return found.reshape(shape)


def write_summary(directory: Path, summary: Summary) -> Path:
    """Write the figures as JSON, SI; return the file."""
    content = {"units": "SI", **summary.to_dict(), "provenance": provenance.provenance()}
    return storage.write_json(directory / SUMMARY_FILE, content, overwrite=True)
