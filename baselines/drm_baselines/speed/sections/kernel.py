"""Section ``kernel``: one Runge-Kutta step of the thesis plant, beside the same step in plain C."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from drm_baselines.errors import BaselineError
from drm_baselines.speed import engine, instructions
from drm_baselines.speed.measure import Measured, Spread, paired_ratio
from drm_baselines.speed.reference import yardstick
from drm_baselines.speed.results import Bench, Row, Section

SINGLE, BATCH = "engine, one environment", "engine, widest pack"
_REPETITIONS = 20
_NS, _INSTRUCTIONS = "ns/step/env", "instructions/step/env"

# Key in the JSON file, lanes, with axial load.
_YARDSTICKS = (
    ("yardstick_scalar", 1, True),
    ("yardstick_lanes", yardstick.LANES, True),
    ("yardstick_scalar_without_axial_load", 1, False),
    ("yardstick_lanes_without_axial_load", yardstick.LANES, False),
)


def _name(lanes: int, axial: bool) -> str:
    width = "scalar" if lanes == 1 else f"{lanes} lanes"
    return f"C, {width}" + ("" if axial else ", without axial load")


def _best(lanes: int) -> float:
    return min(engine.kernel_benchmark(lanes, yardstick.STEPS)[0] for _ in range(_REPETITIONS))


def _built(stack: contextlib.ExitStack, notes: list[str]) -> dict[str, Callable[[], float]]:
    """Compile the yardsticks and check where they fly; say why if there are none."""
    candidates: dict[str, Callable[[], float]] = {}
    try:
        notes.append(f"C: {yardstick.version_of_compiler()}")
        for _, lanes, axial in _YARDSTICKS:
            built = stack.enter_context(yardstick.compiled(lanes, axial=axial))
            yardstick.check(built.run(1))

            def measure(built: yardstick.Yardstick = built) -> float:
                return built.run(_REPETITIONS).ns_per_step

            candidates[_name(lanes, axial)] = measure
            if len(candidates) == 1:
                notes.append("compiled with " + " ".join(built.command[1:]))
    except (yardstick.NoCompilerError, yardstick.CompilationError) as error:
        notes.append(f"C yardstick left out: {error}")
    return candidates


def _rows(measured: Measured) -> list[Row]:
    rows = []
    for name, values in measured.items():
        partners: list[str] = []
        if name in (SINGLE, BATCH):
            lanes = 1 if name == SINGLE else yardstick.LANES
            partners = [_name(lanes, axial) for axial in (True, False)]
        partners = [partner for partner in partners if partner in measured]
        if name == BATCH and SINGLE in measured:
            partners.append(SINGLE)
        for partner in partners or [""]:
            rows.append(
                Row(
                    name,
                    Spread.of(values),
                    _NS,
                    paired_ratio(values, measured[partner]) if partner else None,
                    partner,
                )
            )
    return rows


def _counted(bench: Bench, notes: list[str]) -> list[Row]:
    """Count instructions; say why where that cannot be done."""
    rows: list[Row] = []
    label = "kernel: instructions"
    for index, (name, lanes) in enumerate(((SINGLE, 1), (BATCH, 0))):
        bench.progress(label, index, 2)
        reference: float | None = None
        width = 1 if lanes == 1 else yardstick.LANES
        with contextlib.suppress(BaselineError):
            counted = instructions.count_yardstick(width, axial=True)
            reference = counted.instructions
            rows.append(
                Row(
                    f"{_name(width, True)} ({counted.description})",
                    Spread.of([reference]),
                    _INSTRUCTIONS,
                )
            )
        try:
            count = instructions.count_engine(lanes, instructions.kernel_example())
        except instructions.CountingError as error:
            notes.append(f"instructions of {name} left out: {error}")
            continue
        value = Spread.of([count.instructions])
        ratio = None if reference is None else paired_ratio([value.median], [reference])
        partner = "" if reference is None else _name(width, True)
        rows.append(Row(f"{name} ({count.description})", value, _INSTRUCTIONS, ratio, partner))
    bench.progress(label, 2, 2)
    if rows:
        notes.append(
            "Instructions are counted by valgrind's callgrind, which knows no AVX-512; they "
            "are the same in every run."
        )
    return rows


def run(bench: Bench) -> Section:
    """Measure the kernel on one thread."""
    notes: list[str] = []
    candidates: dict[str, Callable[[], float]] = {}
    lanes: int | None = None
    try:
        lanes = engine.kernel_benchmark(0, 16)[1]
        candidates = {SINGLE: lambda: _best(1), BATCH: lambda: _best(0)}
    except engine.MissingBenchmarkError as error:
        notes.append(f"engine left out: {error}")
    with contextlib.ExitStack() as stack:
        candidates |= _built(stack, notes)
        measured = bench.interleave("kernel", candidates)
    notes.insert(
        0,
        f"One thread, Payload 1 along the open-loop thesis manoeuvre, steps of 0.5 ms; each value "
        f"is the best of {_REPETITIONS} manoeuvres in one call"
        + ("." if lanes is None else f"; the engine's widest pack has {lanes} lanes."),
    )

    def median(name: str) -> float | None:
        return Spread.of(measured[name]).median if name in measured else None

    headline: dict[str, float | None] = {
        "single_kernel_ns_per_step": median(SINGLE),
        "batch_kernel_ns_per_step": median(BATCH),
        "batch_kernel_lanes": lanes,
    }
    for key, width, axial in _YARDSTICKS:
        headline[f"{key}_ns_per_step"] = median(_name(width, axial))
    pairs = (
        ("single_kernel_over_yardstick_scalar", SINGLE, _name(1, True)),
        ("batch_kernel_over_yardstick_lanes", BATCH, _name(yardstick.LANES, True)),
    )
    for key, above, below in pairs:
        both = above in measured and below in measured
        headline[key] = paired_ratio(measured[above], measured[below]).median if both else None
    rows = _rows(measured) + _counted(bench, notes)
    return Section("kernel", "One Runge-Kutta step on one thread", rows, notes, headline)
