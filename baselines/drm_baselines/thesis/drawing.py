"""Pictures: one style for all, no state between them, no display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from drm_baselines.support.figures import LINES, SEQUENCE, subplots
from drm_baselines.support.palette import OKABE_ITO, paler

_Array = NDArray[np.float64]

GREY = "0.6"
PALE = paler(OKABE_ITO["vermilion"], 0.6)


def panels(
    count: int, *, title: str, xlabel: str = "time (s)", height: float = 2.3, share: bool = True
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure with ``count`` axes below each other."""
    figure, grid = subplots(count, 1, size=(7.5, 0.7 + height * count), sharex=share)
    axes: list[Axes] = list(grid[:, 0])
    for axis in axes:
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel(xlabel)
    figure.suptitle(title, fontsize=10)
    return figure, axes


def curves(
    axis: Axes,
    x: _Array,
    lines: Mapping[str, _Array],
    *,
    ylabel: str,
    first_behind: bool = False,
) -> None:
    """Draw lines over ``x`` by their labels; the first as a pale background if asked for."""
    found = list(lines.items())
    if first_behind:
        label, y = found.pop(0)
        axis.plot(x, y, label=label, linewidth=0.8, color=PALE)
    for index, (label, y) in enumerate(found):
        axis.plot(
            x,
            y,
            label=label,
            linewidth=1.0,
            color=SEQUENCE[index % len(SEQUENCE)],
            linestyle=LINES[index % len(LINES)],
        )
    axis.set_ylabel(ylabel, fontsize=9)
    if len(lines) > 1:
        axis.legend(fontsize="x-small", loc="best", ncols=min(3, len(lines)))


def mark(axis: Axes, places: Sequence[float], label: str) -> None:
    """Mark places on the horizontal axis."""
    for index, place in enumerate(places):
        axis.axvline(place, color=GREY, linewidth=0.8, label=label if index == 0 else None)
