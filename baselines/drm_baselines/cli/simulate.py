"""``drm simulate``: one manoeuvre under one or more laws and policies."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drm_baselines.cli.common import POLICY_HELP, complete_policy, guarded
from drm_baselines.cli.terminal import complain, say_files, say_json, show
from drm_baselines.errors import BaselineError
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once
from drm_baselines.support.reading import read_table, shown

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from drm_baselines.policies.pilots import Pilot
_ROWS = 10_000
_SAMPLE_BYTES = 400
"""What a kept sample of a flight takes: some twenty signals, and a copy of them on the way."""


def with_value(scenario: Mapping[str, Any], path: str, value: Any) -> dict[str, Any]:
    """Return the scenario with the dotted ``path`` set to ``value``.

    Raises
    ------
    BaselineError
        A part of the path is there already and is not a table.
    """
    first, _, rest = path.partition(".")
    inner = scenario.get(first, {})
    if not rest:
        return {**scenario, first: value}
    if not isinstance(inner, Mapping):
        raise BaselineError(f"scenario: {first} must be a table, got {shown(inner)}")
    return {**scenario, first: with_value(inner, rest, value)}


def write_trajectory(
    path: Path, flight: Mapping[str, NDArray[np.float64]], *, overwrite: bool
) -> Path:
    """Write the signals of a flight as CSV, one column a signal, SI units and radians."""
    import numpy as np

    from drm_baselines.support import storage

    names = list(flight)
    count = flight[names[0]].size
    with (
        storage.atomic_path(path, overwrite=overwrite) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(names)
        # as Python's numbers a long flight takes several times its arrays
        for first in range(0, count, _ROWS):
            part = slice(first, first + _ROWS)
            writer.writerows(np.column_stack([flight[name][part] for name in names]).tolist())
    return path


def _check_memory(description: Mapping[str, Any], decimation: int, laws: int) -> None:
    """Refuse flights whose signals do not fit; what is no time the engine refuses.

    Raises
    ------
    BaselineError
        The message says how much they would take.
    """
    import drm_env
    from drm_baselines.support import memory

    usual = drm_env.Scenario()
    horizon = description.get("horizon", usual.horizon)
    period = description.get("sample_period", usual.sample_period)
    times = [each for each in (horizon, period) if isinstance(each, (int, float)) and each > 0.0]
    if len(times) < 2 or not math.isfinite(horizon):
        return
    size = min(horizon / period / decimation * laws * _SAMPLE_BYTES, 2.0**80)
    memory.require(int(size), f"{laws} flights of {horizon:g} s, decimation {decimation},")


def _data(pilot: Pilot) -> Mapping[str, Any]:
    """What identifies who flies; of a law the law itself."""
    law = pilot.details.get("law")
    return pilot.details if law is None else law


@guarded
def simulate(
    scenario: Annotated[
        Path | None,
        typer.Argument(
            help="Scenario as a .json or .toml file, SI units and radians; without "
            "one the thesis' standard manoeuvre. Options below win over the file.",
            show_default=False,
        ),
    ] = None,
    law: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Who flies, by name ({POLICY_HELP}). May be repeated; none, linear and lyapunov "
            "by default.",
            show_default=False,
            autocompletion=complete_policy,
        ),
    ] = None,
    payload_mass: Annotated[float | None, typer.Option(help="True payload mass, kg.")] = None,
    payload_length: Annotated[float | None, typer.Option(help="Payload length, m.")] = None,
    payload_width: Annotated[float | None, typer.Option(help="Payload width, m.")] = None,
    mass_error: Annotated[
        float | None,
        typer.Option(help="Reported over true payload mass minus one, such as 0.15."),
    ] = None,
    slew_angle_deg: Annotated[float | None, typer.Option(help="Slew angle, degrees.")] = None,
    slew_max_accel: Annotated[
        float | None, typer.Option(help="Largest slew acceleration, rad/s^2.")
    ] = None,
    slew_final_time: Annotated[
        float | None, typer.Option(help="Duration of the slew in the place of its acceleration, s.")
    ] = None,
    motor_torque_limit: Annotated[
        float | None, typer.Option(help="Torque at which the slew motor's is cut, N m.")
    ] = None,
    profile: Annotated[
        str | None, typer.Option(help="Slew profile: min_time or min_energy.")
    ] = None,
    horizon: Annotated[float | None, typer.Option(help="Length of the flight, s.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory for a CSV of signals for each law, simulation.json and manoeuvre.png."
        ),
    ] = None,
    decimation: Annotated[
        int, typer.Option(min=1, max=10**9, help="Keep every so many samples of the sample period.")
    ] = 5,
    html: Annotated[
        Path | None,
        typer.Option(
            help="File for a report in HTML that needs no network: linked charts, the arm in "
            "motion, metrics, configuration.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing results.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the metrics as JSON, SI units and radians.")
    ] = False,
) -> None:
    """Simulate one manoeuvre in closed loop and show its metrics."""
    with leaving_at_once():
        from drm_baselines.evaluation.tables import metrics_table
        from drm_baselines.policies.names import title_of
        from drm_baselines.policies.pilots import pilot_named
        from drm_baselines.support import provenance, storage

    description = read_table(scenario, "scenario file") if scenario is not None else {}
    for path, value in (
        ("payload.mass", payload_mass),
        ("payload.length", payload_length),
        ("payload.width", payload_width),
        ("mass_error", mass_error),
        ("slew.angle", None if slew_angle_deg is None else math.radians(slew_angle_deg)),
        ("slew.max_accel", slew_max_accel),
        ("slew.final_time", slew_final_time),
        ("slew_motor.open_loop_limit", motor_torque_limit),
        ("slew.profile", profile),
        ("horizon", horizon),
    ):
        if value is not None:
            description = with_value(description, path, value)
    names = law or ["none", "linear", "lyapunov"]
    if len(set(names)) != len(names):
        raise BaselineError(f"--law is given twice: {', '.join(names)}")
    pilots = {name: pilot_named(name) for name in names}
    _check_memory(description, decimation, len(pilots))
    if out is not None:
        require("a picture of the manoeuvre (--out)", "plot")
        storage.claim_directory(out, force=force)
    if html is not None:
        require("a report (--html)", "evaluate", "jinja2")
        storage.claim_file(html, force=force)
    flights = {
        name: pilot.trajectory(description, decimation=decimation) for name, pilot in pilots.items()
    }
    laws = {name: _data(pilot) for name, pilot in pilots.items()}
    report = {
        "format": "drm-simulation",
        "format_version": 1,
        "units": "SI and radians",
        "scenario": description,
        "laws": laws,
        "metrics": {name: dict(flight.metrics) for name, flight in flights.items()},
        "provenance": provenance.provenance(),
    }
    if as_json:
        say_json(report)
    else:
        show(
            metrics_table(
                {name: flight.metrics for name, flight in flights.items()}, title="manoeuvre"
            )
        )
    for name, flight in flights.items():
        if flight.metrics["diverged"]:
            lasted = flight.metrics["duration"]
            complain(
                f"{title_of(name)} after {lasted:g} s: the arm left what the equations describe, "
                "and there are no results",
                "diverged",
            )
    files = []
    if html is not None:
        from drm_baselines.evaluation.reports import simulation_page
        from drm_baselines.pages.writer import write_page

        page = simulation_page(description, flights, laws)
        files.append(write_page(page, html, overwrite=True))
    if out is not None:
        from drm_baselines.evaluation import plots
        from drm_baselines.evaluation.environments import complete_scenario

        files += [
            write_trajectory(out / f"{name}.csv", flight, overwrite=force)
            for name, flight in flights.items()
        ]
        files.append(storage.write_json(out / "simulation.json", report, overwrite=force))
        picture = out / "manoeuvre.png"
        link1 = complete_scenario(description)["arm"]["link1"]["length"]
        plots.plot_manoeuvres(flights, picture, title="manoeuvre", link1=link1, overwrite=force)
        files.append(picture)
    if files and not as_json:
        say_files(files)
