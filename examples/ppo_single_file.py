"""PPO in one file on the native batch, in the manner of CleanRL: nothing but PyTorch and NumPy.

The batch is ``gym.make_vec``'s own, which steps all arms in one call: one process, and many times
the speed of a vector of single environments. At the end the network flies unseen episodes inside
the engine, beside the inner law alone.
"""

import argparse
import time

import gymnasium as gym
import numpy as np
import torch
from torch import Tensor, nn
from torch.distributions import Normal

import drm_env

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--steps", type=int, default=250_000)
options.add_argument("--envs", type=int, default=32)
options.add_argument("--horizon", type=int, default=128, help="steps between two updates")
options.add_argument("--episodes", type=int, default=256, help="of the comparison")
options.add_argument("--seed", type=int, default=0)
given = options.parse_args()

TASK = "slew_residual_v1"
GAMMA, LAMBDA, CLIP, RATE, EPOCHS, BATCH = 0.99, 0.95, 0.2, 3e-4, 10, 256

torch.manual_seed(given.seed)
torch.set_num_threads(1)  # the networks are too small for more
rng = np.random.default_rng(given.seed)
# SameStep: the reset comes with the end, whose last observation is in the info
envs = gym.make_vec("drm_env/SlewResidual-v1", num_envs=given.envs, autoreset_mode="SameStep")
assert envs.single_observation_space.shape and envs.single_action_space.shape
inputs, outputs = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]


def perceptron(outputs: int, scale: float) -> nn.Sequential:
    """Two hidden layers, orthogonal at first."""
    net = nn.Sequential(
        nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)
    )
    linear = [layer for layer in net if isinstance(layer, nn.Linear)]
    for layer, gain in zip(linear, (2**0.5, 2**0.5, scale), strict=True):
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
    return net


actor, critic = perceptron(outputs, 0.01), perceptron(1, 1.0)
log_std = nn.Parameter(torch.full((outputs,), -2.0))  # a seventh of the wheels' torques
parameters = [*actor.parameters(), *critic.parameters(), log_std]
optimizer = torch.optim.Adam(parameters, lr=RATE, eps=1e-5)


def likelihood(observations: Tensor, actions: Tensor) -> Tensor:
    """The logarithm of the density with which the actor acts so."""
    choice = Normal(actor(observations), log_std.exp())
    density: Tensor = choice.log_prob(actions)
    return density.sum(-1)


def value(observations: Tensor) -> Tensor:
    """What the critic expects."""
    expectation: Tensor = critic(observations).squeeze(-1)
    return expectation


size = (given.horizon, given.envs)
seen, acted = torch.zeros(*size, inputs), torch.zeros(*size, outputs)
paid, likely, expected, ended = (torch.zeros(size) for _ in range(4))

begun = time.perf_counter()
observation = torch.from_numpy(envs.reset(seed=1_000_000_000)[0])  # far from those compared
updates = max(1, given.steps // (given.horizon * given.envs))
returns = np.zeros(given.envs)
finished: list[float] = []
for update in range(updates):
    optimizer.param_groups[0]["lr"] = RATE * (1.0 - update / updates)
    for step in range(given.horizon):
        with torch.no_grad():
            action = Normal(actor(observation), log_std.exp()).sample()
            seen[step], acted[step], expected[step] = observation, action, value(observation)
            likely[step] = likelihood(observation, action)
        following, reward, terminated, truncated, info = envs.step(action.clamp(-1, 1).numpy())
        done = terminated | truncated
        returns += reward
        if truncated.any():  # time is up, and the manoeuvre would have gone on: worth its value
            last = np.stack([info["final_obs"][i] for i in np.flatnonzero(truncated)])
            with torch.no_grad():
                reward[truncated] += GAMMA * value(torch.from_numpy(last)).numpy()
        finished += returns[done].tolist()
        returns[done] = 0.0
        paid[step], ended[step] = torch.from_numpy(reward), torch.from_numpy(done)
        observation = torch.from_numpy(following)

    # generalised advantage estimation, backwards
    advantage = torch.zeros(size)
    with torch.no_grad():
        after, carried = value(observation), torch.zeros(given.envs)
    for step in reversed(range(given.horizon)):
        goes_on = 1.0 - ended[step]
        carried = (
            paid[step]
            + GAMMA * after * goes_on
            - expected[step]
            + GAMMA * LAMBDA * goes_on * carried
        )
        advantage[step], after = carried, expected[step]

    flat = [part.flatten(0, 1) for part in (seen, acted, likely, advantage, advantage + expected)]
    for _ in range(EPOCHS):
        for rows in torch.from_numpy(rng.permutation(given.horizon * given.envs)).split(BATCH):
            saw, did, before, gain, target = (part[rows] for part in flat)
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            ratio = (likelihood(saw, did) - before).exp()
            loss = -torch.min(gain * ratio, gain * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
            loss = loss + 0.5 * (value(saw) - target).square().mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(parameters, 0.5)
            optimizer.step()
    if finished and update % 10 == 9:
        steps = (update + 1) * given.horizon * given.envs
        rate = steps / (time.perf_counter() - begun)
        print(f"{steps:>9,} steps, {rate:,.0f} a second: return {np.mean(finished[-100:]):.2f}")

# the trained mean as arrays, which the engine flies without Python
layers = [
    (layer.weight.detach().numpy(), layer.bias.detach().numpy())
    for layer in actor
    if isinstance(layer, nn.Linear)
]
idle = [(np.zeros((outputs, inputs)), np.zeros(outputs))]
scenarios = drm_env.sample_scenarios(TASK, seed=0, n=given.episodes)
print(f"tip error RMS, median of {given.episodes} episodes that were not trained on")
for name, network in (("inner law alone", idle), ("with PPO", layers)):
    flown = drm_env.rollout(scenarios, policy=drm_env.Network(network), task=TASK)
    print(f"{name:>15}: {1e3 * np.median(flown['tip_error_rms']):.1f} mm")
