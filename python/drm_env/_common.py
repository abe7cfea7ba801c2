"""What the single, the vector and the Stable-Baselines3 environment have in common."""

from __future__ import annotations

import copy
import dataclasses
import sys
from collections.abc import Mapping
from typing import Any, NoReturn

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from drm_env import _engine
from drm_env.configuration import known_options, options_to_data, randomizable, to_data
from drm_env.errors import ActionError, ActionTypeError, ConfigError, EnvironmentClosedError

CONTEXT_KEYS = tuple(f"context/{name}" for name in _engine.context_names())
REWARD_KEYS = tuple(_engine.reward_names())
METRIC_KEYS = tuple(f"metrics/{name}" for name in _engine.metric_names())
FLAG_KEYS = ("diverged", "is_success")
EPISODE_KEYS = (*METRIC_KEYS, *FLAG_KEYS)
"""What an info says of the episode as a whole."""
REPORT_KEYS = (*REWARD_KEYS, *EPISODE_KEYS)
"""What an info says that changes with every step."""


NO_VALUE = sys.float_info.max
"""What stands in an info for a number that does not exist, the largest there is.

For a limit that is not set, the settling time of an arm that has not settled, the residual
vibration before the slew has ended. Infinite and NaN, which the engine has there, are no JSON.
"""

RENDER_SIZE = (800, 450)
"""Width and height of a rendered frame, px."""

METADATA: dict[str, Any] = {"render_modes": ["human", "rgb_array", "ansi"], "render_fps": 100}
"""Gymnasium's metadata of the default configuration."""

_FLOAT32 = np.dtype(np.float32)


def own_metadata(control_period: float) -> dict[str, Any]:
    """Metadata of an environment whose frames, one a step, shall play in real time."""
    return {**METADATA, "render_fps": max(1, round(1.0 / control_period))}


def convert_action(action: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """An action as a contiguous float32 array within [-1, 1].

    Raises
    ------
    ActionTypeError
        not made of real numbers.
    ActionError
        wrong shape, NaN or infinite.
    """
    try:
        array = np.asarray(action)
    except (TypeError, ValueError) as error:
        raise ActionTypeError(f"action must be an array of numbers: {error}") from None
    if array.dtype.kind not in "fiu":
        raise ActionTypeError(
            f"action must be an array of real numbers, got dtype {array.dtype} ({action!r})"
        )
    if array.shape != shape:
        raise ActionError(f"action must have shape {shape}, got {array.shape}")
    if array.dtype != _FLOAT32:
        finite = np.isfinite(array)
        if not finite.all():
            index = np.unravel_index(int(np.argmin(finite)), shape)
            place = ", ".join(str(int(i)) for i in index)
            raise ActionError(f"action[{place}] must be finite, got {array[index]}")
        # Clipped before the conversion, in which a large double would become infinite.
        array = np.clip(array, -1.0, 1.0).astype(np.float32)
    return np.ascontiguousarray(array)


def seed_bytes(seed: int) -> bytes:
    """A non-negative seed of any size as bytes, least significant first; without loss."""
    return seed.to_bytes(max(1, (seed.bit_length() + 7) // 8), "little")


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


_PLAIN = {"task", "config", "render_mode", "num_envs", "autoreset_mode", "copy", "num_threads"}
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


def refuse_option(name: str) -> None:
    """Refuses to set an attribute that has the name of an option: it would change nothing.

    Raises
    ------
    ConfigError
        an option's name.
    """
    if name not in known_options():
        return
    way = (
        f"use set_context({name}=...)"
        if name in randomizable()
        else f"make a new environment with {name}=..."
    )
    raise ConfigError(f"{name} is an option, not an attribute that can be set; {way}")


class OptionsAreNoAttributes:
    """Refuses attributes with the names of options, which would be kept and change nothing."""

    def __setattr__(self, name: str, value: Any) -> None:
        """Sets an attribute.

        Raises
        ------
        ConfigError
            an option's name.
        """
        refuse_option(name)
        super().__setattr__(name, value)


def finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """A copy with `NO_VALUE` where there is NaN or infinity."""
    # of a number and NaN, fmin takes the number
    return np.fmin(values, NO_VALUE)


def context_info(values: NDArray[np.float64]) -> dict[str, Any]:
    """The true context of an episode as an info dictionary."""
    return dict(zip(CONTEXT_KEYS, finite(values), strict=True))


def info_metrics(info: Mapping[str, Any]) -> dict[str, Any]:
    """The metrics in an info by name, NaN where there is none.

    Parameters
    ----------
    info
        of a single environment, a batch or one of Stable-Baselines3's dictionaries.

    Returns
    -------
    metrics
        A float each, or an array of shape (num_envs,) from the info of a batch, with NaN where no
        episode has ended.

    Examples
    --------
    >>> import drm_env
    >>> env = drm_env.DrmEnv(horizon=0.5, slew_angle=0.001)
    >>> observation, info = env.reset(seed=0)
    >>> truncated = False
    >>> while not truncated:
    ...     _, _, _, truncated, info = env.step([0.0, 0.0])
    >>> round(drm_env.info_metrics(info)["duration"], 3)  # s
    0.5
    """
    metrics: dict[str, Any] = {}
    for key in METRIC_KEYS:
        if key not in info:
            continue
        values = np.asarray(info[key], dtype=np.float64)
        exists = values < NO_VALUE
        if f"_{key}" in info:
            exists &= info[f"_{key}"]
        found = np.where(exists, values, np.nan)
        metrics[key.removeprefix("metrics/")] = found if found.ndim else float(found)
    return metrics


class ClosedEngine:
    """Stands in for the engine after ``close``: any use of it says so.

    Owners annotate the attribute as the engine, so that its every use is type-checked; putting this
    in its place is therefore marked as a deliberate mismatch.
    """

    def __getattr__(self, name: str) -> NoReturn:
        """Refuses every use."""
        raise EnvironmentClosedError(f"the environment is closed (engine.{name} was asked for)")
