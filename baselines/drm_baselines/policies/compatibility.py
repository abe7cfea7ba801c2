"""Whether a policy and an environment, or an observation, belong together.

A policy trusts the numbers it is given: that entry 3 is the slew error's rate divided by its scale,
that an action of 1 is the wheel's torque limit, that it is asked again after its own control
period. This module is the one place that checks these, for laws and networks alike: an environment
by its configuration, its spaces and its wrappers, an observation by its bounds and by entries that
say the same thing twice.
"""

from __future__ import annotations

import math
import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import PolicyError, PolicyWarning
from drm_env.constants import FINE_SCALES

# Rounding of float32 takes less than a hundredth of this from a fine entry, which is of order one.
_TOLERANCE = 1e-4

_Array = NDArray[np.float64]

_CHANGING = (
    gym.ObservationWrapper,
    gym.ActionWrapper,
    gym.vector.VectorObservationWrapper,
    gym.vector.VectorActionWrapper,
    gym.wrappers.MaxAndSkipObservation,
)
_HARMLESS = (
    # an action within [-1, 1] goes through, an observation changes its type alone
    gym.wrappers.ClipAction,
    gym.wrappers.DtypeObservation,
    gym.wrappers.vector.ClipAction,
    gym.wrappers.vector.DtypeObservation,
)


def warn(message: str) -> None:
    """Warn with :class:`PolicyWarning` at the line outside this package that led here."""
    level, frame = 1, sys._getframe(0)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith(__package__):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, PolicyWarning, stacklevel=level)


# --- environments ---------------------------------------------------------------------------------


def configs_of(env: Any) -> list[drm_env.EnvConfig]:
    """Return the configurations of an environment's sub-environments; one where they are equal.

    Parameters
    ----------
    env
        A single, vector or Stable-Baselines3 environment, wrapped or not.

    Raises
    ------
    PolicyError
        The environment is not one of drm-env's.
    """
    inner = getattr(env, "unwrapped", env)
    found: list[Any] = [getattr(inner, "config", None)]
    if found == [None] and hasattr(inner, "get_attr"):
        try:
            found = list(inner.get_attr("config"))
        except AttributeError:
            found = []
    if not found or not all(isinstance(config, drm_env.EnvConfig) for config in found):
        raise PolicyError(f"{env!r} is not an environment of drm-env: it has no EnvConfig")
    first = found[0]
    return [first] if all(config is first or config == first for config in found) else found


def config_of(env: Any) -> drm_env.EnvConfig:
    """Return the configuration of a single, vector or Stable-Baselines3 environment.

    Raises
    ------
    PolicyError
        The environment is not one of drm-env's, or its sub-environments have different tasks.
    """
    first, *others = configs_of(env)
    if any(config.task != first.task for config in others):
        raise PolicyError(
            f"the sub-environments of {env!r} have different tasks: a policy acts in one"
        )
    return first


def _layers(env: Any, most: int | None = None) -> Iterator[Any]:
    """Every wrapper of an environment and of (``most`` of) its sub-environments, and these."""
    while env is not None:
        yield env
        for inner in list(_own(env, "envs") or ())[:most]:
            yield from _layers(inner, most)
        if isinstance(env, (gym.Wrapper, gym.vector.VectorWrapper)):
            env = env.env
        else:
            env = _own(env, "venv")


def _own(layer: Any, name: str) -> Any:
    """An attribute of a layer itself: wrappers may pass on what they do not have."""
    return getattr(layer, "__dict__", {}).get(name)


