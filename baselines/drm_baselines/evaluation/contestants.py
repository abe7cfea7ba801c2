"""Who is compared: laws, trained policies and directories of runs by their names, in one arena."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import BaselineError, PolicyError
from drm_baselines.evaluation.environments import config_data, environment_config, scenarios_of
from drm_baselines.evaluation.episodes import Progress, fly_law, fly_policy
from drm_baselines.evaluation.records import Episodes
from drm_baselines.policies.gains import TUNED
from drm_baselines.policies.law_policy import LawPolicy, Policy, law_name
from drm_baselines.policies.names import title_of
from drm_baselines.policies.perceptron import NetworkPolicy
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.policies.registry import (
    LAWS,
    LEARNED,
    law_data,
    make_policy,
    shipped_policy,
)


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

    @property
    def config(self) -> drm_env.EnvConfig:
        """The complete configuration."""
        return environment_config(self.env_id, self.options)


@dataclass(frozen=True, kw_only=True)
class Contestant:
    """A policy with the environment it decides in.

    ``law`` is set for laws that the engine flies itself; otherwise ``policy`` acts in ``env_id``
    with ``config``, which must draw the arena's scenarios.
    """

    label: str
    law: Mapping[str, Any] | None = None
    policy: Policy | None = None
    env_id: str = ""
    config: drm_env.EnvConfig | None = None
    details: Mapping[str, Any] = field(default_factory=dict)

    def fly(self, arena: Arena, progress: Progress | None = None) -> Episodes:
        """Fly the arena's episodes."""
        if self.law is not None:
            return fly_law(
                self.law,
                arena.config,
                env_id=arena.env_id,
                seed=arena.seed,
                episodes=arena.episodes,
                label=self.label,
                progress=progress,
            )
        assert self.policy is not None, "a contestant has a law or a policy"
        assert self.config is not None, "a policy comes with a configuration"
        flown = fly_policy(
            self.policy,
            self.env_id,
            self.config,
            seed=arena.seed,
            episodes=arena.episodes,
            label=self.label,
            details=self.details,
            progress=progress,
        )
        if self.details.get("action") == "zero":
            # all that decides is the law below, at its own period
            period = float(self.config.scenario.sample_period)
            return replace(flown, control_period=period)
        return flown

    def trajectory(self, arena: Arena, index: int = 0) -> Mapping[str, NDArray[np.float64]]:
        """Return the signals of the arena's episode ``index`` over time."""
        if self.law is not None:
            scenario = scenarios_of(arena.env_id, arena.config, arena.seed + index, 1)[0]
            return drm_env.simulate(scenario, law=dict(self.law))
        assert self.policy is not None, "a contestant has a law or a policy"
        assert self.config is not None, "a policy comes with a configuration"
        return fly_trajectory(self.policy, self.env_id, self.config, arena.seed + index)


def fly_trajectory(
    policy: Policy, env_id: str, config: drm_env.EnvConfig, seed: int
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
    return Contestant(label=title_of(name), law=law_data(name, **parameters))


def contestant_of_inner_law(arena: Arena, config: drm_env.EnvConfig, env_id: str) -> Contestant:
    """Return the environment's inner law alone: zero action in the environment itself."""
    inner = config.task.inner_law
    name = "none" if inner is None else law_name(inner)
    return Contestant(
        label=f"inner law alone ({name})",
        policy=make_policy("none", config=config),
        env_id=env_id,
        config=_same_episodes(arena, env_id, config_data(config)),
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
    config = _same_episodes(arena, policy.env_id, policy.config)
    policy.check_task(config)
    return Contestant(
        label=label or f"learned ({directory.name})",
        policy=policy,
        env_id=policy.env_id,
        config=config,
        details=details_of(policy),
    )


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


def _same_episodes(arena: Arena, env_id: str, config: Mapping[str, Any]) -> drm_env.EnvConfig:
    """The arena's scenarios under another task, checked to be the same ones."""
    base = arena.config
    data = config_data(base)
    merged = environment_config(env_id, {"config": {**data, "task": config["task"]}})
    count = min(arena.episodes, 8)
    if scenarios_of(env_id, merged, arena.seed, count) != scenarios_of(
        arena.env_id, base, arena.seed, count
    ):
        raise BaselineError(
            f"{env_id} does not draw the episodes of {arena.env_id}: they cannot be compared"
        )
    return merged


def contestant_named(arena: Arena, text: str) -> Contestant:
    """Return the law, the shipped policy ``"learned"`` or the run directory that ``text`` names.

    Raises
    ------
    PolicyError
        None of these; the message lists what exists.
    """
    if text in LAWS or text in TUNED:
        return contestant_of_law(text)
    if text == LEARNED:
        return contestant_of_run(arena, shipped_policy(), label=f"{title_of('dagger')}, seed 0")
    path = Path(text)
    if path.is_dir():
        return contestant_of_run(arena, path)
    raise PolicyError(
        f"no policy {text!r}: it is neither one of {', '.join((*LAWS, *TUNED, LEARNED))} nor the "
        "directory of a training run"
    )


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
