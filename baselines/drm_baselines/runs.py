"""The record of a training run: everything that is needed to repeat, resume or judge it.

A run lives in one directory:

    run.json            what was trained, how, where, how far (rewritten as it goes on)
    policy.safetensors  weights of the newest policy      policy.json  their description
    evaluations.csv     learning curve: metrics over steps and wall time
    checkpoints/        Stable-Baselines3's own files, for resuming this run only
    tensorboard/        event files

The checkpoint files are pickles: they are read on resuming alone, and only if their digest is the
one that the run itself wrote down.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from drm_baselines import storage
from drm_baselines.errors import RunError

RUN_FILE = "run.json"
EVALUATIONS_FILE = "evaluations.csv"
FORMAT = "drm-run"
FORMAT_VERSION = 1


@dataclass(kw_only=True)
class RunRecord:
    """Contents of ``run.json``; see the fields' names, times in s.

    ``options`` are the environment options as given, ``config`` the complete configuration they
    led to. ``segments`` holds one entry for each stretch of training (a resumed run has several),
    with versions, platform and the seed its environments began with.
    """

    algorithm: str
    env_id: str
    options: dict[str, Any]
    config: dict[str, Any]
    control_period: float
    hyperparameters: dict[str, Any]
    seed: int
    target_steps: int
    steps: int = 0
    wall_time: float = 0.0
    status: str = "running"
    checkpoint: dict[str, Any] | None = None
    segments: list[dict[str, Any]] = field(default_factory=list)

    def save(self, directory: Path) -> None:
        """Write ``run.json`` into ``directory`` in one rename."""
        content = {"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(self)}
        storage.write_json(directory / RUN_FILE, content, overwrite=True)


def load_run(directory: str | Path) -> RunRecord:
    """Read the record of a run.

    Raises
    ------
    RunError
        No such directory, no record in it, or one that is damaged or of another version.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise RunError(f"no run directory {folder}")
    path = folder / RUN_FILE
    if not path.is_file():
        raise RunError(f"{folder} holds no {RUN_FILE}: it is not the directory of a training run")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise RunError(f"{path} cannot be read: {error}") from error
    if not isinstance(content, dict) or content.pop("format", None) != FORMAT:
        raise RunError(f"{path} is not the record of a training run")
    version = content.pop("format_version", None)
    if version != FORMAT_VERSION:
        raise RunError(
            f"{path} has format version {version!r}; this version of drm-baselines "
            f"reads {FORMAT_VERSION}"
        )
    try:
        return RunRecord(**content)
    except TypeError as error:
        raise RunError(f"{path} is damaged: {error}") from error


def checkpoint_file(directory: Path, record: RunRecord, kind: str = "model") -> Path:
    """Return the checkpoint's file after checking that it is the one this run wrote.

    ``kind`` is ``"model"`` or ``"replay_buffer"``.

    Raises
    ------
    RunError
        There is none, or its digest differs from the record's.
    """
    entry = (record.checkpoint or {}).get(kind)
    if entry is None:
        raise RunError(f"{directory} holds no {kind} checkpoint to resume from")
    path = directory / str(entry["file"])
    if not path.is_file():
        raise RunError(f"{path} is missing: the run cannot be resumed")
    if storage.sha256_of(path) != entry["sha256"]:
        raise RunError(f"{path} is not the file that this run wrote (its SHA-256 differs)")
    return path
