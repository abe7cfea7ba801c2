"""Searching the gains of a control law.

A law flies manoeuvres drawn like those of a suite, but from seeds of training, never the suite's
own, and is judged by the interquartile mean of the tip error.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

import drm_env
from drm_baselines import suites
from drm_baselines.errors import BaselineError
from drm_baselines.evaluation.statistics import interquartile_mean
from drm_baselines.optimal_control import scheduled_lqr
from drm_baselines.stability import STABLE, Loop, closed_loop, growth_rate
from drm_baselines.support import cores, storage
from drm_baselines.support.executors import Tell
from drm_baselines.support.places import Place
from drm_baselines.support.reading import read_table
from drm_baselines.support.seeds import TUNING_SEED

if TYPE_CHECKING:
    pass
from drm_baselines.policies.gains import FORMAT, FORMAT_VERSION
from drm_baselines.tuning.search import GAINS_FILE, TRIALS_FILE, Search, origin
from drm_baselines.tuning.space import GAINS, Dimension, check_target
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


@dataclass(frozen=True, kw_only=True)
class LawRequest:
    """Which law to tune, on how many manoeuvres like those of which suite, with how many trials."""

    law: str
    suite: str = "robust"
    scenarios: int = 400
    trials: int = 200
    seed: int = 0
    at_once: int = 1

    @property
    def command(self) -> str:
        """The command that makes the search anew."""
        at_once = "" if self.at_once == 1 else f" --at-once {self.at_once}"
        return (
            f"drm tune {self.law} --suite {self.suite} --scenarios {self.scenarios} "
            f"--trials {self.trials} --seed {self.seed}{at_once}"
        )


@dataclass(frozen=True, kw_only=True)
class Draw:
    """Manoeuvres of training: scenarios, their strata with first seed and number, and a digest."""

    scenarios: Sequence[Mapping[str, Any]]
    strata: Sequence[Mapping[str, Any]]
    digest: str


def law_of(name: str, parameters: Mapping[str, float]) -> dict[str, Any]:
    """Return a law as data for the engine from the parameters that are searched.

    Raises
    ------
    BaselineError
        No such law, or weights that no regulator solves.
    """
    check_target(name, tuple(GAINS))
    if name == "lqr":
        # An ill-conditioned design is judged by how it flies.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            return scheduled_lqr.scheduled_law(parameters)
    engine, fixed = _FORMS.get(name, (name, {}))
    law: dict[str, Any] = {"name": engine, **copy.deepcopy(fixed)}
    for path, value in parameters.items():
        *way, last = path.split(".")
        place: Any = law
        for part in way:
            place = place[int(part)] if isinstance(place, list) else place.setdefault(part, {})
        place[int(last) if isinstance(place, list) else last] = value
    return law


_FORMS: dict[str, tuple[str, dict[str, Any]]] = {
    "linear_filtered": (
        "linear",
        {"root": {"filter": {"order": 1}}, "tip": {"filter": {"order": 2}}},
    ),
    "lyapunov_filtered": (
        "lyapunov",
        {"root": {"filter": {"order": 1}}, "tip": {"filter": {"order": 2}}},
    ),
    "linear_collocated": (
        "linear",
        {"root": {"filter": {"order": 1}}, "tip": {"rate_gain": 0.0, "filter": {"order": 1}}},
    ),
    "collocated": (
        "collocated",
        {
            "root": {"filter": {"order": 1}},
            "tip": {"turn_gain": [[0.0, 0.0], [0.0, 0.0]], "filter": {"order": 1}},
        },
    ),
}
"""Laws that have parts which are not searched: name in the engine, and the parts."""

_JUDGED_EXTENSIONS, _JUDGED_MASSES = (1.0, 3.0, 8.0), (50.0, 500.0)
"""Where a law has to be stable to be flown on a flexible arm, m and kg."""


def unstable_at(law: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return an extension (m) and a mass (kg) where a law does not keep the flexible arm stable."""
    for mass in _JUDGED_MASSES:
        for extension in _JUDGED_EXTENSIONS:
            loop = Loop()
            if growth_rate(closed_loop(law, extension, mass, loop=loop), loop.period) >= STABLE:
                return extension, mass
    return None


def training_scenarios(suite: str, count: int, *, beyond: int = 0) -> Draw:
    """Draw manoeuvres from the distributions of a suite, on seeds of training.

    Parameters
    ----------
    suite
        Its name.
    count
        Manoeuvres of all strata together.
    beyond
        Seeds to leave out: what is drawn with as many as are drawn elsewhere is fresh.

    Raises
    ------
    BaselineError
        No such suite, one that lists its manoeuvres, or a number that its strata cannot share.
    """
    strata = suites.STRATA
    if count < len(strata) or count % len(strata):
        raise BaselineError(
            f"scenarios must be a positive multiple of {len(strata)} (the strata), got {count}"
        )
    chosen, each = suites.suite_named(suite), count // len(strata)
    scenarios: list[dict[str, Any]] = []
    rows = []
    for stratum, (title, _, _) in enumerate(strata):
        first = TUNING_SEED + beyond + stratum * each
        config = chosen.stratum_config(stratum)
        scenarios += drm_env.sample_scenarios(config=config, seed=first, n=each)
        rows.append({"name": title, "first_seed": first, "count": each})
    text = json.dumps(storage.plain(scenarios), sort_keys=True, allow_nan=False)
    return Draw(
        scenarios=scenarios, strata=rows, digest=hashlib.sha256(text.encode()).hexdigest()
    )  # fmt: skip


