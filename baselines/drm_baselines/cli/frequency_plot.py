"""The figure of ``drm modes``: natural frequencies over the extension."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from drm_baselines.support.extras import needing
from drm_baselines.support.figures import SEQUENCE, axes_for, plain_log, save_figure

with needing("a picture", "plot"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARKERS = "os^Dv"  # one a plant, beside its colour


def plot_natural_frequencies(
    extensions: Sequence[float],
    found: Mapping[str, Sequence[Sequence[float]]],
    path: Path | None = None,
    *,
    title: str,
    ax: Axes | None = None,
    overwrite: bool = False,
) -> Figure:
    """Draw natural frequencies over the extension, one colour a plant, one line a mode.

    Parameters
    ----------
    extensions
        Lengths of link 2 outside link 1, m.
    found
        By plant: for each extension its frequencies, rising, Hz.
    path, title, overwrite
        Where and what to draw; without a path nothing is written.
    ax
        Axes to draw in; a new figure by default.

    Returns
    -------
    figure
        What has been drawn.
    """
    figure, grid = axes_for(ax, size=(8.0, 5.0))
    axis = grid[0, 0]
    for index, (name, rows) in enumerate(found.items()):
        for mode, values in enumerate(zip(*rows, strict=True)):
            axis.plot(
                extensions,
                values,
                color=SEQUENCE[index % len(SEQUENCE)],
                marker=_MARKERS[index % len(_MARKERS)],
                markersize=4.0,
                linewidth=1.1,
                label=name if mode == 0 else None,
            )
    axis.set_yscale("log")
    axis.set_xlabel("extension of link 2 (m)")
    axis.set_ylabel("natural frequency (Hz)")
    axis.set_title(title)
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize="small", title="plant, a line for each mode")
    plain_log(axis.yaxis)
    if path is not None:
        save_figure(figure, path, overwrite=overwrite)
    return figure
