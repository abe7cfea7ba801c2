"""Aggregates over episodes, against values that can be worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drm_baselines.errors import BaselineError
from drm_baselines.evaluation.records import Episodes, comparison
from drm_baselines.evaluation.statistics import (
    compare_paired,
    interquartile_estimate,
    interquartile_mean,
    mean_estimate,
)


def test_interquartile_mean_is_the_mean_of_the_middle_half() -> None:
    # Sorted: 0 1 | 2 3 4 5 | 6 1000; the quarter at each end does not count.
    assert interquartile_mean([1000.0, 0.0, 5.0, 3.0, 2.0, 6.0, 1.0, 4.0]) == 3.5


def test_interval_contains_the_estimate_and_narrows_with_more_episodes() -> None:
    rng = np.random.default_rng(5)
    few = interquartile_estimate(rng.lognormal(size=40))
    many = interquartile_estimate(rng.lognormal(size=4000))
    for estimate in (few, many):
        assert estimate.low < estimate.value < estimate.high
    assert many.high - many.low < 0.4 * (few.high - few.low)


def test_interval_covers_the_true_mean_about_as_often_as_it_says() -> None:
    # Symmetric about 3: the interquartile mean estimates 3. 200 samples, so the count of covers
    # is binomial around 190 with a deviation of 3; below 175 is five deviations off.
    rng = np.random.default_rng(11)
    covered = 0
    for trial in range(200):
        estimate = interquartile_estimate(rng.normal(3.0, 1.0, size=60), seed=trial)
        covered += estimate.low <= 3.0 <= estimate.high
    assert 175 <= covered <= 199


def test_same_records_give_the_same_interval() -> None:
    values = np.random.default_rng(0).normal(size=50)
    assert interquartile_estimate(values) == interquartile_estimate(values.copy())


def test_constant_samples_have_a_point_for_an_interval() -> None:
    estimate = mean_estimate(np.ones(20))
    assert (estimate.value, estimate.low, estimate.high) == (1.0, 1.0, 1.0)


def test_diverged_episodes_make_the_tail_infinite_but_not_the_middle() -> None:
    estimate = interquartile_estimate([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, math.inf])
    assert estimate.value == 4.5
    assert estimate.high == math.inf
    assert interquartile_mean([math.inf] * 4) == math.inf


@pytest.mark.parametrize("bad", [[], [[1.0, 2.0]], [1.0, math.nan]])
def test_unusable_samples_are_refused(bad: list[float]) -> None:
    with pytest.raises(ValueError, match="values"):
        interquartile_estimate(bad)


def test_paired_comparison_sees_a_shift_that_the_spread_between_episodes_hides() -> None:
    rng = np.random.default_rng(2)
    reference = rng.lognormal(sigma=2.0, size=100)
    candidate = reference - 0.01
    paired = compare_paired(candidate, reference)
    assert paired.verdict == "better"
    assert paired.difference.value == pytest.approx(-0.01)
    assert paired.improvement.value == 1.0
    apart = interquartile_estimate(candidate), interquartile_estimate(reference)
    assert apart[0].high > apart[1].low, "unpaired intervals overlap"


def test_paired_comparison_of_equals_is_undecided_and_ties_count_half() -> None:
    values = np.arange(10.0)
    paired = compare_paired(values, values)
    assert paired.verdict == "undecided"
    assert paired.improvement.value == 0.5


def test_direction_of_a_metric_turns_the_verdict() -> None:
    low, high = np.zeros(20), np.ones(20)
    assert compare_paired(low, high).verdict == "better"
    assert compare_paired(low, high, higher_is_better=True).verdict == "worse"


def _episodes(label: str, seeds: list[int], **metrics: list[float]) -> Episodes:
    return Episodes(
        label=label,
        control_period=0.002,
        seeds=seeds,
        metrics={name: np.array(values) for name, values in metrics.items()},
    )


def test_censored_settling_counts_with_the_time_observed() -> None:
    flight = _episodes(
        "law", [0, 1], settling_time=[2.0, math.nan], duration=[20.0, 20.0],
        slew_end_time=[13.0, 13.5],
    )  # fmt: skip
    assert flight.judged("settling_time").tolist() == [2.0, 6.5]


def test_signed_errors_count_by_magnitude_and_missing_values_as_the_worst() -> None:
    flight = _episodes(
        "law", [0, 1], final_slew_error=[-0.2, 0.1], tip_error_rms=[math.nan, 1.0],
        episode_return=[math.nan, 1.0],
    )  # fmt: skip
    assert flight.judged("final_slew_error").tolist() == [0.2, 0.1]
    assert flight.judged("tip_error_rms").tolist() == [math.inf, 1.0]
    assert flight.judged("episode_return").tolist() == [-math.inf, 1.0]


def test_policies_that_flew_other_episodes_are_not_compared() -> None:
    first = _episodes("a", [0, 1], tip_error_rms=[1.0, 2.0])
    second = _episodes("b", [0, 2], tip_error_rms=[1.0, 2.0])
    with pytest.raises(BaselineError, match="different episodes"):
        comparison(first, second)


def test_a_column_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="tip_error_rms"):
        _episodes("a", [0, 1, 2], tip_error_rms=[1.0, 2.0])
