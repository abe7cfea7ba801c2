"""Who competes, and how each flies a suite.

Every law flies at its own 2 ms; a learned policy in the task that it was trained in, with the
suite's manoeuvres in the place of those it draws. Everything is flown by the engine from end to
end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.benchmark.records import Record
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.optimal_control.lower_bound import bounds_of
from drm_baselines.optimal_control.mpc import Receding, fly_all
from drm_baselines.policies.gains import TUNED, load_gains
from drm_baselines.policies.law_policy import LAW_PERIOD
from drm_baselines.policies.names import title_of
from drm_baselines.policies.perceptron import NetworkPolicy
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.suites import Manoeuvres
from drm_baselines.support import provenance

Progress = Callable[[str, int, int], None]
"""Called with (policy, done, total)."""

BOUND_EPISODES = {"unmodelled": 40, "heavy": 100, "rough": 100}
"""Episodes whose bound is solved, evenly spread; all in other suites. A programme of the consistent
plant has three times as many unknowns, one of a heavy payload needs several attempts."""

RECEDING_EPISODES = {"robust": 125, "unmodelled": 20, "heavy": 10, "rough": 20}
"""Episodes that the receding-horizon controller flies, evenly spread among those of the bound; all
in other suites. It solves several programmes a flight."""


@dataclass(frozen=True, kw_only=True)
class Competitor:
    """One row of the benchmark.

    Attributes
    ----------
    policy, kind, knows
        See :class:`drm_baselines.benchmark.records.Record`.
    law
        The law as data, for what the engine flies as a law.
    receding
        Settings of the receding-horizon controller, for what it flies.
    runs
        Directories of the trained policies, by training seed.
    title
        Name in tables and pictures; by default that of :mod:`drm_baselines.policies.names`.
    """

    policy: str
    kind: str
    knows: str = "reported"
    law: Mapping[str, Any] | None = None
    receding: Receding | None = None
    runs: Mapping[int, Path] = field(default_factory=dict)
    title: str = ""

    def __post_init__(self) -> None:
        """Take the title that the policy has everywhere, unless another is given."""
        if not self.title:
            object.__setattr__(self, "title", title_of(self.policy))

    def episodes(self, manoeuvres: Manoeuvres) -> NDArray[np.int64]:
        """Return the episodes of a suite that are flown, evenly spread."""
        counts = {"bound": BOUND_EPISODES, "controller": RECEDING_EPISODES}.get(self.kind, {})
        wanted = counts.get(manoeuvres.suite.name, len(manoeuvres))
        return np.arange(len(manoeuvres), dtype=np.int64)[:: max(1, len(manoeuvres) // wanted)]

    def fly(self, manoeuvres: Manoeuvres, progress: Progress | None = None) -> Record:
        """Fly a suite; the bound is solved and flown.

        Raises
        ------
        BaselineError, RunError
            A policy that cannot fly there, or whose files are damaged.
        """
        episodes = self.episodes(manoeuvres)
        if self.kind == "bound":
            rows, period, details = [self._bound(manoeuvres, episodes, progress)], 0.02, {}
        elif self.receding is not None:
            rows = [self._receding(manoeuvres, episodes, progress)]
            period = self.receding.hold * LAW_PERIOD
            details = {"receding": asdict(self.receding)}
        elif self.law is not None:
            rows = [self._law(manoeuvres, progress)]
            period, details = LAW_PERIOD, {"law": dict(self.law)}
        else:
            rows, period, details = self._learned(manoeuvres, progress)
        return Record(
            policy=self.policy,
            title=self.title,
            kind=self.kind,
            knows=self.knows,
            control_period=period,
            seeds=list(self.runs) or [0],
            episodes=episodes,
            strata=[manoeuvres.strata[index] for index in episodes],
            metrics={name: np.stack([row[name] for row in rows]) for name in rows[0]},
            details={**details, "suite": manoeuvres.digest, **provenance.provenance()},
        )

    def _bound(
        self, manoeuvres: Manoeuvres, episodes: NDArray[np.int64], progress: Progress | None
    ) -> dict[str, NDArray[np.float64]]:
        bounds = bounds_of(
            [manoeuvres.scenarios[index] for index in episodes],
            progress=None
            if progress is None
            else lambda done, total: progress(self.title, done, total),
        )
        found = {
            name: np.array([bound.metrics[name] for bound in bounds])
            for name in bounds[0].metrics
            if name != "episode_return"
        }
        found["bound_predicted"] = np.array([bound.predicted for bound in bounds])
        found["bound_solved"] = np.array([float(bound.solved) for bound in bounds])
        return found

    def _receding(
        self, manoeuvres: Manoeuvres, episodes: NDArray[np.int64], progress: Progress | None
    ) -> dict[str, NDArray[np.float64]]:
        return fly_all(
            [manoeuvres.scenarios[index] for index in episodes],
            seeds=[int(index) for index in episodes],
            settings=self.receding,
            progress=None
            if progress is None
            else lambda done, total: progress(self.title, done, total),
        )

    def _law(
        self, manoeuvres: Manoeuvres, progress: Progress | None
    ) -> dict[str, NDArray[np.float64]]:
        assert self.law is not None, "only called with a law"
        flown = drm_env.rollout(
            manoeuvres.scenarios,
            law=dict(self.law),
            progress=None
            if progress is None
            else lambda done, total: progress(self.title, done, total),
        )
        return {name: values for name, values in flown.items() if name != "episode_return"}

    def _learned(
        self, manoeuvres: Manoeuvres, progress: Progress | None
    ) -> tuple[list[dict[str, NDArray[np.float64]]], float, dict[str, Any]]:
        rows, trained = [], {}
        period = 0.0
        for place, (seed, directory) in enumerate(self.runs.items()):
            policy = load_policy(directory)
            period = policy.control_period
            flown = drm_env.rollout(
                manoeuvres.scenarios,
                policy=policy.network.engine(),
                config=task_in(policy, manoeuvres.scenarios),
            )
            rows.append(dict(flown))
            trained[str(seed)] = policy.description.get("training", {})
            if progress is not None:
                progress(self.title, place + 1, len(self.runs))
        return rows, period, {"training": trained}


def task_in(policy: NetworkPolicy, scenarios: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the configuration of a policy's task for the horizon of these scenarios."""
    config = dict(policy.config)
    horizon = float(scenarios[0].get("horizon", 20.0))
    config["scenario"] = {**config.get("scenario", {}), "horizon": horizon}
    return config


