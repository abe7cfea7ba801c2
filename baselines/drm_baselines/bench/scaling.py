"""Section ``scaling``: steps per second over the size of the batch and the number of threads."""

from __future__ import annotations

from collections.abc import Callable

import drm_env
from drm_baselines.bench.measure import (
    Measured,
    Spread,
    geometric_sizes,
    paired_ratio,
    seconds_per_call,
)
from drm_baselines.bench.results import Bench, Curve, Row, Section, cores
from drm_baselines.bench.vector import batch_stepper

SIZES = geometric_sizes(1, 65_536, 4)
RATIO_SIZES = (256, 1024, 4096, 16_384)
_REFERENCE = "1 thread, 1 environment"
_UNIT = "steps/s"


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
    curve = Curve(
        "scaling",
        "Batch size and threads",
        "environments",
        "environment steps per second",
        {label: (SIZES, values) for label, values in lines.items()},
    )
    return Section("scaling", "Steps per second of a batch", rows, notes, headline, [curve])
