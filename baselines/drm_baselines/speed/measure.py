"""Taking turns: repeated measurements of several candidates, their spread and their ratios."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_baselines.errors import BaselineError

Measured = dict[str, NDArray[np.float64]]
"""Values of each candidate, one a repetition, in the order in which they were taken."""


@dataclass(frozen=True)
class Spread:
    """Median of repeated measurements with the smallest and the largest."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: ArrayLike) -> Spread:
        """Summarise measurements.

        Raises
        ------
        BaselineError
            There are none.
        """
        array = np.asarray(values, dtype=np.float64)
        if array.size == 0:
            raise BaselineError("a spread needs at least one measurement, got none")
        return cls(float(np.median(array)), float(array.min()), float(array.max()))

    def scaled(self, factor: float) -> Spread:
        """Return the same in another unit; ``factor`` is positive."""
        return Spread(self.median * factor, self.low * factor, self.high * factor)


def paired_ratio(values: ArrayLike, reference: ArrayLike) -> Spread:
    """Return the spread of ``values / reference``, pair by pair.

    Raises
    ------
    BaselineError
        Different numbers of measurements, or a reference that is not positive.
    """
    above = np.asarray(values, dtype=np.float64)
    below = np.asarray(reference, dtype=np.float64)
    if above.shape != below.shape:
        raise BaselineError(f"pairs need equal numbers, got {above.size} and {below.size}")
    if not (below > 0.0).all():
        raise BaselineError(f"the reference of a ratio must be positive, got {below.min()}")
    return Spread.of(above / below)


def interleave(
    candidates: Mapping[str, Callable[[], float]],
    repeats: int,
    progress: Callable[[str], object] | None = None,
) -> Measured:
    """Measure every candidate once, then again, ``repeats`` times in all.

    Parameters
    ----------
    candidates
        Functions by name that take one measurement and return its value.
    repeats
        Number of rounds.
    progress
        Called with the name of each candidate after its measurement.

    Raises
    ------
    BaselineError
        ``repeats`` is less than one.
    """
    if repeats < 1:
        raise BaselineError(f"repeats must be at least 1, got {repeats}")
    taken: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(repeats):
        for name, measure in candidates.items():
            taken[name].append(float(measure()))
            if progress is not None:
                progress(name)
    return {name: np.array(values) for name, values in taken.items()}


def seconds_of(action: Callable[[], object]) -> float:
    """Return how long ``action`` takes, s."""
    before = time.perf_counter()
    action()
    return time.perf_counter() - before


def seconds_per_call(action: Callable[[], object], duration: float, *, block: int = 1) -> float:
    """Return the mean time of a call over about ``duration`` seconds.

    The clock is read once every ``block`` calls.
    """
    calls = 0
    before = time.perf_counter()
    while True:
        for _ in range(block):
            action()
        calls += block
        spent = time.perf_counter() - before
        if spent >= duration:
            return spent / calls


def geometric_sizes(first: int, last: int, factor: int) -> Sequence[int]:
    """Return ``first, first * factor, ...`` up to ``last``."""
    sizes = []
    size = first
    while size <= last:
        sizes.append(size)
        size *= factor
    return sizes
