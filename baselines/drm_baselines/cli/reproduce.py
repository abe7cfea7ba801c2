"""``drm reproduce``: the tables, figures and errata of the thesis, and what they leave out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drm_baselines.cli.common import guarded
from drm_baselines.cli.terminal import progress_bar, say, show
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once


@guarded
def reproduce(
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of a table, figure, claim, erratum or study, such as table-2-9, "
            "figure-4.63, erratum-tip-law or consistent-laws; its rows are printed. May be "
            "repeated; everything by default.",
            show_default=False,
        ),
    ] = None,
    show_list: Annotated[
        bool, typer.Option("--list", help="List the names and do nothing else.")
    ] = False,
    out: Annotated[
        Path,
        typer.Option(
            help="Directory for one picture a figure, the table of verdicts (CSV) and a page "
            "that holds everything (HTML)."
        ),
    ] = Path("results/thesis"),
    force: Annotated[
        bool,
        typer.Option("--force", help="Write into a directory that holds something else."),
    ] = False,
) -> None:
    """Compute the thesis' tables, figures, claims and errata again and judge each number.

    A number is reproduced, inferred (reproduced after a choice that the thesis does not state) or
    not reproduced, with the reason. The studies named consistent-* fly the plant that follows the
    particles and turns link 2 with link 1, which the thesis does not have.
    """
    require("drm reproduce", "evaluate", "jinja2", "matplotlib", "scipy")
    with leaving_at_once():
        from drm_baselines.thesis import select, terminal, writing

    if show_list:
        show(terminal.list_table())
        return
    chosen = select(only)
    with writing.claimed(out, force=force), progress_bar() as progress:
        task = progress.add_task("thesis", total=len(chosen), completed=-1, note="")
        results, files = writing.write_results(
            chosen,
            out,
            complete=not only,
            progress=lambda name: progress.update(task, advance=1, note=name),
        )
    if only:
        for entry, outcome in results:
            # A wide table runs on rather than lose its last columns.
            show(terminal.rows_table(entry, outcome), crop=False)
    else:
        show(terminal.overview_table(results))
        show(terminal.misses_table(results))
    say(writing.summary(results))
    say(f"wrote {len(files)} files, such as {files[-1]}")
