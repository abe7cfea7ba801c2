"""Work shared out among processes that end with the one that shares it out.

They do so also when that one is killed and can do nothing more: Linux is told to end them, and on
every system a thread of theirs waits for their parent's end.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.connection import wait
from typing import Any

from drm_baselines.support import cores

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def _end_with_parent() -> None:
    """Have this process end when its parent has ended, whatever it does by then."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    if sys.platform == "linux":
        # also in the middle of a native call that keeps the interpreter's lock
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, name="parent's end", daemon=True).start()


_boards: list[Any] = []  # of a worker: the queue that its parent reads


def _begin(cores_each: int | None, board: Any) -> None:
    # A terminal sends Ctrl-C to every process: the parent ends the pool, the others say nothing.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with_parent()
    if cores_each is not None:
        cores.keep_to(cores_each)
    _boards[:] = []
    if board is not None:
        # what nobody reads any more must not keep a worker from its end
        board.cancel_join_thread()
        _boards.append(board)


def tell_parent(message: Any) -> None:
    """In a worker of a pool with a board: leave a message for the parent."""
    for board in _boards:
        board.put(message)


def _kill_workers(pool: ProcessPoolExecutor) -> None:
    if hasattr(pool, "kill_workers"):  # from Python 3.14 on
        pool.kill_workers()
        return
    for process in list((getattr(pool, "_processes", None) or {}).values()):
        process.kill()


@contextlib.contextmanager
def process_pool(
    count: int | None = None, *, cores_each: int | None = None, board: Any = None
) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of so many processes, by default one a core that this process may use.

    Each may use ``cores_each`` cores, by default as many as it likes. ``board`` is a queue of
    spawned processes that takes what :func:`tell_parent` is given.

    They are spawned, not forked: engine, solver, torch and progress bars have threads, of which a
    forked process would have none. Scripts need the usual guard of their main module. When an
    error or a signal leaves the block, the processes are ended at once: nobody takes what they
    are at. When this process ends in whatever way, so do they.
    """
    pool = ProcessPoolExecutor(
        max_workers=count or cores.count(),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
        initargs=(cores_each, board),
    )
    try:
        yield pool
    except BaseException:
        _kill_workers(pool)
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    pool.shutdown(wait=True)
