"""The leaderboard: everybody over all suites in one order, and what each learned from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drm_baselines.benchmark.estimates import estimate_of
from drm_baselines.benchmark.records import Record, SuiteResult
from drm_baselines.benchmark.report.ranking import (
    JUDGE,
    bound_of,
    episodes_flown,
    flew_part,
    held_against,
)
from drm_baselines.benchmark.report.tables import (
    BUDGETS,
    markdown,
    policies_in,
    shown,
    trained_on,
    with_interval,
)
from drm_baselines.evaluation.metrics import describe

_DASH = "-"


def leaderboard(results: Sequence[SuiteResult]) -> str:
    """Return a Markdown table for each suite, the best policy first, and one of origins.

    The order is that of the interquartile mean of the tip error RMS. The bound is no competitor and
    has no rank, and neither has who flew fewer episodes than others: its figure is of other
    episodes.
    """
    parts = []
    for result in results:
        parts.append(f"### {result.suite}: {result.title}\n\n{_of_suite(result)}")
    parts.append(f"### Where each row comes from\n\n{_origins(results)}")
    return "\n\n".join(parts)


def _of_suite(result: SuiteResult) -> str:
    metric, settled = describe(JUDGE), describe("settled")
    bound, flown = bound_of(result), episodes_flown(result)
    records = sorted(
        (record for record in result.records if JUDGE in record.metrics),
        key=lambda record: estimate_of(record, JUDGE).value,
    )
    rows, rank = [], 0
    for record in records:
        part = flew_part(record, flown)
        if part or record.kind == "bound":
            place = _DASH
        else:
            rank += 1
            place = str(rank)
        found = estimate_of(record, JUDGE)
        ratio = held_against(record, bound, ratio=True)
        has = "settled" in record.metrics
        rows.append(
            [
                place,
                f"{record.title} *" if part else record.title,
                record.kind,
                with_interval(found.value, found.interval, metric.scale),
                _DASH if ratio is None else with_interval(ratio.value, ratio.ci95),
                shown(estimate_of(record, "settled").value, settled.scale) if has else _DASH,
                str(len(record.seeds)) if record.details.get("training") else _DASH,
                trained_on(record),
            ]
        )
    headings = [
        "rank", "policy", "kind", f"{metric.label} ({metric.unit})", "times the bound",
        f"{settled.label} ({settled.unit})", "seeds", "trained, each seed",
    ]  # fmt: skip
    lines = markdown(headings, rows, 3)
    if any(flew_part(record, flown) for record in records):
        lines += ["", "\\* on fewer episodes than the others."]
    return "\n".join(lines)


def _origins(results: Sequence[SuiteResult]) -> str:
    rows = []
    for record in policies_in(results).values():
        details = record.details
        versions = details.get("versions")
        engine = versions.get("drm-env") if isinstance(versions, Mapping) else None
        commit = details.get("git_commit")
        rows.append(
            [
                record.title,
                f"drm-env {_safe(engine)}",
                _safe(commit)[:12],
                _identity(record),
                _command(record),
            ]
        )
    headings = ["policy", "flown with", "commit", "is", "trained by"]
    return "\n".join([*markdown(headings, rows, 5), "", BUDGETS])


def _identity(record: Record) -> str:
    """What tells a policy from others: the digest of its (first) weights, or its law."""
    details = record.details
    weights = details.get("weights")
    if isinstance(weights, Mapping) and weights:
        first = next(iter(weights.values()))
        more = f" and {len(weights) - 1} more" if len(weights) > 1 else ""
        return f"weights {_safe(first)[:12]}{more}"
    for name, what in (("weights_sha256", "weights"), ("source_sha256", "code")):
        if details.get(name):
            return f"{what} {_safe(details[name])[:12]}"
    law = details.get("law")
    if isinstance(law, Mapping):
        return f"law {_safe(law.get('name'))}"
    return _DASH


def _command(record: Record) -> str:
    """The command that trained the first seed, as its record states it."""
    training = record.details.get("training")
    if not isinstance(training, Mapping) or not training:
        return _DASH
    first = next(iter(training.values()))
    command = first.get("command") if isinstance(first, Mapping) else None
    if not isinstance(command, list) or not command:
        return _DASH
    return f"`{_safe(' '.join(str(part) for part in command))}`"


def _safe(value: object) -> str:
    """Text of a stranger's record without what Markdown or HTML would take for its own."""
    if not isinstance(value, str):
        return _DASH
    return "".join(each for each in value if each.isprintable() and each not in "`|<>[]\\")[:300]
