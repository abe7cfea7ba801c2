"""Writing results so that an interruption never leaves half a file, and never over old ones.

Each file is written to a temporary name in the same folder, brought to the disk, and renamed when
it is complete. A process that is killed leaves its temporary file behind; the next process that
writes into the folder removes it. Existing files are only replaced when the caller says so. Numbers
that JSON does not know (NaN, infinity) become null, so that any JSON reader can load the files.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import json
import math
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from drm_baselines.errors import ExistingResultError, RunError, WriteError
from drm_baselines.support.liveness import is_alive, machine_mark

LOCK_FILE = ".drm.lock"
"""Held by whoever works in a directory."""
NOTE_FILE = ".drm.work.json"
"""Says what is unfinished in a directory; see :mod:`drm_baselines.support.workplace`."""

_OWN = ".drm-"
"""What the names of temporary files begin with; machine and process follow."""
_TEMPORARY = re.compile(rf"{re.escape(_OWN)}(?P<machine>[0-9a-f]{{8}})-(?P<process>[0-9]+)-.*")
_swept: set[Path] = set()


def refuse(path: Path) -> NoReturn:
    """Raise the error for a result that is there already."""
    raise ExistingResultError(f"{path} exists already; give --force or another place")


@contextlib.contextmanager
def atomic_path(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Yield a temporary path with the same suffix; rename it to ``path`` on success.

    Raises
    ------
    ExistingResultError
        ``path`` exists and ``overwrite`` is false.
    WriteError
        The system refuses: no room, no permission. What was in ``path`` is still there.
    """
    if path.exists() and not overwrite:
        refuse(path)
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep_once(path.parent)
        handle, name = tempfile.mkstemp(
            dir=path.parent,
            prefix=f"{_OWN}{machine_mark()}-{os.getpid()}-",
            suffix=path.suffix or ".tmp",
        )
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            # mkstemp makes files private to the user; results are ordinary files.
            umask = os.umask(0)
            os.umask(umask)
            temporary.chmod(0o666 & ~umask)
            _bring_to_disk(temporary)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def _bring_to_disk(path: Path) -> None:
    """Have the system write a file, or it may be renamed and empty when the power fails."""
    handle = os.open(path, os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def is_temporary(name: str) -> bool:
    """Return whether a file's name is one that :func:`atomic_path` gives."""
    return _TEMPORARY.fullmatch(name) is not None


def sweep(directory: Path) -> list[Path]:
    """Remove temporary files of processes of this machine that are dead; return them.

    Those of another machine stay: whether their process lives cannot be known here.
    """
    found = []
    with contextlib.suppress(OSError):
        for path in directory.iterdir():
            name = _TEMPORARY.fullmatch(path.name)
            if (
                name is None
                or name["machine"] != machine_mark()
                or is_alive(int(name["process"]))
                or path.is_symlink()
                or not path.is_file()
            ):
                continue
            path.unlink(missing_ok=True)
            found.append(path)
    return found


def _sweep_once(directory: Path) -> None:
    """Sweep a directory the first time that this process writes there."""
    place = directory.absolute()
    if place not in _swept:
        _swept.add(place)
        sweep(directory)


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system refuses into an error that names ``path``.

    Raises
    ------
    WriteError
        No room, no permission, no such place.
    """
    try:
        yield
    except OSError as error:
        raise WriteError(f"{path} cannot be written: {error.strerror or error}") from error


def write_text(path: Path, text: str, *, overwrite: bool = False) -> Path:
    """Write ``text`` (UTF-8) to ``path`` in one rename; return ``path``."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]], *, overwrite: bool = False) -> Path:
    """Write rows that have the same columns as CSV in one rename; return ``path``."""
    with (
        atomic_path(path, overwrite=overwrite) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return path


def plain(value: Any) -> Any:
    """Return ``value`` as JSON can hold it: arrays to lists, NaN and infinity to ``None``."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return value


def write_json(path: Path, content: Any, *, overwrite: bool = False) -> Path:
    """Write ``content`` as indented JSON without NaN; return ``path``."""
    text = json.dumps(plain(content), indent=2, allow_nan=False) + "\n"
    return write_text(path, text, overwrite=overwrite)


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], digest: str) -> Path:
    """Write arrays to a NumPy archive without pickles, replacing an older one; return ``path``.

    ``digest`` says what they were made with: see :func:`load_arrays`.
    """
    content: dict[str, Any] = {"digest": np.array(digest), **arrays}
    with atomic_path(path, overwrite=True) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **content)
    return path


def load_arrays(path: Path, digest: str) -> dict[str, NDArray[Any]] | None:
    """Read arrays back; none if the file is missing or was made with another ``digest``.

    Raises
    ------
    RunError
        The file is damaged.
    """
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as archive:
            if str(archive["digest"]) != digest:
                return None
            return {name: archive[name] for name in archive.files if name != "digest"}
    except Exception as error:
        # whatever a damaged archive makes zipfile, zlib and NumPy raise: there is no end of it
        raise RunError(f"{path} cannot be read: {error}; delete it to make it anew") from error


def _is_foreign(path: Path) -> bool:
    """Whether a file is something that would be lost, and not this project's own housekeeping."""
    return path.name not in (LOCK_FILE, NOTE_FILE) and not is_temporary(path.name)


def check_directory(directory: Path, *, force: bool = False) -> None:
    """Refuse a directory that :func:`claim_directory` refuses, without making it.

    Raises
    ------
    ExistingResultError
        The path is a file, or holds something already and ``force`` is false.
    """
    if directory.exists() and not directory.is_dir():
        raise ExistingResultError(f"{directory} is a file, not a directory")
    if directory.is_dir() and not force and any(map(_is_foreign, directory.iterdir())):
        raise ExistingResultError(
            f"{directory} is not empty; give --force to replace its files, or another directory"
        )


def claim_directory(directory: Path, *, force: bool = False) -> Path:
    """Make ``directory`` for new results; an existing one must be empty or ``force`` given.

    Raises
    ------
    ExistingResultError
        The path is a file, or holds something already.
    WriteError
        It cannot be made, or nothing can be written there.
    """
    check_directory(directory, force=force)
    with writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    return directory


def remove_tree(directory: Path) -> None:
    """Remove a directory with everything in it, if it is there.

    Raises
    ------
    WriteError
        The system refuses.
    """
    with writing(directory):
        if directory.is_dir() and not directory.is_symlink():
            shutil.rmtree(directory)


def claim_file(path: Path, *, force: bool = False) -> Path:
    """Check, before long work, that ``path`` can be written when it is done; return ``path``.

    Raises
    ------
    ExistingResultError
        The path is a directory, or a file is there and ``force`` is not given.
    WriteError
        Nothing can be written there.
    """
    if path.is_dir():
        raise ExistingResultError(f"{path} is a directory, not a file")
    if path.exists() and not force:
        refuse(path)
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    return path


def sha256_of(path: Path) -> str:
    """Return the SHA-256 digest of a file as hexadecimal text."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
