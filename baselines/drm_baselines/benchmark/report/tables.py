"""The benchmark's records as JSON, tables, targets, figures and one HTML page.

Everything here is made from records alone and is the same each time it is made. Values are in SI
in JSON and in the display units of :mod:`drm_baselines.evaluation.metrics` elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rich.table import Table
from rich.text import Text

from drm_baselines.benchmark.estimates import (
    estimate_of,
)
from drm_baselines.benchmark.records import Record, SuiteResult
from drm_baselines.benchmark.report.ranking import (
    JUDGE,
    ORDER,
    bound_of,
    episodes_flown,
    flew_part,
    held_against,
    ordered,
)
from drm_baselines.evaluation.metrics import HEADLINE, describe
from drm_baselines.policies.budgets import mean_budget
from drm_baselines.suites import SUITES
from drm_baselines.support.format import significant

_DASH = "-"

TRAINED = "trained, each seed"
"""Heading of what a learned policy was given to learn from."""


BUDGETS = (
    "Trained: decisions in all environments, updates of the policy and minutes of one training, "
    "the mean over the seeds. An update is a batch of experience for PPO, a gradient step for "
    "SAC, a round or a step of refinement for imitation."
)
"""What the column :data:`TRAINED` says."""


# --- tables ---------------------------------------------------------------------------------------


def shown(value: float, scale: float = 1.0) -> str:
    """Return a value times ``scale`` with three significant digits, a dash for NaN."""
    if math.isnan(value):
        return _DASH
    if math.isinf(value):
        return "inf" if value > 0.0 else "-inf"
    return significant(value * scale)


def with_interval(value: float, ci95: tuple[float, float], scale: float = 1.0) -> str:
    """Return a figure with its interval, in three significant digits."""
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
    return with_interval(found.value, found.interval, describe(JUDGE).scale)


def trained_on(record: Record) -> str:
    """Return steps, updates and minutes of a learned policy, the mean over its seeds; else a dash.

    See :class:`drm_baselines.policies.budgets.Budget`.
    """
    training = record.details.get("training")
    if not isinstance(training, Mapping):
        return _DASH
    budget = mean_budget(
        {seed: each for seed, each in training.items() if isinstance(each, Mapping)}
    )
    return _DASH if budget is None else budget.told()


def headings_of() -> list[str]:
    """Return the headings of the table of a suite."""

    def heading(name: str) -> str:
        metric = describe(name)
        return f"{metric.label} ({metric.unit})"

    start = ["policy", "knows", "decides every (ms)", "seeds", TRAINED]
    start += [heading(JUDGE), "times the bound"]
    return start + [heading(name) for name in HEADLINE if name != JUDGE]


def rows_of(result: SuiteResult) -> list[list[str]]:
    """Return the cells of the table of a suite, a row a policy."""
    bound, flown = bound_of(result), episodes_flown(result)
    rows = []
    for record in ordered(result):
        ratio = held_against(record, bound, ratio=True)
        trained = record.kind == "learned" or len(record.seeds) > 1
        rows.append(
            [
                f"{record.title} *" if flew_part(record, flown) else record.title,
                record.knows,
                f"{record.control_period * 1e3:g}" if record.control_period > 0.0 else _DASH,
                str(len(record.seeds)) if trained else _DASH,
                trained_on(record),
                _judge(record),
                _DASH if ratio is None else with_interval(ratio.value, ratio.ci95),
                *(_headline(record, name) for name in HEADLINE if name != JUDGE),
            ]
        )
    return rows


def notes(result: SuiteResult) -> list[str]:
    """Return what a reader of a suite's table has to know, sentence by sentence."""
    flown = episodes_flown(result)
    lines = [
        f"Interquartile mean over {flown} episodes and all training seeds, with its 95 % bootstrap "
        "interval; settled: mean.",
        "An episode that never settles counts with the whole time after the slew; a diverged one "
        "counts as infinitely bad.",
    ]
    if any(trained_on(record) != _DASH for record in result.records):
        lines.append(BUDGETS)
    suite = SUITES.get(result.suite)
    if suite is not None and flown < suite.episodes:
        lines.append(f"These are {flown} of the {suite.episodes} episodes of the suite.")
    lines.extend(
        f"* {record.title}: {len(record.episodes)} of these {flown} episodes; its figures belong "
        "to these alone and cannot be held against the others'. The multiples of the bound can: "
        "they are over the episodes that both flew."
        for record in ordered(result)
        if flew_part(record, flown)
    )
    return lines


