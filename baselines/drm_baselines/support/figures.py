"""What all pictures have in common: figures without global state, the palette, saving.

Figures are made with matplotlib's own classes and never with ``pyplot``, so that neither importing
this package nor drawing with it touches the backend that a notebook or a script has chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.support import storage
from drm_baselines.support.extras import needing
from drm_baselines.support.palette import OKABE_ITO

with needing("a picture", "plot"):
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

SEQUENCE = tuple(
    OKABE_ITO[name] for name in ("blue", "vermilion", "green", "purple", "orange", "sky blue")
)
"""Colours of lines that are no policies, in order."""

LINES = ("-", "--", "-.", ":")
"""Line styles, in order."""


def subplots(
    rows: int = 1, columns: int = 1, *, size: tuple[float, float], **options: Any
) -> tuple[Figure, NDArray[Any]]:
    """Return an empty figure and its axes.

    Parameters
    ----------
    rows, columns
        How many axes below and beside each other.
    size
        Width and height, inches.
    **options
        As for ``matplotlib.figure.Figure.subplots``, such as ``sharex=True``.

    Returns
    -------
    figure, axes
        Axes as an array of shape (rows, columns).
    """
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, np.asarray(figure.subplots(rows, columns, squeeze=False, **options))


def axes_for(
    ax: Axes | Sequence[Axes] | None,
    rows: int = 1,
    columns: int = 1,
    *,
    size: tuple[float, float],
    **options: Any,
) -> tuple[Figure, NDArray[Any]]:
    """Return the axes that somebody gave, with their figure, or an empty figure and its axes.

    Parameters
    ----------
    ax
        Where to draw: one pair of axes, or rows * columns of them in the order of reading; a new
        figure by default.
    rows, columns, size, **options
        As for :func:`subplots`; of axes that are given only their number counts.

    Returns
    -------
    figure, axes
        Axes as an array of shape (rows, columns).

    Raises
    ------
    ValueError
        Another number of axes.
    """
    if ax is None:
        return subplots(rows, columns, size=size, **options)
    given = np.empty(rows * columns, dtype=object)
    found = [ax] if isinstance(ax, Axes) else list(np.ravel(np.asarray(ax, dtype=object)))
    if len(found) != given.size:
        raise ValueError(f"ax must be {given.size} axes, got {len(found)}")
    given[:] = found
    figure = found[0].get_figure(root=True)
    assert figure is not None, "axes belong to a figure"
    return figure, given.reshape(rows, columns)


def titled(figure: Figure, axes: NDArray[Any], title: str, *, own: bool) -> None:
    """Put a title above a figure of our own, or above the first of axes that somebody gave."""
    if own:
        figure.suptitle(title)
    else:
        axes.flat[0].set_title(title)


def plain_log(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers; call it when everything is drawn."""
    low, high = axis.get_view_interval()
    narrow = low > 0.0 and high < 300.0 * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def save_figure(figure: Figure, path: Path, *, overwrite: bool) -> Path:
    """Write a figure under a temporary name and rename it; return ``path``."""
    with storage.atomic_path(path, overwrite=overwrite) as temporary:
        figure.savefig(temporary, dpi=130)
    return path
