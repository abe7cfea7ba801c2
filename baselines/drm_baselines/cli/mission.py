"""``drm mission``: several legs, flown one after the other under one or more laws."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drm_baselines.cli.common import JSON_HELP, guarded
from drm_baselines.cli.simulate import write_trajectory
from drm_baselines.cli.terminal import complain, say_files, say_json, show
from drm_baselines.errors import BaselineError
from drm_baselines.support.extras import needing, require
from drm_baselines.support.interruption import leaving_at_once
from drm_baselines.support.reading import read_table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.table import Table

_ERRORS = (-0.15, 0.0, 0.15)
"""Errors of the reported mass with which --replan flies."""


def _table(rows: Sequence[Mapping[str, float | str]], title: str) -> Table:
    with needing("a table", "cli"):
        from rich.table import Table
    table = Table(title=title, title_justify="left", header_style="bold")
    for name, value in rows[0].items():
        table.add_column(name, justify="left" if isinstance(value, str) else "right")
    for row in rows:
        table.add_row(*(_shown(value) for value in row.values()))
    return table


def _shown(value: float | str) -> str:
    if isinstance(value, float):
        return f"{value:,.1f}" if abs(value) >= 100.0 else f"{value:.2f}"
    return str(value)


def _law(name: str) -> dict[str, Any]:
    """The law behind a name.

    Raises
    ------
    BaselineError
        What has this name is no law.
    """
    from drm_baselines.policies.pilots import pilot_named

    law = pilot_named(name).details.get("law")
    if law is None:
        raise BaselineError(
            f"--law {name} is no law; missions of policies are the episodes of drm_env/Mission-v0"
        )
    return dict(law)


@guarded
def mission(
    file: Annotated[
        Path,
        typer.Argument(
            help="Mission as a .json or .toml file, SI units and radians, such as "
            "examples/mission.toml; a whole configuration of drm_env/Mission-v0 will do."
        ),
    ],
    law: Annotated[
        list[str] | None,
        typer.Option(
            help="Law that flies, by name. May be repeated; none, linear and servo by default.",
            show_default=False,
        ),
    ] = None,
    replan: Annotated[
        bool,
        typer.Option(
            "--replan",
            help="Compare legs planned for the reported mass with legs planned for the mass that "
            "the legs before have told, for reports 15 % too light, right and 15 % too heavy.",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of what is drawn and of sensors' noise.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory for a CSV of signals for each law, mission.json and mission.png."
        ),
    ] = None,
    decimation: Annotated[
        int, typer.Option(min=1, max=10**9, help="Keep every so many samples of the sample period.")
    ] = 5,
    force: Annotated[bool, typer.Option("--force", help="Replace existing results.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Fly a mission of several legs and show what came of each."""
    with leaving_at_once():
        import drm_env
        from drm_baselines.evaluation import missions
        from drm_baselines.policies.names import title_of
        from drm_baselines.support import provenance, storage

    document = missions.mission_document(read_table(file, "mission file"), seed)
    names = law or (["servo"] if replan else ["none", "linear", "servo"])
    if len(set(names)) != len(names):
        raise BaselineError(f"--law is given twice: {', '.join(names)}")
    laws = {name: _law(name) for name in names}
    if out is not None:
        require("a picture of the mission (--out)", "plot")
        storage.claim_directory(out, force=force)
    flights: dict[str, drm_env.Trajectory] = {}
    worth: dict[str, Any] = {}
    for name, data in laws.items():
        if replan:
            worth[name] = missions.worth_of_replanning(document, data, _ERRORS, seed=seed)
        if not replan or out is not None:
            flights[name] = drm_env.simulate(
                missions.replanned(document, True) if replan else document,
                data,
                decimation=decimation,
                seed=seed,
            )
    report = {
        "format": "drm-mission",
        "format_version": 1,
        "units": "SI and radians, but for legs and replanning, whose names hold units",
        "mission": document,
        "laws": laws,
        "metrics": {name: dict(flight.metrics) for name, flight in flights.items()},
        "legs": {name: missions.leg_rows(flight) for name, flight in flights.items()},
        "replanning": worth,
        "provenance": provenance.provenance(),
    }
    if as_json:
        say_json(report)
    else:
        for name, rows in worth.items():
            show(_table(rows, f"{title_of(name)}: planned for the reported or the identified mass"))
        for name, flight in flights.items():
            show(_table(missions.leg_rows(flight), title_of(name)))
    for name, flight in flights.items():
        if flight.metrics["diverged"]:
            lasted = flight.metrics["duration"]
            complain(
                f"{title_of(name)} after {lasted:g} s: the arm left what the equations describe",
                "diverged",
            )
    if out is None:
        return
    files = [
        write_trajectory(out / f"{name}.csv", flight, overwrite=force)
        for name, flight in flights.items()
    ]
    files.append(storage.write_json(out / "mission.json", report, overwrite=force))
    files.append(
        missions.plot_mission(
            flights, out / "mission.png", document=document, title=file.stem, overwrite=force
        )
    )
    if not as_json:
        say_files(files)
