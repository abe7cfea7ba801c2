"""Work spread over a Ray cluster: one of many machines, or one that this machine is alone.

What travels: key and data of each job to a worker, what all jobs have in common once to each node,
and the results back. Files do not: workers need no common file system. The nodes need the same
version of this package; each worker flies one manoeuvre and compares its bits with those of this
machine before it does anything, so that a cluster whose results would differ is refused.

Jobs of a worker or a node that is lost are done anew elsewhere. A cluster is trusted: whoever can
reach it can run code on all of it (SECURITY.md).
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import signal
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.support import cores, provenance
from drm_baselines.support.executors import AHEAD, POLL, Job, Key, Result, Shared, Tell, Told
from drm_baselines.support.extras import needing, require

RETRIES = 20
"""How often a job is begun anew after its worker or node was lost."""

_STORE_BYTES = 128 << 20
"""Memory of a cluster of this machine alone for what is passed between its processes."""

_SIZE_FOR = 10.0
"""Seconds for which the size of the cluster is taken to stay: nodes come and go."""

_ANSWER = 10.0
"""How long a cluster may take to answer at its address, s."""

_DONE_BEFORE: list[dict[str, str]] = []  # in a worker: what has been compared already


def identity() -> dict[str, str]:
    """Return what must be the same wherever work is done: versions, and the bits of a flight."""
    scenario = {"payload": {"mass": 320.0}, "mass_error": 0.1, "horizon": 2.0}
    flown = drm_env.rollout([scenario] * 3, law="lyapunov", num_threads=1)
    bits = hashlib.sha256(b"".join(values.tobytes() for values in flown.values()))
    return {
        **{
            name: version
            for name, version in provenance.versions().items()
            if name in ("drm-env", "drm-baselines")
        },
        "flight": bits.hexdigest()[:16],
    }


class ClusterError(BaselineError):
    """A cluster that cannot be reached or cannot do the work."""


class _Board:
    """An actor that keeps what jobs tell until whoever waits asks for it."""

    def __init__(self) -> None:
        self._told: dict[Any, tuple[int, int]] = {}

    def tell(self, key: Any, done: int, total: int) -> None:
        """Keep the newest of a job."""
        self._told[key] = (done, total)

    def news(self) -> dict[Any, tuple[int, int]]:
        """Return what has been told since the last time."""
        told, self._told = self._told, {}
        return told


def _on_worker(
    work: Callable[[Shared, Job, Tell], Result],
    shared: Shared,
    key: Key,
    job: Job,
    wanted: dict[str, str],
    cores_each: int,
    board: Any,
) -> Result:
    cores.keep_to(cores_each)
    if wanted not in _DONE_BEFORE:
        found = identity()
        if found != wanted:
            differing = ", ".join(
                f"{name} {found.get(name)} instead of {wanted[name]}"
                for name in wanted
                if found.get(name) != wanted[name]
            )
            raise ClusterError(
                f"results of the node {platform.node()} would differ from those of this machine: "
                f"it has {differing}"
            )
        _DONE_BEFORE.append(wanted)
    told = -1.0

    def tell(done: int, total: int) -> None:
        nonlocal told
        now = time.monotonic()
        if board is not None and (now - told > POLL or done == total):
            told = now
            board.tell.remote(key, done, total)

    return work(shared, job, tell)


class OnRay:
    """Does jobs on a cluster that this process is connected to.

    Parameters
    ----------
    cores_each
        Cores that a job may use.
    """

    is_here = False
    shares_files = False

    def __init__(self, cores_each: int) -> None:
        self._cores = cores_each
        self._looked = float("-inf")
        self._workers = 0

    @property
    def workers(self) -> int:
        """Jobs for which the cluster has cores now."""
        if time.monotonic() - self._looked > _SIZE_FOR:
            self._workers = sum(
                int(node["Resources"].get("CPU", 0.0)) // self._cores
                for node in _ray().nodes()
                if node["Alive"]
            )
            self._looked = time.monotonic()
        return self._workers

    def run(
        self,
        work: Callable[[Shared, Job, Tell], Result],
        shared: Shared,
        jobs: Iterable[tuple[Key, Job]],
        told: Told | None = None,
    ) -> Iterator[tuple[Key, Result]]:
        """See :class:`drm_baselines.support.executors.Executor`.

        Raises
        ------
        ClusterError
            No node can take a job, a job was lost again and again, or a node would give other
            results.
        """
        ray = _ray()
        if self.workers < 1:
            raise ClusterError(f"the cluster has no node with {self._cores} cores for a job")
        task = ray.remote(_on_worker).options(
            num_cpus=self._cores, max_retries=RETRIES, name=f"drm {work.__name__}"
        )
        board = ray.remote(_Board).options(num_cpus=0).remote() if told is not None else None
        common, wanted = ray.put(shared), identity()
        lost: dict[Key, int] = {}
        again: deque[tuple[Key, Job]] = deque()
        waiting, running = iter(jobs), dict[Any, tuple[Key, Job]]()
        try:
            while True:
                while len(running) < AHEAD * max(1, self.workers):
                    following = again.popleft() if again else next(waiting, None)
                    if following is None:
                        break
                    key, job = following
                    reference = task.remote(work, common, key, job, wanted, self._cores, board)
                    running[reference] = following
                if not running:
                    return
                ready, _ = ray.wait(list(running), num_returns=1, timeout=POLL)
                if ready:
                    ready, _ = ray.wait(list(running), num_returns=len(running), timeout=0)
                if told is not None:
                    _pass_on(ray, board, told)
                for reference in ready:
                    key, job = running.pop(reference)
                    try:
                        result = _result_of(ray, reference)
                    except _LostError as error:
                        lost[key] = lost.get(key, 0) + 1
                        if lost[key] > RETRIES:
                            raise ClusterError(f"a job was lost again and again: {error}") from None
                        # what all have in common may have been lost with it
                        common = ray.put(shared)
                        again.append((key, job))
                    else:
                        yield key, result
        finally:
            for reference in running:
                with contextlib.suppress(Exception):
                    ray.cancel(reference, force=True)


class _LostError(Exception):
    """A job that was lost with its worker, its node or what it was given."""


def _pass_on(ray: Any, board: Any, told: Told) -> None:
    # the board's node may have been lost, and with it what has been told, which is no result
    with contextlib.suppress(ray.exceptions.RayError):
        for key, (done, total) in ray.get(board.news.remote(), timeout=POLL).items():
            told(key, done, total)


def _result_of(ray: Any, reference: Any) -> Any:
    """Return the result of a job, or raise what it has raised.

    Raises
    ------
    ClusterError
        A node lacks a package.
    _LostError
        The job was lost.
    """
    try:
        return ray.get(reference)
    except ray.exceptions.RayError as error:
        cause = error.cause if isinstance(error, ray.exceptions.RayTaskError) else error
        if isinstance(cause, ray.exceptions.RayError):
            lines = str(cause).strip().splitlines()
            raise _LostError(lines[0] if lines else type(cause).__name__) from error
        if isinstance(cause, ModuleNotFoundError) and not isinstance(cause, BaselineError):
            raise ClusterError(f"a node of the cluster lacks a package: {cause}") from error
        raise cause from error


def _ray() -> Any:
    with needing("work on a Ray cluster", "scale"):
        import ray
    return ray


@contextlib.contextmanager
def cluster(address: str, cores_each: int = 1) -> Iterator[OnRay]:
    """Connect to a cluster, or start one on this machine; yield who does jobs there.

    Parameters
    ----------
    address
        ``HOST:PORT`` of a cluster that this machine belongs to, ``ray://HOST:PORT`` of another,
        ``"auto"`` or ``"local"``, see :class:`drm_baselines.support.places.Place`.
    cores_each
        Cores that a job may use.

    Raises
    ------
    ClusterError
        There is none at the address.
    MissingPackageError
        Ray is not installed.
    """
    require("work on a Ray cluster", "scale", "ray")
    # nothing is sent to anybody, whatever Ray's own default is
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    ray = _ray()
    if ray.is_initialized():
        # whoever has connected this process, such as a notebook, also ends it
        yield OnRay(cores_each)
        return
    with _own_handlers():
        _connect(ray, address)
    try:
        yield OnRay(cores_each)
    finally:
        ray.shutdown()


def _knock(address: str) -> None:
    """Refuse an address where nobody answers, which Ray would go on asking for minutes.

    Raises
    ------
    ClusterError
        Nobody answers there, or it is no address.
    """
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon:
        return  # a word of Ray's, such as "auto"
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_ANSWER).close()
    except (OSError, ValueError, OverflowError) as error:
        raise ClusterError(f"no Ray cluster at {address}: {error}") from error


def _connect(ray: Any, address: str) -> None:
    quiet = {"log_to_driver": False, "configure_logging": False}
    if address != "local":
        _knock(address)
        try:
            ray.init(address=address, **quiet)
        except (ConnectionError, RuntimeError, ValueError) as error:
            if address != "auto" or os.environ.get("RAY_ADDRESS"):
                lines = str(error).strip().splitlines() or [type(error).__name__]
                raise ClusterError(f"no Ray cluster at {address}: {lines[0]}") from error
        else:
            return
    try:
        ray.init(
            address="local",
            num_cpus=cores.count(),
            include_dashboard=False,
            object_store_memory=_STORE_BYTES,
            **quiet,
        )
    except Exception as error:
        # Ray has no class of its own for a node that does not start
        if type(error) is not Exception and not isinstance(error, (RuntimeError, OSError)):
            raise
        raise ClusterError(f"Ray does not start on this machine: {error}") from error


@contextlib.contextmanager
def _own_handlers() -> Iterator[None]:
    """Keep the handlers of signals, of which Ray replaces one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
