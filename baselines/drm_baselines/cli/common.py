"""What all commands share: options given as text, errors without tracebacks, progress bars."""

from __future__ import annotations

import contextlib
import functools
import json
import re
import sys
from collections.abc import Callable, Iterator
from typing import Any, ParamSpec, TypeVar

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

import drm_env
from drm_baselines.errors import BaselineError

# A file or a pipe has no width of its own: tables then come at full width.
console = Console(width=None if sys.stdout.isatty() else 132)
errors = Console(stderr=True)

SET_HELP = (
    "Environment option as KEY=VALUE, SI units and radians (drm info --options lists them). "
    "A number or name fixes it, LOW..HIGH draws it uniformly for each episode, JSON says "
    "anything else, such as '{\"log_uniform\": [10, 1000]}'. May be repeated."
)

_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"(?P<low>{_NUMBER})\.\.(?P<high>{_NUMBER})")

_P = ParamSpec("_P")
_R = TypeVar("_R")


def guarded(command: Callable[_P, _R]) -> Callable[_P, _R]:
    """Turn errors that a user can act on into one line on standard error and exit code 2."""

    @functools.wraps(command)
    def run(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        try:
            return command(*args, **kwargs)
        except (BaselineError, drm_env.DrmError, OSError) as error:
            errors.print(f"[bold red]error:[/] {escape(str(error))}", soft_wrap=True)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            errors.print("interrupted")
            raise typer.Exit(130) from None

    return run


def parse_value(text: str) -> Any:
    """Return the value that a text on the command line stands for.

    ``LOW..HIGH`` is a tuple (a range), JSON is what it says, anything else is a name.
    """
    match = _RANGE.fullmatch(text)
    if match:
        return float(match["low"]), float(match["high"])
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def parse_options(items: list[str] | None) -> dict[str, Any]:
    """Return environment options from ``KEY=VALUE`` texts.

    Raises
    ------
    BaselineError
        A text without ``=``, or a key given twice.
    """
    options: dict[str, Any] = {}
    for item in items or []:
        key, equals, text = item.partition("=")
        key = key.strip()
        if not equals or not key:
            raise BaselineError(f"--set takes KEY=VALUE, got {item!r}")
        if key in options:
            raise BaselineError(f"--set {key} is given twice")
        options[key] = parse_value(text.strip())
    return options


@contextlib.contextmanager
def progress_bar() -> Iterator[Progress]:
    """Yield a progress display on standard error, silent when that is not a terminal."""
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
        console=errors,
        disable=not sys.stderr.isatty(),
        transient=True,
    ) as progress:
        yield progress


@contextlib.contextmanager
def flight_progress() -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function that shows (label, done, total) episodes as one bar a label."""
    with progress_bar() as progress:
        tasks: dict[str, Any] = {}

        def show(label: str, done: int, total: int) -> None:
            if label not in tasks:
                tasks[label] = progress.add_task(label, total=total, note="episodes")
            progress.update(tasks[label], completed=done, total=total)

        yield show
