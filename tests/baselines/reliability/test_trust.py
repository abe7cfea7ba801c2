"""A checkpoint is a pickle: it is loaded only if this user wrote it, or says --trust."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import zipfile
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from drm_baselines.cli import app
from drm_baselines.errors import BusyError, ExistingResultError, RunError
from drm_baselines.rl.hyperparameters import from_data
from drm_baselines.rl.request import TrainingRequest
from drm_baselines.rl.run_record import load_run
from drm_baselines.rl.training import resume, train
from drm_baselines.support import storage, trust, workplace

SETTINGS = {
    "ppo": {
        "algorithm": "ppo", "n_envs": 4, "learning_rate": 1e-3,
        "model": {"n_steps": 16, "batch_size": 32, "n_epochs": 1},
        "network": {"layers": [8], "activation": "tanh"},
    },
    "sac": {
        "algorithm": "sac", "n_envs": 4, "learning_rate": 1e-3,
        "model": {"buffer_size": 1000, "learning_starts": 40, "batch_size": 16, "train_freq": 4},
        "network": {"layers": [8], "activation": "relu"},
    },
}  # fmt: skip


def request(algorithm: str = "ppo", **changes: Any) -> TrainingRequest:
    arguments: dict[str, Any] = {
        "algorithm": algorithm, "env_id": "drm_env/SlewResidual-v0", "options": {"horizon": 0.4},
        "steps": 128, "seed": 1, "settings": from_data(SETTINGS[algorithm]), "evaluations": 2,
        "evaluation_episodes": 4,
    }  # fmt: skip
    return TrainingRequest(**{**arguments, **changes})


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A finished run of each algorithm."""
    place = tmp_path_factory.mktemp("runs")
    for name in SETTINGS:
        train(place / name, request(name))
    return {name: place / name for name in SETTINGS}


@pytest.fixture
def run(made: dict[str, Path], tmp_path: Path) -> Path:
    return shutil.copytree(made["ppo"], tmp_path / "run")


