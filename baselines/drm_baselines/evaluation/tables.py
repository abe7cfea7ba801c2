"""Comparison tables for the terminal."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from drm_baselines.evaluation.metrics import Metric, describe
from drm_baselines.evaluation.records import Episodes, headline
from drm_baselines.evaluation.statistics import Estimate
from drm_baselines.policies.names import title_of
from drm_baselines.support.extras import needing

with needing("a table", "cli"):
    from rich.table import Table

_WIDE = 128


def number(value: float, digits: int) -> str:
    """Return a value with ``digits`` decimals, or a dash for what is not a number."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return f"{value:.{digits}f}"


def interval(estimate: Estimate, metric: Metric, *, separator: str = " ") -> str:
    """Return ``value [low, high]`` in the metric's display unit."""
    shown = estimate.scaled(metric.scale)
    digits = metric.digits
    return (
        f"{number(shown.value, digits)}{separator}"
        f"[{number(shown.low, digits)}, {number(shown.high, digits)}]"
    )


def _heading(name: str) -> str:
    metric = describe(name)
    words = [*metric.label.split(), f"({metric.unit})"] if metric.unit else metric.label.split()
    return "\n".join(textwrap.wrap(" ".join(words), 11, break_long_words=False))


def comparison_tables(flights: Sequence[Episodes], *, title: str, width: int) -> list[Table]:
    """Return one row a policy: interquartile means with their 95 % intervals below.

    The settling time counts censored episodes with the time observed (see
    :meth:`drm_baselines.evaluation.records.Episodes.judged`), so it reads beside the settled
    fraction.
    On a terminal narrower than ``_WIDE`` characters the columns come as two tables.
    """
    names = headline(flights)
    half = -(-len(names) // 2)
    groups = [names] if width >= _WIDE else [names[:half], names[half:]]
    tables = []
    for group in groups:
        table = Table(title_justify="left", header_style="bold", show_lines=False)
        table.add_column("policy", min_width=14)
        table.add_column("decides\nevery", justify="right", no_wrap=True)
        for name in group:
            table.add_column(_heading(name), justify="right", no_wrap=True)
        for flight in flights:
            cells = (
                interval(flight.estimate(name), describe(name), separator="\n") for name in group
            )
            table.add_row(flight.label, f"{flight.control_period * 1e3:g} ms", *cells)
        tables.append(table)
    tables[0].title = title
    tables[-1].caption = (
        f"Interquartile mean over {len(flights[0])} episodes with its 95 % bootstrap interval; "
        "settled: mean. An episode that never settles counts with the whole time after the slew."
    )
    tables[-1].caption_justify = "left"
    return tables


def metrics_table(rows: Mapping[str, Mapping[str, float]], *, title: str) -> Table:
    """Return one row a flight with the values of single manoeuvres (no statistics).

    ``rows`` are metrics by the policy's name or any other label.
    """
    shown = (
        "peak_slew_angle", "final_slew_error", "tip_error_rms", "peak_deflection",
        "residual_rms", "settling_time", "wheel_effort",
    )  # fmt: skip
    names = [name for name in shown if all(name in row for row in rows.values())]
    table = Table(title=title, title_justify="left", header_style="bold")
    table.add_column("flight")
    for name in names:
        table.add_column(_heading(name), justify="right")
    for label, row in rows.items():
        cells = []
        for name in names:
            metric = describe(name)
            value = float(row[name])
            if name == "settling_time" and math.isnan(value):
                cells.append("never")
            else:
                cells.append(number(value * metric.scale, metric.digits))
        table.add_row(title_of(label), *cells)
    return table


def paired_table(comparison: Mapping[str, Mapping[str, Any]], *, title: str) -> Table:
    """Return the paired differences of :func:`drm_baselines.evaluation.records.comparison`."""
    table = Table(title=title, title_justify="left", header_style="bold")
    table.add_column("metric")
    table.add_column("difference", justify="right")
    table.add_column("probability of\nimprovement", justify="right")
    table.add_column("verdict")
    for name, entry in comparison.items():
        metric = describe(name)
        difference = Estimate(**entry["difference"]).scaled(metric.scale)
        improvement = Estimate(**entry["probability_of_improvement"])
        digits = metric.digits
        table.add_row(
            f"{metric.label} ({metric.unit})",
            f"{difference.value:+.{digits}f} "
            f"[{difference.low:+.{digits}f}, {difference.high:+.{digits}f}]",
            f"{improvement.value:.2f} [{improvement.low:.2f}, {improvement.high:.2f}]",
            str(entry["verdict"]),
        )
    return table
