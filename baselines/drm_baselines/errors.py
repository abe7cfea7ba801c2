"""Errors of the baselines that a user can act on.

The command line prints their message alone and ends with a non-zero exit code; a traceback is
kept for programming errors. They all descend from one class, so that a script can tell a
refused request from a bug.
"""

from __future__ import annotations

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


class WriteError(BaselineError):
    """A result that could not be written: no room, no permission, no such place."""


def missing_extra(purpose: str, extra: str, error: ImportError) -> BaselineError:
    """Return the error for a package that only an extra of this distribution installs.

    Parameters
    ----------
    purpose
        What needs it, such as ``"training"``.
    extra
        ``"learn"``, ``"tune"`` or ``"bench"``.
    error
        What importing it said.
    """
    source = Path(__file__).resolve().parents[1]
    where = str(source) if (source / "pyproject.toml").is_file() else "./baselines"
    place = "" if where == str(source) else " in a clone of the project"
    return BaselineError(
        f"{purpose} needs the extra {extra!r}: {error}. Install it with: "
        f"python -m pip install '{where}[{extra}]'{place}"
    )
