"""The benchmark's records as JSON, tables, targets, figures and one HTML page.

Everything here is made from records alone and is the same each time it is made. Values are in SI
in JSON and in the display units of :mod:`drm_baselines.metrics` elsewhere.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.table import Table
from rich.text import Text

from drm_baselines import storage
from drm_baselines.bench.report import figure as significant
from drm_baselines.benchmark.estimates import (
    Compared,
    Estimate,
    difference,
    estimate_of,
    improvement,
    judged,
    multiple,
    restricted,
    shared,
)
from drm_baselines.benchmark.results import Record, SuiteResult
from drm_baselines.benchmark.suites import SUITES, load
from drm_baselines.errors import BaselineError
from drm_baselines.figures import plain_log, save_figure, single, subplots
from drm_baselines.markers import marked_range
from drm_baselines.metrics import HEADLINE, describe
from drm_baselines.policy_names import POLICIES, styles
from drm_baselines.statistics import interquartile_mean

FORMAT = "drm-benchmark"
FORMAT_VERSION = 1

KINDS = ("bound", "open loop", "law", "tuned law", "controller", "learned")
"""Kinds of policies in the order of tables."""

JUDGE = "tip_error_rms"
"""The metric that policies are ranked by."""

SHARE = 1.0 / 3.0
"""Target: the learned policy's tip error is at most this share of the best tuned law's."""

REACH = 3.0
"""Target: the learned policy's tip error is at most this multiple of the bound."""

MARGIN = 0.05
"""Target: the learned policy is worse than a law by at most this share of the law's figure."""

MET, MISSED, OPEN = "met", "missed", "cannot be told apart"
"""What is said about a target; see :func:`targets`."""

_NOT_WORSE = ("residual_rms", "settled", "final_slew_error")
_NO_AGGREGATE = ("duration", "slew_end_time")
_DASH = "-"

METHOD = (
    "Every policy flies the same frozen manoeuvres; one evaluator computes the metrics from the "
    "engine's states.",
    "Figures are interquartile means over all training seeds and episodes, fractions are means. "
    "No training seed is left out.",
    "Intervals are 95 % percentile intervals of a bootstrap that draws training seeds, and "
    "episodes within each stratum, with replacement; all policies meet the same drawn episodes.",
    "An episode that never settles counts with the whole time after the slew. A diverged episode "
    "counts as infinitely bad.",
    "Targets are judged by ratios and paired differences over the episodes that both policies "
    "flew: met or missed when the whole 95 % interval says so, else the two cannot be told apart. "
    f"Not worse means worse by at most {100 * MARGIN:g} % of the law's figure.",
)
"""How the figures come about, sentence by sentence."""

# --- choosing -------------------------------------------------------------------------------------


def ordered(result: SuiteResult) -> list[Record]:
    """Return the records in the order of tables: by kind, else as they come.

    Raises
    ------
    BaselineError
        A kind that is none of :data:`KINDS`, or two records of one policy.
    """
    names = [record.policy for record in result.records]
    for record in result.records:
        if record.kind not in KINDS:
            raise BaselineError(f"{record.policy!r} is of kind {record.kind!r}; there are {KINDS}")
        if names.count(record.policy) > 1:
            raise BaselineError(f"suite {result.suite!r} has two records of {record.policy!r}")
    return sorted(result.records, key=lambda record: KINDS.index(record.kind))


def restricted_result(result: SuiteResult, episodes: ArrayLike) -> SuiteResult:
    """Return a result with some episodes of its suite only.

    Parameters
    ----------
    result
        What every policy did.
    episodes
        Places in the suite, shape (m,). A policy that flew none of them is left out.
    """
    records = [restricted(record, episodes) for record in result.records]
    return replace(result, records=[record for record in records if len(record.episodes) > 0])


def best(result: SuiteResult, *kinds: str, name: str = JUDGE) -> Record | None:
    """Return the record of these kinds with the best headline in one metric, if there is any."""
    sign = -1.0 if describe(name).better == "higher" else 1.0
    candidates = [
        record for record in ordered(result) if record.kind in kinds and name in record.metrics
    ]
    if not candidates:
        return None
    return min(candidates, key=lambda record: sign * estimate_of(record, name).value)


