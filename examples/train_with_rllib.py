"""RLlib on the native batch: an environment runner's N environments are one ``DrmVectorEnv(N)``.

More runners (``--runners``) are processes, on as many machines as the Ray cluster has; each steps
its batch on one core.
"""

import argparse
from typing import Any

import gymnasium as gym
from ray.rllib.algorithms.ppo import PPOConfig

import drm_env  # registers the environments

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--iterations", type=int, default=20)
options.add_argument("--envs", type=int, default=32, help="of each runner")
options.add_argument("--runners", type=int, default=0, help="0: the script's own process")
options.add_argument("--batch", type=int, default=16_000, help="steps of an iteration")
given = options.parse_args()

config = (
    PPOConfig()
    .environment(
        "drm_env/Slew-v1", env_config={"num_threads": 1}, clip_actions=True, normalize_actions=False
    )
    .env_runners(
        num_env_runners=given.runners,
        num_envs_per_env_runner=given.envs,
        gym_env_vectorize_mode=gym.VectorizeMode.VECTOR_ENTRY_POINT,
    )
    .training(train_batch_size_per_learner=given.batch, minibatch_size=given.batch // 8, lr=3e-4)
)
trainer = config.build_algo()
runner: Any = trainer.env_runner  # none where runners are processes of their own
if runner is not None:
    assert isinstance(runner.env.unwrapped, drm_env.DrmVectorEnv), runner.env
for _ in range(given.iterations):
    result = trainer.train()
    runners = result["env_runners"]
    mean = runners.get("episode_return_mean")
    shown = "no episode has ended" if mean is None else f"mean return {mean:.2f}"
    print(f"{runners['num_env_steps_sampled_lifetime']:>9,.0f} steps: {shown}")
trainer.stop()
