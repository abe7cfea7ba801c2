"""All commands put together."""

from __future__ import annotations

from typing import Annotated

import typer

from drm_baselines.cli.bench import bench
from drm_baselines.cli.benchmark import benchmark
from drm_baselines.cli.common import guarded
from drm_baselines.cli.compare import compare
from drm_baselines.cli.demo import demo
from drm_baselines.cli.evaluate import evaluate
from drm_baselines.cli.imitate import imitate
from drm_baselines.cli.info import info
from drm_baselines.cli.mission import mission
from drm_baselines.cli.modes import modes
from drm_baselines.cli.plan import plan
from drm_baselines.cli.render import render
from drm_baselines.cli.reproduce import reproduce
from drm_baselines.cli.sharing import WithRay
from drm_baselines.cli.simulate import simulate
from drm_baselines.cli.size import size
from drm_baselines.cli.stability import stability
from drm_baselines.cli.sweep import sweep
from drm_baselines.cli.terminal import say
from drm_baselines.cli.train import train
from drm_baselines.cli.tune import tune

app = typer.Typer(
    name="drm",
    help="Deployable Robotic Manipulator: simulate manoeuvres, compare control laws with learned "
    "policies, train and evaluate. Units are SI and radians unless an option's name ends in "
    "-deg. Exit codes: 0 done, 2 refused or failed with a message, 128 and the signal's number "
    "interrupted, 1 a fault of this program.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@guarded
def _say_versions() -> None:
    import drm_baselines
    import drm_env

    say(f"drm-baselines {drm_baselines.__version__}, drm-env {drm_env.__version__}")


def _show_version(wanted: bool) -> None:
    if wanted:
        _say_versions()
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show versions and exit."
        ),
    ] = False,
) -> None:
    # options of `drm` itself
    pass


for _command in (
    info, modes, stability, plan, size, simulate, mission, compare, render, train, imitate, tune,
    evaluate, benchmark, sweep, demo, reproduce, bench,
):  # fmt: skip
    # these two see to the file that --json took once
    _loose = _command in (benchmark, bench)
    app.command(
        cls=WithRay if _command in (benchmark, sweep, train, tune) else None,
        context_settings={"allow_extra_args": True} if _loose else None,
    )(_command)
