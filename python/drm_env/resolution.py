"""From the id of an environment and options to the configuration that it will have."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec, load_env_creator

from drm_env import _engine
from drm_env._spec import OF_BATCH, RENDER_OPTIONS
from drm_env.configuration import ConfigLike, resolve_options
from drm_env.errors import ConfigError
from drm_env.resolved import ResolvedConfig

if TYPE_CHECKING:
    from typing import Unpack

    from drm_env._options import Options

__all__ = ["resolve", "spec_of"]

_ENTRY_POINTS = ("drm_env.env:DrmEnv", "drm_env.vector:DrmVectorEnv")
_NOT_OF_CONFIG = {*OF_BATCH, "render_mode", *RENDER_OPTIONS, "max_episode_steps"}


def resolve(
    env_id: str | EnvSpec = "drm_env/Slew-v0",
    *,
    config: ConfigLike = None,
    **options: Unpack[Options],
) -> ResolvedConfig:
    """The configuration of the environment that ``gym.make`` with these arguments makes.

    No environment is made. What is returned can be asked for spaces, layout and number of steps,
    and given as ``config=`` to everything that takes one, which does not check it again:

        config = drm_env.resolve("drm_env/Slew-v0", payload_mass=(50.0, 500.0))
        config.observation_space, config.horizon_steps
        env = gym.make("drm_env/Slew-v0", config=config)

    Parameters
    ----------
    env_id
        One of this package's ids, one that you have registered for its environments, a
        specification, or the name of a task, such as ``"slew"``.
    config
        What replaces defaults, as for `DrmEnv`; a configuration that is complete leaves nothing of
        the defaults.
    **options
        As for `DrmEnv`; they win over ``config``.

    Raises
    ------
    ConfigError
        Not an environment of this package, an unknown name or an impossible value.
    gymnasium.error.Error
        An id that is not registered.
    """
    if isinstance(env_id, str) and env_id in _engine.task_names():
        return resolve_options(env_id, config, options)
    kwargs = spec_of(env_id).kwargs
    given: dict[str, Any] = {
        name: value for name, value in kwargs.items() if name not in _NOT_OF_CONFIG
    }
    task = given.pop("task", _engine.task_names()[0])
    base = given.pop("config", None)
    return resolve_options(task, base if config is None else config, {**given, **options})


def spec_of(env_id: str | EnvSpec) -> EnvSpec:
    """The specification behind an id, if it is an environment of this package.

    Raises
    ------
    ConfigError
        Something else.
    """
    if isinstance(env_id, EnvSpec):
        spec = env_id
    elif isinstance(env_id, str):
        if ":" in env_id:
            module, _, env_id = env_id.partition(":")
            try:
                importlib.import_module(module)
            except ImportError as error:
                raise ConfigError(f"env_id: cannot import {module!r}: {error}") from error
        spec = gym.spec(env_id)
    else:
        raise ConfigError(f"env_id must be an id or an EnvSpec, got {env_id!r}")
    for entry in (spec.vector_entry_point, spec.entry_point):
        if isinstance(entry, str):
            # that of others is not imported
            entry = load_env_creator(entry) if entry.startswith("drm_env") else None
        if f"{getattr(entry, '__module__', '')}:{getattr(entry, '__qualname__', '')}" in (
            _ENTRY_POINTS
        ):
            return spec
    raise ConfigError(f"env_id must be one of drm_env's environments, got {spec.id!r}")
