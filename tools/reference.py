"""What pages of the documentation say of the installed packages, as Markdown.

    tools/reference.py NAME        NAME: environments, observations, options, parameters,
                                   metrics, commands, api

``docs/conf.py`` puts each in the place of ``<!-- reference: NAME -->``, so that the site cannot say
anything else than the engine's own tables, the command line and the docstrings do.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

MODULES = (
    "drm_env",
    "drm_env.sb3",
    "drm_env.constants",
    "drm_baselines",
    "drm_baselines.policies",
    "drm_baselines.evaluation",
    "drm_baselines.evaluation.statistics",
    "drm_baselines.suites",
)
"""The public faces, in the order of the API page."""


def section(name: str) -> str:
    """Return a part of the reference by its name."""
    return SECTIONS[name]()


def _cell(text: object) -> str:
    return str(text).replace("|", "\\|").replace("\n", " ").replace("*", "\\*")


def _code(text: object) -> str:
    return f"`{text}`" if str(text) else ""


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines)


# --- environments ---------------------------------------------------------------------------------


def _ids() -> list[str]:
    from drm_baselines.evaluation import known_ids

    return list(known_ids())


def environments() -> str:
    """Every id with what its agent drives, how often, and what it is told."""
    import drm_env

    rows = []
    for name in _ids():
        config = drm_env.resolve(name)
        drawn = [key for key, how in config.to_dict()["randomize"].items() if how is not None]
        rows.append(
            (
                _code(name),
                ", ".join(_code(actuator) for actuator in config.actuators),
                f"{1.0 / config.control_period:g} Hz",
                str(config.horizon_steps),
                str(config.observation_space.shape[0]),
                ", ".join(_code(parameter) for parameter in drawn) or "nothing",
            )
        )
    headings = ("id", "the agent drives", "rate", "steps", "observations", "drawn by default")
    return table(headings, rows)


def observations() -> str:
    """The layout of each environment's observation."""
    import drm_env

    parts = []
    for name in _ids():
        config = drm_env.resolve(name)
        rows = [
            (str(place), _code(entry.name), _cell(entry.unit), f"{entry.scale:g}")
            for place, entry in enumerate(config.observation_layout)
        ]
        parts.append(f"### `{name}`\n\n" + table(("no.", "entry", "unit", "scale"), rows))
    return "\n\n".join(parts)


def _default(value: object) -> str:
    text = json.dumps(value)
    return _code(text) if len(text) <= 60 else "`drm info --config`"


def _options(*, randomizable: bool) -> str:
    import drm_env
    from drm_baselines.cli.info import described_options

    described = described_options(drm_env.resolve("drm_env/Slew-v0").to_dict())
    rows = [
        (
            _code(name),
            _cell(entry["unit"]),
            _default(entry["default"]),
            _cell("; ".join(entry["limits"])),
            _cell(entry["description"]),
        )
        for name, entry in described.items()
        if bool(entry["randomizable"]) is randomizable
    ]
    return table(("option", "unit", "default in `Slew-v0`", "must be", "meaning"), rows)


def options() -> str:
    """Options of the task, which hold for all episodes."""
    return _options(randomizable=False)


def parameters() -> str:
    """Parameters of the manoeuvre, each of which can be drawn for every episode."""
    return _options(randomizable=True)


def metrics() -> str:
    """The metrics of an episode."""
    import drm_env

    rows = [
        (_code(entry.name), _cell(entry.unit), _cell(entry.description), _cell(entry.formula))
        for entry in drm_env.episode_metrics()
    ]
    return table(("metric", "unit", "what it is", "formula"), rows)


# --- commands -------------------------------------------------------------------------------------


def _value(parameter: Any) -> str:
    """How the value of an option is written, empty for a switch."""
    kind = parameter.type_descriptor.annotation
    if kind is bool:
        return ""
    several = getattr(kind, "__origin__", None) is list
    (kind,) = kind.__args__ if several else (kind,)
    word = {int: "INTEGER", float: "NUMBER", Path: "PATH"}.get(kind, "TEXT")
    return f"{word}, repeatable" if several else word


def _help(text: str) -> str:
    """A help text whose options are code."""
    return re.sub(r"(?<![\w`-])--[a-z][\w-]*", r"`\g<0>`", _cell(text))


def _range(parameter: Any) -> str:
    low, high = parameter.min, parameter.max
    if low is None and high is None:
        return ""
    if high is None:
        return f" At least {low:,}."
    return f" At most {high:,}." if low is None else f" {low:,} to {high:,}."


