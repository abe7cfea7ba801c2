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


def _begin() -> None:
    # A terminal sends Ctrl-C to every process: the parent ends the pool, the others say nothing.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with_parent()


def _kill_workers(pool: ProcessPoolExecutor) -> None:
    if hasattr(pool, "kill_workers"):  # from Python 3.14 on
        pool.kill_workers()
        return
    for process in list((getattr(pool, "_processes", None) or {}).values()):
        process.kill()


@contextlib.contextmanager
def process_pool(count: int | None = None) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of so many processes, by default one a processor.

    They are spawned, not forked: engine, solver, torch and progress bars have threads, of which a
    forked process would have none. Scripts need the usual guard of their main module. When an
    error or a signal leaves the block, the processes are ended at once: nobody takes what they
    are at. When this process ends in whatever way, so do they.
    """
    pool = ProcessPoolExecutor(
        max_workers=count or os.cpu_count() or 1,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
    )
    try:
        yield pool
    except BaseException:
        _kill_workers(pool)
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    pool.shutdown(wait=True)
