"""``drm size``: what drawn missions need of wheels, motor, deployment and links."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drm_baselines.cli.common import JSON_HELP, SET_HELP, guarded, parse_options, parse_value
from drm_baselines.cli.terminal import counting, say, say_files, say_json, show
from drm_baselines.errors import BaselineError
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once
from drm_baselines.support.reading import shown

if TYPE_CHECKING:
    from rich.table import Table

    from drm_baselines.sizing import Check, Missions, Requirement, SweepPoint

MOST_MISSIONS = 1_000_000
"""Most missions of one command."""


def parse_payload(text: str | None, number: int | None) -> float | tuple[float, float]:
    """Return the mass of the payload, kg, or the two that it is drawn between.

    Raises
    ------
    BaselineError
        Neither or both, a class that there is not, or no mass.
    """
    from drm_baselines.sizing.missions import payload_of_class

    if (text is None) == (number is None):
        raise BaselineError("give either --payload-class or --payload-mass")
    if number is not None:
        return payload_of_class(number)
    assert text is not None
    value = parse_value(text)
    pair = value if isinstance(value, tuple) else (value,)
    if not all(isinstance(each, (int, float)) and not isinstance(each, bool) for each in pair):
        raise BaselineError(f"--payload-mass takes a mass or LOW..HIGH, kg, got {shown(text)}")
    return (float(value[0]), float(value[1])) if isinstance(value, tuple) else float(value)


@guarded
def size(
    payload_class: Annotated[
        int | None,
        typer.Option(max=1000, help="Payload 0 to 3 of the thesis' Table 2-7.", show_default=False),
    ] = None,
    payload_mass: Annotated[
        str | None,
        typer.Option(help="Mass of the payload, kg, or LOW..HIGH to draw it.", show_default=False),
    ] = None,
    mass_error: Annotated[
        float,
        typer.Option(
            help="Largest error of the reported mass, as a part of the true one, drawn evenly up "
            "and down."
        ),
    ] = 0.15,
    set_options: Annotated[list[str] | None, typer.Option("--set", help=SET_HELP)] = None,
    law: Annotated[str, typer.Option(help="Control law that flies.")] = "linear",
    missions: Annotated[
        int, typer.Option(min=1, max=MOST_MISSIONS, help="Missions that are drawn and flown.")
    ] = 1000,
    fraction: Annotated[
        float, typer.Option(help="Part of all missions that the sizes are to be enough for.")
    ] = 0.99,
    confidence: Annotated[
        float, typer.Option(help="Confidence of the sizes and of the intervals.")
    ] = 0.95,
    fresh: Annotated[
        int,
        typer.Option(
            "--check",
            min=0,
            max=MOST_MISSIONS,
            help="Fly so many fresh missions with wheels of the sizes found.",
        ),
    ] = 0,
    smaller: Annotated[
        int,
        typer.Option(
            "--sweep",
            min=0,
            max=MOST_MISSIONS,
            help="Fly so many missions with each of several smaller wheels.",
        ),
    ] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first mission.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory for size.json, missions.csv, sweep.csv and the pictures needs.png and "
            "sweep.png.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing results.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Size wheels, motor, deployment and links for missions that are drawn.

    A mission is the thesis' standard manoeuvre; --set makes it another one or a set of them, and
    the arm another arm (link1_length, link2_bending_stiffness and so on). Wheels store any momentum
    while they are sized; their torque is limited to what --set says (root_torque_limit), 100 and
    10 N m by default. A size is the upper bound of what the asked part of all missions needs, by
    order statistics.

    Example: drm size --payload-class 1 --mass-error 0.15 --check 1000 --sweep 100
    """
    require("drm size", "evaluate", "scipy", *(["matplotlib"] if out is not None else []))
    with leaving_at_once():
        from drm_baselines.policies.pilots import law_data
        from drm_baselines.sizing import (
            Missions,
            check,
            corners,
            fewest_missions,
            fly_needs,
            requirements,
            sweep,
        )
        from drm_baselines.support import provenance, storage

    for option, value in (("--fraction", fraction), ("--confidence", confidence)):
        if not 0.0 < value < 1.0:
            raise BaselineError(f"{option} must be between 0 and 1, got {value:g}")
    if missions < (fewest := fewest_missions(fraction, confidence)):
        raise BaselineError(
            f"--missions must be at least {fewest} to bound what {fraction:g} of all need with a "
            f"confidence of {confidence:g}, got {missions}"
        )
    what = Missions(
        payload=parse_payload(payload_mass, payload_class),
        mass_error=mass_error,
        options=parse_options(set_options),
    )
    flown_by = law_data(law)
    if out is not None:
        storage.claim_directory(out, force=force)
    drawn = what.draw(seed, missions)
    unseen = what.draw(seed + missions, fresh) if fresh else []
    at_corners = corners(what, flown_by, seed)
    checks: list[Check] = []
    points: list[SweepPoint] = []
    with counting("flights") as tell:
        needs = fly_needs(
            drawn, flown_by, seed=seed, progress=lambda done, all_: tell("missions", done, all_)
        )
        found = requirements(needs, fraction, confidence)
        sizes = {each.name: each.size for each in found}
        if unseen:
            checks = check(
                unseen,
                flown_by,
                sizes,
                seed=seed + missions,
                confidence=confidence,
                progress=lambda done, all_: tell("check", done, all_),
            )
        if smaller:
            ratings = {
                "root_wheel_momentum": sizes["root_wheel_momentum"],
                "root_wheel_torque": drawn[0]["root_wheel"]["torque_limit"],
                "tip_wheel_torque": drawn[0]["tip_wheel"]["torque_limit"],
            }
            points = sweep(
                drawn[: min(smaller, missions)],
                flown_by,
                {name: value for name, value in ratings.items() if value > 0.0},
                seed=seed,
                progress=lambda done, all_: tell("sweep", done, all_),
            )
    report = {
        "format": "drm-size",
        "format_version": 1,
        "units": "SI and radians",
        "payload_mass": what.payload,
        "mass_error": mass_error,
        "options": dict(what.options),
        "law": flown_by,
        "missions": missions,
        "seed": seed,
        "fraction": fraction,
        "confidence": confidence,
        "requirements": [dataclasses.asdict(each) for each in found],
        "corners": [dataclasses.asdict(each) for each in at_corners],
        "check": [{**dataclasses.asdict(each), "part": each.part} for each in checks],
        "sweep": [dataclasses.asdict(each) for each in points],
    }
    if as_json:
        say_json(report)
    else:
        _say(what, found, at_corners, checks, points, fraction, confidence, missions)
    if out is None:
        return
    from drm_baselines.sizing.pictures import plot_requirements, plot_sweep

    title = f"{_payload(what)}, mass error up to {mass_error:.0%}, law {law}"
    files = [
        storage.write_json(
            out / "size.json",
            {**report, "provenance": provenance.provenance()},
            overwrite=force,
        ),
        _write_missions(out / "missions.csv", drawn, needs, seed, overwrite=force),
        plot_requirements(
            needs, found, out / "needs.png", fraction=fraction, title=title, overwrite=force
        ),
    ]
    if points:
        files.append(
            storage.write_rows(
                out / "sweep.csv", [dataclasses.asdict(each) for each in points], overwrite=force
            )
        )
        files.append(plot_sweep(points, out / "sweep.png", title=title, overwrite=force))
    if not as_json:
        say_files(files)


