"""``drm imitate``: a policy that learns from plans made with the true payload."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drm_baselines.cli.common import console, guarded, progress_bar
from drm_baselines.errors import BaselineError


def _modules() -> tuple[Any, Any, Any]:
    try:
        from drm_baselines.imitation import dagger, replanning, teacher
    except ImportError as error:
        raise BaselineError(
            f"imitation needs the extra 'learn' (pip install 'drm-baselines[learn]'): {error}"
        ) from error
    return dagger, replanning, teacher


@guarded
def imitate(
    out: Annotated[Path, typer.Option(help="Directory of the run.")],
    seed: Annotated[
        int, typer.Option(min=0, max=999, help="Seed of weights, manoeuvres and minibatches.")
    ] = 0,
    teacher: Annotated[
        Path,
        typer.Option(help="Directory of the teacher's plans and examples; made if missing."),
    ] = Path("results/benchmark/teacher"),
    scenarios: Annotated[
        int, typer.Option(min=4, help="Manoeuvres that the teacher plans, a quarter a stratum.")
    ] = 2000,
    generations: Annotated[
        int, typer.Option(min=0, help="Pilots that fly for new plans under way.")
    ] = 1,
    rounds: Annotated[
        int | None, typer.Option(min=1, help="Rounds of flying and learning.", show_default=False)
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Start anew in a directory that is not empty.")
    ] = False,
) -> None:
    """Learn by imitation of the convex programme's torques (DAgger).

    The teacher knows the true payload, the student what an agent sees. Plans, and new plans
    from where pilots have gone astray, are made once (some twenty minutes on two cores) and shared
    by all seeds, each of which draws its own three quarters of the manoeuvres. Interrupted, the
    same command goes on with what the teacher has finished.
    """
    dagger, replanning, teachers = _modules()
    teaching = teachers.Teaching(scenarios=scenarios, generations=generations)
    settings = {} if rounds is None else {"rounds": rounds}
    study = dagger.Study(seed=seed, teaching=teaching, **settings)
    plans = teachers.load_plans(teacher / "plans.npz", teaching)
    with progress_bar() as progress:
        tasks: dict[str, Any] = {}

        def prepared(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = progress.add_task(what, total=total, note="")
            progress.update(tasks[what], completed=done)

        if plans is None:
            plans = teachers.make_plans(
                teaching, progress=lambda done, total: prepared("planning", done, total)
            )
            teachers.save_plans(teacher / "plans.npz", plans, teaching)
        shown = replanning.prepare(teacher, plans, teaching, progress=prepared)
    with progress_bar() as progress:
        task = progress.add_task("learning", total=study.rounds, note="rounds")

        def watch(number: int, point: dict[str, float]) -> None:
            progress.update(task, completed=number + 1)
            console.print(
                f"round {number + 1}: {point['steps']:>12,.0f} decisions "
                f"{point['wall_time']:5.0f} s   tip error RMS {point['tip_error_rms'] * 1e3:.3f} mm"
                f"   residual {point['residual_rms'] * 1e3:.3f} mm"
                f"   settled {100 * point['settled']:.0f} %",
                highlight=False,
            )

        dagger.imitate(out, study, plans, shown, force=force, watch=watch)
    console.print(f"saved in {out}", soft_wrap=True)
