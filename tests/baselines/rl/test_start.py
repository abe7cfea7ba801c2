"""``drm train --start``: a shipped student goes on learning by reinforcement."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from drm_baselines import load_policy
from drm_baselines.cli import app
from drm_baselines.errors import RunError
from drm_baselines.evaluation.environments import environment_config
from drm_baselines.evaluation.episodes import fly_policy
from drm_baselines.policies.pilots import shipped_run
from drm_baselines.rl.hyperparameters import Hyperparameters, from_data
from drm_baselines.rl.request import SilentWatcher, TrainingRequest
from drm_baselines.rl.start import settings_of_start, task_of_start
from drm_baselines.rl.training import train
from drm_baselines.support.seeds import CURVE_SEED

STUDENT = shipped_run("dagger")
SMALL = {
    "ppo": {"n_steps": 16, "batch_size": 32, "n_epochs": 1},
    "sac": {"buffer_size": 1000, "learning_starts": 40, "batch_size": 16, "train_freq": 4},
    "tqc": {"buffer_size": 1000, "learning_starts": 40, "batch_size": 16, "train_freq": 4},
    "td3": {"buffer_size": 1000, "learning_starts": 40, "batch_size": 16, "train_freq": 4},
    "crossq": {"buffer_size": 1000, "learning_starts": 40, "batch_size": 16, "train_freq": 4},
    "recurrent_ppo": {"n_steps": 16, "batch_size": 32, "n_epochs": 1},
}


def settings(algorithm: str) -> Hyperparameters:
    return from_data(
        {"algorithm": algorithm, "n_envs": 4, "learning_rate": 1e-4,
         "env": {"control_period": 0.1}, "model": SMALL[algorithm],
         "network": {"layers": [8], "activation": "relu"}}
    )  # fmt: skip


def request(algorithm: str, **changes: Any) -> TrainingRequest:
    env_id, options = task_of_start(STUDENT, None, {"horizon": 3.0})
    whole = {
        "algorithm": algorithm, "env_id": env_id, "options": options, "steps": 128, "seed": 1,
        "settings": settings_of_start(STUDENT, settings(algorithm)), "evaluations": 1,
        "evaluation_episodes": 4, "start": STUDENT,
    }  # fmt: skip
    return TrainingRequest(**{**whole, **changes})


def test_task_and_network_are_the_student_s() -> None:
    student = load_policy(STUDENT)
    asked = request("ppo")
    assert (asked.env_id, asked.settings.env) == (student.env_id, {})
    assert asked.settings.network.layers == (128, 128)
    assert asked.settings.network.activation == "tanh"
    config = environment_config(asked.env_id, asked.options)
    assert (config.task.control_period, config.scenario.horizon) == (0.02, 3.0)
    # what the user names wins
    assert task_of_start(STUDENT, "drm_env/Slew-v1", {"horizon": 2.0}) == (
        "drm_env/Slew-v1",
        {"horizon": 2.0},
    )


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "tqc", "td3"])
def test_the_first_policy_is_the_student_and_it_learns_on(tmp_path: Path, algorithm: str) -> None:
    watcher = SilentWatcher()
    asked = request(algorithm)
    record = train(tmp_path / "run", asked, watcher=watcher)
    student = load_policy(STUDENT)
    config = environment_config(asked.env_id, asked.options)
    flown = fly_policy(student, asked.env_id, config, seed=CURVE_SEED, episodes=4, label="student")
    first = watcher.points[0]
    assert first.steps == 0
    expected = flown.metrics["tip_error_rms"]
    # PPO's actor is the student; the others squash its small actions by a hyperbolic tangent
    tolerance = 1e-9 if algorithm == "ppo" else 0.1
    np.testing.assert_allclose(first.episodes.metrics["tip_error_rms"], expected, rtol=tolerance)
    assert record.start is not None
    assert record.start["weights_sha256"] == student.description["weights_sha256"]
    trained = load_policy(tmp_path / "run")
    assert trained.description["weights_sha256"] != student.description["weights_sha256"]
    assert trained.network.output == ("clip" if algorithm == "ppo" else "tanh")


@pytest.mark.parametrize("algorithm", ["crossq", "recurrent_ppo"])
def test_who_cannot_go_on_says_so_and_writes_nothing(tmp_path: Path, algorithm: str) -> None:
    with pytest.raises(RunError, match="cannot go on from a policy"):
        train(tmp_path / "run", request(algorithm))
    assert not (tmp_path / "run" / "run.json").exists()


def test_a_squashed_policy_is_nothing_for_ppo(tmp_path: Path) -> None:
    sac = shipped_run("sac")
    env_id, options = task_of_start(sac, None, {})
    asked = request(
        "ppo", start=sac, env_id=env_id, options=options,
        settings=settings_of_start(sac, settings("ppo")),
    )  # fmt: skip
    with pytest.raises(RunError, match="whose output is clipped, this one's is 'tanh'"):
        train(tmp_path / "run", asked)


def test_the_command_needs_no_more_than_the_directory(tmp_path: Path) -> None:
    out, path = tmp_path / "run", tmp_path / "sac.toml"
    run = CliRunner().invoke(
        app,
        ["train", "--start", str(STUDENT), "--steps", "512", "--n-envs", "2", "--set",
         "horizon=1.0", "--evaluations", "1", "--evaluation-episodes", "2", "--out", str(out)],
    )  # fmt: skip
    assert run.exit_code == 0, run.output
    content = json.loads((out / "run.json").read_text())
    assert content["config"]["task"]["control_period"] == 0.02
    assert content["hyperparameters"]["network"]["layers"] == [128, 128]
    with (out / "evaluations.csv").open(newline="") as stream:
        assert int(next(csv.DictReader(stream))["steps"]) == 0
    path.write_text(
        'algorithm = "sac"\nn_envs = 2\nlearning_rate = 1e-4\n[network]\nlayers = [8]\n'
    )
    wrong = CliRunner().invoke(
        app, ["train", "--algo", "sac", "--start", str(STUDENT), "--hyperparameters", str(path),
              "--steps", "64", "--out", str(tmp_path / "other")],
    )  # fmt: skip
    assert wrong.exit_code == 2
    assert "the policy has layers" in wrong.output.replace("\n", " ")
