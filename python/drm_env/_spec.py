"""Gymnasium's specifications and metadata of environments: what `spec` and `metadata` say."""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from drm_env.configuration import options_to_data, to_data

RENDER_OPTIONS = (
    "render_width",
    "render_height",
    "render_magnification",
    "render_title",
    "render_colour",
)
"""Arguments of environments that say how pictures look."""
METADATA: dict[str, Any] = {"render_modes": ["human", "rgb_array", "ansi"], "render_fps": 100}
"""Gymnasium's metadata of the default configuration."""


def own_metadata(control_period: float) -> dict[str, Any]:
    """Metadata of an environment whose frames, one a step, shall play in real time."""
    return {**METADATA, "render_fps": max(1, round(1.0 / control_period))}


class HorizonSpec(EnvSpec):
    """A specification that never promises more steps than the environment's horizon has.

    ``gymnasium.wrappers.TimeLimit`` writes its limit into a copy of the environment's
    specification. Episodes end at the horizon all the same, so a longer limit is cut to it, with a
    warning.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        """Sets a field; a step limit is at most the steps in the horizon."""
        horizon = self.__dict__.get("_horizon_steps")
        if name == "max_episode_steps" and horizon is not None:
            value = step_limit(value, horizon)
        super().__setattr__(name, value)

    def __eq__(self, other: object) -> bool:
        """Whether all fields are those of another specification, also of Gymnasium's class."""
        if not isinstance(other, EnvSpec):
            return NotImplemented
        names = [field.name for field in dataclasses.fields(EnvSpec)]
        return all(getattr(self, name) == getattr(other, name) for name in names)

    # compared by value and changeable, so not hashable; typeshed has a method there
    __hash__ = None  # type: ignore[assignment]


def step_limit(limit: int | None, horizon_steps: int) -> int:
    """The steps of an episode that a limit cuts: no more than its horizon has, with a warning."""
    if limit is None or limit == -1:
        return horizon_steps
    if limit > horizon_steps:
        gym.logger.warn(
            f"max_episode_steps={limit} is longer than the horizon of {horizon_steps} steps, at "
            "which episodes end; give a longer horizon"
        )
    return min(limit, horizon_steps)


_PLAIN = {
    "task",
    "config",
    "render_mode",
    *RENDER_OPTIONS,
    "num_envs",
    "autoreset_mode",
    "copy",
    "num_threads",
}
_OF_MAKE_VEC = {"vectorization_mode", "vector_kwargs", "wrappers"}
OF_BATCH = {"num_envs", "autoreset_mode", "copy", "num_threads", *_OF_MAKE_VEC}
"""Arguments of a batch that a single environment does not have."""


def json_spec(spec: EnvSpec | None, horizon_steps: int) -> EnvSpec | None:
    """A specification whose arguments survive JSON, with the episode's length filled in.

    JSON knows no tuples, so a range ``(low, high)`` would come back as two choices; here it is
    written as ``{"uniform": [low, high]}``. The step limit stands in its field alone.
    """
    if spec is None:
        return None
    kwargs, options = {}, {}
    limit = spec.max_episode_steps
    for name, value in spec.kwargs.items():
        if name == "max_episode_steps":
            limit = value
        elif name in _PLAIN:
            kwargs[name] = to_data(value, name)
        elif name in _OF_MAKE_VEC:
            kwargs[name] = value
        else:
            options[name] = value
    fields = {
        field.name: getattr(spec, field.name) for field in dataclasses.fields(EnvSpec) if field.init
    }
    fields["kwargs"] = {**kwargs, **options_to_data(options)}
    cut = limit is not None and 0 < limit < horizon_steps
    fields["max_episode_steps"] = limit if cut else horizon_steps
    own = HorizonSpec(**fields)
    own.__dict__["_horizon_steps"] = horizon_steps
    return own


def single_spec(spec: EnvSpec | None) -> EnvSpec | None:
    """The specification of one environment of the batch that a specification makes."""
    if spec is None:
        return None
    spec = copy.copy(spec)
    spec.kwargs = {name: value for name, value in spec.kwargs.items() if name not in OF_BATCH}
    return spec
