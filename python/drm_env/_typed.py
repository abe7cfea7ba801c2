"""Configuration dataclasses from the JSON text that the engine writes."""

from __future__ import annotations

import dataclasses
import json
import types
from collections.abc import Sequence
from functools import cache
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

if TYPE_CHECKING:
    from drm_env._config import EnvConfig


def config_from_json(text: str) -> EnvConfig:
    """The `EnvConfig` of complete JSON text."""
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
    if isinstance(data, list) and origin is tuple:
        kinds = get_args(kind)
        return tuple(_convert(part, item) for part, item in zip(kinds, data, strict=True))
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
