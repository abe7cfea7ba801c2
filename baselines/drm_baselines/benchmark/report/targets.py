"""The targets of the benchmark, and whether the records meet them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drm_baselines.benchmark.estimates import (
    Compared,
    Estimate,
    difference,
    estimate_of,
    shared,
)
from drm_baselines.benchmark.records import Record, SuiteResult
from drm_baselines.benchmark.report.ranking import (
    JUDGE,
    best,
    bound_of,
    held_against,
    restricted_result,
)
from drm_baselines.benchmark.report.tables import shown, with_interval
from drm_baselines.evaluation.metrics import HEADLINE, describe
from drm_baselines.suites import load

SHARE = 1.0 / 3.0
"""Target: the learned policy's tip error is at most this share of the best tuned law's."""

REACH = 3.0
"""Target: the learned policy's tip error is at most this multiple of the bound."""

MARGIN = 0.05
"""Target: the learned policy is worse than a law by at most this share of the law's figure."""

FEWEST_SETTLED, MOST_RESIDUAL = 0.9, 1e-3
"""Targets on the flexible arm: the best law settles this share of the episodes, with this (m)."""

OF_THESIS, OF_BEST = 0.1, 0.5
"""Targets there: of the thesis' laws' tip error for the best law, of that one's for the learned."""

MET, MISSED, OPEN = "met", "missed", "cannot be told apart"
"""What is said about a target; see :func:`targets`."""

_NOT_WORSE = ("residual_rms", "settled", "final_slew_error")


# --- targets --------------------------------------------------------------------------------------


class Target(NamedTuple):
    """What a learned policy should reach, with the numbers, and whether it does.

    ``verdict`` is :data:`MET`, :data:`MISSED` or :data:`OPEN`.
    """

    text: str
    verdict: str


def judged_part(result: SuiteResult) -> SuiteResult:
    """Return the part of a suite's result that its targets are about, for every report.

    It is the whole of it, in ``thesis`` the episodes whose reported mass is the true one.
    """
    if result.suite != "thesis":
        return result
    exact = [
        index
        for index, scenario in enumerate(load("thesis").scenarios)
        if scenario["mass_error"] == 0.0
    ]
    return restricted_result(result, exact)


def targets(result: SuiteResult) -> list[Target]:
    """Return what a learned policy should reach in a suite, and whether it does.

    The learned policy is the one with the least tip error RMS, with all its training seeds. In the
    suite ``robust`` it is held against the best tuned law and the bound, in ``thesis`` against the
    best law in each headline metric, on the episodes whose reported mass is exact, in ``flexible``
    against the best law, which has targets of its own there; other suites have no targets.

    Two policies are compared in pairs, on the episodes that both flew. A target is met if the whole
    95 % interval of the ratio or difference keeps it and missed if the whole interval breaks it;
    otherwise the two cannot be told apart, nor where there is nothing to be held against. "Not
    worse" means worse by at most :data:`MARGIN` of the law's figure.
    """
    if result.suite not in ("robust", "thesis", "flexible"):
        return []
    part = judged_part(result)
    learned = best(part, "learned")
    if result.suite == "flexible":
        return _flexible(part, learned)
    if learned is None:
        return [Target(f"No learned policy flew the suite {result.suite}.", OPEN)]
    if result.suite == "thesis":
        return [
            _not_worse(
                learned, best(part, "law", "tuned law", name=name), name, " with the exact mass"
            )
            for name in HEADLINE
        ]
    return _robust(part, learned)


def _verdict(ci95: tuple[float, float], limit: float) -> str:
    """Whether a figure that should be at most ``limit`` is, by its interval."""
    low, high = ci95
    if high <= limit:
        return MET
    return MISSED if low > limit else OPEN


def _robust(result: SuiteResult, learned: Record) -> list[Target]:
    found: list[Target] = []
    tuned, bound = best(result, "tuned law"), bound_of(result)
    found.append(_times(learned, tuned, SHARE, "the best tuned law"))
    found.append(_times(learned, bound, REACH, "the bound"))
    if tuned is None or held_against(learned, tuned, ratio=True) is None:
        return found
    metric = describe(JUDGE)
    apart = difference(learned, tuned, JUDGE)
    text = (
        f"{metric.label}: {learned.title} minus {tuned.title}, in pairs, is "
        f"{_signed(apart, metric.scale)} {metric.unit} on {apart.episodes} episodes; the target is "
        "less than 0."
    )
    low, high = apart.ci95
    found.append(Target(text, MET if high < 0.0 else MISSED if low > 0.0 else OPEN))
    found.extend(_not_worse(learned, tuned, name) for name in _NOT_WORSE)
    return found


