"""Names, units and directions of the episode metrics, for tables and plots.

The engine computes the metrics in SI units and radians; this module only says how to show them
(millimetres, degrees) and whether a smaller or a larger value is better. It is the one place
where that is declared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Direction = Literal["lower", "higher", "none"]


@dataclass(frozen=True, kw_only=True)
class Metric:
    """How one metric of an episode is shown.

    ``scale`` multiplies the engine's SI value and gives a number in ``unit``; ``better`` says
    whether a comparison prefers small or large values, or has no preference.
    ``magnitude`` marks signed metrics whose absolute value is what counts.
    """

    name: str
    label: str
    unit: str
    scale: float = 1.0
    better: Direction = "lower"
    magnitude: bool = False
    digits: int = 2


_MILLI = 1e3
_DEGREES = 180.0 / math.pi

METRICS: dict[str, Metric] = {
    metric.name: metric
    for metric in (
        Metric(name="tip_error_rms", label="tip error RMS", unit="mm", scale=_MILLI),
        Metric(name="peak_deflection", label="peak deflection", unit="mm", scale=_MILLI),
        Metric(
            name="peak_slew_angle",
            label="largest slew angle",
            unit="deg",
            scale=_DEGREES,
            better="none",
            digits=3,
        ),
        Metric(
            name="residual_rms", label="residual vibration RMS", unit="mm", scale=_MILLI, digits=3
        ),
        Metric(name="residual_peak", label="residual peak", unit="mm", scale=_MILLI),
        Metric(name="settling_time", label="settling time", unit="s"),
        Metric(name="settled", label="settled", unit="%", scale=100.0, better="higher", digits=0),
        Metric(
            name="final_slew_error",
            label="final slew error",
            unit="deg",
            scale=_DEGREES,
            magnitude=True,
            digits=3,
        ),
        Metric(name="overshoot", label="overshoot", unit="deg", scale=_DEGREES, digits=3),
        Metric(name="wheel_effort", label="wheel effort", unit="s"),
        Metric(name="saturation", label="saturated", unit="%", scale=100.0, digits=1),
        Metric(name="slew_energy", label="slew energy", unit="J", digits=1),
        Metric(name="residual_energy", label="residual energy", unit="J", digits=3),
        Metric(name="episode_return", label="return", unit="", better="higher"),
    )
}

HEADLINE = (
    "tip_error_rms",
    "residual_rms",
    "settled",
    "settling_time",
    "final_slew_error",
    "wheel_effort",
)
"""Metrics of the comparison table, in column order."""


def describe(name: str) -> Metric:
    """Return how ``name`` is shown; a metric unknown here is shown as it comes, in SI units."""
    return METRICS.get(name, Metric(name=name, label=name.replace("_", " "), unit="SI"))
