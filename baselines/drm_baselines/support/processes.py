"""Work shared out among processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor


def _ignore_ctrl_c() -> None:
    # A terminal sends Ctrl-C to every process: the parent ends the pool, the others say nothing.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def process_pool(count: int | None = None) -> ProcessPoolExecutor:
    """Return a pool of so many processes, by default one a processor.

    They are spawned, not forked: engine, solver, torch and progress bars have threads, of which a
    forked process would have none. Scripts need the usual guard of their main module.
    """
    return ProcessPoolExecutor(
        max_workers=count or os.cpu_count() or 1,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_ignore_ctrl_c,
    )
