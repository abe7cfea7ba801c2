"""Who competes, and how each flies a suite.

Every law flies at its own 2 ms; a learned policy in the task that it was trained in, with the
suite's manoeuvres in the place of those it draws. Everything is flown by the engine from end to
end.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.benchmark.records import Record
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.evaluation.predictors import pilot_of
from drm_baselines.policies.names import find, names_of
from drm_baselines.policies.perceptron import NetworkPolicy
from drm_baselines.policies.pilots import Pilot, pilot_named
from drm_baselines.policies.pilots import runs_in as runs_in
from drm_baselines.policies.pilots import shipped_runs as shipped_runs
from drm_baselines.policies.pilots import task_in as task_in
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.suites import Manoeuvres
from drm_baselines.support import provenance

BOUND_EPISODES = {"unmodelled": 100, "heavy": 200, "rough": 200, "flexible": 100}
"""Episodes whose bound is solved, evenly spread; all in other suites. A programme of the consistent
plant has three times as many unknowns, one of a heavy payload needs several attempts."""

LQG_EPISODES = {"flexible": 100}
"""Episodes that the LQG flies, evenly spread; all in other suites. It is asked by Python."""

RECEDING_EPISODES = {"unmodelled": 20, "heavy": 200, "rough": 200, "flexible": 20}
"""Episodes that the receding-horizon controller flies, evenly spread among those of the bound; all
in other suites. It solves several programmes a flight, and on an arm that its model does not know
one at every look."""


@dataclass(frozen=True, kw_only=True)
class Competitor:
    """One row of the benchmark: who flies under a name, once or once a training seed.

    Attributes
    ----------
    policy
        Name, one of :mod:`drm_baselines.policies.names`.
    runs
        Directories of the trained policies, by training seed, for a learning method.
    pilot
        Who flies; by default whoever has the name, and for a learning method its ``runs``.
    title
        Name in tables and pictures; by default that of the policy.
    """

    policy: str
    runs: Mapping[int, Path] = field(default_factory=dict)
    pilot: Pilot | None = None
    title: str = ""

    def __post_init__(self) -> None:
        """Take the title and the pilot that the name has, unless others are given."""
        entry = find(self.policy)
        if not self.title:
            object.__setattr__(self, "title", entry.title)
        if self.pilot is None and entry.kind != "learned":
            object.__setattr__(self, "pilot", pilot_named(self.policy))

    @property
    def kind(self) -> str:
        """See :class:`drm_baselines.benchmark.records.Record`."""
        return find(self.policy).kind

    @property
    def knows(self) -> str:
        """See :class:`drm_baselines.benchmark.records.Record`."""
        return find(self.policy).knows

    @property
    def identity(self) -> Mapping[str, Any]:
        """What decides how it flies, besides its runs: the law or the settings."""
        return {} if self.pilot is None else self.pilot.details

    def pilots(self) -> Iterator[tuple[int, Pilot]]:
        """Who flies, by training seed; 0 for what is not trained."""
        if self.pilot is not None:
            yield 0, self.pilot
        for seed, directory in self.runs.items():
            yield seed, pilot_of(self.policy, load_policy(directory))

    def episodes(self, manoeuvres: Manoeuvres) -> NDArray[np.int64]:
        """Return the episodes of a suite that are flown, evenly spread."""
        counts = {"bound": BOUND_EPISODES, "controller": RECEDING_EPISODES}.get(self.kind, {})
        if self.policy == "lqg":
            counts = LQG_EPISODES
        wanted = counts.get(manoeuvres.suite.name, len(manoeuvres))
        return np.arange(len(manoeuvres), dtype=np.int64)[:: max(1, len(manoeuvres) // wanted)]

    def record(
        self,
        manoeuvres: Manoeuvres,
        pilots: Mapping[int, Pilot],
        metrics: Mapping[str, NDArray[np.float64]],
    ) -> Record:
        """Return the record of what was flown.

        Parameters
        ----------
        manoeuvres
            The suite.
        pilots
            Who flew, from :meth:`pilots`.
        metrics
            By name, each of shape (pilots, episodes).
        """
        episodes = self.episodes(manoeuvres)
        flying = {str(seed): getattr(pilot, "policy", None) for seed, pilot in pilots.items()}
        described = {
            seed: policy.description
            for seed, policy in flying.items()
            if isinstance(policy, NetworkPolicy)
        }
        trained = {seed: about.get("training", {}) for seed, about in described.items()}
        weights = {seed: about["weights_sha256"] for seed, about in described.items()}
        return Record(
            policy=self.policy,
            title=self.title,
            kind=self.kind,
            knows=self.knows,
            control_period=[pilot.control_period for pilot in pilots.values()][-1],
            seeds=list(self.runs) or [0],
            episodes=episodes,
            strata=[manoeuvres.strata[index] for index in episodes],
            metrics=metrics,
            details={
                **self.identity,
                **({"training": trained, "weights": weights} if trained else {}),
                "suite": manoeuvres.digest,
                **provenance.provenance(),
            },
        )


LEARNERS = names_of("learned")
"""Learning methods by name; all are told the reported payload."""


def competitors(learned: Path | None = None) -> list[Competitor]:
    """Return everybody: bound, laws, tuned laws, controller, learned policies of a directory.

    ``learned`` holds a directory a method (see :data:`LEARNERS`) with one a seed in it; by default
    the policies that come with the package.
    """
    base = shipped_runs() if learned is None else learned
    everybody = []
    for name in names_of():
        runs = runs_in(base / name) if name in LEARNERS else {}
        if runs or name not in LEARNERS:
            everybody.append(Competitor(policy=name, runs=runs))
    return everybody


def chosen(everybody: Sequence[Competitor], names: Sequence[str] | None) -> list[Competitor]:
    """Return the competitors of these names, in their own order.

    Raises
    ------
    BaselineError
        A name that nobody has.
    """
    known = [competitor.policy for competitor in everybody]
    wanted = [find(name).name for name in names or ()]
    for name in wanted:
        if name not in known:
            raise BaselineError(f"{name!r} is not here; there are {', '.join(known)}")
    return [one for one in everybody if not wanted or one.policy in wanted]


def check_runs(directory: Path) -> None:
    """Refuse a directory of learned policies that holds none.

    Raises
    ------
    RunError
        No method of :data:`LEARNERS` has a finished run there.
    """
    if not any(runs_in(directory / name) for name in LEARNERS):
        raise RunError(
            f"{directory} holds no learned policies: expected "
            f"{', '.join(LEARNERS)} with directories seed_0, seed_1, ... in them"
        )
