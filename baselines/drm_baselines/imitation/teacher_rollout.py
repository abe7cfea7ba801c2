"""Manoeuvres that are flown decision by decision, with what a teacher sees of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.imitation.observation_jacobian import Array, Sensing
from drm_baselines.imitation.teacher import Plans, Teaching, advise


class Flight:
    """The manoeuvres of some plans side by side, in the student's environment.

    Parameters
    ----------
    plans
        Plans of the manoeuvres.
    teaching
        The teacher's settings.
    """

    def __init__(self, plans: Plans, teaching: Teaching) -> None:
        self.plans, self.teaching = plans, teaching
        self.seeds = [int(seed) for seed in plans.seeds]
        self.config: Mapping[str, Any] = teaching.config(plans.stratum)
        self.sensing = Sensing(self.config)

    def fly(
        self,
        student: Callable[[Array], Array] | None,
        looked: Callable[[int, Array, NDArray[np.float64], Array], None],
    ) -> dict[str, NDArray[np.float64]]:
        """Fly everything, by the teacher without a student; return the metrics.

        ``looked`` is called at every decision with its number, the observations (n, m), the states
        and the teacher's advice (n, 2).
        """
        if not self.seeds:
            return {}
        env = drm_env.DrmVectorEnv(num_envs=len(self.seeds), config=self.config)
        try:
            observations, info = env.reset(seed=self.seeds)
            for k in range(self.plans.torques.shape[1]):
                states = self.sensing.states(env, observations)
                advice = advise(self.plans, k, states, self.teaching)
                looked(k, observations, states, advice)
                actions = advice if student is None else student(observations)
                observations, *_, info = env.step(actions)
            return drm_env.info_metrics(info)
        finally:
            env.close()


class Examples:
    """Observations, what the teacher would have done, and how much it is to be trusted."""

    def __init__(self) -> None:
        self.observations: list[Array] = []
        self.actions: list[Array] = []
        self.trust: list[Array] = []
        self.decisions = 0

    def keep(self, observations: Array, actions: Array, trust: Array) -> None:
        """Keep copies of examples (n, m), (n, 2), (n,)."""
        self.observations.append(np.array(observations))
        self.actions.append(np.array(actions))
        self.trust.append(np.array(trust))

    def arrays(self) -> tuple[Array, Array, Array]:
        """Return all observations, actions and trusts."""
        return (
            np.concatenate(self.observations),
            np.concatenate(self.actions),
            np.concatenate(self.trust),
        )
