"""Pictures of the benchmark: the ratios of a section, and values over a size."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drm_baselines.speed.measure import Spread
from drm_baselines.speed.results import Curve, Section
from drm_baselines.support.extras import needing
from drm_baselines.support.figures import (
    LINES,
    SEQUENCE,
    axes_for,
    save_figure,
)

with needing("a picture", "plot"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter


def _errors(values: Sequence[Spread]) -> list[list[float]]:
    return [
        [value.median - value.low for value in values],
        [value.high - value.median for value in values],
    ]


def plot_ratios(
    section: Section,
    path: Path | None = None,
    *,
    ax: Axes | None = None,
    overwrite: bool = False,
) -> Figure | None:
    """Draw the ratios of a section with their spread; ``None`` if it has none.

    The figure is written to ``path``, if there is one; ``ax`` are axes to draw in.
    """
    rows = [row for row in section.rows if row.ratio is not None]
    ratios = [row.ratio for row in section.rows if row.ratio is not None]
    if not rows:
        return None
    figure, grid = axes_for(ax, size=(10.0, 1.6 + 0.5 * len(rows)))
    axis = grid[0, 0]
    places = np.arange(len(rows))[::-1]
    medians = [ratio.median for ratio in ratios]
    axis.errorbar(medians, places, xerr=_errors(ratios), fmt="o", capsize=4, color=SEQUENCE[0])
    axis.axvline(1.0, color="0.3", linewidth=1.0)
    axis.set_yticks(places, [f"{row.what}\nto {row.relative_to}" for row in rows])
    axis.tick_params(axis="y", labelsize="small")
    if max(medians) > 5.0 * min(medians):
        axis.set_xscale("log")
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_ylim(-0.6, len(rows) - 0.4)
    axis.set_xlabel("ratio to what stands below each name (median; smallest and largest)")
    axis.grid(alpha=0.3, axis="x")
    axis.set_title(section.title)
    if path is not None:
        save_figure(figure, path, overwrite=overwrite)
    return figure


def plot_curve(
    curve: Curve, path: Path | None = None, *, ax: Axes | None = None, overwrite: bool = False
) -> Figure:
    """Draw values over a size, both logarithmic, with their spread.

    The figure is written to ``path``, if there is one; ``ax`` are axes to draw in.
    """
    figure, grid = axes_for(ax, size=(8.0, 5.0))
    axis = grid[0, 0]
    for index, (label, (sizes, values)) in enumerate(curve.lines.items()):
        axis.errorbar(
            list(sizes),
            [value.median for value in values],
            yerr=_errors(values),
            label=label,
            marker="o",
            capsize=3,
            color=SEQUENCE[index % len(SEQUENCE)],
            linestyle=LINES[index % len(LINES)],
        )
    axis.set_xscale("log", base=2)
    axis.set_yscale("log")
    places = sorted({size for sizes, _ in curve.lines.values() for size in sizes})
    axis.set_xticks(places, [f"{size:,g}" for size in places])
    axis.set_xlabel(curve.x_label)
    axis.set_ylabel(curve.y_label)
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize="small")
    axis.set_title(curve.title)
    if path is not None:
        save_figure(figure, path, overwrite=overwrite)
    return figure


def plot_all(
    sections: Sequence[Section], directory: Path, *, overwrite: bool = False
) -> list[Path]:
    """Draw everything; return the files."""
    files = []
    for section in sections:
        path = directory / f"{section.name}-ratios.png"
        if plot_ratios(section, path, overwrite=overwrite) is not None:
            files.append(path)
        for curve in section.curves:
            path = directory / f"{curve.name}.png"
            plot_curve(curve, path, overwrite=overwrite)
            files.append(path)
    return files
