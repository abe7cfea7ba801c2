"""Any policy with a ``predict`` as a pilot: it flies given manoeuvres through a batch.

The engine flies what it has the network of. Everything else is asked in Python, once a decision for
all manoeuvres of a batch together, with what the environment shows alone.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import BaselineError, PolicyError
from drm_baselines.evaluation.first_episodes import first_episodes
from drm_baselines.policies.law_policy import Predictor
from drm_baselines.policies.perceptron import NetworkPolicy
from drm_baselines.policies.pilots import Metrics, NetworkPilot, Progress, details_of
from drm_baselines.suites import SUITES
from drm_baselines.support import cores

BATCH = 250
"""Most manoeuvres that are flown side by side."""


def flat_manoeuvres(
    scenarios: Sequence[Mapping[str, Any]],
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return what all scenarios share, and what each has of its own by the flat names of options.

    Parameters
    ----------
    scenarios
        Of one suite: they differ in columns of its file alone.

    Raises
    ------
    BaselineError
        They differ in something else.
    """
    paths = {path: name for suite in SUITES.values() for name, path in suite.columns.items()}
    shared: dict[str, Any] | None = None
    own = []
    for scenario in scenarios:
        rest = copy.deepcopy(dict(scenario))
        options: dict[str, Any] = {}
        for path, name in paths.items():
            node: Any = rest
            for part in path[:-1]:
                node = node.get(part, {}) if isinstance(node, dict) else {}
            value = node.pop(path[-1], None) if isinstance(node, dict) else None
            if value is not None:
                options[name] = value
        rest = _without_empty(rest)
        if shared is None:
            shared = rest
        elif shared != rest:
            raise BaselineError("the manoeuvres of a batch must be of one suite")
        own.append(options)
    return shared or {}, own


def _without_empty(data: dict[str, Any]) -> dict[str, Any]:
    found = {}
    for name, value in data.items():
        if isinstance(value, dict):
            value = _without_empty(value)
            if not value:
                continue
        found[name] = value
    return found


class PredictorPilot:
    """A policy with the ``predict`` of Stable-Baselines3, flown through the native batch.

    Parameters
    ----------
    name
        In commands and files.
    policy
        The policy; a state that it returns is given back, with the starts of episodes.
    config
        The task that it acts in, as plain data: observation, action, inner law, control period.
    details
        What identifies it in records.
    """

    def __init__(
        self,
        name: str,
        policy: Predictor,
        config: Mapping[str, Any],
        details: Mapping[str, Any] | None = None,
    ) -> None:
        self.name = name
        self.policy = policy
        self._task = copy.deepcopy(dict(config.get("task", {})))
        self._details = dict(details or {})
        self.control_period = float(drm_env.resolve(config={"task": self._task}).control_period)

    @property
    def details(self) -> Mapping[str, Any]:
        """What identifies it in records."""
        return self._details

    def fly(
        self,
        scenarios: Sequence[Mapping[str, Any]],
        *,
        seed: int | Sequence[int] = 0,
        progress: Progress | None = None,
    ) -> Metrics:
        """See :class:`drm_baselines.policies.pilots.Pilot`.

        Raises
        ------
        PolicyError
            The policy fails, or what it returns are no actions.
        """
        seeds = [seed + i for i in range(len(scenarios))] if isinstance(seed, int) else list(seed)
        shared, own = flat_manoeuvres(scenarios)
        parts: list[Metrics] = []
        for first in range(0, len(own), BATCH):
            chosen = slice(first, first + BATCH)
            parts.append(self._batch(shared, own[chosen], seeds[chosen]))
            if progress is not None:
                progress(min(first + BATCH, len(own)), len(own))
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def trajectory(
        self,
        scenario: Mapping[str, Any],  # noqa: ARG002
        *,
        seed: int = 0,  # noqa: ARG002
        decimation: int = 1,  # noqa: ARG002
    ) -> drm_env.Trajectory:
        """See :class:`drm_baselines.policies.pilots.Pilot`.

        Raises
        ------
        PolicyError
            Always: the engine alone keeps signals between decisions.
        """
        raise PolicyError(f"{self.name!r} is asked in Python: the engine keeps no signals of it")

    def _batch(
        self, shared: Mapping[str, Any], own: Sequence[Mapping[str, Any]], seeds: Sequence[int]
    ) -> Metrics:
        count = len(own)
        config = drm_env.resolve(config={"scenario": dict(shared), "task": self._task})
        env = drm_env.DrmVectorEnv(count, config=config, num_threads=cores.given())
        try:
            options = [dict(each) for each in own]
            observations, _ = env.reset(seed=list(seeds), options=options)
            return first_episodes(env, observations, self._asked)
        finally:
            env.close()

    def _asked(
        self, observations: Any, state: Any, starts: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], Any]:
        try:
            actions, state = self.policy.predict(
                observations, state=state, episode_start=starts, deterministic=True
            )
            return np.asarray(actions, dtype=np.float32), state
        except (BaselineError, drm_env.DrmError):
            raise
        except Exception as error:  # whatever a stranger's code may raise
            raise PolicyError(
                f"predict of {self.name!r} failed: {type(error).__name__}: {error}"
            ) from error


def pilot_of(name: str, policy: NetworkPolicy) -> NetworkPilot | PredictorPilot:
    """Return who flies an exported policy: the engine, or NumPy where the network has a memory."""
    if type(policy) is NetworkPolicy:
        return NetworkPilot(name, policy)
    return PredictorPilot(name, policy, policy.config, details_of(policy))
