"""The sections of the benchmark by name; each is loaded when it runs."""

from __future__ import annotations

import importlib
from collections.abc import Sequence

from drm_baselines.errors import BaselineError
from drm_baselines.speed.results import Bench, Section

SECTIONS = {
    "kernel": "one Runge-Kutta step, beside the same step in C",
    "step": "one environment through Gymnasium, beside Pendulum and the engine alone",
    "vector": "batches of environments, beside NumPy's CartPole and the engine alone",
    "learn": "frames per second of PPO, beside PPO on environments that do nothing",
    "training": "where PPO's time goes, and drm train beside the library's own loop",
    "rollout": "whole closed-loop episodes, beside C, NumPy and numba",
    "scaling": "steps per second over batch size and threads",
    "memory": "memory of a resting environment, and growth over a long run",
    "consistent": "the consistent plant beside the thesis plant",
}


def chosen(only: Sequence[str] | None) -> list[str]:
    """Return the names of the sections to run, in their order.

    Raises
    ------
    BaselineError
        An unknown name.
    """
    for name in only or ():
        if name not in SECTIONS:
            raise BaselineError(f"--only {name}: no such section; there are {', '.join(SECTIONS)}")
    return [name for name in SECTIONS if not only or name in only]


def run(name: str, bench: Bench) -> Section:
    """Run the section ``name``."""
    module = importlib.import_module(f"drm_baselines.speed.sections.{name}")
    result: Section = module.run(bench)
    return result
