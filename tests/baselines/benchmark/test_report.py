"""The benchmark's aggregates against values worked out by hand, and what is made of them."""

from __future__ import annotations

import html
import json
import math
import re
from collections.abc import Mapping, Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy import stats

pytest.importorskip("jinja2")

from rich.console import Console

from drm_baselines.benchmark import estimates
from drm_baselines.benchmark.estimates import (
    difference,
    estimate,
    estimate_of,
    judged,
    multiple,
    probability_of_improvement,
    restricted,
)
from drm_baselines.benchmark.records import Record, SuiteResult
from drm_baselines.benchmark.report import (
    documents,
    page,
    plots,
    ranking,
    summaries,
    tables,
    targets,
)
from drm_baselines.errors import BaselineError, ExistingResultError

STRATA = ["a"] * 4 + ["b"] * 4
PNG = b"\x89PNG\r\n\x1a\n"


def record(
    policy: str,
    kind: str,
    tip: ArrayLike,
    *,
    title: str | None = None,
    episodes: Sequence[int] | None = None,
    **metrics: ArrayLike,
) -> Record:
    """A policy with the tip errors of its seeds, shape (s, n) or (n,), in m."""
    values = np.atleast_2d(np.asarray(tip, dtype=np.float64))
    places = np.arange(values.shape[1]) if episodes is None else np.asarray(episodes)
    return Record(
        policy=policy,
        title=title or policy,
        kind=kind,
        knows="true" if kind == "bound" else "reported",
        control_period=0.02 if kind == "learned" else 0.002,
        seeds=list(range(values.shape[0])),
        episodes=places.astype(np.int64),
        strata=[STRATA[place % len(STRATA)] for place in places],
        metrics={
            "tip_error_rms": values,
            **{
                name: np.broadcast_to(np.asarray(item, dtype=np.float64), values.shape).copy()
                for name, item in metrics.items()
            },
        },
    )


def suite(*records: Record, name: str = "robust") -> SuiteResult:
    return SuiteResult(suite=name, title="made up", records=records)


def level(policy: str, kind: str, millimetres: float, seeds: int = 1, **options: Any) -> Record:
    """A policy whose tip error is the same in all eight episodes."""
    good: dict[str, Any] = {
        "residual_rms": 1e-4, "settled": 1.0, "settling_time": 2.0,
        "final_slew_error": 1e-3, "wheel_effort": 3.0,
    }  # fmt: skip
    return record(policy, kind, np.full((seeds, 8), millimetres * 1e-3), **{**good, **options})


def field(learned: float = 1.0, **options: Any) -> SuiteResult:
    """Bound 0.5 mm, a law 6 mm, a tuned law 3 mm, a learned policy; listed the wrong way round."""
    return suite(
        level("ppo", "learned", learned, seeds=3, title="PPO", **options),
        level("tuned", "tuned law", 3.0),
        level("linear", "law", 6.0),
        level("none", "open loop", 50.0),
        level("bound", "bound", 0.5),
    )


# --- estimates ------------------------------------------------------------------------------------


def test_interquartile_mean_and_mean_are_over_all_seeds_and_episodes() -> None:
    # Sorted: 0 1 | 2 3 4 5 | 6 1000; the quarter at each end does not count.
    found = estimate([[1000, 0, 5, 3], [2, 6, 1, 4]], ["a"] * 4, fraction=False)
    assert found.iqm == 3.5
    assert found.mean == 1021 / 8
    assert (found.seeds, found.episodes) == (2, 4)


def test_resampled_statistics_are_those_of_the_repeated_values() -> None:
    # 3 seeds x 5 episodes: 15 values, of which 3 are cut from each end, not 3.75.
    values = np.random.default_rng(1).lognormal(size=(3, 5))
    by_seed = np.array([[1, 1, 1], [0, 3, 0], [2, 0, 1]], dtype=np.int32)
    by_episode = np.array([[1, 1, 1, 1, 1], [2, 0, 1, 2, 0], [0, 5, 0, 0, 0]], dtype=np.int32)
    trimmed, plain = estimates._statistics(values, by_seed, by_episode)
    for place in range(3):
        repeated = np.repeat(np.repeat(values, by_seed[place], 0), by_episode[place], 1).ravel()
        assert trimmed[place] == pytest.approx(stats.trim_mean(repeated, 0.25), rel=1e-14)
        assert plain[place] == pytest.approx(repeated.mean(), rel=1e-14)


