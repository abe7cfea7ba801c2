"""The consistent plant, which the thesis does not have: convergence, laws, stability."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

import drm_env
from drm_baselines.thesis import arm
from drm_baselines.thesis.drawing import curves, panels
from drm_baselines.thesis.manoeuvres import Manoeuvre
from drm_baselines.thesis.results import Entry, Grid, Outcome, Row, ours_only

_Array = NDArray[np.float64]

_MODES = (1, 2, 3, 4, 5, 6)
_FLIGHT = Manoeuvre(inertia="full", plant="consistent")
_SLEWS = {
    "minimum time": _FLIGHT,
    "minimum energy, smoothed": replace(_FLIGHT, profile="min_energy", smoothing=0.05),
}
_STEPS = {
    "minimum time": (5e-4, 2.5e-4, 1e-4, 5e-5, 2.5e-5),
    "minimum energy, smoothed": (5e-4, 2.5e-4, 1e-4),
}
"""Steps of the integrator that are tried with 4 + 4 modes, s."""

_RELEASE = 1e-9
"""Half the deflection of link 2's tip, m: far below what saturates a wheel."""


@dataclass(frozen=True)
class _Column:
    """A quantity of a flight and how it is written."""

    heading: str
    quantity: str
    unit: str
    digits: str
    value: Callable[[drm_env.Trajectory], float]

    def text(self, flight: drm_env.Trajectory) -> str:
        """Return the value as text; a dash where there is none."""
        value = self.value(flight)
        return format(value, self.digits) if math.isfinite(value) else "-"


def _metric(name: str, scale: float = 1.0) -> Callable[[drm_env.Trajectory], float]:
    return lambda flight: scale * float(flight.metrics[name])


def vibration(flight: drm_env.Trajectory, low: float, high: float) -> float:
    """Return the RMS deflection of link 2 from the time ``low`` to ``high`` (s), m."""
    part = (flight["time"] >= low) & (flight["time"] < high)
    return float(np.sqrt(np.mean(flight["link2_tip_deflection"][part] ** 2)))


_PEAK = _Column("peak (mm)", "largest deflection of the tip", "mm", ".2f",
                _metric("peak_deflection", 1e3))  # fmt: skip
_RESIDUAL = _Column("residual peak (mm)", "largest deflection of the tip after the slew", "mm",
                    ".2f", _metric("residual_peak", 1e3))  # fmt: skip
_RMS = _Column("residual RMS (mm)", "RMS deflection of the tip after the slew", "mm", ".2f",
               _metric("residual_rms", 1e3))  # fmt: skip
_OF_LAWS = (
    _PEAK,
    _RMS,
    _Column("settled after (s)", "settling time", "s", ".2f", _metric("settling_time")),
    _Column("largest angle (deg)", "largest angle", "deg", ".3f",
            _metric("peak_slew_angle", 180.0 / math.pi)),
    _Column("final error (deg)", "slew error at the end", "deg", ".3f",
            _metric("final_slew_error", 180.0 / math.pi)),
    _Column("saturated (%)", "time with a wheel at its limit", "%", ".0f",
            _metric("saturation", 100.0)),
    _Column("35 to 40 s (mm)", "RMS deflection of link 2 from 35 to 40 s", "mm", ".3f",
            lambda flight: 1e3 * vibration(flight, 35.0, 40.0)),
)  # fmt: skip


def _changes(flights: Sequence[drm_env.Trajectory], column: _Column) -> list[float]:
    """Return the change to the next flight, percent; NaN for the last."""
    values = [column.value(flight) for flight in flights]
    pairs = itertools.pairwise(values)
    return [*(100.0 * (more / fewer - 1.0) for fewer, more in pairs), math.nan]