def _payload(missions: Missions) -> str:
    if isinstance(missions.payload, tuple):
        return "payload of {:g} to {:g} kg".format(*missions.payload)
    return f"payload of {missions.payload:g} kg"


def _write_missions(
    path: Path,
    drawn: Sequence[Mapping[str, Any]],
    needs: Mapping[str, Any],
    seed: int,
    *,
    overwrite: bool,
) -> Path:
    from drm_baselines.support import storage

    rows = [
        {
            "seed": seed + index,
            "payload_mass": scenario["payload"]["mass"],
            "mass_error": scenario["mass_error"],
            **{name: float(values[index]) for name, values in needs.items()},
        }
        for index, scenario in enumerate(drawn)
    ]
    return storage.write_rows(path, rows, overwrite=overwrite)


def _say(
    what: Missions,
    found: Sequence[Requirement],
    at_corners: Sequence[Any],
    checks: Sequence[Check],
    points: Sequence[SweepPoint],
    fraction: float,
    confidence: float,
    missions: int,
) -> None:
    from rich.table import Table

    from drm_baselines.sizing import NEEDS
    from drm_baselines.support.format import significant

    table = Table(
        title=f"what {fraction:.4g} of all missions need ({missions} flown, {_payload(what)}, "
        f"confidence {confidence:.4g})",
        title_justify="left",
        header_style="bold",
    )
    table.add_column("")
    for name in ("quantile", "interval", "size", "largest"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit")
    if checks:
        table.add_column("fresh missions\nwithin the size", justify="right")
    held = {each.name: each for each in checks}
    for each in found:
        need = NEEDS[each.name]
        cells = [
            need.label,
            significant(each.quantile),
            f"{significant(each.low)} "
            + (f"to {significant(each.high)}" if math.isfinite(each.high) else "and more"),
            significant(each.size),
            significant(each.largest),
            need.unit,
        ]
        if each.name in held:
            one = held[each.name]
            cells.append(f"{one.within} of {one.missions}")
        table.add_row(*cells)
    show(table)
    corner = Table(
        title="root wheel with the mass wrong by all that it can be", title_justify="left",
        header_style="bold",
    )  # fmt: skip
    for name in ("payload\n(kg)", "mass error", "momentum flown\n(N m s)",
                 "by hand, torque enough\n(N m s)"):  # fmt: skip
        corner.add_column(name, justify="right")
    for each in at_corners:
        corner.add_row(
            f"{each.payload:g}",
            f"{each.mass_error:+.0%}",
            f"{each.root_momentum:.0f}",
            f"{each.by_hand:.0f}",
        )
    show(corner)
    if points:
        show(_sweep_table(points))
    say("a size is a bound by order statistics: see docs/planning.md")


def _sweep_table(points: Sequence[SweepPoint]) -> Table:
    from rich.table import Table

    from drm_baselines.sizing import NEEDS

    table = Table(title="smaller wheels", title_justify="left", header_style="bold")
    table.add_column("")
    for name in ("limit", "of full", "settled", "slew error at the end\nmedian, 95 % (deg)",
                 "tip error\nmedian, 95 % (mm)"):  # fmt: skip
        table.add_column(name, justify="right")
    for point in points:
        final = (math.degrees(point.final_error), math.degrees(point.final_error_high))
        tip = (1e3 * point.tip_error, 1e3 * point.tip_error_high)
        table.add_row(
            NEEDS[point.name].label,
            f"{point.limit:.4g} {NEEDS[point.name].unit}",
            f"{point.factor:.0%}",
            f"{point.settled:.0%}",
            ", ".join(_number(value) for value in final),
            ", ".join(_number(value) for value in tip),
        )
    return table


def _number(value: float) -> str:
    from drm_baselines.support.format import significant

    return significant(value) if math.isfinite(value) else "diverged"
