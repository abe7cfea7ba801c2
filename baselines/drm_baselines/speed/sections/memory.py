"""Section ``memory``: bytes of a resting environment, and growth over a long run."""

from __future__ import annotations

import functools
import importlib.util
import json
import subprocess
import sys

from drm_baselines.errors import BaselineError
from drm_baselines.speed.measure import Spread
from drm_baselines.speed.results import Bench, Row, Section

_SMALL, _LARGE = 1024, 65_536
_LONG_BATCH = 32
_TITLE = "Memory of a batch"


def probe(num_envs: int, steps: int = 0) -> dict[str, int]:
    """Return what :mod:`drm_baselines.speed.memory_probe` prints in a fresh process.

    Raises
    ------
    BaselineError
        The process fails.
    """
    command = [sys.executable, "-m", "drm_baselines.speed.memory_probe", str(num_envs), str(steps)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        last = done.stderr.strip().splitlines()[-1:] or ["no message"]
        raise BaselineError(f"memory of {num_envs} environments cannot be measured: {last[0]}")
    content: dict[str, int] = json.loads(done.stdout)
    return content


def run(bench: Bench) -> Section:
    """Measure resident memory in fresh processes."""
    if importlib.util.find_spec("psutil") is None:
        return Section(
            "memory", _TITLE, [], ["left out: psutil is not installed (the extra 'bench' has it)"]
        )

    def growth(num_envs: int) -> float:
        found = probe(num_envs)
        return float(found["after_reset"] - found["before"])

    names = {size: f"{size:,} environments after reset" for size in (_SMALL, _LARGE)}
    measured = bench.interleave(
        "memory", {name: functools.partial(growth, size) for size, name in names.items()}
    )
    each = (measured[names[_LARGE]] - measured[names[_SMALL]]) / (_LARGE - _SMALL)
    bench.progress("memory: long run", 0, 1)
    long_run = probe(_LONG_BATCH, bench.long_steps)
    bench.progress("memory: long run", 1, 1)
    grown = long_run["late"] - long_run["early"]
    rows = [
        *(
            Row(name, Spread.of(measured[name] / 2**20), "MiB")
            for name in (names[_SMALL], names[_LARGE])
        ),
        Row("one resting environment (difference quotient)", Spread.of(each), "bytes"),
        Row(
            f"growth from a tenth to the whole of {bench.long_steps:,} environment steps",
            Spread.of([grown / 2**10]),
            "KiB",
        ),
    ]
    notes = [
        "Growth of the resident memory of fresh processes; drm_env.DrmVectorEnv with its arrays. "
        f"The long run is one of {_LONG_BATCH} environments, resets included; it runs once."
    ]
    headline: dict[str, float | None] = {
        "bytes_per_environment": Spread.of(each).median,
        "long_run_growth_bytes": float(grown),
    }
    return Section("memory", _TITLE, rows, notes, headline)
