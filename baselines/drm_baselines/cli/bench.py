"""``drm bench``: what the engine costs, as ratios to what is measured beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drm_baselines.cli.common import JSON_HELP, MOST_STEPS, guarded, json_target
from drm_baselines.cli.terminal import counting, note, output, say_files, say_json, show
from drm_baselines.errors import BaselineError
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once

if TYPE_CHECKING:
    from rich.table import Table


def _list_table(sections: dict[str, str]) -> Table:
    from rich.table import Table

    table = Table(header_style="bold")
    table.add_column("section")
    table.add_column("what is measured")
    for name, text in sections.items():
        table.add_row(name, text)
    return table


@guarded
def bench(
    context: typer.Context,
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="Section to run (--list names them). May be repeated; all by default.",
            show_default=False,
        ),
    ] = None,
    show_list: Annotated[
        bool, typer.Option("--list", help="List the sections and do nothing else.")
    ] = False,
    repeats: Annotated[
        int, typer.Option(min=1, max=1000, help="Measurements of each candidate.")
    ] = 5,
    seconds: Annotated[
        int,
        typer.Option(
            min=1, max=3600, help="About how long one measurement of a stepping loop lasts, s."
        ),
    ] = 1,
    episodes: Annotated[
        int, typer.Option(min=1, max=1_000_000, help="Episodes of the section rollout.")
    ] = 10_000,
    long: Annotated[
        int,
        typer.Option(
            min=1, max=MOST_STEPS, help="Environment steps over which memory is watched for growth."
        ),
    ] = 1_000_000,
    out: Annotated[
        Path | None,
        typer.Option(help="Directory for bench.json, bench.csv and pictures (PNG)."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
    json_file: Annotated[
        Path | None, typer.Option("--json-file", help="Write the results to this file as JSON.")
    ] = None,
    markdown: Annotated[
        Path | None,
        typer.Option(
            help="Write the tables into this Markdown file, between the comments "
            "'<!-- drm bench: begin SECTION -->' and '<!-- drm bench: end SECTION -->', or "
            "at its end where a section has none."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing results.")] = False,
) -> None:
    """Measure the engine beside its yardsticks.

    Each candidate is measured in turn, again and again, on the machine as it is; a row shows the
    median with the smallest and the largest, and the ratio to another candidate of the same run,
    taken pair by pair. What cannot be measured here (no C compiler, no numba, no valgrind) is
    said below the table; a last table holds all ratios. Close other programs first.
    """
    with leaving_at_once():
        import drm_env
        from drm_baselines.speed import report, sections
        from drm_baselines.speed.results import Bench
        from drm_baselines.support import storage

    if show_list:
        show(_list_table(sections.SECTIONS))
        return
    as_json, json_file = json_target(as_json, json_file, context.args)
    names = sections.chosen(only)
    if json_file is not None:
        storage.claim_file(json_file, force=force)
    if markdown is not None:
        report.check_markdown(markdown, names)
    if out is not None:
        require("pictures of the measurements (--out)", "bench", "matplotlib")
        storage.claim_directory(out, force=force)
    kept = any(place is not None for place in (json_file, markdown, out))
    results = []
    current = names[0]
    stopped: Exception | KeyboardInterrupt | None = None
    with counting("measurements") as progress:
        settings = Bench(repeats, seconds, episodes, long, progress)
        try:
            for current in names:
                results.append(sections.run(current, settings))
                if not as_json:
                    show(report.terminal_table(results[-1]))
                if output.failure is not None and not kept:
                    break
        except (BaselineError, drm_env.DrmError, OSError, KeyboardInterrupt) as reason:
            stopped = reason
    if len(results) > 1 and not as_json:
        show(report.ratio_table(results))
    files = []
    content = report.data(results, settings)
    if as_json:
        say_json(content)
    if json_file is not None:
        files.append(storage.write_json(json_file, content, overwrite=force))
    if markdown is not None:
        files.append(report.update_markdown(markdown, results, settings))
    if out is not None:
        from drm_baselines.speed import plots

        files.append(storage.write_json(out / "bench.json", content, overwrite=force))
        files.append(report.write_csv(out / "bench.csv", results, overwrite=force))
        files.extend(plots.plot_all(results, out, overwrite=force))
    if not as_json:
        say_files(files)
    if stopped is not None:
        note(f"stopped in section {current}; those before it are complete")
        raise stopped
