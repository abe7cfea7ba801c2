"""Flights as a page draws them: linked charts of their signals, and the arm that moves.

A chart has one grid of times for all flights. Where a flight has more samples than the grid, the
smallest and the largest value of each interval are kept, so that no peak is lost; where it has
fewer, the grid is filled between its samples.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.pages.blocks import Data

Signals = Mapping[str, NDArray[np.float64]]

BUDGET = 2_500_000
"""About how many bytes the signals of a page take at most."""
MOST_INTERVALS = 1000
FEWEST_INTERVALS = 200
"""Into how many intervals a flight is cut."""
_BYTES = 4.0 * 4.0 / 3.0
"""A number of single precision as base64."""
_DEGREES = 180.0 / math.pi


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A flight of one policy.

    Attributes
    ----------
    label, colour, dash
        How it is called, and its line: ``"#RRGGBB"``, and lengths of strokes and gaps (CSS px).
    signals
        By name, as in ``drm_env.Trajectory``, SI.
    diverged
        Whether it was broken off.
    """

    label: str
    colour: str
    dash: tuple[float, ...]
    signals: Signals
    diverged: bool = False


@dataclass(frozen=True, kw_only=True)
class Manoeuvre:
    """Flights of one manoeuvre.

    Attributes
    ----------
    title
        What distinguishes it from others on the page.
    flights
        Who flew.
    links
        Lengths of link 1 and link 2, m.
    masses
        True and reported mass of the payload, kg.
    target
        Slew angle at the end, rad.
    slew_end
        End of the slew profile, s.
    limits
        Torque limits of root and tip wheel, N m.
    magnification
        Factor by which deflections are drawn larger than they are.
    """

    title: str
    flights: Sequence[Flight]
    links: tuple[float, float]
    masses: tuple[float, float]
    target: float
    slew_end: float
    limits: tuple[float, float]
    magnification: float


@dataclass(frozen=True, kw_only=True)
class _Chart:
    """A chart: the signals it needs, and its values from them and the length of link 1."""

    key: str
    title: str
    unit: str
    meaning: str
    needs: tuple[str, ...]
    values: Callable[[Signals, float], NDArray[np.float64]]
    more: bool = False


def tip_error(signals: Signals, link1: float) -> NDArray[np.float64]:
    """Return the error of the tip, r e + y, m: what flights are judged by."""
    reach = link1 + signals["extension"]
    error = signals["slew_angle"] - signals["reference_angle"]
    return np.asarray(reach * error + signals["tip_deflection"])


CHARTS = (
    _Chart(
        key="tip_error",
        title="Tip error",
        unit="mm",
        meaning="r e + y: reach times slew error, and deflection; what is judged",
        needs=("extension", "slew_angle", "reference_angle", "tip_deflection"),
        values=lambda s, link1: tip_error(s, link1) * 1e3,
    ),
    _Chart(
        key="tip_deflection",
        title="Tip deflection",
        unit="mm",
        meaning="y: of the tip against the straight arm",
        needs=("tip_deflection",),
        values=lambda s, _: s["tip_deflection"] * 1e3,
    ),
    _Chart(
        key="slew_angle",
        title="Slew angle",
        unit="deg",
        meaning="of link 1 at the shoulder; wide and pale: the reference",
        needs=("slew_angle",),
        values=lambda s, _: s["slew_angle"] * _DEGREES,
    ),
    _Chart(
        key="slew_error",
        title="Slew error",
        unit="deg",
        meaning="e: slew angle minus reference",
        needs=("slew_angle", "reference_angle"),
        values=lambda s, _: (s["slew_angle"] - s["reference_angle"]) * _DEGREES,
    ),
    _Chart(
        key="root_torque",
        title="Root wheel torque",
        unit="N m",
        meaning="of the reaction wheel at the shoulder; dotted: its limits",
        needs=("root_torque",),
        values=lambda s, _: s["root_torque"],
    ),
    _Chart(
        key="tip_torque",
        title="Tip wheel torque",
        unit="N m",
        meaning="of the reaction wheel at the tip; dotted: its limits",
        needs=("tip_torque",),
        values=lambda s, _: s["tip_torque"],
    ),
    _Chart(
        key="root_momentum",
        title="Root wheel momentum",
        unit="N m s",
        meaning="what the wheel at the shoulder has stored",
        needs=("root_momentum",),
        values=lambda s, _: s["root_momentum"],
        more=True,
    ),
    _Chart(
        key="tip_momentum",
        title="Tip wheel momentum",
        unit="N m s",
        meaning="what the wheel at the tip has stored",
        needs=("tip_momentum",),
        values=lambda s, _: s["tip_momentum"],
        more=True,
    ),
    _Chart(
        key="slew_torque",
        title="Slew motor torque",
        unit="N m",
        meaning="of the motor that turns the arm",
        needs=("slew_torque",),
        values=lambda s, _: s["slew_torque"],
        more=True,
    ),
    _Chart(
        key="extension",
        title="Extension",
        unit="m",
        meaning="of link 2 out of link 1",
        needs=("extension",),
        values=lambda s, _: s["extension"],
        more=True,
    ),
)
"""The charts in their order; those with ``more`` are folded away at first."""

_ARM = ("slew_angle", "extension", "alpha", "beta", "tip_deflection")
"""What the picture of the arm needs, in the order of the page's script."""