LEARNERS = ("dagger", "ppo", "sac", "ppo_direct", "sac_direct")
"""Learning methods by name; all are told the reported payload."""

_LAWS = (
    Competitor(policy="bound", kind="bound", knows="true"),
    Competitor(policy="none", kind="open loop", law={"name": "none"}),
    Competitor(policy="linear", kind="law", law={"name": "linear"}),
    Competitor(policy="lyapunov", kind="law", law={"name": "lyapunov"}),
)

_RECEDING = Competitor(policy="receding", kind="controller", receding=Receding())


def shipped_runs() -> Path:
    """Return the directory of the policies that come with the package."""
    return Path(str(resources.files("drm_baselines") / "learned"))


def runs_in(directory: Path) -> dict[int, Path]:
    """Return the trained policies of one method by seed: its subdirectories ``seed_<n>``."""
    found = {}
    for path in sorted(directory.glob("seed_*")):
        text = path.name.removeprefix("seed_")
        if text.isdigit() and (path / "policy.json").is_file():
            found[int(text)] = path
    return dict(sorted(found.items()))


def competitors(learned: Path | None = None) -> list[Competitor]:
    """Return everybody: bound, laws, tuned laws, controller, learned policies of a directory.

    ``learned`` holds a directory a method (see :data:`LEARNERS`) with one a seed in it; by default
    the policies that come with the package.
    """
    tuned = [
        Competitor(policy=name, kind="tuned law", law=load_gains(gains)["law"])
        for name, gains in TUNED.items()
    ]
    base = shipped_runs() if learned is None else learned
    methods = [
        Competitor(policy=name, kind="learned", runs=runs)
        for name in LEARNERS
        if (runs := runs_in(base / name))
    ]
    return [*_LAWS, *tuned, _RECEDING, *methods]


def chosen(everybody: Sequence[Competitor], names: Sequence[str] | None) -> list[Competitor]:
    """Return the competitors of these names, in their own order.

    Raises
    ------
    BaselineError
        A name that nobody has.
    """
    known = [competitor.policy for competitor in everybody]
    for name in names or ():
        if name not in known:
            there = ", ".join(known)
            message = f"no policy {name!r} in the benchmark; there are {there}"
            raise BaselineError(message)
    return [one for one in everybody if not names or one.policy in names]


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
