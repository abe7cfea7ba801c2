"""Errors of the baselines that a user can act on.

The command line prints their message alone and ends with a non-zero exit code; a traceback is
kept for programming errors. They all descend from one class, so that a script can tell a
refused request from a bug.
"""

from __future__ import annotations


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
