"""Flying a sweep: block after block, here or on a cluster, and on where it was interrupted.

A sweep lives in one directory:

    settings.json   what is drawn; a directory goes on only with the same
    episodes/       the episodes as Parquet files (:mod:`drm_baselines.sweep.parts`)
    summary.json    the policies' figures, and the map of the tip error
    tip_error.png   the map as a picture

A block's episodes follow from its seeds, the configuration and the policy alone, so they are the
same to the bit wherever they are flown, and those of ``drm compare`` with the same options.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.errors import BaselineError, ExistingResultError
from drm_baselines.evaluation.environments import scenarios_of
from drm_baselines.support import provenance, storage, workplace
from drm_baselines.support.executors import Executor, Tell
from drm_baselines.support.places import Place, executor
from drm_baselines.support.reading import read_table
from drm_baselines.sweep.parts import EPISODES, is_there, part_of, write_part
from drm_baselines.sweep.request import Block, Fleet, SweepRequest

SETTINGS_FILE = "settings.json"
FORMAT, FORMAT_VERSION = "drm-sweep", 1

Progress = Callable[[str, int, int], None]
"""Called with (policy, episodes done, episodes in all)."""


def fly_block(fleet: Fleet, block: Block, tell: Tell) -> dict[str, NDArray[Any]]:
    """Fly the episodes of a block; return the columns of its file, each of shape (episodes,)."""
    arena = replace(fleet.arena, seed=block.seed, episodes=block.episodes)
    scenarios = scenarios_of(arena.env_id, arena.resolved, arena.seed, arena.episodes)
    contestant = fleet.contestants[block.policy]
    if contestant.pilot is not None:
        metrics = contestant.pilot.fly(scenarios, seed=arena.seed, progress=tell)
    else:
        metrics = dict(contestant.fly(arena, tell).metrics)
    return {
        "seed": np.arange(arena.seed, arena.seed + arena.episodes, dtype=np.int64),
        **_context_of(scenarios),
        **metrics,
    }


def _context_of(scenarios: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[np.float64]]:
    """Return what is kept of each manoeuvre, SI; all else follows from its seed."""
    rows = [
        (
            each["payload"]["mass"],
            each["mass_error"],
            each["reported_payload"]["mass"],
            each["slew"]["angle"],
        )
        for each in scenarios
    ]
    mass, error, reported, angle = np.array(rows, dtype=np.float64).T
    # a mass that is not reported itself is the true one with its error
    reported = np.where(np.isnan(reported), mass * (1.0 + error), reported)
    return {
        "payload_mass": mass,
        "reported_mass": reported,
        "mass_error": reported / mass - 1.0,
        "slew_angle": angle,
    }


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Where a sweep stands: who flew, and how many blocks there were before and are new."""

    fleet: Fleet
    found: int
    flown: int


def sweep(
    directory: Path,
    request: SweepRequest,
    *,
    place: Place | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Fly what is missing of a sweep, and keep each block as soon as it has been flown.

    Parameters
    ----------
    directory
        Of the sweep; one that holds the same sweep goes on: policies and episodes can be added.
    request
        What is flown.
    place
        Where; in this process by default. The episodes are the same to the bit.
    force
        Whether to start anew in a directory that holds something else.
    progress
        Called when episodes have been flown.

    Raises
    ------
    BaselineError
        A request that cannot be flown, or a directory of another sweep.
    ExistingResultError
        The directory holds something else.
    """
    fleet = Fleet.of(request)
    settings = _settings_of(fleet)
    if not (directory / SETTINGS_FILE).is_file():
        storage.claim_directory(directory, force=force)
    with workplace.noting(directory, workplace.Work("drm sweep")):
        if (directory / SETTINGS_FILE).is_file() and not force:
            _check_settings(directory, settings)
        else:
            shutil.rmtree(directory / EPISODES, ignore_errors=True)
            storage.write_json(
                directory / SETTINGS_FILE,
                {
                    "format": FORMAT,
                    "format_version": FORMAT_VERSION,
                    **settings,
                    "provenance": provenance.provenance(),
                },
                overwrite=True,
            )
        digests = {policy: fleet.digest(policy) for policy in fleet.contestants}
        missing = {
            policy: [
                block
                for block in fleet.blocks(policy)
                if not is_there(part_of(directory, block), block, digests[policy])
            ]
            for policy in fleet.contestants
        }
        blocks = [block for each in missing.values() for block in each]
        count = sum(1 for policy in fleet.contestants for _ in fleet.blocks(policy))
        if blocks:
            with executor(place) as workers:
                _fly(directory, fleet, missing, digests, workers, progress)
    return Outcome(fleet=fleet, found=count - len(blocks), flown=len(blocks))


def _fly(
    directory: Path,
    fleet: Fleet,
    missing: Mapping[str, list[Block]],
    digests: Mapping[str, str],
    workers: Executor,
    progress: Progress | None,
) -> None:
    total = fleet.arena.episodes
    done = {
        policy: total - sum(block.episodes for block in blocks)
        for policy, blocks in missing.items()
    }

    def shown(block: Block, flown: int, _: int) -> None:
        if progress is not None:
            progress(fleet.contestants[block.policy].label, done[block.policy] + flown, total)

    jobs = ((block, block) for blocks in missing.values() for block in blocks)
    # a block of a cluster is short, and told of as a whole
    told = shown if workers.is_here else None
    for block, columns in workers.run(fly_block, fleet, jobs, told):
        write_part(part_of(directory, block), columns, digests[block.policy])
        done[block.policy] += block.episodes
        shown(block, 0, total)


def _settings_of(fleet: Fleet) -> dict[str, Any]:
    return {
        "env_id": fleet.arena.env_id,
        "config": fleet.arena.resolved.to_dict(),
        "seed": fleet.arena.seed,
    }


def _check_settings(directory: Path, wanted: Mapping[str, Any]) -> None:
    path = directory / SETTINGS_FILE
    stored = read_table(path, "record of a sweep")
    if stored.get("format") != FORMAT:
        raise ExistingResultError(f"{path} is not the record of a sweep; take another --out")
    if stored.get("format_version") != FORMAT_VERSION:
        raise BaselineError(
            f"{path} has format version {stored.get('format_version')!r}, not {FORMAT_VERSION}"
        )
    for name, value in wanted.items():
        where = _difference(name, stored.get(name), storage.plain(value))
        if where is not None:
            raise BaselineError(
                f"the sweep in {directory} {where}; give another --out, or --force to start anew"
            )


def _difference(name: str, old: Any, new: Any) -> str | None:
    """Return in words where two settings differ first, if they do."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*new, *old]):
            found = _difference(f"{name}.{key}", old.get(key), new.get(key))
            if found is not None:
                return found
        return None
    return None if old == new else f"was begun with {name} {old!r}, not {new!r}"