def _converging(
    flights: Sequence[drm_env.Trajectory],
    modes: Sequence[int],
    titles: Sequence[str],
    places: Sequence[str],
    following: Sequence[str],
) -> tuple[list[Row], list[tuple[str, ...]]]:
    """Return rows and lines of flights, with the change from each to the next.

    Parameters
    ----------
    flights, modes
        The flights and how many modes a link each has.
    titles, places
        How each is called in its line and in its rows.
    following
        How the rows call the one after it.
    """
    rows: list[Row] = []
    lines: list[tuple[str, ...]] = []
    changes = [_changes(flights, column) for column in (_PEAK, _RESIDUAL)]
    for n, flight, title, place, after, *both in zip(
        modes, flights, titles, places, following, *changes, strict=True
    ):
        frequency = float(arm.frequencies("P1", 8.0, plant="consistent", modes=(n, n))[0])
        for column, change in zip((_PEAK, _RESIDUAL), both, strict=True):
            words = f"{place}, {column.quantity}"
            rows.append(ours_only(words, column.unit, column.value(flight)))
            if math.isfinite(change):
                rows.append(ours_only(f"{words}, change to {after}", "%", change))
        of_peak, of_residual = map(_percent, both)
        lines.append(
            (title, str(n), f"{frequency:.4f}", _PEAK.text(flight), of_peak,
             _RESIDUAL.text(flight), of_residual)
        )  # fmt: skip
    return rows, lines


def _convergence() -> Outcome:
    rows: list[Row] = []
    lines: list[tuple[str, ...]] = []
    figure, axes = panels(len(_SLEWS), title="Payload 1, a = 1 to 8 m, open loop, consistent plant")
    for axis, (name, manoeuvre) in zip(axes, _SLEWS.items(), strict=True):
        flights = [replace(manoeuvre, modes=(n, n)).flight() for n in _MODES]
        drawn = {
            f"{n} + {n} modes": 1e3 * flight["tip_deflection"]
            for n, flight in zip(_MODES, flights, strict=True)
            if n in (1, 2, 4, 6)
        }
        curves(axis, flights[0]["time"], drawn, ylabel="tip (mm)")
        axis.set_title(name, fontsize=9)
        found = _converging(
            flights,
            _MODES,
            [name] * len(_MODES),
            [f"{name}, n = m = {n}" for n in _MODES],
            [str(n + 1) for n in _MODES],
        )
        rows += found[0]
        lines += found[1]
    for name, steps in _STEPS.items():
        flights = [replace(_SLEWS[name], integrator_step=step).flight() for step in steps]
        words = [f"step {1e3 * step:g} ms" for step in steps]
        titles = [f"{name}, {word}" for word in words]
        found = _converging(
            flights, [_FLIGHT.modes[0]] * len(steps), titles, titles, [*words[1:], ""]
        )
        rows += found[0]
        lines += found[1]
    columns = (
        "slew", "n = m", "f1 at 8 m (Hz)", _PEAK.heading, "to the next (%)", _RESIDUAL.heading,
        "to the next (%)",
    )  # fmt: skip
    note = (
        "Payload 1, 50 deg, a = 1 to 8 m, open loop, no damping. Minimum time switches the torque "
        "at once and excites every mode; minimum energy with smoothing 0.05 leaves the low ones. "
        "The step is 0.5 ms where none is named."
    )
    return Outcome(tuple(rows), note, figure, Grid(columns, tuple(lines)))


def _percent(change: float) -> str:
    return f"{round(change, 2) + 0.0:+.2f}" if math.isfinite(change) else ""


_PLANTS = {
    "thesis": replace(_FLIGHT, plant="thesis", horizon=40.0),
    "consistent": replace(_FLIGHT, horizon=40.0),
    "damped": replace(_FLIGHT, horizon=40.0, damping=1e-3),
}
_LAWS = {"none": "open loop", "linear": "linear law", "Lyapunov": "Lyapunov law"}


def _smooth_slew() -> Outcome:
    rows: list[Row] = []
    lines: list[tuple[str, ...]] = []
    columns = (_PEAK, _RESIDUAL, *_OF_LAWS[1:])
    for law, plant in itertools.product(_LAWS, _PLANTS):
        flight = replace(_PLANTS[plant], smoothing=0.05, law=law).flight()
        for column in columns:
            value = column.value(flight)
            if math.isfinite(value):
                words = f"{_LAWS[law]}, {plant} plant, {column.quantity}"
                rows.append(ours_only(words, column.unit, value))
        lines.append((law, plant, *(column.text(flight) for column in columns)))
    note = (
        "Payload 1 with its mass known, near minimum time with smoothing 0.05, a = 1 to 8 m, 40 s; "
        "otherwise as consistent-laws."
    )
    headings = ("law", "plant", *(column.heading for column in columns))
    return Outcome(tuple(rows), note, grid=Grid(headings, tuple(lines)))


