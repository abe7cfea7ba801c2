"""``drm demo``: what the project does, in half a minute, or in three with a training.

First the thesis' manoeuvre under every law, with the payload known and misreported; with
``--train`` a policy trained on top of the linear law for about two minutes, which alone needs
PyTorch; then the laws and policies that learned over the same hundred episodes with unknown
payloads, and a verdict that the records bear out.
"""

from __future__ import annotations

import functools
import itertools
import shlex
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drm_baselines.cli.common import MOST_STEPS, guarded
from drm_baselines.cli.terminal import console, counting, progress_bar, say, say_files, show
from drm_baselines.cli.train import ConsoleWatcher, training_module
from drm_baselines.errors import BaselineError
from drm_baselines.rl.hyperparameters import MOST_ENVS, load_hyperparameters
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import exit_code, leaving_at_once

if TYPE_CHECKING:
    from drm_baselines.evaluation.contestants import Arena
    from drm_baselines.evaluation.statistics import Estimate

ENV_ID = "drm_env/SlewResidual-v0"
STEPS = 2_560_000
"""Environment steps of the training: about two minutes on two cores."""

CURVE_EPISODES = 100
"""Episodes behind each point of the learning curve."""

SHIPPED = ("ppo", "learned")
"""Policies of the package that fly where none is trained; the verdict is on the last."""

_AGENT = "inner law + PPO"
_MASS_ERRORS = (0.0, 0.15, -0.15)


def fresh_directory(base: Path) -> Path:
    """Return ``base``, or ``base-2``, ``base-3``, ... if that holds results already."""
    candidates = itertools.chain([base], (Path(f"{base}-{n}") for n in itertools.count(2)))
    return next(
        path for path in candidates
        if not path.exists() or (path.is_dir() and not any(path.iterdir()))
    )  # fmt: skip


def fly_thesis_manoeuvre(out: Path, *, overwrite: bool) -> list[Path]:
    """Fly Payload 1 through the standard manoeuvre under each law; write figures and JSON."""
    import drm_env
    from drm_baselines.evaluation import plots
    from drm_baselines.evaluation.tables import metrics_table
    from drm_baselines.policies.names import title_of
    from drm_baselines.policies.registry import LAWS
    from drm_baselines.support import provenance, storage

    rows: dict[str, Mapping[str, float]] = {}
    files = []
    for error in _MASS_ERRORS:
        told = "known exactly" if error == 0.0 else f"reported {error:+.0%}"
        flights = {
            law: drm_env.simulate({"mass_error": error}, law=law, decimation=5) for law in LAWS
        }
        rows.update(
            {f"{title_of(law)}, payload {told}": flight.metrics for law, flight in flights.items()}
        )
        picture = out / f"manoeuvre_mass_{round(error * 100):+d}_percent.png"
        title = f"50 deg slew, 1 m to 8 m, Payload 1 {told}"
        plots.plot_manoeuvres(flights, picture, title=title, overwrite=overwrite)
        files.append(picture)
    show(metrics_table(rows, title="thesis manoeuvre: 50 deg, minimum time, 1 m to 8 m, Payload 1"))
    files.append(
        storage.write_json(
            out / "manoeuvres.json",
            {"units": "SI and radians", "metrics": rows, "provenance": provenance.provenance()},
            overwrite=overwrite,
        )
    )
    return files


def verdict(
    comparison: Mapping[str, Mapping[str, Any]],
    *,
    agent: str = "the trained agent",
    reference: str = "the inner law it corrects",
) -> list[str]:
    """Return what the paired comparison of ``agent`` with ``reference`` allows to say.

    Returns
    -------
    list of str
        Sentences; the first is about the tip error.
    """
    from drm_baselines.evaluation.metrics import describe
    from drm_baselines.evaluation.statistics import Estimate

    tip = comparison["tip_error_rms"]
    difference = Estimate(**tip["difference"]).scaled(1e3)
    chance = Estimate(**tip["probability_of_improvement"])
    judged = {
        "better": f"{agent} beats {reference}",
        "worse": f"{agent} is worse than {reference}",
        "undecided": f"no difference between {agent} and {reference} can be shown",
    }[str(tip["verdict"])]
    lines = [
        f"{judged[0].upper()}{judged[1:]}: tip error RMS {difference.value:+.2f} mm "
        f"[{difference.low:+.2f}, {difference.high:+.2f}] on the same episodes, better in "
        f"{chance.value:.0%} of them [{chance.low:.0%}, {chance.high:.0%}]."
    ]
    for outcome, phrase in (("better", "Also better in"), ("worse", "Worse in")):
        names = [
            describe(name).label
            for name, entry in comparison.items()
            if name != "tip_error_rms" and entry["verdict"] == outcome
        ]
        if names:
            lines.append(f"{phrase} {', '.join(names)}.")
    return lines


