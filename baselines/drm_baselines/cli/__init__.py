"""The ``drm`` command: simulate, compare, train and evaluate from a terminal.

Each command lives in a module of its own. Modules that need torch are imported only when their
command runs, so that ``drm --help`` and the flights of control laws are fast and need no torch.
"""

from __future__ import annotations

import typer

from drm_baselines.cli.bench import bench
from drm_baselines.cli.benchmark import benchmark
from drm_baselines.cli.compare import compare
from drm_baselines.cli.demo import demo
from drm_baselines.cli.evaluate import evaluate
from drm_baselines.cli.imitate import imitate
from drm_baselines.cli.info import info
from drm_baselines.cli.modes import modes
from drm_baselines.cli.reproduce import reproduce
from drm_baselines.cli.simulate import simulate
from drm_baselines.cli.train import train
from drm_baselines.cli.tune import tune

app = typer.Typer(
    name="drm",
    help="Deployable Robotic Manipulator: simulate manoeuvres, compare control laws with learned "
    "policies, train and evaluate. Units are SI and radians unless an option's name ends in "
    "-deg.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for _command in (
    info, modes, simulate, compare, train, imitate, tune, evaluate, benchmark, demo, reproduce,
    bench,
):  # fmt: skip
    app.command()(_command)


def main() -> None:
    """Run the command line."""
    app()
