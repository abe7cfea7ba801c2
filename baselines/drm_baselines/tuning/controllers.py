"""Searching the settings of a controller that plans under way.

It is judged like a law, by the interquartile mean of the tip error over manoeuvres of training,
only over fewer of them, since a flight takes it half a second. With so few, the best of the trials
is partly the luckiest: it flies fresh manoeuvres of training against the first trial, and is taken
only where it is significantly better there and settles no fewer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines import suites
from drm_baselines.errors import BaselineError
from drm_baselines.evaluation.statistics import compare_paired, interquartile_mean
from drm_baselines.optimal_control.mpc import Receding, fly_all
from drm_baselines.support.executors import Tell
from drm_baselines.support.places import Place
from drm_baselines.support.reading import read_table
from drm_baselines.support.seeds import TUNING_SEED
from drm_baselines.tuning.laws import (
    Draw,
    made_by,
    search_over,
    start_of,
    training_scenarios,
    written,
)
from drm_baselines.tuning.search import GAINS_FILE
from drm_baselines.tuning.space import SETTINGS, check_target
from drm_baselines.tuning.trials import (
    LOST,
    METRIC,
    Outcome,
    Progress,
    UnfitError,
    Verdict,
    best_of,
    budget_of,
    silent,
    summary_of,
)

HOPELESS = 1.5
"""Times the tip error of the first trial's settings, over the first third of the manoeuvres, at
which a trial ends early."""

FRESH = 2
"""Fresh manoeuvres that the best trial and the first fly at the end, for each of the search."""

_FRESH_SEED = 500_000


@dataclass(frozen=True, kw_only=True)
class ControllerRequest:
    """Which controller to tune, on how many manoeuvres like a suite's, with how many trials."""

    controller: str = "receding"
    suite: str = "robust"
    scenarios: int = 24
    trials: int = 24
    seed: int = 0
    at_once: int = 1

    @property
    def command(self) -> str:
        """The command that makes the search anew."""
        at_once = "" if self.at_once == 1 else f" --at-once {self.at_once}"
        return (
            f"drm tune {self.controller} --suite {self.suite} --scenarios {self.scenarios} "
            f"--trials {self.trials} --seed {self.seed}{at_once}"
        )


