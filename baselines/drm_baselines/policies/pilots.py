"""Who flies: the one representation of laws, networks and controllers that fly whole manoeuvres.

    pilot = pilot_named("lqr")
    metrics = pilot.fly(scenarios)

The commands, comparisons and the benchmark all fly pilots, and get them here by the names of
:mod:`drm_baselines.policies.names`. As Gymnasium's registry does, an entry names where it is made,
which is imported when it is asked for: what plans ahead lives in a room above this one.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import BaselineError, PolicyError
from drm_baselines.policies.gains import TUNED, load_gains
from drm_baselines.policies.names import find, names_of
from drm_baselines.policies.perceptron import NetworkPolicy
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.support import cores
from drm_env.constants import LAW_PERIOD, SIGNAL_NAMES

Metrics = dict[str, NDArray[np.float64]]
Progress = Callable[[int, int], None]
"""Called with (done, total)."""


class Pilot(Protocol):
    """Flies manoeuvres from end to end.

    Attributes
    ----------
    name
        In commands and files; that of a run is its directory's.
    control_period
        Time between two decisions, s.
    details
        What identifies it in records.
    """

    @property
    def name(self) -> str:
        """See the class."""

    @property
    def control_period(self) -> float:
        """See the class."""

    @property
    def details(self) -> Mapping[str, Any]:
        """See the class."""

    def fly(
        self,
        scenarios: Sequence[Mapping[str, Any]],
        *,
        seed: int | Sequence[int] = 0,
        progress: Progress | None = None,
    ) -> Metrics:
        """Fly scenarios; return metrics by name, each of shape (len(scenarios),).

        ``seed + i``, or entry i of a sequence, is that of scenario i's sensor noise.
        """

    def trajectory(
        self, scenario: Mapping[str, Any], *, seed: int = 0, decimation: int = 1
    ) -> drm_env.Trajectory:
        """Fly one scenario; return its signals and metrics.

        ``decimation`` keeps every so many samples; what decides less often keeps its decisions.
        """


class LawPilot:
    """A control law of the engine, at the sample period of what it flies.

    Parameters
    ----------
    name
        In commands and files.
    law
        The law as data: ``{"name": "linear", ...}``.
    """

    control_period = LAW_PERIOD

    def __init__(self, name: str, law: Mapping[str, Any]) -> None:
        self.name = name
        self.law = dict(law)

    @property
    def details(self) -> Mapping[str, Any]:
        """The law."""
        return {"law": dict(self.law)}

    def fly(
        self,
        scenarios: Sequence[Mapping[str, Any]],
        *,
        seed: int | Sequence[int] = 0,
        progress: Progress | None = None,
    ) -> Metrics:
        """See :class:`Pilot`; there is no return, for nothing is paid without a task."""
        flown = drm_env.rollout(
            scenarios,
            law=dict(self.law),
            seed=seed,
            num_threads=cores.given(),
            progress=progress,
        )
        return {name: values for name, values in flown.items() if name != "episode_return"}

    def trajectory(
        self, scenario: Mapping[str, Any], *, seed: int = 0, decimation: int = 1
    ) -> drm_env.Trajectory:
        """See :class:`Pilot`."""
        return drm_env.simulate(scenario, law=dict(self.law), decimation=decimation, seed=seed)


class NetworkPilot:
    """A trained policy in the task it was trained in, with given manoeuvres in it.

    Parameters
    ----------
    name
        In commands and files.
    policy
        The policy.
    """

    def __init__(self, name: str, policy: NetworkPolicy) -> None:
        self.name = name
        self.policy = policy

    @property
    def control_period(self) -> float:
        """Time between two decisions, s."""
        return self.policy.control_period

    @property
    def details(self) -> Mapping[str, Any]:
        """Where and how it was trained."""
        return details_of(self.policy)

    def fly(
        self,
        scenarios: Sequence[Mapping[str, Any]],
        *,
        seed: int | Sequence[int] = 0,
        progress: Progress | None = None,
    ) -> Metrics:
        """See :class:`Pilot`; missions are flown one and the same."""
        scenarios = [_of_an_episode(scenario) for scenario in scenarios]
        flown = drm_env.rollout(
            scenarios,
            policy=self.policy.network.engine(),
            config=task_in(self.policy, scenarios),
            seed=seed,
            num_threads=cores.given(),
            progress=progress,
        )
        return dict(flown)

    def trajectory(
        self, scenario: Mapping[str, Any], *, seed: int = 0, decimation: int = 1
    ) -> drm_env.Trajectory:
        """See :class:`Pilot`."""
        scenario = _of_an_episode(scenario)
        flown = drm_env.rollout(
            [scenario],
            policy=self.policy.network.engine(),
            config=task_in(self.policy, [scenario]),
            seed=seed,
            signals=SIGNAL_NAMES,
            decimation=decimation,
        )
        return flown.trajectory(0)


def _of_an_episode(scenario: Mapping[str, Any]) -> Mapping[str, Any]:
    """What flies; a mission that states no horizon gets that of ``drm_env/Mission-v0``."""
    if "mission" not in scenario or "horizon" in scenario.get("scenario", {}):
        return scenario
    horizon = drm_env.resolve("mission").config.scenario.horizon
    return {**scenario, "scenario": {**scenario.get("scenario", {}), "horizon": horizon}}


def task_in(
    policy: NetworkPolicy, scenarios: Sequence[Mapping[str, Any]]
) -> drm_env.ResolvedConfig:
    """Return the configuration of a policy's task for the horizon, or the mission, of these."""
    config = dict(policy.config)
    scenario = scenarios[0]
    if "mission" in scenario:
        config["mission"] = scenario["mission"]
        scenario = scenario.get("scenario", {})
    horizon = float(scenario.get("horizon", drm_env.Scenario().horizon))
    config["scenario"] = {**config.get("scenario", {}), "horizon": horizon}
    return drm_env.resolve(config=config)