def _laws() -> Outcome:
    rows: list[Row] = []
    lines: list[tuple[str, ...]] = []
    for payload, error, law, plant in itertools.product(
        ("P0", "P1", "P3"), (0.0, 0.15), _LAWS, _PLANTS
    ):
        manoeuvre = replace(_PLANTS[plant], payload=payload, mass_error=error, law=law)
        flight = manoeuvre.flight()
        reported = f"{100.0 * error:+.0f} %" if error else "exact"
        place = f"{arm.PAYLOAD_TITLES[payload]}, mass {reported}, {_LAWS[law]}, {plant} plant"
        for column in _OF_LAWS:
            value = column.value(flight)
            if math.isfinite(value):
                rows.append(ours_only(f"{place}, {column.quantity}", column.unit, value))
        finer = replace(manoeuvre, integrator_step=2.5e-4).flight()
        rows.append(
            ours_only(f"{place}, {_RMS.quantity}, half the step", _RMS.unit, _RMS.value(finer))
        )
        peak, residual, *rest = (column.text(flight) for column in _OF_LAWS)
        lines.append((payload, reported, law, plant, peak, residual, _RMS.text(finer), *rest))
    first, second, *last = (column.heading for column in _OF_LAWS)
    columns = ("payload", "mass reported", "law", "plant", first, second, "at half the step", *last)
    note = (
        "50 deg in minimum time, a = 1 to 8 m, 40 s. The consistent plant has 4 + 4 modes; damped "
        "is the same with a damping of 1 ms (1 % of the first mode at 8 m, more of the others), "
        "the others have none. Settled: the tip within 1 mm of the axis and 10 mm of the target "
        "for good; a dash is never. At half the step: the residual RMS with a step of 0.25 ms; "
        "where it differs, the flight is one of many. Last column: RMS deflection of link 2 at the "
        "end."
    )
    return Outcome(tuple(rows), note, grid=Grid(columns, tuple(lines)))


@dataclass(frozen=True)
class Loop:
    """The linear law about a resting arm, with the gains that a flight under ``law`` has.

    Attributes
    ----------
    law
        Name in `drm_baselines.thesis.manoeuvres.LAWS`.
    root, tip
        Gains on the slew rate, with a tenth of it on the angle, and on beta', N m s and N s.
    period
        Between two samples, s.
    damping
        Time constant of the structural damping, s.
    """

    law: str
    root: float
    tip: float
    period: float = 2e-3
    damping: float = 0.0

    def growth(self, payload: str, a: float, plant: str, modes: int) -> float:
        """Return the growth rate of the fastest growing motion, 1/s; 0 is a free rotation.

        The linear plant at the length ``a`` (m) is driven by torques that are held from sample to
        sample, without limits.
        """
        options: dict[str, Any] = {"modes": (modes, modes)} if plant == "consistent" else {}
        linear = drm_env.Model(
            {**arm.payload(payload)},
            plant=plant,
            dynamics={"structural_damping": self.damping},
            **options,
        ).linearize(a)
        gain = np.zeros((len(linear.inputs), len(linear.outputs)))
        root, tip = (linear.inputs.index(f"{end}_torque") for end in ("root", "tip"))
        gain[root, linear.outputs.index("slew_rate")] = self.root
        gain[root, linear.outputs.index("slew_angle")] = self.root / 10.0
        gain[tip, linear.outputs.index("link2_deflection_rate")] = self.tip / 2.0
        size = len(linear.A)
        held = np.zeros((size + len(gain), size + len(gain)))
        held[:size] = self.period * np.hstack([linear.A, linear.B])
        moved = np.asarray(expm(held))[:size]
        poles = np.linalg.eigvals(moved[:, :size] - moved[:, size:] @ gain @ linear.C)
        return math.log(float(np.abs(poles).max())) / self.period

    def flight(self, payload: str, a: float, modes: int) -> drm_env.Trajectory:
        """Return 20 s on the consistent plant after a release of link 2 by 2e-6 mm."""
        return replace(
            _FLIGHT,
            payload=payload,
            law=self.law,
            start=a,
            end=a,
            angle_deg=0.0,
            initial_beta=_RELEASE,
            modes=(modes, modes),
            sample_period=self.period,
            damping=self.damping,
        ).flight()