class _Payload:
    """What a stranger puts into a checkpoint: it runs when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return os.mkdir, (str(self.mark),)


def poisoned(directory: Path, mark: Path, kind: str = "model") -> None:
    """Replace a checkpoint by one that runs code, with a record that agrees with it."""
    record = json.loads((directory / "run.json").read_text())
    entry = record["checkpoint"][kind]
    path = directory / entry["file"]
    content = pickle.dumps(_Payload(mark))
    if kind == "model":
        import base64

        with zipfile.ZipFile(path) as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
        data = json.loads(files["data"])
        for value in data.values():
            if isinstance(value, dict) and ":serialized:" in value:
                value[":serialized:"] = base64.b64encode(content).decode()
        files["data"] = json.dumps(data).encode()
        with zipfile.ZipFile(path, "w") as archive:
            for name, text in files.items():
                archive.writestr(name, text)
    else:
        path.write_bytes(content)
    entry["sha256"] = storage.sha256_of(path)
    (directory / "run.json").write_text(json.dumps(record))


@pytest.mark.parametrize(("algorithm", "kind"), [("ppo", "model"), ("sac", "replay_buffer")])
@pytest.mark.parametrize("seal", ["kept", "missing", "wrong", "of another user"])
def test_a_stranger_who_writes_checkpoint_and_record_runs_nothing(
    made: dict[str, Path], tmp_path: Path, algorithm: str, kind: str, seal: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    directory = shutil.copytree(made[algorithm], tmp_path / "run")
    mark = tmp_path / "code was run"
    poisoned(directory, mark, kind)
    record = json.loads((directory / "run.json").read_text())
    entry = record["checkpoint"][kind]
    if seal == "missing":
        del entry["seal"]
    elif seal == "wrong":
        entry["seal"] = "0" * 64
    elif seal == "of another user":
        with monkeypatch.context() as patch:
            patch.setenv("XDG_STATE_HOME", str(tmp_path / "stranger"))
            entry["seal"] = trust.seal(entry["sha256"])
    (directory / "run.json").write_text(json.dumps(record))
    before = {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()}
    with pytest.raises(RunError, match=r"was not written by you on this machine.*--trust"):
        resume(directory, steps=256)
    assert not mark.exists()
    after = {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()}
    after.pop(directory / ".drm.lock", None)
    before.pop(directory / ".drm.lock", None)
    assert after == before


def test_the_poison_is_one(made: dict[str, Path], tmp_path: Path) -> None:
    """What the other tests keep out would have run: with --trust it does."""
    directory = shutil.copytree(made["ppo"], tmp_path / "run")
    mark = tmp_path / "code was run"
    poisoned(directory, mark)
    with pytest.raises(Exception, match=r".*"):  # whatever comes of a model made of nothing
        resume(directory, steps=256, trust=True)
    assert mark.exists()


def test_ones_own_run_goes_on_wherever_it_was_moved(run: Path) -> None:
    assert resume(run, steps=192).steps >= 192


def test_a_run_of_another_machine_needs_trust(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "elsewhere"))
    arguments = ["train", "--resume", "--out", str(run), "--steps", "192"]
    refused = CliRunner().invoke(app, arguments)
    assert refused.exit_code == 2 and "--trust" in refused.stderr
    taken = CliRunner().invoke(app, [*arguments, "--trust"])
    assert taken.exit_code == 0, taken.stderr
    assert "--trust is for --resume" in CliRunner().invoke(
        app, ["train", "--out", str(tmp_path / "new"), "--trust"]
    ).stderr  # fmt: skip
    # from now on it is this machine's
    assert resume(run, steps=256).steps >= 256


@pytest.mark.parametrize(
    "file",
    [
        "/etc/passwd", "../other/checkpoints/model_1.zip", "checkpoints/../../model_1.zip",
        "checkpoints/model_1.zip/../../x", "model_1.zip", "checkpoints\\model_1.zip", "",
        "checkpoints/model_1.zip\n", "checkpoints//model_1.zip", "C:/model_1.zip",
    ],
)  # fmt: skip
def test_a_checkpoint_outside_its_folder_is_refused(run: Path, file: str) -> None:
    record = json.loads((run / "run.json").read_text())
    record["checkpoint"]["model"]["file"] = file
    (run / "run.json").write_text(json.dumps(record))
    with pytest.raises(RunError, match=r"checkpoint\.model\.file must be a file in checkpoints/"):
        resume(run, steps=256, trust=True)


@pytest.mark.parametrize("whole", [False, True])
def test_links_to_checkpoints_are_not_followed(run: Path, tmp_path: Path, whole: bool) -> None:
    name = load_run(run).checkpoint["model"]["file"]  # type: ignore[index]  # there is one
    place = run / "checkpoints" if whole else run / name
    place.rename(tmp_path / "elsewhere")
    place.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RunError, match="is a link"):
        resume(run, steps=256, trust=True)


def test_the_secret_is_drawn_once_and_private(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    digest = "0" * 64
    assert not trust.is_sealed(digest, None)
    assert not trust.secret_file().exists(), "looking draws none"
    first = trust.seal(digest)
    assert trust.is_sealed(digest, first)
    assert first == trust.seal(digest) != trust.seal("1" * 64)
    path = trust.secret_file()
    assert path.stat().st_mode & 0o077 == 0
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    path.chmod(0o644)
    assert not trust.is_sealed(digest, first), "somebody else may have read it"


def test_without_a_place_for_the_secret_runs_are_trained_unsealed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    with pytest.warns(UserWarning, match="cannot be kept.*--trust"):
        train(tmp_path / "run", request(steps=64))
    with pytest.raises(RunError, match="--trust"):
        resume(tmp_path / "run", steps=128)
    with pytest.warns(UserWarning, match="cannot be kept"):
        assert resume(tmp_path / "run", steps=128, trust=True).steps >= 128


def test_two_at_once_are_refused(run: Path, tmp_path: Path) -> None:
    with workplace.noting(run, workplace.Work("drm train")):
        with pytest.raises(BusyError, match=rf"in use by drm train \(process {os.getpid()}"):
            resume(run, steps=256)
        with pytest.raises(BusyError):
            train(run, request(), force=True)
        result = CliRunner().invoke(app, ["train", "--resume", "--out", str(run), "--steps", "256"])
    assert result.exit_code == 2
    assert "in use by drm train" in result.stderr
    assert load_run(run).steps == load_run(run).target_steps == 128


def test_a_run_without_a_checkpoint_begins_anew(tmp_path: Path) -> None:
    whole = train(tmp_path / "whole", request())
    directory = tmp_path / "run"
    train(directory, request())
    record = json.loads((directory / "run.json").read_text())
    record.update(checkpoint=None, steps=0, status="running")
    (directory / "run.json").write_text(json.dumps(record))  # as after a kill before the first save
    again = resume(directory)
    assert (again.steps, again.status, len(again.segments)) == (whole.steps, "finished", 1)
    digests = [
        json.loads((tmp_path / name / "policy.json").read_text())["weights_sha256"]
        for name in ("whole", "run")
    ]
    assert digests[0] == digests[1]
    with pytest.raises(ExistingResultError, match="not empty"):
        train(directory, request())
    # nor is --force needed to train something else in its place
    (directory / "run.json").write_text(json.dumps(record))
    assert train(directory, request(steps=64)).steps == 64
