"""Policies: the control laws behind the ``predict`` call of Stable-Baselines3.

A law flown through a policy is the engine's own law (``drm_env.ControlLaw``), fed with what an
agent sees, so that the two are compared on the same footing and there is one implementation of
each law. The thesis' gains belong to a sampling period of 2 ms: a policy states the period it
was made for in ``control_period``, and whoever asks it at another is warned. What a policy is given
is checked in :mod:`drm_baselines.compatibility`.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import drm_env
from drm_baselines.compatibility import (
    Contexts,
    ObservationCheck,
    check_environment,
    check_period,
    config_of,
    decision_period,
)
from drm_baselines.errors import PolicyError
from drm_baselines.network import NetworkPolicy, load_policy

LAWS = ("none", "linear", "lyapunov")
"""Control laws by name: open loop, linear and Lyapunov-based feedback."""

TUNED = {"linear_tuned": "linear", "lyapunov_tuned": "lyapunov", "lqr": "lqr"}
"""Policies whose gains come from ``drm tune``, by name, and the name of their gains."""

LEARNED = "learned"
"""Name of the learned policy that comes with the package."""

LAW_PERIOD = 2e-3
"""Sampling period that the thesis' gains were chosen for, s."""

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


_LIMITS = ("root_torque_limit", "tip_torque_limit")

_ARM = ("link1_length", "link2_mass_per_length", "payload_inertia")
"""What the Lyapunov law knows of the arm, by the flat names of the scenario's parameters."""

_INERTIAS = ("full", "slender")  # by their number in the context

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
        self._needs = _LIMITS + (_ARM if self.name == "lyapunov" else ())
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
        if self.name in ("lyapunov", "scheduled") and str(task.observe_payload) == "hidden":
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
        if known is None or known.shape[1] == len(_LIMITS):
            return self._law.torques(measurements, memory, start)
        arms, which = np.unique(known[:, len(_LIMITS) :], axis=0, return_inverse=True)
        torques = np.empty((len(measurements), 2))
        after = np.empty_like(memory)
        for index, arm in enumerate(arms.tolist()):
            rows = np.flatnonzero(which.reshape(-1) == index)
            torques[rows], after[rows] = self._law_of(tuple(arm)).torques(
                measurements[rows], memory[rows], start[rows]
            )
        return torques, after

    def _law_of(self, arm: tuple[float, ...]) -> drm_env.ControlLaw:
        """The law that knows an episode's arm."""
        if arm not in self._arms:
            if len(self._arms) >= _MOST_ARMS:
                self._arms.clear()
            options: dict[str, Any] = dict(zip(_ARM, arm, strict=True))
            options["payload_inertia"] = _INERTIAS[int(options["payload_inertia"])]
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


def law_data(name: str, **parameters: Any) -> dict[str, Any]:
    """Return a law as data for the engine, after checking that the name exists.

    Raises
    ------
    PolicyError
        No law of this name, the message lists what exists; or parameters for tuned gains.
    """
    if name in TUNED:
        from drm_baselines.benchmark.tuning import load_gains

        if parameters:
            raise PolicyError(
                f"the gains of {name!r} are those of drm tune: {sorted(parameters)[0]!r} cannot be "
                "given"
            )
        return dict(load_gains(TUNED[name])["law"])
    if name not in LAWS:
        if name == LEARNED:
            raise PolicyError(
                "'learned' is a network and no law: make_policy('learned') loads the one that "
                "comes with the package, drm_baselines.load_policy(directory) any other"
            )
        raise PolicyError(f"no policy {name!r}; there are {', '.join((*LAWS, *TUNED, LEARNED))}")
    return {"name": name, **parameters}


def make_policy(
    name: str,
    *,
    env: Any = None,
    config: drm_env.EnvConfig | Mapping[str, Any] | str | Path | None = None,
    **law_parameters: Any,
) -> LawPolicy | NetworkPolicy:
    """Make a policy that acts on observations. No torch is imported.

    Parameters
    ----------
    name
        ``"none"`` (open loop, or the environment's inner law alone), ``"linear"`` or
        ``"lyapunov"`` with the thesis' gains; ``"lqr"``, ``"linear_tuned"`` or
        ``"lyapunov_tuned"`` with those of ``drm tune``; ``"learned"``, the network that comes
        with the package, which acts in the task of its ``config``.
    env
        The environment it will act in: single, vector or Stable-Baselines3. A law then divides by
        the torque limits of the very episodes that are flown; wrappers that change observations
        or actions are refused.
    config
        Its configuration, instead of ``env``; without either, that of ``drm_env/Slew-v0``. The
        observations alone are then checked.
    **law_parameters
        Gains other than the thesis', such as ``tip=None`` or ``root={"angle_gain": 4e3}``.

    Raises
    ------
    PolicyError
        Unknown name, or a policy that cannot act in this environment.
    drm_env.ConfigError
        Impossible gains or configuration.

    Warns
    -----
    PolicyWarning
        The environment asks at another period than the policy's own, such as a law at 100 Hz.
    """
    if env is not None and config is not None:
        raise PolicyError("give env or config, not both")
    if name == LEARNED:
        return _learned(env, config, law_parameters)
    law = law_data(name, **law_parameters)
    if env is not None:
        resolved = config_of(env)
    elif isinstance(config, drm_env.EnvConfig):
        resolved = config
    else:
        resolved = drm_env.DrmEnv(config=config).config
    policy = LawPolicy(law, resolved, env)
    if name != "none":
        check_period(name, policy.control_period, decision_period(env, resolved))
    return policy


def shipped_policy() -> Path:
    """Return the directory of the learned policy that comes with the package."""
    return Path(str(resources.files("drm_baselines") / "learned" / "dagger" / "seed_0"))


def _learned(env: Any, config: Any, parameters: Mapping[str, Any]) -> NetworkPolicy:
    if parameters:
        raise PolicyError(f"'learned' has no parameter {sorted(parameters)[0]!r}")
    policy = load_policy(shipped_policy())
    if env is not None or config is not None:
        resolved = config_of(env) if env is not None else drm_env.DrmEnv(config=config).config
        if env is not None:
            check_environment(env, resolved)
        policy.check_task(resolved)
        check_period(LEARNED, policy.control_period, decision_period(env, resolved))
    return policy


__all__ = [
    "LAWS",
    "LAW_PERIOD",
    "LEARNED",
    "TUNED",
    "LawPolicy",
    "Policy",
    "config_of",
    "law_data",
    "law_name",
    "load_policy",
    "make_policy",
    "shipped_policy",
]
