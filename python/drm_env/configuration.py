"""From keyword arguments, files and dataclasses to the JSON text that the engine reads, and back.

The engine alone knows the parameters, their defaults and their limits; what is here only changes
the form. Units are SI and radians throughout.
"""

from __future__ import annotations

import dataclasses
import decimal
import difflib
import json
import math
import numbers
import os
import tomllib
import warnings
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from drm_env import _engine
from drm_env.distributions import distribution_to_data
from drm_env.errors import ConfigError, UnknownOptionError
from drm_env.resolved import ResolvedConfig

if TYPE_CHECKING:
    from drm_env._config import EnvConfig

__all__ = [
    "ConfigLike",
    "default_config",
    "flat_options",
    "option_names",
    "options_to_data",
    "resolve_options",
    "to_data",
]

ConfigLike = Union["EnvConfig", ResolvedConfig, Mapping[str, Any], str, os.PathLike[str], None]
"""What ``config=`` takes: an `EnvConfig`, its dict, a path to a JSON or TOML file, or a
`ResolvedConfig`, which is not checked again."""


def option_names() -> dict[str, dict[str, Any]]:
    """Every keyword option.

    Returns
    -------
    options
        By name: ``path`` in the configuration, ``unit``, ``randomizable`` (whether it can be drawn
        for each episode) and ``description``.

    Examples
    --------
    >>> import drm_env
    >>> option = drm_env.option_names()["payload_mass"]
    >>> option["path"], option["unit"], option["randomizable"]
    ('scenario.payload.mass', 'kg', True)
    """
    names: dict[str, dict[str, Any]] = json.loads(_engine.option_names_json())
    return names


@cache
def randomizable() -> frozenset[str]:
    """Names of the options that can be drawn for each episode and set at reset."""
    return frozenset(name for name, option in option_names().items() if option["randomizable"])


@cache
def known_options() -> frozenset[str]:
    """Names of all options."""
    return frozenset(option_names())


def check_names(
    names: Iterable[Any], known: frozenset[str], what: str = "keyword argument"
) -> None:
    """Refuses the first of ``names`` that is not ``known``, naming those that are spelt alike.

    Raises
    ------
    UnknownOptionError
        an unknown name.
    """
    for name in names:
        if name in known:
            continue
        close = difflib.get_close_matches(str(name), sorted(known), n=3)
        hint = f"did you mean {' or '.join(close)}?" if close else "see drm_env.option_names()"
        raise UnknownOptionError(f"got an unexpected {what} {_short(name)}; {hint}")


def _short(value: Any) -> str:
    """``repr`` of a value that a user gave, cut to a line."""
    try:
        text = repr(value)
    except ValueError:
        # Python refuses to write integers of thousands of digits
        text = f"a number of type {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:77]}..."


_DEEPEST = 32
"""Levels that a value may be nested; the deepest configuration has 6."""


def to_data(value: Any, path: str = "") -> Any:
    """The JSON form of a value: NumPy scalars and arrays, sequences, enums, dataclasses included.

    Parameters
    ----------
    value
        anything that a configuration may hold.
    path
        dotted name of the value, for the error.

    Raises
    ------
    ConfigError
        a number that is not finite, a type without a JSON form, or too many levels.
    """
    return _data(value, path, 0)


def _data(value: Any, path: str, level: int) -> Any:
    if level > _DEEPEST:
        name = path if len(path) <= 80 else f"{path[:77]}..."
        raise ConfigError(f"{name} is nested more than {_DEEPEST} levels deep")
    if isinstance(value, Enum):
        return _data(value.value, path, level + 1)
    if isinstance(value, ResolvedConfig):
        return value.to_dict()
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, (numbers.Number, np.generic, decimal.Decimal)):
        return _number(value, path)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        shallow = {item.name: getattr(value, item.name) for item in dataclasses.fields(value)}
        return _data(shallow, path, level)
    if isinstance(value, Mapping):
        data = {}
        for key, item in value.items():
            if not isinstance(key, str):
                raise ConfigError(
                    f"{path or 'configuration'}: keys must be text, got {_short(key)}"
                )
            data[key] = _data(item, f"{path}.{key}" if path else key, level + 1)
        return distribution_to_data(data, path) if "distribution" in data else data
    if is_sequence(value):
        if len(value) > _LONGEST:
            raise ConfigError(
                f"{path or 'value'} must have at most {_LONGEST} entries, got {len(value)}"
            )
        return [_data(item, f"{path}[{index}]", level + 1) for index, item in enumerate(value)]
    if hasattr(type(value), "__array__"):
        # arrays without dimension, and those of other libraries
        array = np.asarray(value)
        return _data(array[()] if array.ndim == 0 else array, path, level + 1)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise ConfigError(f"{path or 'value'}: cannot use a value of type {type(value).__name__}")


