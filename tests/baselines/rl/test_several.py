"""``drm train --seeds``: each seed's run is that of a training alone, wherever it is trained."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from drm_baselines import load_policy
from drm_baselines.errors import BaselineError, ExistingResultError
from drm_baselines.rl import several
from drm_baselines.rl.hyperparameters import from_data
from drm_baselines.rl.request import TrainingRequest
from drm_baselines.rl.run_record import load_run, open_checkpoint
from drm_baselines.rl.several import directory_of, parse_seeds, train_seeds
from drm_baselines.rl.training import train
from drm_baselines.support.executors import Here
from drm_baselines.support.places import Place

SETTINGS: dict[str, Any] = {
    "algorithm": "ppo", "n_envs": 4, "learning_rate": 1e-3,
    "model": {"n_steps": 16, "batch_size": 32, "n_epochs": 1},
    "network": {"layers": [8], "activation": "tanh"},
}  # fmt: skip


def request(**changes: Any) -> TrainingRequest:
    arguments: dict[str, Any] = {
        "algorithm": "ppo", "env_id": "drm_env/SlewResidual-v0", "options": {"horizon": 0.4},
        "steps": 128, "seed": 0, "settings": from_data(SETTINGS, "test"), "evaluations": 1,
        "evaluation_episodes": 4,
    }  # fmt: skip
    return TrainingRequest(**{**arguments, **changes})


def weights(directory: Path) -> list[np.ndarray]:
    network = load_policy(directory).network
    return [*network.weights, *network.biases]


def same(one: Path, two: Path) -> bool:
    return all(map(np.array_equal, weights(one), weights(two)))


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("alone")
    for seed in (0, 1):
        train(directory_of(directory, seed), request(seed=seed))
    assert not same(directory_of(directory, 0), directory_of(directory, 1))
    return directory


def test_one_after_another_is_as_alone(alone: Path, tmp_path: Path) -> None:
    records = train_seeds(tmp_path, request(), [1, 0])
    assert [record.status for record in records.values()] == ["finished"] * 2
    for seed in (0, 1):
        assert same(directory_of(tmp_path, seed), directory_of(alone, seed))


@pytest.mark.slow
def test_processes_train_the_same(alone: Path, tmp_path: Path) -> None:
    train_seeds(tmp_path, request(), [0, 1], place=Place(processes=2))
    for seed in (0, 1):
        assert same(directory_of(tmp_path, seed), directory_of(alone, seed))


class Elsewhere(Here):
    """Does jobs as workers do that do not see the files of this machine."""

    shares_files = False


def test_a_run_that_was_sent_is_whole_and_ones_own(alone: Path, tmp_path: Path) -> None:
    several._spread(tmp_path, request(), [1], Elsewhere(), None)
    run = directory_of(tmp_path, 1)
    assert same(run, directory_of(alone, 1))
    names = {path.relative_to(run).parts[0] for path in run.rglob("*")}
    assert {"run.json", "policy.json", "evaluations.csv", "checkpoints", "tensorboard"} <= names
    with open_checkpoint(run, load_run(run)) as stream:
        assert stream.read(2) == b"PK"
    assert [path.name for path in tmp_path.iterdir()] == ["seed_1"]


def test_what_is_finished_is_not_trained_again(tmp_path: Path) -> None:
    train_seeds(tmp_path, request(), [0])
    before = (directory_of(tmp_path, 0) / "run.json").stat().st_mtime_ns
    train_seeds(tmp_path, request(), [0, 1])
    assert (directory_of(tmp_path, 0) / "run.json").stat().st_mtime_ns == before
    with pytest.raises(ExistingResultError, match="target_steps 128, not 192"):
        train_seeds(tmp_path, request(steps=192), [0])


def test_an_interrupted_seed_is_trained_anew(alone: Path, tmp_path: Path) -> None:
    run = directory_of(tmp_path, 1)
    train(run, request(seed=1))
    record = load_run(run)
    record.status, record.steps = "interrupted", 64
    record.save(run)
    train_seeds(tmp_path, request(), [1])
    assert load_run(run).status == "finished" and load_run(run).steps == 128
    assert same(run, directory_of(alone, 1))


@pytest.mark.parametrize(
    ("text", "seeds"), [("0-3", [0, 1, 2, 3]), ("7", [7]), ("0,2,5-6", [0, 2, 5, 6])]
)
def test_seeds_as_text(text: str, seeds: list[int]) -> None:
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "a", "1-", "3-1", "1,1", "0-1000", "-1", "1.5"])
def test_seeds_that_are_none(text: str) -> None:
    with pytest.raises(BaselineError, match="seeds"):
        parse_seeds(text)


def test_a_cluster_does_not_see_a_policy_to_begin_with(tmp_path: Path) -> None:
    with pytest.raises(BaselineError, match="do not see the directory"):
        train_seeds(tmp_path, request(start=tmp_path), [0], place=Place(ray="local"))
