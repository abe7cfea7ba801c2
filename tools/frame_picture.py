"""Make the picture of a frame in docs/images: what an environment shows within an episode.

    tools/frame_picture.py [OUTPUT]

The Lyapunov law flies a payload that is reported too heavy, while it slews and deploys.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
from PIL import Image

import drm_env  # registers the ids
from drm_baselines import make_policy
from drm_baselines.policies.names import find

ROOT = Path(__file__).resolve().parents[1]
TIME = 9.0
"""Instant of the picture, s."""


def main() -> int:
    """Take the picture that the command line names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    output = ROOT / "docs" / "images" / "frame.png"
    parser.add_argument("output", type=Path, nargs="?", default=output)
    arguments = parser.parse_args()
    law = find("lyapunov")
    env = gym.make(
        "drm_env/Slew-v0",
        control_period=0.002,
        payload_mass=320.0,
        mass_error=0.15,
        render_mode="rgb_array",
        render_title=f"{law.title[0].upper()}{law.title[1:]}, drm-env {drm_env.__version__}",
        render_colour=law.colour,
    )
    policy, state = make_policy(law.name, env=env), None
    observation, _ = env.reset(seed=0)
    for _ in range(round(TIME / 0.002)):
        action, state = policy.predict(observation, state)
        observation, *_ = env.step(action)
    frame = np.asarray(env.render())
    env.close()
    Image.fromarray(frame).save(arguments.output, optimize=True)
    print(arguments.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
