"""Flying policies over the same episodes and recording what the engine's evaluator says.

Laws and learned policies are flown by the engine from end to end (``drm_env.rollout``), a law at
its own sampling period, a policy at the period it was trained with; any other policy through
``gymnasium.make_vec``. Episode i is in all cases the one that the environment flies after
``reset(seed=seed + i)``, so that all rows are paired. Metrics come from the engine's states, never
from a policy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.evaluation.environments import scenarios_of, task_of
from drm_baselines.evaluation.first_episodes import first_episodes
from drm_baselines.evaluation.records import Episodes
from drm_baselines.policies.compatibility import check_period
from drm_baselines.policies.law_policy import LawPolicy, Predictor
from drm_baselines.policies.perceptron import NetworkPolicy
from drm_baselines.policies.pilots import LawPilot, Pilot
from drm_baselines.support import cores
from drm_baselines.support.seeds import episode_seeds
from drm_env.constants import LAW_PERIOD

Progress = Callable[[int, int], None]
"""Called with (done, total) while episodes are flown."""

Config = drm_env.EnvConfig | drm_env.ResolvedConfig

_CHUNK = 256


def _context(scenarios: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[np.float64]]:
    """The drawn numbers that differ between the scenarios or matter in every table."""

    def flatten(node: Any, path: str, into: dict[str, float]) -> None:
        if isinstance(node, Mapping):
            for name, item in node.items():
                flatten(item, f"{path}.{name}" if path else name, into)
        elif isinstance(node, (int, float)) and not isinstance(node, bool):
            into[path] = float(node)

    rows: list[dict[str, float]] = []
    for scenario in scenarios:
        row: dict[str, float] = {}
        flatten(scenario, "", row)
        rows.append(row)
    shared = [name for name in rows[0] if all(name in row for row in rows)]
    columns = {name: np.array([row[name] for row in rows]) for name in shared}
    always = ("payload.mass", "reported_payload.mass", "mass_error", "slew.angle")
    return {
        name: values
        for name, values in columns.items()
        if name in always or np.any(values != values[0])
    }


def fly_law(
    law: Mapping[str, Any],
    config: Config,
    *,
    env_id: str,
    seed: int,
    episodes: int,
    label: str | None = None,
    progress: Progress | None = None,
) -> Episodes:
    """Fly a control law in the engine, every ``scenario.sample_period`` seconds.

    Parameters
    ----------
    law
        The law as data, see ``drm_baselines.policies.pilots.law_data``.
    config, env_id
        Where the scenarios are drawn from; its task (observation, reward) plays no part.
    seed, episodes
        Scenario i is what an environment of this configuration flies with ``seed + i``.
    label
        Name in tables; the law's by default.
    progress
        Called with (done, total).

    Warns
    -----
    PolicyWarning
        Another sample period than the one that the laws' gains belong to.

    Examples
    --------
    >>> from drm_baselines.evaluation import environment_config, fly_law
    >>> config = environment_config("drm_env/Slew-v0", {"mass_error": 0.15})
    >>> flown = fly_law({"name": "linear"}, config, env_id="drm_env/Slew-v0", seed=0, episodes=4)
    >>> flown.metrics["settled"].shape, flown.seeds
    ((4,), [0, 1, 2, 3])
    """
    seeds = episode_seeds(seed, episodes)
    resolved = drm_env.resolve(config=config)
    scenarios = scenarios_of(env_id, resolved, seed, episodes)
    if law["name"] != "none":
        check_period(label or str(law["name"]), LAW_PERIOD, resolved.sample_period)
    metrics = drm_env.rollout(
        scenarios, law=dict(law), seed=seed, num_threads=cores.given(), progress=progress
    )
    return Episodes(
        label=label or str(law["name"]),
        control_period=resolved.sample_period,
        seeds=seeds,
        # A flight without a task pays no reward, and a return of zero would look like one.
        metrics={
            name: np.asarray(values, dtype=np.float64)
            for name, values in metrics.items()
            if name != "episode_return"
        },
        context=_context(scenarios),
        details={"law": dict(law)},
    )


def fly_pilot(
    pilot: Pilot,
    config: Config,
    *,
    env_id: str,
    seed: int,
    episodes: int,
    label: str,
    progress: Progress | None = None,
) -> Episodes:
    """Fly whoever flies manoeuvres from end to end; parameters as for :func:`fly_law`."""
    if isinstance(pilot, LawPilot):
        return fly_law(
            pilot.law,
            config,
            env_id=env_id,
            seed=seed,
            episodes=episodes,
            label=label,
            progress=progress,
        )
    seeds = episode_seeds(seed, episodes)
    scenarios = scenarios_of(env_id, config, seed, episodes)
    return Episodes(
        label=label,
        control_period=pilot.control_period,
        seeds=seeds,
        metrics=pilot.fly(scenarios, seed=seed, progress=progress),
        context=_context(scenarios),
        details=pilot.details,
    )


def fly_policy(
    policy: Predictor,
    env_id: str,
    config: Config,
    *,
    seed: int,
    episodes: int,
    label: str,
    details: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Episodes:
    """Fly any policy, one episode a seed.

    A ``NetworkPolicy`` is flown by the engine; anything else through ``gymnasium.make_vec``.

    Parameters
    ----------
    policy
        Anything with Stable-Baselines3's ``predict``.
    env_id, config
        The environment; its control period is what the policy acts at.
    seed, episodes
        Episode i is that of ``reset(seed=seed + i)``.
    label
        Name in tables.
    details
        What identifies the policy, for the records.
    progress
        Called with (finished, total) episodes.

    Raises
    ------
    PolicyError
        The policy does not fit the environment.

    Warns
    -----
    PolicyWarning
        The environment asks at another period than the policy's own.

    Examples
    --------
    >>> from drm_baselines import make_policy
    >>> from drm_baselines.evaluation import environment_config, fly_policy
    >>> policy = make_policy("learned")
    >>> config = environment_config(policy.env_id, {"config": policy.config})
    >>> flown = fly_policy(policy, policy.env_id, config, seed=0, episodes=4, label="learned")
    >>> flown.metrics["tip_error_rms"].shape, flown.control_period  # s
    ((4,), 0.02)
    """
    seeds = episode_seeds(seed, episodes)
    resolved = drm_env.resolve(config=config)
    scenarios = scenarios_of(env_id, resolved, seed, episodes)
    if isinstance(policy, NetworkPolicy):
        policy.check_task(resolved.config)
    own = getattr(policy, "control_period", None)
    if own is not None and getattr(policy, "name", None) != "none":
        check_period(label, float(own), resolved.control_period)
    # a subclass may decide otherwise than its network
    if type(policy) is NetworkPolicy:
        metrics: dict[str, NDArray[np.float64]] = drm_env.rollout(
            scenarios,
            policy=policy.network.engine(),
            task=task_of(env_id),
            config=resolved,
            seed=seed,
            num_threads=cores.given(),
            progress=progress,
        )
    else:
        parts: list[dict[str, NDArray[np.float64]]] = []
        for first in range(0, episodes, _CHUNK):
            count = min(_CHUNK, episodes - first)
            parts.append(_fly_chunk(policy, env_id, resolved, seed + first, count))
            if progress is not None:
                progress(first + count, episodes)
        metrics = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return Episodes(
        label=label,
        control_period=resolved.control_period,
        seeds=seeds,
        metrics=dict(metrics),
        context=_context(scenarios),
        details=details or {},
    )


def _fly_chunk(
    policy: Predictor, env_id: str, config: drm_env.ResolvedConfig, seed: int, count: int
) -> dict[str, NDArray[np.float64]]:
    env = gym.make_vec(env_id, num_envs=count, config=config, num_threads=cores.given())
    try:
        if isinstance(policy, LawPolicy):
            policy = policy.acting_in(env)
        observations, _ = env.reset(seed=seed)
        flies = policy
        return first_episodes(
            env,
            observations,
            lambda seen, state, starts: flies.predict(
                seen, state=state, episode_start=starts, deterministic=True
            ),
        )
    finally:
        env.close()