def _bound(result: SuiteResult) -> Record | None:
    return next((record for record in result.records if record.kind == "bound"), None)


def _compared(record: Record, other: Record | None, *, ratio: bool) -> Compared | None:
    """A comparison in the judging metric; none without a partner or a common episode."""
    if other is None or not all(JUDGE in side.metrics for side in (record, other)):
        return None
    if np.intersect1d(record.episodes, other.episodes).size == 0:
        return None
    return (multiple if ratio else improvement)(record, other, JUDGE)


def _partial(record: Record, flown: int) -> bool:
    """Whether a record's figures are over fewer episodes than those of others."""
    return len(record.episodes) < flown


def _flown(result: SuiteResult) -> int:
    """How many episodes of the suite were flown by anybody."""
    places = [record.episodes for record in result.records]
    return int(np.unique(np.concatenate(places)).size) if places else 0


# --- JSON -----------------------------------------------------------------------------------------


def summary(result: SuiteResult) -> dict[str, Any]:
    """Return all aggregates of a suite as plain values for JSON, SI.

    ``policies.<policy>.<metric>`` has ``iqm`` with ``ci95`` and ``mean`` with ``mean_ci95``; what
    is infinite (diverged episodes reach into it) is ``None``. ``multiple_of_bound`` and
    ``probability_of_improvement`` (over the best tuned law, named under ``over``) are about the tip
    error RMS on the episodes that both flew, and ``None`` where there is nothing to compare with.

    Raises
    ------
    BaselineError
        An unknown kind, or two records of one policy.
    """
    bound, tuned = _bound(result), best(result, "tuned law")
    policies: dict[str, Any] = {}
    for record in ordered(result):
        entry: dict[str, Any] = {
            "title": record.title,
            "kind": record.kind,
            "knows": record.knows,
            "control_period": record.control_period,
            "seeds": list(record.seeds),
            "episodes": len(record.episodes),
        }
        for name in record.metrics:
            if name in _NO_AGGREGATE:
                continue
            found = estimate_of(record, name)
            entry[name] = {
                "iqm": found.iqm,
                "mean": found.mean,
                "ci95": found.ci95,
                "mean_ci95": found.mean_ci95,
            }
        entry["multiple_of_bound"] = _entry(_compared(record, bound, ratio=True), bound)
        entry["probability_of_improvement"] = _entry(_compared(record, tuned, ratio=False), tuned)
        policies[record.policy] = entry
    content: dict[str, Any] = storage.plain(
        {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "suite": result.suite,
            "title": result.title,
            "episodes": _flown(result),
            "policies": policies,
        }
    )
    return content


def _entry(compared: Compared | None, other: Record | None) -> dict[str, Any] | None:
    if compared is None or other is None:
        return None
    return {
        "over": other.policy,
        "value": compared.value,
        "ci95": compared.ci95,
        "episodes": compared.episodes,
    }


# --- tables ---------------------------------------------------------------------------------------


def shown(value: float, scale: float = 1.0) -> str:
    """Return a value times ``scale`` with three significant digits, a dash for NaN."""
    if math.isnan(value):
        return _DASH
    if math.isinf(value):
        return "inf" if value > 0.0 else "-inf"
    return significant(value * scale)


def _with_interval(value: float, ci95: tuple[float, float], scale: float = 1.0) -> str:
    low, high = (shown(edge, scale) for edge in ci95)
    return f"{shown(value, scale)} [{low}, {high}]"


def _headline(record: Record, name: str) -> str:
    """The headline of a metric in its display unit, without interval."""
    if name not in record.metrics:
        return _DASH
    return shown(estimate_of(record, name).value, describe(name).scale)


def _judge(record: Record) -> str:
    if JUDGE not in record.metrics:
        return _DASH
    found = estimate_of(record, JUDGE)
    return _with_interval(found.value, found.interval, describe(JUDGE).scale)


def _headings() -> list[str]:
    def heading(name: str) -> str:
        metric = describe(name)
        return f"{metric.label} ({metric.unit})"

    start = ["policy", "knows", "decides every (ms)", "seeds", heading(JUDGE), "times the bound"]
    return start + [heading(name) for name in HEADLINE if name != JUDGE]


