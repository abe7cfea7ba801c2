"""``drm evaluate``: one policy over many episodes, with a record of each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drm_baselines.cli.common import (
    JSON_HELP,
    POLICY_HELP,
    SET_HELP,
    complete_env,
    complete_policy,
    guarded,
    parse_options,
)
from drm_baselines.cli.terminal import console, counting, say_files, say_json, show
from drm_baselines.errors import BaselineError
from drm_baselines.support.extras import require
from drm_baselines.support.interruption import leaving_at_once


@guarded
def evaluate(
    policy: Annotated[
        str,
        typer.Option(
            help=f"A policy by name ({POLICY_HELP}) or the directory of a training run. "
            "A run is read from policy.safetensors and policy.json alone.",
            autocompletion=complete_policy,
        ),
    ],
    env_id: Annotated[
        str | None,
        typer.Option(
            "--env",
            help="Environment whose episodes are flown; for a run, by default "
            "the one it was trained in, otherwise drm_env/Slew-v0.",
            autocompletion=complete_env,
        ),
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Number of episodes.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first episode.")] = 0,
    records: Annotated[
        Path | None,
        typer.Option(help="File for one row an episode, SI units and radians: .csv or .parquet."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="File for the aggregates as JSON, SI units and radians.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
    set_options: Annotated[list[str] | None, typer.Option("--set", help=SET_HELP)] = None,
) -> None:
    """Fly one policy over seeded episodes and report the engine's metrics."""
    require("drm evaluate", "evaluate", "scipy")
    with leaving_at_once():
        from drm_baselines.evaluation.contestants import Arena, contestant_named, fly_all
        from drm_baselines.evaluation.records import write_records
        from drm_baselines.evaluation.tables import comparison_tables
        from drm_baselines.policies.names import is_name
        from drm_baselines.policies.policy_file import load_policy
        from drm_baselines.support import provenance, storage
        from drm_baselines.support.seeds import episode_seeds

    episode_seeds(seed, episodes)
    options = parse_options(set_options)
    if env_id is None:
        run = Path(policy)
        if not is_name(policy) and run.is_dir():
            trained = load_policy(run)
            env_id = trained.env_id
            options = {"config": trained.config, **options}
        else:
            env_id = "drm_env/Slew-v0"
    if records is not None and records.suffix not in (".csv", ".parquet"):
        raise BaselineError(f"--records takes a .csv or .parquet file, got {records}")
    if records is not None and records.suffix == ".parquet":
        require("a Parquet file (CSV works without)", "report", "pyarrow")
    for path in (records, out):
        if path is not None:
            storage.claim_file(path, force=force)
    arena = Arena(env_id=env_id, options=options, seed=seed, episodes=episodes)
    contestant = contestant_named(arena, policy)
    with counting("episodes") as progress:
        flights = fly_all([contestant], arena, progress)
    report = {
        "format": "drm-evaluation",
        "format_version": 1,
        "units": "SI and radians",
        "seed": seed,
        "environment": {"id": env_id, "config": arena.resolved.to_dict()},
        "policy": flights[0].summary(),
        "provenance": provenance.provenance(),
    }
    if as_json:
        say_json(report)
    else:
        show(*comparison_tables(flights, title=f"{env_id}, seeds {seed}..", width=console.width))
    files: list[Path] = []
    if records is not None:
        files += write_records(
            records,
            flights,
            settings={k: v for k, v in report.items() if k != "policy"},
            overwrite=force,
        )
    if out is not None:
        files.append(storage.write_json(out, report, overwrite=force))
    if not as_json:
        say_files(files)
