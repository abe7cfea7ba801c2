"""Figures: manoeuvres over time, comparisons over episodes, learning curves.

A policy looks the same in all of them (:mod:`drm_baselines.policies.names`). Every axis carries its
unit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.evaluation.metrics import describe
from drm_baselines.evaluation.records import Episodes, headline
from drm_baselines.evaluation.statistics import Estimate
from drm_baselines.pages.flights import tip_error
from drm_baselines.policies.names import styles, title_of
from drm_baselines.support.extras import needing
from drm_baselines.support.figures import (
    axes_for,
    plain_log,
    save_figure,
    titled,
)
from drm_baselines.support.palette import OKABE_ITO

with needing("a picture", "plot"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, NullLocator

_DEGREES = 180.0 / np.pi
_Flight = Mapping[str, NDArray[np.float64]]


def _line(style: Mapping[str, Any]) -> dict[str, Any]:
    """A style without its marker, for lines of many points."""
    return {name: value for name, value in style.items() if name != "marker"}


_PIECES = 400
"""Into how many pieces a curve is cut to see where it cannot be seen."""
_WINDOW = 8
"""Pieces on both sides that a piece is seen with: together a twenty-fifth of the axis."""
_TURNS = 8
"""Turns within a window above which a curve is drawn as a band: they cannot be told apart."""


def _windows(values: NDArray[np.float64], half: int) -> NDArray[np.float64]:
    """Every value with ``half`` neighbours on both sides, shape (n, 2 * half + 1)."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, half, mode="edge"), 2 * half + 1)