def details_of(policy: NetworkPolicy) -> dict[str, Any]:
    """Return what identifies a learned policy in records."""
    training = policy.description.get("training", {})
    return {
        "env_id": policy.env_id,
        "weights_sha256": policy.description["weights_sha256"],
        "training": {
            name: training.get(name) for name in ("algorithm", "seed", "steps", "wall_time")
        },
    }


# --- by name --------------------------------------------------------------------------------------


def law_data(name: str, **parameters: Any) -> dict[str, Any]:
    """Return a law as data for the engine, after checking that the name exists.

    Raises
    ------
    PolicyError
        No law of this name, the message lists what exists; or parameters for tuned gains.
    """
    if name in TUNED:
        if parameters:
            raise PolicyError(
                f"the gains of {name!r} are those of drm tune: {sorted(parameters)[0]!r} cannot be "
                "given"
            )
        return dict(load_gains(TUNED[name])["law"])
    found = find(name)
    if found.kind not in ("open loop", "law"):
        known = ", ".join(names_of("open loop", "law", "tuned law"))
        what = {
            "learned": "a network",
            "controller": "a controller that plans or observes",
            "shaped law": "a law and a manoeuvre",
        }.get(found.kind, "what no policy can be better than")
        raise PolicyError(f"{name!r} is {what} and no law; laws are {known}")
    return {"name": name, **parameters}


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


def shipped_run(name: str) -> Path:
    """Return the directory of the first policy of a learning method that comes with the package.

    Raises
    ------
    PolicyError
        No such method, or none of its policies is in this package.
    """
    entry = find(name)
    runs = runs_in(shipped_runs() / entry.name)
    if not runs:
        raise PolicyError(f"no policy of {entry.name!r} comes with this package")
    return next(iter(runs.values()))


SINGLE_ONLY = "is made for single manoeuvres and flies no missions; laws and learned policies do"
"""What is said of who plans a whole manoeuvre ahead, where a mission is to be flown."""


