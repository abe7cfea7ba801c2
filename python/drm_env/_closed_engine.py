"""What stands in for the engine of a closed environment."""

from __future__ import annotations

from typing import NoReturn

from drm_env.errors import EnvironmentClosedError


class ClosedEngine:
    """Stands in for the engine after ``close``: any use of it says so.

    Owners annotate the attribute as the engine, so that its every use is type-checked; putting this
    in its place is therefore marked as a deliberate mismatch.
    """

    def __getattr__(self, name: str) -> NoReturn:
        """Refuses every use."""
        raise EnvironmentClosedError(f"the environment is closed (engine.{name} was asked for)")
