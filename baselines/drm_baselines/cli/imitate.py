"""``drm imitate``: a policy that learns from plans made with the true payload."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drm_baselines.cli.common import console, guarded, progress_bar
from drm_baselines.errors import BaselineError


def _modules() -> tuple[Any, Any]:
    try:
        from drm_baselines.imitation import dagger, teacher
    except ImportError as error:
        raise BaselineError(
            f"imitation needs the extra 'learn' (pip install 'drm-baselines[learn]'): {error}"
        ) from error
    return dagger, teacher


@guarded
def imitate(
    out: Annotated[Path, typer.Option(help="Directory of the run.")],
    seed: Annotated[
        int, typer.Option(min=0, max=999, help="Seed of weights, manoeuvres and minibatches.")
    ] = 0,
    plans: Annotated[
        Path, typer.Option(help="File of the teacher's plans; made if it is missing.")
    ] = Path("results/benchmark/plans.npz"),
    scenarios: Annotated[
        int, typer.Option(min=4, help="Manoeuvres that the teacher plans, a quarter a stratum.")
    ] = 1600,
    rounds: Annotated[
        int | None, typer.Option(min=1, help="Rounds of flying and learning.", show_default=False)
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Start anew in a directory that is not empty.")
    ] = False,
) -> None:
    """Learn by imitation of the convex programme's torques (DAgger).

    The teacher knows the true payload, the student what an agent sees. Plans are made once (ten
    minutes on two cores) and shared by all seeds, each of which draws its own three quarters.
    """
    dagger, teacher = _modules()
    teaching = teacher.Teaching(scenarios=scenarios)
    settings = {} if rounds is None else {"rounds": rounds}
    study = dagger.Study(seed=seed, teaching=teaching, **settings)
    found = teacher.load_plans(plans, teaching)
    if found is None:
        with progress_bar() as progress:
            task = progress.add_task("planning", total=scenarios, note="manoeuvres")
            found = teacher.make_plans(
                teaching, progress=lambda done, _: progress.update(task, completed=done)
            )
        teacher.save_plans(plans, found, teaching)
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

        dagger.imitate(out, study, found, force=force, watch=watch)
    console.print(f"saved in {out}", soft_wrap=True)
