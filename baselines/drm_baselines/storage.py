"""Writing results so that an interruption never leaves half a file, and never over old ones.

Each file is written to a temporary name in the same folder and renamed when it is complete.
Existing files are only replaced when the caller says so. Numbers that JSON does not know (NaN,
infinity) become null, so that any JSON reader can load the files.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import ExistingResultError, RunError, WriteError


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
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.stem[:100]}-", suffix=path.suffix or ".tmp"
        )
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            # mkstemp makes files private to the user; results are ordinary files.
            umask = os.umask(0)
            os.umask(umask)
            temporary.chmod(0o666 & ~umask)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


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
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise RunError(f"{path} cannot be read: {error}; delete it to make it anew") from error


def check_directory(directory: Path, *, force: bool = False) -> None:
    """Refuse a directory that :func:`claim_directory` refuses, without making it.

    Raises
    ------
    ExistingResultError
        The path is a file, or holds something already and ``force`` is false.
    """
    if directory.exists() and not directory.is_dir():
        raise ExistingResultError(f"{directory} is a file, not a directory")
    if directory.is_dir() and any(directory.iterdir()) and not force:
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


_DISTRIBUTIONS = (
    "numpy",
    "scipy",
    "gymnasium",
    "stable-baselines3",
    "torch",
    "safetensors",
)


def versions() -> dict[str, str]:
    """Return the installed version of each package that can change a result."""
    import drm_baselines

    found = {
        "drm-env": drm_env.__version__,
        "drm-baselines": drm_baselines.__version__,
        "python": platform.python_version(),
    }
    for name in _DISTRIBUTIONS:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def git_commit() -> str | None:
    """Return the commit of the source checkout this package runs from, if it is one.

    A ``-dirty`` suffix says that tracked files differ from the commit.
    """
    here = Path(__file__).resolve().parent
    command = ["git", "-C", str(here), "describe", "--always", "--abbrev=40", "--dirty"]
    try:
        # An installed copy inside somebody else's repository must not report their commit.
        subprocess.run(
            ["git", "-C", str(here), "ls-files", "--error-unmatch", Path(__file__).name],
            check=True,
            capture_output=True,
            timeout=10,
        )
        answer = subprocess.run(command, check=True, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip() or None


def provenance() -> dict[str, Any]:
    """Return what is needed to tell where a result came from: versions, platform, commit."""
    return {
        "versions": versions(),
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cpu_count": os.cpu_count(),
        "git_commit": git_commit(),
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]] if sys.argv else [],
    }
