"""``drm benchmark``: bound, laws and learned policies over the frozen suites."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from drm_baselines.cli.common import JSON_HELP, complete_policy, guarded, json_target
from drm_baselines.cli.sharing import RayOption, place_of
from drm_baselines.cli.terminal import counting, note, say, say_files, say_json, show
from drm_baselines.policies.names import listed
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once


def _show(
    progress: Callable[[str, int, int], None], suite: str, label: str, done: int, total: int
) -> None:
    progress(f"{suite}: {label}", done, total)


@guarded
def benchmark(
    context: typer.Context,
    suite: Annotated[
        list[str] | None,
        typer.Option(
            "--suite",
            help="Suite: thesis, robust, heavy, unmodelled, rough or flexible; may be repeated; "
            "all by default.",
            show_default=False,
        ),
    ] = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            "--policy",
            help=f"Only these policies ({listed()}); may be repeated.",
            show_default=False,
            autocompletion=complete_policy,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
    json_file: Annotated[
        Path | None, typer.Option("--json-file", help="Write the aggregates to this file as JSON.")
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Directory of records, figures and the HTML page.")
    ] = Path("results/benchmark"),
    learned: Annotated[
        Path | None,
        typer.Option(
            help="Directory of trained policies (METHOD/seed_N) instead of those that come with "
            "the package.",
            show_default=False,
        ),
    ] = None,
    ray: RayOption = None,
    again: Annotated[
        bool, typer.Option("--again", help="Fly everybody anew, whatever records there are.")
    ] = False,
    documents: Annotated[
        Path | None,
        typer.Option(
            "--documents",
            help="Root of the project: its README.md and docs/benchmark.md get the tables, "
            "docs/images the figures.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Fly everybody over the suites, and make tables, figures and a page of the records.

    Laws fly at their own 2 ms, learned policies in the task they were trained in, all over the same
    episodes. Records are kept; a policy that has flown is not flown again. Lengths are in mm and
    angles in degrees in the tables, SI and radians in the files.
    """
    require("drm benchmark", "report")
    place = place_of(ray)
    with leaving_at_once():
        from drm_baselines import suites
        from drm_baselines.benchmark import competitors as competing
        from drm_baselines.benchmark import runner
        from drm_baselines.benchmark.report import documents as made
        from drm_baselines.benchmark.report import example, page, tables, targets
        from drm_baselines.policies.pilots import shipped_runs
        from drm_baselines.support import storage, workplace
        from drm_baselines.support.places import executor

    as_json, json_file = json_target(as_json, json_file, context.args)
    names = list(suite or suites.SUITES)
    for name in names:
        suites.suite_named(name)
    if learned is not None:
        competing.check_runs(learned)
    if json_file is not None:
        storage.claim_file(json_file, force=True)
    everybody = competing.chosen(competing.competitors(learned), policy)
    with workplace.noting(out, workplace.Work("drm benchmark")), executor(place) as workers:
        results = []
        for name in dict.fromkeys(names):
            begun = time.monotonic()
            with counting("episodes") as progress:
                shown = functools.partial(_show, progress, name)
                result = runner.fly_suite(
                    name,
                    everybody,
                    out,
                    again=again,
                    progress=shown,
                    told=note,
                    workers=workers,
                )
            results.append(result)
            if as_json:
                continue
            say(f"{name}: flights took {time.monotonic() - begun:.0f} s")
            show(tables.terminal_table(result))
            for text, verdict in targets.targets(result):
                say(f"{verdict}: {text}")
        if as_json:
            say_json(made.summary(results))
        figures = made.draw(results, out / "figures", learned or shipped_runs())
        written = [
            page.write_page(
                results,
                out / "benchmark.html",
                {caption: figures[caption] for caption in made.LINKED if caption in figures},
                flights=example.example_flights(names[0], everybody),
                overwrite=True,
            )
        ]
        if json_file is not None:
            written.append(made.write_summary(json_file, results, overwrite=True))
        if documents is not None:
            written += made.update_documents(documents, results, out / "figures")
    if not as_json:
        say_files(written)
