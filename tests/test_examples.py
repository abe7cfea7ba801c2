"""The scripts in ``examples/`` run as they stand, with small budgets."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"

SMALL = {
    "first_flight": (),
    "vector_environment": ("--envs", "8", "--steps", "20"),
    "own_controller": ("--episodes", "4"),
    "misreported_payload": ("--episodes", "8"),
    "custom_reward": ("--out", "reward.png"),
    "ppo_single_file": ("--envs", "4", "--steps", "1024", "--episodes", "4"),
    "train_from_scratch": (
        "--envs",
        "4",
        "--steps",
        "1024",
        "--episodes",
        "4",
        "--out",
        "curve.png",
    ),
    "train_with_rllib": ("--envs", "4", "--iterations", "1", "--batch", "256"),
    "train_residual": ("--envs", "4", "--steps", "400", "--episodes", "2"),
}


def test_every_example_is_run_and_listed() -> None:
    found = {path.stem for path in EXAMPLES.glob("*.py")}
    assert found == set(SMALL)
    page = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert all(f"| `{name}.py` |" in page for name in found)


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALL)
def test_an_example_runs(name: str, tmp_path: Path) -> None:
    if name == "train_with_rllib":
        for package in ("ray", "tree", "lz4", "ormsgpack", "tensorboardX"):
            pytest.importorskip(package, reason=f"RLlib needs {package}, which is not installed")
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", EXAMPLES / f"{name}.py", *SMALL[name]],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        # Ray gives its own processes half a minute to begin, which a busy machine does not keep
        env={**os.environ, "RAY_raylet_start_wait_time_s": "300"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout and "nan" not in done.stdout
    if name == "train_with_rllib":  # which gives advice about itself
        assert "Traceback" not in done.stderr
    else:
        assert not done.stderr
    if name == "custom_reward":
        assert (tmp_path / "reward.png").stat().st_size > 1000
