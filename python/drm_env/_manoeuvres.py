"""Scenarios and laws as the engine takes them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env import _engine
from drm_env.configuration import to_data
from drm_env.errors import ConfigError
from drm_env.resolved import ResolvedConfig


def engine_scenario(scenario: Any, name: str = "scenario") -> str | _engine.Config:
    """JSON text of a scenario given as a dict or dataclass (parts left out have their defaults).

    A configuration that has been resolved is taken as it is: the engine has checked it, and says
    whether it is one manoeuvre.

    Raises
    ------
    ConfigError
        not a mapping, or a value without a JSON form.
    """
    if isinstance(scenario, ResolvedConfig):
        return scenario.held
    data = to_data({} if scenario is None else scenario)
    if not isinstance(data, dict):
        raise ConfigError(f"{name} must be a mapping or a Scenario, got {type(scenario).__name__}")
    return json.dumps(data)


def law_json(law: Any) -> str:
    """JSON text of a law given as a name, a dict or a dataclass; ``None`` is the law ``"none"``.

    Raises
    ------
    ConfigError
        anything else.
    """
    data = to_data("none" if law is None else law, "law")
    if not isinstance(data, (str, dict)):
        raise ConfigError(f"law must be a name or a mapping, got {law!r}")
    return json.dumps(data)


class AskedLaw:
    """A callable as the engine asks it: an array of measurements in, an array of torques out."""

    def __init__(self, law: Callable[[NDArray[np.float64]], ArrayLike], count: int) -> None:
        """For so many manoeuvres."""
        self._law, self._count = law, count

    def __call__(self, measurements: NDArray[np.float64]) -> NDArray[np.float64]:
        """Torques as the engine takes them.

        Raises
        ------
        ConfigError
            what the callable returns is no array of numbers of the right shape.
        """
        returned = self._law(measurements)
        try:
            torques = np.ascontiguousarray(returned, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ConfigError(f"law must return an array of numbers: {error}") from error
        if torques.shape != (self._count, 2):
            raise ConfigError(
                f"law must return torques of shape ({self._count}, 2), got {torques.shape}"
            )
        return torques


def is_callable(law: Any) -> TypeGuard[Callable[[NDArray[np.float64]], ArrayLike]]:
    """Whether a law is asked for its torques, and not one of the engine's."""
    return callable(law) and not isinstance(law, (str, Mapping, type))


def check_period(law: Any, law_period: Any) -> float | None:
    """The period of a callable as the engine takes it.

    Raises
    ------
    ConfigError
        no positive number, or given for a law of the engine.
    """
    if law_period is None:
        return None
    if not is_callable(law):
        raise ConfigError(f"law_period belongs to a callable, got {law_period!r} without one")
    if isinstance(law_period, bool) or not isinstance(law_period, (int, float)):
        raise ConfigError(f"law_period must be a number, got {law_period!r}")
    if not (math.isfinite(law_period) and law_period > 0.0):
        raise ConfigError(f"law_period must be positive and finite, got {law_period!r}")
    return float(law_period)


def check_decimation(decimation: Any) -> None:
    if isinstance(decimation, bool) or not isinstance(decimation, int) or decimation < 1:
        raise ConfigError(f"decimation must be a positive integer, got {decimation!r}")


def check_flag(name: str, value: Any) -> None:
    if not isinstance(value, bool):
        raise ConfigError(f"{name} must be True or False, got {value!r}")
