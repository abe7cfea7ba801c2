"""``drm imitate``: a policy that learns from plans made with the true payload."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drm_baselines.cli.common import MOST_MANOEUVRES, MOST_ROUNDS, guarded
from drm_baselines.cli.terminal import progress_bar, say
from drm_baselines.errors import BaselineError
from drm_baselines.support import memory
from drm_baselines.support.extras import needing, require
from drm_baselines.support.interruption import exit_code, leaving_at_once

_PLAN_BYTES = 200_000
_INTERVALS_BYTES = 2_000_000
"""What a plan, and the linearised intervals of a manoeuvre, take at most while they are joined."""


def _modules() -> tuple[Any, Any, Any, Any]:
    require("imitation", "learn", "clarabel", "piqp", "scipy", "torch")
    with leaving_at_once(), needing("imitation", "learn"):
        from drm_baselines.imitation import (
            analytic_gradient,
            dagger,
            plant_jacobian,
            teacher,
        )
    return dagger, analytic_gradient, plant_jacobian, teacher


def _given(options: dict[str, int | None]) -> dict[str, int]:
    return {name: value for name, value in options.items() if value is not None}


@guarded
def imitate(
    out: Annotated[Path, typer.Option(help="Directory of the run.")],
    seed: Annotated[
        int, typer.Option(min=0, max=999, help="Seed of weights, manoeuvres and minibatches.")
    ] = 0,
    teacher: Annotated[
        Path,
        typer.Option(help="Directory of what the teacher works out beforehand; made if missing."),
    ] = Path("results/benchmark/teacher"),
    scenarios: Annotated[
        int,
        typer.Option(
            min=4,
            max=MOST_MANOEUVRES,
            help="Manoeuvres that the teacher plans, a quarter a stratum.",
        ),
    ] = 800,
    rounds: Annotated[
        int | None,
        typer.Option(
            min=1, max=MOST_ROUNDS, help="Rounds of flying and learning.", show_default=False
        ),
    ] = None,
    manoeuvres: Annotated[
        int | None,
        typer.Option(
            min=4, max=MOST_MANOEUVRES, help="Manoeuvres for the refinement.", show_default=False
        ),
    ] = None,
    refine: Annotated[
        int | None,
        typer.Option(
            min=0, max=MOST_ROUNDS, help="Gradient steps of the refinement.", show_default=False
        ),
    ] = None,
    batch: Annotated[
        int | None,
        typer.Option(
            min=4,
            max=MOST_MANOEUVRES,
            help="Manoeuvres flown for each of them.",
            show_default=False,
        ),
    ] = None,
    settle: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=MOST_ROUNDS,
            help="Gradient steps of the second refinement, towards rest.",
            show_default=False,
        ),
    ] = None,
    start: Annotated[
        Path | None,
        typer.Option(
            help="Directory of a refined student, which has only to settle.", show_default=False
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Start anew in a directory that is not empty.")
    ] = False,
) -> None:
    """Learn by imitation of the convex programme's torques (DAgger), then by the gradient.

    The teacher knows the true payload, the student what an agent sees. After some rounds of
    imitation the student is refined by the gradient of the tip error through the plant, and at last
    it settles: it learns to leave an arm at rest alone. Plans and linearised manoeuvres are made
    once, which takes minutes, and shared by all seeds. An interrupted run keeps its newest policy;
    the same command begins the student anew, to the same digits.
    """
    if start is not None and (rounds is not None or refine is not None):
        raise BaselineError("--rounds and --refine are over for a student that --start names")
    dagger, analytic_gradient, plant_jacobian, teachers = _modules()
    from drm_baselines.policies.policy_file import load_policy
    from drm_baselines.support import workplace

    teaching = teachers.Teaching(scenarios=scenarios)
    given = {"manoeuvres": manoeuvres, "batch": batch}
    stages = {
        "refinement": analytic_gradient.Refinement(**_given({**given, "steps": refine})),
        "settling": analytic_gradient.settling(**_given({**given, "steps": settle})),
    }
    refinement = stages["refinement"]
    settings = {} if rounds is None else {"rounds": rounds}
    study = dagger.Study(seed=seed, teaching=teaching, **stages, **settings)
    # before the minutes that the teacher takes
    workplace.check(out, dagger.work_of(study, start), force=force)
    memory.require(
        scenarios * _PLAN_BYTES + refinement.manoeuvres * _INTERVALS_BYTES,
        f"{scenarios:,} plans and {refinement.manoeuvres:,} linearised manoeuvres",
    )
    with progress_bar() as progress:
        plans = [] if start else teachers.load_plans(teacher / "plans.npz", teaching)
        if plans is None:
            task = progress.add_task("planning", total=scenarios, note="")
            plans = teachers.make_plans(
                teaching, progress=lambda done, _: progress.update(task, completed=done)
            )
            teachers.save_plans(teacher / "plans.npz", plans, teaching)
        linearising = progress.add_task("linearising", total=None, note="")
        intervals = plant_jacobian.prepare(
            teacher / "intervals.npz",
            teaching,
            refinement.manoeuvres,
            refinement.tail,
            progress=lambda done, total: progress.update(linearising, completed=done, total=total),
        )
        progress.update(linearising, completed=len(intervals.counts), total=len(intervals.counts))
    with progress_bar() as progress:
        totals = {"imitation": study.rounds, "refinement": refinement.steps}
        totals = {**({} if start else totals), "settling": study.settling.steps}
        tasks = {
            stage: progress.add_task(
                stage, total=total, note="rounds" if stage == "imitation" else "steps"
            )
            for stage, total in totals.items()
        }

        def watch(stage: str, number: int, point: dict[str, float] | None) -> None:
            progress.update(tasks[stage], completed=number)
            if point is None:
                return
            say(
                f"{stage} {number:>4}: {point['steps']:>12,.0f} decisions "
                f"{point['wall_time']:5.0f} s   tip error RMS {point['tip_error_rms'] * 1e3:.3f} mm"
                f"   residual {point['residual_rms'] * 1e3:.3f} mm"
                f"   settled {100 * point['settled']:.0f} %"
            )

        dagger.imitate(out, study, plans, intervals, start=start, force=force, watch=watch)
    finished = load_policy(out).description["training"]["finished"]
    say(f"{'saved' if finished else 'interrupted; saved'} in {out}")
    if not finished:
        raise typer.Exit(exit_code())
