"""Control laws behind the ``predict`` call of Stable-Baselines3.

A law flown through a policy is the engine's own law (``drm_env.ControlLaw``), fed with what an
agent sees, so that the two are compared on the same footing and there is one implementation of
each law. The thesis' gains belong to a sampling period of 2 ms: a policy states the period it
was made for in ``control_period``, and whoever asks it at another is warned. What a policy is given
is checked in :mod:`drm_baselines.policies.compatibility`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import drm_env
from drm_baselines.errors import PolicyError
from drm_baselines.policies.compatibility import (
    Contexts,
    ObservationCheck,
    check_environment,
    config_of,
)
from drm_env.constants import LAW_PERIOD as LAW_PERIOD
from drm_env.constants import PAYLOAD_INERTIAS

State = tuple[NDArray[np.float64], ...]


class Policy(Protocol):
    """What flies: the ``predict`` call that Stable-Baselines3 models have."""

    control_period: float

    def predict(
        self,
        observation: ArrayLike,
        state: State | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], State | None]:
        """Return actions in [-1, 1] and the policy's state."""


class Predictor(Protocol):
    """What flies and says nothing else of itself: models of Stable-Baselines3, anybody's class."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        """Return actions in [-1, 1] and the policy's state."""


_LIMITS = ("root_torque_limit", "tip_torque_limit")

_ARM = ("link1_length", "link2_mass_per_length", "payload_inertia")
"""What the Lyapunov law knows of the arm, by the flat names of the scenario's parameters."""

_MODELLED_ARM = (*_ARM, "link1_mass_per_length", "link2_length")
"""What the servo knows of it; the stiffness that it believes is one of its own parameters."""

_MOST_ARMS = 256


