"""How many processor cores this process may use: all of them, unless it was given some.

Where work is shared out (:mod:`drm_baselines.support.executors`), each process that works gets a
number of cores and keeps to it: the threads of the engine, of linear algebra and of the solver. So
many processes on one machine do not start many threads each.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

_LIBRARIES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "RAYON_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
"""What libraries of linear algebra ask when they are loaded."""

_given: list[int] = []


def keep_to(count: int) -> None:
    """Have this process use so many cores from now on.

    Libraries of linear algebra look once, when they are loaded: for them this has to come first.
    """
    _given[:] = [count]
    for name in _LIBRARIES:
        os.environ[name] = str(count)


@contextlib.contextmanager
def kept_to(count: int) -> Iterator[None]:
    """Have this process use so many cores meanwhile, but for libraries that are loaded already."""
    before, places = list(_given), {name: os.environ.get(name) for name in _LIBRARIES}
    keep_to(count)
    try:
        yield
    finally:
        _given[:] = before
        for name, value in places.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def given() -> int | None:
    """Return the cores that this process was given, none where it has the whole machine."""
    return _given[0] if _given else None


def count() -> int:
    """Return the number of cores that this process may use."""
    return given() or os.cpu_count() or 1
