"""What all commands share: how they end, and options that are given as text."""

from __future__ import annotations

import functools
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import typer

from drm_baselines.cli.terminal import complain, complaints, note, output
from drm_baselines.errors import BaselineError
from drm_baselines.policies.names import ALIASES, listed, names_of
from drm_baselines.support.extras import needing
from drm_baselines.support.interruption import Stopped, handled_by, interrupt
from drm_baselines.support.reading import parse_json, shown

REFUSED = 2
"""Exit code of a request that cannot be carried out."""
INTERRUPTED = 130
"""Exit code after Ctrl-C; 129 and 143 follow SIGHUP and SIGTERM."""
BROKEN_PIPE = 141
"""Exit code where nobody reads the output to its end, such as ``drm info | head -1``."""

MOST_STEPS = 10**12
"""Most environment steps of a training: years on any machine."""
MOST_MANOEUVRES = 100_000
"""Most manoeuvres of a teacher or a search, which are all kept."""
MOST_ROUNDS = 10_000_000
"""Most rounds or gradient steps."""
MOST_TRIALS = 100_000
"""Most trials of a search, whose record is read as a whole."""

SET_HELP = (
    "Environment option as KEY=VALUE, SI units and radians (drm info --options lists them). "
    "A number or name fixes it, LOW..HIGH draws it uniformly for each episode, JSON says "
    "anything else, such as '{\"log_uniform\": [10, 1000]}'. May be repeated."
)
POLICY_HELP = f"{listed()}; of a learning method the first policy that comes with the package flies"
JSON_HELP = "Print the result as JSON, SI units and radians, and nothing else."


def complete_policy(incomplete: str) -> list[str]:
    """Return the names of policies that a shell may complete to; none of them: it takes files."""
    return [name for name in (*names_of(), *ALIASES) if name.startswith(incomplete)]


def complete_env(incomplete: str) -> list[str]:
    """Return the ids of environments that a shell may complete to."""
    import gymnasium as gym

    import drm_env  # noqa: F401  # registers the ids

    ids = [name for name, spec in gym.registry.items() if spec.namespace == "drm_env"]
    return [name for name in ids if name.startswith(incomplete)]


_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"(?P<low>{_NUMBER})\.\.(?P<high>{_NUMBER})")

_P = ParamSpec("_P")
_R = TypeVar("_R")


def _is_refusal(error: Exception) -> bool:
    """Whether an error is one that a user can act on, and not a fault of the program."""
    if isinstance(error, (BaselineError, OSError, MemoryError)):
        return True
    # an error of a package that was not imported cannot have come from it
    engine = sys.modules.get("drm_env.errors")
    pools = sys.modules.get("concurrent.futures.process")
    return (engine is not None and isinstance(error, engine.DrmError)) or (
        # a process that the system has killed, mostly for want of memory
        pools is not None and isinstance(error, pools.BrokenProcessPool)
    )


def _message(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return f"not enough memory: {error}".removesuffix(": ")
    if isinstance(error, OSError) and error.strerror is not None:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error)


def ending_well(action: Callable[[], _R]) -> _R:
    """Return what ``action`` does; turn errors that a user can act on into one line.

    Raises
    ------
    typer.Exit
        Refused (2), interrupted (128 and the signal's number), or the output was not written.
    """
    for stream in (output, complaints):
        stream.failure = None
    try:
        # commands ask for their packages first; this is for what they have not thought of
        with handled_by(interrupt), needing("this command"):
            result = action()
            output.flush()
    except KeyboardInterrupt as error:
        note("interrupted")
        raise typer.Exit(
            128 + error.number if isinstance(error, Stopped) else INTERRUPTED
        ) from None
    except Exception as error:
        if not _is_refusal(error):
            raise
        complain(_message(error))
        raise typer.Exit(REFUSED) from None
    if output.failure is not None:
        if isinstance(output.failure, BrokenPipeError):
            raise typer.Exit(BROKEN_PIPE)
        complain(f"standard output cannot be written: {_message(output.failure)}")
        raise typer.Exit(REFUSED)
    return result


def guarded(command: Callable[_P, _R]) -> Callable[_P, _R]:
    """Make a command end as :func:`ending_well` says."""

    @functools.wraps(command)
    def run(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        return ending_well(lambda: command(*args, **kwargs))

    return run


def json_target(as_json: bool, file: Path | None, rest: list[str]) -> tuple[bool, Path | None]:
    """Return whether JSON is printed, and into which file it is written.

    ``rest`` are the arguments that no option has taken: one after ``--json`` is the file that it
    took, in the commands that measure, before it was a flag everywhere.

    Raises
    ------
    BaselineError
        An argument without ``--json``.
    """
    if not rest:
        return as_json, file
    if not as_json or file is not None or len(rest) > 1:
        raise BaselineError(f"unexpected argument {shown(rest[0])}")
    complain("--json prints; --json-file FILE writes a file, as --json FILE did", "warning")
    return False, Path(rest[0])


def parse_value(text: str) -> Any:
    """Return the value that a text on the command line stands for.

    ``LOW..HIGH`` is a tuple (a range), JSON is what it says, anything else is a name.

    Raises
    ------
    BaselineError
        A number of hundreds of digits, or a text that begins like JSON and is none.
    """
    match = _RANGE.fullmatch(text)
    if match:
        return float(match["low"]), float(match["high"])
    try:
        return parse_json(text)
    except ValueError as error:
        if text[:1] in ("[", "{", '"') or re.fullmatch(_NUMBER, text):
            raise BaselineError(f"{shown(text)} cannot be read as JSON: {error}") from None
        return text


def parse_options(items: list[str] | None) -> dict[str, Any]:
    """Return environment options from ``KEY=VALUE`` texts.

    Raises
    ------
    BaselineError
        A text without ``=``, a key given twice, or a value that cannot be read.
    """
    options: dict[str, Any] = {}
    for item in items or []:
        key, equals, text = item.partition("=")
        key = key.strip()
        if not equals or not key:
            raise BaselineError(f"--set takes KEY=VALUE, got {shown(item)}")
        if key in options:
            raise BaselineError(f"--set {key} is given twice")
        try:
            options[key] = parse_value(text.strip())
        except BaselineError as error:
            raise BaselineError(f"--set {key}: {error}") from None
    return options
