"""Policies: the control laws behind the ``predict`` call of Stable-Baselines3.

A law flown through a policy is the engine's own law (``drm_env.ControlLaw``), fed with what an
agent sees, so that the two are compared on the same footing and there is one implementation of
each law. The thesis' gains belong to a sampling period of 2 ms: a policy states the period it
was made for in ``control_period`` and the evaluator builds the environment with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import drm_env
from drm_baselines.errors import PolicyError
from drm_baselines.network import NetworkPolicy, load_policy

LAWS = ("none", "linear", "lyapunov")
"""Control laws by name: open loop, linear and Lyapunov-based feedback."""

TUNED = {"lqr": "lqr", "linear_tuned": "linear", "lyapunov_tuned": "lyapunov"}
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


def config_of(env: Any) -> drm_env.EnvConfig:
    """Return the configuration of a single, vector or Stable-Baselines3 environment.

    Raises
    ------
    PolicyError
        The environment is not one of drm-env's.
    """
    inner = getattr(env, "unwrapped", env)
    config = getattr(inner, "config", None)
    if config is None and hasattr(env, "get_attr"):
        try:
            config = env.get_attr("config")[0]
        except (AttributeError, IndexError):
            config = None
    if not isinstance(config, drm_env.EnvConfig):
        raise PolicyError(f"{env!r} is not an environment of drm-env: it has no EnvConfig")
    return config


class LawPolicy:
    """A control law of the engine, acting on observations.

    ``control_period`` is the sampling period that the law was made for, in s.

    Parameters
    ----------
    law
        The law with its parameters, as data: ``{"name": "linear", ...}``.
    config
        The environment it acts in: layout, torque limits and inner law are read from it.

    Raises
    ------
    PolicyError
        The law cannot act there: hidden payload, missing measurement, a second law underneath.
    """

    def __init__(self, law: Mapping[str, Any], config: drm_env.EnvConfig) -> None:
        self.control_period = LAW_PERIOD
        self.law = dict(law)
        self.name = str(law["name"])
        self.config = config
        task = config.task
        self._size = len(drm_env.observation_layout(config=config))
        self._actuators = [str(getattr(name, "value", name)) for name in task.actuators]
        self._law = drm_env.ControlLaw(self.law, config=config)
        if self.name == "none":
            return
        if task.inner_law is not None and law_name(task.inner_law) != "none":
            raise PolicyError(
                f"the environment already adds the law {law_name(task.inner_law)!r} below the "
                f"action; flying {self.name!r} on top would apply two laws at once. Use 'none' "
                "for the inner law alone, or an environment without inner_law"
            )
        if self.name == "lyapunov" and str(task.observe_payload) == "hidden":
            raise PolicyError(
                "the law 'lyapunov' needs the payload's mass, length and width, which this "
                "environment hides (observe_payload is 'hidden')"
            )

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
            Wrong observation size, or a state of another batch size.
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
        torques, memory = self._law.torques(self._law.measurements(batch), memory, start)
        return self._scaled(actions, torques, single), (memory,)

    def _batch(self, observation: ArrayLike) -> NDArray[np.float64]:
        array = np.asarray(observation, dtype=np.float64)
        if array.ndim not in (1, 2) or array.shape[-1] != self._size:
            raise PolicyError(
                f"observation has shape {array.shape}, but the environment's observation has "
                f"{self._size} entries"
            )
        return np.atleast_2d(array)

    def _scaled(
        self, actions: NDArray[np.float32], torques: NDArray[np.float64], single: bool
    ) -> NDArray[np.float32]:
        limits = self._law.torque_limits
        for column, wheel in enumerate(("root_wheel", "tip_wheel")):
            if wheel in self._actuators:
                fraction = np.clip(torques[:, column] / limits[column], -1.0, 1.0)
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
        The environment it will act in: single, vector or Stable-Baselines3.
    config
        Its configuration, instead of ``env``; without either, that of ``drm_env/Slew-v0``.
    **law_parameters
        Gains other than the thesis', such as ``tip=None`` or ``root={"angle_gain": 4e3}``.

    Raises
    ------
    PolicyError
        Unknown name, or a law that cannot act in this environment.
    drm_env.ConfigError
        Impossible gains or configuration.
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
    return LawPolicy(law, resolved)


def shipped_policy() -> Path:
    """Return the directory of the learned policy that comes with the package."""
    return Path(str(resources.files("drm_baselines") / "learned" / "dagger" / "seed_0"))


def _learned(env: Any, config: Any, parameters: Mapping[str, Any]) -> NetworkPolicy:
    if parameters:
        raise PolicyError(f"'learned' has no parameter {sorted(parameters)[0]!r}")
    policy = load_policy(shipped_policy())
    if env is not None or config is not None:
        resolved = config_of(env) if env is not None else drm_env.DrmEnv(config=config).config
        layout = [list(entry) for entry in drm_env.observation_layout(config=resolved)]
        if layout != [list(entry) for entry in policy.description["observation_layout"]]:
            raise PolicyError(
                "the observation of this environment is not the one that 'learned' was trained "
                f"on: make the environment with config=policy.config ({policy.env_id})"
            )
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