def label_of(result: SuiteResult) -> str:
    """Return name and title of the suite, as a table is called."""
    return f"{result.suite}: {result.title}"


def terminal_table(result: SuiteResult) -> Table:
    """Return a suite as a table for the terminal, a row a policy, its notes below."""
    table = Table(title=Text(label_of(result)), title_justify="left", header_style="bold")
    for place, heading in enumerate(headings_of()):
        table.add_column(heading, justify="left" if place < 2 else "right")
    for row in rows_of(result):
        # intervals go below their figures; brackets are not markup
        table.add_row(*(Text(cell.replace(" [", "\n[") if "]" in cell else cell) for cell in row))
    table.caption = Text("\n".join(notes(result)))
    table.caption_justify = "left"
    return table


def _escaped(text: str) -> str:
    return text.replace("*", "\\*")


def markdown(headings: Sequence[str], rows: Sequence[Sequence[str]], left: int) -> list[str]:
    """Return the lines of a Markdown table whose first ``left`` columns are text."""

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(_escaped(cell).replace("|", "\\|") for cell in cells) + " |"

    rule = "|" + "---|" * left + "---:|" * (len(headings) - left)
    return [line(headings), rule, *(line(row) for row in rows)]


def markdown_table(result: SuiteResult) -> str:
    """Return a suite as a Markdown table, a row a policy, its notes below as a list."""
    table = markdown(headings_of(), rows_of(result), 2)
    return "\n".join([*table, "", *(f"- {_escaped(note)}" for note in notes(result))])


SHORT = ("bound", "none", "linear", "lyapunov", "lqr", "dagger", "ppo", "ppo_direct")
"""Policies of the short table: whom a stranger wants to see first."""


def short_markdown_table(result: SuiteResult) -> str:
    """Return the policies of `SHORT` with what is judged, as a Markdown table with its notes."""
    judged, settled = (f"{each.label} ({each.unit})" for each in map(describe, (JUDGE, "settled")))
    headings = headings_of()
    wanted = [headings[0], judged, "times the bound", settled]
    places = [headings.index(heading) for heading in wanted]
    chosen = {record.title for record in ordered(result) if record.policy in SHORT}
    rows = [
        [row[place] for place in places]
        for record, row in zip(ordered(result), rows_of(result), strict=True)
        if record.title in chosen
    ]
    # a note on a policy or a column that is not here would only puzzle
    said = [
        note
        for note in notes(result)
        if not note.startswith(("*", "Trained:"))
        or any(note.startswith(f"* {title}:") for title in chosen)
    ]
    return "\n".join([*markdown(wanted, rows, 1), "", *(f"- {_escaped(note)}" for note in said)])


def policies_in(results: Sequence[SuiteResult]) -> dict[str, Record]:
    """The first record of every policy of all suites, in the order of tables."""
    found: dict[str, Record] = {}
    for result in results:
        for record in ordered(result):
            found.setdefault(record.policy, record)
    # the sort is stable
    return dict(sorted(found.items(), key=lambda item: ORDER.index(item[1].kind)))


def degradation_of(results: Sequence[SuiteResult]) -> tuple[list[str], list[list[str]], bool]:
    """Headings, rows, and whether a star marks a record with fewer episodes."""
    rows, starred = [], False
    flights = [{record.policy: record for record in result.records} for result in results]
    for policy, first in policies_in(results).items():
        row = [first.title]
        for result, records in zip(results, flights, strict=True):
            cell = _headline(records[policy], JUDGE) if policy in records else _DASH
            if policy in records and flew_part(records[policy], episodes_flown(result)):
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
    headings, rows, starred = degradation_of(results)
    return "\n".join([*markdown(headings, rows, 1), *(["", _escaped(_STAR)] if starred else [])])
