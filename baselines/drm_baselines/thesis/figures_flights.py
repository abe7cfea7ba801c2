"""Figures of chapters 4 and 5, drawn from the flights in `flights`."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

import drm_env
from drm_baselines.thesis.drawing import curves, panels
from drm_baselines.thesis.flights import FLIGHTS, Shown
from drm_baselines.thesis.manoeuvres import (
    Manoeuvre,
    after,
    during,
    energies,
    final_angle_deg,
    largest_angle_deg,
    peak,
    rms,
    settling_time,
    slew_end,
)
from drm_baselines.thesis.published import statements
from drm_baselines.thesis.results import Entry, Outcome, Row, ours_only
from drm_baselines.thesis.statements import VALUES

_Array = NDArray[np.float64]
_Lines = dict[str, _Array]
_DEGREES = 180.0 / math.pi
_Panel = Callable[[drm_env.Trajectory, Manoeuvre], _Lines]


def _tip(flight: drm_env.Trajectory, _: Manoeuvre) -> _Lines:
    return {
        "both links": 1e3 * flight["tip_deflection"],
        "link 2": 1e3 * flight["link2_tip_deflection"],
    }


def _angle(flight: drm_env.Trajectory, _: Manoeuvre) -> _Lines:
    return {
        "slew angle": flight["slew_angle"] * _DEGREES,
        "reference": flight["reference_angle"] * _DEGREES,
    }


def _force(flight: drm_env.Trajectory, manoeuvre: Manoeuvre) -> _Lines:
    accel = np.gradient(flight["extension_rate"], flight["time"])
    load = manoeuvre.scenario()["payload"]["mass"]
    scenario = drm_env.Scenario()
    link2 = scenario.arm.link2
    return {"force": accel * (load + link2.mass_per_length * link2.length)}


def _single(name: str, signal: str) -> _Panel:
    return lambda flight, _: {name: flight[signal]}


PANELS: dict[str, tuple[str, _Panel]] = {
    "tip": ("deflection (mm)", _tip),
    "tip afterwards": ("deflection (mm)", _tip),
    "angle": ("angle (deg)", _angle),
    "slew": ("slew torque (N m)", _single("S", "slew_torque")),
    "root": ("root wheel (N m)", _single("T1", "root_torque")),
    "wheel": ("tip wheel (N m)", _single("T2", "tip_torque")),
    "accel": ("acceleration (rad/s²)", _single("reference", "reference_accel")),
    "power": ("power (W)", _single("P", "motor_power")),
    "length": ("length a (m)", _single("a", "extension")),
    "force": ("force (N)", _force),
}
"""Vertical axis and lines of each kind of panel; energies are drawn apart."""


def _zoom(axis: Axes, flight: drm_env.Trajectory) -> None:
    """Show what is left after the slew."""
    start = slew_end(flight) + 0.1
    left = flight["time"] > start
    largest = 1e3 * max(peak(flight[n][left]) for n in ("link2_tip_deflection", "tip_deflection"))
    axis.set_xlim(start, float(flight["time"][-1]))
    axis.set_ylim(-1.3 * largest, 1.3 * largest)


def _numbers(shown: Shown) -> list[Row]:
    """Values of the flight that the panels show."""
    flight = shown.manoeuvre.flight()
    rows: list[Row] = []
    if "tip" in shown.signals and shown.manoeuvre.angle_deg:
        rows += [
            ours_only("vibration of link 2 in the slew, peak", "mm", 1e3 * peak(during(flight))),
            ours_only("vibration of link 2 afterwards, peak", "mm", 1e3 * peak(after(flight))),
            ours_only("vibration of link 2 afterwards, RMS", "mm", 1e3 * rms(after(flight))),
        ]
        settled = settling_time(flight)
        if shown.manoeuvre.law != "none" and math.isfinite(settled):
            rows.append(ours_only("link 2 below 0.1 mm from", "s", settled))
    if "angle" in shown.signals:
        rows += [
            ours_only("largest angle", "deg", largest_angle_deg(flight)),
            ours_only("angle at the end", "deg", final_angle_deg(flight)),
        ]
    for signal, name, words in (
        ("slew", "slew_torque", "slew torque"),
        ("root", "root_torque", "root wheel torque"),
        ("wheel", "tip_torque", "tip wheel torque"),
    ):
        if signal in shown.signals:
            rows.append(ours_only(f"largest {words}", "N m", peak(flight[name])))
    if "power" in shown.signals:
        rows.append(ours_only("largest power", "W", peak(flight["motor_power"])))
    return rows


def _statement_rows(name: str) -> list[Row]:
    return [
        statement.row(VALUES[key]())
        for key, statement in statements().items()
        if statement.entry == name
    ]


def _build(number: str, shown: Shown) -> Outcome:
    flight = shown.manoeuvre.flight()
    count = len(shown.signals)
    apart = "tip afterwards" in shown.signals
    height = 2.9 if count == 1 else 2.1
    figure, axes = panels(count, title=shown.manoeuvre.title, height=height, share=not apart)
    for axis, signal in zip(axes, shown.signals, strict=True):
        if signal in ("total energy", "energies"):
            time, lines = energies(shown.manoeuvre)
            names = ("total",) if signal == "total energy" else ("kinetic", "strain")
            curves(axis, time, {name: lines[name] for name in names}, ylabel="energy (J)")
            if signal == "total energy":
                axis.set_ylim(0.0, 1.2 * float(lines["total"].max()))
            else:
                axis.set_xlim(0.0, 2.0)
            continue
        label, lines_of = PANELS[signal]
        curves(
            axis,
            flight["time"],
            lines_of(flight, shown.manoeuvre),
            ylabel=label,
            first_behind=lines_of is _tip,
        )
    if apart:
        _zoom(axes[shown.signals.index("tip afterwards")], flight)
    rows = tuple(_statement_rows(f"figure-{number}") + _numbers(shown))
    return Outcome(rows, shown.note, figure)


def flight_entries() -> list[Entry]:
    """Return the entries of chapters 4 and 5."""
    return [
        Entry(
            f"figure-{number}",
            shown.title,
            shown.section,
            functools.partial(_build, number, shown),
        )
        for number, shown in FLIGHTS.items()
    ]
