"""From keyword arguments, files and dataclasses to the JSON text that the engine reads, and back.

The engine alone knows the parameters, their defaults and their limits; what is here only changes
the form. Units are SI and radians throughout.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import tomllib
import types
import warnings
from collections.abc import Mapping, Sequence
from enum import Enum
from functools import cache
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from drm_env import _engine
from drm_env.distributions import distribution_to_data
from drm_env.errors import ConfigError

if TYPE_CHECKING:
    from drm_env._config import EnvConfig

__all__ = [
    "ConfigLike",
    "config_from_json",
    "default_config",
    "flat_options",
    "option_names",
    "options_to_data",
    "resolve",
    "to_data",
]

ConfigLike = Union["EnvConfig", Mapping[str, Any], str, os.PathLike[str], None]
"""What ``config=`` takes: an `EnvConfig`, its dict, or a path to a JSON or TOML file."""


def option_names() -> dict[str, dict[str, Any]]:
    """Every keyword option.

    Returns
    -------
    options
        By name: ``path`` in the configuration, ``unit``, ``randomizable`` (whether it can be drawn
        for each episode) and ``description``.
    """
    names: dict[str, dict[str, Any]] = json.loads(_engine.option_names_json())
    return names


@cache
def _randomizable() -> frozenset[str]:
    return frozenset(name for name, option in option_names().items() if option["randomizable"])


def to_data(value: Any, path: str = "") -> Any:
    """The JSON form of a value: NumPy scalars and arrays, tuples, enums and dataclasses included.

    Parameters
    ----------
    value
        anything that a configuration may hold.
    path
        dotted name of the value, for the error.

    Raises
    ------
    ConfigError
        a number that is not finite, or a type without a JSON form.
    """
    if value is None or isinstance(value, (bool, str, int)):
        return value.value if isinstance(value, Enum) else value
    if isinstance(value, np.generic):
        return to_data(value.item(), path)
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ConfigError(f"{path or 'value'} must be finite, got {value}")
        return value
    if isinstance(value, Enum):
        return to_data(value.value, path)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        shallow = {item.name: getattr(value, item.name) for item in dataclasses.fields(value)}
        return to_data(shallow, path)
    if isinstance(value, Mapping):
        data = {}
        for key, item in value.items():
            if not isinstance(key, str):
                raise ConfigError(f"{path or 'configuration'}: keys must be text, got {key!r}")
            data[key] = to_data(item, f"{path}.{key}" if path else key)
        return distribution_to_data(data, path) if "distribution" in data else data
    if isinstance(value, (list, tuple)):
        return [to_data(item, f"{path}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, np.ndarray):
        return to_data(value.tolist(), path)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise ConfigError(f"{path or 'value'}: cannot use a value of type {type(value).__name__}")


def _draw_to_data(name: str, value: Any) -> Any:
    """The JSON form of a randomizable option: a tuple is a range, a list is a set of choices."""
    if isinstance(value, tuple):
        data = to_data(value, name)
        if len(data) != 2:
            raise ConfigError(f"{name}: a tuple must be (low, high), got {value!r}")
        return {"uniform": data}
    if isinstance(value, (list, np.ndarray)):
        data = to_data(value, name)
        if not isinstance(data, list):
            return data
        numbers = [item for item in data if isinstance(item, (int, float))]
        if len(data) == 2 and len(numbers) == 2:
            warnings.warn(
                f"{name}={data} is taken as two choices; write a tuple {tuple(data)} for a range",
                UserWarning,
                stacklevel=6,
            )
        return {"choices": data}
    return to_data(value, name)


def options_to_data(options: Mapping[str, Any]) -> dict[str, Any]:
    """The JSON form of keyword options. See `option_names` for what they are called.

    Raises
    ------
    ConfigError
        a value without a JSON form. Unknown names and impossible values are found
        by the engine, see `resolve`.
    """
    drawn = _randomizable()
    return {
        name: _draw_to_data(name, value) if name in drawn else to_data(value, name)
        for name, value in options.items()
    }


def flat_options(options: Mapping[str, Any] | None) -> str | None:
    """JSON text of parameters given for one episode or context, ``None`` if there are none.

    Raises
    ------
    ConfigError
        not a mapping, or a value without a JSON form.
    """
    if options is None:
        return None
    if not isinstance(options, Mapping):
        raise ConfigError(f"options must be a mapping, got {type(options).__name__}")
    if not options:
        return None
    return json.dumps({name: to_data(value, str(name)) for name, value in options.items()})


def _read_file(path: Path) -> Any:
    """The content of a JSON or TOML file.

    Raises
    ------
    ConfigError
        missing, unreadable, malformed, or of another kind.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError(f"config: no such file: {path}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"config: cannot read {path}: {error}") from error
    suffix = path.suffix.lower()
    try:
        if suffix == ".json":
            return json.loads(text)
        if suffix == ".toml":
            return tomllib.loads(text)
    except (json.JSONDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigError(f"config: {path} is not valid {suffix[1:].upper()}: {error}") from error
    raise ConfigError(f"config: {path} must end in .json or .toml")


def config_to_json(config: ConfigLike) -> str | None:
    """JSON text of what ``config=`` was given; ``None`` for ``None``.

    Raises
    ------
    ConfigError
        a file that cannot be read, or a value without a JSON form.
    """
    if config is None:
        return None
    if isinstance(config, (str, os.PathLike)):
        content = _read_file(Path(config))
        if not isinstance(content, dict):
            raise ConfigError(f"config: {config} must hold a table, got {type(content).__name__}")
        config = content
    data = to_data(config)
    if not isinstance(data, dict):
        raise ConfigError(
            f"config must be an EnvConfig, a mapping or a path, got {type(config).__name__}"
        )
    return json.dumps(data)


def resolve(task: str, config: ConfigLike, options: Mapping[str, Any]) -> str:
    """Complete, validated configuration as JSON text.

    Parameters
    ----------
    task
        ``"slew"``, ``"slew_residual"``, ``"slew_thesis"`` or ``"slew_direct"``: the defaults.
    config
        what replaces defaults; may be partial.
    options
        keyword options, which win over ``config``.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value, with its path and the value.
    """
    if not isinstance(task, str):
        raise ConfigError(f"task must be text, got {task!r}")
    data = options_to_data(options)
    return _engine.resolve_config(task, config_to_json(config), json.dumps(data))


def default_config(task: str = "slew") -> EnvConfig:
    """The configuration behind one of the registered environments.

    Raises
    ------
    ConfigError
        unknown task.
    """
    return config_from_json(_engine.default_config_json(task))


def config_from_json(text: str) -> EnvConfig:
    """The `EnvConfig` of complete JSON text, as `resolve` returns it."""
    from drm_env._config import EnvConfig

    config: EnvConfig = _convert(EnvConfig, json.loads(text))
    return config


@cache
def _hints(kind: type[Any]) -> dict[str, Any]:
    return get_type_hints(kind)


def _convert(kind: Any, data: Any) -> Any:
    """JSON data as what an annotation asks for; lists become tuples, like the defaults."""
    origin = get_origin(kind)
    if origin is Annotated:
        return _convert(get_args(kind)[0], data)
    if origin in (Union, types.UnionType):
        return _convert_union(get_args(kind), data)
    if isinstance(data, dict) and dataclasses.is_dataclass(kind):
        # `is_dataclass` also admits instances, which no annotation is
        hints = _hints(kind)  # type: ignore[arg-type]
        fields = {name: _convert(hints[name], item) for name, item in data.items()}
        return kind(**fields)  # type: ignore[operator]
    if isinstance(data, list) and origin is Sequence:
        (item_kind,) = get_args(kind)
        return tuple(_convert(item_kind, item) for item in data)
    return data


def _convert_union(kinds: tuple[Any, ...], data: Any) -> Any:
    """The first member of a union that the data fits."""
    for kind in kinds:
        if isinstance(data, dict) and dataclasses.is_dataclass(kind) and _fits(kind, data):
            return _convert(kind, data)
        if isinstance(data, list) and get_origin(kind) is Sequence:
            return _convert(kind, data)
    return data


def _fits(kind: Any, data: dict[str, Any]) -> bool:
    """Whether a dataclass has these fields, and its ``Literal`` ones these values."""
    hints = _hints(kind)
    return all(
        name in hints and (get_origin(hints[name]) is not Literal or item in get_args(hints[name]))
        for name, item in data.items()
    )
