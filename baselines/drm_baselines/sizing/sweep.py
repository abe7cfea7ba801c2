"""What happens if a wheel is smaller: the same missions with less momentum or torque."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import drm_env
from drm_baselines.sizing.requirements import limited

SWEPT = {
    "root_wheel_momentum": ("root", "momentum_limit", "N m s"),
    "root_wheel_torque": ("root", "torque_limit", "N m"),
    "tip_wheel_torque": ("tip", "torque_limit", "N m"),
}
"""What is made smaller: wheel, limit, unit."""

FACTORS = (0.1, 0.25, 0.5, 0.75, 0.9, 1.0, 1.25)
"""Sizes of the sweep, as parts of the full one."""


@dataclass(frozen=True, kw_only=True)
class SweepPoint:
    """Missions with one limit of one wheel.

    Attributes
    ----------
    name
        One of `SWEPT`.
    factor, limit
        Part of the full size, and the limit itself, SI.
    settled
        Part of the missions that settle.
    final_error, final_error_high
        Median and 95 % quantile of the slew error at the end, rad.
    tip_error, tip_error_high
        Median and 95 % quantile of the RMS error of the tip, m.
    """

    name: str
    factor: float
    limit: float
    settled: float
    final_error: float
    final_error_high: float
    tip_error: float
    tip_error_high: float


def sweep(
    scenarios: Sequence[Mapping[str, Any]],
    law: Mapping[str, Any],
    full: Mapping[str, float],
    *,
    seed: int = 0,
    factors: Sequence[float] = FACTORS,
    progress: Callable[[int, int], object] | None = None,
) -> list[SweepPoint]:
    """Fly missions with ever larger limits of one wheel, all else as it is.

    Parameters
    ----------
    scenarios, law, seed
        What is flown, the same for every limit.
    full
        The size that factors are of, by the names of `SWEPT`; what is not in it is not swept.
    factors
        See `FACTORS`.
    progress
        Called with flights done and their number.
    """
    wanted = [(name, factor) for name in full for factor in factors]
    points = []
    for place, (name, factor) in enumerate(wanted):
        wheel, field, _ = SWEPT[name]
        limit = factor * full[name]
        parts: dict[str, Mapping[str, float]] = {"root": {}, "tip": {}}
        parts[wheel] = {field: limit}
        first = place * len(scenarios)

        def tell(done: int, _: int, first: int = first) -> None:
            if progress is not None:
                progress(first + done, len(wanted) * len(scenarios))

        flown = drm_env.rollout(
            [limited(each, root=parts["root"], tip=parts["tip"]) for each in scenarios],
            law=dict(law),
            seed=seed,
            progress=tell,
        )
        # one that diverged is as bad as can be
        error = np.nan_to_num(np.abs(flown["final_slew_error"]), nan=np.inf)
        tip = np.nan_to_num(flown["tip_error_rms"], nan=np.inf)
        points.append(
            SweepPoint(
                name=name,
                factor=factor,
                limit=limit,
                settled=float(flown["settled"].mean()),
                final_error=float(np.median(error)),
                final_error_high=float(np.quantile(error, 0.95, method="inverted_cdf")),
                tip_error=float(np.median(tip)),
                tip_error_high=float(np.quantile(tip, 0.95, method="inverted_cdf")),
            )
        )
    return points
