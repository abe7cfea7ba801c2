"""The batch as a vector environment of Stable-Baselines3 (which this module alone imports)."""

from __future__ import annotations

import operator
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from drm_env._common import METRIC_KEYS, REWARD_KEYS
from drm_env.errors import ConfigError
from drm_env.lane import Lane
from drm_env.vector import DrmVectorEnv

__all__ = ["DrmSB3VecEnv", "make_sb3_vec"]

Indices = int | Iterable[int] | None

_TIP_VIBRATION, _SLEW_ERROR, _EFFORT = REWARD_KEYS


class DrmSB3VecEnv(VecEnv):
    """A `DrmVectorEnv` with the interface and the semantics of Stable-Baselines3's ``DummyVecEnv``.

    Sub-environments that end are reset in the same step; their last observation is
    ``info["terminal_observation"]`` and ``info["TimeLimit.truncated"]`` says whether time alone
    ended them. Arrays and infos are new at every step.

    Parameters
    ----------
    num_envs : int
        Number of sub-environments.
    step_context : bool
        Whether the infos of ordinary steps carry the true context too. Without it they hold the
        reward terms alone, which saves time with many sub-environments; the infos of resets and
        of last steps always hold everything.
    **arguments
        As for `DrmVectorEnv`, the autoreset mode excepted.

    Raises
    ------
    ConfigError
        An unknown name or an impossible value.
    """

    def __init__(self, num_envs: int = 1, *, step_context: bool = True, **arguments: Any) -> None:
        for name in ("autoreset_mode", "copy"):
            if name in arguments:
                raise ConfigError(f"{name} is fixed by Stable-Baselines3's interface")
        self.batch = DrmVectorEnv(num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)
        self._step_context = bool(step_context)
        self._contexts: list[dict[str, Any]] = [{} for _ in range(num_envs)]
        self._actions: NDArray[np.float32] | None = None
        super().__init__(
            num_envs, self.batch.single_observation_space, self.batch.single_action_space
        )
        self.metadata = dict(self.batch.metadata)

    # -- Episodes ----------------------------------------------------------------------------

    def reset(self) -> NDArray[np.float32]:
        """Starts an episode everywhere, with the seeds and options set for this reset.

        Returns
        -------
        observations
            float32 of shape (num_envs, n).

        Raises
        ------
        ConfigError
            An unknown or impossible option; nothing has been reset.
        """
        observations = self.batch.reset_lanes(self._seeds, self._options)
        self._contexts = self.batch.contexts.infos()
        self.reset_infos = [context.copy() for context in self._contexts]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Takes the actions, shape (num_envs, k); `step_wait` applies them."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Holds the actions for one control period.

        Returns
        -------
        observations, rewards, dones, infos
            float32 (num_envs, n), float32 (num_envs,), bool (num_envs,), one dictionary each.

        Raises
        ------
        ActionError
            Wrong shape or not finite; `ActionTypeError` if not made of numbers.
        ResetNeededError
            Before the first ``reset``.
        """
        if self._actions is None:
            raise ConfigError("actions are missing: step_async comes before step_wait")
        actions, self._actions = self._actions, None
        buffers, _, any_done = self.batch.advance(actions)
        observations, rewards, terminated, truncated, _ = buffers
        terms = buffers.terms.tolist()
        if self._step_context:
            infos = [context.copy() for context in self._contexts]
        else:
            infos = [{} for _ in terms]
        for info, values in zip(infos, terms, strict=True):
            info[_TIP_VIBRATION], info[_SLEW_ERROR], info[_EFFORT] = values
            info["TimeLimit.truncated"] = False
        dones = terminated | truncated
        if any_done:
            self._end_episodes(dones, truncated & ~terminated, infos)
        return observations, rewards.astype(np.float32), dones, infos

    def _end_episodes(
        self,
        dones: NDArray[np.bool_],
        timeouts: NDArray[np.bool_],
        infos: list[dict[str, Any]],
    ) -> None:
        """Completes the infos of the episodes that ended and takes over the new ones' contexts."""
        last, metrics, diverged, success = self.batch.ended()
        contexts = self.batch.contexts.infos()
        for index in np.flatnonzero(dones).tolist():
            info = infos[index]
            info.update(self._contexts[index])
            info.update(zip(METRIC_KEYS, metrics[index].tolist(), strict=True))
            info["diverged"] = bool(diverged[index])
            info["is_success"] = bool(success[index])
            info["TimeLimit.truncated"] = bool(timeouts[index])
            info["terminal_observation"] = last[index].copy()
            self._contexts[index] = contexts[index]
            self.reset_infos[index] = contexts[index].copy()

    def close(self) -> None:
        """Lets go of the engine."""
        self.batch.close()

    # -- Sub-environments --------------------------------------------------------------------

    def _lanes(self, indices: Indices) -> list[Lane]:
        if indices is None:
            return self.batch.lanes
        if isinstance(indices, (int, np.integer)):
            indices = [operator.index(indices)]
        return [self.batch.lanes[index] for index in indices]

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """The values of an attribute of some sub-environments."""
        return [getattr(lane, attr_name) for lane in self._lanes(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Sets an attribute of some sub-environments."""
        for lane in self._lanes(indices):
            setattr(lane, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Calls a method of some sub-environments, such as ``set_context`` or ``get_state``."""
        results = [
            getattr(lane, method_name)(*method_args, **method_kwargs)
            for lane in self._lanes(indices)
        ]
        if method_name in ("reset", "set_state"):
            self._contexts = self.batch.contexts.infos()
        return results

    def env_is_wrapped(
        self,
        wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]],  # noqa: ARG002
        indices: Indices = None,
    ) -> list[bool]:
        """Never: the sub-environments live in the engine."""
        return [False] * len(self._lanes(indices))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One frame of each sub-environment, uint8 of shape (height, width, 3)."""
        if self.render_mode != "rgb_array":
            warnings.warn(
                f"images need render_mode='rgb_array', it is {self.render_mode!r}", stacklevel=2
            )
            return [None] * self.num_envs
        # with rgb_array a lane renders an array, never text
        return [lane.render() for lane in self.batch.lanes]  # type: ignore[misc]


def make_sb3_vec(
    env_id: str,
    n_envs: int = 1,
    seed: int | None = None,
    *,
    monitor: bool = True,
    step_context: bool = True,
    **options: Any,
) -> VecEnv:
    """A batch for Stable-Baselines3, from the id of a registered environment.

    Parameters
    ----------
    env_id : str
        ``"drm_env/Slew-v0"`` or one of the others.
    n_envs : int
        Number of sub-environments.
    seed : int, optional
        Sub-environment i gets ``seed + i`` at the first reset.
    monitor : bool
        Whether to add Stable-Baselines3's ``VecMonitor``, which records returns and lengths.
    step_context : bool
        See `DrmSB3VecEnv`.
    **options
        As for ``gym.make_vec``.

    Raises
    ------
    ConfigError
        Not an environment of this package, or an unknown or impossible option.
    """
    spec = gym.spec(env_id)
    if spec.vector_entry_point != "drm_env.vector:DrmVectorEnv":
        raise ConfigError(f"env_id must be one of drm_env's environments, got {env_id!r}")
    venv: VecEnv = DrmSB3VecEnv(n_envs, step_context=step_context, **{**spec.kwargs, **options})
    if monitor:
        venv = VecMonitor(venv)
    if seed is not None:
        venv.seed(operator.index(seed))
        venv.action_space.seed(operator.index(seed))
    return venv
