"""A configuration that has been checked, held as a value."""

from __future__ import annotations

import json
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn, final

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env import _engine, _html
from drm_env._spaces import ObservationEntry, action_box, observation_box
from drm_env._typed import config_from_json
from drm_env.errors import ConfigError

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

    def _repr_html_(self) -> str:
        """What Jupyter shows: what the environment will be, and every value."""
        return _html.environment("ResolvedConfig", self)

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

    def identification_slopes(
        self,
        identified_mass_error: ArrayLike,
        slew_rate: ArrayLike,
        extension: ArrayLike,
        payload: ArrayLike,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """How the entry ``identified_mass_error`` of an observation depends on what is measured.

        Parameters
        ----------
        identified_mass_error
            the entry in its unit, shape (n,).
        slew_rate
            as measured, rad/s, shape (n,).
        extension
            of link 2, m, shape (n,).
        payload
            what the observation tells of it: mass (kg), length and width (m), shape (n, 3).

        Returns
        -------
        by_rate, by_momentum
            the derivatives by the slew rate, s/rad, and by the stored momentum of either wheel,
            1/(N m s), each of shape (n,); 0 where nothing is identified or the error is limited.

        Raises
        ------
        ConfigError
            arrays of other or of different shapes.
        """
        columns = [
            np.asarray(values, dtype=np.float64)
            for values in (identified_mass_error, slew_rate, extension)
        ]
        told = np.asarray(payload, dtype=np.float64)
        shapes = [column.shape for column in columns]
        if len(set(shapes)) != 1 or len(shapes[0]) != 1 or told.shape != (*shapes[0], 3):
            raise ConfigError(
                "identified_mass_error, slew_rate and extension must have one shape (n,) and "
                f"payload (n, 3), got {', '.join(map(str, (*shapes, told.shape)))}"
            )
        slopes = self.held.identification_slopes(np.column_stack([*columns, told]))
        return slopes[:, 0], slopes[:, 1]

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