def check_environment(env: Any, config: drm_env.EnvConfig) -> None:
    """Refuse an environment that does not show and take what its configuration says.

    Wrappers that change observations or actions are refused, and so is any other whose observation
    or action space is not that of the configuration. ``ClipAction`` and ``DtypeObservation`` leave
    the values as they are. What ``AsyncVectorEnv`` and ``SubprocVecEnv`` hide in their processes
    shows in the spaces alone.

    Raises
    ------
    PolicyError
        The message names the wrapper or the space.
    """
    for layer in _layers(env):
        changes = isinstance(layer, _CHANGING) and not isinstance(layer, _HARMLESS)
        # Stable-Baselines3's VecNormalize keeps the space of what it normalises
        if changes or _own(layer, "norm_obs") is True:
            raise PolicyError(
                f"the wrapper {type(layer).__name__} changes the observations or actions of this "
                "environment, and a policy needs them as drm-env makes them: give the environment "
                "without it, or config=... if it leaves the values as they are"
            )
    layout = drm_env.observation_layout(config=config)
    low, high = ([getattr(entry, side) for entry in layout] for side in ("low", "high"))
    shown = getattr(env, "single_observation_space", None) or env.observation_space
    if (
        not isinstance(shown, gym.spaces.Box)
        or shown.shape != (len(layout),)
        or not (np.allclose(shown.low, low) and np.allclose(shown.high, high))
    ):
        raise PolicyError(
            f"the observation space of this environment is {shown}, but its configuration makes "
            f"observations of {len(layout)} entries within {min(low):g} and {max(high):g}: a "
            "wrapper has changed them"
        )
    size = len(config.task.actuators)
    taken = getattr(env, "single_action_space", None) or env.action_space
    clipped = any(isinstance(layer, _HARMLESS) for layer in _layers(env))
    if (
        not isinstance(taken, gym.spaces.Box)
        or taken.shape != (size,)
        or not (clipped or (np.all(taken.low == -1.0) and np.all(taken.high == 1.0)))
    ):
        raise PolicyError(
            f"the action space of this environment is {taken}, but its configuration takes "
            f"{size} fractions within -1 and 1: a wrapper has changed them"
        )


def decision_period(env: Any, config: drm_env.EnvConfig) -> float:
    """Return the time between two actions that are asked for, s, with ``RepeatAction`` counted."""
    repeats = [_own(layer, "num_repeats") or 1 for layer in _layers(env, most=1)]
    return float(config.task.control_period) * math.prod(repeats)


def check_period(name: str, own: float, period: float) -> None:
    """Warn that a policy is asked at another period (s) than its own, which makes it another."""
    if not math.isclose(own, period, rel_tol=1e-6):
        warn(
            f"the policy {name!r} was made to decide every {own * 1e3:g} ms and is asked every "
            f"{period * 1e3:g} ms: that makes another policy of it, often a worse one; "
            f"control_period={own:g} in the environment gives it its own"
        )


class Contexts:
    """The true parameters of the episodes that an environment is flying.

    Parameters
    ----------
    env
        A single, vector or Stable-Baselines3 environment of drm-env.
    """

    def __init__(self, env: Any) -> None:
        inner = getattr(env, "unwrapped", env)
        self._inner = inner
        batch = getattr(inner, "batch", inner)
        self._batch = batch if isinstance(batch, drm_env.DrmVectorEnv) else None
        self._rows: dict[str, int] = {}
        if self._batch is not None:
            self._rows = {key: row for row, key in enumerate(self._batch.envs[0].context)}

    def read(self, names: Sequence[str]) -> _Array | None:
        """Return parameters by their flat names, SI, shape (sub-environments, names).

        ``None`` before the first reset.
        """
        keys = [f"context/{name}" for name in names]
        if self._batch is not None:
            rows = self._batch.contexts.rows
            found = np.stack([rows[self._rows[key]] for key in keys], axis=1)
            # before the first reset everything is zero, which no torque limit ever is
            return found if found.any() else None
        if hasattr(self._inner, "get_attr"):
            contexts = list(self._inner.get_attr("context"))
        else:
            contexts = [self._inner.context]
        if not all(contexts):
            return None
        return np.array([[context[key] for key in keys] for context in contexts])


# --- observations ---------------------------------------------------------------------------------


