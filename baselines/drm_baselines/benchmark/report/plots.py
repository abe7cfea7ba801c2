"""The pictures of the benchmark."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_baselines.benchmark.estimates import (
    Estimate,
    estimate_of,
    judged,
    restricted,
)
from drm_baselines.benchmark.records import Record, SuiteResult
from drm_baselines.benchmark.report.ranking import (
    JUDGE,
    bound_of,
    episodes_flown,
    flew_part,
    ordered,
)
from drm_baselines.benchmark.report.tables import degradation_of, label_of, policies_in
from drm_baselines.evaluation.metrics import describe
from drm_baselines.evaluation.statistics import interquartile_mean
from drm_baselines.policies.names import POLICIES, styles
from drm_baselines.support.extras import needing
from drm_baselines.support.figures import axes_for, plain_log, save_figure, titled

with needing("a picture", "plot"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# --- figures --------------------------------------------------------------------------------------


def axis_label(name: str = JUDGE) -> str:
    """Return a metric with its unit, as an axis is called."""
    metric = describe(name)
    return f"{metric.label} ({metric.unit})"


def _legend(figure: Figure, axis: Axes, *, own: bool) -> None:
    """Beside the axes in a figure of our own, within axes that somebody gave."""
    if own:
        figure.legend(loc="outside right upper", fontsize="small")
    else:
        axis.legend(fontsize="small")


def _judged_records(result: SuiteResult) -> list[Record]:
    return [record for record in ordered(result) if JUDGE in record.metrics]


def _episodes(record: Record, flown: int) -> str:
    return f"{len(record.episodes):,} of {flown:,} episodes"


def plot_suite(
    result: SuiteResult,
    path: Path | None = None,
    *,
    ax: Axes | None = None,
    overwrite: bool = False,
) -> Figure:
    """Draw the tip error RMS of every policy with its 95 % interval, the bound as a line.

    The axis is logarithmic. A policy that flew fewer episodes than others is drawn hollow, with
    their number; a vertical stroke in its row is the bound on these same episodes. The figure is
    written to ``path``, if there is one; ``ax`` are axes to draw in.
    """
    scale = describe(JUDGE).scale
    records, bound, flown = _judged_records(result), bound_of(result), episodes_flown(result)
    drawn = styles([record.policy for record in records])
    fig, grid = axes_for(ax, size=(9.0, 1.6 + 0.42 * len(records)))
    axis = grid[0, 0]
    axis.set_xscale("log")
    names = []
    for place, record, style in zip(range(len(records)), records, drawn, strict=True):
        few = flew_part(record, flown)
        kind = "" if record.title == record.kind else f" ({record.kind})"
        names.append(f"{record.title}{kind}" + (f"\n{_episodes(record, flown)}" if few else ""))
        found = estimate_of(record, JUDGE)
        value, (low, high) = found.value * scale, (edge * scale for edge in found.interval)
        if not math.isfinite(value):
            axis.annotate("diverged", (0.5, place), xycoords=("axes fraction", "data"))
            continue
        if record is bound:
            axis.axvline(value, color=style["color"], linestyle="--", linewidth=1.0)
        elif few and bound is not None and np.isin(record.episodes, bound.episodes).all():
            same = estimate_of(restricted(bound, record.episodes), JUDGE).value * scale
            colour = POLICIES["bound"].colour
            axis.plot([same, same], [place - 0.32, place + 0.32], color=colour, linewidth=1.6)
        # A percentile interval need not contain the estimate; an infinite end is not drawn.
        spread = [max(0.0, value - low), max(0.0, high - value)]
        spread = [length if math.isfinite(length) else 0.0 for length in spread]
        axis.errorbar(
            value,
            place,
            xerr=[[spread[0]], [spread[1]]],
            capsize=4,
            markerfacecolor="white" if few else style["color"],
            **{**style, "linestyle": "none"},
        )
    axis.set_yticks(range(len(records)), names)
    axis.set_ylim(len(records) - 0.4, -0.6)
    told = f"{axis_label()}: interquartile mean, 95 % interval"
    if any(flew_part(record, flown) for record in records):
        told += "\nhollow: on fewer episodes than the others; stroke: the bound on the same ones"
    axis.set_xlabel(told)
    axis.grid(alpha=0.3, which="both", axis="x")
    axis.set_title(label_of(result), fontsize="medium")
    plain_log(axis.xaxis)
    if path is not None:
        save_figure(fig, path, overwrite=overwrite)
    return fig


def plot_profiles(
    result: SuiteResult,
    path: Path | None = None,
    *,
    ax: Axes | None = None,
    overwrite: bool = False,
) -> Figure:
    """Draw which fraction of all runs (seeds x episodes) stays below a tip error RMS.

    The axis of the error is logarithmic. The figure is written to ``path``, if there is one; ``ax``
    are axes to draw in.
    """
    scale = describe(JUDGE).scale
    records, flown = _judged_records(result), episodes_flown(result)
    fig, grid = axes_for(ax, size=(10.0, 5.4))
    axis = grid[0, 0]
    axis.set_xscale("log")
    drawn = styles([record.policy for record in records])
    for record, style in zip(records, drawn, strict=True):
        values = np.sort(judged(record, JUDGE), axis=None) * scale
        share = np.arange(1, values.size + 1) / values.size
        visible = np.isfinite(values) & (values > 0.0)
        few = f"\n({_episodes(record, flown)})" if flew_part(record, flown) else ""
        axis.step(
            values[visible],
            share[visible],
            where="post",
            label=f"{record.title}{few}",
            linewidth=1.4,
            color=style["color"],
            linestyle=style["linestyle"],
        )
    axis.set_ylim(0.0, 1.02)
    axis.set_xlabel(axis_label())
    axis.set_ylabel("fraction of runs at or below")
    axis.grid(alpha=0.3, which="both")
    axis.set_title(label_of(result), fontsize="medium")
    plain_log(axis.xaxis)
    _legend(fig, axis, own=ax is None)
    if path is not None:
        save_figure(fig, path, overwrite=overwrite)
    return fig


def plot_degradation(
    results: Sequence[SuiteResult],
    path: Path | None = None,
    *,
    ax: Axes | None = None,
    overwrite: bool = False,
) -> Figure:
    """Draw the tip error RMS of every policy in every suite with its 95 % intervals.

    The suites have no order, so that no lines join them. The axis of the error is logarithmic; a
    hollow point is on fewer episodes than those of others. The figure is written to ``path``, if
    there is one; ``ax`` are axes to draw in.
    """
    scale = describe(JUDGE).scale
    policies = policies_in(results)
    fig, grid = axes_for(ax, size=(11.0, 5.4))
    axis = grid[0, 0]
    axis.set_yscale("log")
    flights = [{record.policy: record for record in result.records} for result in results]
    flown = [episodes_flown(result) for result in results]
    starred = degradation_of(results)[2]
    middle = (len(policies) - 1) / 2.0
    drawn = styles(list(policies))
    for number, ((policy, first), style) in enumerate(zip(policies.items(), drawn, strict=True)):
        figures = np.full((3, len(results)), np.nan)
        for column, records in enumerate(flights):
            if policy in records and JUDGE in records[policy].metrics:
                found = estimate_of(records[policy], JUDGE)
                figures[:, column] = np.array([found.value, *found.interval]) * scale
        figures[~np.isfinite(figures)] = np.nan
        value, low, high = figures
        # beside each other, so that intervals can be told apart
        places = np.arange(len(results)) + 0.8 * (number - middle) / max(1, len(policies))
        spread = np.nan_to_num(np.maximum(0.0, [value - low, high - value]))
        few = np.array(
            [
                policy in records and flew_part(records[policy], count)
                for records, count in zip(flights, flown, strict=True)
            ]
        )
        # the legend shows every policy once, filled
        axis.plot([], [], label=first.title, **{**style, "linestyle": "none"})
        for chosen, face in ((~few, style["color"]), (few, "white")):
            axis.errorbar(
                places[chosen],
                value[chosen],
                yerr=spread[:, chosen],
                capsize=2,
                markersize=5.0,
                elinewidth=1.0,
                markerfacecolor=face,
                **{**style, "linestyle": "none"},
            )
    for border in range(1, len(results)):
        axis.axvline(border - 0.5, color="0.85", linewidth=0.8)
    axis.set_xlim(-0.5, len(results) - 0.5)
    axis.set_xticks(range(len(results)), [result.suite for result in results])
    axis.set_xlabel("suite (hollow: on fewer episodes than the others)" if starred else "suite")
    axis.set_ylabel(f"{axis_label()}: interquartile mean")
    axis.grid(alpha=0.3, which="both", axis="y")
    plain_log(axis.yaxis)
    _legend(fig, axis, own=ax is None)
    if path is not None:
        save_figure(fig, path, overwrite=overwrite)
    return fig


def _between_seeds(
    runs: Sequence[NDArray[np.float64]], column: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places that all runs reach, and the interquartile mean of the runs at each of them."""
    first = max(run[0, column] for run in runs)
    last = min(run[-1, column] for run in runs)
    every = np.unique(np.concatenate([run[:, column] for run in runs]))
    places = every[(every >= first) & (every <= last)]
    lines = [
        np.interp(places, run[:, column], np.where(np.isfinite(run[:, 2]), run[:, 2], 1e100))
        for run in runs
    ]
    middle = np.array([interquartile_mean(values) for values in np.transpose(lines)])
    return places, np.where(middle > 1e50, np.nan, middle)


