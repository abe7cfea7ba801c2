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

    from drm_baselines.policies.pilots import Pilot

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


def _pilot(name: str, *, law: bool) -> Pilot:
    """Who flies under a name: a law or a network, or only a law.

    Raises
    ------
    BaselineError
        What has this name flies single manoeuvres alone, or is no law where one is needed.
    """
    from drm_baselines.policies.names import find
    from drm_baselines.policies.pilots import SINGLE_ONLY, pilot_named

    if find(name).kind in ("controller", "bound"):
        raise BaselineError(f"--law {name} {SINGLE_ONLY}")
    pilot = pilot_named(name)
    if law and "law" not in pilot.details:
        raise BaselineError(f"--law {name} is no law, and --replan compares laws")
    return pilot


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
            help="Law or learned policy that flies, by name. May be repeated; none, linear and "
            "servo by default.",
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
    pilots = {name: _pilot(name, law=replan) for name in names}
    if out is not None:
        require("a picture of the mission (--out)", "plot")
        storage.claim_directory(out, force=force)
    flights: dict[str, drm_env.Trajectory] = {}
    worth: dict[str, Any] = {}
    for name, pilot in pilots.items():
        if replan:
            law_data = pilot.details["law"]
            worth[name] = missions.worth_of_replanning(document, law_data, _ERRORS, seed=seed)
        if not replan or out is not None:
            flights[name] = pilot.trajectory(
                missions.replanned(document, True) if replan else document,
                decimation=decimation,
                seed=seed,
            )
    report = {
        "format": "drm-mission",
        "format_version": 1,
        "units": "SI and radians, but for legs and replanning, whose names hold units",
        "mission": document,
        "laws": {
            name: dict(pilot.details.get("law", pilot.details)) for name, pilot in pilots.items()
        },
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
