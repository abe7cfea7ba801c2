"""An own reward as a wrapper, and the signals of the flight that earned it as a picture.

Weights of the environment's own reward are options (``reward={"effort": 0.1}``). Another reward is
a wrapper: it reads true signals, which no policy sees.
"""

import argparse
from pathlib import Path
from typing import Any, SupportsFloat

import gymnasium as gym
from matplotlib.figure import Figure

import drm_env
from drm_baselines import make_policy

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--out", type=Path, default=Path("custom_reward.png"))
given = options.parse_args()


class Gentle(gym.Wrapper[Any, Any, Any, Any]):
    """Pays for every step in which the tip swings by less than 5 mm."""

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        observation, _, terminated, truncated, info = self.env.step(action)
        deflection = self.get_wrapper_attr("signals")()["tip_deflection"]
        return observation, float(abs(deflection) < 5e-3), terminated, truncated, info


env = Gentle(gym.make("drm_env/SlewThesis-v0", reward={"effort": 0.1}))
policy = make_policy("lyapunov", env=env)
observation, info = env.reset(seed=0)
start, ended = [True], False
state: Any = None
paid: list[float] = []
while not ended:
    action, state = policy.predict(observation, state, start)
    observation, reward, terminated, truncated, info = env.step(action)
    ended, start = terminated or truncated, [False]
    paid.append(float(reward))
print(f"paid for {sum(paid):.0f} of {len(paid)} steps")

flight = drm_env.simulate(law="lyapunov")
figure = Figure(figsize=(7, 3), layout="constrained")
axes = figure.add_subplot(xlabel="time (s)", ylabel="tip deflection (mm)")
axes.plot(flight["time"], 1e3 * flight["tip_deflection"])
axes.axhspan(-5.0, 5.0, color="0.9", zorder=0)
figure.savefig(given.out, dpi=150)
print(f"wrote {given.out}")
