"""Pictures of plans: trade curves, the path of the tip, what is needed over time."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.planning.trade import TRADED, front
from drm_baselines.support.figures import save_figure, subplots
from drm_baselines.support.palette import OKABE_ITO

_FAMILIES = {
    ("min_time", False): ("minimum time", "blue", "o"),
    ("min_time", True): ("minimum time, smoothed", "sky blue", "s"),
    ("min_energy", False): ("minimum energy", "vermilion", "^"),
    ("min_energy", True): ("minimum energy, smoothed", "orange", "D"),
}
"""The thesis' four families: label, colour, marker."""


def plot_trades(plan: drm_env.SlewPlan, path: Path, *, overwrite: bool = False) -> Path:
    """Draw what was flown, each pair of time, energy, vibration and momentum; return ``path``.

    Hollow marks pass a limit, the line joins those on the front, the star is the plan.
    """
    names = [name for name in TRADED if any(each.value(name) > 0.0 for each in plan.candidates)]
    pairs = [(first, second) for first, second in itertools.combinations(names, 2)]
    columns = min(3, len(pairs))
    lines = -(-len(pairs) // columns)
    figure, axes = subplots(lines, columns, size=(4.3 * columns, 3.6 * lines + 0.5))
    best = front(plan.candidates)
    for axis in axes.flat[len(pairs) :]:
        axis.set_visible(False)
    for axis, (first, second) in zip(axes.flat, pairs, strict=False):
        for (profile, smoothed), (label, colour, marker) in _FAMILIES.items():
            for feasible in (True, False):
                here = [
                    each
                    for each in plan.candidates
                    if each.profile == profile
                    and (each.smoothing > 0.0) is smoothed
                    and each.feasible is feasible
                ]
                axis.plot(
                    [each.value(first) / TRADED[first].factor for each in here],
                    [each.value(second) / TRADED[second].factor for each in here],
                    linestyle="none",
                    marker=marker,
                    markersize=4.5,
                    color=OKABE_ITO[colour],
                    markerfacecolor=OKABE_ITO[colour] if feasible else "none",
                    label=label if feasible and here else None,
                )
        axis.plot([], [], "o", color="0.35", markersize=4.5, markerfacecolor="none",
                  label="passes a limit")  # fmt: skip
        # of the front in four quantities, what is best in these two
        edge, least = [], np.inf
        for each in sorted(best, key=lambda one: (one.value(first), one.value(second))):
            if each.value(second) < least:
                least = each.value(second)
                edge.append(each)
        axis.plot(
            [each.value(first) / TRADED[first].factor for each in edge],
            [each.value(second) / TRADED[second].factor for each in edge],
            color=OKABE_ITO["grey"],
            linewidth=1.0,
            zorder=0,
            drawstyle="steps-post",
            label="best that can be had of both",
        )
        axis.plot(
            plan.best.value(first) / TRADED[first].factor,
            plan.best.value(second) / TRADED[second].factor,
            marker="*",
            markersize=13.0,
            color=OKABE_ITO["green"],
            markeredgecolor="black",
            linestyle="none",
            label=f"plan: {plan.objective}",
        )
        for set_label, name in ((axis.set_xlabel, first), (axis.set_ylabel, second)):
            set_label(f"{TRADED[name].label} ({TRADED[name].unit})")
        if "vibration" in (first, second):
            scale = axis.set_xscale if first == "vibration" else axis.set_yscale
            scale("log")
        axis.grid(alpha=0.3)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize="small")
    return save_figure(figure, path, overwrite=overwrite)


