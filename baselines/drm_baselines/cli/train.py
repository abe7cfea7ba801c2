"""``drm train``: train a policy, or go on with an interrupted run."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drm_baselines.cli.common import MOST_STEPS, SET_HELP, complete_env, guarded, parse_options
from drm_baselines.cli.sharing import ProcessesOption, RayOption, place_of
from drm_baselines.cli.terminal import counting, progress_bar, say
from drm_baselines.errors import BaselineError
from drm_baselines.rl import hyperparameters as settings_files
from drm_baselines.support.extras import needing, require
from drm_baselines.support.interruption import exit_code, leaving_at_once

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from drm_baselines.rl.request import Point, TrainingRequest
    from drm_baselines.support.places import Place


class ConsoleWatcher:
    """Shows a run as a progress bar, and each point of its learning curve as a line."""

    def __init__(self, progress: Progress, total: int, done: int = 0) -> None:
        self._progress = progress
        self._task: TaskID = progress.add_task(
            "training", total=total, completed=done, note="steps"
        )
        self.points: list[Point] = []

    def advanced(self, steps: int, recent: Mapping[str, float]) -> None:
        """Move the bar; show the tip error with exploration noise."""
        note = "steps"
        if "tip_error_rms" in recent:
            note = f"steps, with noise {recent['tip_error_rms'] * 1e3:.1f} mm"
        self._progress.update(self._task, completed=steps, note=note)

    def evaluated(self, point: Point) -> None:
        """Print the point."""
        from drm_baselines.evaluation.metrics import describe
        from drm_baselines.evaluation.tables import interval

        self.points.append(point)
        self._progress.update(self._task, completed=point.steps)
        cells = []
        for name in ("tip_error_rms", "residual_rms", "settled"):
            metric = describe(name)
            cells.append(
                f"{metric.label} {interval(point.episodes.estimate(name), metric)} {metric.unit}"
            )
        say(f"{point.steps:>10,} steps {point.wall_time:6.0f} s   " + "   ".join(cells))


def training_module() -> Any:
    """Import the training code, which needs the ``learn`` extra.

    Raises
    ------
    MissingPackageError
        Torch, Stable-Baselines3 or SciPy is not installed.
    """
    require("training", "learn", "scipy", "stable_baselines3", "torch")
    with leaving_at_once(), needing("training", "learn"):
        from drm_baselines.rl import training
    return training


def _several(out: Path, request: TrainingRequest, text: str, place: Place, force: bool) -> None:
    """Train several seeds and say how each has ended."""
    with leaving_at_once(), needing("training", "learn"):
        from drm_baselines.rl import several

    seeds = several.parse_seeds(text)
    with counting("steps") as progress:
        records = several.train_seeds(
            out,
            request,
            seeds,
            place=place,
            force=force,
            progress=lambda seed, done, total: progress(f"seed {seed}", done, total),
        )
    for seed, record in records.items():
        say(
            f"seed {seed}: {record.status} after {record.steps:,} steps and "
            f"{record.wall_time:.0f} s of training"
        )
    say(f"saved in {out}")


@guarded
def train(
    out: Annotated[Path, typer.Option(help="Directory of the run.")],
    algo: Annotated[
        str | None,
        typer.Option(
            help=f"Algorithm: {', '.join(settings_files.ALGORITHMS)}; ppo by default.",
            show_default=False,
        ),
    ] = None,
    env_id: Annotated[
        str | None,
        typer.Option(
            "--env",
            help="Environment; drm_env/SlewResidual-v0 by default.",
            show_default=False,
            autocompletion=complete_env,
        ),
    ] = None,
    steps: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MOST_STEPS,
            help="Environment steps in all, over all environments and including "
            "those done before a --resume; 4,000,000 by default.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=999,
            help="Seed of networks, noise and episodes; 0 by default.",
            show_default=False,
        ),
    ] = None,
    seeds: Annotated[
        str | None,
        typer.Option(
            help="Several seeds, such as 0-9 or 0,2,5-7: a run each, in --out/seed_N. The same "
            "command goes on with those that are not finished.",
            show_default=False,
        ),
    ] = None,
    n_envs: Annotated[
        int | None,
        typer.Option(
            "--n-envs",
            min=1,
            max=settings_files.MOST_ENVS,
            help="Environments stepped as one batch; those of the hyperparameters by default.",
            show_default=False,
        ),
    ] = None,
    hyperparameters: Annotated[
        Path | None, typer.Option(help="TOML file of settings instead of the packaged ones.")
    ] = None,
    start: Annotated[
        Path | None,
        typer.Option(
            help="Directory of a policy to begin with, such as one of drm imitate; its task and "
            "layers are taken over unless --env and --hyperparameters say otherwise.",
            show_default=False,
        ),
    ] = None,
    evaluations: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MOST_STEPS,
            help="Points of the learning curve; 10 by default.",
            show_default=False,
        ),
    ] = None,
    evaluation_episodes: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="Episodes behind each point of the learning curve; 100 by default.",
            show_default=False,
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the run in --out.")] = False,
    trust: Annotated[
        bool,
        typer.Option(
            "--trust",
            help="With --resume: load a checkpoint that was written by another user or on another "
            "machine, which runs whatever its maker wants.",
        ),
    ] = False,
    ray: RayOption = None,
    processes: ProcessesOption = 1,
    force: Annotated[
        bool, typer.Option("--force", help="Start anew in a directory that is not empty.")
    ] = False,
    set_options: Annotated[list[str] | None, typer.Option("--set", help=SET_HELP)] = None,
) -> None:
    """Train a policy; Ctrl-C (SIGTERM, SIGHUP) saves the run, which --resume then continues.

    The directory receives run.json (everything needed to repeat the run), the policy as
    safetensors and JSON, the learning curve as CSV, TensorBoard events and a checkpoint. The
    checkpoint is a pickle that --resume alone reads, and only if you have written it on this
    machine or say --trust.
    """
    if seeds is None and (ray is not None or processes != 1):
        raise BaselineError("--ray and --processes share out --seeds: one training is one job")
    if seeds is not None and seed is not None:
        raise BaselineError("give either --seed or --seeds")
    if resume:
        given = {"--algo": algo, "--env": env_id, "--seed": seed, "--seeds": seeds,
                 "--n-envs": n_envs,
                 "--hyperparameters": hyperparameters, "--start": start,
                 "--evaluations": evaluations, "--evaluation-episodes": evaluation_episodes,
                 "--set": set_options or None,
                 "--force": force or None}  # fmt: skip
        for name, value in given.items():
            if value is not None:
                raise BaselineError(
                    f"{name} cannot be given with --resume: a run goes on with what it began with"
                )
        from drm_baselines.rl.run_record import load_run

        record = load_run(out)
        total = steps if steps is not None else record.target_steps
        training = training_module()
        with progress_bar() as progress:
            watcher = ConsoleWatcher(progress, total, record.steps)
            record = training.resume(out, steps=steps, trust=trust, watcher=watcher)
    elif trust:
        raise BaselineError("--trust is for --resume")
    else:
        import dataclasses

        from drm_baselines.rl.request import TrainingRequest

        algorithm = algo or "ppo"
        settings = settings_files.load_hyperparameters(algorithm, hyperparameters)
        options = parse_options(set_options)
        if start is not None:
            from drm_baselines.rl import start as starting

            env_id, options = starting.task_of_start(start, env_id, options)
            if hyperparameters is None:
                settings = starting.settings_of_start(start, settings)
        if n_envs is not None:
            settings = dataclasses.replace(settings, n_envs=n_envs)
        training = training_module()
        request = TrainingRequest(
            algorithm=algorithm,
            env_id=env_id or "drm_env/SlewResidual-v0",
            options=options,
            steps=steps if steps is not None else 4_000_000,
            seed=seed if seed is not None else 0,
            settings=settings,
            evaluations=evaluations if evaluations is not None else 10,
            evaluation_episodes=evaluation_episodes if evaluation_episodes is not None else 100,
            start=start,
        )
        if seeds is not None:
            _several(out, request, seeds, place_of(ray, processes), force)
            return
        with progress_bar() as progress:
            watcher = ConsoleWatcher(progress, request.steps)
            record = training.train(out, request, watcher=watcher, force=force)
    say(
        f"{record.status} after {record.steps:,} steps and {record.wall_time:.0f} s of training; "
        f"saved in {out}"
    )
    if record.status == "interrupted":
        say(f"go on with: drm train --resume --out {shlex.quote(str(out))}")
        raise typer.Exit(exit_code())