def _turns(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Samples at which a curve turns back, after a way of a hundredth of its range at least."""
    level = 0.01 * (float(np.nanmax(values)) - float(np.nanmin(values)))
    corners = np.flatnonzero(np.diff(np.sign(np.diff(values))) != 0) + 1
    found: list[int] = []
    last, direction = values[0], 0.0
    for place in corners.tolist():
        way = values[place] - last
        if abs(way) <= level:
            continue
        # the way went on: the turn before was none
        if found and np.sign(way) == direction:
            found.pop()
        found.append(place)
        last, direction = values[place], float(np.sign(way))
    return np.array(found, dtype=np.int64)


def _draw_signal(
    axis: Axes, time: NDArray[np.float64], values: NDArray[np.float64], style: Mapping[str, Any]
) -> None:
    """Draw a curve; where it turns too often to be seen, a pale band between its peaks."""
    line = _line(style)
    finite = np.isfinite(values)
    time, values = time[finite], values[finite]
    if time.size < 2 * _PIECES:
        axis.plot(time, values, linewidth=1.2, **line)
        return
    edges = np.linspace(0, time.size, _PIECES + 1).round().astype(int)[:-1]
    turns = np.bincount(
        np.searchsorted(edges, _turns(values), side="right") - 1, minlength=_PIECES
    ).astype(np.float64)
    dense = _windows(turns, _WINDOW).sum(axis=1) > _TURNS
    dense &= _windows(turns, 2).sum(axis=1) > 0.0
    # a band that is shorter than what it is seen with would only make gaps
    dense = _windows(dense.astype(np.float64), 2).max(axis=1) > 0.0
    low, high = np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)
    # closed over half a window, so that the band does not follow the very turns it stands for
    half = _WINDOW // 2
    high = _windows(_windows(high, half).max(axis=1), half).min(axis=1)
    low = _windows(_windows(low, half).min(axis=1), half).max(axis=1)
    centres = time[np.minimum(edges + time.size // _PIECES // 2, time.size - 1)]
    axis.fill_between(
        centres, low, high, where=dense.tolist(), color=line["color"], alpha=0.22, linewidth=0.0
    )
    for edge in (low, high):
        axis.plot(centres, np.where(dense, edge, np.nan), linewidth=0.8, color=line["color"])
    inner = _windows(dense.astype(np.float64), 1).min(axis=1) > 0.0
    hidden = inner[np.searchsorted(edges, np.arange(time.size), side="right") - 1]
    axis.plot(time, np.where(hidden, np.nan, values), linewidth=1.2, **line)


_ROWS: tuple[tuple[str, Callable[[_Flight, float], NDArray[np.float64]]], ...] = (
    ("slew angle (deg)", lambda f, _: f["slew_angle"] * _DEGREES),
    ("tip error r e + y (mm)", lambda f, link1: tip_error(f, link1) * 1e3),
    ("tip deflection y (mm)", lambda f, _: f["tip_deflection"] * 1e3),
    ("root wheel torque (N m)", lambda f, _: f["root_torque"]),
    ("tip wheel torque (N m)", lambda f, _: f["tip_torque"]),
)
_LINEAR = 1.0
"""Up to where the axes of errors are linear, mm."""


def _error_axis(axis: Axes, flights: Sequence[NDArray[np.float64]]) -> None:
    """Make an axis of errors (mm) linear around zero and logarithmic further out, if need be."""
    sizes = [float(np.nanmax(np.abs(values), initial=0.0)) for values in flights]
    largest = max(sizes, default=0.0)
    if largest < 20.0:
        return
    axis.set_yscale("symlog", linthresh=_LINEAR, linscale=0.6)
    decades = range(math.ceil(math.log10(largest)) + 1)
    ticks = [10.0**decade for decade in decades]
    axis.set_yticks([*(-tick for tick in reversed(ticks)), 0.0, *ticks])
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.yaxis.set_minor_locator(NullLocator())
    low = min(float(np.nanmin(values, initial=0.0)) for values in flights)
    high = max(float(np.nanmax(values, initial=0.0)) for values in flights)
    axis.set_ylim(min(1.6 * low, -_LINEAR), max(1.6 * high, _LINEAR))


def plot_manoeuvres(
    flights: Mapping[str, Mapping[str, NDArray[np.float64]]],
    path: Path | None = None,
    *,
    title: str,
    link1: float = drm_env.Scenario().arm.link1.length,
    ax: Sequence[Axes] | None = None,
    overwrite: bool = False,
) -> Figure:
    """Draw slew angle, tip error, deflection and wheel torques of manoeuvres over time.

    A curve that turns too often to be seen is drawn as a pale band between its peaks. The axes of
    errors are linear up to 1 mm and logarithmic beyond.

    Parameters
    ----------
    flights
        Trajectories by name or label of the policy, as ``drm_env.simulate`` returns them; those
        that diverged are drawn up to there and labelled so.
    path
        File to write, if any.
    title
        What is above the figure.
    link1
        Length of link 1, m.
    ax
        Five axes to draw in, from top to bottom; a new figure by default.
    overwrite
        Whether a file may be replaced.

    Returns
    -------
    figure
        What has been drawn.
    """
    figure, grid = axes_for(ax, len(_ROWS), 1, size=(9.0, 12.5), sharex=True)
    axes = list(grid[:, 0])
    drawn = styles(list(flights))
    for place, (axis, (label, signal)) in enumerate(zip(axes, _ROWS, strict=True)):
        curves = [
            np.where(_possible(flight, link1), signal(flight, link1), np.nan)
            for flight in flights.values()
        ]
        for flight, values, style in zip(flights.values(), curves, drawn, strict=True):
            _draw_signal(axis, flight["time"], values, style)
        if "(mm)" in label:
            _error_axis(axis, curves)
            axis.axhline(0.0, color="0.4", linewidth=0.7)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        if place == 0:
            for name, style in zip(flights, drawn, strict=True):
                lost = getattr(flights[name], "metrics", {}).get("diverged")
                shown = f"{title_of(name)} (diverged)" if lost else title_of(name)
                axis.plot([], [], label=shown, linewidth=1.6, **_line(style))
    reference = max(flights.values(), key=lambda flight: float(flight["time"][-1]))
    axes[0].plot(
        reference["time"],
        reference["reference_angle"] * _DEGREES,
        color=OKABE_ITO["yellow"],
        linewidth=5.0,
        zorder=0,
        label="reference",
    )
    axes[0].legend(fontsize="small", ncols=2)
    axes[-1].set_xlabel("time (s)")
    titled(figure, grid, title, own=ax is None)
    if path is not None:
        save_figure(figure, path, overwrite=overwrite)
    return figure


def _possible(flight: _Flight, link1: float) -> NDArray[np.bool_]:
    """Where an arm can be in these states: not after a flight has begun to diverge."""
    reach = link1 + flight["extension"]
    return np.asarray(np.abs(flight["tip_deflection"]) <= 0.25 * np.abs(reach))


def plot_comparison(
    flights: Sequence[Episodes],
    path: Path | None = None,
    *,
    title: str,
    ax: Axes | Sequence[Axes] | None = None,
    overwrite: bool = False,
) -> Figure:
    """Draw the headline metrics of each policy as points with their 95 % intervals.

    The figure is written to ``path``, if there is one. ``ax`` are axes to draw in, one a metric
    of `drm_baselines.evaluation.records.headline`, in rows of three with the last row filled up.
    """
    names = headline(flights)
    columns = 3
    lines = -(-len(names) // columns)
    size = (13.0, 0.8 + lines * (1.2 + 0.34 * len(flights)))
    figure, axes = axes_for(ax, lines, columns, size=size, sharey=True)
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
    told = f"{title}\ninterquartile mean and 95 % interval, {len(flights[0])} episodes"
    titled(figure, axes, told, own=ax is None)
    if path is not None:
        save_figure(figure, path, overwrite=overwrite)
    return figure


def plot_distribution(
    flights: Sequence[Episodes],
    path: Path | None = None,
    *,
    metric: str = "tip_error_rms",
    title: str,
    ax: Axes | None = None,
    overwrite: bool = False,
) -> Figure:
    """Draw which share of episodes stays below a value of ``metric``, for each policy.

    The figure is written to ``path``, if there is one; ``ax`` are axes to draw in.
    """
    shown = describe(metric)
    figure, grid = axes_for(ax, size=(8.0, 5.0))
    axis = grid[0, 0]
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
    if path is not None:
        save_figure(figure, path, overwrite=overwrite)
    return figure


def plot_learning_curve(
    curve: Mapping[str, NDArray[np.float64]],
    bands: Mapping[str, Estimate],
    path: Path | None = None,
    *,
    label: str = "learned",
    metric: str = "tip_error_rms",
    title: str,
    ax: Sequence[Axes] | None = None,
    overwrite: bool = False,
) -> Figure:
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
    ax
        Two axes to draw in, steps and time; a new figure by default.
    """
    shown = describe(metric)
    figure, grid = axes_for(ax, 1, 2, size=(12.0, 4.8), sharey=True)
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
    titled(figure, grid, title, own=ax is None)
    if path is not None:
        save_figure(figure, path, overwrite=overwrite)
    return figure
