"""Aggregates over episodes: interquartile mean, bootstrap intervals, paired comparison.

Episodes of this task spread over decades (a heavy misreported payload saturates the wheels), so
that a plain mean is ruled by a few of them. The interquartile mean keeps the middle half; the
interval says how far the figure depends on the episodes that happened to be drawn. Comparisons
are paired: both policies flew the same episodes, which removes the spread between episodes.
The method follows Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical
Precipice" (2021); the arithmetic is scipy's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_baselines.support.extras import needing

RESAMPLES = 4000
CONFIDENCE = 0.95
_TRIM = 0.25
_BEYOND = 1e100
_BATCH_VALUES = 1 << 24  # 128 MiB of resampled values at a time


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A point estimate with its bootstrap interval, in the unit of the data.

    ``low`` and ``high`` bound the 95 % percentile interval; ``count`` is the number of episodes.
    """

    value: float
    low: float
    high: float
    count: int

    def scaled(self, factor: float) -> Estimate:
        """Return the estimate in another unit (``factor`` > 0)."""
        return Estimate(
            value=self.value * factor,
            low=self.low * factor,
            high=self.high * factor,
            count=self.count,
        )

    def to_dict(self) -> dict[str, float | int]:
        """Return plain numbers for JSON."""
        return {"value": self.value, "low": self.low, "high": self.high, "count": self.count}


@dataclass(frozen=True, kw_only=True)
class PairedComparison:
    """How a candidate compares with a reference on the same episodes.

    ``difference`` is the (interquartile) mean of candidate minus reference; ``improvement`` the
    share of episodes where the candidate is better (ties count half).
    """

    difference: Estimate
    improvement: Estimate
    better: bool
    worse: bool

    @property
    def verdict(self) -> str:
        """``"better"``, ``"worse"`` or ``"undecided"``: the sign that the whole interval has."""
        if self.better:
            return "better"
        return "worse" if self.worse else "undecided"

    def to_dict(self) -> dict[str, object]:
        """Return plain values for JSON."""
        return {
            "difference": self.difference.to_dict(),
            "probability_of_improvement": self.improvement.to_dict(),
            "verdict": self.verdict,
        }


def _vector(values: ArrayLike, name: str) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"{name} must be a non-empty 1-D array, got shape {array.shape}")
    if np.isnan(array).any():
        raise ValueError(
            f"{name} contains NaN: censored or diverged episodes have to be given a value "
            "before they are averaged, not dropped"
        )
    return array


def interquartile_mean(values: ArrayLike) -> float:
    """Return the mean of the middle half of ``values`` (1-D, no NaN).

    Examples
    --------
    >>> from drm_baselines.evaluation.statistics import interquartile_mean
    >>> interquartile_mean([-1000.0, 1.0, 3.0, 1000.0])
    2.0
    """
    return float(_trim_mean(_vector(values, "values")))


def _trim_mean(values: NDArray[np.float64], axis: int = 0) -> Any:
    # imported where it is used: it takes a second, which tables of single flights need not wait for
    with needing("statistics of episodes", "evaluate"):
        from scipy import stats

    return stats.trim_mean(values, _TRIM, axis=axis)


def _interquartile_axis(sample: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    return np.asarray(_trim_mean(sample, axis=axis))


def _mean_axis(sample: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    return np.asarray(np.mean(sample, axis=axis))


def _real(value: float) -> float:
    return math.copysign(math.inf, value) if abs(value) > 1e-6 * _BEYOND else value


def _estimate(values: NDArray[np.float64], seed: int, *, trimmed: bool) -> Estimate:
    with needing("statistics of episodes", "evaluate"):
        from scipy import stats

    statistic = _interquartile_axis if trimmed else _mean_axis
    # Quantiles of the resampled figures cannot be interpolated at infinity, so that diverged
    # episodes enter as a value beyond any real one and leave as what they are.
    finite = np.clip(values, -_BEYOND, _BEYOND)
    value = _real(float(statistic(finite)))
    if np.unique(finite).size == 1:
        # Every resample is the same: the interval is a point, which scipy would warn about.
        return Estimate(value=value, low=value, high=value, count=values.size)
    result = stats.bootstrap(
        (finite,),
        statistic,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        vectorized=True,
        axis=-1,
        batch=max(1, min(500, _BATCH_VALUES // finite.size)),
        rng=np.random.default_rng(seed),
    )
    interval = result.confidence_interval
    return Estimate(
        value=value,
        low=_real(float(interval.low)),
        high=_real(float(interval.high)),
        count=values.size,
    )


def interquartile_estimate(values: ArrayLike, *, seed: int = 0) -> Estimate:
    """Return the interquartile mean of episodes with its 95 % bootstrap interval.

    ``seed`` fixes the resampling, so that the same records always give the same interval.
    """
    return _estimate(_vector(values, "values"), seed, trimmed=True)


def mean_estimate(values: ArrayLike, *, seed: int = 0) -> Estimate:
    """Return the mean of episodes with its 95 % bootstrap interval (for fractions)."""
    return _estimate(_vector(values, "values"), seed, trimmed=False)


def compare_paired(
    candidate: ArrayLike,
    reference: ArrayLike,
    *,
    higher_is_better: bool = False,
    trimmed: bool = True,
    seed: int = 0,
) -> PairedComparison:
    """Compare two policies over the same episodes, row by row.

    Parameters
    ----------
    candidate
        Metric of the candidate, one value an episode.
    reference
        Metric of the reference for the same episodes in the same order.
    higher_is_better
        Direction of the metric.
    trimmed
        Whether the difference is an interquartile mean, or a plain mean (for fractions).
    seed
        Fixes the bootstrap's resampling.

    Raises
    ------
    ValueError
        The arrays differ in length, are empty or contain NaN.

    Examples
    --------
    >>> from drm_baselines.evaluation.statistics import compare_paired
    >>> found = compare_paired([1.0, 2.0, 3.0, 4.0], [2.0, 3.0, 4.0, 5.0])
    >>> found.difference.value, found.better
    (-1.0, True)
    """
    first, second = _vector(candidate, "candidate"), _vector(reference, "reference")
    if first.shape != second.shape:
        raise ValueError(f"paired arrays differ in length: {first.size} and {second.size}")
    # Two infinite values (both diverged) are a tie.
    with np.errstate(invalid="ignore"):
        difference = np.where(first == second, 0.0, first - second)
    gain = difference if higher_is_better else -difference
    wins = np.where(gain > 0.0, 1.0, np.where(gain == 0.0, 0.5, 0.0))
    estimate = _estimate(_vector(difference, "difference"), seed, trimmed=trimmed)
    above, below = estimate.low > 0.0, estimate.high < 0.0
    return PairedComparison(
        difference=estimate,
        improvement=mean_estimate(wins, seed=seed + 1),
        better=above if higher_is_better else below,
        worse=below if higher_is_better else above,
    )