def plot_curves(
    curves: Mapping[str, Sequence[ArrayLike]],
    bands: Mapping[str, Estimate],
    path: Path | None = None,
    *,
    metric: str = JUDGE,
    title: str = "learning curves",
    ax: Sequence[Axes] | None = None,
    overwrite: bool = False,
) -> Figure:
    """Draw a metric over simulated steps and over wall time, laws as horizontal bands.

    All axes are logarithmic: the methods need from seconds to half an hour. What was evaluated
    before the first step is left out.

    Parameters
    ----------
    curves
        By title of the algorithm one array a training seed, each of shape (k, 3) with a row an
        evaluation: steps, wall time in s, value in SI. Thin lines are seeds, a thick one is their
        interquartile mean.
    bands
        Estimates of laws over the same episodes, by title, SI.
    path
        File to write, if any.
    metric, title, overwrite
        What the values are, what is above the figure, whether a file may be replaced.
    ax
        Two axes to draw in, steps and time; a new figure by default.

    Raises
    ------
    ValueError
        An array of another shape, or without rows; another number of axes.
    """
    display = describe(metric)
    drawn: dict[str, list[NDArray[np.float64]]] = {
        name: [np.asarray(run, dtype=np.float64) for run in runs] for name, runs in curves.items()
    }
    for name, runs in drawn.items():
        for run in runs:
            if run.ndim != 2 or run.shape[1] != 3 or run.shape[0] == 0:
                raise ValueError(f"a curve of {name!r} has shape {run.shape} instead of (k, 3)")
    fig, grid = axes_for(ax, 1, 2, size=(12.0, 5.0), sharey=True)
    axes = list(grid[0])
    looks = dict(zip([*drawn, *bands], styles([*drawn, *bands]), strict=True))
    sides = ((0, 1e-6, "simulated steps (millions)"), (1, 1.0 / 60.0, "wall time (min)"))
    for axis, (column, factor, label) in zip(axes, sides, strict=True):
        axis.set_xscale("log")
        axis.set_yscale("log")
        for name in drawn:
            line = {key: looks[name][key] for key in ("color", "linestyle")}
            runs = [run[(run[:, 0] > 0.0) & (run[:, column] > 0.0)] for run in drawn[name]]
            runs = [run for run in runs if len(run) > 0]
            for begun in runs:
                value = np.where(np.isfinite(begun[:, 2]), begun[:, 2], np.nan)
                axis.plot(
                    begun[:, column] * factor,
                    value * display.scale,
                    linewidth=0.6,
                    alpha=0.5,
                    **line,
                )
            if runs:
                places, middle = _between_seeds(runs, column)
                word = "seed" if len(runs) == 1 else "seeds"
                axis.plot(
                    places * factor,
                    middle * display.scale,
                    linewidth=2.2,
                    label=f"{name} ({len(runs)} {word})",
                    **line,
                )
        for name, found in bands.items():
            line = {key: looks[name][key] for key in ("color", "linestyle")}
            level = found.value * display.scale
            low, high = (edge * display.scale for edge in found.interval)
            if not math.isfinite(level):
                continue
            if math.isfinite(low) and math.isfinite(high):
                axis.axhspan(low, high, color=line["color"], alpha=0.15, linewidth=0.0)
            axis.axhline(level, linewidth=1.2, label=name, **line)
        axis.set_xlabel(label)
        axis.grid(alpha=0.3, which="both")
        plain_log(axis.xaxis)
        plain_log(axis.yaxis)
    axes[0].set_ylabel(axis_label(metric))
    handles, labels = axes[0].get_legend_handles_labels()
    if ax is None:
        fig.legend(handles, labels, loc="outside right upper", fontsize="small")
    else:
        axes[0].legend(handles, labels, fontsize="small")
    titled(fig, grid, title, own=ax is None)
    if path is not None:
        save_figure(fig, path, overwrite=overwrite)
    return fig
