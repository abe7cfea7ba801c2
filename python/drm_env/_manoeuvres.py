"""Scenarios and laws as the engine takes them."""

from __future__ import annotations

import json
from typing import Any

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


def check_decimation(decimation: Any) -> None:
    if isinstance(decimation, bool) or not isinstance(decimation, int) or decimation < 1:
        raise ConfigError(f"decimation must be a positive integer, got {decimation!r}")


def check_flag(name: str, value: Any) -> None:
    if not isinstance(value, bool):
        raise ConfigError(f"{name} must be True or False, got {value!r}")
