"""The HTML page of the benchmark: one file with everything in it."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

import jinja2

from drm_baselines.benchmark.records import SuiteResult
from drm_baselines.benchmark.report.plots import axis_label
from drm_baselines.benchmark.report.tables import (
    degradation_of,
    headings_of,
    label_of,
    notes,
    policies_in,
    rows_of,
)
from drm_baselines.benchmark.report.targets import MARGIN, targets
from drm_baselines.errors import BaselineError
from drm_baselines.support import provenance, storage

METHOD = (
    "Every policy flies the same frozen manoeuvres; one evaluator computes the metrics from the "
    "engine's states.",
    "Figures are interquartile means over all training seeds and episodes, fractions are means. "
    "No training seed is left out.",
    "Intervals are 95 % percentile intervals of a bootstrap that draws training seeds, and "
    "episodes within each stratum, with replacement; all policies meet the same drawn episodes.",
    "An episode that never settles counts with the whole time after the slew. A diverged episode "
    "counts as infinitely bad.",
    "Targets are judged by ratios and paired differences over the episodes that both policies "
    "flew: met or missed when the whole 95 % interval says so, else the two cannot be told apart. "
    f"Not worse means worse by at most {100 * MARGIN:g} % of the law's figure.",
)
"""How the figures come about, sentence by sentence."""


# --- page and Markdown files ----------------------------------------------------------------------


def _data_uri(path: Path) -> str:
    try:
        return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
    except OSError as error:
        raise BaselineError(f"figure {path} cannot be read: {error}") from error


def write_page(
    results: Sequence[SuiteResult],
    path: Path,
    figures: Mapping[str, Path],
    *,
    overwrite: bool = False,
) -> Path:
    """Write one HTML page that needs no other file: tables, targets, figures, how it was made.

    Parameters
    ----------
    results
        The suites, in their order on the page.
    path
        File to write; returned.
    figures
        PNG files by caption; they are put into the page.
    overwrite
        Whether a file may be replaced.

    Raises
    ------
    BaselineError
        A figure that cannot be read.
    ExistingResultError
        ``path`` exists and ``overwrite`` is false.
    """
    source = resources.files(__package__).joinpath("page.html.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    headings, rows, starred = degradation_of(results)
    text = environment.from_string(source).render(
        suites=[
            {
                "label": label_of(result),
                "headings": headings_of(),
                "rows": rows_of(result),
                "notes": notes(result),
                "targets": targets(result),
            }
            for result in results
        ],
        degradation={
            "headings": headings,
            "rows": rows,
            "label": axis_label(),
            "starred": starred,
        },
        figures=[(caption, _data_uri(picture)) for caption, picture in figures.items()],
        method=METHOD,
        policies=[
            (record.title, json.dumps(storage.plain(dict(record.details)), indent=2))
            for record in policies_in(results).values()
        ],
        provenance=json.dumps(storage.plain(provenance.provenance()), indent=2),
    )
    return storage.write_text(path, text, overwrite=overwrite)