def test_interval_covers_the_truth_about_as_often_as_it_says() -> None:
    # Symmetric about 3, so that the interquartile mean estimates 3. 200 samples: the covers are
    # binomial around 190 with a deviation of 3, bar the bootstrap's own narrowness.
    rng = np.random.default_rng(11)
    covered = 0
    for trial in range(200):
        values = rng.normal(3.0, 1.0, size=(1, 60))
        low, high = estimate(values, ["a"] * 60, fraction=False, seed=trial, resamples=500).ci95
        covered += low <= 3.0 <= high
    assert 175 <= covered <= 199


def test_training_seeds_that_differ_widen_the_interval() -> None:
    episodes = np.random.default_rng(2).normal(10.0, 0.1, size=(1, 80))
    alike = np.repeat(episodes, 5, axis=0)
    differing = alike + np.linspace(-2.0, 2.0, 5)[:, None]
    widths = [
        np.ptp(estimate(values, ["a"] * 80, fraction=False).ci95) for values in (alike, differing)
    ]
    assert widths[1] > 10.0 * widths[0]


def test_strata_keep_their_share_in_every_resample() -> None:
    # Within a stratum all values are equal: nothing is left to chance.
    values = [[1.0] * 4 + [5.0] * 4]
    found = estimate(values, STRATA, fraction=False)
    assert (found.iqm, found.ci95, found.mean_ci95) == (3.0, (3.0, 3.0), (3.0, 3.0))
    low, high = estimate(values, ["a"] * 8, fraction=False).ci95
    assert low < 3.0 < high


def test_single_seed_and_episode_have_a_point_for_an_interval() -> None:
    found = estimate([[0.25]], ["a"], fraction=False)
    assert (found.iqm, found.mean, found.ci95, found.mean_ci95) == (
        0.25, 0.25, (0.25, 0.25), (0.25, 0.25),
    )  # fmt: skip


def test_diverged_episodes_reach_the_mean_but_not_the_middle() -> None:
    found = estimate([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, math.inf]], ["a"] * 8, fraction=False)
    assert found.iqm == 4.5
    assert found.mean == math.inf
    assert found.ci95[1] == math.inf
    assert 1.0 < found.ci95[0] < 4.5


def test_one_diverged_flight_in_ten_thousand_makes_the_mean_infinite() -> None:
    values = np.ones((10, 1000))
    values[3, 77] = math.inf
    found = estimate(values, ["a"] * 1000, fraction=False)
    assert (found.iqm, found.ci95) == (1.0, (1.0, 1.0))
    assert found.mean == math.inf


def test_headline_of_a_fraction_is_its_mean() -> None:
    values = [[1.0] * 7 + [0.0]]
    found = estimate(values, ["a"] * 8, fraction=True)
    assert found.iqm == 1.0
    assert found.value == 0.875
    assert found.interval == found.mean_ci95
    assert estimate(values, ["a"] * 8, fraction=False).value == 1.0


