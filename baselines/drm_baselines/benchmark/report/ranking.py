"""Who is best, who is shown, and what is held against what."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from drm_baselines.benchmark.estimates import (
    Compared,
    estimate_of,
    improvement,
    multiple,
    restricted,
)
from drm_baselines.benchmark.records import KINDS as KINDS
from drm_baselines.benchmark.records import SUBMITTED, Record, SuiteResult
from drm_baselines.errors import BaselineError
from drm_baselines.evaluation.metrics import describe

ORDER = (*KINDS, SUBMITTED)
"""Kinds of policies in the order of tables, strangers' last."""

JUDGE = "tip_error_rms"
"""The metric that policies are ranked by."""

# --- choosing -------------------------------------------------------------------------------------


def ordered(result: SuiteResult) -> list[Record]:
    """Return the records in the order of tables: by kind, else as they come.

    Raises
    ------
    BaselineError
        A kind that is none of :data:`ORDER`, or two records of one policy.
    """
    names = [record.policy for record in result.records]
    for record in result.records:
        if record.kind not in ORDER:
            raise BaselineError(f"{record.policy!r} is of kind {record.kind!r}; there are {ORDER}")
        if names.count(record.policy) > 1:
            raise BaselineError(f"suite {result.suite!r} has two records of {record.policy!r}")
    return sorted(result.records, key=lambda record: ORDER.index(record.kind))


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


def bound_of(result: SuiteResult) -> Record | None:
    """Return the record of the bound, if it was flown."""
    return next((record for record in result.records if record.kind == "bound"), None)


def held_against(record: Record, other: Record | None, *, ratio: bool) -> Compared | None:
    """A comparison in the judging metric; none without a partner or a common episode."""
    if other is None or not all(JUDGE in side.metrics for side in (record, other)):
        return None
    if np.intersect1d(record.episodes, other.episodes).size == 0:
        return None
    return (multiple if ratio else improvement)(record, other, JUDGE)


def flew_part(record: Record, flown: int) -> bool:
    """Whether a record's figures are over fewer episodes than those of others."""
    return len(record.episodes) < flown


def episodes_flown(result: SuiteResult) -> int:
    """How many episodes of the suite were flown by anybody."""
    places = [record.episodes for record in result.records]
    return int(np.unique(np.concatenate(places)).size) if places else 0
