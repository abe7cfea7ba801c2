"""Comparison tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from drm_baselines.metrics import HEADLINE, Metric, describe
from drm_baselines.records import Episodes
from drm_baselines.statistics import Estimate


def number(value: float, digits: int) -> str:
    """Return a value with ``digits`` decimals, or a dash for what is not a number."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return f"{value:.{digits}f}"


def interval(estimate: Estimate, metric: Metric) -> str:
    """Return ``value [low, high]`` in the metric's display unit."""
    shown = estimate.scaled(metric.scale)
    digits = metric.digits
    return (
        f"{number(shown.value, digits)} [{number(shown.low, digits)}, {number(shown.high, digits)}]"
    )


def _heading(name: str) -> str:
    metric = describe(name)
    return f"{metric.label}\n({metric.unit})" if metric.unit else metric.label


def comparison_table(flights: Sequence[Episodes], *, title: str) -> Table:
    """Return one row a policy: interquartile means with their 95 % intervals.

    The settling time counts censored episodes with the time observed (see
    :meth:`drm_baselines.records.Episodes.judged`), so it reads beside the settled fraction.
    """
    names = [name for name in HEADLINE if all(name in flight.metrics for flight in flights)]
    table = Table(title=title, title_justify="left", header_style="bold")
    table.add_column("policy")
    table.add_column("decides\nevery", justify="right")
    for name in names:
        table.add_column(_heading(name), justify="right")
    for flight in flights:
        table.add_row(
            flight.label,
            f"{flight.control_period * 1e3:g} ms",
            *(interval(flight.estimate(name), describe(name)) for name in names),
        )
    table.caption = (
        f"Interquartile mean over {len(flights[0])} episodes with its 95 % bootstrap interval; "
        "settled: mean. An episode that never settles counts with the whole time after the slew."
    )
    table.caption_justify = "left"
    return table


def metrics_table(rows: Mapping[str, Mapping[str, float]], *, title: str) -> Table:
    """Return one row a flight with the values of single manoeuvres (no statistics)."""
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
        table.add_row(label, *cells)
    return table


def paired_table(comparison: Mapping[str, Mapping[str, Any]], *, title: str) -> Table:
    """Return the paired differences of :func:`drm_baselines.records.comparison`."""
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