def _rows(result: SuiteResult) -> list[list[str]]:
    bound, flown = _bound(result), _flown(result)
    rows = []
    for record in ordered(result):
        ratio = _compared(record, bound, ratio=True)
        trained = record.kind == "learned" or len(record.seeds) > 1
        rows.append(
            [
                f"{record.title} *" if _partial(record, flown) else record.title,
                record.knows,
                f"{record.control_period * 1e3:g}" if record.control_period > 0.0 else _DASH,
                str(len(record.seeds)) if trained else _DASH,
                _judge(record),
                _DASH if ratio is None else _with_interval(ratio.value, ratio.ci95),
                *(_headline(record, name) for name in HEADLINE if name != JUDGE),
            ]
        )
    return rows


def notes(result: SuiteResult) -> list[str]:
    """Return what a reader of a suite's table has to know, sentence by sentence."""
    flown = _flown(result)
    lines = [
        f"Interquartile mean over {flown} episodes and all training seeds, with its 95 % bootstrap "
        "interval; settled: mean.",
        "An episode that never settles counts with the whole time after the slew; a diverged one "
        "counts as infinitely bad.",
    ]
    suite = SUITES.get(result.suite)
    if suite is not None and flown < suite.episodes:
        lines.append(f"These are {flown} of the {suite.episodes} episodes of the suite.")
    lines.extend(
        f"* {record.title}: {len(record.episodes)} of these {flown} episodes; its figures belong "
        "to these alone and cannot be held against the others'. The multiples of the bound can: "
        "they are over the episodes that both flew."
        for record in ordered(result)
        if _partial(record, flown)
    )
    return lines


def _label(result: SuiteResult) -> str:
    return f"{result.suite}: {result.title}"


def terminal_table(result: SuiteResult) -> Table:
    """Return a suite as a table for the terminal, a row a policy, its notes below."""
    table = Table(title=Text(_label(result)), title_justify="left", header_style="bold")
    for place, heading in enumerate(_headings()):
        table.add_column(heading, justify="left" if place < 2 else "right")
    for row in _rows(result):
        # intervals go below their figures; brackets are not markup
        table.add_row(*(Text(cell.replace(" [", "\n[") if "]" in cell else cell) for cell in row))
    table.caption = Text("\n".join(notes(result)))
    table.caption_justify = "left"
    return table


def _escaped(text: str) -> str:
    return text.replace("*", "\\*")


def _markdown(headings: Sequence[str], rows: Sequence[Sequence[str]], left: int) -> list[str]:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(_escaped(cell).replace("|", "\\|") for cell in cells) + " |"

    rule = "|" + "---|" * left + "---:|" * (len(headings) - left)
    return [line(headings), rule, *(line(row) for row in rows)]


def markdown_table(result: SuiteResult) -> str:
    """Return a suite as a Markdown table, a row a policy, its notes below as a list."""
    table = _markdown(_headings(), _rows(result), 2)
    return "\n".join([*table, "", *(f"- {_escaped(note)}" for note in notes(result))])


def _policies(results: Sequence[SuiteResult]) -> dict[str, Record]:
    """The first record of every policy of all suites, in the order of tables."""
    found: dict[str, Record] = {}
    for result in results:
        for record in ordered(result):
            found.setdefault(record.policy, record)
    # the sort is stable
    return dict(sorted(found.items(), key=lambda item: KINDS.index(item[1].kind)))


def _degradation(results: Sequence[SuiteResult]) -> tuple[list[str], list[list[str]], bool]:
    """Headings, rows, and whether a star marks a record with fewer episodes."""
    rows, starred = [], False
    flights = [{record.policy: record for record in result.records} for result in results]
    for policy, first in _policies(results).items():
        row = [first.title]
        for result, records in zip(results, flights, strict=True):
            cell = _headline(records[policy], JUDGE) if policy in records else _DASH
            if policy in records and _partial(records[policy], _flown(result)):
                cell, starred = f"{cell} *", True
            row.append(cell)
        rows.append(row)
    return ["policy", *(result.suite for result in results)], rows, starred


_STAR = "* on fewer episodes than the others."


