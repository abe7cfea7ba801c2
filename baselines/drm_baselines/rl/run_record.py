"""The record of a training run: everything that is needed to repeat, resume or judge it.

A run lives in one directory:

    run.json            what was trained, how, where, how far (rewritten as it goes on)
    policy.safetensors  weights of the newest policy      policy.json  their description
    evaluations.csv     learning curve: metrics over steps and wall time
    checkpoints/        Stable-Baselines3's own files, for resuming this run only
    tensorboard/        event files

The checkpoint files are pickles: they are read on resuming alone, and only if their digest is the
one that the run itself wrote down and this user has sealed it (:mod:`drm_baselines.support.trust`).
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import Any

from drm_baselines.errors import RunError
from drm_baselines.rl.algorithms import ALGORITHMS
from drm_baselines.support import storage
from drm_baselines.support.reading import read_table, shown
from drm_baselines.support.trust import is_sealed

RUN_FILE = "run.json"
EVALUATIONS_FILE = "evaluations.csv"
FORMAT = "drm-run"
FORMAT_VERSION = 1


@dataclass(kw_only=True)
class RunRecord:
    """Contents of ``run.json``; see the fields' names, times in s.

    ``options`` are the environment options as given, ``config`` the complete configuration they
    led to. ``evaluations`` and ``evaluation_episodes`` say how the learning curve is measured,
    ``start`` names the policy that the run began with, if there was one (directory and SHA-256 of
    its weights). ``segments`` holds one entry for each stretch of training (a resumed run has
    several), with versions, platform and the seed its environments began with.
    """

    algorithm: str
    env_id: str
    options: dict[str, Any]
    config: dict[str, Any]
    control_period: float
    hyperparameters: dict[str, Any]
    seed: int
    target_steps: int
    evaluations: int = 10
    evaluation_episodes: int = 100
    start: dict[str, Any] | None = None
    steps: int = 0
    wall_time: float = 0.0
    status: str = "running"
    checkpoint: dict[str, Any] | None = None
    segments: list[dict[str, Any]] = field(default_factory=list)

    def save(self, directory: Path) -> None:
        """Write ``run.json`` into ``directory`` in one rename."""
        content = {"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(self)}
        storage.write_json(directory / RUN_FILE, content, overwrite=True)


def _is_count(value: Any, least: int = 0) -> bool:
    return type(value) is int and least <= value < 2**53


def _is_time(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value) and 0.0 <= value < 2**53


def _is_checkpoint(value: Any) -> bool:
    return value is None or (
        isinstance(value, dict)
        and all(
            isinstance(entry, dict)
            and all(isinstance(entry.get(name), str) for name in ("file", "sha256"))
            and isinstance(entry.get("seal"), (str, type(None)))
            for entry in value.values()
        )
    )


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_table(value: Any) -> bool:
    return isinstance(value, dict)


_CHECKS: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "algorithm": (f"one of {', '.join(ALGORITHMS)}", lambda value: value in ALGORITHMS),
    "env_id": ("text", _is_text),
    "options": ("a table", _is_table),
    "config": ("a table", _is_table),
    "control_period": ("a positive time", lambda value: _is_time(value) and value > 0.0),
    "hyperparameters": ("a table", _is_table),
    "seed": ("a whole number from 0", _is_count),
    "target_steps": ("a whole number from 1", lambda value: _is_count(value, 1)),
    "evaluations": ("a whole number from 1", lambda value: _is_count(value, 1)),
    "evaluation_episodes": ("a whole number from 2", lambda value: _is_count(value, 2)),
    "start": ("a table or null", lambda value: value is None or _is_table(value)),
    "steps": ("a whole number from 0", _is_count),
    "wall_time": ("a time", _is_time),
    "status": ("text", _is_text),
    "checkpoint": ("null, or file and sha256 by kind", _is_checkpoint),
    "segments": (
        "a list of tables",
        lambda value: isinstance(value, list) and all(_is_table(item) for item in value),
    ),
}


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
    content = read_table(path, "record of a run", error=RunError)
    if content.pop("format", None) != FORMAT:
        raise RunError(f"{path} is not the record of a training run")
    version = content.pop("format_version", None)
    if version != FORMAT_VERSION:
        raise RunError(
            f"{path} has format version {shown(version)}; this version of drm-baselines "
            f"reads {FORMAT_VERSION}"
        )
    for name, (kind, fits) in _CHECKS.items():
        if name in content and not fits(content[name]):
            raise RunError(f"{path} is damaged: {name} must be {kind}, got {shown(content[name])}")
    try:
        return RunRecord(**content)
    except TypeError as error:
        raise RunError(f"{path} is damaged: {error}") from error


_CHECKPOINT = re.compile(r"checkpoints/(?:model|replay_buffer)_[0-9]+(?:_[0-9a-f]+)?\.(?:zip|pkl)")


def open_checkpoint(
    directory: Path, record: RunRecord, kind: str = "model", *, trust: bool = False
) -> BufferedReader:
    """Open a checkpoint after checking that it is the one this run wrote, and this user.

    What is opened is what was checked, whatever takes its name in the meantime.

    Parameters
    ----------
    directory, record
        Of the run.
    kind
        ``"model"`` or ``"replay_buffer"``.
    trust
        Whether a file that this user has not sealed is opened too.

    Raises
    ------
    RunError
        There is none, it lies outside the run's own folder of checkpoints, is a link, its digest
        differs from the record's, or nothing vouches for who made it.
    """
    entry = (record.checkpoint or {}).get(kind)
    if entry is None:
        raise RunError(f"{directory} holds no {kind} checkpoint to resume from")
    name = str(entry["file"])
    if not _CHECKPOINT.fullmatch(name):
        raise RunError(
            f"{directory / RUN_FILE} is damaged: checkpoint.{kind}.file must be a file in "
            f"checkpoints/, got {shown(name)}"
        )
    path = directory / name
    if path.parent.is_symlink() or path.is_symlink():
        raise RunError(f"{path} is a link: only a checkpoint in its own place is read")
    if not path.is_file():
        raise RunError(f"{path} is missing: the run cannot be resumed")
    stream = path.open("rb")
    try:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
        if digest != entry["sha256"]:
            raise RunError(f"{path} is not the file that this run wrote (its SHA-256 differs)")
        if not trust and not is_sealed(digest, entry.get("seal")):
            raise RunError(
                f"{path} was not written by you on this machine, and loading a checkpoint runs "
                "whatever its maker wants; if you know who made it, give --trust"
            )
        stream.seek(0)
    except BaseException:
        stream.close()
        raise
    return stream