def packed(values: NDArray[np.float64]) -> str:
    """Return numbers as base64 of single precision, little-endian."""
    with np.errstate(over="ignore"):
        return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode("ascii")


def on_grid(
    time: NDArray[np.float64], values: NDArray[np.float64], duration: float, intervals: int
) -> NDArray[np.float64]:
    """Return values on the grid of a chart, two for each interval and the last.

    Parameters
    ----------
    time, values
        A signal, each of shape (samples,), time rising.
    duration, intervals
        The grid: so many intervals of equal length from 0 to ``duration``. Points are at the
        beginning and the middle of each.

    Returns
    -------
    values
        Shape (2 * intervals + 1,), NaN after the last sample. An interval with more than two
        samples has its smallest and its largest value, in the order in which the signal begins
        nearer to them; one with fewer is filled by linear interpolation.
    """
    grid = np.linspace(0.0, duration, 2 * intervals + 1)
    tolerance = 1e-9 * max(1.0, duration)
    found = np.interp(grid, time, values)
    edges = np.searchsorted(time, grid[::2] - tolerance)
    counts = np.diff(edges)
    crowded = np.flatnonzero(counts > 2)
    if crowded.size:
        # of intervals that follow each other, reduceat takes each to the beginning of the next
        pairs = np.stack([edges[crowded], edges[crowded] + counts[crowded]], axis=1).ravel()
        padded = np.append(values, values[-1])
        low = np.minimum.reduceat(padded, pairs)[::2]
        high = np.maximum.reduceat(padded, pairs)[::2]
        first = values[edges[crowded]]
        rising = first - low <= high - first
        found[2 * crowded] = np.where(rising, low, high)
        found[2 * crowded + 1] = np.where(rising, high, low)
    found[grid > time[-1] + tolerance] = np.nan
    return found


def _intervals(manoeuvre: Manoeuvre, most: int) -> int:
    """Into how many intervals: as many as the finest flight fills, ``most`` at most."""
    needed = max(math.ceil((flight.signals["time"].size - 1) / 2) for flight in manoeuvre.flights)
    return max(1, min(most, needed))


def _encoded(manoeuvre: Manoeuvre, charts: Sequence[_Chart], most: int) -> dict[str, Any]:
    intervals = _intervals(manoeuvre, most)
    duration = max(float(flight.signals["time"][-1]) for flight in manoeuvre.flights)
    link1 = manoeuvre.links[0]
    longest = max(manoeuvre.flights, key=lambda flight: float(flight.signals["time"][-1]))
    instants = np.linspace(0.0, duration, intervals + 1)
    flights = []
    for flight in manoeuvre.flights:
        time = flight.signals["time"]
        arm = np.array([np.interp(instants, time, flight.signals[name]) for name in _ARM])
        flights.append(
            {
                "label": flight.label,
                "colour": flight.colour,
                "dash": list(flight.dash),
                "end": float(time[-1]),
                "diverged": flight.diverged,
                "charts": {
                    chart.key: packed(
                        on_grid(time, chart.values(flight.signals, link1), duration, intervals)
                    )
                    for chart in charts
                },
                "arm": packed(arm),
            }
        )
    reference = np.interp(instants, longest.signals["time"], longest.signals["reference_angle"])
    return {
        "title": manoeuvre.title,
        "duration": duration,
        "intervals": intervals,
        "links": list(manoeuvre.links),
        "masses": list(manoeuvre.masses),
        "target": manoeuvre.target,
        "slewEnd": min(manoeuvre.slew_end, duration),
        "limits": {"root_torque": manoeuvre.limits[0], "tip_torque": manoeuvre.limits[1]},
        "magnification": manoeuvre.magnification,
        "reference": packed(reference),
        "flights": flights,
    }


def flights_block(manoeuvres: Sequence[Manoeuvre]) -> Data:
    """Return flights as a block of a page, with what was left out of them stated below.

    Raises
    ------
    ValueError
        No manoeuvre, or one without flights.
    """
    if not manoeuvres or not all(manoeuvre.flights for manoeuvre in manoeuvres):
        raise ValueError("there must be a flight in every manoeuvre")
    everybody = [flight for manoeuvre in manoeuvres for flight in manoeuvre.flights]
    charts = [
        chart
        for chart in CHARTS
        if all(name in flight.signals for flight in everybody for name in chart.needs)
    ]
    numbers = 2 * len(charts) + len(_ARM)
    most = int(BUDGET / (_BYTES * len(everybody) * numbers))
    most = min(MOST_INTERVALS, max(FEWEST_INTERVALS, most))
    content = [_encoded(manoeuvre, charts, most) for manoeuvre in manoeuvres]
    finest = max(item["duration"] / item["intervals"] for item in content)
    return Data(
        script="flights",
        content={
            "charts": [
                {
                    "key": chart.key,
                    "title": chart.title,
                    "unit": chart.unit,
                    "meaning": chart.meaning,
                    "more": chart.more,
                }
                for chart in charts
            ],
            "manoeuvres": content,
        },
        note=(
            f"Curves: time is cut into intervals of {1e3 * finest:.3g} ms or less; where a flight "
            "has more than two samples in one, its smallest and largest value are drawn, so that "
            "no peak is lost. The picture of the arm has one instant for each interval."
        ),
    )