def _learning_curve(
    run: Path, bands: Mapping[str, Estimate], path: Path, *, overwrite: bool
) -> Path:
    import numpy as np

    from drm_baselines.evaluation import plots
    from drm_baselines.rl.run_record import EVALUATIONS_FILE

    table = np.genfromtxt(run / EVALUATIONS_FILE, delimiter=",", names=True, ndmin=1)
    names: Sequence[str] = table.dtype.names or ()
    plots.plot_learning_curve(
        {name: np.asarray(table[name], dtype=np.float64) for name in names},
        bands,
        path,
        label=_AGENT,
        title=f"learning on {ENV_ID}, and the laws on the same episodes",
        overwrite=overwrite,
    )
    return path


def _train(run: Path, steps: int, seed: int, n_envs: int | None, *, force: bool) -> None:
    import dataclasses

    from drm_baselines.rl.request import TrainingRequest

    training = training_module()
    settings = load_hyperparameters("ppo")
    if n_envs is not None:
        settings = dataclasses.replace(settings, n_envs=n_envs)
    request = TrainingRequest(
        algorithm="ppo",
        env_id=ENV_ID,
        options={},
        steps=steps,
        seed=seed,
        settings=settings,
        evaluation_episodes=CURVE_EPISODES,
    )
    with progress_bar() as progress:
        record = training.train(run, request, watcher=ConsoleWatcher(progress, steps), force=force)
    if record.status == "interrupted":
        say(f"training stopped; go on with: drm train --resume --out {shlex.quote(str(run))}")
        raise typer.Exit(exit_code())


def _minutes(steps: int) -> int:
    """About how long the training takes on two cores, in min."""
    return max(1, round(steps / STEPS * 2))


