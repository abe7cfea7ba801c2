"""The one place where commands print.

Texts and table cells are shown as they are: brackets in a path are no markup, control characters
are made visible. Results go to standard output, notes and errors to standard error; while a
progress bar is shown on a terminal everything goes through its console, so that lines and bar do
not run into each other.

Output that cannot be written (a closed descriptor, a full disk, a pipe that nobody reads) does not
end a computation whose results are still to be saved: the rest of it is dropped, and the command
ends with an error.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

from rich.console import Console, RenderableType
from rich.text import Text

if TYPE_CHECKING:
    from rich.progress import Progress

_PIPE_WIDTH = 132
"""Columns of tables in a file or a pipe, which have no width of their own."""

_CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")


def visible(text: str) -> str:
    """Return a text whose control characters are written out, but for tabs and line ends."""
    return _CONTROLS.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


class Stream:
    """Standard output or standard error, which may be closed, full or a pipe that nobody reads.

    Attributes
    ----------
    failure
        What writing has failed with; nothing is written after it.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self.failure: OSError | None = None

    @property
    def _file(self) -> IO[str] | None:
        file = getattr(sys, self._name)
        # progress bars put a file of their own in its place
        return cast("IO[str] | None", getattr(file, "rich_proxied_file", file))

    @property
    def encoding(self) -> str:
        """The encoding of what is written."""
        return getattr(self._file, "encoding", None) or "utf-8"

    def isatty(self) -> bool:
        """Return whether this is a terminal."""
        file = self._file
        try:
            return file is not None and file.isatty()
        except (OSError, ValueError):
            return False

    def fileno(self) -> int:
        """Return the file descriptor.

        Raises
        ------
        OSError
            There is none.
        """
        if (file := self._file) is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        return file.fileno()

    def write(self, text: str) -> int:
        """Write a text; characters that the encoding does not have are written out."""
        if self.failure is None:
            encoding = self.encoding
            try:
                if (file := self._file) is None:
                    raise OSError(errno.EBADF, "it is closed")
                file.write(text.encode(encoding, "backslashreplace").decode(encoding))
            except OSError as error:
                self.failure = error
        return len(text)

    def flush(self) -> None:
        """Write what is kept back."""
        if self.failure is None and (file := self._file) is not None:
            try:
                file.flush()
            except OSError as error:
                self.failure = error

    def abandon(self) -> None:
        """After a failure: let the interpreter's last flush go nowhere, or it would fail again."""
        if self.failure is not None:
            with contextlib.suppress(OSError, ValueError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self.fileno())
                os.close(nowhere)


class _PlainConsole(Console):
    """A console to which every string is plain text, in tables too."""

    def __init__(self, stream: Stream) -> None:
        super().__init__(
            # what is left out of IO[str] no console uses
            file=cast("IO[str]", stream),
            width=None if stream.isatty() else _PIPE_WIDTH,
            markup=False,
            emoji=False,
            highlight=False,
        )

    def render_str(self, text: str, **options: Any) -> Text:
        """Return a text as it is shown."""
        return super().render_str(visible(text), **options)


output = Stream("stdout")
complaints = Stream("stderr")
console = _PlainConsole(output)
"""Results."""
errors = _PlainConsole(complaints)
"""Notes, errors, and progress where results are not shown on a terminal."""

_shown_on: list[Console] = []  # consoles of the progress bars that are shown


def show(*renderables: RenderableType, crop: bool = True) -> None:
    """Print tables and texts as results."""
    console.print(*renderables, crop=crop)


def say(text: str) -> None:
    """Print one line as a result, which is not broken."""
    console.print(text, soft_wrap=True)


def note(text: str | Text) -> None:
    """Print one line that is no result: to standard error, or above the progress bar."""
    on_screen = bool(_shown_on) and errors.is_terminal
    (_shown_on[-1] if on_screen else errors).print(text, soft_wrap=True)


def complain(text: str, kind: str = "error") -> None:
    """Print an error or a warning."""
    style = "bold red" if kind == "error" else "bold yellow"
    note(Text.assemble((f"{kind}:", style), " ", visible(text)))


def say_files(files: Sequence[Path]) -> None:
    """Name the files that were written, if there are any."""
    if files:
        say("wrote " + ", ".join(str(file) for file in files))


def say_json(content: Any) -> None:
    """Print a result as JSON, and nothing else."""
    from drm_baselines.support import storage

    output.write(json.dumps(storage.plain(content), indent=2, allow_nan=False) + "\n")
    output.flush()


@contextlib.contextmanager
def progress_bar() -> Iterator[Progress]:
    """Yield a progress display on the terminal, silent where there is none."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    screen = console if console.is_terminal else errors
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}", markup=False),
        console=screen,
        disable=not screen.is_terminal,
        transient=True,
    ) as progress:
        _shown_on.append(screen)
        try:
            yield progress
        finally:
            _shown_on.pop()


@contextlib.contextmanager
def counting(unit: str = "") -> Iterator[Callable[..., None]]:
    """Yield ``show(label, done, total, note=unit)``, which shows one bar a label.

    ``unit`` is what is counted, such as ``"episodes"``.
    """
    with progress_bar() as progress:
        tasks: dict[str, Any] = {}

        def update(label: str, done: int, total: int, note: str = unit) -> None:
            if label not in tasks:
                # what was there before took no time now: the estimate must not count it
                tasks[label] = progress.add_task(
                    visible(label), total=total, completed=done, note=note
                )
            progress.update(tasks[label], completed=done, total=total, note=note)

        yield update
