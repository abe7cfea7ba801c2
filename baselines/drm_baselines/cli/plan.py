"""``drm plan``: a manoeuvre within limits, and what it trades."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drm_baselines.cli.arm import ARM_HELP, parse_arm
from drm_baselines.cli.common import JSON_HELP, guarded, parse_value
from drm_baselines.cli.terminal import counting, say, say_files, say_json, show
from drm_baselines.errors import BaselineError
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once
from drm_baselines.support.reading import read_table, shown

if TYPE_CHECKING:
    from rich.table import Table

    import drm_env
    from drm_baselines.planning import Proof
    from drm_baselines.planning.free import FreeProfile

MOST_CASES = 100_000
"""Most drawn cases of one command."""
PLANTS = ("thesis", "consistent")

LIMIT_HELP = (
    "Most that the manoeuvre may need, as NAME=VALUE in SI units: final_time, acceleration, "
    "motor_torque, motor_rate, deployment_force, root_wheel_torque, root_wheel_momentum, "
    "tip_wheel_momentum, deflection, residual, root_bending_moment, root_shear, "
    "link2_bending_moment, link2_shear. May be repeated."
)


def parse_limits(items: Sequence[str] | None) -> dict[str, float]:
    """Return limits from ``NAME=VALUE`` texts.

    Raises
    ------
    BaselineError
        A text without ``=``, a name given twice, or no number.
    """
    limits: dict[str, float] = {}
    for item in items or ():
        name, equals, text = item.partition("=")
        name = name.strip()
        if not equals or not name:
            raise BaselineError(f"--limit takes NAME=VALUE, got {shown(item)}")
        if name in limits:
            raise BaselineError(f"--limit {name} is given twice")
        value = parse_value(text.strip())
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise BaselineError(f"--limit {name} must be a number, got {shown(text)}")
        limits[name] = float(value)
    return limits


@guarded
def plan(
    scenario: Annotated[
        Path | None,
        typer.Argument(
            help="Scenario as a .json or .toml file, SI units and radians: arm, payload, plant, "
            "wheels. Options below win over the file.",
            show_default=False,
        ),
    ] = None,
    start: Annotated[
        tuple[float, float] | None,
        typer.Option("--from", help="Place X Y of the tip at the start, m.", show_default=False),
    ] = None,
    goal: Annotated[
        tuple[float, float] | None,
        typer.Option("--to", help="Place X Y of the tip at the end, m.", show_default=False),
    ] = None,
    angle_deg: Annotated[
        float | None,
        typer.Option(help="Slew angle, degrees, in place of --from and --to.", show_default=False),
    ] = None,
    extensions: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--extension",
            help="Length of link 2 outside link 1 at start and end, m, in place of --from and "
            "--to.",
            show_default=False,
        ),
    ] = None,
    payload_mass: Annotated[
        float | None, typer.Option(help="Mass of the payload, kg.", show_default=False)
    ] = None,
    plant: Annotated[
        str | None,
        typer.Option(
            help="Equations of motion: thesis (default) or consistent.", show_default=False
        ),
    ] = None,
    arm: Annotated[
        list[str] | None, typer.Option("--arm", help=ARM_HELP, show_default=False)
    ] = None,
    limits: Annotated[
        list[str] | None, typer.Option("--limit", help=LIMIT_HELP, show_default=False)
    ] = None,
    final_time: Annotated[
        float | None,
        typer.Option(help="Exact time of the manoeuvre, s.", show_default=False),
    ] = None,
    objective: Annotated[
        str, typer.Option(help="fastest, cheapest (energy) or calmest (vibration).")
    ] = "fastest",
    patience: Annotated[
        float,
        typer.Option(
            help="Times the fastest that the cheapest and the calmest may take without a limit "
            "final_time."
        ),
    ] = 1.5,
    mass_error: Annotated[
        float,
        typer.Option(help="Largest error of the reported mass, as a part of the true one."),
    ] = 0.0,
    law: Annotated[str, typer.Option(help="Control law that flies.")] = "none",
    free: Annotated[
        bool,
        typer.Option(
            "--free",
            help="Beside the plan find the fastest free profile, no longer one of the thesis', "
            "within the same limits, of which one must be on acceleration, motor_torque or "
            "motor_rate.",
        ),
    ] = False,
    cases: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MOST_CASES,
            help="Plan so many drawn cases instead of one, fly each plan again, and tell whether "
            "every limit held.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first drawn case.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory for plan.json, candidates.csv, scenario.json (for drm simulate), "
            "flight.csv, the pictures trades.png, path.png and loads.png, and with --free "
            "free_scenario.json.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing results.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Plan a manoeuvre that keeps its limits when it is flown.

    Of the thesis' profiles and their smoothing the fastest, the cheapest or the calmest is found;
    what no profile can do is refused with the limit in the way and by how much. With the cheapest
    and the calmest come the trade curves of time, energy, vibration and wheel momentum.

    Example: drm plan --from 8 0 --to 0 14 --limit motor_torque=900 --objective calmest
    """
    with leaving_at_once():
        import drm_env
        from drm_baselines.planning import rows
        from drm_baselines.policies.pilots import law_data
        from drm_baselines.support import provenance, storage

    if plant is not None and plant not in PLANTS:
        raise BaselineError(f"--plant must be one of {', '.join(PLANTS)}, got {shown(plant)}")
    if cases is not None:
        _prove(cases, seed, [plant] if plant else list(PLANTS), as_json)
        return
    if (start is None) != (goal is None):
        raise BaselineError("give both --from and --to, or neither")
    if start is not None and (angle_deg is not None or extensions is not None):
        raise BaselineError("give either --from and --to, or --angle-deg and --extension")
    description = read_table(scenario, "scenario file") if scenario is not None else {}
    description = _described(description, angle_deg, extensions, payload_mass, plant)
    if (links := parse_arm(arm)) is not None:
        description = {**description, "arm": links}
    given = parse_limits(limits)
    if free:
        require("a free profile", "plan", "scipy")
        from drm_baselines.planning.free import check_limits

        # before anything is flown
        check_limits(given)
    if out is not None:
        require("pictures of a plan (--out)", "plot")
        storage.claim_directory(out, force=force)
    with counting("flights") as tell:
        found = drm_env.plan_slew(
            description,
            start=start,
            goal=goal,
            limits=given,
            final_time=final_time,
            objective=objective,
            patience=patience,
            mass_error=mass_error,
            law=law_data(law),
            progress=tell,
        )
    other = _free(found) if free else None
    beside = {} if other is None else {"free": dataclasses.asdict(other)}
    if as_json:
        say_json({"units": "SI and radians", **found.to_dict(), **beside})
    else:
        _say_plan(found)
        if other is not None:
            saved = 1.0 - other.final_time / found.best.final_time
            say(
                f"free profile of {len(other.times)} knots: {other.final_time:.3f} s, "
                f"{saved:.1%} less than {found.best.final_time:.3f} s"
            )
    if out is None:
        return
    from drm_baselines.cli.simulate import write_trajectory
    from drm_baselines.planning import pictures

    # the largest error as well as none: what the wheels are there for
    errors = {"mass as reported": 0.0}
    if mass_error > 0.0:
        errors[f"reported {mass_error:+.0%}"] = mass_error
        errors[f"reported {-mass_error:+.0%}"] = -mass_error
    flights = {
        label: drm_env.simulate(
            {**found.scenario, "mass_error": error}, law=law_data(law), decimation=5, loads=True
        )
        for label, error in errors.items()
    }
    flight = flights["mass as reported"]
    if other is not None:
        flights["free profile"] = drm_env.simulate(
            other.scenario, law=law_data(law), decimation=5, loads=True
        )
    table = rows(found)
    files = [
        storage.write_json(
            out / "plan.json",
            {
                "format": "drm-plan",
                "format_version": 1,
                "units": "SI and radians",
                **found.to_dict(),
                **beside,
                "provenance": provenance.provenance(),
            },
            overwrite=force,
        ),
        storage.write_json(out / "scenario.json", found.scenario, overwrite=force),
        storage.write_rows(out / "candidates.csv", table, overwrite=force),
        write_trajectory(out / "flight.csv", flight, overwrite=force),
        pictures.plot_trades(found, out / "trades.png", overwrite=force),
        pictures.plot_tip_path(found, flight, out / "path.png", overwrite=force),
        pictures.plot_loads(found, flights, out / "loads.png", overwrite=force),
    ]
    if other is not None:
        path = out / "free_scenario.json"
        files.append(storage.write_json(path, other.scenario, overwrite=force))
    if not as_json:
        say_files(files)