class LawPolicy:
    """A control law of the engine, acting on observations.

    ``control_period`` is the sampling period that the law was made for, in s.

    Parameters
    ----------
    law
        The law with its parameters, as data: ``{"name": "linear", ...}``.
    config
        The environment it acts in: layout, inner law and meaning of an action are read from it.
    env
        The environment itself, single, vector or Stable-Baselines3. Torque limits and arm are
        then those of the episodes that it is flying, whatever is drawn, or fixed at a reset; the
        policy must not be flown in another one (see :meth:`acting_in`).

    Raises
    ------
    PolicyError
        The law cannot act there: hidden payload, missing measurement, a second law underneath, a
        wrapper that changes observations or actions; or without ``env``, a torque limit or an arm
        that is drawn for each episode.

    Examples
    --------
    >>> import gymnasium as gym
    >>> from drm_baselines import make_policy
    >>> env = gym.make("drm_env/Slew-v0", control_period=0.002)
    >>> policy = make_policy("lyapunov", env=env)
    >>> observation, info = env.reset(seed=0)
    >>> action, state = policy.predict(observation)
    >>> action.shape, policy.control_period
    ((2,), 0.002)
    """

    def __init__(self, law: Mapping[str, Any], config: drm_env.EnvConfig, env: Any = None) -> None:
        self.control_period = LAW_PERIOD
        self.law = dict(law)
        self.name = str(law["name"])
        self.config = config
        task = config.task
        layout = drm_env.observation_layout(config=config)
        self._size = len(layout)
        self._check = ObservationCheck(self.name, layout)
        self._actuators = [str(getattr(name, "value", name)) for name in task.actuators]
        self._law = drm_env.ControlLaw(self.law, config=config)
        self._arms: dict[tuple[float, ...], drm_env.ControlLaw] = {}
        self._contexts = None
        if self._law.needs_tip_rate and not any(entry.name == "tip_turn_rate" for entry in layout):
            raise PolicyError(
                f"the law {self.name!r} needs the gyro at the tip wheel, which the observation "
                "does not hold; observe_sensors = ['tip_gyro'] shows it, and simulate, rollout and "
                "inner_law do not need it"
            )
        self._arm = {"lyapunov": _ARM, "servo": _MODELLED_ARM}.get(self.name, ())
        self._needs = _LIMITS + self._arm
        if env is not None:
            check_environment(env, config)
        if self.name == "none":
            return
        if task.inner_law is not None and law_name(task.inner_law) != "none":
            raise PolicyError(
                f"the environment already adds the law {law_name(task.inner_law)!r} below the "
                f"action; flying {self.name!r} on top would apply two laws at once. Use 'none' "
                "for the inner law alone, or an environment without inner_law"
            )
        if (
            self.name in ("lyapunov", "scheduled", "servo")
            and str(task.observe_payload) == "hidden"
        ):
            raise PolicyError(
                f"the law {self.name!r} needs the payload's mass, length and width, which this "
                "environment hides (observe_payload is 'hidden')"
            )
        if env is not None:
            self._contexts = Contexts(env)
            return
        for name in self._needs:
            if getattr(config.randomize, name) is not None:
                raise PolicyError(
                    f"{name} is drawn for each episode and no part of the observation: give the "
                    "environment itself, such as make_policy(..., env=env), so that the law knows "
                    "the episode's own"
                )

    def acting_in(self, env: Any) -> LawPolicy:
        """Return the same law for the episodes of an environment; see the class."""
        return LawPolicy(self.law, config_of(env), env)

    def predict(
        self,
        observation: ArrayLike,
        state: State | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], State | None]:
        """Return the wheel torques as fractions of their limits.

        Parameters
        ----------
        observation
            One observation ``(d,)`` or a batch ``(n, d)``.
        state
            What the last call returned; ``None`` at the start.
        episode_start
            Which environments of the batch have just begun an episode, ``(n,)`` bool: their
            memory (the rates of the sample before) is cleared.
        deterministic
            A law always is; accepted for the signature's sake.

        Returns
        -------
        tuple
            Actions ``(k,)`` or ``(n, k)``, float32 in [-1, 1], and the new state.

        Raises
        ------
        PolicyError
            Wrong observation size, values that are not finite, a state of another batch size, or
            other episodes than those of the environment that the policy was made for.

        Warns
        -----
        PolicyWarning
            Once, of observations that the environment cannot give: scaled, normalised or
            reordered ones.
        """
        single = np.ndim(observation) == 1
        batch = self._batch(observation)
        count = len(batch)
        actions = np.zeros((count, len(self._actuators)), dtype=np.float32)
        if self.name == "none":
            return (actions[0] if single else actions), state
        fresh = self._law.initial_state(count)
        if state is None:
            memory = fresh
            start = np.ones(count, dtype=np.bool_)
        else:
            memory = np.asarray(state[0], dtype=np.float64)
            start = np.zeros(count, dtype=np.bool_)
            if memory.shape != fresh.shape:
                raise PolicyError(
                    f"state has shape {memory.shape} for {count} observations; hand back what "
                    "the last predict returned"
                )
        if episode_start is not None:
            given = np.atleast_1d(np.asarray(episode_start, dtype=np.bool_))
            if given.shape != (count,):
                raise PolicyError(f"episode_start has shape {given.shape} for {count} observations")
            start = start | given
        known = self._known(count)
        torques, memory = self._torques(self._law.measurements(batch), memory, start, known)
        return self._scaled(actions, torques, known, single), (memory,)

    def _batch(self, observation: ArrayLike) -> NDArray[np.float64]:
        array = np.asarray(observation, dtype=np.float64)
        if array.ndim not in (1, 2) or array.shape[-1] != self._size:
            raise PolicyError(
                f"observation has shape {array.shape}, but the environment's observation has "
                f"{self._size} entries"
            )
        batch = np.atleast_2d(array)
        if self.name != "none":
            self._check(batch)
        return batch

    def _known(self, count: int) -> NDArray[np.float64] | None:
        """What is true in the episodes of each observation, (count, needs); none: as configured."""
        known = None if self._contexts is None else self._contexts.read(self._needs)
        if known is not None and len(known) != count:
            raise PolicyError(
                f"{count} observations, but the environment that this policy was made for flies "
                f"{len(known)} episodes: policy.acting_in(env) makes one for another environment"
            )
        return known

    def _torques(
        self,
        measurements: NDArray[np.float64],
        memory: NDArray[np.float64],
        start: NDArray[np.bool_],
        known: NDArray[np.float64] | None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if known is None or not self._arm:
            return self._law.torques(measurements, memory, start)
        arms, which = np.unique(known, axis=0, return_inverse=True)
        torques = np.empty((len(measurements), 2))
        after = np.empty_like(memory)
        for index, arm in enumerate(arms.tolist()):
            rows = np.flatnonzero(which.reshape(-1) == index)
            torques[rows], after[rows] = self._law_of(tuple(arm)).torques(
                measurements[rows], memory[rows], start[rows]
            )
        return torques, after

    def _law_of(self, arm: tuple[float, ...]) -> drm_env.ControlLaw:
        """The law that knows an episode's torque limits and arm."""
        if arm not in self._arms:
            if len(self._arms) >= _MOST_ARMS:
                self._arms.clear()
            options: dict[str, Any] = dict(zip(self._needs, arm, strict=True))
            options["payload_inertia"] = PAYLOAD_INERTIAS[int(options["payload_inertia"])]
            self._arms[arm] = drm_env.ControlLaw(self.law, config=self.config, **options)
        return self._arms[arm]

    def _scaled(
        self,
        actions: NDArray[np.float32],
        torques: NDArray[np.float64],
        known: NDArray[np.float64] | None,
        single: bool,
    ) -> NDArray[np.float32]:
        limits = np.array([self._law.torque_limits]) if known is None else known
        limits = limits * self.config.task.wheel_scale
        for column, wheel in enumerate(("root_wheel", "tip_wheel")):
            if wheel in self._actuators:
                fraction = np.clip(torques[:, column] / limits[:, column], -1.0, 1.0)
                actions[:, self._actuators.index(wheel)] = fraction
        return actions[0] if single else actions


def law_name(law: Any) -> str:
    """Return the name of a law given as a name, as data or as a dataclass."""
    if isinstance(law, str):
        return law
    name = law["name"] if isinstance(law, Mapping) else law.name
    return str(getattr(name, "value", name))
