"""Figures: manoeuvres over time, comparisons over episodes, learning curves.

Drawn without a display (Agg). Colours are those of Okabe and Ito, which stay apart for the
colour-blind; line styles differ as well. Every axis carries its unit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from drm_baselines import storage
from drm_baselines.metrics import describe
from drm_baselines.records import Episodes, headline
from drm_baselines.statistics import Estimate

_COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_STYLES = ("-", "--", "-.", ":")
_DEGREES = 180.0 / np.pi
_Flight = Mapping[str, NDArray[np.float64]]


def _style(index: int) -> dict[str, Any]:
    return {
        "color": _COLOURS[index % len(_COLOURS)],
        "linestyle": _STYLES[(index // len(_COLOURS) + index) % len(_STYLES)],
    }


def save_figure(figure: Figure, path: Path, *, overwrite: bool) -> Path:
    """Write a figure under a temporary name, rename it, close the figure; return ``path``."""
    try:
        with storage.atomic_path(path, overwrite=overwrite) as temporary:
            figure.savefig(temporary, dpi=130)
    finally:
        plt.close(figure)
    return path


def plot_manoeuvres(
    flights: Mapping[str, Mapping[str, NDArray[np.float64]]],
    path: Path,
    *,
    title: str,
    overwrite: bool = False,
) -> Path:
    """Draw slew error, tip deflection and wheel torques of manoeuvres over time.

    ``flights`` are trajectories by label, with the signals that ``drm_env.simulate`` returns.
    """
    figure, axes = plt.subplots(5, 1, figsize=(9.0, 12.0), sharex=True, layout="constrained")
    rows: tuple[tuple[str, Callable[[_Flight], NDArray[np.float64]]], ...] = (
        ("slew angle (deg)", lambda f: f["slew_angle"] * _DEGREES),
        ("slew error (deg)", lambda f: (f["slew_angle"] - f["reference_angle"]) * _DEGREES),
        ("tip deflection (mm)", lambda f: f["tip_deflection"] * 1e3),
        ("root wheel torque (N m)", lambda f: f["root_torque"]),
        ("tip wheel torque (N m)", lambda f: f["tip_torque"]),
    )
    for axis, (label, signal) in zip(axes, rows, strict=True):
        for index, (name, flight) in enumerate(flights.items()):
            axis.plot(flight["time"], signal(flight), label=name, linewidth=1.1, **_style(index))
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    reference = next(iter(flights.values()))
    axes[0].plot(
        reference["time"],
        reference["reference_angle"] * _DEGREES,
        color="0.6",
        linewidth=3.0,
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
    figure, axes = plt.subplots(
        lines,
        columns,
        figsize=(13.0, 0.8 + lines * (1.2 + 0.34 * len(flights))),
        layout="constrained",
        squeeze=False,
        sharey=True,
    )
    places = np.arange(len(flights))[::-1]
    for axis, name in zip(axes.flat, names, strict=False):
        metric = describe(name)
        for index, (flight, place) in enumerate(zip(flights, places, strict=True)):
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
                fmt="o",
                capsize=4,
                color=_COLOURS[index % len(_COLOURS)],
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
    figure, axis = plt.subplots(figsize=(8.0, 5.0), layout="constrained")
    for index, flight in enumerate(flights):
        values = np.sort(flight.judged(metric) * shown.scale)
        share = np.arange(1, values.size + 1) / values.size
        finite = np.isfinite(values)
        axis.step(values[finite], share[finite], where="post", label=flight.label, **_style(index))
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
    metric: str = "tip_error_rms",
    title: str,
    overwrite: bool = False,
) -> Path:
    """Draw a metric over training steps and wall time, with laws as horizontal bands.

    Parameters
    ----------
    curve
        Columns of ``evaluations.csv``: ``steps``, ``wall_time`` (s), the metric with ``_low``
        and ``_high``, SI units.
    bands
        Estimates of laws over the same episodes, by label, SI units.
    path, metric, title, overwrite
        Where and what to draw.
    """
    shown = describe(metric)
    figure, axes = plt.subplots(1, 2, figsize=(12.0, 4.8), sharey=True, layout="constrained")
    sides = (
        (curve["steps"] / 1e6, "environment steps (millions)"),
        (curve["wall_time"] / 60.0, "training time (min)"),
    )
    for axis, (places, label) in zip(axes, sides, strict=True):
        axis.plot(
            places, curve[metric] * shown.scale, marker="o", color=_COLOURS[2], label="learned"
        )
        axis.fill_between(
            places,
            curve[f"{metric}_low"] * shown.scale,
            curve[f"{metric}_high"] * shown.scale,
            color=_COLOURS[2],
            alpha=0.2,
            linewidth=0.0,
        )
        for index, (name, estimate) in enumerate(bands.items()):
            colour = _COLOURS[(0, 1, 3, 4)[index % 4]]
            band = estimate.scaled(shown.scale)
            axis.axhspan(band.low, band.high, color=colour, alpha=0.15, linewidth=0.0)
            axis.axhline(band.value, color=colour, linestyle=_STYLES[1 + index % 3], label=name)
        axis.set_xlabel(label)
        axis.set_yscale("log")
        axis.grid(alpha=0.3, which="both")
    axes[0].set_ylabel(f"{shown.label} ({shown.unit})")
    axes[0].legend(fontsize="small")
    figure.suptitle(title)
    return save_figure(figure, path, overwrite=overwrite)