class ObservationCheck:
    """Tells observations that no environment of a layout can have given.

    Four quantities are in an observation twice, once as they are and once as asinh(x / x0). If an
    observation has been scaled, normalised, shifted or reordered, the two contradict each other.
    It may be meant so (noise that somebody has added), so that a policy warns, once.

    Parameters
    ----------
    name
        What the policy is called in messages.
    layout
        Name, unit, scale, low and high of each entry, as of ``drm_env.observation_layout``.
    """

    def __init__(self, name: str, layout: Sequence[Sequence[Any]]) -> None:
        self._name = name
        self._warned = False
        self._names = [str(entry[0]) for entry in layout]
        self._low, self._high = (
            np.array([infinite if e[i] is None else e[i] for e in layout], dtype=np.float64)
            for i, infinite in ((3, -np.inf), (4, np.inf))
        )
        places = {name: index for index, name in enumerate(self._names)}
        pairs = []
        for name, index in places.items():
            # an older frame's entries end in @-1, @-2, ...
            parts = re.fullmatch(r"(\w+?)(@-\d+)?", name)
            if parts is None or parts[1] not in FINE_SCALES:
                continue
            fine = places.get(f"{parts[1]}_fine{parts[2] or ''}")
            if fine is not None:
                factor = float(layout[index][2]) / FINE_SCALES[parts[1]]
                pairs.append((index, fine, factor, float(layout[fine][2])))
        self._plain = np.array([pair[0] for pair in pairs], dtype=np.intp)
        self._fine = np.array([pair[1] for pair in pairs], dtype=np.intp)
        self._factor = np.array([pair[2] for pair in pairs])
        self._scale = np.array([pair[3] for pair in pairs])

    def __call__(self, observations: NDArray[Any]) -> None:
        """Check observations of shape (n, entries).

        Raises
        ------
        PolicyError
            A value that is not finite; the message names entry and value.

        Warns
        -----
        PolicyWarning
            The first time that values are beyond their bounds or contradict each other.
        """
        values = np.asarray(observations, dtype=np.float64)
        if not np.isfinite(values).all():
            row, column = (int(place[0]) for place in np.nonzero(~np.isfinite(values)))
            raise PolicyError(
                f"observation[{column}], {self._names[column]!r}, must be finite, got "
                f"{values[row, column]}"
            )
        if self._warned:
            return
        wrong = self._wrong(values)
        if wrong is not None:
            self._warned = True
            warn(
                f"the observation given to the policy {self._name!r} is none of its environment: "
                f"{wrong}. Was it scaled, normalised or reordered by a wrapper? A policy needs it "
                "as drm-env makes it"
            )

    def _wrong(self, values: _Array) -> str | None:
        """What of the observations cannot be, if anything."""
        beyond = (values < self._low) | (values > self._high)
        if beyond.any():
            row, column = (int(place[0]) for place in np.nonzero(beyond))
            return (
                f"{self._names[column]!r} is {values[row, column]:g}, not within "
                f"{self._low[column]:g} and {self._high[column]:g}"
            )
        plain, fine = values[:, self._plain], values[:, self._fine]
        # where an entry is clipped at its bound, its partner tells more than it does
        clipped = np.abs(plain) >= self._high[self._plain]
        apart = np.abs(np.arcsinh(plain * self._factor) / self._scale - fine)
        apart[clipped] = 0.0
        if not (apart > _TOLERANCE).any():
            return None
        row, pair = (int(place[0]) for place in np.nonzero(apart > _TOLERANCE))
        name = self._names[self._plain[pair]]
        return (
            f"{name!r} is {plain[row, pair]:g}, which its fine entry of {fine[row, pair]:g} "
            "contradicts"
        )


# --- tasks ----------------------------------------------------------------------------------------


def complete_config(trained: Mapping[str, Any]) -> dict[str, Any]:
    """Return a policy's configuration with the options that came after its training.

    It was complete in its time. An option that is not in it did not exist, and takes the engine's
    own default, which changes nothing; the id's default of today may be another. A configuration
    that this version cannot read stays as it is: environments made of it say why.
    """
    try:
        return drm_env.resolve(config=trained).to_dict()
    except drm_env.ConfigError:
        return dict(trained)


def check_trained_task(
    env_id: str, trained: Mapping[str, Any], layout: Sequence[Sequence[Any]], config: Any
) -> None:
    """Refuse an environment whose observations or actions mean something else than in training.

    Parameters
    ----------
    env_id, trained, layout
        Where the policy was trained: id, complete configuration, observation layout.
    config
        The configuration of the environment that it shall act in.

    Raises
    ------
    PolicyError
        Another observation layout, other actuators, inner law or ``wheel_scale``.
    """
    here = drm_env.observation_layout(config=config)
    if [list(entry) for entry in here] != [list(entry) for entry in layout]:
        raise PolicyError(
            f"the observation of this environment ({len(here)} entries) is not the one the policy "
            f"was trained on in {env_id} ({len(layout)} entries): make the environment with "
            "config=policy.config"
        )
    task = drm_env.resolve(config=trained).config.task
    for name in ("actuators", "inner_law", "wheel_scale"):
        there, found = getattr(task, name), getattr(config.task, name)
        if there != found:
            raise PolicyError(
                f"task.{name} of this environment is {found!r}, but the policy was trained in "
                f"{env_id} with {there!r}: make the environment with config=policy.config"
            )
