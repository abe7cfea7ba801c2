"""Work shared out among processes."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor


def process_pool(count: int | None = None) -> ProcessPoolExecutor:
    """Return a pool of so many processes, by default one a processor.

    They are spawned, not forked: engine, solver, torch and progress bars have threads, of which a
    forked process would have none. Scripts need the usual guard of their main module.
    """
    return ProcessPoolExecutor(
        max_workers=count or os.cpu_count() or 1,
        mp_context=multiprocessing.get_context("spawn"),
    )
