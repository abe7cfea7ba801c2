"""PPO from scratch, without a law underneath: its learning curve beside the laws.

Everything about the algorithm is Stable-Baselines3's default but the number of environments, of
steps between two updates and of samples in a minibatch. ``drm train`` does more: it goes on after
an interruption and exports a policy that needs no PyTorch.
"""

import argparse
from pathlib import Path

import torch
from matplotlib.figure import Figure
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from drm_baselines.evaluation import TRAINING_SEED, environment_config, fly_law, fly_policy
from drm_baselines.evaluation.records import Episodes
from drm_env.sb3 import make_sb3_vec

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--steps", type=int, default=500_000)
options.add_argument("--envs", type=int, default=32)
options.add_argument("--episodes", type=int, default=256, help="behind each point of the curve")
options.add_argument("--out", type=Path, default=Path("from_scratch.png"))
given = options.parse_args()

ENV_ID = "drm_env/Slew-v1"
config = environment_config(ENV_ID, {})
curve: list[tuple[int, float]] = []


def error_of(flown: Episodes) -> float:
    """Tip error RMS in mm, interquartile mean."""
    return flown.estimate("tip_error_rms").scaled(1e3).value


class Curve(BaseCallback):
    """Flies the policy as it is, ten times during training."""

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= len(curve) * given.steps / 10:
            self.fly()

    def _on_step(self) -> bool:
        return True

    def fly(self) -> None:
        """Adds a point."""
        flown = fly_policy(self.model, ENV_ID, config, seed=0, episodes=given.episodes, label="PPO")
        curve.append((self.num_timesteps, error_of(flown)))
        print(f"{curve[-1][0]:>9,} steps: tip error RMS {curve[-1][1]:7.1f} mm", flush=True)


torch.set_num_threads(1)  # the network is too small for more
# training has seeds of its own, which no comparison flies
venv = make_sb3_vec(ENV_ID, n_envs=given.envs, seed=TRAINING_SEED, step_context=False)
model = PPO("MlpPolicy", venv, n_steps=128, batch_size=256, device="cpu")
watcher = Curve()
model.learn(given.steps, callback=watcher)
watcher.fly()

figure = Figure(figsize=(6, 4), layout="constrained")
axis = figure.subplots()
axis.plot(*zip(*curve, strict=True), marker="o", label="PPO, from scratch")
for name, title in (("none", "open loop"), ("lyapunov", "Lyapunov law"), ("linear", "linear law")):
    error = error_of(
        fly_law({"name": name}, config, env_id=ENV_ID, seed=0, episodes=given.episodes)
    )
    print(f"{title + ' at 500 Hz':>24}: {error:7.1f} mm")
    axis.axhline(error, color="grey")
    axis.annotate(title, (1.0, error), xycoords=("axes fraction", "data"), ha="right", va="bottom")
axis.set(yscale="log", xlabel="environment steps", ylabel="tip error RMS (mm)")
axis.legend()
figure.savefig(given.out)
