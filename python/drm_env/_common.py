"""What the single, the vector and the Stable-Baselines3 environment have in common."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, NoReturn

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from drm_env import _engine
from drm_env.configuration import options_to_data, to_data
from drm_env.errors import ActionError, ActionTypeError, EnvironmentClosedError

CONTEXT_KEYS = tuple(f"context/{name}" for name in _engine.context_names())
REWARD_KEYS = tuple(_engine.reward_names())
METRIC_KEYS = tuple(f"metrics/{name}" for name in _engine.metric_names())

RENDER_SIZE = (800, 450)
"""Width and height of a rendered frame, px."""

METADATA: dict[str, Any] = {"render_modes": ["human", "rgb_array", "ansi"], "render_fps": 100}
"""Gymnasium's metadata of the default configuration."""

_FLOAT32 = np.dtype(np.float32)


def own_metadata(control_period: float) -> dict[str, Any]:
    """Metadata of an environment whose frames, one a step, shall play in real time."""
    return {**METADATA, "render_fps": max(1, round(1.0 / control_period))}


def action_box(size: int) -> gym.spaces.Box[np.float32]:
    """The symmetric action space of ``size`` actuators."""
    return gym.spaces.Box(-1.0, 1.0, (size,), np.float32)


def observation_box(
    low: NDArray[np.float32], high: NDArray[np.float32]
) -> gym.spaces.Box[np.float32]:
    """The observation space between two arrays of shape (n,)."""
    return gym.spaces.Box(low, high, dtype=np.float32)


def batch_box(single: gym.spaces.Box[np.float32], num_envs: int) -> gym.spaces.Box[np.float32]:
    """The space of ``num_envs`` values of a space, whose bounds are views of its bounds.

    Gymnasium copies the bounds for each sub-environment, a good part of what a resting one takes.
    """
    # a box makes a box, which its annotation does not say
    batch: gym.spaces.Box[np.float32] = batch_space(single, num_envs)  # type: ignore[assignment]
    for name in ("low", "high", "bounded_below", "bounded_above"):
        setattr(batch, name, np.broadcast_to(getattr(single, name), batch.shape))
    return batch


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


def json_spec(spec: EnvSpec | None, horizon_steps: int) -> EnvSpec | None:
    """A specification whose arguments survive JSON, with the episode's length filled in.

    JSON knows no tuples, so a range ``(low, high)`` would come back as two choices; here it is
    written as ``{"uniform": [low, high]}``.
    """
    if spec is None:
        return None
    spec = copy.copy(spec)
    if spec.max_episode_steps is None:
        spec.max_episode_steps = horizon_steps
    plain = {"task", "config", "render_mode", "num_envs", "max_episode_steps", "autoreset_mode"}
    plain |= {"copy", "num_threads"}
    others = {"vectorization_mode", "vector_kwargs", "wrappers"}
    kwargs, options = {}, {}
    for name, value in spec.kwargs.items():
        if name in plain:
            kwargs[name] = to_data(value, name)
        elif name in others:
            kwargs[name] = value
        else:
            options[name] = value
    spec.kwargs = {**kwargs, **options_to_data(options)}
    return spec


def context_info(values: NDArray[np.float64]) -> dict[str, Any]:
    """The true context of an episode as an info dictionary."""
    return dict(zip(CONTEXT_KEYS, values.tolist(), strict=True))


def end_info(
    metrics: NDArray[np.float64], diverged: bool, success: bool
) -> Mapping[str, float | bool]:
    """What the last step of an episode adds to its info."""
    info: dict[str, float | bool] = dict(zip(METRIC_KEYS, metrics.tolist(), strict=True))
    info["diverged"] = diverged
    info["is_success"] = success
    return info


class ClosedEngine:
    """Stands in for the engine after ``close``: any use of it says so.

    Owners annotate the attribute as the engine, so that its every use is type-checked; putting this
    in its place is therefore marked as a deliberate mismatch.
    """

    def __getattr__(self, name: str) -> NoReturn:
        """Refuses every use."""
        raise EnvironmentClosedError(f"the environment is closed (engine.{name} was asked for)")
