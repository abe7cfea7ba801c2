"""Where work is done, as a user says it, and who does it there."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

from drm_baselines.errors import BaselineError
from drm_baselines.support.executors import Executor, Here, Processes


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where work is to be done, as a user says it.

    Attributes
    ----------
    ray
        Address of a Ray cluster; ``"auto"``: the one that this machine belongs to or
        ``RAY_ADDRESS`` names, and where there is none, one of this machine alone that ends with the
        work; ``"local"``: such a one in any case. None: no Ray.
    processes
        How many processes of this machine without Ray; 1: this one.
    """

    ray: str | None = None
    processes: int = 1


@contextlib.contextmanager
def executor(place: Place | None = None, *, cores_each: int = 1) -> Iterator[Executor]:
    """Yield who does the work at a place; ``cores_each`` is what a job of a cluster may use.

    Raises
    ------
    BaselineError
        Ray and processes at once, no such cluster, or one that cannot do the work.
    MissingPackageError
        Ray is asked for and not installed.
    """
    place = place or Place()
    if place.processes < 1:
        raise BaselineError(f"processes must be at least 1, got {place.processes}")
    if place.ray is not None:
        if place.processes != 1:
            raise BaselineError("give either a Ray cluster or a number of processes")
        from drm_baselines.support.on_ray import cluster

        with cluster(place.ray, cores_each) as found:
            yield found
    elif place.processes > 1:
        yield Processes(place.processes)
    else:
        yield Here()