def degradation_table(results: Sequence[SuiteResult]) -> str:
    """Return the tip error RMS (mm, interquartile mean) of all policies in all suites.

    It is one Markdown table, a row a policy and a column a suite; a star marks a policy that flew
    fewer episodes of a suite than others did.
    """
    headings, rows, starred = _degradation(results)
    return "\n".join([*_markdown(headings, rows, 1), *(["", _escaped(_STAR)] if starred else [])])


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
    best law in each headline metric, on the episodes whose reported mass is exact; other suites
    have no targets.

    Two policies are compared in pairs, on the episodes that both flew. A target is met if the whole
    95 % interval of the ratio or difference keeps it and missed if the whole interval breaks it;
    otherwise the two cannot be told apart, nor where there is nothing to be held against. "Not
    worse" means worse by at most :data:`MARGIN` of the law's figure.
    """
    if result.suite not in ("robust", "thesis"):
        return []
    part = judged_part(result)
    learned = best(part, "learned")
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
    tuned, bound = best(result, "tuned law"), _bound(result)
    label = describe(JUDGE).label
    for other, limit, what in (
        (tuned, SHARE, "the best tuned law"),
        (bound, REACH, "the bound"),
    ):
        ratio = _compared(learned, other, ratio=True)
        if other is None or ratio is None:
            found.append(Target(f"{label}: {learned.title} cannot be held against {what}.", OPEN))
            continue
        left, right = _pair(learned, other, JUDGE)
        text = (
            f"{label}: {_claim(learned, left, JUDGE)} is {_with_interval(ratio.value, ratio.ci95)} "
            f"times {_claim(other, right, JUDGE)}, {what}, on {ratio.episodes} episodes; "
            f"the target is at most {limit:.3g} times."
        )
        found.append(Target(text, _verdict(ratio.ci95, limit)))
    if tuned is None or _compared(learned, tuned, ratio=True) is None:
        return found
    metric = describe(JUDGE)
    apart = difference(learned, tuned, JUDGE)
    text = (
        f"{label}: {learned.title} minus {tuned.title}, in pairs, is "
        f"{_signed(apart, metric.scale)} {metric.unit} on {apart.episodes} episodes; the target is "
        "less than 0."
    )
    low, high = apart.ci95
    found.append(Target(text, MET if high < 0.0 else MISSED if low > 0.0 else OPEN))
    found.extend(_not_worse(learned, tuned, name) for name in _NOT_WORSE)
    return found


def _pair(first: Record, second: Record, name: str) -> tuple[Estimate, Estimate]:
    left, right = shared(first, second)
    return estimate_of(left, name), estimate_of(right, name)


def _claim(record: Record, found: Estimate, name: str) -> str:
    metric = describe(name)
    figures = _with_interval(found.value, found.interval, metric.scale)
    return f"{record.title} ({figures} {metric.unit})"


def _signed(found: Compared, scale: float) -> str:
    sign = "+" if found.value > 0.0 else ""
    return sign + _with_interval(found.value, found.ci95, scale)


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


# --- figures --------------------------------------------------------------------------------------


def _axis_label(name: str = JUDGE) -> str:
    metric = describe(name)
    return f"{metric.label} ({metric.unit})"


def _judged_records(result: SuiteResult) -> list[Record]:
    return [record for record in ordered(result) if JUDGE in record.metrics]


def _episodes(record: Record, flown: int) -> str:
    return f"{len(record.episodes):,} of {flown:,} episodes"


def plot_suite(result: SuiteResult, path: Path, *, overwrite: bool = False) -> Path:
    """Draw the tip error RMS of every policy with its 95 % interval, the bound as a line.

    The axis is logarithmic. A policy that flew fewer episodes than others is drawn hollow, with
    their number; a vertical stroke in its row is the bound on these same episodes. Returns
    ``path``.
    """
    scale = describe(JUDGE).scale
    records, bound, flown = _judged_records(result), _bound(result), _flown(result)
    drawn = styles([record.policy for record in records])
    fig, axis = single(size=(9.0, 1.6 + 0.42 * len(records)))
    axis.set_xscale("log")
    names = []
    for place, record, style in zip(range(len(records)), records, drawn, strict=True):
        few = _partial(record, flown)
        kind = "" if record.title == record.kind else f" ({record.kind})"
        names.append(f"{record.title}{kind}" + (f"\n{_episodes(record, flown)}" if few else ""))
        found = estimate_of(record, JUDGE)
        value, (low, high) = found.value * scale, (edge * scale for edge in found.interval)
        if not math.isfinite(value):
            axis.annotate("diverged", (0.5, place), xycoords=("axes fraction", "data"))
            continue
        if record is bound:
            axis.axvline(value, color=style["color"], linestyle="--", linewidth=1.0)
        elif few and bound is not None and np.isin(record.episodes, bound.episodes).all():
            same = estimate_of(restricted(bound, record.episodes), JUDGE).value * scale
            colour = POLICIES["bound"].colour
            axis.plot([same, same], [place - 0.32, place + 0.32], color=colour, linewidth=1.6)
        # A percentile interval need not contain the estimate; an infinite end is not drawn.
        spread = [max(0.0, value - low), max(0.0, high - value)]
        spread = [length if math.isfinite(length) else 0.0 for length in spread]
        axis.errorbar(
            value,
            place,
            xerr=[[spread[0]], [spread[1]]],
            capsize=4,
            markerfacecolor="white" if few else style["color"],
            **{**style, "linestyle": "none"},
        )
    axis.set_yticks(range(len(records)), names)
    axis.set_ylim(len(records) - 0.4, -0.6)
    told = f"{_axis_label()}: interquartile mean, 95 % interval"
    if any(_partial(record, flown) for record in records):
        told += "\nhollow: on fewer episodes than the others; stroke: the bound on the same ones"
    axis.set_xlabel(told)
    axis.grid(alpha=0.3, which="both", axis="x")
    axis.set_title(_label(result), fontsize="medium")
    plain_log(axis.xaxis)
    return save_figure(fig, path, overwrite=overwrite)


def plot_profiles(result: SuiteResult, path: Path, *, overwrite: bool = False) -> Path:
    """Draw which fraction of all runs (seeds x episodes) stays below a tip error RMS.

    The axis of the error is logarithmic. Returns ``path``.
    """
    scale = describe(JUDGE).scale
    records, flown = _judged_records(result), _flown(result)
    fig, axis = single(size=(10.0, 5.4))
    axis.set_xscale("log")
    drawn = styles([record.policy for record in records])
    for record, style in zip(records, drawn, strict=True):
        values = np.sort(judged(record, JUDGE), axis=None) * scale
        share = np.arange(1, values.size + 1) / values.size
        visible = np.isfinite(values) & (values > 0.0)
        few = f"\n({_episodes(record, flown)})" if _partial(record, flown) else ""
        axis.step(
            values[visible],
            share[visible],
            where="post",
            label=f"{record.title}{few}",
            linewidth=1.4,
            color=style["color"],
            linestyle=style["linestyle"],
        )
    axis.set_ylim(0.0, 1.02)
    axis.set_xlabel(_axis_label())
    axis.set_ylabel("fraction of runs at or below")
    axis.grid(alpha=0.3, which="both")
    axis.set_title(_label(result), fontsize="medium")
    plain_log(axis.xaxis)
    fig.legend(loc="outside right upper", fontsize="small")
    return save_figure(fig, path, overwrite=overwrite)


def plot_degradation(
    results: Sequence[SuiteResult], path: Path, *, overwrite: bool = False
) -> Path:
    """Draw the tip error RMS of every policy in every suite with its 95 % intervals.

    The suites have no order, so that no lines join them. The axis of the error is logarithmic; a
    hollow point is on fewer episodes than those of others. Returns ``path``.
    """
    scale = describe(JUDGE).scale
    policies = _policies(results)
    fig, axis = single(size=(11.0, 5.4))
    axis.set_yscale("log")
    flights = [{record.policy: record for record in result.records} for result in results]
    flown = [_flown(result) for result in results]
    starred = _degradation(results)[2]
    middle = (len(policies) - 1) / 2.0
    drawn = styles(list(policies))
    for number, ((policy, first), style) in enumerate(zip(policies.items(), drawn, strict=True)):
        figures = np.full((3, len(results)), np.nan)
        for column, records in enumerate(flights):
            if policy in records and JUDGE in records[policy].metrics:
                found = estimate_of(records[policy], JUDGE)
                figures[:, column] = np.array([found.value, *found.interval]) * scale
        figures[~np.isfinite(figures)] = np.nan
        value, low, high = figures
        # beside each other, so that intervals can be told apart
        places = np.arange(len(results)) + 0.8 * (number - middle) / max(1, len(policies))
        spread = np.nan_to_num(np.maximum(0.0, [value - low, high - value]))
        few = np.array(
            [
                policy in records and _partial(records[policy], count)
                for records, count in zip(flights, flown, strict=True)
            ]
        )
        # the legend shows every policy once, filled
        axis.plot([], [], label=first.title, **{**style, "linestyle": "none"})
        for chosen, face in ((~few, style["color"]), (few, "white")):
            axis.errorbar(
                places[chosen],
                value[chosen],
                yerr=spread[:, chosen],
                capsize=2,
                markersize=5.0,
                elinewidth=1.0,
                markerfacecolor=face,
                **{**style, "linestyle": "none"},
            )
    for border in range(1, len(results)):
        axis.axvline(border - 0.5, color="0.85", linewidth=0.8)
    axis.set_xlim(-0.5, len(results) - 0.5)
    axis.set_xticks(range(len(results)), [result.suite for result in results])
    axis.set_xlabel("suite (hollow: on fewer episodes than the others)" if starred else "suite")
    axis.set_ylabel(f"{_axis_label()}: interquartile mean")
    axis.grid(alpha=0.3, which="both", axis="y")
    plain_log(axis.yaxis)
    fig.legend(loc="outside right upper", fontsize="small")
    return save_figure(fig, path, overwrite=overwrite)


def _between_seeds(
    runs: Sequence[NDArray[np.float64]], column: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places that all runs reach, and the interquartile mean of the runs at each of them."""
    first = max(run[0, column] for run in runs)
    last = min(run[-1, column] for run in runs)
    every = np.unique(np.concatenate([run[:, column] for run in runs]))
    places = every[(every >= first) & (every <= last)]
    lines = [
        np.interp(places, run[:, column], np.where(np.isfinite(run[:, 2]), run[:, 2], 1e100))
        for run in runs
    ]
    middle = np.array([interquartile_mean(values) for values in np.transpose(lines)])
    return places, np.where(middle > 1e50, np.nan, middle)


