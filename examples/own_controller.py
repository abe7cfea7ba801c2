"""An own controller in a few lines, beside the thesis' linear law on the same episodes.

A controller is anything with the ``predict`` of Stable-Baselines3. Observations are scaled; the
layout says by what, so that a controller can be written in SI units.
"""

import argparse
from typing import Any

import numpy as np

import drm_env
from drm_baselines.evaluation import environment_config, fly_law, fly_policy

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--episodes", type=int, default=50)
given = options.parse_args()

ENV_ID = "drm_env/Slew-v0"
config = environment_config(ENV_ID, {"control_period": 0.002})
layout = enumerate(drm_env.observation_layout(config=config))
places = {entry.name: (index, entry.scale) for index, entry in layout}
SEEN = [places[name] for name in ("slew_error", "slew_error_rate", "link2_deflection_rate")]


class Damper:
    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        error, rate, bend = (observation[..., place] * scale for place, scale in SEEN)
        torques = np.stack([-4e3 * error - 4e4 * rate, -250.0 * bend], axis=-1)  # N m
        return np.clip(torques / [100.0, 10.0], -1.0, 1.0).astype(np.float32), state


own = fly_policy(Damper(), ENV_ID, config, seed=0, episodes=given.episodes, label="own")
law = fly_law({"name": "linear"}, config, env_id=ENV_ID, seed=0, episodes=given.episodes)
print("tip error RMS, interquartile mean with its 95 % interval (mm)")
for flown in (own, law):
    error = flown.estimate("tip_error_rms").scaled(1e3)
    print(f"{flown.label:>7}: {error.value:.1f} [{error.low:.1f}, {error.high:.1f}]")