def _free(found: drm_env.SlewPlan) -> FreeProfile:
    from drm_baselines.planning.free import free_profile

    return free_profile(found)


def _described(
    description: Mapping[str, Any],
    angle_deg: float | None,
    extensions: tuple[float, float] | None,
    payload_mass: float | None,
    plant: str | None,
) -> dict[str, Any]:
    from drm_baselines.cli.simulate import with_value

    found = dict(description)
    first, last = extensions or (None, None)
    for path, value in (
        ("slew.angle", None if angle_deg is None else math.radians(angle_deg)),
        ("deployment.start", first),
        ("deployment.end", last),
        ("payload.mass", payload_mass),
        ("plant", plant),
    ):
        if value is not None:
            found = with_value(found, path, value)
    return found


def _say_plan(found: drm_env.SlewPlan) -> None:
    from rich.table import Table

    from drm_baselines.planning import front
    from drm_baselines.support.format import significant
    from drm_env.slew_limits import LIMITED

    best = found.best
    angle = math.degrees(found.scenario["slew"]["angle"])
    say(
        f"{found.objective}: {best.profile}, smoothing {best.smoothing:g}, "
        f"{best.final_time:.3f} s, {best.max_accel:.4g} rad/s^2"
    )
    say(
        f"slew of {angle:.2f} deg, extension {found.start.extension:.3f} m to "
        f"{found.goal.extension:.3f} m"
    )
    limits = found.limits.given()
    table = Table(title="what it needs", title_justify="left", header_style="bold")
    for name in ("", "needed", "limit", "used", "unit"):
        table.add_column(name, justify="left" if name in ("", "unit") else "right")
    if found.limits.final_time is not None:
        used = best.final_time / found.limits.final_time
        table.add_row(
            "final_time", f"{best.final_time:.3f}", f"{found.limits.final_time:g}", f"{used:.1%}",
            "s",
        )  # fmt: skip
    units = {name: entry.unit for name, entry in LIMITED.items()}
    units |= {"motor_power": "W", "energy": "J", "vibration": "m"}
    for name, unit in units.items():
        if (value := best.values.get(name)) is None:
            continue
        limit = limits.get(name)
        table.add_row(
            name,
            significant(value),
            "" if limit is None else f"{limit:g}",
            "" if limit is None else f"{value / limit:.1%}",
            unit,
        )
    show(table)
    show(_trade_table(found, front(found.candidates)))


