"""A misspelt option is an error for type checkers, at every door that takes options."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import drm_env
from drm_env import _options

SNIPPET = """
import numpy as np
import drm_env
from drm_env.sb3 import DrmSB3VecEnv, make_sb3_vec
from drm_env.observation import observation_layout

env = drm_env.DrmEnv(payload_mass=(50.0, 500.0), slew_profile=["min_time"], horizon=np.float32(3))
batch = drm_env.DrmVectorEnv(2, mass_error=drm_env.Normal(0.0, 0.1), reward={"effort": 0.5})
env.set_context(payload_mass=320.0)
batch.set_context(payload_mass=np.array([60.0, 70.0]), deployment_mode="none")
make_sb3_vec("drm_env/Slew-v0", 2, preview_times=[0.5], max_episode_steps=9, config=None)
drm_env.sample_scenarios(n=2, payload_mass=range(60, 80))
drm_env.ControlLaw("linear", control_period=0.02)
held = drm_env.resolve("drm_env/Slew-v0", payload_mass=(50.0, 500.0))
drm_env.DrmEnv(config=held)
drm_env.simulate(drm_env.resolve("slew_thesis"))

drm_env.DrmEnv(payload_mas=1.0)
drm_env.DrmVectorEnv(2, payload_mas=1.0)
DrmSB3VecEnv(2, payload_mas=1.0)
make_sb3_vec("drm_env/Slew-v0", payload_mas=1.0)
drm_env.sample_scenarios(n=2, payload_mas=1.0)
drm_env.rollout([{}], payload_mas=1.0)
drm_env.ControlLaw("linear", payload_mas=1.0)
observation_layout(payload_mas=1.0)
drm_env.resolve(payload_mas=1.0)
env.set_context(payload_mas=1.0)
batch.set_context(payload_mas=1.0)
batch.envs[0].set_context(payload_mas=1.0)
env.set_context(horizon=1.0)
drm_env.DrmEnv(payload_mass="heavy")
drm_env.DrmEnv(slew_profile="sinus")
"""


def test_types_cover_every_option() -> None:
    names = drm_env.option_names()
    assert set(_options.Options.__annotations__) == set(names) - {"task"}
    drawn = {name for name, option in names.items() if option["randomizable"]}
    assert set(_options.Parameters.__annotations__) == drawn


@pytest.mark.slow
def test_type_checker_finds_misspelt_options(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    snippet = tmp_path / "snippet.py"
    snippet.write_text(SNIPPET)
    package = Path(drm_env.__file__).parent.parent
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path), str(snippet)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "MYPYPATH": str(package)},
    )
    lines = SNIPPET.splitlines()
    first_bad = lines.index("drm_env.DrmEnv(payload_mas=1.0)") + 1
    found = {int(line.split(":")[1]) for line in done.stdout.splitlines() if ": error:" in line}
    assert found == set(range(first_bad, len(lines) + 1)), done.stdout