def in_turn(count: int) -> list[int]:
    """Return the places of ``count`` drawn manoeuvres, one of each stratum in turn."""
    strata = len(suites.STRATA)
    return [
        place for first in range(count // strata) for place in range(first, count, count // strata)
    ]


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What came of some flights.

    Attributes
    ----------
    errors
        RMS of the tip error, m, :data:`~drm_baselines.tuning.trials.LOST` where the arm was lost.
    settled
        1 where the arm settled, else 0.
    cost
        Sums over the flights.
    """

    errors: NDArray[np.float64]
    settled: NDArray[np.float64]
    cost: Mapping[str, float]

    @property
    def value(self) -> float:
        """Interquartile mean of the tip error, mm."""
        return interquartile_mean(self.errors) * METRIC.scale


def fly(
    settings: Mapping[str, float],
    scenarios: Sequence[Mapping[str, Any]],
    seeds: Sequence[int],
    processes: int | None = 1,
) -> Flown:
    """Fly the controller with these settings, those of the rest being the package's.

    Raises
    ------
    BaselineError
        A scenario that cannot be flown.
    """
    values: dict[str, Any] = dict(settings)  # by field, each of its field's type
    chosen = replace(Receding(), **values)
    metrics = fly_all(scenarios, seeds=seeds, settings=chosen, processes=processes)
    error = metrics[METRIC.name]
    lost = ~np.isfinite(error) | (metrics["diverged"] > 0.0)
    return Flown(
        errors=np.where(lost, LOST, error),
        settled=np.where(lost, 0.0, metrics["settled"]),
        cost={
            "episodes": len(scenarios),
            "diverged": int(lost.sum()),
            "settled": int(np.where(lost, 0.0, metrics["settled"]).sum()),
            "plans": int(metrics["plans"].sum()),
            "simulated_seconds": float(metrics["duration"].sum()),
        },
    )


@dataclass(frozen=True, kw_only=True)
class _Judge:
    """Flies the controller with the settings of a trial; the hopeless ones not to the end."""

    scenarios: Sequence[Mapping[str, Any]]
    begun: int
    """Manoeuvres after which a trial may end."""
    bar: float
    """Tip error (mm) over these at which it does."""

    def __call__(
        self,
        number: int,
        parameters: Mapping[str, Any],
        tell: Tell,  # noqa: ARG002
    ) -> Verdict:
        """See :class:`drm_baselines.tuning.trials.Judge`."""
        try:
            first = self._fly(parameters, slice(0, self.begun))
            if number > 0 and first.value > self.bar:
                raise UnfitError(
                    f"{first.value:.4g} mm over the first {self.begun} manoeuvres, more than "
                    f"{self.bar:.4g} mm"
                )
            rest = self._fly(parameters, slice(self.begun, None))
        except (BaselineError, drm_env.DrmError) as error:
            raise UnfitError(str(error)) from error
        return Verdict(
            value=interquartile_mean(np.concatenate([first.errors, rest.errors])) * METRIC.scale,
            cost={name: first.cost[name] + rest.cost[name] for name in first.cost},
        )

    def _fly(self, parameters: Mapping[str, Any], part: slice) -> Flown:
        places = range(len(self.scenarios))[part]
        return fly(parameters, self.scenarios[part], [TUNING_SEED + place for place in places])


def tune_controller(
    directory: Path,
    request: ControllerRequest,
    *,
    force: bool = False,
    progress: Progress | None = None,
    place: Place | None = None,
) -> Outcome:
    """Search the settings of a controller, or go on with a search, and write those to be taken.

    Parameters
    ----------
    directory
        Of the search; one that holds the same search goes on with the missing trials.
    request
        What is searched.
    force
        Whether to start anew in a directory that is not empty.
    progress
        Called after each trial.
    place
        Where trials that are drawn at once are run; one after another here by default.

    Raises
    ------
    BaselineError
        Unknown names, a directory of another search, or no trial that could be flown.
    ExistingResultError
        The directory holds something else.
    """
    space = SETTINGS[check_target(request.controller, tuple(SETTINGS))]
    draw = training_scenarios(request.suite, request.scenarios)
    scenarios = [draw.scenarios[place] for place in in_turn(request.scenarios)]
    start = start_of(space)
    begun = max(1, request.scenarios // 3)
    search = search_over(directory, "controller", request.controller, request, space, draw)
    trials, found, interrupted = search.run(
        request.trials,
        _Judge(scenarios=scenarios, begun=begun, bar=_bar(start, scenarios[:begun])),
        force=force,
        progress=progress or silent,
        place=place,
    )
    best = best_of(trials, request.controller)
    path = directory / GAINS_FILE
    confirmation = None
    if not interrupted:
        fresh = training_scenarios(request.suite, FRESH * request.scenarios, beyond=_FRESH_SEED)
        confirmation = _confirmed(path, best.parameters, start, fresh)
    taken = confirmation is not None and confirmation["taken"]
    budget = budget_of(trials)
    budget["episodes"] += begun * sum(trial.value is None for trial in trials)
    content = {
        "name": request.controller,
        "settings": dict(best.parameters if taken else start),
        **summary_of(trials, space, search.start),
        "confirmation": confirmation,
        "budget": budget,
        **made_by(request, space, draw),
    }
    return written(directory, content, found=found, interrupted=interrupted)


def _bar(start: Mapping[str, float], scenarios: Sequence[Mapping[str, Any]]) -> float:
    seeds = range(TUNING_SEED, TUNING_SEED + len(scenarios))
    return HOPELESS * fly(start, scenarios, seeds, None).value


def _confirmed(
    path: Path, best: Mapping[str, float], first: Mapping[str, float], draw: Draw
) -> dict[str, Any]:
    """Return how the best trial and the first fly fresh manoeuvres, flown or as in ``path``."""
    try:
        stored = read_table(path, "result of a search")
    except BaselineError:
        stored = {}
    known = stored.get("confirmation")
    if known and known["sha256"] == draw.digest and stored["parameters"] == dict(best):
        return dict(known)
    seeds = range(TUNING_SEED + _FRESH_SEED, TUNING_SEED + _FRESH_SEED + len(draw.scenarios))
    old = fly(first, draw.scenarios, seeds, None)
    new = old if dict(best) == dict(first) else fly(best, draw.scenarios, seeds, None)
    errors = compare_paired(new.errors, old.errors)
    settled = compare_paired(new.settled, old.settled, higher_is_better=True, trimmed=False)
    return {
        "count": len(draw.scenarios),
        "strata": list(draw.strata),
        "sha256": draw.digest,
        "value": new.value,
        "first": old.value,
        "difference": errors.difference.scaled(METRIC.scale).to_dict(),
        "settled": {
            "value": float(new.settled.mean()),
            "first": float(old.settled.mean()),
            "difference": settled.difference.to_dict(),
        },
        "taken": bool(errors.better and new.settled.mean() >= old.settled.mean()),
    }