LOOPS = {
    "root law": Loop("linear root", 8e4, 0.0),
    "root law every 0.5 ms": Loop("linear root", 8e4, 0.0, period=5e-4),
    "root law, gains / 80": Loop("linear root, low gain", 1e3, 0.0),
    "root law, gains / 80, every 0.5 ms": Loop("linear root, low gain", 1e3, 0.0, period=5e-4),
    "tip law": Loop("linear tip", 0.0, 500.0),
    "tip law every 0.5 ms": Loop("linear tip", 0.0, 500.0, period=5e-4),
    "tip law, damping 1 ms": Loop("linear tip", 0.0, 500.0, damping=1e-3),
    "both": Loop("linear", 8e4, 500.0),
    "both, damping 1 ms": Loop("linear", 8e4, 500.0, damping=1e-3),
}
"""Closed loops whose stability is studied."""


def _stability() -> Outcome:
    rows: list[Row] = []
    lines: list[tuple[str, ...]] = []
    plants = [("thesis", 1), ("consistent", 1), ("consistent", 2), ("consistent", 4)]
    for (words, loop), a in itertools.product(LOOPS.items(), (1.0, 4.0, 8.0)):
        place = f"{words}, a = {a:g} m"
        cells = []
        for plant, n in plants:
            rate = loop.growth("P1", a, plant, n)
            rows.append(
                ours_only(f"{place}, {plant} plant, {n} + {n} modes, growth rate", "1/s", rate)
            )
            cells.append(f"{rate + 0.0:+.2f}" if abs(rate) >= 0.005 else "0.00")
        left = 1e3 * vibration(loop.flight("P1", a, 4), 15.0, 20.0)
        rows.append(ours_only(f"{place}, 4 + 4 modes, RMS of link 2 from 15 to 20 s", "mm", left))
        lines.append((words, f"{a:g}", *cells, f"{left:.1e}"))
    columns = (
        "linear law",
        "a (m)",
        "thesis (1/s)",
        *(f"{n} + {n} (1/s)" for _, n in plants[1:]),
        "flown (mm)",
    )
    note = (
        "Payload 1. Growth rates of the fastest growing motion of the linear plant under the "
        "sampled law without torque limits; positive is unstable. Last column: RMS deflection of "
        "link 2 from 15 to 20 s after it is released by 2e-6 mm, with 4 + 4 modes and the torque "
        "limits: what is above that is where switching between the limits leads. The integrator "
        "damps modes that its step of 0.5 ms cannot resolve, the growth rates do not."
    )
    return Outcome(tuple(rows), note, grid=Grid(columns, tuple(lines)))


def least_unstable_root_gain(
    payload: str, a: float, plant: str, modes: int, period: float
) -> float:
    """Return the smallest gain of the root law on the slew rate that is unstable, N m s.

    Parameters
    ----------
    payload, a
        Payload and length of link 2 outside link 1, m.
    plant, modes
        As for `Loop.growth`.
    period
        Between two samples, s.

    Returns
    -------
    gain
        From 10, where the search begins, to 1e6 N m s, NaN if all of these are stable; a tenth of
        it is on the angle.
    """

    def unstable(gain: float) -> bool:
        loop = Loop("linear root", gain, 0.0, period=period)
        return loop.growth(payload, a, plant, modes) > 1e-3

    gains = np.geomspace(10.0, 1e6, 51)
    first = next((i for i, gain in enumerate(gains) if unstable(float(gain))), None)
    if first is None:
        return math.nan
    if first == 0:
        return float(gains[0])
    low, high = float(gains[first - 1]), float(gains[first])
    for _ in range(12):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return high


