"""Errors of the baselines that a user can act on.

The command line prints their message alone and ends with a non-zero exit code; a traceback is
kept for programming errors. They all descend from one class, so that a script can tell a
refused request from a bug.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


class BaselineError(Exception):
    """A request that cannot be carried out; the message says which value is at fault."""


class PolicyError(BaselineError):
    """No such policy, or a policy that cannot act on the given environment."""


class PolicyWarning(UserWarning):
    """A policy that flies, but otherwise than it was made for."""


class RunError(BaselineError):
    """A training run directory that is missing, damaged or does not fit the request."""


class ExistingResultError(BaselineError):
    """Results that exist already and would have been overwritten."""


class BusyError(BaselineError):
    """A directory that another process works in."""


class WriteError(BaselineError):
    """A result that could not be written: no room, no permission, no such place."""


class MissingPackageError(BaselineError, ModuleNotFoundError):
    """A package that is not installed, with the extra of this distribution that installs it.

    Attributes
    ----------
    name
        The first of the packages, as it is imported.
    packages
        All that are missing.
    extra
        Name of the extra.
    """

    def __init__(self, purpose: str, extra: str, packages: Sequence[str], reason: str = "") -> None:
        """State what needs which packages, why they cannot be used, and what installs them."""
        source = Path(__file__).resolve().parents[1]
        # a source tree is installed as such again, or pip would put a copy in its place
        in_source = (source / "pyproject.toml").is_file()
        command = f"python -m pip install {'-e ' if in_source else ''}"
        place = f"'{source if in_source else './baselines'}[{extra}]'"
        needed = " and ".join(part for part in (", ".join(packages[:-1]), *packages[-1:]) if part)
        super().__init__(
            f"{purpose} needs {needed}{f' ({reason})' if reason else ''}, which the extra "
            f"{extra!r} installs. Install it with: {command}{place}"
            f"{'' if in_source else ' in a clone of the project'}"
        )
        self.name = packages[0]
        self.packages = tuple(packages)
        self.extra = extra