def plot_curves(
    curves: Mapping[str, Sequence[ArrayLike]],
    bands: Mapping[str, Estimate],
    path: Path,
    *,
    metric: str = JUDGE,
    title: str = "learning curves",
    overwrite: bool = False,
) -> Path:
    """Draw a metric over simulated steps and over wall time, laws as horizontal bands.

    All axes are logarithmic: the methods need from seconds to half an hour. What was evaluated
    before the first step is left out.

    Parameters
    ----------
    curves
        By title of the algorithm one array a training seed, each of shape (k, 3) with a row an
        evaluation: steps, wall time in s, value in SI. Thin lines are seeds, a thick one is their
        interquartile mean.
    bands
        Estimates of laws over the same episodes, by title, SI.
    path
        PNG to write; returned.
    metric, title, overwrite
        What the values are, what is above the figure, whether a file may be replaced.

    Raises
    ------
    ValueError
        An array of another shape, or without rows.
    """
    display = describe(metric)
    drawn: dict[str, list[NDArray[np.float64]]] = {
        name: [np.asarray(run, dtype=np.float64) for run in runs] for name, runs in curves.items()
    }
    for name, runs in drawn.items():
        for run in runs:
            if run.ndim != 2 or run.shape[1] != 3 or run.shape[0] == 0:
                raise ValueError(f"a curve of {name!r} has shape {run.shape} instead of (k, 3)")
    fig, grid = subplots(1, 2, size=(12.0, 5.0), sharey=True)
    axes = list(grid[0])
    looks = dict(zip([*drawn, *bands], styles([*drawn, *bands]), strict=True))
    sides = ((0, 1e-6, "simulated steps (millions)"), (1, 1.0 / 60.0, "wall time (min)"))
    for axis, (column, factor, label) in zip(axes, sides, strict=True):
        axis.set_xscale("log")
        axis.set_yscale("log")
        for name in drawn:
            line = {key: looks[name][key] for key in ("color", "linestyle")}
            runs = [run[(run[:, 0] > 0.0) & (run[:, column] > 0.0)] for run in drawn[name]]
            runs = [run for run in runs if len(run) > 0]
            for begun in runs:
                value = np.where(np.isfinite(begun[:, 2]), begun[:, 2], np.nan)
                axis.plot(
                    begun[:, column] * factor,
                    value * display.scale,
                    linewidth=0.6,
                    alpha=0.5,
                    **line,
                )
            if runs:
                places, middle = _between_seeds(runs, column)
                word = "seed" if len(runs) == 1 else "seeds"
                axis.plot(
                    places * factor,
                    middle * display.scale,
                    linewidth=2.2,
                    label=f"{name} ({len(runs)} {word})",
                    **line,
                )
        for name, found in bands.items():
            line = {key: looks[name][key] for key in ("color", "linestyle")}
            level = found.value * display.scale
            low, high = (edge * display.scale for edge in found.interval)
            if not math.isfinite(level):
                continue
            if math.isfinite(low) and math.isfinite(high):
                axis.axhspan(low, high, color=line["color"], alpha=0.15, linewidth=0.0)
            axis.axhline(level, linewidth=1.2, label=name, **line)
        axis.set_xlabel(label)
        axis.grid(alpha=0.3, which="both")
        plain_log(axis.xaxis)
        plain_log(axis.yaxis)
    axes[0].set_ylabel(_axis_label(metric))
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside right upper", fontsize="small")
    fig.suptitle(title)
    return save_figure(fig, path, overwrite=overwrite)


