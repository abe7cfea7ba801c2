"""A configuration that has been checked, held as a value."""

from __future__ import annotations

import json
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn, final

import gymnasium as gym
import numpy as np

from drm_env import _engine
from drm_env._spaces import ObservationEntry, action_box, observation_box
from drm_env._typed import config_from_json

if TYPE_CHECKING:
    from drm_env._config import EnvConfig

__all__ = ["ResolvedConfig"]


@final
class ResolvedConfig:
    """A complete configuration of an environment, checked once and never changed.

    `drm_env.resolve` makes it. It answers what would otherwise take an environment to ask (spaces,
    layout of the observation, number of steps), and is taken wherever ``config=`` is, without being
    read or checked again. Two are equal if every value in them is; they can be keys of
    dictionaries, pickled, and shared between environments and threads.
    """

    def __init__(self, held: _engine.Config) -> None:
        """Holds what the engine has checked."""
        self.__dict__["_held"] = held

    @classmethod
    def from_json(cls, text: str) -> ResolvedConfig:
        """What `to_json` wrote.

        Raises
        ------
        ConfigError
            an unknown name or an impossible value, with its path and the value.
        """
        return cls(_engine.Config(_engine.task_names()[0], text, None))

    # -- As a value --------------------------------------------------------------------------

    def __setattr__(self, name: str, value: Any) -> NoReturn:
        """Refuses every change.

        Raises
        ------
        AttributeError
            always.
        """
        raise AttributeError(
            f"a ResolvedConfig does not change: {name} cannot be set; "
            "drm_env.resolve(config=..., **options) makes another one"
        )

    def __delattr__(self, name: str) -> NoReturn:
        """Refuses every change.

        Raises
        ------
        AttributeError
            always.
        """
        raise AttributeError(f"a ResolvedConfig does not change: {name} cannot be deleted")

    def __eq__(self, other: object) -> bool:
        """Whether every value is the same."""
        if not isinstance(other, ResolvedConfig):
            return NotImplemented
        return self is other or self._text == other._text

    def __hash__(self) -> int:
        """The same for equal configurations."""
        return hash(self._text)

    def __copy__(self) -> ResolvedConfig:
        """Itself, since it does not change."""
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> ResolvedConfig:
        """Itself, since it does not change."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles hold the JSON text, which is checked again when it is read."""
        return ResolvedConfig.from_json, (self._text,)

    def __repr__(self) -> str:
        """Steps, entries of observation and action, and what is drawn."""
        drawn = f", draws {', '.join(self.drawn)}" if self.drawn else ""
        return (
            f"ResolvedConfig({self.horizon_steps} steps of {self.control_period:g} s, "
            f"observation {len(self.observation_layout)}, action {self.action_size}{drawn})"
        )

    # -- As data -----------------------------------------------------------------------------

    @property
    def held(self) -> _engine.Config:
        """What the engine takes."""
        held: _engine.Config = self.__dict__["_held"]
        return held

    @cached_property
    def _text(self) -> str:
        return self.held.to_json()

    def to_json(self) -> str:
        """JSON text with every value, SI and radians."""
        return self._text

    def to_dict(self) -> dict[str, Any]:
        """Every value as plain data, in the form of configuration files; a new dictionary."""
        data: dict[str, Any] = json.loads(self._text)
        return data

    @cached_property
    def config(self) -> EnvConfig:
        """Every value as dataclasses, which are frozen."""
        return config_from_json(self._text)

    # -- What the environment will be --------------------------------------------------------

    @property
    def control_period(self) -> float:
        """Duration of one step, s."""
        return self.held.control_period

    @property
    def sample_period(self) -> float:
        """Period of laws, sensors and metrics, s."""
        return self.held.sample_period

    @property
    def horizon(self) -> float:
        """Duration of an episode that nothing ends early, s."""
        return self.held.horizon

    @property
    def horizon_steps(self) -> int:
        """Steps of an episode that neither a limit nor ``max_episode_steps`` ends early."""
        return self.held.horizon_steps

    @property
    def action_size(self) -> int:
        """Entries of an action."""
        return self.held.action_size

    @property
    def actuators(self) -> tuple[str, ...]:
        """What the entries of an action drive, in order."""
        return tuple(str(name) for name in self.config.task.actuators)

    @cached_property
    def observation_layout(self) -> tuple[ObservationEntry, ...]:
        """Name, unit, scale and bounds of each entry of the observation, in order."""
        return tuple(ObservationEntry(*entry) for entry in self.held.observation_layout())

    @property
    def observation_space(self) -> gym.spaces.Box[np.float32]:
        """The space of one observation, shape (n,); a new object, for spaces hold a generator."""
        return observation_box(self.observation_layout)

    @property
    def action_space(self) -> gym.spaces.Box[np.float32]:
        """The space of one action, shape (k,), from -1 to 1; a new object."""
        return action_box(self.action_size)

    @property
    def context_names(self) -> tuple[str, ...]:
        """Flat names of the true parameters, ``context/...`` in the infos, in order."""
        return tuple(_engine.context_names())

    @property
    def context(self) -> dict[str, float]:
        """The true parameters by their flat names, SI, before anything is drawn.

        What is left out stands as what follows (a payload's length from its mass), a name as its
        position among the alternatives, a limit that is not set as infinity.
        """
        return dict(zip(_engine.context_names(), self.held.context(), strict=True))

    @property
    def drawn(self) -> tuple[str, ...]:
        """Flat names of the parameters that are drawn for each episode."""
        return tuple(self.held.drawn)
