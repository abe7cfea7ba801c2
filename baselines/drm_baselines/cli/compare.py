"""``drm compare``: policies side by side on the same episodes."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated

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
from drm_baselines.cli.terminal import console, counting, say_files, say_json, show
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once


@guarded
def compare(
    policies: Annotated[
        list[str] | None,
        typer.Argument(
            help=f"Policies by name ({POLICY_HELP}) or directories of training runs; none, linear "
            "and lyapunov by default. The first is the reference of the paired comparison.",
            show_default=False,
            autocompletion=complete_policy,
        ),
    ] = None,
    env_id: Annotated[
        str,
        typer.Option(
            "--env", help="Environment whose episodes are flown.", autocompletion=complete_env
        ),
    ] = "drm_env/Slew-v0",
    episodes: Annotated[int, typer.Option(min=1, help="Number of episodes.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first episode.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="Directory for comparison.json, episodes.csv and figures (PNG)."),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option(
            help="File for a report in HTML that needs no network: tables, every episode, linked "
            "charts and the arm in motion for three of them.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing results.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
    set_options: Annotated[list[str] | None, typer.Option("--set", help=SET_HELP)] = None,
) -> None:
    """Fly policies over the same episodes and compare them.

    Laws decide every 2 ms, the sampling period of their gains; trained policies at the period
    they were trained with; the bound and the receding-horizon controller plan a whole manoeuvre,
    which takes seconds each. Lengths are in mm and angles in degrees in the table, SI and radians
    in the files.
    """
    require("drm compare", "evaluate", "scipy", *(["matplotlib"] if out is not None else []))
    with leaving_at_once():
        from drm_baselines.evaluation.comparison import report_of, write_comparison
        from drm_baselines.evaluation.contestants import Arena, contestant_named, fly_all
        from drm_baselines.evaluation.tables import comparison_tables, paired_table
        from drm_baselines.support import storage
        from drm_baselines.support.seeds import episode_seeds

    episode_seeds(seed, episodes)
    arena = Arena(env_id=env_id, options=parse_options(set_options), seed=seed, episodes=episodes)
    contestants = [
        contestant_named(arena, text) for text in policies or ["none", "linear", "lyapunov"]
    ]
    if out is not None:
        storage.claim_directory(out, force=force)
    if html is not None:
        require("a report (--html)", "evaluate", "jinja2")
        storage.claim_file(html, force=force)
    with counting("episodes") as progress:
        flights = fly_all(contestants, arena, progress)
    report = report_of(flights, arena)
    if as_json:
        say_json(report)
    else:
        show(*comparison_tables(flights, title=f"{env_id}, seeds {seed}..", width=console.width))
        for label, entry in report["paired"]["candidates"].items():
            show(paired_table(entry, title=f"{label} minus {report['paired']['reference']}"))
    files = []
    if html is not None:
        from drm_baselines.evaluation.reports import comparison_page
        from drm_baselines.pages.writer import write_page

        with counting("flights") as progress:
            told = functools.partial(progress, "report")
            page = comparison_page(contestants, flights, report, arena, told=told)
        files.append(write_page(page, html, overwrite=True))
    if out is not None:
        from drm_baselines.evaluation import plots

        files += write_comparison(out, flights, report, title=env_id, overwrite=force)
        trajectories = {
            contestant.label: contestant.trajectory(arena) for contestant in contestants
        }
        title = f"{env_id}, seed {seed}"
        picture = out / "manoeuvre.png"
        link1 = arena.config.scenario.arm.link1.length
        plots.plot_manoeuvres(trajectories, picture, title=title, link1=link1, overwrite=force)
        files.append(picture)
    if files and not as_json:
        say_files(files)
