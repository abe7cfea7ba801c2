"""Directories that one command at a time works in, and what is unfinished in them.

Whoever works in a directory holds a lock there, which the system takes back when the process ends
in whatever way, and leaves a note of what is done and by whom. The note goes when the work is
finished: so work that was interrupted or killed is known, and the same command may take it up
again without being told to overwrite it.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drm_baselines.errors import BaselineError, BusyError, ExistingResultError
from drm_baselines.support import storage
from drm_baselines.support.extras import needing
from drm_baselines.support.reading import read_table

NOTE_FILE = storage.NOTE_FILE
LOCK_FILE = storage.LOCK_FILE
FORMAT = "drm-work"


@dataclass
class Work:
    """What is done in a directory.

    Attributes
    ----------
    command
        Such as ``"drm imitate"``.
    settings
        What else must be the same for the work to be taken up again; as JSON can hold it.
    finished
        Whether it is finished once the block is left without an error.
    """

    command: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    finished: bool = True

    def is_noted(self, directory: Path) -> bool:
        """Return whether the same work was begun in a directory, and is not finished."""
        note = noted(directory)
        return (
            note is not None
            and note.get("command") == self.command
            and note.get("settings") == storage.plain(dict(self.settings))
        )


def noted(directory: Path) -> dict[str, Any] | None:
    """Return the note of unfinished work in a directory, if there is one that can be read."""
    try:
        note = read_table(directory / NOTE_FILE, "note of unfinished work")
    except BaselineError:
        return None
    return note if note.get("format") == FORMAT else None


def check(directory: Path, work: Work, *, force: bool = False) -> None:
    """Refuse a directory that :func:`working` would refuse, without making or changing it.

    Raises
    ------
    BusyError
        Another process works there.
    ExistingResultError
        It holds something that is not this work, unfinished, and ``force`` is false.
    """
    if (directory / LOCK_FILE).is_file():
        with alone(directory, work):
            pass
    if directory.is_dir() and not force and work.is_noted(directory):
        return
    note = noted(directory)
    if note is not None and not force and note.get("command") == work.command:
        raise ExistingResultError(
            f"{directory} holds an unfinished {work.command} with other settings; give the same "
            "ones to take it up again, --force to replace its files, or another directory"
        )
    storage.check_directory(directory, force=force)


@contextlib.contextmanager
def working(directory: Path, work: Work, *, force: bool = False) -> Iterator[bool]:
    """Claim a directory for some work; yield whether the same work was begun there before.

    Raises
    ------
    BusyError, ExistingResultError
        As :func:`check`.
    WriteError
        The directory cannot be made, or nothing can be written there.
    """
    check(directory, work, force=force)
    with alone(directory, work):
        again = work.is_noted(directory)
        if not again:
            storage.claim_directory(directory, force=force)
        storage.sweep(directory)
        _note(directory, work)
        yield again
        if work.finished:
            (directory / NOTE_FILE).unlink(missing_ok=True)


@contextlib.contextmanager
def noting(
    directory: Path, work: Work, *, before: Callable[[], object] | None = None
) -> Iterator[None]:
    """Hold a directory, noted as this work meanwhile; however it ends, the note goes.

    For work whose own records say how far it is. ``before`` is called when the directory is held
    and nothing has changed yet.

    Raises
    ------
    BusyError, WriteError
        As :func:`alone`.
    """
    with alone(directory, work):
        if before is not None:
            before()
        _note(directory, work)
        try:
            yield
        finally:
            (directory / NOTE_FILE).unlink(missing_ok=True)


@contextlib.contextmanager
def alone(directory: Path, work: Work) -> Iterator[None]:
    """Hold a directory, made if it is missing, and refuse one that another process holds.

    Raises
    ------
    BusyError
        It works there; the message names it.
    WriteError
        Nothing can be written there.
    """
    with needing(work.command, "cli"):
        import filelock
    path = directory / LOCK_FILE
    lock = filelock.FileLock(path, timeout=0)
    with storage.writing(path):
        directory.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire()
        except filelock.Timeout:
            raise BusyError(_who(directory)) from None
    try:
        yield
    finally:
        lock.release()


def _note(directory: Path, work: Work) -> None:
    content = {
        "format": FORMAT,
        "command": work.command,
        "settings": dict(work.settings),
        "process": os.getpid(),
        "host": socket.gethostname(),
        "began": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    storage.write_json(directory / NOTE_FILE, content, overwrite=True)


def _who(directory: Path) -> str:
    note = noted(directory)
    who = "another process"
    if note is not None:
        who = (
            f"{note.get('command')} (process {note.get('process')} on {note.get('host')}, since "
            f"{note.get('began')})"
        )
    return f"{directory} is in use by {who}: wait for its end, or take another directory"
