"""Trials of a search, and what is said about all of them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from drm_baselines.errors import BaselineError
from drm_baselines.evaluation.metrics import describe
from drm_baselines.support import storage
from drm_baselines.support.executors import Tell

if TYPE_CHECKING:
    pass
from drm_baselines.tuning.space import Dimension

LOST = 10.0
"""Tip error (m) that a diverged manoeuvre counts with."""

METRIC = describe("tip_error_rms")

Progress = Callable[[str, int, int, str], None]
"""Called with (label, done, total, note) while trials and trainings go on."""


class UnfitError(Exception):
    """A trial whose parameters make nothing that could fly; the search goes on without it."""


class StoppedError(Exception):
    """A trial that was interrupted and does not count."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a trial was worth: the objective in mm, and figures that are summed into the budget."""

    value: float
    cost: Mapping[str, float] = field(default_factory=dict)


class Judge(Protocol):
    """Says what parameters are worth; it can be sent to other processes."""

    def __call__(self, number: int, parameters: Mapping[str, Any], tell: Tell) -> Verdict:
        """Judge the parameters of a trial.

        Raises
        ------
        UnfitError
            They make nothing that could fly.
        StoppedError
            A signal has ended the trial.
        """


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One trial of a search.

    ``number`` counts from 0, ``value`` is in mm and none for a trial that was ``"pruned"`` for
    ``reason``; ``seconds`` is wall time.
    """

    number: int
    value: float | None
    state: str
    parameters: Mapping[str, Any]
    seconds: float
    cost: Mapping[str, float]
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Where a search stands.

    Attributes
    ----------
    content
        What ``gains.json`` holds, or the same about settings of learning.
    found
        Trials that were there before.
    interrupted
        Whether trials are missing.
    files
        What was written.
    """

    content: dict[str, Any]
    found: int
    interrupted: bool
    files: tuple[Path, ...]


def write_trials(path: Path, trials: Sequence[Trial], space: Sequence[Dimension]) -> Path:
    """Write the record of a search as CSV; values are in mm, numbers to the last bit."""
    names = [dimension.name for dimension in space]
    with (
        storage.atomic_path(path, overwrite=True) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["number", "value", "state", *names, "seconds", "reason"])
        for trial in trials:
            writer.writerow(
                [
                    trial.number,
                    "" if trial.value is None else trial.value,
                    trial.state,
                    *(trial.parameters[name] for name in names),
                    f"{trial.seconds:.3f}",
                    trial.reason,
                ]
            )
    return path


def silent(label: str, done: int, total: int, note: str) -> None:
    """Show nothing."""


def note_of(trials: Sequence[Trial]) -> str:
    """Return what a progress bar says: the best value so far."""
    values = [trial.value for trial in trials if trial.value is not None]
    return f"best {min(values):.4g} mm" if values else "trials"


def best_of(trials: Sequence[Trial], name: str) -> Trial:
    """Return the best trial of the search called ``name``.

    Raises
    ------
    BaselineError
        None flew.
    """
    flown = [trial for trial in trials if trial.value is not None]
    if not flown:
        why = f": {trials[-1].reason}" if trials else ", it was interrupted before"
        raise BaselineError(f"the search of {name} has no trial that flew{why}")
    return min(flown, key=lambda trial: (trial.value, trial.number))


def summary_of(
    trials: Sequence[Trial], space: Sequence[Dimension], start: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the best parameters, their value, and what lies at an edge of its range."""
    best = best_of(trials, "")
    return {
        "parameters": dict(best.parameters),
        "objective": {
            "metric": METRIC.name,
            "aggregate": "interquartile mean",
            "unit": METRIC.unit,
            "value": best.value,
            # the thesis' gains or the packaged settings
            "first": trials[0].value if start else None,
        },
        "at_edge": [each.name for each in space if each.at_edge(float(best.parameters[each.name]))],
        "trials": {
            "count": len(trials),
            "pruned": sum(trial.value is None for trial in trials),
            "best": best.number,
        },
    }


def budget_of(trials: Sequence[Trial]) -> dict[str, float]:
    """Return what all trials have cost together."""
    total: dict[str, float] = {}
    for trial in trials:
        for name, cost in trial.cost.items():
            total[name] = total.get(name, 0) + cost
    return {**total, "wall_seconds": round(sum(trial.seconds for trial in trials), 3)}
