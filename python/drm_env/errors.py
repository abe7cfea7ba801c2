"""The exceptions of this package.

::

    DrmError
    ├── ConfigError (ValueError)          a configuration, scenario or option that cannot be used
    │   ├── UnknownOptionError (TypeError)    an option that there is not
    │   └── InfeasibleError                   a manoeuvre that no arm or no limit allows
    ├── SimulationError                   a call that cannot be carried out now
    │   ├── ActionError (ValueError)      an action of the wrong shape or not finite
    │   │   └── ActionTypeError (TypeError)   an action that is not made of real numbers
    │   ├── ResetNeededError              step before reset or after the end of an episode
    │   └── EnvironmentClosedError        any use after close
    ├── SnapshotError                     bytes that are not a snapshot of this environment
    └── CheckError (AssertionError)       a vector environment that does not keep its promises

Nothing has changed when one of them is raised, but for the last: a check flies what it checks.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium as gym

__all__ = [
    "ActionError",
    "ActionTypeError",
    "CheckError",
    "ConfigError",
    "DrmError",
    "EnvironmentClosedError",
    "InfeasibleError",
    "ResetNeededError",
    "SimulationError",
    "SnapshotError",
    "UnknownOptionError",
]

# The engine raises these by their names here; a type made in Rust would be missing in its stub.


class DrmError(Exception):
    """Base of every error of this package."""

    __module__ = "drm_env"


class ConfigError(DrmError, ValueError):
    """A configuration, scenario or option that cannot be used."""

    __module__ = "drm_env"


class UnknownOptionError(ConfigError, TypeError):
    """A keyword option that there is not.

    It is a `TypeError` as well, with the words of Python's own, because other libraries look for
    these to find out what an environment accepts.
    """

    __module__ = "drm_env"


class InfeasibleError(ConfigError):
    """A manoeuvre that the workspace or a limit does not allow.

    Attributes
    ----------
    limit
        name of the limit in the way.
    needed, allowed
        what the manoeuvre needs at least (at most, in the hole of the workspace), and what the
        limit allows, in the same SI unit.
    """

    __module__ = "drm_env"

    def __init__(self, message: str, *, limit: str, needed: float, allowed: float) -> None:
        """Names the limit and by how much it is missed."""
        super().__init__(message)
        self.limit = limit
        self.needed = float(needed)
        self.allowed = float(allowed)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles hold the limit, too."""
        kept: dict[str, Any] = {
            "limit": self.limit,
            "needed": self.needed,
            "allowed": self.allowed,
        }
        return partial(type(self), **kept), self.args


class SimulationError(DrmError):
    """A call that cannot be carried out in the present state."""

    __module__ = "drm_env"


class ActionError(SimulationError, ValueError):
    """An action with the wrong shape or a value that is not finite."""

    __module__ = "drm_env"


class ActionTypeError(ActionError, TypeError):
    """An action that is not made of real numbers."""

    __module__ = "drm_env"


class ResetNeededError(SimulationError, gym.error.ResetNeeded):
    """A call before the first ``reset``, or ``step`` after the end of an episode."""

    __module__ = "drm_env"


class EnvironmentClosedError(SimulationError, gym.error.ClosedEnvironmentError):
    """The environment was used after ``close``."""

    __module__ = "drm_env"


class SnapshotError(DrmError):
    """Bytes that are damaged, of another version, or of another configuration."""

    __module__ = "drm_env"


class CheckError(DrmError, AssertionError):
    """A vector environment that does not keep what its interface promises.

    Attributes
    ----------
    faults : tuple of str
        Everything that was found.
    """

    __module__ = "drm_env"

    def __init__(self, subject: str, faults: tuple[str, ...]) -> None:
        self.subject, self.faults = subject, faults
        super().__init__(subject, faults)

    def __str__(self) -> str:
        """The faults, one a line."""
        lines = "".join(f"\n- {fault}" for fault in self.faults)
        return f"{self.subject} has {len(self.faults)} fault(s):{lines}"
