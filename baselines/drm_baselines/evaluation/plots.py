"""Figures: manoeuvres over time, comparisons over episodes, learning curves.

A policy looks the same in all of them (:mod:`drm_baselines.policies.names`). Every axis carries its
unit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.evaluation.metrics import describe
from drm_baselines.evaluation.records import Episodes, headline
from drm_baselines.evaluation.statistics import Estimate
from drm_baselines.policies.names import styles, title_of
from drm_baselines.support.figures import (
    plain_log,
    save_figure,
    single,
    subplots,
)
from drm_baselines.support.palette import OKABE_ITO

_DEGREES = 180.0 / np.pi
_Flight = Mapping[str, NDArray[np.float64]]


def _line(style: Mapping[str, Any]) -> dict[str, Any]:
    """A style without its marker, for lines of many points."""
    return {name: value for name, value in style.items() if name != "marker"}


def plot_manoeuvres(
    flights: Mapping[str, Mapping[str, NDArray[np.float64]]],
    path: Path,
    *,
    title: str,
    overwrite: bool = False,
) -> Path:
    """Draw slew error, tip deflection and wheel torques of manoeuvres over time.

    ``flights`` are trajectories by name or label of the policy, as ``drm_env.simulate`` returns
    them; those that diverged are drawn up to there and labelled so.
    """
    figure, grid = subplots(5, 1, size=(9.0, 12.0), sharex=True)
    axes = list(grid[:, 0])
    drawn = styles(list(flights))
    rows: tuple[tuple[str, Callable[[_Flight], NDArray[np.float64]]], ...] = (
        ("slew angle (deg)", lambda f: f["slew_angle"] * _DEGREES),
        ("slew error (deg)", lambda f: (f["slew_angle"] - f["reference_angle"]) * _DEGREES),
        ("tip deflection (mm)", lambda f: f["tip_deflection"] * 1e3),
        ("root wheel torque (N m)", lambda f: f["root_torque"]),
        ("tip wheel torque (N m)", lambda f: f["tip_torque"]),
    )
    for axis, (label, signal) in zip(axes, rows, strict=True):
        for (name, flight), style in zip(flights.items(), drawn, strict=True):
            lost = getattr(flight, "metrics", {}).get("diverged")
            axis.plot(
                flight["time"],
                signal(flight),
                label=f"{title_of(name)} (diverged)" if lost else title_of(name),
                linewidth=1.1,
                **_line(style),
            )
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    reference = max(flights.values(), key=lambda flight: float(flight["time"][-1]))
    axes[0].plot(
        reference["time"],
        reference["reference_angle"] * _DEGREES,
        color=OKABE_ITO["yellow"],
        linewidth=4.0,
        zorder=0,
        label="reference",
    )
    axes[0].legend(fontsize="small", ncols=2)
    axes[-1].set_xlabel("time (s)")
    figure.suptitle(title)
    return save_figure(figure, path, overwrite=overwrite)


def plot_comparison(
    flights: Sequence[Episodes], path: Path, *, title: str, overwrite: bool = False
) -> Path:
    """Draw the headline metrics of each policy as points with their 95 % intervals."""
    names = headline(flights)
    columns = 3
    lines = -(-len(names) // columns)
    figure, axes = subplots(
        lines, columns, size=(13.0, 0.8 + lines * (1.2 + 0.34 * len(flights))), sharey=True
    )
    drawn = styles([flight.label for flight in flights])
    places = np.arange(len(flights))[::-1]
    for axis, name in zip(axes.flat, names, strict=False):
        metric = describe(name)
        for flight, place, style in zip(flights, places, drawn, strict=True):
            shown = flight.estimate(name).scaled(metric.scale)
            if not np.isfinite(shown.value):
                axis.annotate("diverged", (0.5, place), xycoords=("axes fraction", "data"))
                continue
            # A percentile interval need not contain the estimate, least of all by rounding.
            spread = [[max(0.0, shown.value - shown.low)], [max(0.0, shown.high - shown.value)]]
            if not np.isfinite(spread).all():
                spread = [[0.0], [0.0]]
            axis.errorbar(
                shown.value,
                place,
                xerr=spread,
                capsize=4,
                **{**style, "linestyle": "none"},
            )
        axis.set_xlabel(f"{metric.label} ({metric.unit})" if metric.unit else metric.label)
        if metric.unit in ("mm", "deg") and all(
            flight.estimate(name).low > 0.0 for flight in flights
        ):
            axis.set_xscale("log")
        axis.grid(alpha=0.3, which="both", axis="x")
    for axis in axes.flat[len(names) :]:
        axis.set_visible(False)
    axes[0, 0].set_yticks(places, [flight.label for flight in flights])
    axes[0, 0].set_ylim(-0.6, len(flights) - 0.4)
    figure.suptitle(f"{title}\ninterquartile mean and 95 % interval, {len(flights[0])} episodes")
    return save_figure(figure, path, overwrite=overwrite)


def plot_distribution(
    flights: Sequence[Episodes],
    path: Path,
    *,
    metric: str = "tip_error_rms",
    title: str,
    overwrite: bool = False,
) -> Path:
    """Draw which share of episodes stays below a value of ``metric``, for each policy."""
    shown = describe(metric)
    figure, axis = single(size=(8.0, 5.0))
    for flight, style in zip(flights, styles([flight.label for flight in flights]), strict=True):
        values = np.sort(flight.judged(metric) * shown.scale)
        share = np.arange(1, values.size + 1) / values.size
        finite = np.isfinite(values)
        axis.step(values[finite], share[finite], where="post", label=flight.label, **_line(style))
    axis.set_xscale("log")
    axis.set_xlabel(f"{shown.label} ({shown.unit})")
    axis.set_ylabel("share of episodes at or below")
    axis.set_ylim(0.0, 1.02)
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize="small")
    axis.set_title(title)
    return save_figure(figure, path, overwrite=overwrite)


def plot_learning_curve(
    curve: Mapping[str, NDArray[np.float64]],
    bands: Mapping[str, Estimate],
    path: Path,
    *,
    label: str = "learned",
    metric: str = "tip_error_rms",
    title: str,
    overwrite: bool = False,
) -> Path:
    """Draw a metric over training steps and wall time, with laws as horizontal bands.

    All axes are logarithmic; a point before the first step or second is left out.

    Parameters
    ----------
    curve
        Columns of ``evaluations.csv``: ``steps``, ``wall_time`` (s), the metric with ``_low``
        and ``_high``, SI units.
    bands
        Estimates of laws over the same episodes, by label, SI units.
    path, label, metric, title, overwrite
        Where and what to draw; ``label`` is the policy's name or label.
    """
    shown = describe(metric)
    figure, grid = subplots(1, 2, size=(12.0, 4.8), sharey=True)
    axes = list(grid[0])
    own, *others = styles([label, *bands])
    sides = (
        (curve["steps"] / 1e6, "environment steps (millions)"),
        (curve["wall_time"] / 60.0, "training time (min)"),
    )
    for axis, (places, xlabel) in zip(axes, sides, strict=True):
        begun = (curve["steps"] > 0.0) & (places > 0.0)
        axis.plot(places[begun], curve[metric][begun] * shown.scale, label=title_of(label), **own)
        axis.fill_between(
            places[begun],
            curve[f"{metric}_low"][begun] * shown.scale,
            curve[f"{metric}_high"][begun] * shown.scale,
            color=own["color"],
            alpha=0.2,
            linewidth=0.0,
        )
        for (name, estimate), style in zip(bands.items(), others, strict=True):
            band = estimate.scaled(shown.scale)
            axis.axhspan(band.low, band.high, color=style["color"], alpha=0.15, linewidth=0.0)
            axis.axhline(band.value, label=title_of(name), **_line(style))
        axis.set_xlabel(xlabel)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.grid(alpha=0.3, which="both")
        plain_log(axis.xaxis)
    plain_log(axes[0].yaxis)
    axes[0].set_ylabel(f"{shown.label} ({shown.unit})")
    axes[0].legend(fontsize="small")
    figure.suptitle(title)
    return save_figure(figure, path, overwrite=overwrite)
