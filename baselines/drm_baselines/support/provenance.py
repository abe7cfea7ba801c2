"""Where a result comes from: versions, platform, commit."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import drm_env

_DISTRIBUTIONS = (
    "drm-baselines",
    "numpy",
    "scipy",
    "gymnasium",
    "stable-baselines3",
    "torch",
    "safetensors",
)


def versions() -> dict[str, str]:
    """Return the installed version of each package that can change a result."""
    found = {
        "drm-env": drm_env.__version__,
        "python": platform.python_version(),
    }
    for name in _DISTRIBUTIONS:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def git_commit() -> str | None:
    """Return the commit of the source checkout this package runs from, if it is one.

    A ``-dirty`` suffix says that tracked files differ from the commit.
    """
    here = Path(__file__).resolve().parent
    command = ["git", "-C", str(here), "describe", "--always", "--abbrev=40", "--dirty"]
    try:
        # An installed copy inside somebody else's repository must not report their commit.
        subprocess.run(
            ["git", "-C", str(here), "ls-files", "--error-unmatch", Path(__file__).name],
            check=True,
            capture_output=True,
            timeout=10,
        )
        answer = subprocess.run(command, check=True, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip() or None


def provenance() -> dict[str, Any]:
    """Return what is needed to tell where a result came from: versions, platform, commit."""
    return {
        "versions": versions(),
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cpu_count": os.cpu_count(),
        "git_commit": git_commit(),
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]] if sys.argv else [],
    }