def fly(law: Mapping[str, Any], scenarios: Sequence[Mapping[str, Any]]) -> Verdict:
    """Fly a law and return the interquartile mean of its tip error in mm, and what that cost.

    Raises
    ------
    drm_env.ConfigError
        Impossible gains.
    """
    metrics = drm_env.rollout(scenarios, law=dict(law), seed=TUNING_SEED, num_threads=cores.given())
    error = np.asarray(metrics[METRIC.name], dtype=np.float64)
    lost = ~np.isfinite(error) | (np.asarray(metrics["diverged"]) > 0.0)
    duration = np.asarray(metrics["duration"], dtype=np.float64)
    steps = 0
    for scenario, seconds in zip(scenarios, duration, strict=True):
        period = scenario["sample_period"]
        substeps = math.ceil(period / scenario["integrator_step"] - 1e-9)
        steps += round(seconds / period) * max(1, substeps)
    return Verdict(
        value=interquartile_mean(np.where(lost, LOST, error)) * METRIC.scale,
        cost={
            "episodes": len(scenarios),
            "diverged": int(lost.sum()),
            "simulated_seconds": float(duration.sum()),
            "integrator_steps": steps,
        },
    )


@dataclass(frozen=True, kw_only=True)
class _Judge:
    """Flies a law with the parameters of a trial."""

    law: str
    scenarios: Sequence[Mapping[str, Any]]

    def __call__(
        self,
        number: int,  # noqa: ARG002
        parameters: Mapping[str, Any],
        tell: Tell,  # noqa: ARG002
    ) -> Verdict:
        """See :class:`drm_baselines.tuning.trials.Judge`."""
        try:
            law = law_of(self.law, parameters)
            # what grows flies until the wheels are full: there is nothing to be learned of it
            if self.law in _FORMS and (place := unstable_at(law)) is not None:
                raise UnfitError(f"unstable at {place[0]:g} m with {place[1]:g} kg")
            return fly(law, self.scenarios)
        except (BaselineError, drm_env.DrmError) as error:
            raise UnfitError(str(error)) from error


def tune_law(
    directory: Path,
    request: LawRequest,
    *,
    force: bool = False,
    progress: Progress | None = None,
    place: Place | None = None,
) -> Outcome:
    """Search the gains of a law, or go on with a search, and write the best law found.

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
    space = GAINS[check_target(request.law, tuple(GAINS))]
    draw = training_scenarios(request.suite, request.scenarios)

    judge = _Judge(law=request.law, scenarios=draw.scenarios)
    search = search_over(directory, "law", request.law, request, space, draw)
    trials, found, interrupted = search.run(
        request.trials, judge, force=force, progress=progress or silent, place=place
    )
    best = best_of(trials, request.law)
    content = {
        "name": request.law,
        "law": law_of(request.law, best.parameters),
        **summary_of(trials, space, search.start),
        "budget": budget_of(trials),
        **made_by(request, space, draw),
    }
    return written(directory, content, found=found, interrupted=interrupted)


class OverManoeuvres(Protocol):
    """A search over manoeuvres like a suite's, as :class:`LawRequest` asks for it."""

    @property
    def suite(self) -> str:
        """Suite whose distributions they are drawn from."""

    @property
    def scenarios(self) -> int:
        """Their number."""

    @property
    def seed(self) -> int:
        """Seed of the search."""

    @property
    def at_once(self) -> int:
        """Trials that are drawn together."""

    @property
    def command(self) -> str:
        """The command that makes the search anew."""


def search_over(
    directory: Path,
    kind: str,
    name: str,
    request: OverManoeuvres,
    space: Sequence[Dimension],
    draw: Draw,
) -> Search:
    """Return the search for what is best for one ``kind`` of pilot of a name, over a draw."""
    return Search(
        directory=directory,
        settings={
            kind: name,
            "suite": request.suite,
            "scenarios": request.scenarios,
            "seed": request.seed,
            "space": [dimension.to_dict() for dimension in space],
            "drawn scenarios": draw.digest,
            **({} if request.at_once == 1 else {"at once": request.at_once}),
        },
        space=space,
        start=start_of(space),
        seed=request.seed,
        label=name,
        at_once=request.at_once,
    )


def made_by(request: OverManoeuvres, space: Sequence[Dimension], draw: Draw) -> dict[str, Any]:
    """Return what a result says of its making: its form, the manoeuvres, the command."""
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "scenarios": {
            "suite": request.suite,
            "count": request.scenarios,
            "strata": list(draw.strata),
            "sha256": draw.digest,
        },
        **origin(request.command, request.seed, space),
    }


def written(directory: Path, content: dict[str, Any], *, found: int, interrupted: bool) -> Outcome:
    """Write the result of a search, and return what came of it."""
    path = directory / GAINS_FILE
    content = kept(path, content)
    storage.write_json(path, content, overwrite=True)
    return Outcome(
        content=content,
        found=found,
        interrupted=interrupted,
        files=(path, directory / TRIALS_FILE),
    )


def kept(path: Path, content: dict[str, Any]) -> dict[str, Any]:
    """Return the result in ``path`` if it is the same, for it knows when it was made."""
    try:
        stored = read_table(path, "result of a search")
    except BaselineError:
        return content
    same = {**stored, "provenance": None} == {**storage.plain(content), "provenance": None}
    return stored if same else content


def start_of(space: Sequence[Dimension]) -> dict[str, float]:
    """Return the parameters of the first trial, where they are known beforehand."""
    return {each.name: each.start for each in space if each.start is not None}