def _times(first: Record, other: Record | None, limit: float, what: str) -> Target:
    """The first one's tip error is at most so many times that of another."""
    label = describe(JUDGE).label
    ratio = held_against(first, other, ratio=True)
    if other is None or ratio is None:
        return Target(f"{label}: {first.title} cannot be held against {what}.", OPEN)
    left, right = _pair(first, other, JUDGE)
    text = (
        f"{label}: {_claim(first, left, JUDGE)} is {with_interval(ratio.value, ratio.ci95)} "
        f"times {_claim(other, right, JUDGE)}, {what}, on {ratio.episodes} episodes; "
        f"the target is at most {limit:.3g} times."
    )
    return Target(text, _verdict(ratio.ci95, limit))


def _flexible(result: SuiteResult, learned: Record | None) -> list[Target]:
    law = best(result, "law", "tuned law", "shaped law")
    if law is None:
        return [Target(f"No law flew the suite {result.suite}.", OPEN)]
    found = [_limit(law, "settled", FEWEST_SETTLED), _limit(law, "residual_rms", MOST_RESIDUAL)]
    thesis = [record for record in result.records if record.policy in ("linear", "lyapunov")]
    least = min(thesis, key=lambda record: estimate_of(record, JUDGE).value, default=None)
    found.append(_times(law, least, OF_THESIS, "the better of the thesis' laws"))
    if learned is None:
        return [*found, Target(f"No learned policy flew the suite {result.suite}.", OPEN)]
    found.append(_times(learned, law, OF_BEST, "the best law"))
    found.extend(_not_worse(learned, law, name) for name in _NOT_WORSE)
    return found


def _limit(record: Record, name: str, limit: float) -> Target:
    """A figure by itself keeps a limit."""
    metric, figure = describe(name), estimate_of(record, name)
    low, high = figure.interval
    at_least = metric.better == "higher"
    verdict = _verdict((-high, -low), -limit) if at_least else _verdict((low, high), limit)
    text = (
        f"{metric.label}: {_claim(record, figure, name)}; the target is "
        f"{'at least' if at_least else 'at most'} {shown(limit, metric.scale)} {metric.unit}."
    )
    return Target(text, verdict)


def _pair(first: Record, second: Record, name: str) -> tuple[Estimate, Estimate]:
    left, right = shared(first, second)
    return estimate_of(left, name), estimate_of(right, name)


def _claim(record: Record, found: Estimate, name: str) -> str:
    metric = describe(name)
    figures = with_interval(found.value, found.interval, metric.scale)
    return f"{record.title} ({figures} {metric.unit})"


def _signed(found: Compared, scale: float) -> str:
    sign = "+" if found.value > 0.0 else ""
    return sign + with_interval(found.value, found.ci95, scale)


def _not_worse(learned: Record, other: Record | None, name: str, which: str = "") -> Target:
    metric = describe(name)
    if (
        other is None
        or not all(name in side.metrics for side in (learned, other))
        or np.intersect1d(learned.episodes, other.episodes).size == 0
    ):
        text = f"{metric.label}: {learned.title} cannot be held against a law."
        return Target(text, OPEN)
    left, right = _pair(learned, other, name)
    apart = difference(learned, other, name)
    margin = MARGIN * abs(right.value)
    low, high = apart.ci95
    better_high = metric.better == "higher"
    verdict = _verdict((-high, -low) if better_high else (low, high), margin)
    limit = f"{'at least -' if better_high else 'at most '}{shown(margin, metric.scale)}"
    text = (
        f"{metric.label}: {_claim(learned, left, name)} minus {_claim(other, right, name)}, in "
        f"pairs, is {_signed(apart, metric.scale)} {metric.unit} on {left.episodes} episodes"
        f"{which}; the target is {limit} {metric.unit}, {100 * MARGIN:g} % of the law's figure."
    )
    return Target(text, verdict)
