"""``drm info``: what is installed, which environments there are, what they show and take."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drm_baselines.cli.common import JSON_HELP, SET_HELP, complete_env, guarded, parse_options
from drm_baselines.cli.terminal import say, say_json, show
from drm_baselines.support.interruption import leaving_at_once

if TYPE_CHECKING:
    from rich.table import Table


@guarded
def info(
    env_id: Annotated[
        str,
        typer.Option("--env", help="Environment to describe.", autocompletion=complete_env),
    ] = "drm_env/Slew-v0",
    options: Annotated[
        bool,
        typer.Option(
            "--options", help="List every option with unit, default in --env, and limits."
        ),
    ] = False,
    metrics: Annotated[
        bool, typer.Option("--metrics", help="List every metric with unit and formula.")
    ] = False,
    config: Annotated[bool, typer.Option("--config", help="Show the full configuration.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
    set_options: Annotated[list[str] | None, typer.Option("--set", help=SET_HELP)] = None,
) -> None:
    """Show versions, environments, the observation's layout, the options and the metrics."""
    with leaving_at_once():
        import drm_env
        from drm_baselines.evaluation.environments import known_ids, resolved_config
        from drm_baselines.policies.names import listed, names_of
        from drm_baselines.policies.registry import LAWS
        from drm_baselines.support import provenance

    resolved = resolved_config(env_id, parse_options(set_options))
    layout = resolved.observation_layout
    if as_json:
        content: dict[str, Any] = {
            "versions": provenance.versions(),
            "environments": known_ids(),
            "laws": list(LAWS),
            "policies": list(names_of()),
            "environment": env_id,
            "observation": [
                {
                    "name": entry.name,
                    "unit": entry.unit,
                    "scale": entry.scale,
                    "low": entry.low,
                    "high": entry.high,
                }
                for entry in layout
            ],
            "actuators": list(resolved.actuators),
            "control_period": resolved.control_period,
            "options": described_options(resolved.to_dict()),
            "metrics": [entry._asdict() for entry in drm_env.episode_metrics()],
            "config": resolved.to_dict(),
        }
        say_json(content)
        return
    if metrics:
        show(_metrics_table())
        for symbol, meaning in drm_env.METRIC_SYMBOLS.items():
            say(f"{symbol}: {meaning}")
        return
    if options:
        show(_options_table(described_options(resolved.to_dict()), env_id))
        return
    if config:
        say_json(resolved.to_dict())
        return
    say("  ".join(f"{name} {version}" for name, version in provenance.versions().items()))
    say("environments: " + ", ".join(known_ids()))
    say("control laws: " + ", ".join(LAWS))
    say("policies: " + listed())
    table = _table(
        f"observation of {env_id}: {len(layout)} entries (value = entry x scale)",
        "entry", "name", "unit", "scale", "low", "high",
    )  # fmt: skip
    for column in table.columns:
        column.justify = "left" if column.header in ("name", "unit") else "right"
    for index, entry in enumerate(layout):
        table.add_row(
            str(index),
            entry.name,
            entry.unit,
            f"{entry.scale:g}",
            f"{entry.low:g}",
            f"{entry.high:g}",
        )
    show(table)
    say(
        f"actions: {', '.join(resolved.actuators)}, each a fraction "
        f"of its torque limit, every {resolved.control_period * 1e3:g} ms"
    )
    say("more: --options, --metrics, --config")


# What an option is tried with to hear the engine's limits: another kind of value, and numbers
# below, at and above what there can be.
_TRIALS: tuple[Any, ...] = ("?", -1e12, 0.0, 1e12, 0, 10**12)
# What has limits only beside another option.
_BESIDE: dict[str, tuple[tuple[Any, ...], dict[str, Any]]] = {
    "modes": (([0, 0],), {"plant": "consistent"})
}
_LONGEST_DEFAULT = 100
_REQUIREMENT = re.compile(r"(?P<path>\S+) must be (?P<what>.+), got ", re.DOTALL)
_ALTERNATIVES = re.compile(r"unknown variant `\?`, expected (?:one of )?(?P<what>.+)")


def described_options(config: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return ``drm_env.option_names`` with ``default`` and ``limits`` of each option.

    The default is what ``config`` says; the limits are what the engine answers to values that are
    too small or too large or of another kind, in its own words.
    """
    import drm_env

    found = {}
    for name, entry in drm_env.option_names().items():
        drawn = config["randomize"].get(name)
        default: Any = config
        for part in str(entry["path"]).split("."):
            default = default[part]
        found[name] = {
            **entry,
            "default": default if drawn is None else drawn,
            "limits": _limits(name, str(entry["path"])),
        }
    return found


def _limits(name: str, path: str) -> list[str]:
    """The distinct requirements that the engine states for an option."""
    import drm_env

    stated: list[str] = []
    trials, others = _BESIDE.get(name, (_TRIALS, {}))
    for value in trials:
        try:
            drm_env.observation_layout(**{name: value}, **others)
        except drm_env.DrmError as error:
            stated += _requirements(str(error), path)
    return list(dict.fromkeys(stated))


def _requirements(message: str, path: str) -> list[str]:
    """What an error says of the option at ``path``, if it is that one that it is about."""
    if "expected a boolean" in message:
        return ["true or false"]
    if found := _ALTERNATIVES.search(message):
        return [found["what"].replace("`", "").replace(", ", " or ")]
    found = _REQUIREMENT.match(message)
    # the engine names scenario's and task's own entries without them
    return [found["what"]] if found and path.endswith(found["path"]) else []


def _table(title: str, *headings: str) -> Table:
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for heading in headings:
        table.add_column(heading)
    return table


def _options_table(options: Mapping[str, Mapping[str, Any]], env_id: str) -> Table:
    table = _table(
        f"options of {env_id}", "option", "unit", "default", "must be", "drawn", "meaning"
    )
    for name, entry in options.items():
        default = json.dumps(entry["default"])
        table.add_row(
            name,
            str(entry["unit"]),
            default if len(default) <= _LONGEST_DEFAULT else "(see --config)",
            "; ".join(entry["limits"]),
            "yes" if entry["randomizable"] else "no",
            str(entry["description"]),
        )
    return table


def _metrics_table() -> Table:
    import drm_env

    table = _table("metrics of an episode", "metric", "unit", "what it is", "formula")
    for entry in drm_env.episode_metrics():
        table.add_row(*entry)
    return table