def _default_of(parameter: Any) -> str:
    value = parameter.default
    if value is None or value is False or not parameter.show_default:
        return ""
    return _code(value)


def _paragraphs(text: str) -> str:
    """A command's help, whose lines beginning with ``drm`` are commands."""
    parts = []
    for part in re.split(r"\n\s*\n", inspect.cleandoc(text).split("\f")[0]):
        joined = " ".join(part.split())
        parts.append(f"```sh\n{joined}\n```" if joined.startswith("drm ") else joined)
    return "\n\n".join(parts)


def commands() -> str:
    """Every command of ``drm`` with its arguments and options."""
    import typer

    from drm_baselines.cli.application import app

    group: Any = typer.main.get_command(app)
    parts = []
    for name, command in group.commands.items():
        arguments = [each for each in command.params if each.param_type_name == "argument"]
        chosen = [each for each in command.params if each.param_type_name == "option"]
        written = [
            f"[{each.name.upper()}]..." if each.nargs < 0 else each.name.upper()
            for each in arguments
        ]
        usage = " ".join([f"drm {name}", *written, "[OPTIONS]"])
        parts.append(
            f"## `drm {name}`\n\n```text\n{usage}\n```\n\n{_paragraphs(command.help or '')}"
        )
        if arguments:
            rows = [
                (_code(each.name.upper()), _cell(getattr(each, "help", "") or ""))
                for each in arguments
            ]
            parts.append(table(("argument", "meaning"), rows))
        rows3 = [
            (
                ", ".join(_code(written) for written in (*each.opts, *each.secondary_opts)),
                _value(each),
                _default_of(each),
                _help(each.help or "") + _range(each) + (" **Required.**" if each.required else ""),
            )
            for each in chosen
            if not each.hidden and each.name != "help"
        ]
        parts.append(table(("option", "value", "default", "meaning"), rows3))
    return "\n\n".join(parts)


# --- api ------------------------------------------------------------------------------------------


def _directive(address: str, value: object) -> str:
    if inspect.isclass(value):
        lines = [f".. autoclass:: {address}", "   :members:"]
        if issubclass(value, BaseException):
            lines[1] = "   :show-inheritance:"
        return "\n".join(lines)
    if inspect.isroutine(value):
        return f".. autofunction:: {address}"
    said = "\n".join(f"   {line}" for line in _said_of(address, value))
    return f".. py:data:: {address}\n\n{said}"


def _said_of(address: str, value: object) -> list[str]:
    """What stands below an assignment in the source, wherever the value was made."""
    from sphinx.pycode import ModuleAnalyzer

    name = address.rpartition(".")[2]
    for home, module in sorted(sys.modules.items()):
        if home.startswith("drm_") and vars(module).get(name) is value:
            try:
                found = ModuleAnalyzer.for_module(home).find_attr_docs()
            except Exception:  # no source: the next module may have it
                continue
            if ("", name) in found:
                return list(found["", name])
    return []


def _public(module: Any) -> list[str]:
    """What a module offers; without a list, what it defines itself."""
    own = [
        name
        for name, value in vars(module).items()
        if getattr(value, "__module__", None) == module.__name__
    ]
    return list(getattr(module, "__all__", own))


def api() -> str:
    """Directives of autodoc for every public name, module by module."""
    import importlib

    parts, told = [], set()
    for face in MODULES:
        module = importlib.import_module(face)
        names = [name for name in _public(module) if not name.startswith("_")]
        entries = []
        for name in names:
            value = getattr(module, name)
            key = id(value) if inspect.isclass(value) or inspect.isroutine(value) else (face, name)
            if key in told:
                continue
            told.add(key)
            entries.append(_directive(f"{face}.{name}", value))
        text = "\n\n".join(entries)
        parts.append(f"## `{face}`\n\n```{{eval-rst}}\n.. module:: {face}\n\n{text}\n```")
    return "\n\n".join(parts)


SECTIONS: dict[str, Callable[[], str]] = {
    each.__name__: each
    for each in (environments, observations, options, parameters, metrics, commands, api)
}


def main() -> int:
    """Print the part that the command line names."""
    if len(sys.argv) != 2 or sys.argv[1] not in SECTIONS:
        print(__doc__, file=sys.stderr)
        return 2
    print(section(sys.argv[1]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
