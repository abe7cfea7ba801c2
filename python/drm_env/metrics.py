"""What the metrics of an episode are: units, descriptions and formulas.

The engine computes them from the states of an episode, in SI units and radians; they are in the
last info of an episode as ``metrics/<name>`` (of a single environment in every info, those of the
episode so far; see `drm_env.info_metrics`), and in what `simulate` and `rollout` return.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["METRIC_SYMBOLS", "MetricEntry", "episode_metrics"]


class MetricEntry(NamedTuple):
    """One metric of an episode.

    Attributes
    ----------
    name
        what it is called.
    unit
        SI unit; ``"1"`` for a pure number.
    description
        what it is.
    formula
        how it is formed, in the symbols of `METRIC_SYMBOLS`.
    """

    name: str
    unit: str
    description: str
    formula: str


METRIC_SYMBOLS = {
    "k": "the samples 1 ... n of the episode, dt apart (sample_period); none is at t = 0",
    "e": "slew angle minus reference angle, rad",
    "theta": "slew angle in the direction of the slew, rad",
    "r": "reach, from the shoulder to the tip, m",
    "y": "deflection of the tip, m",
    "u1, u2": "torque of the root and of the tip wheel over its limit, after lag and dead time",
    "t_f": "end of the slew profile, s",
    "s": "the samples at t >= t_f",
}
"""Symbols of the formulas."""

_METRICS = (
    MetricEntry(
        "tip_error_rms", "m", "RMS error of the tip over the episode.", "sqrt(mean_k (r e + y)^2)"
    ),
    MetricEntry(
        "peak_deflection", "m", "Largest deflection of the tip, the start included.", "max_k |y|"
    ),
    MetricEntry(
        "peak_slew_angle",
        "rad",
        "Largest slew angle in the direction of the slew, the start included.",
        "max_k theta",
    ),
    MetricEntry(
        "residual_rms",
        "m",
        "RMS deflection of the tip after the slew; NaN if the episode ended before.",
        "sqrt(mean_s y^2)",
    ),
    MetricEntry(
        "residual_peak",
        "m",
        "Largest deflection of the tip after the slew; NaN if the episode ended before.",
        "max_s |y|",
    ),
    MetricEntry(
        "settling_time",
        "s",
        "Time after the slew until the arm is settled to the end of the episode; NaN where that "
        "is never.",
        "first t - t_f from which |y| <= 1 mm and |r e| <= 10 mm hold in s to the end; 0 if in "
        "all s",
    ),
    MetricEntry(
        "settled", "1", "Whether the settling time exists: 1 or 0.", "1 if settling_time exists"
    ),
    MetricEntry("final_slew_error", "rad", "Slew error at the end, with its sign.", "e at n"),
    MetricEntry(
        "overshoot",
        "rad",
        "Largest slew angle beyond the final reference; 0 if it is not passed.",
        "max(0, peak_slew_angle - final reference)",
    ),
    MetricEntry(
        "wheel_effort",
        "s",
        "Squared torque fractions of both wheels, integrated over the episode.",
        "dt sum_k (u1^2 + u2^2)",
    ),
    MetricEntry(
        "saturation",
        "1",
        "Fraction of the time in which the command of a wheel is at its limit.",
        "mean_k (1 if a wheel's command is at its limit)",
    ),
    MetricEntry(
        "slew_energy",
        "J",
        "Electrical energy of the slew motor.",
        "dt sum_k R i^2 at the beginning of sample k (i: current of slew torque, reference rate "
        "and acceleration)",
    ),
    MetricEntry(
        "residual_energy",
        "J",
        "Kinetic and potential energy of the arm at the end.",
        "T + V at n",
    ),
    MetricEntry("slew_end_time", "s", "End of the slew profile.", "t_f"),
    MetricEntry("duration", "s", "Time flown.", "n dt"),
    MetricEntry(
        "diverged",
        "1",
        "Whether the episode ended by divergence or at a limit of the structure: 1 or 0.",
        "1 if so",
    ),
    MetricEntry(
        "episode_return",
        "1",
        "Sum of the rewards; 0 where none are paid (laws flown without a task).",
        "sum of rewards",
    ),
)


def episode_metrics() -> tuple[MetricEntry, ...]:
    """Every metric of an episode with unit, description and formula, in the engine's order.

    Examples
    --------
    >>> import drm_env
    >>> first = drm_env.episode_metrics()[0]
    >>> first.name, first.unit, first.formula
    ('tip_error_rms', 'm', 'sqrt(mean_k (r e + y)^2)')
    """
    return _METRICS
