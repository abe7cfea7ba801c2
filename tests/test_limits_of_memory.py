"""What does not fit into memory is refused with its size; the process lives on."""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap

import pytest

import drm_env

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")

HEAD = """
import resource, sys
import numpy as np
import gymnasium as gym
import drm_env
from drm_env import _engine

ID = "drm_env/Slew-v0"
config = _engine.Config("slew", None, None)

def refused(call):
    try:
        call()
    except (drm_env.ConfigError, MemoryError) as error:
        print(type(error).__name__, error)
    else:
        print("it fits")
"""

LIMIT = """
with open("/proc/self/statm") as file:
    used = int(file.read().split()[0]) * resource.getpagesize()
limit = used + (600 << 20)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
"""


def run(script: str, before: str = "") -> list[str]:
    text = HEAD + before + LIMIT + textwrap.dedent(script)
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


LIMITED = {
    "simulate": ("drm_env.simulate({'horizon': 2e4})", "decimation .* GiB"),
    "make_vec": ("gym.make_vec(ID, num_envs=1_000_000)", "num_envs .* GiB"),
    "make_sb3_vec": (
        "make_sb3_vec(ID, 1_000_000)",
        "num_envs .* GiB",
    ),
    "rollout": (
        "drm_env.rollout([{'horizon': 2e4}] * 4, signals=['alpha', 'beta'])",
        "signals .* (MiB|GiB)",
    ),
    "sample_scenarios": ("drm_env.sample_scenarios(n=1_000_000)", "n must .* GiB"),
    "transitions": (
        "drm_env.transitions({'plant': 'consistent', 'modes': [8, 8], 'horizon': 200.0}, hold=1)",
        "hold .* (MiB|GiB)",
    ),
    "batch benchmark": ("_engine.batch_benchmark(config, 1_000_000, 1, 1)", "num_envs .* GiB"),
    "picture": (
        "env = drm_env.DrmEnv(); env.reset(seed=0); "
        "_engine.Painter(1, None, '', (0, 0, 0)).frame(env._engine, 2**31, 2**31)",
        "size .* GiB",
    ),
}


@pytest.mark.parametrize("name", LIMITED)
def test_under_a_limit_of_the_process_it_is_refused(name: str) -> None:
    call, match = LIMITED[name]
    *first, last = call.split("; ")
    # torch alone takes more than the limit
    before = "from drm_env.sb3 import make_sb3_vec" if "sb3" in call else ""
    (line,) = run("\n".join(first) + f"\nrefused(lambda: {last})", before)
    assert line.startswith("ConfigError"), line
    assert re.search(match, line), line


def test_what_fits_is_done_under_a_limit() -> None:
    lines = run(
        """
        vec = gym.make_vec(ID, num_envs=20_000)
        vec.reset(seed=0)
        vec.step(np.zeros((20_000, 2), np.float32))
        refused(lambda: drm_env.simulate({"horizon": 200.0}))
        """
    )
    assert lines == ["it fits"]


def test_whatever_the_number_it_is_refused_with_what_it_takes() -> None:
    calls = {
        **{f"drm_env.DrmVectorEnv(10**{power})": "num_envs" for power in (9, 12, 18, 19, 20, 30)},
        "drm_env.DrmVectorEnv(2**62)": "num_envs",
        "drm_env.sample_scenarios(n=10**12)": "n",
        "drm_env.sample_scenarios(n=10**30)": "n",
    }
    lines = run("\n".join(f"refused(lambda: {call})" for call in calls))
    assert len(lines) == len(calls)
    for line, name in zip(lines, calls.values(), strict=True):
        assert re.match(rf"ConfigError {name} must fit into .* takes \d+\.\d GiB$", line), line
    (line,) = run("refused(lambda: drm_env.simulate({'horizon': 1e6}))")
    assert line.endswith("got 1, which takes 74.5 GiB"), line


def test_a_number_beyond_the_machine_is_the_largest_one() -> None:
    """A decimation or a hold that leaves one row, whatever its size."""
    for decimation in (10**6, 2**64, 10**30):
        flown = drm_env.simulate({"horizon": 0.1}, decimation=decimation)
        assert flown["time"].tolist() == [0.0, 0.1]
        kept = drm_env.rollout([{"horizon": 0.1}], signals=["time"], decimation=decimation)
        assert kept.trajectories["time"].tolist() == [[0.0, 0.1]]
    with pytest.raises(drm_env.ConfigError, match="hold must divide"):
        drm_env.transitions({"horizon": 0.1}, hold=2**70)
