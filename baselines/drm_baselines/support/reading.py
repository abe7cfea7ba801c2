"""Reading files and texts that somebody else wrote: JSON and TOML, checked before anything is used.

Whatever is wrong with them is one short error that names the file: missing, not text, malformed,
nested too deeply, numbers that no computer has, a name given twice.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from drm_baselines.errors import BaselineError

MAX_NESTING = 32
"""Deepest nesting that is read."""
MAX_FILE_BYTES = 64 << 20
"""Largest scenario, hyperparameter file or record that is read: 64 MiB."""
MAX_DIGITS = 300
"""Most digits of a whole number: more do not fit into a float."""

# Possessive, and a string need not end: the time is linear in the length whatever is read.
_BRACKETS = re.compile(r'"(?:[^"\\]++|\\.)*+"?|[\[{]|[\]}]', re.DOTALL)
_LONG_NUMBER = re.compile(rf"[0-9](?:_?[0-9]){{{MAX_DIGITS},}}+")
# A key of many parts, on which tomllib takes a time that grows with their square.
_LONG_KEY = re.compile(rf"(?<![\w.-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){{{MAX_NESTING},}}+")


def shown(value: Any) -> str:
    """Return a value as an error shows it: at most 60 characters."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # too many digits, nested too deeply
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}..."


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")


def _integer(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise ValueError(f"a number of {len(text)} digits is too large")
    return int(text)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]} is too large a number")
    return value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f"{shown(name)} is there twice")
        found[name] = value
    return found


def parse_json(text: str) -> Any:
    """Return what a JSON text says: not nested deeply, names unique, numbers finite.

    Raises
    ------
    ValueError
        Anything else.
    """
    depth = 0
    for match in _BRACKETS.finditer(text):
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(match.group(), 0)
        if depth > MAX_NESTING:
            raise ValueError(f"it is nested more than {MAX_NESTING} deep")
    return json.loads(
        text,
        parse_constant=_refuse_constant,
        parse_float=_finite,
        parse_int=_integer,
        object_pairs_hook=_unique,
    )


def parse_toml(text: str) -> dict[str, Any]:
    """Return what a TOML text says: not nested deeply, numbers finite.

    Raises
    ------
    ValueError
        Anything else.
    """
    if number := _LONG_NUMBER.search(text):
        raise ValueError(f"a number of {len(number.group())} digits is too large")
    too_deep = f"it is nested more than {MAX_NESTING} deep"
    if _LONG_KEY.search(text):
        raise ValueError(too_deep)
    try:
        found = tomllib.loads(text, parse_float=_finite)
    except RecursionError:
        raise ValueError(too_deep) from None
    level: list[Any] = [found]
    for _ in range(MAX_NESTING):
        level = [
            inner
            for each in level
            for inner in (each.values() if isinstance(each, dict) else each)
            if isinstance(inner, (dict, list))
        ]
    if level:
        raise ValueError(too_deep)
    return found


_PARSERS: dict[str, Callable[[str], Any]] = {".json": parse_json, ".toml": parse_toml}


def read_table(
    path: Path, what: str = "file", *, error: type[BaselineError] = BaselineError
) -> dict[str, Any]:
    """Return the table that a ``.json`` or ``.toml`` file holds.

    Parameters
    ----------
    path
        The file.
    what
        What it is, such as ``"scenario file"``, for errors.
    error
        Class of the error.

    Raises
    ------
    BaselineError
        A missing or malformed file, one of another kind, or one that holds something else.
    """
    parse = _PARSERS.get(path.suffix.lower())
    if parse is None:
        raise error(f"{path}: a {what} is a .json or .toml file")
    try:
        with path.open("rb") as stream:
            content = stream.read(MAX_FILE_BYTES + 1)
        if len(content) > MAX_FILE_BYTES:
            raise ValueError(f"it has more than the {MAX_FILE_BYTES} bytes that are read")
        found = parse(content.decode("utf-8"))
    except FileNotFoundError:
        raise error(f"no {what} {path}") from None
    except OSError as reason:
        raise error(f"{path} cannot be read: {reason.strerror or reason}") from reason
    except ValueError as reason:
        raise error(f"{path} cannot be read: {reason}") from reason
    if not isinstance(found, dict):
        raise error(f"{path} must hold a table of values, got {shown(found)}")
    return found