# --- page and Markdown files ----------------------------------------------------------------------


def _data_uri(path: Path) -> str:
    try:
        return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
    except OSError as error:
        raise BaselineError(f"figure {path} cannot be read: {error}") from error


def write_page(
    results: Sequence[SuiteResult],
    path: Path,
    figures: Mapping[str, Path],
    *,
    overwrite: bool = False,
) -> Path:
    """Write one HTML page that needs no other file: tables, targets, figures, how it was made.

    Parameters
    ----------
    results
        The suites, in their order on the page.
    path
        File to write; returned.
    figures
        PNG files by caption; they are put into the page.
    overwrite
        Whether a file may be replaced.

    Raises
    ------
    BaselineError
        A figure that cannot be read.
    ExistingResultError
        ``path`` exists and ``overwrite`` is false.
    """
    source = resources.files(__package__).joinpath("page.html.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    headings, rows, starred = _degradation(results)
    text = environment.from_string(source).render(
        suites=[
            {
                "label": _label(result),
                "headings": _headings(),
                "rows": _rows(result),
                "notes": notes(result),
                "targets": targets(result),
            }
            for result in results
        ],
        degradation={
            "headings": headings,
            "rows": rows,
            "label": _axis_label(),
            "starred": starred,
        },
        figures=[(caption, _data_uri(picture)) for caption, picture in figures.items()],
        method=METHOD,
        policies=[
            (record.title, json.dumps(storage.plain(dict(record.details)), indent=2))
            for record in _policies(results).values()
        ],
        provenance=json.dumps(storage.plain(storage.provenance()), indent=2),
    )
    return storage.write_text(path, text, overwrite=overwrite)


def inject(path: Path, name: str, text: str) -> Path:
    """Replace what is between two markers of a Markdown file; everything else stays as it is.

    The markers are ``<!-- benchmark:NAME -->`` and ``<!-- /benchmark:NAME -->``.

    Raises
    ------
    BaselineError
        No such file, or markers that are missing, there twice or in the wrong order; the file is
        as it was.
    """
    begin, end = f"<!-- benchmark:{name} -->", f"<!-- /benchmark:{name} -->"
    try:
        old = path.read_text(encoding="utf-8")
    except OSError as error:
        raise BaselineError(f"{path} cannot be read: {error}") from error
    place = marked_range(old, begin, end, where=str(path))
    if place is None:
        raise BaselineError(f"{path}: expected {begin!r} and then {end!r}, found neither")
    body = text.strip("\n")
    new = f"{old[: place[0]]}{begin}\n{body}\n{end}{old[place[1] :]}"
    return storage.write_text(path, new, overwrite=True)