def _trade_table(found: drm_env.SlewPlan, best: Sequence[drm_env.SlewCandidate]) -> Table:
    from rich.table import Table

    from drm_baselines.planning import TRADED
    from drm_baselines.support.format import significant

    title = f"what can be traded: best of {len(found.candidates)} flown candidates"
    table = Table(title=title, title_justify="left", header_style="bold")
    table.add_column("profile")
    table.add_column("smoothing", justify="right")
    for traded in TRADED.values():
        table.add_column(f"{traded.label}\n({traded.unit})", justify="right")
    for each in best:
        mark = " *" if each is found.best else ""
        table.add_row(
            each.profile + mark,
            f"{each.smoothing:g}",
            *(significant(each.value(name) / entry.factor) for name, entry in TRADED.items()),
        )
    return table


def _prove(cases: int, seed: int, plants: Sequence[str], as_json: bool) -> None:
    """Plan drawn cases, and end with an error where a limit was passed."""
    from rich.table import Table

    from drm_baselines.planning import fly_cases

    proofs: list[Proof] = []
    with counting("cases") as tell:
        for plant in plants:
            proofs.append(
                fly_cases(
                    range(seed, seed + cases),
                    plant,
                    functools.partial(tell, plant, total=cases),
                )
            )
    counts = [proof.counts() for proof in proofs]
    if as_json:
        say_json({"seed": seed, "plants": counts})
    else:
        table = Table(title=f"drawn cases, seeds {seed}..", title_justify="left")
        for name in counts[0]:
            table.add_column(name.replace("_", "\n"), justify="right")
        for row in counts:
            table.add_row(
                *(
                    str(len(value)) if isinstance(value, list)
                    else f"{value:.6f}" if isinstance(value, float) else str(value)
                    for value in row.values()
                )
            )  # fmt: skip
        show(table)
    failed = {row["plant"]: row["failed_seeds"] for row in counts if row["failed_seeds"]}
    if failed:
        raise BaselineError(f"limits were passed by the seeds {failed}")
