"""The engine's own clocks: benchmarks that run inside the extension module, without Python.

They exist for this package alone and are no part of drm-env's public interface, so a build of
the engine may lack them; then the sections say so and leave their rows out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from drm_baselines.errors import BaselineError
from drm_env import ResolvedConfig, _engine


class MissingBenchmarkError(BaselineError):
    """The installed engine does not have a benchmark of this name."""


def _function(name: str) -> Callable[..., Any]:
    function: Callable[..., Any] | None = getattr(_engine, name, None)
    if function is None:
        raise MissingBenchmarkError(f"the installed engine has no {name}")
    return function


def kernel_benchmark(lanes: int, steps: int) -> tuple[float, int]:
    """Return the time of a Runge-Kutta step an environment, ns, and the environments a pack.

    Parameters
    ----------
    lanes
        1 is the path of a single environment, 0 the widest pack.
    steps
        Steps that each environment makes, on the calling thread.

    Raises
    ------
    MissingBenchmarkError
        The engine cannot.
    """
    nanoseconds, used = _function("kernel_benchmark")(lanes, steps)
    return float(nanoseconds), int(used)


def env_benchmark(config: ResolvedConfig, steps: int) -> float:
    """Return the time of ``steps`` control periods of one environment inside the engine, s.

    Raises
    ------
    MissingBenchmarkError
        The engine cannot.
    """
    return float(_function("env_benchmark")(config.held, steps))


def batch_benchmark(
    config: ResolvedConfig, num_envs: int, steps: int, num_threads: int | None
) -> float:
    """Return the time of ``steps`` control periods of a batch inside the engine, s.

    Raises
    ------
    MissingBenchmarkError
        The engine cannot.
    """
    return float(_function("batch_benchmark")(config.held, num_envs, steps, num_threads))


def available(name: str) -> bool:
    """Return whether the engine has the benchmark ``name``."""
    return hasattr(_engine, name)
