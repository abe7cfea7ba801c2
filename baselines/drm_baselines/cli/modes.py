"""``drm modes``: natural frequencies of the arm over its length."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drm_baselines.cli.arm import ARM_HELP, parse_arm
from drm_baselines.cli.common import JSON_HELP, guarded
from drm_baselines.cli.terminal import say_files, say_json, show
from drm_baselines.errors import BaselineError
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once

if TYPE_CHECKING:
    from rich.table import Table

PLANTS = ("thesis", "consistent", "finite_element", "exact_rigid_link1", "spatial")
PLANE = PLANTS[:-1]
"""Those that are shown unless others are asked for."""
MARKS = {"in-plane bending": "", "out-of-plane bending": "o", "torsion": "t"}
"""What stands behind a frequency in the table."""


@guarded
def modes(
    plant: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Model of the bending: {', '.join(PLANTS)}. May be repeated; all but "
            "spatial by default.",
            show_default=False,
        ),
    ] = None,
    extensions: Annotated[
        list[float] | None,
        typer.Option(
            "--extension",
            help="Length of link 2 outside link 1, m. May be repeated; 1, 2, ... 8 by default, "
            "and eight lengths from the shortest to the longest of another arm.",
            show_default=False,
        ),
    ] = None,
    arm: Annotated[
        list[str] | None, typer.Option("--arm", help=ARM_HELP, show_default=False)
    ] = None,
    mass: Annotated[
        float, typer.Option("--payload-mass", help="Mass of the payload, kg; 0 for none.")
    ] = 200.0,
    length: Annotated[
        float | None,
        typer.Option(
            "--payload-length",
            help="Length of the payload along the arm, m; by its mass (Table 2-7) by default.",
            show_default=False,
        ),
    ] = None,
    width: Annotated[
        float | None,
        typer.Option(
            "--payload-width",
            help="Width of the payload across the arm, m; by its mass (Table 2-7) by default.",
            show_default=False,
        ),
    ] = None,
    inertia: Annotated[
        str,
        typer.Option(
            "--payload-inertia", help="Moment of inertia of the payload: full or slender."
        ),
    ] = "full",
    assumed: Annotated[
        tuple[int, int] | None,
        typer.Option(
            "--modes",
            help="Assumed modes of link 1 and link 2 (0: rigid link) of the plants thesis (1 1 by "
            "default) and consistent (4 4 by default).",
            show_default=False,
        ),
    ] = None,
    shapes: Annotated[
        str | None,
        typer.Option(
            help="Assumed shapes: b7, b8, b9, mono; b8 for thesis and mono for consistent by "
            "default.",
            show_default=False,
        ),
    ] = None,
    elements: Annotated[
        int | None,
        typer.Option(help="Number of finite elements; 60 by default.", show_default=False),
    ] = None,
    centre: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            "--payload-centre",
            help="Centre of mass of the payload from the tip, m: along the arm, across it in the "
            "plane of the slew, out of the plane. Of plant spatial.",
            show_default=False,
        ),
    ] = None,
    tensor: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(
            "--payload-tensor",
            help="Entries xx yy zz xy xz yz of the payload's tensor of inertia about its centre "
            "of mass, kg m^2. Of plant spatial; a box as wide as high by default.",
            show_default=False,
        ),
    ] = None,
    rotation_deg: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            "--payload-rotation-deg",
            help="Rotation of the payload about its centre of mass, axis times angle in degrees. "
            "Of plant spatial.",
            show_default=False,
        ),
    ] = None,
    torsional: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--torsional-stiffness",
            help="G J of link 1 and link 2, N m^2. Of plant spatial; the thesis' tubes by default.",
            show_default=False,
        ),
    ] = None,
    count: Annotated[
        int,
        typer.Option(min=1, help="Number of frequencies, where a plant has so many."),
    ] = 3,
    plot: Annotated[
        Path | None,
        typer.Option(help="Draw the frequencies over the extension into this file (PNG)."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing figure.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Show natural frequencies (Hz) of the arm at rest at fixed lengths.

    The rotation of the whole arm about the shoulder, which has no frequency, is left out.
    """
    with leaving_at_once():
        import drm_env
        from drm_baselines.support import storage

    names = tuple(dict.fromkeys(plant or PLANE))
    unknown = [name for name in names if name not in PLANTS]
    if unknown:
        raise BaselineError(f"--plant must be one of {', '.join(PLANTS)}, got {unknown[0]}")
    given = {"mass": mass, "length": length, "width": width, "inertia": inertia}
    payload = {name: value for name, value in given.items() if value is not None}
    assumed_options = {"modes": assumed, "shapes": shapes}
    if not {"thesis", "consistent"} & set(names):
        for name, value in assumed_options.items():
            if value is not None:
                raise BaselineError(f"--{name} is for the plants thesis and consistent")
    if elements is not None and not {"finite_element", "spatial"} & set(names):
        raise BaselineError("--elements is for the plants finite_element and spatial")
    turn = None if rotation_deg is None else [math.radians(angle) for angle in rotation_deg]
    held = {"centre": centre, "inertia": tensor, "rotation": turn}
    grapple = {name: value for name, value in held.items() if value is not None}
    if "spatial" not in names and (grapple or torsional is not None):
        raise BaselineError(
            "--payload-centre, --payload-tensor, --payload-rotation-deg and --torsional-stiffness "
            "are for the plant spatial"
        )
    if plot is not None:
        require("a picture of the frequencies", "plot")
        storage.claim_file(plot, force=force)
    links = parse_arm(arm)
    places = sorted(set(extensions)) if extensions else _places(links)
    models: dict[str, drm_env.Model] = {}
    for name in names:
        options: dict[str, Any] = {"plant": name, "arm": links}
        if name in ("thesis", "consistent"):
            options |= assumed_options
        elif name == "finite_element":
            options["elements"] = elements
        elif name == "spatial":
            options |= {"elements": elements, "torsional_stiffness": torsional}
            options["grapple"] = grapple or None
        models[name] = drm_env.Model(payload, **options)
    found: dict[str, list[list[float]]] = {}
    for name, model in models.items():
        wanted = None if name in ("thesis", "consistent") else count
        found[name] = [
            [float(f) for f in model.natural_frequencies(a, wanted)[:count]] for a in places
        ]
    kinds = {
        name: [model.mode_kinds(a, count) for a in places]
        for name, model in models.items()
        if name == "spatial"
    }
    if as_json:
        say_json(
            {
                "payload": payload,
                **({} if links is None else {"arm": links}),
                **({"grapple": grapple} if grapple else {}),
                **({"kinds": kinds} if kinds else {}),
                "extensions": places,
                "units": "SI, frequencies in Hz",
                "natural_frequencies": found,
            }
        )
    else:
        show(_table(places, found, kinds, _title(payload)))
    if plot is not None:
        from drm_baselines.cli.frequency_plot import plot_natural_frequencies

        plot_natural_frequencies(places, found, plot, title=_title(payload), overwrite=force)
        if not as_json:
            say_files([plot])


