"""Environments by their ids: configurations, and the scenarios that they draw."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import gymnasium as gym

import drm_env
from drm_baselines.errors import BaselineError


def resolved_config(env_id: str, options: Mapping[str, Any]) -> drm_env.ResolvedConfig:
    """Return the checked configuration of an environment id with keyword options.

    Raises
    ------
    BaselineError
        No such id among drm-env's.
    drm_env.ConfigError
        An unknown or impossible option.
    """
    known = known_ids()
    if env_id not in known:
        raise BaselineError(f"no environment {env_id!r}; there are {', '.join(known)}")
    return drm_env.resolve(env_id, **options)


def environment_config(env_id: str, options: Mapping[str, Any]) -> drm_env.EnvConfig:
    """Return the complete configuration of an environment id with keyword options.

    Raises
    ------
    BaselineError
        No such id among drm-env's.
    drm_env.ConfigError
        An unknown or impossible option.

    Examples
    --------
    >>> from drm_baselines.evaluation import environment_config
    >>> config = environment_config("drm_env/Slew-v0", {"payload_mass": 320.0})
    >>> config.scenario.payload.mass
    320.0
    """
    return resolved_config(env_id, options).config


def config_data(config: drm_env.EnvConfig | drm_env.ResolvedConfig) -> dict[str, Any]:
    """Return a configuration as plain data, in the form that configuration files have."""
    return drm_env.resolve(config=config).to_dict()


def known_ids() -> list[str]:
    """Return the ids that drm-env has registered."""
    return sorted(name for name in gym.registry if name.startswith("drm_env/"))


def scenarios_of(
    env_id: str, config: drm_env.EnvConfig | drm_env.ResolvedConfig, seed: int, episodes: int
) -> list[dict[str, Any]]:
    """Return the scenarios that the environment flies with ``seed .. seed + episodes - 1``."""
    return drm_env.sample_scenarios(task_of(env_id), config=config, seed=seed, n=episodes)


def complete_scenario(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scenario with everything that it leaves out as the standard manoeuvre has it."""

    def filled(part: Mapping[str, Any], whole: Mapping[str, Any]) -> dict[str, Any]:
        found = dict(whole)
        for name, value in part.items():
            inner = whole.get(name)
            if isinstance(value, Mapping) and isinstance(inner, Mapping):
                value = filled(value, inner)
            found[name] = value
        return found

    return filled(scenario, dataclasses.asdict(drm_env.Scenario()))


def task_of(env_id: str) -> str:
    """Return the name of the defaults that an environment id stands for."""
    return str(gym.spec(env_id).kwargs["task"])