def test_same_values_give_the_same_interval_and_another_seed_another() -> None:
    values = np.random.default_rng(0).normal(size=(3, 40))
    first = estimate(values, ["a"] * 40, fraction=False)
    # what an earlier call left behind has no part in it
    estimates._resampled.cache_clear()
    assert estimate(values.copy(), ["a"] * 40, fraction=False) == first
    assert estimate(values, ["a"] * 40, fraction=False, seed=1).ci95 != first.ci95


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1.0, 2.0], "shape"),
        (np.empty((0, 2)), "shape"),
        ([[1.0, 2.0, 3.0]], "2 strata for 3 episodes"),
        ([[1.0, math.nan]], "NaN"),
    ],
)
def test_values_that_cannot_be_aggregated_are_refused(values: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        estimate(values, ["a", "a"], fraction=False)


def test_censored_signed_and_diverged_values_are_judged() -> None:
    flown = record(
        "p", "law", [[0.1, math.nan]],
        settling_time=[[math.nan, 4.0]], duration=[[30.0, 30.0]], slew_end_time=[[12.0, 12.0]],
        final_slew_error=[[-0.5, 0.25]], settled=[[math.nan, 1.0]], episode_return=[[math.nan, 2]],
    )  # fmt: skip
    assert judged(flown, "settling_time").tolist() == [[18.0, 4.0]]
    assert judged(flown, "final_slew_error").tolist() == [[0.5, 0.25]]
    assert judged(flown, "tip_error_rms").tolist() == [[0.1, math.inf]]
    assert judged(flown, "episode_return").tolist() == [[-math.inf, 2.0]]
    with pytest.raises(BaselineError, match="no metric 'speed'"):
        judged(flown, "speed")


def test_improvement_counts_all_pairs_of_seeds_and_ties_half() -> None:
    # Episode 1: 1 and 3 against 2: one of two pairs. Episode 2: a tie and a loss.
    found = probability_of_improvement([[1.0, 5.0], [3.0, 6.0]], [[2.0, 5.0]], ["a", "b"])
    assert found.value == (1.0 + 0.0 + 0.5 + 0.0) / 4.0
    assert found.episodes == 2
    # The strata hold an episode each; of the seeds, both may be the better or the worse one.
    assert found.ci95 == (0.0, 0.75)


def test_improvement_follows_the_direction_of_the_metric() -> None:
    low, high = [[0.0, 0.0, 1.0]], [[1.0, 1.0, 1.0]]
    strata = ["a"] * 3
    assert probability_of_improvement(low, high, strata).value == pytest.approx(2.5 / 3.0)
    upward = probability_of_improvement(low, high, strata, higher_is_better=True)
    assert upward.value == pytest.approx(0.5 / 3.0)


def test_two_diverged_flights_are_a_tie() -> None:
    found = probability_of_improvement([[math.inf]], [[math.inf]], ["a"])
    assert (found.value, found.ci95) == (0.5, (0.5, 0.5))


def test_multiple_is_over_common_episodes_whatever_their_order() -> None:
    # The bound was solved for episodes 5 and 2 only; the policy takes ten times as much there.
    policy = record("p", "law", [[900, 900, 20, 900, 900, 50, 900, 900]])
    bound = record("bound", "bound", [[5.0, 2.0]], episodes=[5, 2])
    found = multiple(policy, bound, "tip_error_rms")
    assert (found.value, found.episodes) == (10.0, 2)
    assert found.ci95 == pytest.approx((10.0, 10.0))


def test_multiple_draws_the_same_episodes_for_both() -> None:
    # The figures spread over a decade, their ratio does not.
    tip = np.random.default_rng(4).lognormal(size=(1, 8))
    found = multiple(record("p", "law", 3.0 * tip), record("bound", "bound", tip), "tip_error_rms")
    assert found.ci95 == pytest.approx((3.0, 3.0))


def test_multiple_of_what_is_infinite_or_nothing() -> None:
    def ratio(above: float, below: float) -> float:
        first, second = record("p", "law", [[above]]), record("q", "law", [[below]])
        return multiple(first, second, "tip_error_rms").value

    assert ratio(math.inf, 2.0) == math.inf
    assert ratio(2.0, math.inf) == 0.0
    assert ratio(1.0, 0.0) == math.inf
    assert ratio(0.0, 0.0) == 1.0


def test_records_without_a_common_episode_are_not_compared() -> None:
    first = record("p", "law", [[1.0, 2.0]])
    second = record("q", "law", [[1.0, 2.0]], episodes=[6, 7])
    with pytest.raises(BaselineError, match="no episode in common"):
        multiple(first, second, "tip_error_rms")


def test_records_of_different_strata_are_not_compared() -> None:
    first = record("p", "law", [[1.0, 2.0]])
    second = Record(**{**vars(first), "policy": "q", "strata": ["b", "b"]})
    with pytest.raises(BaselineError, match="different suites"):
        multiple(first, second, "tip_error_rms")


def test_restricted_record_keeps_its_order() -> None:
    kept = restricted(record("p", "law", [[7.0, 3.0, 5.0]], episodes=[7, 3, 5]), [5, 7, 0])
    assert kept.episodes.tolist() == [7, 5]
    assert kept.metrics["tip_error_rms"].tolist() == [[7.0, 5.0]]
    assert kept.strata == ["b", "b"]


def test_difference_is_paired_over_common_episodes_and_all_pairs_of_seeds() -> None:
    # Episodes 0 to 3 differ by 1, whatever their level; the others are not common.
    flown = record("p", "learned", [[11.0, 21.0, 31.0, 41.0], [13.0, 23.0, 33.0, 43.0]])
    law = record("q", "law", [[40.0, 30.0, 20.0, 10.0, 7.0]], episodes=[3, 2, 1, 0, 6])
    found = difference(flown, law, "tip_error_rms")
    assert (found.value, found.episodes) == (2.0, 4)
    # both seeds, or one of them twice: 1 and 3, 1 and 1, 3 and 3
    assert found.ci95 == (1.0, 3.0)
    turned = difference(law, flown, "tip_error_rms")
    assert (turned.value, turned.ci95) == (-2.0, (-3.0, -1.0))


def test_difference_of_flights_that_both_diverged_is_nothing() -> None:
    first, second = (record(name, "law", [[math.nan] * 8]) for name in "pq")
    found = difference(first, second, "tip_error_rms")
    assert (found.value, found.ci95) == (0.0, (0.0, 0.0))


# --- JSON -----------------------------------------------------------------------------------------


def test_summary_holds_the_aggregates_in_si() -> None:
    content = summaries.summary(field())
    assert content["format"] == "drm-benchmark"
    assert content["format_version"] == 1
    assert (content["suite"], content["episodes"]) == ("robust", 8)
    assert list(content["policies"]) == ["bound", "none", "linear", "tuned", "ppo"]
    learned = content["policies"]["ppo"]
    assert {key: learned[key] for key in ("title", "kind", "knows", "control_period", "seeds")} == {
        "title": "PPO", "kind": "learned", "knows": "reported", "control_period": 0.02,
        "seeds": [0, 1, 2],
    }  # fmt: skip
    assert learned["tip_error_rms"] == {
        "iqm": pytest.approx(1e-3), "mean": pytest.approx(1e-3),
        "ci95": pytest.approx([1e-3, 1e-3]), "mean_ci95": pytest.approx([1e-3, 1e-3]),
    }  # fmt: skip
    assert learned["multiple_of_bound"]["value"] == pytest.approx(2.0)
    assert learned["probability_of_improvement"] == {
        "over": "tuned", "value": 1.0, "ci95": [1.0, 1.0], "episodes": 8,
    }  # fmt: skip
    assert content["policies"]["bound"]["tip_error_rms"]["iqm"] == pytest.approx(0.5e-3)


def test_summary_is_strict_json_even_where_episodes_diverged() -> None:
    result = suite(record("p", "law", [[1.0] * 7 + [math.nan]]))
    text = json.dumps(summaries.summary(result), allow_nan=False)
    entry = json.loads(text)["policies"]["p"]
    assert entry["tip_error_rms"]["mean"] is None
    assert entry["tip_error_rms"]["iqm"] == 1.0
    assert entry["multiple_of_bound"] is None
    assert entry["probability_of_improvement"] is None


def test_improvement_is_over_the_best_of_the_tuned_laws() -> None:
    result = suite(
        level("a", "tuned law", 3.0), level("b", "tuned law", 2.0), level("c", "law", 1.0)
    )
    entries = summaries.summary(result)["policies"]
    assert {entry["probability_of_improvement"]["over"] for entry in entries.values()} == {"b"}
    assert entries["a"]["probability_of_improvement"]["value"] == 0.0


def test_two_records_of_one_policy_or_an_unknown_kind_are_refused() -> None:
    with pytest.raises(BaselineError, match="two records of 'p'"):
        summaries.summary(suite(level("p", "law", 1.0), level("p", "law", 2.0)))
    with pytest.raises(BaselineError, match="kind 'magic'"):
        summaries.summary(suite(level("p", "magic", 1.0)))


# --- tables ---------------------------------------------------------------------------------------


def cells(markdown: str) -> list[list[str]]:
    lines = [line for line in markdown.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_table_has_a_row_a_policy_the_bound_first() -> None:
    rows = cells(tables.markdown_table(field()))
    assert [row[0] for row in rows] == ["policy", "bound", "none", "linear", "tuned", "PPO"]
    assert dict(zip(rows[0], rows[-1], strict=True)) == {
        "policy": "PPO",
        "knows": "reported",
        "decides every (ms)": "20",
        "seeds": "3",
        "trained, each seed": "-",
        "tip error RMS (mm)": "1.00 [1.00, 1.00]",
        "times the bound": "2.00 [2.00, 2.00]",
        "residual vibration RMS (mm)": "0.100",
        "settled (%)": "100",
        "settling time (s)": "2.00",
        "final slew error (deg)": "0.0573",
        "wheel effort (s)": "3.00",
    }


def test_short_table_has_few_policies_their_judge_and_their_notes_alone() -> None:
    few = record("receding", "controller", [[1e-3, 1e-3]], title="planner")
    text = tables.short_markdown_table(
        suite(level("bound", "bound", 0.5), level("linear", "law", 3.0), few)
    )
    assert cells(text) == [
        ["policy", "tip error RMS (mm)", "times the bound", "settled (%)"],
        ["bound", "0.500 [0.500, 0.500]", "1.00 [1.00, 1.00]", "100"],
        ["linear", "3.00 [3.00, 3.00]", "6.00 [6.00, 6.00]", "100"],
    ]
    assert "planner" not in text
    assert "- Interquartile mean over 8 episodes" in text
    few = record("bound", "bound", [[1e-3, 1e-3]], title="programme")
    text = tables.short_markdown_table(suite(few, level("linear", "law", 3.0)))
    assert "- \\* programme: 2 of these 8 episodes" in text


def test_readme_has_the_short_table_and_the_page_the_whole_one(tmp_path: Path) -> None:
    robust = suite(level("bound", "bound", 0.5), level("tuned", "tuned law", 3.0))
    empty = "<!-- benchmark:robust -->\n<!-- /benchmark:robust -->\n"
    (tmp_path / "docs" / "images").mkdir(parents=True)
    (tmp_path / "README.md").write_text(empty)
    (tmp_path / "docs" / "benchmark.md").write_text(empty)
    documents.update_documents(tmp_path, [robust], tmp_path / "figures")
    readme, page = ((tmp_path / name).read_text() for name in ("README.md", "docs/benchmark.md"))
    assert tables.short_markdown_table(robust) in readme
    assert tables.markdown_table(robust) in page
    assert "tuned" in page and "tuned" not in readme


def test_micrometres_are_not_shown_as_nothing() -> None:
    row = cells(tables.markdown_table(suite(level("bound", "bound", 0.001234))))[1]
    assert row[5] == "0.00123 [0.00123, 0.00123]"


def test_metrics_that_a_record_lacks_are_dashes() -> None:
    row = cells(tables.markdown_table(suite(record("p", "law", [[1e-3] * 8]))))[1]
    assert row[6:] == ["-"] * 6


def test_note_names_the_policy_with_fewer_episodes() -> None:
    few = record("bound", "bound", [[1e-3, 1e-3]], title="programme")
    text = tables.markdown_table(suite(few, level("linear", "law", 3.0)))
    assert "- \\* programme: 2 of these 8 episodes" in text
    assert [row[0] for row in cells(text)[1:]] == ["programme \\*", "linear"]
    assert "linear: " not in text
    assert "These are 8 of the 1000 episodes of the suite." in text


def test_terminal_table_shows_brackets_as_they_are() -> None:
    result = suite(level("p", "law", 2.0, title="[b]law[/b]"), level("bound", "bound", 1.0))
    console = Console(width=220)
    with console.capture() as capture:
        console.print(tables.terminal_table(result))
    text = capture.get()
    assert "[b]law[/b]" in text
    assert "[2.00, 2.00]" in text


def test_degradation_has_a_column_a_suite() -> None:
    robust = suite(level("p", "law", 2.0), level("ppo", "learned", 1.0))
    heavy = suite(level("p", "law", 8.0), record("bound", "bound", [[0.5e-3]]), name="heavy")
    text = tables.degradation_table([robust, heavy])
    assert cells(text) == [
        ["policy", "robust", "heavy"],
        ["bound", "-", "0.500 \\*"],
        ["p", "2.00", "8.00"],
        ["ppo", "1.00", "-"],
    ]
    assert text.endswith("\\* on fewer episodes than the others.")


# --- targets --------------------------------------------------------------------------------------


def verdicts(result: SuiteResult) -> list[str]:
    return [target.verdict for target in targets.targets(result)]


def test_all_targets_of_robust_are_met_and_state_their_numbers() -> None:
    found = targets.targets(field(learned=0.9))
    assert [target.verdict for target in found] == ["met"] * 6
    first, second, third, fourth, fifth, _ = (target.text for target in found)
    assert "0.300 [0.300, 0.300] times tuned" in first and "at most 0.333" in first
    assert "1.80 [1.80, 1.80] times bound" in second and "at most 3" in second
    assert "PPO minus tuned, in pairs, is -2.10 [-2.10, -2.10] mm on 8 episodes" in third
    assert "is 0 [0, 0] mm on 8 episodes; the target is at most 0.00500 mm, 5 % of" in fourth
    assert "at least -5.00 %" in fifth


@pytest.mark.parametrize(
    ("options", "missed"),
    [
        ({"learned": 1.1}, 0),
        ({"learned": 4.0}, 0),
        ({"learned": 1.6}, 1),
        ({"learned": 3.1}, 2),
        ({"residual_rms": 2e-4}, 3),
        ({"settled": 0.5}, 4),
        ({"final_slew_error": -2e-3}, 5),
    ],
)
def test_each_target_of_robust_can_be_missed(options: Mapping[str, Any], missed: int) -> None:
    assert verdicts(field(**{"learned": 0.9, **options}))[missed] == "missed"


@pytest.mark.parametrize(
    ("worse", "verdict"),
    [
        # by how much each of the eight episodes is worse, of a law's residual of 0.1 mm
        ([0.004] * 8, "met"),
        ([0.006] * 8, "missed"),
        ([-0.05, 0.06] * 4, "cannot be told apart"),
        ([-0.5] * 8, "met"),
    ],
)
def test_not_worse_is_judged_by_the_paired_difference_and_a_margin(
    worse: Sequence[float], verdict: str
) -> None:
    # The episodes lie so far apart that unpaired intervals touch whatever the difference.
    law = np.array([1.0, 2.0, 4.0, 8.0, 0.5, 0.25, 0.1, 0.05]) * 1e-4
    law *= 1e-4 / float(stats.trim_mean(law, 0.25))
    result = suite(
        level("ppo", "learned", 0.9, residual_rms=law + np.array(worse) * 1e-3),
        level("tuned", "tuned law", 3.0, residual_rms=law),
        level("bound", "bound", 0.5),
    )
    assert verdicts(result)[3] == verdict


def test_touching_intervals_are_no_evidence() -> None:
    """The learned policy is twice as bad in every episode; the unpaired intervals overlap."""
    law = np.geomspace(1e-6, 1e-3, 8)
    result = suite(
        level("ppo", "learned", 0.9, residual_rms=2.0 * law),
        level("tuned", "tuned law", 3.0, residual_rms=law),
    )
    left, right = (estimate_of(one, "residual_rms").interval for one in result.records)
    assert left[0] < right[1]
    assert verdicts(result)[3] == "missed"


def test_a_ratio_whose_interval_holds_the_target_cannot_be_told_apart() -> None:
    tip = np.array([0.2, 0.4, 0.2, 0.4, 0.2, 0.4, 0.2, 0.4]) * 1e-3
    result = suite(record("ppo", "learned", [tip]), level("tuned", "tuned law", 0.9))
    low, high = multiple(*result.records, "tip_error_rms").ci95
    assert low < targets.SHARE < high
    assert verdicts(result)[0] == "cannot be told apart"


def test_best_learned_policy_is_the_one_of_all_its_seeds() -> None:
    # One brilliant seed of three does not make the algorithm the best one.
    lucky = np.full((3, 8), 20e-3)
    lucky[0] = 1e-6
    result = suite(
        level("steady", "learned", 0.9, seeds=3), record("lucky", "learned", lucky),
        level("tuned", "tuned law", 3.0), level("bound", "bound", 0.5),
    )  # fmt: skip
    assert "steady" in targets.targets(result)[0].text


def test_best_policy_follows_the_direction_of_the_metric() -> None:
    result = suite(level("a", "law", 2.0, settled=1.0), level("b", "law", 1.0, settled=0.5))
    chosen = [ranking.best(result, "law", name=name) for name in ("tip_error_rms", "settled")]
    assert [found.policy for found in chosen if found is not None] == ["b", "a"]
    assert ranking.best(result, "learned") is None


def test_without_somebody_to_compare_with_nothing_is_told() -> None:
    assert verdicts(suite(level("tuned", "tuned law", 3.0))) == ["cannot be told apart"]
    assert verdicts(suite(level("ppo", "learned", 1.0))) == ["cannot be told apart"] * 2


def test_targets_of_thesis_are_about_every_headline_metric_and_the_best_law_in_it() -> None:
    laws = (
        level("linear", "law", 6.0, wheel_effort=1.0), level("tuned", "tuned law", 3.0),
    )  # fmt: skip
    learned = level("ppo", "learned", 2.0, seeds=2, wheel_effort=2.0)
    found = targets.targets(suite(*laws, learned, name="thesis"))
    assert [target.verdict for target in found] == ["met"] * 5 + ["missed"]
    assert "ppo (2.00 [2.00, 2.00] s) minus linear (1.00 [1.00, 1.00] s), in pairs, is +1.00" in (
        found[-1].text
    )
    assert targets.targets(suite(*laws, learned, name="heavy")) == []


def arm(*, law: float = 0.9, learned: float = 0.4, **law_metrics: Any) -> SuiteResult:
    """Those who fly the flexible arm; tip errors in mm."""
    return suite(
        level("linear", "law", 10.0), level("lyapunov", "law", 20.0),
        level("servo_zvd", "shaped law", law, **law_metrics),
        level("ppo_flexible", "learned", learned, seeds=2), name="flexible",
    )  # fmt: skip


def test_all_targets_of_the_flexible_arm_are_met_and_state_their_numbers() -> None:
    found = targets.targets(arm())
    assert [target.verdict for target in found] == ["met"] * 7
    texts = [target.text for target in found]
    assert "100 [100, 100] %); the target is at least 90.0 %" in texts[0]
    assert "0.100 [0.100, 0.100] mm); the target is at most 1.00 mm" in texts[1]
    assert "0.0900 [0.0900, 0.0900] times linear" in texts[2] and "at most 0.1 times" in texts[2]
    assert "0.444 [0.444, 0.444] times servo_zvd" in texts[3] and "at most 0.5 times" in texts[3]


@pytest.mark.parametrize(
    ("options", "missed"),
    [
        ({"settled": 0.89}, 0),
        ({"residual_rms": 1.01e-3}, 1),
        ({"law": 1.01}, 2),
        ({"learned": 0.46}, 3),
        ({"residual_rms": 9e-5}, 4),
        ({"final_slew_error": 9e-4}, 6),
    ],
)
def test_each_target_of_the_flexible_arm_can_be_missed(
    options: Mapping[str, Any], missed: int
) -> None:
    assert verdicts(arm(**options))[missed] == "missed"


def test_the_flexible_arm_without_law_or_learned_policy() -> None:
    nobody = suite(level("ppo_flexible", "learned", 1.0), name="flexible")
    assert verdicts(nobody) == ["cannot be told apart"]
    alone = suite(level("servo", "law", 1.0), name="flexible")
    assert verdicts(alone) == ["met", "met", "cannot be told apart", "cannot be told apart"]


def test_every_report_judges_thesis_on_the_episodes_with_the_exact_mass(tmp_path: Path) -> None:
    """Of each three episodes the first has the exact mass: there the policy is better."""
    tip = np.where(np.arange(8) % 3 == 0, 1e-3, 1.0)
    result = suite(record("ppo", "learned", [tip]), level("tuned", "tuned law", 3.0), name="thesis")
    assert targets.judged_part(result).records[0].episodes.tolist() == [0, 3, 6]
    first = targets.targets(result)[0]
    assert first.verdict == "met" and "on 3 episodes with the exact mass" in first.text
    written = page.write_page([result], tmp_path / "page.html", {}).read_text(encoding="utf-8")
    text = html.unescape(written)
    for target in targets.targets(result):
        assert re.search(rf">{target.verdict}</span> {re.escape(target.text)}<", text)
        assert f": `thesis`: {target.text}" in documents.targets_text([result])


def test_restricted_result_drops_who_flew_none_of_the_episodes() -> None:
    result = suite(level("p", "law", 2.0), record("bound", "bound", [[1.0]]))
    kept = ranking.restricted_result(result, [3, 4])
    assert [(found.policy, found.episodes.tolist()) for found in kept.records] == [("p", [3, 4])]


# --- figures, page, Markdown ----------------------------------------------------------------------


def curve(values: Sequence[float]) -> NDArray[np.float64]:
    count = len(values)
    return np.column_stack([np.arange(count) * 1e5, np.arange(count) * 30.0, values])


def test_figures_are_drawn_even_of_diverged_and_missing_policies(tmp_path: Path) -> None:
    result = suite(
        level("bound", "bound", 1e-3), level("p", "law", 3.0),
        record("q", "law", [[math.nan] * 8]), record("r", "learned", [[1e-3] * 7 + [math.nan]]),
    )  # fmt: skip
    other = suite(level("p", "law", 8.0), name="heavy")
    bands = {"law": estimate_of(result.records[1], "tip_error_rms")}
    curves = {"PPO": [curve([0.1, 0.01, 0.005]), curve([math.inf, 0.02])]}
    plots.plot_suite(result, tmp_path / "suite.png")
    plots.plot_profiles(result, tmp_path / "profiles.png")
    plots.plot_degradation([result, other], tmp_path / "degradation.png")
    plots.plot_curves(curves, bands, tmp_path / "curves.png")
    assert [file.read_bytes()[:8] for file in tmp_path.iterdir()] == [PNG] * 4
    with pytest.raises(ExistingResultError):
        plots.plot_suite(result, tmp_path / "suite.png")


def test_thick_line_is_the_middle_of_the_seeds_where_all_were_evaluated() -> None:
    runs = [curve([4.0, 2.0, 1.0]), curve([8.0, 4.0]), curve([math.inf, 6.0, 0.5])]
    places, middle = plots._between_seeds(runs, 0)
    assert places.tolist() == [0.0, 1e5]
    # Of three values none is cut: the diverged evaluation leaves a gap.
    assert math.isnan(middle[0])
    assert middle[1] == 4.0


def test_curves_of_another_shape_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"'PPO' has shape \(3, 2\)"):
        plots.plot_curves({"PPO": [np.ones((3, 2))]}, {}, tmp_path / "curves.png")
    assert list(tmp_path.iterdir()) == []


VOID = {"meta", "img", "link", "br", "hr", "input"}


class Page(HTMLParser):
    """Checks that elements nest; gathers tags, texts and sources."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.sources: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_page_is_well_formed_escaped_and_needs_no_other_file(tmp_path: Path) -> None:
    picture = tmp_path / "suite.png"
    picture.write_bytes(PNG)
    result = suite(
        level("ppo", "learned", 1.0, title="<b>PPO</b> & co"), level("tuned", "tuned law", 3.0)
    )
    heavy = suite(level("tuned", "tuned law", 9.0), name="heavy")
    path = page.write_page([result, heavy], tmp_path / "page.html", {"a <i>figure</i>": picture})
    reader = Page()
    reader.feed(path.read_text(encoding="utf-8"))
    reader.close()
    assert reader.open == []
    assert not {"b", "i"} & set(reader.tags)
    assert "<b>PPO</b> & co" in reader.text and "a <i>figure</i>" in reader.text
    outside = [source for source in reader.sources if not source.startswith("#")]
    assert outside == ["data:image/png;base64,iVBORw0KGgo="]
    # two suites and what happens from one to the other
    assert reader.tags.count("table") == 3
    assert "1.001.00 to 1.00" in reader.text
    assert "cannot be told apart" in reader.text and "missed" in reader.text


def test_page_without_its_figure_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(BaselineError, match=r"gone\.png cannot be read"):
        page.write_page([field()], tmp_path / "page.html", {"x": tmp_path / "gone.png"})
    assert list(tmp_path.iterdir()) == []


def test_injection_replaces_what_is_between_the_markers_only(tmp_path: Path) -> None:
    path = tmp_path / "README.md"
    path.write_text("a\n<!-- benchmark:x -->\nold\n<!-- /benchmark:x -->\nb\n")
    for _ in range(2):
        documents.inject(path, "x", "\nnew \\1\n")
        assert path.read_text() == ("a\n<!-- benchmark:x -->\nnew \\1\n<!-- /benchmark:x -->\nb\n")


@pytest.mark.parametrize(
    "text",
    [
        "nothing\n",
        "<!-- benchmark:x -->\n",
        "<!-- /benchmark:x -->\n<!-- benchmark:x -->\n",
        "<!-- benchmark:x --> <!-- /benchmark:x -->" * 2,
        "<!-- benchmark:y --> <!-- /benchmark:y -->",
    ],
)
def test_injection_refuses_missing_or_damaged_markers(tmp_path: Path, text: str) -> None:
    path = tmp_path / "README.md"
    path.write_text(text)
    with pytest.raises(BaselineError, match="expected '<!-- benchmark:x -->'"):
        documents.inject(path, "x", "new")
    assert path.read_text() == text


def test_injection_into_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BaselineError, match="cannot be read"):
        documents.inject(tmp_path / "README.md", "x", "new")