def _root_law() -> Outcome:
    rows: list[Row] = []
    lines: list[tuple[str, ...]] = []
    plants = [("thesis", 1), ("consistent", 1), ("consistent", 2), ("consistent", 4)]
    for payload, a in itertools.product(("P0", "P1", "P3"), (1.0, 4.0, 8.0)):
        cells = []
        for plant, n in plants:
            gain = least_unstable_root_gain(payload, a, plant, n, 2e-3)
            place = f"{arm.PAYLOAD_TITLES[payload]}, a = {a:g} m, {plant} plant, {n} + {n} modes"
            if math.isfinite(gain):
                rows.append(ours_only(f"{place}, smallest unstable gain", "N m s", gain))
            least = "at most " if gain == 10.0 else ""
            cells.append(f"{least}{gain:.3g}" if math.isfinite(gain) else "-")
        lines.append((payload, f"{a:g}", *cells))
    columns = ("payload", "a (m)", "thesis", *(f"{n} + {n}" for _, n in plants[1:]))
    note = (
        "Smallest gain on the slew rate (N m s) at which the root law alone, sampled every 2 ms, "
        "without torque limits and with a tenth of the gain on the angle, is unstable; the thesis "
        "has 8e4. Plants: the thesis', and the consistent one by its modes."
    )
    return Outcome(tuple(rows), note, grid=Grid(columns, tuple(lines)))


def tip_law_growth(payload: str, a: float, gain: float, count: int = 5) -> tuple[_Array, _Array]:
    """Return natural frequencies (Hz) and the growth rates (1/s) that a small tip gain gives them.

    The tip wheel's torque -gain y2'/2 does work on the slope of the tip, so that a mode with modal
    mass m, slope s of the tip and deflection y2 of link 2's tip from its root's tangent grows with
    -gain s y2 / (4 m): it is damped only if s and y2 have the same sign. Modes are those of beam
    finite elements.

    Parameters
    ----------
    payload, a
        Payload and length of link 2 outside link 1, m.
    gain
        Of the tip law on beta', N s.
    count
        Number of modes.
    """
    mass, length, width = arm.PAYLOADS[payload]
    links = arm.LINK1, arm.LINK2
    joint, reach = links[0].length, links[0].length + a
    x, shapes, frequencies = arm.model(payload, plant="finite_element").mode_shapes(a, count)
    density = np.where(x <= joint, links[0].mass_per_length, 0.0)
    density += np.where(x >= reach - links[1].length, links[1].mass_per_length, 0.0)
    rates = []
    for shape in shapes:
        slope = np.gradient(shape, x, edge_order=2)
        tip = float(slope[-1])
        y2 = float(shape[-1] - np.interp(joint, x, shape) - a * np.interp(joint, x, slope))
        modal = float(np.trapezoid(density * shape**2, x))
        modal += mass * (float(shape[-1]) + 0.5 * length * tip) ** 2
        modal += mass * (length**2 + width**2) / 12.0 * tip**2
        rates.append(-gain * tip * y2 / (4.0 * modal))
    return frequencies, np.array(rates)


def _tip_law() -> Outcome:
    rows: list[Row] = []
    lines: list[tuple[str, ...]] = []
    for payload, a in itertools.product(("P0", "P1", "P3"), (1.0, 4.0, 8.0)):
        found = list(zip(*tip_law_growth(payload, a, 500.0), strict=True))
        place = f"{arm.PAYLOAD_TITLES[payload]}, a = {a:g} m, mode"
        for mode, (frequency, rate) in enumerate(found, start=1):
            rows += [
                ours_only(f"{place} {mode}, frequency", "Hz", float(frequency)),
                ours_only(f"{place} {mode}, growth rate", "1/s", float(rate)),
            ]
        lines.append((payload, f"{a:g}", *(f"{f:.1f} Hz {rate:+.2f}" for f, rate in found)))
    columns = ("payload", "a (m)", *(f"mode {mode} (1/s)" for mode in range(1, 6)))
    note = (
        "Growth rates that T2 = -500 beta' gives the modes of beam finite elements, to first order "
        "in the gain: the slope of the tip times link 2's deflection over the modal mass. Positive "
        "is unstable without damping."
    )
    return Outcome(tuple(rows), note, grid=Grid(columns, tuple(lines)))


