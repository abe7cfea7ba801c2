"""What a sweep costs, measured by flying a little of it."""

from __future__ import annotations

import pickle
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from drm_baselines.support import cores
from drm_baselines.sweep.parts import write_part
from drm_baselines.sweep.request import Fleet, SweepRequest
from drm_baselines.sweep.runner import fly_block

_SECONDS = 2.0
"""Least time that a measurement takes."""


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What one policy's episodes cost.

    Attributes
    ----------
    policy
        Its name.
    seconds
        Of one core for an episode.
    block
        Episodes of a block.
    shared_bytes, job_bytes, result_bytes
        What travels to a worker once, to it with each block, and back with each.
    disk_bytes
        Of the files for an episode.
    """

    policy: str
    seconds: float
    block: int
    shared_bytes: int
    job_bytes: int
    result_bytes: int
    disk_bytes: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)


def costs_of(request: SweepRequest) -> list[Cost]:
    """Fly some episodes of each policy on one core, and return what they cost."""
    fleet = Fleet.of(request)
    with cores.kept_to(1):
        return [_cost_of(fleet, policy) for policy in fleet.contestants]


def _cost_of(fleet: Fleet, policy: str) -> Cost:
    size = fleet.sizes[policy]
    first = next(fleet.blocks(policy))
    block = replace(first, episodes=min(first.episodes, 500 if size >= 500 else 2))
    spent, flown = 0.0, 0
    while spent < _SECONDS:
        begun = time.process_time()
        columns = fly_block(fleet, block, lambda _done, _total: None)
        spent += time.process_time() - begun
        flown += block.episodes
    with tempfile.TemporaryDirectory() as folder:
        disk = write_part(Path(folder) / "part.parquet", columns, "").stat().st_size
    share = size / block.episodes
    return Cost(
        policy=policy,
        seconds=spent / flown,
        block=size,
        shared_bytes=len(pickle.dumps(fleet)),
        job_bytes=len(pickle.dumps(block)),
        result_bytes=round(share * sum(values.nbytes for values in columns.values())),
        disk_bytes=disk / block.episodes,
    )
