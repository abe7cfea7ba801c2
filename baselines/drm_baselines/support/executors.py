"""Work shared out: in this process, among processes of this machine, or over a Ray cluster.

Whoever has work to share cuts it into jobs. A job is data, what is done with it a function of a
module (so that other processes find it), and what all jobs have in common is handed over once. The
result must follow from these alone: then it is the same to the bit wherever a job is done, however
often it is begun anew because a process or a machine was lost, and whatever else is done meanwhile.
Results come in the order in which they are ready, with the key of their job.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import queue
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, Protocol, TypeVar

from drm_baselines.support import cores
from drm_baselines.support.processes import process_pool, tell_parent

Shared = TypeVar("Shared")
Job = TypeVar("Job")
Result = TypeVar("Result")
Key = TypeVar("Key", bound=Hashable)

Tell = Callable[[int, int], None]
"""What a job may call now and then: how much of it is done, and how much there is."""
Told = Callable[[Any, int, int], None]
"""Is called with the key of a job and what it tells."""

AHEAD = 2
"""Jobs that are handed out for each that can go on at a time: nobody waits for the next one."""
POLL = 0.5
"""Seconds after which whoever waits looks for what jobs tell."""


class Executor(Protocol):
    """Does jobs, wherever it does them.

    Attributes
    ----------
    workers
        How many jobs go on at a time.
    is_here
        Whether jobs are done in this very process, with all its cores.
    shares_files
        Whether jobs see the files of this process under the same names.
    """

    @property
    def workers(self) -> int:
        """See the class."""

    @property
    def is_here(self) -> bool:
        """See the class."""

    @property
    def shares_files(self) -> bool:
        """See the class."""

    def run(
        self,
        work: Callable[[Shared, Job, Tell], Result],
        shared: Shared,
        jobs: Iterable[tuple[Key, Job]],
        told: Told | None = None,
    ) -> Iterator[tuple[Key, Result]]:
        """Do ``work(shared, job, tell)`` for all jobs; yield keys and results as they are ready.

        Jobs are taken from the iterable as there is room for them, so that there may be millions.

        Raises
        ------
        Exception
            What a job has raised; jobs that have not begun are dropped.
        """


class Here:
    """Does one job after the other in this process."""

    workers = 1
    is_here = True
    shares_files = True

    def run(
        self,
        work: Callable[[Shared, Job, Tell], Result],
        shared: Shared,
        jobs: Iterable[tuple[Key, Job]],
        told: Told | None = None,
    ) -> Iterator[tuple[Key, Result]]:
        """See :class:`Executor`."""
        for key, job in jobs:

            def tell(done: int, total: int, key: Key = key) -> None:
                if told is not None:
                    told(key, done, total)

            yield key, work(shared, job, tell)


class Processes:
    """Does jobs in processes of this machine, which share its cores.

    Parameters
    ----------
    count
        How many processes.
    cores_each
        Cores that each may use; by default an equal share of all.
    """

    is_here = False
    shares_files = True

    def __init__(self, count: int, cores_each: int | None = None) -> None:
        self.workers = count
        self._cores = cores_each or max(1, cores.count() // count)

    def run(
        self,
        work: Callable[[Shared, Job, Tell], Result],
        shared: Shared,
        jobs: Iterable[tuple[Key, Job]],
        told: Told | None = None,
    ) -> Iterator[tuple[Key, Result]]:
        """See :class:`Executor`."""
        board: Any = None if told is None else multiprocessing.get_context("spawn").Queue()
        with process_pool(self.workers, cores_each=self._cores, board=board) as pool:
            waiting = iter(jobs)
            running: dict[Future[Result], Key] = {}
            while True:
                while len(running) < AHEAD * self.workers:
                    following = next(waiting, None)
                    if following is None:
                        break
                    key, job = following
                    running[pool.submit(_in_process, work, shared, key, job)] = key
                if not running:
                    return
                ready, _ = wait(running, timeout=POLL, return_when=FIRST_COMPLETED)
                with contextlib.suppress(queue.Empty):
                    while told is not None:
                        told(*board.get_nowait())
                for future in ready:
                    yield running.pop(future), future.result()


def _in_process(
    work: Callable[[Shared, Job, Tell], Result], shared: Shared, key: Key, job: Job
) -> Result:
    return work(shared, job, lambda done, total: tell_parent((key, done, total)))
