"""The maps of a sweep as a picture: tip error over payload and misreport, a panel a policy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drm_baselines.evaluation.metrics import describe
from drm_baselines.support.figures import plain_log, save_figure, subplots
from drm_baselines.sweep.summary import Summary

PICTURE_FILE = "tip_error.png"
_COLUMNS = 4
_METRIC = describe("tip_error_rms")


def plot_sweep(summary: Summary, path: Path) -> Path:
    """Draw the median of the tip error in each cell, all panels with the same colours.

    Cells in which more than half of the episodes diverged are black, those with hardly any episode
    grey.
    """
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm

    maps = [each.cells * _METRIC.scale for each in summary.figures.values()]
    known = np.concatenate([cells[np.isfinite(cells)] for cells in maps])
    low, high = (known.min(), known.max()) if known.size else (1.0, 10.0)
    high = max(high, 1.0001 * low)
    norm = LogNorm(low, high)
    colours = colormaps["viridis"].with_extremes(bad="0.8", over="black")
    columns = min(_COLUMNS, len(maps))
    rows = -(-len(maps) // columns)
    figure, axes = subplots(
        rows, columns, size=(3.0 * columns + 1.6, 3.1 * rows + 0.4), sharex=True, sharey=True
    )
    for axis, figures, cells in zip(
        axes.flat, summary.figures.values(), maps, strict=False
    ):  # empty panels are left over
        mesh = axis.pcolormesh(
            100.0 * summary.error_edges,
            summary.payload_edges,
            np.ma.masked_invalid(np.where(np.isposinf(cells), 2.0 * high, cells)),
            norm=norm,
            cmap=colours,
        )
        axis.set_title(figures.title, fontsize=9)
    for axis in axes.flat[len(maps) :]:
        axis.set_visible(False)
    for axis in axes[:, 0]:
        axis.set_ylabel("payload (kg)")
    for axis in axes[-1]:
        axis.set_xlabel("error of the reported mass (%)")
    bar = figure.colorbar(mesh, ax=axes.ravel().tolist())
    bar.set_label(f"median of the {_METRIC.label} ({_METRIC.unit})")
    plain_log(bar.ax.yaxis)
    return save_figure(figure, path, overwrite=True)