_LONGEST = 100_000
"""Entries that a sequence may have; the engine's own limits are lower."""


def is_sequence(value: Any) -> bool:
    """Whether a value is a sequence of values: a list, array, deque, range, ... but no text."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, (str, bytes, bytearray))


def _number(value: Any, path: str) -> bool | int | float | str:
    """The Python number of whatever kind of number.

    Raises
    ------
    ConfigError
        not real, not finite, or too large for a double.
    """
    if isinstance(value, np.generic):
        if value.dtype.kind not in "biufU":
            raise ConfigError(f"{path or 'value'}: cannot use a value of type {value.dtype.name}")
        if value.dtype.kind in "bU":
            plain: bool | str = value.item()
            return plain
    if isinstance(value, (int, np.integer)) and abs(int(value)) < 2**63:
        return int(value)
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    except (TypeError, ValueError):
        name = type(value).__name__
        raise ConfigError(f"{path or 'value'}: cannot use a value of type {name}") from None
    if not math.isfinite(number):
        raise ConfigError(f"{path or 'value'} must be finite, got {_short(value)}")
    return number


def _draw_to_data(name: str, value: Any) -> Any:
    """The JSON form of what can be drawn: a tuple is a range, any other sequence are choices."""
    if isinstance(value, tuple):
        data = to_data(value, name)
        if len(data) != 2:
            raise ConfigError(f"{name}: a tuple must be (low, high), got {_short(value)}")
        return {"uniform": data}
    if is_sequence(value):
        data = to_data(value, name)
        numbers_only = all(isinstance(item, (int, float)) for item in data)
        if isinstance(value, (list, np.ndarray)) and len(data) == 2 and numbers_only:
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
    UnknownOptionError
        an unknown name.
    ConfigError
        a value without a JSON form. The engine finds impossible values, see `resolve_options`.
    """
    check_names(options, known_options())
    drawn = randomizable()
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
    for name in options:
        if name not in randomizable() and name in known_options():
            raise ConfigError(f"{name} is fixed when the environment is made, not set later")
    check_names(options, randomizable(), "parameter of the scenario")
    return json.dumps({name: _draw_to_data(name, value) for name, value in options.items()})


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
    except (OSError, ValueError) as error:
        raise ConfigError(f"config: cannot read {path}: {error}") from error
    suffix = path.suffix.lower()
    try:
        if suffix == ".json":
            return json.loads(text)
        if suffix == ".toml":
            return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
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
    if isinstance(config, ResolvedConfig):
        return config.to_json()
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


def resolve_options(task: str, config: ConfigLike, options: Mapping[str, Any]) -> ResolvedConfig:
    """The complete, checked configuration that a task's defaults, ``config`` and options make.

    Parameters
    ----------
    task
        ``"slew"``, ``"slew_residual"``, ``"slew_thesis"``, ``"slew_direct"``, ``"slew_v1"``,
        ``"slew_residual_v1"`` or ``"slew_flexible"``: the defaults.
    config
        what replaces defaults; may be partial. A `ResolvedConfig` is complete, and without options
        it is what is returned.
    options
        keyword options, which win over ``config``.

    Raises
    ------
    UnknownOptionError
        an option that there is not.
    ConfigError
        an unknown name or an impossible value, with its path and the value.
    """
    if not isinstance(task, str):
        raise ConfigError(f"task must be text, got {task!r}")
    data = options_to_data(options)
    if isinstance(config, ResolvedConfig) and not data and task in _engine.task_names():
        return config
    return ResolvedConfig(_engine.Config(task, config_to_json(config), json.dumps(data)))


def default_config(task: str = "slew") -> EnvConfig:
    """The configuration behind one of the registered environments.

    Raises
    ------
    ConfigError
        unknown task.

    Examples
    --------
    >>> import drm_env
    >>> config = drm_env.default_config("slew_thesis")
    >>> config.task.control_period, config.scenario.slew.max_accel  # s, rad/s^2
    (0.002, 0.02)
    """
    return resolve_options(task, None, {}).config
