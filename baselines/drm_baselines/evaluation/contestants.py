"""Who is compared: pilots by their names, directories of runs and policies, in one arena."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import BaselineError, PolicyError
from drm_baselines.evaluation.environments import config_data, resolved_config, scenarios_of
from drm_baselines.evaluation.episodes import Progress, fly_pilot, fly_policy
from drm_baselines.evaluation.records import Episodes
from drm_baselines.policies.compatibility import warn
from drm_baselines.policies.law_policy import LawPolicy, Policy, law_name
from drm_baselines.policies.names import find, is_name, listed, title_of
from drm_baselines.policies.pilots import (
    LawPilot,
    Pilot,
    details_of,
    law_data,
    pilot_named,
    shipped_run,
)
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.policies.registry import make_policy


@dataclass(frozen=True, kw_only=True)
class Arena:
    """The episodes that everybody flies.

    Attributes
    ----------
    env_id, options
        Where the scenarios are drawn from, with keyword options.
    seed, episodes
        Episode i is that of ``reset(seed=seed + i)``.
    """

    env_id: str
    options: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    episodes: int = 100

    @cached_property
    def resolved(self) -> drm_env.ResolvedConfig:
        """The complete configuration, checked."""
        return resolved_config(self.env_id, self.options)

    @property
    def config(self) -> drm_env.EnvConfig:
        """The complete configuration."""
        return self.resolved.config


@dataclass(frozen=True, kw_only=True)
class Contestant:
    """Who flies in an arena, under a label.

    Either a ``pilot``, which flies the arena's manoeuvres from end to end, or a ``policy`` that
    acts in ``env_id`` with ``config``, which must draw the arena's scenarios.
    """

    label: str
    pilot: Pilot | None = None
    policy: Policy | None = None
    env_id: str = ""
    config: drm_env.EnvConfig | drm_env.ResolvedConfig | None = None
    details: Mapping[str, Any] = field(default_factory=dict)

    def fly(self, arena: Arena, progress: Progress | None = None) -> Episodes:
        """Fly the arena's episodes."""
        if self.pilot is not None:
            return fly_pilot(
                self.pilot,
                arena.resolved,
                env_id=arena.env_id,
                seed=arena.seed,
                episodes=arena.episodes,
                label=self.label,
                progress=progress,
            )
        policy, config = self._acting()
        flown = fly_policy(
            policy,
            self.env_id,
            config,
            seed=arena.seed,
            episodes=arena.episodes,
            label=self.label,
            details=self.details,
            progress=progress,
        )
        if self.details.get("action") == "zero":
            # all that decides is the law below, at its own period
            return replace(flown, control_period=config.sample_period)
        return flown

    def trajectory(self, arena: Arena, index: int = 0) -> Mapping[str, NDArray[np.float64]]:
        """Return the signals of the arena's episode ``index`` over time."""
        seed = arena.seed + index
        if self.pilot is not None:
            scenario = scenarios_of(arena.env_id, arena.resolved, seed, 1)[0]
            return self.pilot.trajectory(scenario)
        policy, config = self._acting()
        return fly_trajectory(policy, self.env_id, config, seed)

    def _acting(self) -> tuple[Policy, drm_env.ResolvedConfig]:
        assert self.policy is not None, "a contestant has a pilot or a policy"
        return self.policy, drm_env.resolve(config=self.config)


def fly_trajectory(
    policy: Policy, env_id: str, config: drm_env.EnvConfig | drm_env.ResolvedConfig, seed: int
) -> dict[str, NDArray[np.float64]]:
    """Fly one episode and return the true signals at each decision, SI, by name."""
    env = gym.make(env_id, config=config)
    try:
        if isinstance(policy, LawPolicy):
            policy = policy.acting_in(env)
        observation, _ = env.reset(seed=seed)
        inner: Any = env.unwrapped
        rows = [inner.signals()]
        state, start, done = None, np.ones(1, dtype=np.bool_), False
        while not done:
            action, state = policy.predict(
                observation, state=state, episode_start=start, deterministic=True
            )
            observation, _, terminated, truncated, _ = env.step(action)
            rows.append(inner.signals())
            start, done = np.zeros(1, dtype=np.bool_), terminated or truncated
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}
    finally:
        env.close()


