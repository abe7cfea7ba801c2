"""PPO on top of the linear law, held against that law alone on the same unseen episodes.

``drm train`` does more: it records the learning curve, goes on after an interruption and exports a
policy that needs no PyTorch.
"""

import argparse
from typing import Any

import numpy as np
from stable_baselines3 import PPO

from drm_baselines.evaluation import TRAINING_SEED, environment_config, fly_policy
from drm_env.sb3 import make_sb3_vec

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--steps", type=int, default=1_000_000)
options.add_argument("--envs", type=int, default=128)
options.add_argument("--episodes", type=int, default=50, help="of the comparison")
given = options.parse_args()

ENV_ID = "drm_env/SlewResidual-v0"
# training has seeds of its own, which no comparison flies
venv = make_sb3_vec(ENV_ID, n_envs=given.envs, seed=TRAINING_SEED, control_period=0.1)
agent = PPO("MlpPolicy", venv, n_steps=100, batch_size=given.envs * 10, device="cpu", seed=0)
agent.learn(given.steps)


class Idle:
    """Adds nothing to the inner law."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        return np.zeros((len(observation), 2), dtype=np.float32), state


config = environment_config(ENV_ID, {"control_period": 0.1})
for name, policy in (("inner law alone", Idle()), ("with PPO", agent)):
    flown = fly_policy(policy, ENV_ID, config, seed=0, episodes=given.episodes, label=name)
    error = 1e3 * flown.metrics["tip_error_rms"]
    print(f"{name:>15}: tip error RMS, median of {error.size} episodes: {np.median(error):.1f} mm")
