"""How well a policy flew a suite: interquartile means, and how far they depend on luck.

The training seeds and the episodes were both drawn, so that the bootstrap draws both again: the
seeds with replacement, the episodes with replacement within their stratum. All seeds of a policy
fly the same drawn episodes, and so do two policies that are compared. The method is that of Agarwal
et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice" (2021).

A resample only says how often each value counts. The values are therefore sorted once, and the
interquartile mean of a resample follows from the running sum of its counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_baselines.benchmark.records import Record
from drm_baselines.errors import BaselineError
from drm_baselines.evaluation.metrics import describe
from drm_baselines.evaluation.records import Episodes

FRACTIONS = ("settled", "saturation", "diverged")
"""Metrics between 0 and 1, whose mean is what tables show."""

RESAMPLES = 2000

_TRIM = 0.25
_PERCENTILES = (2.5, 97.5)
# Diverged episodes enter as a value beyond any real one, for percentiles cannot be interpolated at
# infinity. A figure beyond the limit contains such a value and leaves as infinity.
_BEYOND = 1e100
_LIMIT = 1e50
_CHUNK = 1 << 18

# Streams of random numbers. The episodes have their own, so that every policy meets the same ones.
_EPISODES, _CANDIDATE, _REFERENCE = 0, 1, 2

_Array = NDArray[np.float64]
_Counts = NDArray[np.int32]


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Aggregates of one metric over all seeds and episodes, in the unit of the data.

    Attributes
    ----------
    iqm, mean
        Interquartile mean and mean over seeds x episodes.
    ci95, mean_ci95
        95 % percentile intervals of the two, (low, high).
    seeds, episodes
        How many of each.
    fraction
        Whether the mean is the headline (a fraction of episodes or of time).
    """

    iqm: float
    mean: float
    ci95: tuple[float, float]
    mean_ci95: tuple[float, float]
    seeds: int
    episodes: int
    fraction: bool = False

    @property
    def value(self) -> float:
        """The headline: the mean of a fraction, the interquartile mean of anything else."""
        return self.mean if self.fraction else self.iqm

    @property
    def interval(self) -> tuple[float, float]:
        """The interval of the headline, (low, high)."""
        return self.mean_ci95 if self.fraction else self.ci95


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A figure of two policies over the episodes that both flew.

    Attributes
    ----------
    value
        The ratio, probability or difference.
    ci95
        Its 95 % percentile interval, (low, high).
    episodes
        Number of episodes that both flew.
    """

    value: float
    ci95: tuple[float, float]
    episodes: int


def judged(record: Record, name: str) -> _Array:
    """Return a metric in SI with a comparable value for every flight.

    The rules are those of :meth:`drm_baselines.evaluation.records.Episodes.judged`: a censored
    settling time counts as the time that was observed, a signed error by its magnitude, a diverged
    episode as infinitely bad.

    Parameters
    ----------
    record
        Flights of a policy with s seeds and n episodes.
    name
        Metric of the engine.

    Returns
    -------
    ndarray
        Shape (s, n), SI.

    Raises
    ------
    BaselineError
        The record has no such metric.
    """
    if name not in record.metrics:
        raise BaselineError(f"the record of {record.policy!r} has no metric {name!r}")
    shape = (len(record.seeds), len(record.episodes))
    needed = (name, "duration", "slew_end_time")
    flat = Episodes(
        label=record.title,
        control_period=record.control_period,
        seeds=range(math.prod(shape)),
        metrics={key: np.ravel(record.metrics[key]) for key in needed if key in record.metrics},
    )
    return flat.judged(name).reshape(shape)


def restricted(record: Record, episodes: ArrayLike) -> Record:
    """Return a record with those of the episodes that it has, in its own order.

    Parameters
    ----------
    record
        Flights of a policy.
    episodes
        Places in the suite, shape (m,), in any order.
    """
    keep = np.isin(record.episodes, np.asarray(episodes, dtype=np.int64))
    return replace(
        record,
        episodes=record.episodes[keep],
        strata=[stratum for stratum, kept in zip(record.strata, keep, strict=True) if kept],
        metrics={name: values[:, keep] for name, values in record.metrics.items()},
    )


def shared(first: Record, second: Record) -> tuple[Record, Record]:
    """Return two records on the episodes that both have, in ascending order.

    Raises
    ------
    BaselineError
        There are none, or the two disagree about the stratum of one.
    """
    both = np.intersect1d(first.episodes, second.episodes)
    if both.size == 0:
        raise BaselineError(f"{first.policy!r} and {second.policy!r} flew no episode in common")
    left, right = (_sorted(restricted(record, both)) for record in (first, second))
    if list(left.strata) != list(right.strata):
        raise BaselineError(f"{first.policy!r} and {second.policy!r} flew different suites")
    return left, right


def _sorted(record: Record) -> Record:
    order = np.argsort(record.episodes, kind="stable")
    return replace(
        record,
        episodes=record.episodes[order],
        strata=[record.strata[place] for place in order],
        metrics={name: values[:, order] for name, values in record.metrics.items()},
    )


def _checked(values: ArrayLike, strata: Sequence[str], name: str) -> _Array:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.size == 0:
        raise ValueError(f"{name} must have the shape (seeds, episodes), got {array.shape}")
    if len(strata) != array.shape[1]:
        raise ValueError(f"{len(strata)} strata for {array.shape[1]} episodes of {name}")
    if np.isnan(array).any():
        raise ValueError(f"{name} contains NaN: give diverged episodes a value before")
    return np.clip(array, -_BEYOND, _BEYOND)


def _drawn(count: int, rng: np.random.Generator, resamples: int) -> _Counts:
    """How often each of ``count`` things is drawn, shape (resamples, count)."""
    places = rng.integers(0, count, size=(resamples, count))
    places += count * np.arange(resamples)[:, None]
    counts = np.bincount(places.ravel(), minlength=resamples * count)
    return counts.astype(np.int32).reshape(resamples, count)


def _seed_counts(seeds: int, stream: int, seed: int, resamples: int) -> _Counts:
    return _drawn(seeds, np.random.default_rng([seed, stream]), resamples)


def _episode_counts(strata: Sequence[str], seed: int, resamples: int) -> _Counts:
    rng = np.random.default_rng([seed, _EPISODES])
    names = np.asarray(strata)
    counts = np.empty((resamples, names.size), dtype=np.int32)
    for stratum in dict.fromkeys(strata):
        places = np.flatnonzero(names == stratum)
        counts[:, places] = _drawn(places.size, rng, resamples)
    return counts


def _statistics(values: _Array, by_seed: _Counts, by_episode: _Counts) -> tuple[_Array, _Array]:
    """Interquartile mean and mean of each resample.

    Parameters
    ----------
    values
        Shape (s, n), finite.
    by_seed, by_episode
        How often each counts, shapes (b, s) and (b, n).

    Returns
    -------
    tuple
        Both of shape (b,).
    """
    size, resamples = values.size, by_seed.shape[0]
    order = np.argsort(values, axis=None, kind="stable")
    ranked = values.ravel()[order]
    seed_of, episode_of = np.divmod(order, values.shape[1])
    # As scipy.stats.trim_mean: this many of the smallest and of the largest are left out.
    cut = int(_TRIM * size)
    plain = np.sum((by_seed @ values) * by_episode, axis=1) / size
    trimmed = np.empty(resamples)
    step = max(1, _CHUNK // size)
    for first in range(0, resamples, step):
        part = slice(first, first + step)
        counts = by_seed[part].take(seed_of, axis=1) * by_episode[part].take(episode_of, axis=1)
        reached = np.cumsum(counts, axis=1, dtype=np.int32)
        np.clip(reached, cut, size - cut, out=reached)
        kept = np.diff(reached, axis=1, prepend=cut)
        trimmed[part] = kept.astype(np.float64) @ ranked / (size - 2 * cut)
    return trimmed, plain


def _point(values: _Array) -> tuple[float, float]:
    once = [np.ones((1, count), dtype=np.int32) for count in values.shape]
    trimmed, plain = _statistics(values, *once)
    return float(trimmed[0]), float(plain[0])


@lru_cache(maxsize=512)
def _resampled(
    data: bytes,
    shape: tuple[int, int],
    strata: tuple[str, ...],
    stream: int,
    seed: int,
    resamples: int,
) -> tuple[_Array, _Array]:
    """The statistics of all resamples; tables and figures ask for the same ones again and again."""
    found = _statistics(
        np.frombuffer(data).reshape(shape),
        _seed_counts(shape[0], stream, seed, resamples),
        _episode_counts(strata, seed, resamples),
    )
    for array in found:
        array.flags.writeable = False
    return found


def _bootstrap(
    values: _Array, strata: Sequence[str], stream: int, seed: int, resamples: int
) -> tuple[_Array, _Array]:
    """Interquartile mean and mean of each resample, both of shape (resamples,)."""
    seeds, episodes = values.shape
    return _resampled(values.tobytes(), (seeds, episodes), tuple(strata), stream, seed, resamples)


def _real(value: float) -> float:
    return math.copysign(math.inf, value) if abs(value) > _LIMIT else value


def _interval(resampled: _Array) -> tuple[float, float]:
    low, high = np.percentile(np.clip(resampled, -_BEYOND, _BEYOND), _PERCENTILES)
    return _real(float(low)), _real(float(high))


def estimate(
    values: ArrayLike,
    strata: Sequence[str],
    *,
    fraction: bool,
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Estimate:
    """Return interquartile mean and mean with their 95 % intervals.

    Parameters
    ----------
    values
        Shape (s, n): a row a training seed, a column an episode; infinite where it diverged.
    strata
        Stratum of each episode, n of them.
    fraction
        Whether the headline is the mean.
    seed
        Fixes the resampling, so that the same values always give the same intervals.
    resamples
        Number of bootstrap resamples.

    Returns
    -------
    Estimate
        In the unit of ``values``; infinite where diverged episodes reach into the figure.

    Raises
    ------
    ValueError
        Another shape, no values, or NaN.
    """
    array = _checked(values, strata, "values")
    seeds, episodes = array.shape
    trimmed, plain = _bootstrap(array, strata, _CANDIDATE, seed, resamples)
    iqm, mean = _point(array)
    return Estimate(
        iqm=_real(iqm),
        mean=_real(mean),
        ci95=_interval(trimmed),
        mean_ci95=_interval(plain),
        seeds=seeds,
        episodes=episodes,
        fraction=fraction,
    )


def estimate_of(
    record: Record, name: str, *, seed: int = 0, resamples: int = RESAMPLES
) -> Estimate:
    """Return the :func:`estimate` of one metric of a record, SI.

    Raises
    ------
    BaselineError
        The record has no such metric.
    """
    values = judged(record, name)
    return estimate(
        values, record.strata, fraction=name in FRACTIONS, seed=seed, resamples=resamples
    )


def probability_of_improvement(
    candidate: ArrayLike,
    reference: ArrayLike,
    strata: Sequence[str],
    *,
    higher_is_better: bool = False,
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Compared:
    """Return how probably the candidate does better on an episode than the reference.

    All pairs of their training seeds are compared on every episode; a tie counts half.

    Parameters
    ----------
    candidate, reference
        Shapes (s1, n) and (s2, n), the same episodes in the same order; infinite where diverged.
    strata
        Stratum of each episode, n of them.
    higher_is_better
        Direction of the metric.
    seed, resamples
        As for :func:`estimate`.

    Raises
    ------
    ValueError
        Shapes that do not fit, no values, or NaN.
    """
    first = _checked(candidate, strata, "candidate")
    second = _checked(reference, strata, "reference")
    if higher_is_better:
        first, second = -first, -second
    left, right = first[:, None, :], second[None, :, :]
    # shape (s1 s2, n)
    won = ((left < right) + 0.5 * (left == right)).reshape(-1, len(strata))
    of_pairs = _episode_counts(strata, seed, resamples).astype(np.float64) @ won.T / len(strata)
    by_first = _seed_counts(first.shape[0], _CANDIDATE, seed, resamples)
    by_second = _seed_counts(second.shape[0], _REFERENCE, seed, resamples)
    pairs = (by_first[:, :, None] * by_second[:, None, :]).reshape(resamples, -1)
    resampled = np.sum(pairs * of_pairs, axis=1) / won.shape[0]
    return Compared(value=float(won.mean()), ci95=_interval(resampled), episodes=len(strata))


def improvement(
    candidate: Record, reference: Record, name: str, *, seed: int = 0, resamples: int = RESAMPLES
) -> Compared:
    """Return :func:`probability_of_improvement` in one metric on the episodes both have.

    Raises
    ------
    BaselineError
        No common episode, or no such metric.
    """
    first, second = shared(candidate, reference)
    return probability_of_improvement(
        judged(first, name),
        judged(second, name),
        first.strata,
        higher_is_better=describe(name).better == "higher",
        seed=seed,
        resamples=resamples,
    )


def _ratio(above: _Array, below: _Array) -> _Array:
    """Quotients of figures of at least 0; equal ones, also two infinite ones, give 1."""
    above, below = (np.where(np.abs(side) > _LIMIT, np.inf, side) for side in (above, below))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(above == below, 1.0, above / below)


def multiple(
    record: Record,
    bound_record: Record,
    name: str,
    *,
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Compared:
    """Return a policy's figure as a multiple of the bound's, or of another policy's.

    It is the ratio of the interquartile means (of the means for fractions) on the episodes that
    both have; every resample draws the same episodes for both.

    Raises
    ------
    BaselineError
        No common episode, or no such metric.
    """
    first, second = shared(record, bound_record)
    which = 1 if name in FRACTIONS else 0
    points, resampled = [], []
    for side, stream in ((first, _CANDIDATE), (second, _REFERENCE)):
        values = _checked(judged(side, name), side.strata, name)
        points.append(np.array([_point(values)[which]]))
        resampled.append(_bootstrap(values, side.strata, stream, seed, resamples)[which])
    return Compared(
        value=float(_ratio(*points)[0]),
        ci95=_interval(_ratio(*resampled)),
        episodes=len(first.episodes),
    )


def difference(
    candidate: Record, reference: Record, name: str, *, seed: int = 0, resamples: int = RESAMPLES
) -> Compared:
    """Return the paired difference of two policies in one metric, candidate minus reference, SI.

    On every episode that both have, each training seed of the one is held against each of the
    other; the value is the interquartile mean of these differences (the mean for fractions). What
    makes an episode hard for both takes no part. Two diverged flights differ by nothing.

    Raises
    ------
    BaselineError
        No common episode, or no such metric.
    """
    first, second = shared(candidate, reference)
    left, right = judged(first, name)[:, None, :], judged(second, name)[None, :, :]
    with np.errstate(invalid="ignore"):
        pairs = np.where(left == right, 0.0, left - right)
    values = _checked(pairs.reshape(-1, len(first.strata)), first.strata, "the differences")
    by_first = _seed_counts(left.shape[0], _CANDIDATE, seed, resamples)
    by_second = _seed_counts(right.shape[1], _REFERENCE, seed, resamples)
    by_pair = (by_first[:, :, None] * by_second[:, None, :]).reshape(resamples, -1)
    which = 1 if name in FRACTIONS else 0
    by_episode = _episode_counts(first.strata, seed, resamples)
    return Compared(
        value=_real(_point(values)[which]),
        ci95=_interval(_statistics(values, by_pair, by_episode)[which]),
        episodes=len(first.episodes),
    )
