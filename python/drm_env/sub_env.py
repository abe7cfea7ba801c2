"""One sub-environment of a batch, seen alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drm_env._arguments import refuse_option
from drm_env._infos import REWARD_KEYS, Info, Observations
from drm_env._spec import single_spec
from drm_env.configuration import flat_options
from drm_env.errors import ConfigError

if TYPE_CHECKING:
    from typing import Unpack

    from gymnasium.envs.registration import EnvSpec

    from drm_env import _engine
    from drm_env._contexts import Contexts
    from drm_env._options import Parameters

__all__ = ["SubEnv"]

_OF_BATCH = {
    "action_space": "single_action_space",
    "observation_space": "single_observation_space",
    "config": "config",
    "config_json": "config_json",
    "control_period": "control_period",
    "metadata": "metadata",
    "observation_layout": "observation_layout",
    "render_mode": "render_mode",
    "resolved_config": "resolved_config",
}
"""Attributes of a single environment and the names that they have in a batch."""


class _Batch(Protocol):
    """What a sub-environment asks of its batch."""

    num_envs: int
    spec: EnvSpec | None
    render_mode: str | None
    _engine: _engine.Batch

    @property
    def np_random_seed(self) -> tuple[int, ...]:
        """Seeds of the streams of episodes."""

    @property
    def contexts(self) -> Contexts:
        """True contexts of the running episodes."""

    def reset(self, *, seed: Any, options: Any) -> tuple[Observations, Info]:
        """As `gymnasium.vector.VectorEnv.reset`."""

    def _after_restore(self) -> None: ...

    def frame_of(self, index: int) -> NDArray[np.uint8]:
        """The picture of one sub-environment."""


class SubEnv:
    """Sub-environment ``index`` of a batch: what can be asked of it and done to it alone.

    Attributes that are the same for the whole batch (``config``, ``observation_layout``, ...) are
    those of the batch. Others may be set freely; they belong to this sub-environment.
    """

    def __init__(self, batch: _Batch, index: int) -> None:
        """Refers to ``batch``; holds no state of its own."""
        self._batch = batch
        self._index = index

    def __getattr__(self, name: str) -> Any:
        """Attributes of the single environment that are the same in the whole batch."""
        if name not in _OF_BATCH:
            raise AttributeError(f"a sub-environment has no attribute {name!r}")
        return getattr(self._batch, _OF_BATCH[name])

    def __setattr__(self, name: str, value: Any) -> None:
        """Sets an attribute that belongs to this sub-environment.

        Raises
        ------
        ConfigError
            an option's name, or what is the same in the whole batch.
        """
        refuse_option(name)
        if name in _OF_BATCH:
            raise ConfigError(f"{name} is that of the whole batch and cannot be set")
        super().__setattr__(name, value)

    @property
    def spec(self) -> EnvSpec | None:
        """The specification of this environment alone, as ``gym.make`` takes it."""
        return single_spec(self._batch.spec)

    @property
    def np_random_seed(self) -> int:
        """The seed of this sub-environment's stream of episodes."""
        return self._batch.np_random_seed[self._index]

    def has_wrapper_attr(self, name: str) -> bool:
        """Whether there is an attribute; see ``gymnasium.Env``."""
        return hasattr(self, name)

    def get_wrapper_attr(self, name: str) -> Any:
        """The value of an attribute; see ``gymnasium.Env``."""
        return getattr(self, name)

    def set_wrapper_attr(self, name: str, value: Any, *, force: bool = True) -> bool:
        """Sets an attribute, unless there is none and ``force`` is false; see ``gymnasium.Env``.

        Raises
        ------
        ConfigError
            an option's name, or what is the same in the whole batch.
        """
        refuse_option(name)
        if not force and not hasattr(self, name):
            return False
        setattr(self, name, value)
        return True

    @property
    def unwrapped(self) -> SubEnv:
        """Itself."""
        return self

    @property
    def context(self) -> dict[str, float]:
        """The true context of the present episode, by the keys of the info."""
        return self._batch.contexts.info(self._index)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts an episode in this sub-environment alone; see `DrmEnv.reset`."""
        batch = self._batch
        mask = np.zeros(batch.num_envs, dtype=np.bool_)
        mask[self._index] = True
        seeds: list[int | None] = [None] * batch.num_envs
        seeds[self._index] = seed
        observations, _ = batch.reset(seed=seeds, options={**(options or {}), "reset_mask": mask})
        return observations[self._index].copy(), self.context | dict.fromkeys(REWARD_KEYS, 0.0)

    def set_context(self, **context: Unpack[Parameters]) -> None:
        """Fixes parameters of this sub-environment's next episodes; see `DrmEnv.set_context`."""
        self._batch._engine.set_env_context(self._index, flat_options(context))

    def get_state(self) -> bytes:
        """The exact state, as of `DrmEnv.get_state`: either takes the other's."""
        return self._batch._engine.env_state(self._index)

    def set_state(self, state: bytes) -> None:
        """Restores what ``get_state`` of a sub- or single environment returned.

        Raises
        ------
        SnapshotError
            damaged or foreign; nothing has changed.
        """
        self._batch._engine.set_env_state(self._index, state)
        self._batch._after_restore()

    def signals(self) -> dict[str, float]:
        """The present true values by name, SI; see `DrmEnv.signals`."""
        return dict(self._batch._engine.signals(self._index))

    def render(self) -> NDArray[np.uint8] | str | None:
        """The present state as a picture or text; see `DrmEnv.render`."""
        engine = self._batch._engine
        if self._batch.render_mode == "rgb_array":
            return self._batch.frame_of(self._index)
        if self._batch.render_mode == "ansi":
            return engine.render_ansi(self._index)
        return None
