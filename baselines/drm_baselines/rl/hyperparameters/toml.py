"""Settings of learning as the text of a file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from drm_baselines.rl.hyperparameters import Hyperparameters

if TYPE_CHECKING:
    pass


def toml_of(settings: Hyperparameters, comment: str = "") -> str:
    """Return settings as the text of a file that ``drm train --hyperparameters`` reads."""
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    data = settings.to_dict()
    tables = {name: data.pop(name) for name in ("env", "model", "network")}
    lines += [f"{_toml_key(name)} = {_toml_value(value)}" for name, value in data.items()]
    for name, table in tables.items():
        if table:
            lines += ["", f"[{name}]"]
            lines += [f"{_toml_key(key)} = {_toml_value(value)}" for key, value in table.items()]
    return "\n".join(lines) + "\n"


def _toml_key(name: str) -> str:
    return name if name.replace("_", "a").isalnum() and name.isascii() else json.dumps(name)


def _toml_value(value: Any) -> str:
    if isinstance(value, Mapping):
        pairs = (f"{_toml_key(str(key))} = {_toml_value(item)}" for key, item in value.items())
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)
