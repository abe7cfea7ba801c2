"""Section ``scaling``: steps per second over the size of the batch and the number of threads."""

from __future__ import annotations

from collections.abc import Callable

import drm_env
from drm_baselines.speed import engine
from drm_baselines.speed.measure import (
    Measured,
    Spread,
    geometric_sizes,
    paired_ratio,
    seconds_per_call,
)
from drm_baselines.speed.results import (
    Bench,
    Curve,
    Row,
    Section,
    cores,
)
from drm_baselines.speed.sections.vector import batch_stepper

SIZES = geometric_sizes(1, 65_536, 4)
RATIO_SIZES = (256, 1024, 4096, 16_384)
_REFERENCE = "1 thread, 1 environment"
_UNIT = "steps/s"
_ENGINE_STEPS = 2900
"""Control periods of one measurement of the engine alone: an episode and a half."""
_ENGINE_MOST = 2_000_000
"""Environment steps of one such measurement at most."""


def thread_counts(available: int) -> list[int]:
    """Return 1, 2, 4, ... and the number of cores itself."""
    return sorted({*geometric_sizes(1, available, 2), available})


def _size(bench: Bench, num_envs: int, threads: list[int]) -> Measured:
    """Measure one size, in every round beside a batch of one on one thread."""
    batches = {str(count): drm_env.DrmVectorEnv(num_envs, num_threads=count) for count in threads}
    if num_envs > 1:
        batches[_REFERENCE] = drm_env.DrmVectorEnv(1, num_threads=1)

    def timed(batch: drm_env.DrmVectorEnv) -> Callable[[], float]:
        step = batch_stepper(batch)
        block = max(1, 256 // batch.num_envs)
        return lambda: batch.num_envs / seconds_per_call(step, bench.seconds, block=block)

    try:
        return bench.interleave(
            f"scaling: {num_envs}", {name: timed(batch) for name, batch in batches.items()}
        )
    finally:
        for batch in batches.values():
            batch.close()


def _alone(bench: Bench, num_envs: int) -> Measured:
    """Measure the engine by itself, on one thread and on two."""
    config = drm_env.resolve()
    steps = max(
        20, min(_ENGINE_STEPS, _ENGINE_MOST // num_envs, int(_ENGINE_STEPS * bench.seconds))
    )

    def timed(threads: int) -> Callable[[], float]:
        return lambda: num_envs * steps / engine.batch_benchmark(config, num_envs, steps, threads)

    return bench.interleave(
        f"scaling: {num_envs}, engine alone", {str(threads): timed(threads) for threads in (1, 2)}
    )


def run(bench: Bench) -> Section:
    """Measure all sizes with all numbers of threads."""
    threads = thread_counts(cores())
    notes = ["Environment steps of drm_env/Slew-v0 (control period 10 ms), resets included."]
    if len(threads) == 1:
        notes.append("Only one core may be used here: no ratio of threads.")
    rows: list[Row] = []
    headline: dict[str, float | None] = {}
    lines: dict[str, list[Spread]] = {}
    for num_envs in SIZES:
        measured = _size(bench, num_envs, threads)
        reference = measured.pop(_REFERENCE, None)
        for count, values in measured.items():
            label = f"{count} thread" + ("" if count == "1" else "s")
            lines.setdefault(label, []).append(Spread.of(values))
            ratio, partner = None, ""
            if count == "2" and num_envs in RATIO_SIZES:
                ratio, partner = paired_ratio(values, measured["1"]), "1 thread, same batch"
                headline[f"two_threads_over_one_{num_envs}"] = ratio.median
            elif count == "1" and reference is not None:
                ratio, partner = paired_ratio(values, reference), _REFERENCE
            rows.append(Row(f"{num_envs:,} x {label}", Spread.of(values), _UNIT, ratio, partner))
    if 2 in threads and engine.available("batch_benchmark"):
        for num_envs in (size for size in RATIO_SIZES if size in SIZES):
            measured = _alone(bench, num_envs)
            ratio = paired_ratio(measured["2"], measured["1"])
            headline[f"two_threads_over_one_{num_envs}_engine"] = ratio.median
            name = f"{num_envs:,} x"
            rows.append(
                Row(f"{name} 1 thread, engine alone", Spread.of(measured["1"]), _UNIT, None, "")
            )
            rows.append(
                Row(
                    f"{name} 2 threads, engine alone",
                    Spread.of(measured["2"]),
                    _UNIT,
                    ratio,
                    "1 thread, same batch",
                )
            )
        notes.append(
            "Engine alone: without Gymnasium's part of a step, which is serial: arrays, infos."
        )
    curve = Curve(
        "scaling",
        "Batch size and threads",
        "environments",
        "environment steps per second",
        {label: (SIZES, values) for label, values in lines.items()},
    )
    return Section("scaling", "Steps per second of a batch", rows, notes, headline, [curve])
