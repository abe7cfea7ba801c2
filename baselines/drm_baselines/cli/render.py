"""``drm render``: a film of policies side by side on the same episode."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drm_baselines.cli.common import (
    POLICY_HELP,
    SET_HELP,
    complete_env,
    complete_policy,
    guarded,
    parse_options,
)
from drm_baselines.cli.terminal import complain, counting, say_files
from drm_baselines.errors import BaselineError
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once

MOST_TOGETHER = 12
"""Most policies in one film, which share its width."""


@guarded
def render(
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="File to write: its ending, .mp4 or .gif, says what it is."
        ),
    ],
    policies: Annotated[
        list[str] | None,
        typer.Option(
            "--policy",
            help=f"Who flies, by name ({POLICY_HELP}) or directory of a training run. Repeat it "
            "for more beside each other; none and lyapunov by default.",
            show_default=False,
            autocompletion=complete_policy,
        ),
    ] = None,
    env_id: Annotated[
        str,
        typer.Option(
            "--env",
            help="Environment, or the name of its task, whose episode is flown.",
            autocompletion=complete_env,
        ),
    ] = "drm_env/Slew-v0",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the episode.")] = 0,
    fps: Annotated[
        float, typer.Option(min=1.0, max=100.0, help="Pictures for each second of the film.")
    ] = 25.0,
    speed: Annotated[
        float,
        typer.Option(min=0.01, max=100.0, help="Seconds of flight for each second of the film."),
    ] = 1.0,
    duration: Annotated[
        float | None,
        typer.Option(min=0.01, help="Seconds of flight that are shown; all by default."),
    ] = None,
    width: Annotated[
        int | None,
        typer.Option(
            min=64,
            max=4096,
            help="Width of the film, px; by default 800 for one policy, 480 each for more.",
            show_default=False,
        ),
    ] = None,
    height: Annotated[
        int | None,
        typer.Option(
            min=64,
            max=4096,
            help="Height of the film, px; by default 450 for one policy, 560 a row for more.",
            show_default=False,
        ),
    ] = None,
    columns: Annotated[
        int | None,
        typer.Option(min=1, help="Policies beside each other; at most four by default."),
    ] = None,
    magnification: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=1e6,
            help="Factor by which deflections are drawn larger; by default one that makes the "
            "bending of this manoeuvre visible.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    set_options: Annotated[list[str] | None, typer.Option("--set", help=SET_HELP)] = None,
) -> None:
    """Draw a film (MP4 or GIF) of policies side by side on the same episode.

    All fly the manoeuvre that the environment draws with this seed, on the same axes; a policy has
    the colour that it has in every picture.

    For example:

    drm render --output slew.mp4

    drm render --policy none --policy lyapunov --policy dagger --set mass_error=0.15 -o race.gif
    --fps 10 --speed 2

    drm render --policy lqr --env slew_thesis --width 1280 --height 720 -o lqr.mp4
    """
    require("drm render", "render")
    with leaving_at_once():
        import gymnasium as gym

        from drm_baselines.evaluation import films
        from drm_baselines.evaluation.contestants import Arena, contestant_named
        from drm_baselines.evaluation.environments import known_ids, scenarios_of, task_of
        from drm_baselines.policies.names import find, is_name, styles
        from drm_baselines.support import storage

    films.check_ending(output)
    storage.claim_file(output, force=force)
    if env_id not in gym.registry:
        env_id = next((known for known in known_ids() if task_of(known) == env_id), env_id)
    arena = Arena(env_id=env_id, options=parse_options(set_options), seed=seed, episodes=1)
    names = policies or ["none", "lyapunov"]
    if len(names) > MOST_TOGETHER:
        raise BaselineError(
            f"--policy can be given at most {MOST_TOGETHER} times, got {len(names)}"
        )
    contestants = [contestant_named(arena, text) for text in names]
    across = min(columns or 4, len(contestants))
    rows = -(-len(contestants) // across)
    single = len(contestants) == 1
    cut = films.Cut(
        fps=fps,
        speed=speed,
        duration=duration,
        columns=across,
        width=width or (800 if single else 480 * across),
        height=height or (450 if single else 560 * rows),
    )
    scenario = scenarios_of(arena.env_id, arena.resolved, seed, 1)[0]
    # a policy by its name and in its colour; of a learning method one run flies
    titles = [
        find(text).title if is_name(text) else contestant.label
        for text, contestant in zip(names, contestants, strict=True)
    ]
    colours = [style["color"] for style in styles(titles)]
    labels = films.labels_of(titles)
    with counting("flights") as progress:
        flights = {}
        for label, contestant in zip(labels, contestants, strict=True):
            flights[label] = contestant.trajectory(arena)
            progress("flying", len(flights), len(contestants))
    for label, flight in flights.items():
        if getattr(flight, "metrics", {}).get("diverged"):
            last = float(flight["time"][-1])
            complain(f"{label} diverged after {last:g} s; its last picture is held", "warning")
    with counting("pictures") as progress:
        frames = films.side_by_side(
            scenario,
            flights,
            cut,
            colours=colours,
            magnification=magnification,
            progress=lambda done, total: progress("drawing", done, total),
        )
        films.write_film(output, frames, fps=fps, overwrite=force)
    say_files([output])
