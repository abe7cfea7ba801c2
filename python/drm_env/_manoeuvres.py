"""Scenarios and laws as the text that the engine reads."""

from __future__ import annotations

import json
from typing import Any

from drm_env.configuration import to_data
from drm_env.errors import ConfigError
from drm_env.resolved import ResolvedConfig


def scenario_json(scenario: Any, name: str = "scenario") -> str:
    """JSON text of a scenario given as a dict or dataclass (parts left out have their defaults).

    Raises
    ------
    ConfigError
        not a mapping, a value without a JSON form, or a configuration that draws its manoeuvres.
    """
    if isinstance(scenario, ResolvedConfig):
        if scenario.drawn:
            raise ConfigError(
                f"{name} must be one manoeuvre, got a configuration that draws "
                f"{', '.join(scenario.drawn)}; see drm_env.sample_scenarios"
            )
        return json.dumps(scenario.to_dict()["scenario"])
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