def contestant_of_law(name: str, **parameters: Any) -> Contestant:
    """Return a control law, with the thesis' or tuned gains, flown by the engine every 2 ms."""
    return contestant_of_pilot(LawPilot(name, law_data(name, **parameters)))


def contestant_of_pilot(pilot: Pilot) -> Contestant:
    """Return whoever has a name, under the title of that name."""
    return Contestant(label=title_of(pilot.name), pilot=pilot)


def contestant_of_inner_law(arena: Arena, config: drm_env.EnvConfig, env_id: str) -> Contestant:
    """Return the environment's inner law alone: zero action in the environment itself."""
    inner = config.task.inner_law
    name = "none" if inner is None else law_name(inner)
    return Contestant(
        label=f"inner law alone ({name})",
        policy=make_policy("none", config=config),
        env_id=env_id,
        config=_same_episodes(arena, env_id, config_data(config)["task"]),
        details={"inner_law": name, "action": "zero"},
    )


def contestant_of_run(arena: Arena, directory: Path, label: str | None = None) -> Contestant:
    """Return the exported policy of a run, in the task it was trained in, on the arena's episodes.

    Raises
    ------
    RunError
        No such run, or damaged files.
    PolicyError
        The policy does not fit that environment in this version of drm-env.
    """
    policy = load_policy(directory)
    config = _same_episodes(arena, policy.env_id, policy.config["task"])
    policy.check_task(config.config)
    return Contestant(
        label=label or f"learned ({directory.name})",
        policy=policy,
        env_id=policy.env_id,
        config=config,
        details=details_of(policy),
    )


def _same_episodes(arena: Arena, env_id: str, task: Mapping[str, Any]) -> drm_env.ResolvedConfig:
    """The arena's scenarios under another task, checked to be the same ones."""
    base = arena.resolved
    merged = resolved_config(env_id, {"config": {**base.to_dict(), "task": task}})
    count = min(arena.episodes, 8)
    if scenarios_of(env_id, merged, arena.seed, count) != scenarios_of(
        arena.env_id, base, arena.seed, count
    ):
        raise BaselineError(
            f"{env_id} does not draw the episodes of {arena.env_id}: they cannot be compared"
        )
    return merged


def contestant_named(arena: Arena, text: str) -> Contestant:
    """Return the policy of a name, or of the run directory, that ``text`` is.

    A learning method stands for the first of its policies that come with the package, in the task
    that it was trained in. A name wins over a directory of that name, with a warning: ``./ppo`` is
    the directory.

    Raises
    ------
    PolicyError
        None of these; the message lists what exists.
    """
    path = Path(text)
    if not is_name(text):
        if path.is_dir():
            return contestant_of_run(arena, path)
        raise PolicyError(
            f"no policy {text!r}: it is neither one of {listed()} nor the directory of a training "
            "run"
        )
    if path.is_dir():
        warn(f"{text!r} is a policy of the package; the directory of that name is ./{text}")
    entry = find(text)
    if entry.kind == "learned":
        run = shipped_run(entry.name)
        return contestant_of_run(arena, run, label=f"{entry.title}, {run.name.replace('_', ' ')}")
    return contestant_of_pilot(pilot_named(entry.name))


def fly_all(
    contestants: Sequence[Contestant],
    arena: Arena,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[Episodes]:
    """Fly all contestants over the arena's episodes, one after the other."""
    labels = [contestant.label for contestant in contestants]
    twice = next((label for label in labels if labels.count(label) > 1), None)
    if twice is not None:
        raise BaselineError(f"two policies are called {twice!r}: name each only once")

    def report(label: str) -> Progress | None:
        if progress is None:
            return None
        shown = progress
        return lambda done, total: shown(label, done, total)

    return [contestant.fly(arena, report(contestant.label)) for contestant in contestants]
