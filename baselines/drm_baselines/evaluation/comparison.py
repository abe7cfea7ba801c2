"""Policies side by side on the same episodes.

A contestant is a control law, or a trained policy with the task it was trained in (observation,
control period, inner law). All of them fly the same scenarios: those of the environment that the
comparison is about.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from drm_baselines.evaluation.contestants import Arena
from drm_baselines.evaluation.records import Episodes, comparison, write_records
from drm_baselines.support import provenance, storage

FORMAT = "drm-comparison"
FORMAT_VERSION = 1


def report_of(
    flights: Sequence[Episodes], arena: Arena, *, reference: str | None = None
) -> dict[str, Any]:
    """Return the comparison as plain data: aggregates, paired differences, provenance."""
    against = next((flight for flight in flights if flight.label == reference), flights[0])
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "units": "SI and radians",
        "seed": arena.seed,
        "episodes": arena.episodes,
        "environment": {
            "id": arena.env_id,
            "options": dict(arena.options),
            "config": arena.resolved.to_dict(),
        },
        "policies": [flight.summary() for flight in flights],
        "paired": {
            "reference": against.label,
            "candidates": {
                flight.label: comparison(flight, against)
                for flight in flights
                if flight is not against
            },
        },
        "provenance": provenance.provenance(),
    }


def write_comparison(
    directory: Path,
    flights: Sequence[Episodes],
    report: Mapping[str, Any],
    *,
    title: str,
    overwrite: bool,
) -> list[Path]:
    """Write report, records and figures of a comparison into ``directory``; return the files."""
    from drm_baselines.evaluation import plots

    settings = {name: value for name, value in report.items() if name not in ("policies", "paired")}
    settings["policies"] = [
        {"label": flight.label, "details": dict(flight.details)} for flight in flights
    ]
    files = [
        storage.write_json(directory / "comparison.json", dict(report), overwrite=overwrite),
        *write_records(directory / "episodes.csv", flights, settings=settings, overwrite=overwrite),
    ]
    for name, draw in (
        ("comparison.png", plots.plot_comparison),
        ("tip_error.png", plots.plot_distribution),
    ):
        draw(flights, directory / name, title=title, overwrite=overwrite)
        files.append(directory / name)
    return files
