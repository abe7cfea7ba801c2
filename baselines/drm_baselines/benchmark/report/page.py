"""The HTML page of the benchmark: one file with everything in it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drm_baselines.benchmark.estimates import estimate_of, judged
from drm_baselines.benchmark.records import Record, SuiteResult
from drm_baselines.benchmark.report.plots import axis_label
from drm_baselines.benchmark.report.ranking import (
    JUDGE,
    bound_of,
    episodes_flown,
    flew_part,
    ordered,
)
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
from drm_baselines.evaluation.metrics import HEADLINE, describe
from drm_baselines.pages import writer
from drm_baselines.pages.blocks import (
    Block,
    Cell,
    Data,
    Folded,
    Interval,
    Intervals,
    Page,
    Picture,
    Section,
    Table,
    Text,
    Verdicts,
)
from drm_baselines.policies.names import dash_of, styles
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

SHARES = 400
"""Most points of a profile: so many shares of all runs."""

_TONES = {"met": "good", "missed": "bad"}


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise BaselineError(f"figure {path} cannot be read: {error}") from error


def _intervals(result: SuiteResult) -> Intervals:
    """The judging metric of every policy with its interval, the bound as a line."""
    scale = describe(JUDGE).scale
    flown, bound = episodes_flown(result), bound_of(result)
    records = [record for record in ordered(result) if JUDGE in record.metrics]
    rows = []
    for record, look in zip(records, styles([one.policy for one in records]), strict=True):
        found = estimate_of(record, JUDGE)
        few = flew_part(record, flown)
        rows.append(
            Interval(
                label=f"{record.title} *" if few else record.title,
                colour=look["color"],
                value=found.value * scale,
                low=found.interval[0] * scale,
                high=found.interval[1] * scale,
                hollow=few,
            )
        )
    line = None
    if bound is not None and JUDGE in bound.metrics:
        value = estimate_of(bound, JUDGE).value * scale
        line = value if math.isfinite(value) and value > 0.0 else None
    return Intervals(
        axis=f"{axis_label()}: interquartile mean, 95 % interval", rows=rows, line=line
    )


def _profiles(result: SuiteResult) -> Data:
    """Every metric of all runs (seeds x episodes) in order, policy by policy."""
    records = list(ordered(result))
    names = [name for name in HEADLINE if name != "settled"]
    metrics = []
    for name in names:
        if not all(name in record.metrics for record in records):
            continue
        metric = describe(name)
        values = []
        for record in records:
            runs = np.sort(judged(record, name), axis=None) * metric.scale
            if runs.size > SHARES:
                places = np.linspace(0, runs.size - 1, SHARES).round().astype(int)
                runs = runs[places]
            values.append([float(f"{v:.4g}") if math.isfinite(v) else None for v in runs.tolist()])
        metrics.append({"label": metric.label, "unit": metric.unit, "values": values})
    looks = styles([record.policy for record in records])
    return Data(
        script="episodes",
        content={
            "metrics": metrics,
            "columns": [{"label": "share of all runs, in order", "unit": "%", "values": None}],
            "seeds": [],
            "policies": [
                {
                    "label": record.title,
                    "colour": look["color"],
                    "dash": list(dash_of(look["linestyle"])),
                }
                for record, look in zip(records, looks, strict=True)
            ],
        },
        note=(
            "All training seeds and episodes of a policy, from the best to the worst: how large "
            f"the metric is at most in that share of them. Drawn at {SHARES} shares where there "
            "are more runs. Diverged runs have no value and are not drawn."
        ),
    )


def _suite_table(result: SuiteResult) -> Table:
    """The table of a suite; intervals stand below their figures."""
    looks = styles([record.policy for record in ordered(result)])
    rows = []
    for cells, look in zip(rows_of(result), looks, strict=True):
        title, *others = cells
        line = [Cell(text=title, colour=look["color"], dash=dash_of(look["linestyle"]))]
        for text in others:
            value, _, spread = text.partition(" [")
            line.append(Cell(text=value, detail=spread.removesuffix("]").replace(", ", " to ")))
        rows.append(line)
    return Table(
        headings=[Cell(text=heading) for heading in headings_of()],
        rows=rows,
        left=2,
        sortable=True,
    )


def _suite_section(result: SuiteResult) -> Section:
    parts: list[Block] = []
    if any(JUDGE in record.metrics for record in result.records):
        parts.append(_intervals(result))
    parts += [_suite_table(result), Text(lines=notes(result), listed=True)]
    told = [(text, verdict, _TONES.get(verdict, "plain")) for text, verdict in targets(result)]
    if told:
        parts += [Text(lines=["Targets:"]), Verdicts(rows=told)]
    if any(JUDGE in record.metrics for record in result.records):
        parts.append(_profiles(result))
    return Section(
        name=f"suite-{result.suite}", title=label_of(result), brief=result.suite, blocks=parts
    )


def _made(record: Record) -> Folded:
    return Folded(
        title=record.title, text=json.dumps(storage.plain(dict(record.details)), indent=2)
    )


def write_page(
    results: Sequence[SuiteResult],
    path: Path,
    figures: Mapping[str, Path],
    *,
    flights: Data | None = None,
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
    flights
        Flights of one manoeuvre, see `drm_baselines.pages.flights`.
    overwrite
        Whether a file may be replaced.

    Raises
    ------
    BaselineError
        A figure that cannot be read.
    ExistingResultError
        ``path`` exists and ``overwrite`` is false.
    """
    sections = [_suite_section(result) for result in results]
    if len(results) > 1:
        headings, rows, starred = degradation_of(results)
        looks = styles(list(policies_in(results)))
        lines: list[list[Cell | str]] = [
            [Cell(text=title, colour=look["color"], dash=dash_of(look["linestyle"])), *cells]
            for (title, *cells), look in zip(rows, looks, strict=True)
        ]
        sections.append(
            Section(
                name="degradation",
                title=f"From suite to suite: {axis_label()}",
                brief="From suite to suite",
                blocks=[
                    Table(
                        headings=[Cell(text=heading) for heading in headings],
                        rows=lines,
                        sortable=True,
                        note="* on fewer episodes than the others." if starred else "",
                    )
                ],
            )
        )
    if flights is not None:
        sections.append(
            Section(
                name="flights",
                title="One manoeuvre: the first of the first suite",
                subtitle="Under everybody but the bound and the controllers that plan ahead.",
                brief="One manoeuvre",
                blocks=[flights],
            )
        )
    for place, (caption, picture) in enumerate(figures.items()):
        sections.append(
            Section(
                name=f"figure-{place + 1}",
                title=caption,
                blocks=[Picture(data=_content(picture), title=caption)],
            )
        )
    sections.append(
        Section(
            name="made",
            title="How this was made",
            blocks=[
                Text(lines=METHOD, listed=True),
                Folded(
                    title="Versions and machine",
                    text=json.dumps(storage.plain(provenance.provenance()), indent=2),
                ),
                *(_made(record) for record in policies_in(results).values()),
            ],
        )
    )
    page = Page(
        title="drm benchmark",
        subtitle=", ".join(label_of(result) for result in results),
        sections=sections,
    )
    return writer.write_page(page, path, overwrite=overwrite)