def refuse_missions(name: str, scenarios: Iterable[Mapping[str, Any]]) -> None:
    """Refuse missions to who is made for single manoeuvres.

    Raises
    ------
    PolicyError
        One of them is a mission.
    """
    if any("mission" in scenario for scenario in scenarios):
        raise PolicyError(f"{name!r} {SINGLE_ONLY}")


def law_pilot(name: str) -> LawPilot:
    """Return a law with the thesis' gains, or those of ``drm tune``."""
    return LawPilot(name, law_data(name))


class ShapedPilot:
    """A law that flies every manoeuvre with its slew shaped: it ends later by the shaper's length.

    Not a kind of :class:`LawPilot`: whoever flies its law alone flies another manoeuvre.

    Parameters
    ----------
    name
        In commands and files.
    law
        The law as data.
    kind
        ``"zv"`` or ``"zvd"``.
    """

    control_period = LAW_PERIOD

    def __init__(self, name: str, law: Mapping[str, Any], kind: str) -> None:
        self.name = name
        self.kind = kind
        self._pilot = LawPilot(name, law)

    @property
    def details(self) -> Mapping[str, Any]:
        """Law and shaper."""
        return {**self._pilot.details, "slew_shaper": self.kind}

    def _shaped(self, scenario: Mapping[str, Any]) -> dict[str, Any]:
        if "mission" in scenario:
            return {**scenario, "scenario": self._shaped(scenario.get("scenario", {}))}
        slew = dict(scenario.get("slew", {}))
        return {
            **scenario,
            "slew": {**slew, "shaper": {**slew.get("shaper", {}), "kind": self.kind}},
        }

    def fly(
        self,
        scenarios: Sequence[Mapping[str, Any]],
        *,
        seed: int | Sequence[int] = 0,
        progress: Progress | None = None,
    ) -> Metrics:
        """See :class:`Pilot`."""
        shaped = [self._shaped(each) for each in scenarios]
        return self._pilot.fly(shaped, seed=seed, progress=progress)

    def trajectory(
        self, scenario: Mapping[str, Any], *, seed: int = 0, decimation: int = 1
    ) -> drm_env.Trajectory:
        """See :class:`Pilot`."""
        return self._pilot.trajectory(self._shaped(scenario), seed=seed, decimation=decimation)


LEAN_SHARE = 0.95
"""Part of the wheels' torque that the plan counts on; the rest is for feedback."""

VARIANTS: Mapping[str, Mapping[str, Any]] = {"servo_lean": {"name": "servo", "lean": LEAN_SHARE}}
"""Laws of shaped manoeuvres that are another law with a parameter."""


def shaped_pilot(name: str) -> ShapedPilot:
    """Return a law with the shaper that its name says: ``servo_zv``."""
    law, _, kind = find(name).name.rpartition("_")
    return ShapedPilot(name, VARIANTS[law] if law in VARIANTS else law_data(law), kind)


def network_pilot(name: str) -> NetworkPilot:
    """Return the first of a learning method's policies that come with the package."""
    return NetworkPilot(name, load_policy(shipped_run(name)))


ENTRY_POINTS = {
    "bound": "drm_baselines.optimal_control.lower_bound:BoundPilot",
    "open loop": f"{__name__}:law_pilot",
    "law": f"{__name__}:law_pilot",
    "tuned law": f"{__name__}:law_pilot",
    "shaped law": f"{__name__}:shaped_pilot",
    "controller": "drm_baselines.optimal_control.controllers:pilot",
    "learned": f"{__name__}:network_pilot",
}
"""Where the pilots of a kind are made, from their names."""


def pilot_named(name: str) -> Pilot:
    """Return who flies under a name; of a learning method its first policy in the package.

    Raises
    ------
    PolicyError
        Nobody has that name; the message lists who there is.
    BaselineError
        What it needs is not installed.
    """
    entry = find(name)
    module, _, maker = ENTRY_POINTS[entry.kind].partition(":")
    try:
        make: Callable[[str], Pilot] = getattr(importlib.import_module(module), maker)
    except ImportError as error:
        raise BaselineError(f"the policy {name!r} cannot be used: {error}") from error
    return make(entry.name)