_MASSES = (0.0, 50.0, 200.0, 500.0, 1000.0, 3000.0, 10_000.0, 30_000.0)
"""Masses of payloads, kg."""

_RATES = (0.005, 0.02, 0.04)
"""Largest accelerations of the slew, rad/s^2."""

_REFINED: tuple[dict[str, Any], ...] = ({}, {"modes": (6, 6)}, {"integrator_step": 1e-4})
"""A flight with 4 + 4 modes and steps of 0.5 ms, with more modes, with shorter steps."""


def _payloads() -> Outcome:
    rows: list[Row] = []
    lines: list[tuple[str, ...]] = []
    cases = list(itertools.product(_MASSES, _RATES))
    found = []
    for refined in _REFINED:
        scenarios = [
            {
                "plant": "consistent",
                "horizon": 40.0,
                "payload": {"mass": mass},
                "slew": {"max_accel": accel, "profile": "min_energy", "smoothing": 0.05},
                "deployment": {"start": 8.0, "mode": "none"},
                **refined,
            }
            for mass, accel in cases
        ]
        found.append(drm_env.rollout(scenarios, "none"))
    for i, (mass, accel) in enumerate(cases):
        place = f"{mass:g} kg, {accel:g} rad/s^2"
        peaks, residuals = (
            [1e3 * float(flown[name][i]) for flown in found]
            for name in ("peak_deflection", "residual_peak")
        )
        if not math.isfinite(peaks[0]):
            lines.append((f"{mass:g}", f"{accel:g}", "diverged", "", "", "", "", ""))
            continue
        rows.append(ours_only(f"{place}, {_PEAK.quantity}", "mm", peaks[0]))
        rows.append(ours_only(f"{place}, {_RESIDUAL.quantity}", "mm", residuals[0]))
        texts = []
        for values in (peaks, residuals):
            changes = [100.0 * (value / values[0] - 1.0) for value in values[1:]]
            texts += [f"{values[0]:.2f}", *map(_percent, changes)]
            rows += [
                ours_only(f"{place}, {quantity}", "%", change)
                for quantity, change in zip(
                    (f"change with {what}" for what in ("6 + 6 modes", "steps of 0.1 ms")),
                    changes,
                    strict=True,
                )
            ]
        lines.append((f"{mass:g}", f"{accel:g}", *texts))
    columns = (
        "payload (kg)", "slew (rad/s^2)", _PEAK.heading, "6 + 6 modes (%)", "0.1 ms (%)",
        _RESIDUAL.heading, "6 + 6 modes (%)", "0.1 ms (%)",
    )  # fmt: skip
    note = (
        "50 deg at a fixed 8 m, minimum energy with smoothing 0.05, open loop, no damping, 40 s; "
        "4 + 4 modes and steps of 0.5 ms, and what changes with more of either. Diverged: the tip "
        "is deflected by more than a quarter of the reach."
    )
    return Outcome(tuple(rows), note, grid=Grid(columns, tuple(lines)))


def consistent_entries() -> list[Entry]:
    """Return the studies of the consistent plant."""
    return [
        Entry("consistent-convergence", "Convergence with the number of modes", "", _convergence),
        Entry("consistent-payloads", "Convergence for any payload", "", _payloads),
        Entry("consistent-laws", "The laws on the thesis plant and on the consistent plant", "",
              _laws),
        Entry("consistent-smooth-slew", "The laws in a smooth slew with the mass known", "",
              _smooth_slew),
        Entry("consistent-stability", "Stability of the linear law with the number of modes", "",
              _stability),
        Entry("consistent-root-law", "Gain from which the sampled root law is unstable", "",
              _root_law),
        Entry("consistent-tip-law", "What the linear tip law does to each mode", "", _tip_law),
    ]  # fmt: skip