def _places(links: dict[str, Any] | None) -> list[float]:
    """Extensions that are looked at where none are given, m."""
    if links is None:
        return [float(a) for a in range(1, 9)]
    import drm_env

    hole, edge = drm_env.workspace(links)
    longest = links["link2"]["length"]
    shortest = max(hole - (edge - longest), longest / 8.0)
    return [shortest + (longest - shortest) * step / 7.0 for step in range(8)]


def _title(payload: dict[str, Any]) -> str:
    return f"natural frequencies (Hz), payload of {payload['mass']:g} kg"


def _table(
    places: list[float],
    found: dict[str, list[list[float]]],
    kinds: dict[str, list[tuple[str, ...]]],
    title: str,
) -> Table:
    from rich.table import Table

    words = ", ".join(f"{mark}: {kind}" for kind, mark in MARKS.items() if mark)
    caption = f"{words}; all others: in-plane bending" if kinds else None
    table = Table(
        title=title,
        title_justify="left",
        header_style="bold",
        caption=caption,
        caption_justify="left",
    )
    table.add_column("extension\n(m)", justify="right")
    for name in found:
        table.add_column(name, justify="right", no_wrap=True)
    width = max(len(f"{f:.3f}") for rows in found.values() for row in rows for f in row)
    for index, a in enumerate(places):
        cells = []
        for name, rows in found.items():
            marks = [MARKS[kind] for kind in kinds[name][index]] if name in kinds else [""]
            columns = itertools.zip_longest(rows[index], marks, fillvalue="")
            gap = 1 if name in kinds else 0
            cells.append("  ".join(f"{f:{width}.3f}{mark:<{gap}}" for f, mark in columns))
        table.add_row(f"{a:.4g}", *cells)
    return table
