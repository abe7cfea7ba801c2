"""``drm tune``: search the gains of control laws, or the settings of learning."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drm_baselines.cli.common import (
    JSON_HELP,
    MOST_MANOEUVRES,
    MOST_STEPS,
    MOST_TRIALS,
    guarded,
)
from drm_baselines.cli.sharing import ProcessesOption, RayOption, place_of
from drm_baselines.cli.terminal import counting, note, say, say_files, say_json, show
from drm_baselines.errors import BaselineError
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import exit_code, leaving_at_once

if TYPE_CHECKING:
    from rich.table import Table

    from drm_baselines.tuning.trials import Outcome

_RESULTS = Path("results") / "tune"


def _table(content: dict[str, Any]) -> Table:
    from rich.table import Table

    units = {each["name"]: each["unit"] for each in content["search"]["space"]}
    table = Table(header_style="bold")
    table.add_column("parameter")
    table.add_column("best", justify="right")
    table.add_column("unit")
    for name, value in content["parameters"].items():
        unit = units[name]
        table.add_row(name, f"{value:.5g}", "" if unit == "1" else unit)
    return table


def _report(outcome: Outcome) -> None:
    content = outcome.content
    objective, trials = content["objective"], content["trials"]
    show(_table(content))
    first = objective["first"]
    digits = 2 if objective["value"] >= 1.0 else 4
    since = "" if first is None else f" (first trial: {first:.{digits}f} mm)"
    say(
        f"{content['name']}: tip error RMS {objective['value']:.{digits}f} mm{since}, trial "
        f"{trials['best']} of {trials['count']}, {trials['pruned']} of them not flown; "
        f"{content['budget']['wall_seconds']:.0f} s"
    )
    if confirmation := content.get("confirmation"):
        low, high = (confirmation["difference"][name] for name in ("low", "high"))
        say(
            f"on {confirmation['count']} fresh manoeuvres {confirmation['value']:.4g} mm, first "
            f"trial {confirmation['first']:.4g} mm, in pairs {low:+.3g} to {high:+.3g} mm: the "
            f"{'best' if confirmation['taken'] else 'first'} trial's settings are taken"
        )
    if content["at_edge"]:
        say(f"at the edge of the search: {', '.join(content['at_edge'])}")
    say_files(outcome.files)


@guarded
def tune(
    target: Annotated[
        str,
        typer.Argument(
            help="Law whose gains are searched (linear, lyapunov, lqr), or controller (receding) "
            "or learning algorithm (ppo, sac, td3, tqc, crossq, recurrent_ppo) whose settings are."
        ),
    ],
    suite: Annotated[
        str | None,
        typer.Option(
            help="Laws, controller: suite whose distributions the manoeuvres are drawn from, on "
            "seeds of training; robust by default.",
            show_default=False,
        ),
    ] = None,
    scenarios: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MOST_MANOEUVRES,
            help="Laws, controller: manoeuvres of all four strata together; 400 for laws, 24 for "
            "the controller by default.",
            show_default=False,
        ),
    ] = None,
    steps: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MOST_STEPS,
            help="Learning: environment steps of each training; 400,000 by default.",
            show_default=False,
        ),
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MOST_TRIALS,
            help="Trials in all, including those of an earlier start; 200 for laws, 24 for "
            "the controller, 20 for learning by default.",
            show_default=False,
        ),
    ] = None,
    env_id: Annotated[
        str | None,
        typer.Option(
            "--env",
            help="Learning: environment; drm_env/SlewResidual-v0 by default.",
            show_default=False,
        ),
    ] = None,
    hyperparameters: Annotated[
        Path | None,
        typer.Option(
            help="Learning: TOML file with the settings of the first trial; the packaged ones by "
            "default.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=999, help="Seed of the search.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory of the search; results/tune/TARGET by default (TARGET_direct for "
            "settings searched in drm_env/Slew-v0 or -v1).",
            show_default=False,
        ),
    ] = None,
    at_once: Annotated[
        int,
        typer.Option(
            "--at-once",
            min=1,
            max=1024,
            help="Trials that are drawn together, knowing those before them alone, and so can be "
            "run side by side. The digits depend on this number, and not on where trials are run.",
        ),
    ] = 1,
    ray: RayOption = None,
    processes: ProcessesOption = 1,
    package: Annotated[
        bool,
        typer.Option(
            "--package",
            help="Also put the gains into the package, as its own, or the settings, as those of "
            "the controller, of the benchmark's learner or, for another algorithm, of drm train.",
        ),
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Start anew in a directory that is not empty.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Tune the gains of a law, or search the settings of a controller or learning algorithm.

    Laws and the controller are judged by the interquartile mean of the tip error over drawn
    manoeuvres, settings of learning by that of a short training's policy. The first trial is what
    there is: the thesis' gains, the settings chosen by hand, the packaged ones. The controller's
    best trial is taken only if it is better than the first on fresh manoeuvres of training. The
    same command goes on with a search that was interrupted (Ctrl-C keeps what is there) and ends
    with the same digits; more --trials extend one.
    """
    require("drm tune", "tune", "clarabel", "optuna", "piqp", "scipy")
    if at_once == 1 and (ray is not None or processes != 1):
        raise BaselineError("--ray and --processes share out the trials of --at-once, which is 1")
    place = place_of(ray, processes)
    with leaving_at_once():
        from drm_baselines.tuning import (
            controllers,
            laws,
            learners,
            packaging,
            space,
        )

    space.check_target(target)
    is_law, is_controller = target in space.GAINS, target in space.SETTINGS
    given = (
        {"--steps": steps, "--env": env_id, "--hyperparameters": hyperparameters}
        if is_law or is_controller
        else {"--suite": suite, "--scenarios": scenarios}
    )  # fmt: skip
    for name, value in given.items():
        if value is not None:
            raise BaselineError(f"{name} means nothing for {target}")
    with counting() as progress:
        asked: dict[str, Any] = {"suite": suite, "scenarios": scenarios, "trials": trials}
        asked = {name: value for name, value in asked.items() if value is not None}
        asked |= {"seed": seed, "at_once": at_once}
        if is_law:
            request = laws.LawRequest(law=target, **asked)
            command = request.command
            directory = out if out is not None else _RESULTS / target
            outcome = laws.tune_law(directory, request, force=force, progress=progress, place=place)
        elif is_controller:
            wanted = controllers.ControllerRequest(controller=target, **asked)
            command = wanted.command
            directory = out if out is not None else _RESULTS / target
            outcome = controllers.tune_controller(
                directory, wanted, force=force, progress=progress, place=place
            )
        else:
            settings = learners.LearningRequest(
                algorithm=target,
                steps=steps if steps is not None else 400_000,
                trials=trials if trials is not None else 20,
                seed=seed,
                base=hyperparameters,
                env_id=env_id if env_id is not None else learners.ENV_ID,
                at_once=at_once,
            )
            if package:
                packaging.check_package(settings)
            command = settings.command
            directory = out if out is not None else _RESULTS / settings.learner
            outcome = learners.tune_learning(
                directory, settings, force=force, progress=progress, place=place
            )
    count = outcome.content["trials"]["count"]
    if outcome.found:
        note(
            f"went on with {directory}: {outcome.found} trials were there, "
            f"{count - outcome.found} are new"
        )
    if as_json:
        say_json(outcome.content)
    else:
        _report(outcome)
    if outcome.interrupted:
        note(
            f"interrupted after {count} trials; go on with: {command} "
            f"--out {shlex.quote(str(directory))}"
        )
        raise typer.Exit(exit_code())
    if package:
        path = packaging.package(outcome)
        note(f"packaged {path.name}")
