"""A thousand arms as one native batch, and the speed of it."""

import argparse
import time

import gymnasium as gym

import drm_env

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--envs", type=int, default=1024, help="number of arms")
options.add_argument("--steps", type=int, default=500, help="steps of each")
given = options.parse_args()

envs = gym.make_vec("drm_env/Slew-v0", num_envs=given.envs, payload_mass=(50.0, 500.0))
observations, infos = envs.reset(seed=0)  # sub-environment i has the episode of seed i
print(f"observations {observations.shape}, actions {envs.action_space.shape}")

begun, returns = time.perf_counter(), 0.0
for _ in range(given.steps):
    observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
    returns += float(rewards.mean())
elapsed = time.perf_counter() - begun

assert isinstance(envs.unwrapped, drm_env.DrmVectorEnv)
period = envs.unwrapped.control_period
print(f"{given.envs * given.steps / elapsed:,.0f} steps/s, each of {1e3 * period:g} ms")
print(f"mean return so far {returns:.2f} (random torques)")
