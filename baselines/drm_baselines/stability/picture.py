"""Stability maps as a picture: growth rate over length and payload, a panel a law."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drm_baselines.stability.closed_loop import STABLE, StabilityMap
from drm_baselines.support.extras import needing
from drm_baselines.support.figures import axes_for, save_figure

with needing("a picture", "plot"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = 1000.0
"""Largest growth rate that a colour shows, 1/s."""

_STRONG = 100.0
"""Growth rate from which a cell is so dark that its number is white, 1/s."""


def plot_stability(
    maps: Sequence[StabilityMap],
    path: Path | None = None,
    *,
    ax: Sequence[Axes] | None = None,
    overwrite: bool = False,
) -> Figure:
    """Draw the maps beside each other; ``ax`` are as many axes to draw in.

    Colours run from blue (dies away) over white to red (grows), on a scale that is linear up to
    0.1 1/s; the number is in each cell, bold where the motion grows. The figure is written
    to ``path``, if there is one.
    """
    from matplotlib.colors import SymLogNorm

    figure, axes = axes_for(ax, 1, len(maps), size=(3.2 * len(maps) + 1.4, 3.6), sharey=True)
    norm = SymLogNorm(0.1, vmin=-_SHOWN, vmax=_SHOWN)
    for axis, found in zip(axes[0], maps, strict=True):
        columns, rows = np.arange(len(found.extensions)), np.arange(len(found.masses))
        mesh = axis.pcolormesh(
            columns,
            rows,
            np.nan_to_num(found.rates, posinf=_SHOWN),
            norm=norm,
            cmap="RdBu_r",
            shading="nearest",
        )
        for row, column in np.ndindex(found.rates.shape):
            rate = found.rates[row, column]
            strong = abs(rate) > _STRONG
            axis.text(
                column,
                row,
                f"{rate:.0f}" if abs(rate) >= 10.0 else f"{rate:.2g}",
                ha="center",
                va="center",
                fontsize=6.5,
                color="white" if strong else "black",
                weight="bold" if rate >= STABLE else "normal",
            )
        axis.set_xticks(columns, [f"{a:g}" for a in found.extensions], fontsize="small")
        axis.set_yticks(rows, [f"{mass:g}" for mass in found.masses], fontsize="small")
        axis.set_xlabel("extension of link 2 (m)")
        axis.set_title(f"{found.title}: {'stable' if found.stable else 'unstable'}", fontsize=9)
    axes[0, 0].set_ylabel("payload mass (kg)")
    bar = figure.colorbar(mesh, ax=list(axes[0]))
    bar.set_label("growth rate of the worst motion (1/s)")
    ticks = [-1000.0, -10.0, -0.1, 0.0, 0.1, 10.0, 1000.0]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    if path is not None:
        save_figure(figure, path, overwrite=overwrite)
    return figure
