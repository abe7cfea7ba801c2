"""``drm stability``: poles of a law's sampled loop over lengths and payloads."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drm_baselines.cli.common import JSON_HELP, guarded
from drm_baselines.cli.terminal import counting, say, say_files, say_json, show
from drm_baselines.errors import BaselineError
from drm_baselines.policies.names import find, names_of
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once

if TYPE_CHECKING:
    from rich.table import Table

    from drm_baselines.stability import StabilityMap, Stepped

_LAWS = (*names_of("law", "tuned law"), "lqg")


@guarded
def stability(
    policies: Annotated[
        list[str] | None,
        typer.Option(
            "--policy",
            help=f"Law to judge: {', '.join(_LAWS)}. May be repeated; the laws with "
            "the thesis' gains and the servo by default.",
            show_default=False,
        ),
    ] = None,
    extensions: Annotated[
        list[float] | None,
        typer.Option(
            "--extension",
            help="Length of link 2 outside link 1, m. May be repeated; 1, 2, ... 8 by default.",
            show_default=False,
        ),
    ] = None,
    masses: Annotated[
        list[float] | None,
        typer.Option(
            "--payload-mass",
            help="Mass of the payload, kg. May be repeated; 50, 200, 350, 500 by default.",
            show_default=False,
        ),
    ] = None,
    mass_error: Annotated[
        float, typer.Option(help="Error of the reported mass, as a part of the true one.")
    ] = 0.0,
    period: Annotated[float, typer.Option(help="Sampling period of the law, s.")] = 0.002,
    lag: Annotated[float, typer.Option(min=0.0, help="Time constant of the wheels, s.")] = 0.005,
    delay: Annotated[
        float, typer.Option(min=0.0, help="Delay of the sensors, s; in whole periods.")
    ] = 0.002,
    damping_ratio: Annotated[
        float, typer.Option(min=0.0, max=0.99, help="Damping ratio of every mode of the arm.")
    ] = 0.005,
    stiffness: Annotated[
        float, typer.Option(help="Stiffness of the arm, in multiples of what the law believes.")
    ] = 1.0,
    modes: Annotated[tuple[int, int], typer.Option(help="Assumed modes of each link.")] = (4, 4),
    plot: Annotated[
        Path | None, typer.Option(help="Draw the maps into this file (PNG).", show_default=False)
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing figure.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Show where a law keeps the flexible arm stable.

    A number is the rate (1/s) at which the worst small motion grows, at a fixed length: negative
    where every motion dies away. In the loop are the consistent plant, the wheels' lag, the delay
    of the sensors and the law at its sampling period; not the limits of the wheels.

    Example: drm stability --policy linear --policy servo --plot stability.png
    """
    with leaving_at_once():
        from drm_baselines.policies.pilots import law_data
        from drm_baselines.stability import Loop, StabilityMap, stability_map
        from drm_baselines.support import storage

    names = list(dict.fromkeys(policies or names_of("law")))
    laws: dict[str, Any] = {}
    for name in names:
        laws[name] = _lqg(period) if name == "lqg" else law_data(name)
    for option, value in (("period", period), ("stiffness", stiffness)):
        if not value > 0.0:
            raise BaselineError(f"--{option} must be positive, got {value:g}")
    if plot is not None:
        require("a picture of the stability", "plot")
        storage.claim_file(plot, force=force)
    loop = Loop(
        period=period,
        lag=lag,
        delay=delay,
        damping_ratio=damping_ratio,
        stiffness=stiffness,
        modes=modes,
    )
    lengths = sorted(set(extensions)) if extensions else [float(a) for a in range(1, 9)]
    payloads = sorted(set(masses)) if masses else [50.0, 200.0, 350.0, 500.0]
    maps: list[StabilityMap] = []
    with counting("payloads") as tell:
        for name, law in laws.items():
            rows = []
            for done, mass in enumerate(payloads):
                tell(name, done, len(payloads))
                rows.append(
                    stability_map(
                        find(name).title, law, lengths, [mass], mass_error=mass_error, loop=loop
                    )
                )
            maps.append(StabilityMap.stacked(rows))
    if as_json:
        say_json(
            {
                "units": "SI",
                "extensions": lengths,
                "payload_masses": payloads,
                "growth_rates": {
                    name: found.rates.tolist() for name, found in zip(names, maps, strict=True)
                },
            }
        )
    else:
        for found in maps:
            show(_table(found))
        say("growth rate of the worst motion, 1/s; * it grows")
    if plot is not None:
        from drm_baselines.stability.picture import plot_stability

        plot_stability(maps, plot, overwrite=force)
        if not as_json:
            say_files([plot])


def _lqg(period: float) -> Stepped:
    """The LQG, which is designed for a sampling period."""
    with leaving_at_once():
        from drm_baselines.optimal_control.lqg import Lqg, LqgLaw

    return LqgLaw(Lqg(period=period))


def _table(found: StabilityMap) -> Table:
    from rich.table import Table

    from drm_baselines.stability import STABLE

    table = Table(title=found.title, title_justify="left", header_style="bold")
    table.add_column("payload\n(kg)", justify="right")
    for a in found.extensions:
        table.add_column(f"{a:g} m", justify="right", no_wrap=True)
    for mass, row in zip(found.masses, found.rates, strict=True):
        cells = (f"{rate:.3g}{'*' if rate >= STABLE else ' '}" for rate in row)
        table.add_row(f"{mass:g}", *cells)
    return table
