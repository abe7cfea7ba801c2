"""The aggregates of a suite as plain data, in SI."""

from __future__ import annotations

from typing import Any

from drm_baselines.benchmark.estimates import (
    Compared,
    estimate_of,
)
from drm_baselines.benchmark.records import Record, SuiteResult
from drm_baselines.benchmark.report.ranking import (
    best,
    bound_of,
    episodes_flown,
    held_against,
    ordered,
)
from drm_baselines.support import storage

FORMAT = "drm-benchmark"
FORMAT_VERSION = 1
_NO_AGGREGATE = ("duration", "slew_end_time")


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
    bound, tuned = bound_of(result), best(result, "tuned law")
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
        entry["multiple_of_bound"] = _entry(held_against(record, bound, ratio=True), bound)
        entry["probability_of_improvement"] = _entry(
            held_against(record, tuned, ratio=False), tuned
        )
        policies[record.policy] = entry
    content: dict[str, Any] = storage.plain(
        {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "suite": result.suite,
            "title": result.title,
            "episodes": episodes_flown(result),
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
