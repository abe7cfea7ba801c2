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
from drm_baselines.errors import BaselineError
from drm_baselines.policies.names import listed
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once


def _show(
    progress: Callable[[str, int, int], None], suite: str, label: str, done: int, total: int
) -> None:
    progress(f"{suite}: {label}", done, total)


def _check_together(*, recorded: bool, submit: bool, given: dict[str, bool]) -> None:
    """Refuse options that have no meaning where records are used in the place of flights.

    Raises
    ------
    BaselineError
        The message names the two.
    """
    for name, is_given in given.items():
        if is_given and (recorded or submit):
            other = "--from-records" if recorded else "--submit"
            raise BaselineError(f"{name} cannot be given with {other}: others are not flown there")


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
    from_records: Annotated[
        bool,
        typer.Option(
            "--from-records",
            help="Fly nobody: make everything of the records that come with the package.",
        ),
    ] = False,
    records: Annotated[
        Path | None,
        typer.Option(
            help="Directory of such records (SUITE.parquet) instead of those of the package.",
            show_default=False,
        ),
    ] = None,
    submit: Annotated[
        list[str] | None,
        typer.Option(
            "--submit",
            help="Fly a policy of your own and add its row to the records: NAME=DIRECTORY of an "
            "exported policy, or NAME=module:attribute, an object with predict (the module is "
            "imported, which runs it); may be repeated.",
            show_default=False,
        ),
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            help="Also write the records there, small enough to be kept: SUITE.parquet and "
            "summary.json.",
            show_default=False,
        ),
    ] = None,
    package: Annotated[
        bool, typer.Option("--package", help="Also keep the records with the package, as its own.")
    ] = False,
    again: Annotated[
        bool, typer.Option("--again", help="Fly everybody anew, whatever records there are.")
    ] = False,
    documents: Annotated[
        Path | None,
        typer.Option(
            "--documents",
            help="Root of the project: README.md, docs/benchmark.md and docs/leaderboard.md get "
            "their tables, docs/images the figures.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Fly everybody over the suites, and make tables, figures and a page of the records.

    Laws fly at their own 2 ms, learned policies in the task they were trained in, all over the same
    episodes. Records are kept; a policy that has flown is not flown again. With --from-records
    nobody flies, with --submit your policy alone, and all others are taken from records. Lengths
    are in mm and angles in degrees in the tables, SI and radians in the files.
    """
    require("drm benchmark", "report")
    place = place_of(ray)
    with leaving_at_once():
        from drm_baselines import suites
        from drm_baselines.benchmark import competitors as competing
        from drm_baselines.benchmark import kept, recording, runner, submissions
        from drm_baselines.benchmark.report import documents as made
        from drm_baselines.benchmark.report import example, page, tables, targets
        from drm_baselines.policies import names as names_module
        from drm_baselines.policies.pilots import shipped_runs
        from drm_baselines.support import storage, workplace
        from drm_baselines.support.places import executor

    as_json, json_file = json_target(as_json, json_file, context.args)
    recorded = from_records or records is not None
    _check_together(
        recorded=recorded,
        submit=bool(submit),
        given={"--again": again and recorded and not submit, "--learned": learned is not None,
               "--ray": ray is not None and recorded, "--keep": keep is not None,
               "--package": package},
    )  # fmt: skip
    for name in suite or ():
        suites.suite_named(name)
    source = kept.packaged() if records is None else records
    names = list(dict.fromkeys(suite or (kept.suites_in(source) if recorded else suites.SUITES)))
    if learned is not None:
        competing.check_runs(learned)
    if json_file is not None:
        storage.claim_file(json_file, force=True)
    strangers = submissions.submitted(submit or ())
    from_file = recorded or bool(strangers)
    everybody: list[competing.Competitor] = list(strangers)
    if not from_file:
        everybody = competing.chosen(competing.competitors(learned), policy)
    wanted = [names_module.find(name).name for name in policy or ()]
    with workplace.noting(out, workplace.Work("drm benchmark")), executor(place) as workers:
        results = []
        for name in names:
            begun = time.monotonic()
            flown = None
            if everybody:
                with counting("episodes") as progress:
                    shown = functools.partial(_show, progress, name)
                    flown = runner.fly_suite(
                        name,
                        everybody,
                        out,
                        again=again,
                        progress=shown,
                        told=note,
                        workers=workers,
                    )
            if from_file:
                result = recording.recorded(source, name, out, flown, wanted)
            else:
                assert flown is not None, "somebody flies"
                result = flown
                for directory in recording.places(keep, package=package):
                    result = recording.kept_result(directory, result, everybody)
            results.append(result)
            if as_json:
                continue
            if flown is not None:
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
                flights=None if from_file else example.example_flights(names[0], everybody),
                overwrite=True,
            )
        ]
        if json_file is not None:
            written.append(made.write_summary(json_file, results, overwrite=True))
        for directory in recording.places(keep, package=package):
            written.append(recording.write_summary(directory))
        if documents is not None:
            written += made.update_documents(documents, results, out / "figures")
            if kept.suites_in(kept.packaged()):
                written += made.update_leaderboard(documents, kept.results_in(kept.packaged()))
    if not as_json:
        say_files(written)
