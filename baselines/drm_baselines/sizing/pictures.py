"""Pictures of sizes: what drawn missions need, and what smaller wheels do to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drm_baselines.sizing.requirements import NEEDS, Requirement
from drm_baselines.sizing.sweep import SWEPT, SweepPoint
from drm_baselines.support.figures import save_figure, subplots
from drm_baselines.support.palette import OKABE_ITO


def plot_requirements(
    needs: Mapping[str, NDArray[np.float64]],
    found: Sequence[Requirement],
    path: Path,
    *,
    fraction: float,
    title: str,
    overwrite: bool = False,
) -> Path:
    """Draw which part of the missions needs how much, with quantile, interval and size."""
    shown = [each for each in found if each.largest > 0.0]
    columns = 3
    lines = -(-len(shown) // columns)
    figure, axes = subplots(lines, columns, size=(11.0, 2.4 * lines + 0.8))
    for axis in axes.flat[len(shown) :]:
        axis.set_visible(False)
    for axis, each in zip(axes.flat, shown, strict=False):
        values = np.sort(needs[each.name])
        part = np.arange(1, len(values) + 1) / len(values)
        axis.step(values, 100.0 * part, where="post", color=OKABE_ITO["blue"], linewidth=1.2)
        axis.axvspan(
            each.low,
            # not a number where the interval has no upper end
            float(np.fmin(each.high, each.largest)),
            color=OKABE_ITO["sky blue"],
            alpha=0.4,
            linewidth=0.0,
            label="interval of the quantile",
        )
        axis.axvline(each.size, color=OKABE_ITO["vermilion"], linewidth=1.4, label="size")
        axis.axhline(100.0 * fraction, color="black", linestyle=":", linewidth=0.9)
        axis.set_xlabel(f"{NEEDS[each.name].label} ({NEEDS[each.name].unit})", fontsize="small")
        axis.grid(alpha=0.3)
        axis.tick_params(labelsize="small")
        axis.locator_params(axis="x", nbins=5)
    for row in axes[:, 0]:
        row.set_ylabel("missions (%)", fontsize="small")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize="small")
    figure.suptitle(title)
    return save_figure(figure, path, overwrite=overwrite)


def plot_sweep(
    points: Sequence[SweepPoint], path: Path, *, title: str, overwrite: bool = False
) -> Path:
    """Draw settled missions, error of the angle and error of the tip over the size of a wheel."""
    names = list(dict.fromkeys(point.name for point in points))
    figure, axes = subplots(3, len(names), size=(3.8 * len(names) + 0.4, 7.6), sharex="col",
                            sharey="row")  # fmt: skip
    degrees = 180.0 / np.pi
    for column, name in zip(axes.T, names, strict=True):
        here = [point for point in points if point.name == name]
        limits = [point.limit for point in here]
        settled = [100.0 * point.settled for point in here]
        column[0].plot(limits, settled, marker="o", color=OKABE_ITO["green"])
        column[0].set_ylim(-4.0, 104.0)
        for axis, median, high, factor in (
            (column[1], "final_error", "final_error_high", degrees),
            (column[2], "tip_error", "tip_error_high", 1e3),
        ):
            for field, style, label in ((median, "-", "median"), (high, "--", "95 %")):
                values = [factor * getattr(point, field) for point in here]
                axis.plot(limits, values, style, marker="o", markersize=4.0,
                          color=OKABE_ITO["vermilion"], label=label)  # fmt: skip
            axis.set_yscale("log")
        (full,) = {round(point.limit / point.factor, 9) for point in here}
        for axis in column:
            axis.axvline(full, color=OKABE_ITO["grey"], linewidth=1.0)
            axis.grid(alpha=0.3, which="both")
        column[2].set_xlabel(f"{NEEDS[name].label} ({SWEPT[name][2]})", fontsize="small")
    axes[0, 0].set_ylabel("settled missions (%)")
    axes[1, 0].set_ylabel("slew error at the end (deg)")
    axes[2, 0].set_ylabel("RMS error of the tip (mm)")
    axes[1, 0].legend(fontsize="small")
    figure.suptitle(title)
    return save_figure(figure, path, overwrite=overwrite)
