"""``drm benchmark``: bound, laws and learned policies over the frozen suites."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from drm_baselines.cli.common import console, errors, flight_progress, guarded


def _show(
    progress: Callable[[str, int, int], None], suite: str, label: str, done: int, total: int
) -> None:
    progress(f"{suite}: {label}", done, total)


def _say(line: str) -> None:
    errors.print(line, soft_wrap=True)


@guarded
def benchmark(
    suite: Annotated[
        list[str] | None,
        typer.Option(
            "--suite",
            help="Suite: thesis, robust, heavy, unmodelled or rough; may be repeated; all by "
            "default.",
            show_default=False,
        ),
    ] = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            "--policy",
            help="Only these policies (bound, none, linear, lyapunov, linear_tuned, "
            "lyapunov_tuned, lqr, dagger, ppo, ...); may be repeated.",
            show_default=False,
        ),
    ] = None,
    as_json: Annotated[
        Path | None, typer.Option("--json", help="File for the aggregates as JSON.")
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
    from drm_baselines import storage
    from drm_baselines.benchmark import field, report, run, suites

    names = list(suite or suites.SUITES)
    for name in names:
        suites.suite_named(name)
    if learned is not None:
        field.check_runs(learned)
    if as_json is not None and as_json.is_dir():
        storage.refuse(as_json)
    everybody = field.chosen(field.competitors(learned), policy)
    results = []
    for name in dict.fromkeys(names):
        begun = time.monotonic()
        with flight_progress() as progress:
            shown = functools.partial(_show, progress, name)
            result = run.fly_suite(name, everybody, out, again=again, progress=shown, told=_say)
        results.append(result)
        console.print(f"{name}: flights took {time.monotonic() - begun:.0f} s", highlight=False)
        console.print(report.terminal_table(result))
        for text, verdict in report.targets(result):
            console.print(f"{verdict}: {text}", highlight=False)
    figures = run.draw(results, out / "figures", learned or field.shipped_runs())
    written = [report.write_page(results, out / "benchmark.html", figures, overwrite=True)]
    if as_json is not None:
        written.append(run.write_summary(as_json, results, overwrite=True))
    if documents is not None:
        written += run.update_documents(documents, results, out / "figures")
    console.print("wrote " + ", ".join(str(path) for path in written), soft_wrap=True)
