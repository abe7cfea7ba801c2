"""Environments that start spread over the phases of an episode instead of all together."""

from __future__ import annotations

import numpy as np

from drm_baselines.support.extras import needing

with needing("training", "learn"):
    from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn


class StaggeredStart(VecEnvWrapper):
    """Spreads the environments evenly over the phases of an episode before training begins.

    Episodes of this task are equally long. Environments that all start together stay in step,
    so that each update would see one phase of the manoeuvre only and forget the others.

    Parameters
    ----------
    venv
        Environments whose sub-environments can be reset one at a time.
    horizon
        Length of an episode in steps.
    """

    def __init__(self, venv: VecEnv, horizon: int) -> None:
        super().__init__(venv)
        self._horizon = horizon

    def reset(self) -> VecEnvObs:
        """Reset, then fly one horizon with zero action, restarting each at its own time."""
        observations = self.venv.reset()
        shape = self.action_space.shape
        assert shape is not None, "the action space is a Box"
        actions = np.zeros((self.num_envs, *shape), dtype=np.float32)
        restarts = np.arange(self.num_envs) * self._horizon // self.num_envs
        for step in range(self._horizon):
            due = np.flatnonzero(restarts == step)
            if step > 0 and due.size:
                self.venv.env_method("reset", indices=due.tolist())
            observations, _, _, _ = self.venv.step(actions)
        return observations

    def step_wait(self) -> VecEnvStepReturn:
        """Step the environments."""
        return self.venv.step_wait()