@guarded
def demo(
    out: Annotated[
        Path | None,
        typer.Option(
            help="Directory for figures, records and the run; by default results, or "
            "results-2 and so on where that exists.",
            show_default=False,
        ),
    ] = None,
    train: Annotated[
        bool,
        typer.Option(
            "--train",
            help=f"Train an agent on top of the linear law, about {_minutes(STEPS)} min on two "
            "cores, and compare it in the place of the package's. Needs PyTorch.",
        ),
    ] = False,
    episodes: Annotated[int, typer.Option(min=4, help="Episodes of the comparison.")] = 100,
    steps: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MOST_STEPS,
            help=f"Environment steps of the training; {STEPS} by default.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, max=999, help="Seed of the training; 0 by default.", show_default=False
        ),
    ] = None,
    n_envs: Annotated[
        int | None,
        typer.Option(
            "--n-envs", min=1, max=MOST_ENVS, help="Environments that the training steps at once."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace results in --out.")] = False,
) -> None:
    """Fly the thesis' manoeuvre, then laws and policies that learned over the same episodes."""
    if train:
        require("drm demo --train", "learn", "matplotlib", "scipy", "stable_baselines3", "torch")
        training_module()
    else:
        require("drm demo", "evaluate", "jinja2", "matplotlib", "scipy")
        for option, value in (("--steps", steps), ("--seed", seed), ("--n-envs", n_envs)):
            if value is not None:
                raise BaselineError(f"{option} {value} is for the training: add --train")
    with leaving_at_once():
        from drm_baselines.evaluation.comparison import report_of, write_comparison
        from drm_baselines.evaluation.contestants import (
            Arena,
            contestant_named,
            contestant_of_inner_law,
            contestant_of_law,
            contestant_of_run,
            fly_all,
        )
        from drm_baselines.evaluation.reports import comparison_page
        from drm_baselines.evaluation.tables import comparison_tables, paired_table
        from drm_baselines.pages.writer import write_page
        from drm_baselines.policies.names import title_of
        from drm_baselines.policies.registry import LAWS
        from drm_baselines.support import storage
        from drm_baselines.support.seeds import episode_seeds

    episode_seeds(0, episodes)
    directory = out if out is not None else fresh_directory(Path("results"))
    storage.claim_directory(directory, force=force)
    begun = time.monotonic()
    steps = STEPS if steps is None else steps
    parts = 3 if train else 2
    lasting = f"{_minutes(steps) + 1} min" if train else "half a minute"
    say(f"results go to {directory}; {parts} parts, about {lasting} on two cores")

    say(
        f"\n1 of {parts}: the thesis' manoeuvre under every law, payload known and misreported "
        "(seconds)"
    )
    files = fly_thesis_manoeuvre(directory, overwrite=force)

    run = directory / "ppo"
    if train:
        say(
            f"\n2 of 3: training PPO on {ENV_ID}: {steps:,} steps, seed {seed or 0} (about "
            f"{_minutes(steps)} min on two cores; Ctrl-C saves it and ends the demo). Every line "
            f"below is a point of the learning curve, over {CURVE_EPISODES} episodes of its own, "
            "which are not those of the table at the end."
        )
        _train(run, steps, seed or 0, n_envs, force=force)

    who = "the trained agent" if train else "policies that learned"
    say(
        f"\n{parts} of {parts}: the laws and {who} over the same {episodes} episodes, which no "
        "training has seen (about 20 s with the pictures)"
    )
    arena = Arena(env_id=ENV_ID, seed=0, episodes=episodes)
    laws = [contestant_of_law(name) for name in LAWS]
    if train:
        reference = contestant_of_inner_law(arena, arena.config, ENV_ID)
        agent = contestant_of_run(arena, run, label=_AGENT)
        contestants = [*laws, reference, agent]
        # The inner law alone is the linear law: one line over another.
        drawn = [*laws, agent]
    else:
        reference = next(law for law in laws if law.label == title_of("linear"))
        drawn = contestants = [*laws, *(contestant_named(arena, name) for name in SHIPPED)]
        agent = contestants[-1]
    with counting("episodes") as progress:
        flights = fly_all(contestants, arena, progress)
    report = report_of(flights, arena, reference=reference.label)
    say("")
    show(
        *comparison_tables(
            flights,
            width=console.width,
            title="payload 50 to 500 kg, its reported mass wrong by up to 15 %: "
            f"{episodes} episodes that no training has seen",
        )
    )
    paired = report["paired"]["candidates"][agent.label]
    show(paired_table(paired, title=f"{agent.label} minus {reference.label}"))
    sentences = (
        verdict(paired)
        if train
        else verdict(paired, agent=agent.label, reference=f"the {reference.label}")
    )
    report["verdict"] = sentences
    for line in sentences:
        say(line)
    files += write_comparison(directory, flights, report, title="SlewResidual-v0", overwrite=force)
    files.append(_episode_figure(directory, drawn, arena, overwrite=force))
    with counting("flights") as progress:
        told = functools.partial(progress, "report")
        page = comparison_page(contestants, flights, report, arena, told=told)
    html = write_page(page, directory / "comparison.html", overwrite=force)
    files.append(html)
    if train:
        curve = directory / "learning_curve.png"
        files.append(_learning_curve(run, _bands(), curve, overwrite=force))
    say(f"\ndone in {time.monotonic() - begun:.0f} s")
    say_files(files)
    say(f"next: open {html} in a browser: tables, charts and the arm in motion, without network")
    if train:
        say(
            f"go on with the training: drm train --resume --steps {2 * steps} --out "
            f"{shlex.quote(str(run))}; fly it anywhere: drm compare none linear "
            f"{shlex.quote(str(run))}"
        )
    else:
        say(
            "train one of your own beside the laws (two minutes, with PyTorch): make build, then "
            "drm demo --train"
        )


def _bands() -> dict[str, Estimate]:
    """The laws on the very episodes that the learning curve was measured on."""
    from drm_baselines.evaluation.contestants import Arena, contestant_of_law, fly_all
    from drm_baselines.policies.registry import LAWS
    from drm_baselines.support.seeds import CURVE_SEED

    curve = Arena(env_id=ENV_ID, seed=CURVE_SEED, episodes=CURVE_EPISODES)
    laws = [contestant_of_law(name) for name in LAWS]
    return {flight.label: flight.estimate("tip_error_rms") for flight in fly_all(laws, curve)}


def _episode_figure(
    out: Path, contestants: Sequence[Any], arena: Arena, *, overwrite: bool
) -> Path:
    from drm_baselines.evaluation import plots

    picture = out / "episode.png"
    plots.plot_manoeuvres(
        {contestant.label: contestant.trajectory(arena) for contestant in contestants},
        picture,
        title=f"{arena.env_id}, seed {arena.seed}",
        overwrite=overwrite,
    )
    return picture
