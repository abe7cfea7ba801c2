"""Whether what a user asks for fits into memory, judged before anything is allocated."""

from __future__ import annotations

import os
from pathlib import Path

from drm_baselines.errors import BaselineError

_MEMINFO = Path("/proc/meminfo")
_GROUPS = (
    # limit and use of a container, in the two forms that Linux has
    (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")),
    (
        Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
        Path("/sys/fs/cgroup/memory/memory.usage_in_bytes"),
    ),
)


def available() -> int | None:
    """Return the bytes that this process can still have, or none where that is not known."""
    found = []
    try:
        for line in _MEMINFO.read_text("ascii").splitlines():
            if line.startswith("MemAvailable:"):
                found.append(int(line.split()[1]) * 1024)
    except (OSError, ValueError, IndexError):
        pass
    for limit, use in _GROUPS:
        try:
            found.append(int(limit.read_text("ascii")) - int(use.read_text("ascii")))
        except (OSError, ValueError):  # no such group, or no limit: "max"
            continue
    try:
        import resource

        limit_of_all = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit_of_all != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
            found.append(limit_of_all - pages * os.sysconf("SC_PAGE_SIZE"))
    except (ImportError, OSError, ValueError):
        pass
    return max(0, min(found)) if found else None


def _size(count: float) -> str:
    for unit in ("bytes", "KiB", "MiB", "GiB", "TiB"):
        if count < 1024.0:
            return f"{count:.3g} {unit}"
        count /= 1024.0
    return f"{count:,.0f} PiB"


def require(size: int, what: str) -> None:
    """Refuse what does not fit; ``size`` is in bytes, ``what`` begins the error.

    Raises
    ------
    BaselineError
        More than what is available; the message says how much it would take.
    """
    room = available()
    if room is not None and size > room:
        raise BaselineError(
            f"{what} would take about {_size(size)} of memory, and {_size(room)} are available"
        )
