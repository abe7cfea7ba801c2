"""Section ``rollout``: whole closed-loop episodes, beside C, NumPy and numba."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.speed.measure import Spread, paired_ratio, seconds_of
from drm_baselines.speed.reference import model, with_numpy, yardstick
from drm_baselines.speed.results import (
    Bench,
    Row,
    Section,
    cores,
)

_HORIZON = 20.0
_ENGINE, _YARDSTICK = "drm_env.rollout", "C kernel alone"
_NUMPY, _NUMBA = "NumPy, one core", "numba, all cores"
_KEYS = {_YARDSTICK: "yardstick", _NUMPY: "numpy", _NUMBA: "numba"}
# Episodes and samples of one measurement: enough to fill the arrays, few enough to wait for.
_NUMPY_EPISODES, _NUMPY_SAMPLES = 4096, 200
_NUMBA_EPISODES = 256


def steps_of(samples: int) -> int:
    """Return the Runge-Kutta steps of the first ``samples`` samples of an episode."""
    return int(model.legs(samples).steps.sum())


def _payloads(episodes: int) -> model.Payloads:
    return model.Payloads.of(np.full(episodes, 200.0), 1.0, 0.5)


def _numba() -> ModuleType | None:
    try:
        from drm_baselines.speed.reference import with_numba
    except ImportError:
        return None
    return with_numba


def run(bench: Bench) -> Section:
    """Fly thesis episodes under the Lyapunov law on all cores."""
    samples = round(_HORIZON / model.SAMPLE)
    steps = steps_of(samples) * bench.episodes
    available = cores()
    scenarios = [{"horizon": _HORIZON, "payload": {"mass": 200.0, "length": 1.0, "width": 0.5}}]
    scenarios *= bench.episodes
    notes = [
        f"{bench.episodes:,} thesis episodes of {_HORIZON:g} s under the Lyapunov law, which "
        f"decides every 2 ms: {steps:,} Runge-Kutta steps on {available} core(s).",
        f"C kernel alone: the time that the yardstick with {yardstick.LANES} lanes and axial load "
        f"takes for as many steps on one core, divided by {available}; it has no law, no metrics.",
        f"NumPy: {_NUMPY_EPISODES:,} episodes of {_NUMPY_SAMPLES} samples on one core, scaled by "
        "the number of steps. The arm's length, the same in all episodes, is not computed anew "
        "for each. NumPy and numba end with the state and compute no metrics.",
    ]

    def engine() -> float:
        return seconds_of(lambda: drm_env.rollout(scenarios, "lyapunov", num_threads=available))

    def scaled(
        fly: Callable[[model.Payloads, int], NDArray[np.float64]],
        episodes: int,
        flown: int,
    ) -> Callable[[], float]:
        payloads = _payloads(episodes)
        factor = steps / (episodes * steps_of(flown))
        return lambda: factor * seconds_of(lambda: fly(payloads, flown))

    candidates: dict[str, Callable[[], float]] = {_ENGINE: engine}
    compiled_python = _numba()
    with contextlib.ExitStack() as stack:
        try:
            built = stack.enter_context(yardstick.compiled(yardstick.LANES, axial=True))
            yardstick.check(built.run(1))
            candidates[_YARDSTICK] = lambda: built.run().ns_per_step * 1e-9 * steps / available
        except (yardstick.NoCompilerError, yardstick.CompilationError) as error:
            notes.append(f"C left out: {error}")
        candidates[_NUMPY] = scaled(with_numpy.fly, _NUMPY_EPISODES, _NUMPY_SAMPLES)
        if compiled_python is None:
            notes.append("numba left out: it is not installed (the extra 'bench' has it)")
        else:
            compiled_python.fly(_payloads(1), 1)
            candidates[_NUMBA] = scaled(compiled_python.fly, _NUMBA_EPISODES, samples)
            notes.append(
                f"numba: {_NUMBA_EPISODES} whole episodes on {compiled_python.threads()} "
                "thread(s), compiled beforehand, scaled by the number of episodes."
            )
        measured = bench.interleave("rollout", candidates)

    rows: list[Row] = []
    headline: dict[str, float | None] = {}
    for name, values in measured.items():
        if name == _ENGINE:
            continue
        ratio = paired_ratio(measured[_ENGINE], values)
        rows.append(Row(_ENGINE, Spread.of(measured[_ENGINE]), "s", ratio, name))
        headline[f"rollout_over_{_KEYS[name]}"] = ratio.median
    rows.extend(
        Row(name, Spread.of(values), "s") for name, values in measured.items() if name != _ENGINE
    )
    headline["rollout_episodes_per_second"] = bench.episodes / Spread.of(measured[_ENGINE]).median
    return Section("rollout", "Whole closed-loop episodes", rows, notes, headline)
