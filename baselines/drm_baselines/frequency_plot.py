"""The figure of ``drm modes``: natural frequencies over the extension. Drawn without a display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

from drm_baselines import storage

# Okabe and Ito's colours, with a marker for each plant as well.
_MARKS = (("#000000", "o"), ("#0072B2", "s"), ("#D55E00", "^"), ("#009E73", "D"))


def plot_natural_frequencies(
    extensions: Sequence[float],
    found: Mapping[str, Sequence[Sequence[float]]],
    path: Path,
    *,
    title: str,
    overwrite: bool = False,
) -> Path:
    """Draw natural frequencies over the extension, one colour a plant, one line a mode.

    Parameters
    ----------
    extensions
        Lengths of link 2 outside link 1, m.
    found
        By plant: for each extension its frequencies, rising, Hz.
    path, title, overwrite
        Where and what to draw.
    """
    figure, axis = plt.subplots(figsize=(8.0, 5.0), layout="constrained")
    try:
        for index, (name, rows) in enumerate(found.items()):
            colour, marker = _MARKS[index % len(_MARKS)]
            for mode, values in enumerate(zip(*rows, strict=True)):
                axis.plot(
                    extensions,
                    values,
                    color=colour,
                    marker=marker,
                    markersize=4.0,
                    linewidth=1.1,
                    label=name if mode == 0 else None,
                )
        axis.set_yscale("log")
        axis.set_xlabel("extension (m)")
        axis.set_ylabel("natural frequency (Hz)")
        axis.set_title(title)
        axis.grid(alpha=0.3, which="both")
        axis.legend(fontsize="small")
        with storage.atomic_path(path, overwrite=overwrite) as temporary:
            figure.savefig(temporary, dpi=130)
    finally:
        plt.close(figure)
    return path
