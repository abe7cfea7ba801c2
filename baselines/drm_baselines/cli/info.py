"""``drm info``: what is installed, which environments there are, what they show and take."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer
from rich.table import Table

import drm_env
from drm_baselines import storage
from drm_baselines.cli.common import SET_HELP, console, guarded, parse_options
from drm_baselines.evaluation import config_data, environment_config, known_ids
from drm_baselines.policies import LAWS


@guarded
def info(
    env_id: Annotated[str, typer.Option("--env", help="Environment to describe.")] = (
        "drm_env/Slew-v0"
    ),
    options: Annotated[bool, typer.Option("--options", help="List every option with its unit.")] = (
        False
    ),
    config: Annotated[bool, typer.Option("--config", help="Show the full configuration.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
    set_options: Annotated[list[str] | None, typer.Option("--set", help=SET_HELP)] = None,
) -> None:
    """Show versions, environments, the observation's layout and the options."""
    resolved = environment_config(env_id, parse_options(set_options))
    layout = drm_env.observation_layout(config=resolved)
    if as_json:
        content: dict[str, Any] = {
            "versions": storage.versions(),
            "environments": known_ids(),
            "laws": list(LAWS),
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
            "actuators": [str(name) for name in resolved.task.actuators],
            "control_period": float(resolved.task.control_period),
            "options": drm_env.option_names(),
            "config": config_data(resolved),
        }
        typer.echo(json.dumps(storage.plain(content), indent=2))
        return
    console.print("  ".join(f"{name} {version}" for name, version in storage.versions().items()))
    console.print("environments: " + ", ".join(known_ids()))
    console.print("control laws: " + ", ".join(LAWS))
    if options:
        console.print(_options_table())
        return
    if config:
        console.print_json(json.dumps(storage.plain(config_data(resolved))))
        return
    table = Table(
        title=f"observation of {env_id}: {len(layout)} entries (value = entry x scale)",
        title_justify="left",
    )
    for heading in ("entry", "name", "unit", "scale", "low", "high"):
        table.add_column(heading, justify="left" if heading in ("name", "unit") else "right")
    for index, entry in enumerate(layout):
        table.add_row(
            str(index),
            entry.name.replace("[", r"\["),
            entry.unit,
            f"{entry.scale:g}",
            f"{entry.low:g}",
            f"{entry.high:g}",
        )
    console.print(table)
    console.print(
        f"actions: {', '.join(str(name) for name in resolved.task.actuators)}, each a fraction "
        f"of its torque limit, every {float(resolved.task.control_period) * 1e3:g} ms"
    )


def _options_table() -> Table:
    table = Table(title="options of the environments", title_justify="left")
    for heading in ("option", "unit", "drawn per episode", "meaning"):
        table.add_column(heading)
    for name, entry in drm_env.option_names().items():
        table.add_row(
            name,
            str(entry["unit"]),
            "yes" if entry["randomizable"] else "no",
            str(entry["description"]),
        )
    return table
