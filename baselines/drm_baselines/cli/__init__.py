"""The ``drm`` command: simulate, compare, train and evaluate from a terminal.

Each command lives in a module of its own. What a command needs to do its work (the engine, NumPy,
scipy, matplotlib, torch, ...) is imported when it runs, so that ``drm --help`` and errors in a
command line come at once, and flights of control laws need no torch.
"""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from typing import TYPE_CHECKING, Any

from drm_baselines.errors import MissingPackageError
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once

if TYPE_CHECKING:
    import typer

    app: typer.Typer


def __getattr__(name: str) -> Any:
    """Make ``app``, the typer application, when it is first used."""
    if name == "app":
        from drm_baselines.cli.application import app

        return app
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _open_descriptors() -> None:
    """Give descriptors that were closed a place, or the next file that is opened gets theirs."""
    with contextlib.suppress(OSError):
        while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
            pass
        os.close(descriptor)


def _without_terminal(error: MissingPackageError) -> int:
    """Say on standard error, without the packages that do so otherwise, what is missing."""
    with contextlib.suppress(OSError):
        os.write(2, f"error: {error}\n".encode())
    return 2


def main() -> None:
    """Run the command line."""
    _open_descriptors()
    try:
        with leaving_at_once():
            require("the command drm", "cli")
            import typer

            from drm_baselines.cli.application import app
            from drm_baselines.cli.common import ending_well
            from drm_baselines.cli.terminal import complain, output
    except MissingPackageError as error:
        sys.exit(_without_terminal(error))

    def warn(message: Warning | str, *_: object, **__: object) -> None:
        complain(str(message), "warning")

    warnings.showwarning = warn
    try:
        # commands end well by themselves; help and errors of the command line do here
        ending_well(app)
    except typer.Exit as error:
        sys.exit(error.exit_code)
    finally:
        output.flush()
        output.abandon()