def plot_tip_path(
    plan: drm_env.SlewPlan,
    flight: Mapping[str, NDArray[np.float64]],
    path: Path,
    *,
    overwrite: bool = False,
) -> Path:
    """Draw the path of the tip in the plane, with the workspace and the arm at times.

    The deflection is drawn as it is.
    """
    from matplotlib.patches import Annulus

    ring = drm_env.workspace(plan.scenario["arm"])
    places = plan.tip_path(flight)
    low = min(0.0, float(places[:, 1].min())) - 1.5
    high = max(0.0, float(places[:, 1].max())) + 1.5
    wide = 2.08 * ring.edge
    figure, axes = subplots(size=(7.0, 1.0 + 6.2 * (high - low) / wide))
    axis = axes[0, 0]
    axis.add_patch(
        Annulus(
            (0.0, 0.0), ring.edge, ring.edge - ring.hole, color=OKABE_ITO["sky blue"], alpha=0.12,
            linewidth=0.0, label="workspace of the tip",
        )
    )  # fmt: skip
    count = len(flight["time"])
    moving = int(np.searchsorted(flight["time"], plan.best.final_time))
    for index in np.linspace(0, min(moving, count - 1), 7).astype(int):
        axis.plot(
            [0.0, places[index, 0]], [0.0, places[index, 1]], color=OKABE_ITO["grey"],
            linewidth=1.4, alpha=0.6, label="arm" if index == 0 else None,
        )  # fmt: skip
    axis.plot(*places.T, color=OKABE_ITO["vermilion"], linewidth=1.8, label="tip")
    ends = drm_env.tip_position(
        [plan.start.angle, plan.start.angle + plan.scenario["slew"]["angle"]],
        [plan.start.extension, plan.goal.extension],
        plan.scenario["arm"],
    )
    for place, label, marker in zip(ends, ("start", "goal"), ("o", "X"), strict=True):
        axis.plot(*place, marker=marker, color="black", linestyle="none", label=label)
    axis.plot(0.0, 0.0, marker="s", color="black", markersize=5.0, linestyle="none")
    axis.set_aspect("equal")
    axis.set_xlabel("x (m)")
    axis.set_ylabel("y (m)")
    axis.set_xlim(-0.5 * wide, 0.5 * wide)
    axis.set_ylim(low, high)
    axis.grid(alpha=0.3)
    axis.legend(fontsize="small", loc="best")
    axis.set_title(f"{plan.objective}: {plan.best.final_time:.2f} s")
    return save_figure(figure, path, overwrite=overwrite)


class Drawn(NamedTuple):
    """A signal in the picture of the loads.

    Attributes
    ----------
    signal
        Its name.
    label
        With its unit.
    factor
        Of that unit to SI.
    limit
        Name of the limit on it, if there can be one.
    """

    signal: str
    label: str
    factor: float
    limit: str | None


DRAWN: Sequence[Drawn] = (
    Drawn("slew_torque", "motor torque (N m)", 1.0, "motor_torque"),
    Drawn("deployment_force", "deployment force (N)", 1.0, "deployment_force"),
    Drawn("root_bending_moment_link2", "link 2, root moment (N m)", 1.0, "link2_bending_moment"),
    Drawn("motor_power", "motor power (W)", 1.0, None),
    Drawn("slew_rate", "slew rate (deg/s)", np.pi / 180.0, "motor_rate"),
    Drawn("tip_deflection", "tip deflection (mm)", 1e-3, "deflection"),
    Drawn("root_momentum", "root wheel momentum (N m s)", 1.0, "root_wheel_momentum"),
)
"""What is drawn over time."""


def plot_loads(
    plan: drm_env.SlewPlan,
    flights: Mapping[str, Mapping[str, NDArray[np.float64]]],
    path: Path,
    *,
    overwrite: bool = False,
) -> Path:
    """Draw what a plan needs over time, with its limits; ``flights`` by their labels."""
    from drm_baselines.support.figures import LINES, SEQUENCE

    shown = [
        each for each in DRAWN if any(np.any(flight[each.signal]) for flight in flights.values())
    ]
    figure, grid = subplots(len(shown), 1, size=(8.0, 1.75 * len(shown) + 0.6), sharex=True)
    limits = plan.limits.given()
    for axis, drawn in zip(grid[:, 0], shown, strict=True):
        for index, (label, flight) in enumerate(flights.items()):
            axis.plot(
                flight["time"],
                flight[drawn.signal] / drawn.factor,
                color=SEQUENCE[index % len(SEQUENCE)],
                linestyle=LINES[index % len(LINES)],
                linewidth=1.1,
                label=label,
            )
        limit = None if drawn.limit is None else limits.get(drawn.limit)
        if limit is not None:
            for sign in (-1.0, 1.0):
                axis.axhline(sign * limit / drawn.factor, color="black", linestyle=":")
        axis.axvline(plan.best.final_time, color=OKABE_ITO["grey"], linewidth=0.8)
        axis.set_ylabel(drawn.label, fontsize="small")
        axis.grid(alpha=0.3)
    grid[0, 0].legend(fontsize="small", ncols=len(flights))
    grid[-1, 0].set_xlabel("time (s)")
    figure.suptitle(f"{plan.objective}: {plan.best.final_time:.2f} s; dotted: limits")
    return save_figure(figure, path, overwrite=overwrite)
