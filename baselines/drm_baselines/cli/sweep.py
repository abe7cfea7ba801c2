"""``drm sweep``: Monte Carlo over payload, misreport and policy."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drm_baselines.cli.common import (
    JSON_HELP,
    POLICY_HELP,
    SET_HELP,
    complete_env,
    complete_policy,
    guarded,
    parse_options,
)
from drm_baselines.cli.sharing import ProcessesOption, RayOption, place_of
from drm_baselines.cli.terminal import counting, note, say, say_files, say_json, show
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once

if TYPE_CHECKING:
    from rich.table import Table

    from drm_baselines.sweep.cost import Cost
    from drm_baselines.sweep.summary import Summary

MOST_EPISODES = 10**9
"""Most episodes of a sweep: those that have seeds of their own."""


@guarded
def sweep(
    policies: Annotated[
        list[str] | None,
        typer.Option(
            "--policy",
            "--law",
            help=f"Who flies: a policy by name ({POLICY_HELP}) or the directory of a training run. "
            "May be repeated; linear, lyapunov and lqr by default.",
            show_default=False,
            autocompletion=complete_policy,
        ),
    ] = None,
    episodes: Annotated[
        int,
        typer.Option(min=1, max=MOST_EPISODES, help="Manoeuvres that everybody flies."),
    ] = 10_000,
    payload_mass: Annotated[
        tuple[float, float],
        typer.Option(help="Range of the payload, kg, drawn uniformly.", metavar="LOW HIGH"),
    ] = (50.0, 500.0),
    mass_error: Annotated[
        float,
        typer.Option(
            help="Largest error of the reported mass, as a part of the true one; drawn uniformly "
            "from both sides of zero."
        ),
    ] = 0.15,
    env_id: Annotated[
        str,
        typer.Option(
            "--env", help="Environment whose episodes are flown.", autocompletion=complete_env
        ),
    ] = "drm_env/Slew-v0",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first episode.")] = 0,
    out: Annotated[Path, typer.Option(help="Directory of the sweep.")] = Path("results/sweep"),
    ray: RayOption = None,
    processes: ProcessesOption = 1,
    cost: Annotated[
        bool,
        typer.Option(
            "--cost",
            help="Only say what the sweep would cost, measured on one core of this machine.",
        ),
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Start anew in a directory that holds something else.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
    set_options: Annotated[list[str] | None, typer.Option("--set", help=SET_HELP)] = None,
) -> None:
    """Fly policies over very many manoeuvres, and show the tip error over payload and misreport.

    Every block of episodes is kept as a Parquet file as soon as it has been flown; the same command
    goes on where it was interrupted, and adds --policy and --episodes to what is there. Episode i
    is that of reset(seed=SEED + i), as in drm compare.
    """
    require("drm sweep", "report", "matplotlib", "pyarrow", "scipy")
    place = place_of(ray, processes)
    with leaving_at_once():
        from drm_baselines.sweep import runner
        from drm_baselines.sweep.request import SweepRequest

    request = SweepRequest(
        policies=tuple(policies or ("linear", "lyapunov", "lqr")),
        env_id=env_id,
        options=parse_options(set_options),
        payload_mass=payload_mass,
        mass_error=mass_error,
        episodes=episodes,
        seed=seed,
    )
    if cost:
        from drm_baselines.sweep.cost import costs_of

        costs = costs_of(request)
        if as_json:
            say_json({"policies": [each.to_dict() for each in costs]})
        else:
            show(_cost_table(costs, episodes))
        return
    begun = time.monotonic()
    with counting("episodes") as progress:
        outcome = runner.sweep(out, request, place=place, force=force, progress=progress)
    if outcome.found:
        note(f"went on with {out}: {outcome.found} blocks were there, {outcome.flown} are new")
    from drm_baselines.sweep.parts import EPISODES
    from drm_baselines.sweep.picture import PICTURE_FILE, plot_sweep
    from drm_baselines.sweep.summary import summary_of, write_summary

    summary = summary_of(out, outcome.fleet)
    files = [
        out / EPISODES,
        write_summary(out, summary),
        plot_sweep(summary, out / PICTURE_FILE),
    ]
    if as_json:
        say_json(summary.to_dict())
        return
    show(_table(summary, title=f"{env_id}, seeds {seed}..{seed + episodes - 1}"))
    say(f"took {time.monotonic() - begun:.0f} s")
    say_files(files)


def _table(summary: Summary, *, title: str) -> Table:
    from rich.table import Table

    from drm_baselines.evaluation.metrics import describe
    from drm_baselines.evaluation.tables import number
    from drm_baselines.sweep.summary import QUANTILES

    metric = describe("tip_error_rms")

    def shown(value: float) -> str:
        return number(value * metric.scale, metric.digits)

    table = Table(title=title, title_justify="left", header_style="bold")
    table.add_column("policy")
    table.add_column("episodes", justify="right")
    for level in QUANTILES:
        table.add_column(
            f"tip error ({metric.unit})\n" + ("median" if level == 0.5 else f"{100 * level:g} %"),
            justify="right",
        )
    table.add_column("worst", justify="right")
    table.add_column("its seed", justify="right")
    table.add_column("settled\n(%)", justify="right")
    table.add_column("diverged\n(%)", justify="right")
    for each in summary.figures.values():
        low, high = each.median_interval
        cells = [shown(each.quantiles[level]) for level in QUANTILES]
        cells[0] += f"\n[{shown(low)}, {shown(high)}]"
        table.add_row(
            each.title,
            f"{each.episodes:,}",
            *cells,
            shown(each.worst),
            str(each.worst_seed),
            number(100.0 * each.settled, 2),
            number(100.0 * each.diverged, 4),
        )
    table.caption = "Quantiles over all episodes, with the 95 % interval of the median."
    table.caption_justify = "left"
    return table


def _cost_table(costs: list[Cost], episodes: int) -> Table:
    from rich.table import Table

    table = Table(
        title="measured on one core of this machine", title_justify="left", header_style="bold"
    )
    table.add_column("policy")
    for name in (
        "an episode\n(ms)", "a million episodes\n(core hours)",
        f"{episodes:,} episodes\n(core hours)", "a block\n(episodes)", "a block\n(s)",
        "job\n(kB)", "result\n(kB)", "a million\n(MB on disk)",
    ):  # fmt: skip
        table.add_column(name, justify="right")
    for each in costs:
        hours = each.seconds / 3600.0
        table.add_row(
            each.policy,
            f"{1e3 * each.seconds:.3f}",
            f"{1e6 * hours:.2f}",
            f"{episodes * hours:.2f}",
            f"{each.block:,}",
            f"{each.block * each.seconds:.1f}",
            f"{each.job_bytes / 1e3:.1f}",
            f"{each.result_bytes / 1e3:.0f}",
            f"{each.disk_bytes:.0f}",
        )
    return table
