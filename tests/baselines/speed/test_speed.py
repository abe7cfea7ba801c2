"""``drm bench``: what it compares the engine with is the same mechanics, and its arithmetic holds.

No test here judges a time.
"""

from __future__ import annotations

import csv
import importlib
import importlib.util
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

import drm_env
from drm_baselines.cli import app
from drm_baselines.errors import BaselineError
from drm_baselines.speed import (
    instructions,
    plots,
    report,
    sections,
)
from drm_baselines.speed.measure import (
    Spread,
    interleave,
    paired_ratio,
    seconds_per_call,
)
from drm_baselines.speed.reference import model, with_numpy, yardstick
from drm_baselines.speed.results import (
    Bench,
    Curve,
    Row,
    Section,
)
from drm_baselines.speed.sections import (
    kernel,
    memory,
    scaling,
    vector,
)
from drm_baselines.support.format import significant
from drm_env import _engine

HAS_COMPILER = any(shutil.which(name) for name in ("cc", "gcc", "clang"))
needs_compiler = pytest.mark.skipif(not HAS_COMPILER, reason="no C compiler")
needs_numba = pytest.mark.skipif(
    importlib.util.find_spec("numba") is None, reason="numba is not installed"
)

MASSES, LENGTHS, WIDTHS, MASS_ERRORS = [200.0, 120.0, 430.0], [1.0, 0.8, 1.9], [0.5, 0.4, 0.9], [
    0.0, 0.1, -0.12,
]  # fmt: skip
STATE = ("slew_angle", "alpha", "beta", "slew_rate", "alpha_rate", "beta_rate")

SECTION = Section(
    "kernel",
    "One step",
    [
        Row("engine", Spread(2.0, 1.9, 2.2), "ns", Spread(0.5, 0.4, 0.6), "C | scalar"),
        Row("C | scalar", Spread(4.0, 4.0, 4.0), "ns"),
    ],
    ["measured so"],
    {"answer": 2.0, "missing": None},
    [
        Curve(
            "steps", "Steps", "size", "steps/s", {"a": ([1, 4], [Spread(1, 1, 2), Spread(3, 2, 3)])}
        )
    ],
)


def simulated(samples: int) -> NDArray[np.float64]:
    """States of the three payloads after so many samples, from the engine."""
    columns = []
    for mass, length, width, error in zip(MASSES, LENGTHS, WIDTHS, MASS_ERRORS, strict=True):
        flight = drm_env.simulate(
            {
                "payload": {"mass": mass, "length": length, "width": width},
                "mass_error": error,
                "horizon": 20.0,
            },
            "lyapunov",
        )
        columns.append([flight[name][samples] for name in STATE])
    return np.array(columns).T


def assert_same_flight(
    fly: Callable[[model.Payloads, int], NDArray[np.float64]], samples: int
) -> None:
    state = fly(model.Payloads.of(MASSES, LENGTHS, WIDTHS, MASS_ERRORS), samples)
    expected = simulated(samples)
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(state / scale, expected / scale, rtol=0.0, atol=1e-8)


def test_the_numpy_reference_flies_where_the_engine_flies() -> None:
    """4000 samples: beyond the switch at half the slew."""
    assert_same_flight(with_numpy.fly, 4000)


@needs_numba
def test_the_numba_reference_flies_where_the_engine_flies() -> None:
    from drm_baselines.speed.reference import with_numba

    assert_same_flight(with_numba.fly, 10_000)


def test_the_references_refuse_a_payload_without_mass() -> None:
    with pytest.raises(BaselineError, match="mass must be positive, got 0"):
        model.Payloads.of([100.0, 0.0], 1.0, 0.5)


def test_no_step_of_the_references_straddles_a_switch() -> None:
    plan = model.legs(10_000)
    # one more step in the sample that the end of the slew cuts, and one in that of its middle
    assert plan.steps.sum() == 40_002
    assert plan.h.max() <= model.MAX_STEP * (1.0 + 1e-6)
    assert plan.first.sum() == 10_000
    assert (plan.h * plan.steps).sum() == pytest.approx(20.0)


@needs_compiler
@pytest.mark.parametrize("lanes", [1, yardstick.LANES])
@pytest.mark.parametrize("axial", [True, False])
def test_the_yardstick_flies_where_the_engine_flies(lanes: int, axial: bool) -> None:
    with yardstick.compiled(lanes, axial=axial) as built:
        outcome = built.run(1)
        program = built.program
    assert not program.exists()
    assert (outcome.lanes, outcome.axial) == (lanes, axial)
    assert outcome.steps == yardstick.STEPS
    assert outcome.ns_per_step > 0.0
    yardstick.check(outcome)
    other = yardstick.Outcome(**{**vars(outcome), "axial": not axial})
    with pytest.raises(yardstick.YardstickError, match=r"slew_angle is 0\.87"):
        yardstick.check(other)


def test_a_missing_compiler_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(yardstick.NoCompilerError, match="cc, gcc or clang"):
        yardstick.compiler()
    with pytest.raises(instructions.CountingError, match="no valgrind"):
        instructions.valgrind()


# -- Arithmetic ------------------------------------------------------------------------------


def test_candidates_take_turns_and_ratios_are_of_pairs() -> None:
    order: list[str] = []
    values = {"a": iter([2.0, 30.0, 4.0]), "b": iter([1.0, 10.0, 4.0])}

    def measure(name: str) -> Callable[[], float]:
        def take() -> float:
            order.append(name)
            return next(values[name])

        return take

    shown: list[str] = []
    measured = interleave({name: measure(name) for name in "ab"}, 3, shown.append)
    assert order == shown == list("ababab")
    assert paired_ratio(measured["a"], measured["b"]) == Spread(2.0, 1.0, 3.0)
    assert Spread.of(measured["a"]).scaled(0.5) == Spread(2.0, 1.0, 15.0)


def test_ratios_refuse_what_makes_no_pairs() -> None:
    with pytest.raises(BaselineError, match="got 2 and 1"):
        paired_ratio([1.0, 2.0], [1.0])
    with pytest.raises(BaselineError, match=r"must be positive, got 0\.0"):
        paired_ratio([1.0], [0.0])
    with pytest.raises(BaselineError, match="at least one"):
        Spread.of([])
    with pytest.raises(BaselineError, match="repeats must be at least 1, got 0"):
        interleave({}, 0)


def test_time_per_call_counts_whole_blocks() -> None:
    calls: list[None] = []
    assert seconds_per_call(lambda: calls.append(None), 0.0, block=7) >= 0.0
    assert len(calls) == 7


def test_sizes_and_threads() -> None:
    assert list(scaling.SIZES) == [4**power for power in range(9)]
    assert scaling.thread_counts(1) == [1]
    assert scaling.thread_counts(6) == [1, 2, 4, 6]


def test_each_size_is_paired_with_one_environment_of_the_same_rounds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(scaling, "SIZES", (1, 4))
    monkeypatch.setattr(scaling, "cores", lambda: 1)
    rounds: list[tuple[str, int, int]] = []
    section = scaling.run(Bench(2, 0, progress=lambda *shown: rounds.append(shown)))
    assert [row.relative_to for row in section.rows] == ["", "1 thread, 1 environment"]
    # two candidates in each of two rounds: the batch, and one environment beside it
    assert rounds[-1] == ("scaling: 4", 4, 4)


def test_figures_have_three_digits_or_all_of_the_integer_part() -> None:
    shown = [significant(value) for value in (0.0, 0.012345, 1.2345, 99.96, 12345.6, -2.5)]
    assert shown == ["0", "0.0123", "1.23", "100.0", "12,346", "-2.50"]
    assert report.spread_text(Spread(2.0, 1.0, 3.0)) == "2.00 [1.00, 3.00]"
    assert report.spread_text(Spread(2.0, 2.0, 2.0)) == "2.00"


# -- Files -----------------------------------------------------------------------------------


def test_markdown_is_replaced_between_its_markers_alone() -> None:
    begin, end = "<!-- drm bench: begin kernel -->", "<!-- drm bench: end kernel -->"
    old = f"# Title\n\ntyped by hand\n{begin}\nold figures\n{end}\n\nmore text\n"
    text = report.with_sections(old, [SECTION], Bench(repeats=3))
    assert text.startswith(f"# Title\n\ntyped by hand\n{begin}\n")
    assert text.endswith(f"{end}\n\nmore text\n")
    assert "old figures" not in text
    assert "| engine | 2.00 [1.90, 2.20] | ns | 0.500 [0.400, 0.600] | C \\| scalar |" in text
    assert "of 3 runs" in text
    assert report.with_sections(text, [SECTION], Bench(repeats=3)) == text


def test_markdown_without_markers_gets_them_at_its_end(tmp_path: Path) -> None:
    path = tmp_path / "performance.md"
    report.update_markdown(path, [SECTION], Bench())
    assert path.read_text().startswith("## One step\n\n<!-- drm bench: begin kernel -->\n")
    path.write_text("# Title\n")
    report.update_markdown(path, [SECTION], Bench())
    assert path.read_text().startswith("# Title\n\n## One step\n\n<!-- drm bench: begin kernel -->")


def test_damaged_markers_leave_the_file_alone(tmp_path: Path) -> None:
    path = tmp_path / "performance.md"
    path.write_text("<!-- drm bench: end kernel -->\n<!-- drm bench: begin kernel -->\n")
    before = path.read_text()
    with pytest.raises(BaselineError, match=r"markers of section kernel: .* found 1 and 1"):
        report.update_markdown(path, [SECTION], Bench())
    path.write_text(before * 2)
    with pytest.raises(BaselineError, match="found 2 and 2"):
        report.update_markdown(path, [SECTION], Bench())
    assert path.read_text() == before * 2
    refused = CliRunner().invoke(app, ["bench", "--only", "kernel", "--markdown", str(path)])
    assert refused.exit_code == 2
    assert "found 2 and 2" in " ".join(refused.stderr.split())


def test_results_as_json_csv_and_pictures(tmp_path: Path) -> None:
    content = report.data([SECTION], Bench())
    assert content["answer"] == 2.0
    assert content["missing"] is None
    rows = content["sections"]["kernel"]["rows"]
    assert rows[0]["ratio"] == {"median": 0.5, "low": 0.4, "high": 0.6}
    assert rows[1]["ratio"] is None
    path = report.write_csv(tmp_path / "bench.csv", [SECTION])
    with path.open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [row["what"] for row in table] == ["engine", "C | scalar"]
    assert float(table[0]["ratio_low"]) == 0.4
    assert table[1]["ratio"] == ""
    files = plots.plot_all([SECTION], tmp_path)
    assert [file.name for file in files] == ["kernel-ratios.png", "steps.png"]
    assert all(file.stat().st_size > 5_000 for file in files)


# -- Sections --------------------------------------------------------------------------------


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """An engine with clocks that always say the same, and no valgrind."""

    def kernel_benchmark(lanes: int, steps: int) -> tuple[float, int]:
        return (40.0, 1) if lanes == 1 else (10.0, 8)

    def no_valgrind() -> str:
        raise instructions.CountingError("no valgrind found")

    def env_benchmark(config: Any, steps: int) -> float:
        assert json.loads(config.to_json())["scenario"]["horizon"] == 20.0
        return 1e-9 * steps

    def batch_benchmark(config: Any, envs: int, steps: int, threads: int | None) -> float:
        return env_benchmark(config, steps) * envs

    monkeypatch.setattr(_engine, "kernel_benchmark", kernel_benchmark, raising=False)
    monkeypatch.setattr(_engine, "env_benchmark", env_benchmark, raising=False)
    monkeypatch.setattr(_engine, "batch_benchmark", batch_benchmark, raising=False)
    monkeypatch.setattr(instructions, "valgrind", no_valgrind)
    monkeypatch.setattr(kernel, "_REPETITIONS", 1)


def drm(*arguments: str | Path) -> str:
    result = CliRunner().invoke(app, ["bench", *map(str, arguments)])
    assert result.exit_code == 0, result.output + result.stderr
    return result.stdout


def test_kernel_json_has_its_keys_at_the_top(stand_in: None, tmp_path: Path) -> None:
    path, out, page = tmp_path / "kernel.json", tmp_path / "out", tmp_path / "page.md"
    text = drm(
        "--only", "kernel", "--repeats", "2", "--json-file", path, "--out", out, "--markdown", page
    )
    assert "engine, widest pack" in text
    content: dict[str, Any] = json.loads(path.read_text())
    assert content["single_kernel_ns_per_step"] == 40.0
    assert content["batch_kernel_ns_per_step"] == 10.0
    assert content["batch_kernel_lanes"] == 8
    assert content["repeats"] == 2
    yardsticks = ("yardstick_scalar_ns_per_step", "yardstick_lanes_ns_per_step")
    assert set(yardsticks) <= set(content)
    if HAS_COMPILER:
        assert all(content[name] > 0.0 for name in yardsticks)
        assert content["single_kernel_over_yardstick_scalar"] > 0.0
    names = {row["what"] for row in content["sections"]["kernel"]["rows"]}
    assert {kernel.SINGLE, kernel.BATCH} <= names
    notes = content["sections"]["kernel"]["notes"]
    assert any(note.startswith("instructions of engine, widest pack left out") for note in notes)
    assert {file.name for file in out.iterdir()} >= {"bench.json", "bench.csv"}
    assert "<!-- drm bench: begin kernel -->" in page.read_text()
    refused = CliRunner().invoke(app, ["bench", "--only", "kernel", "--json-file", str(path)])
    assert refused.exit_code == 2
    assert "kernel.json exists already" in " ".join(refused.stderr.split())


def test_an_engine_without_clocks_and_no_compiler_are_said(
    stand_in: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none() -> str:
        raise yardstick.NoCompilerError("no C compiler found")

    monkeypatch.delattr(_engine, "kernel_benchmark")
    monkeypatch.setattr(yardstick, "compiler", none)
    section = kernel.run(Bench(repeats=1))
    assert not section.rows
    assert section.headline["single_kernel_ns_per_step"] is None
    assert any("the installed engine has no kernel_benchmark" in note for note in section.notes)
    assert any("no C compiler found" in note for note in section.notes)


def test_a_section_that_fails_leaves_those_before_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def run(name: str, bench: Bench) -> Section:
        if name == "step":
            raise BaselineError("the clock stands still")
        return SECTION

    monkeypatch.setattr(sections, "run", run)
    path = tmp_path / "bench.json"
    result = CliRunner().invoke(
        app, ["bench", "--only", "kernel", "--only", "step", "--json-file", str(path)]
    )
    assert result.exit_code == 2
    assert "stopped in section step" in result.stderr
    assert "error: the clock stands still" in result.stderr
    assert list(json.loads(path.read_text())["sections"]) == ["kernel"]


@needs_compiler
def test_a_source_that_does_not_compile_is_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.c"
    broken.write_text("int main(")
    monkeypatch.setattr(yardstick, "SOURCE", broken)
    with (
        pytest.raises(yardstick.CompilationError, match="ended with 1"),
        yardstick.compiled(1, axial=True),
    ):
        pass


def test_all_ratios_come_as_one_table() -> None:
    table = report.ratio_table([SECTION, SECTION])
    assert table.row_count == 2


def test_instructions_are_counted_by_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    def counted(command: list[str]) -> tuple[int, str]:
        steps = int(command[-1])
        return 5_000_000 + 800 * steps, "avx2, lanes: 4\nsomething else\n"

    monkeypatch.setattr(instructions, "instructions_of", counted)
    assert instructions.count_engine(0, Path("kernel")) == instructions.Count(
        200.0, "avx2, lanes: 4"
    )
    monkeypatch.setattr(instructions, "instructions_of", lambda _: (1, "no width"))
    with pytest.raises(instructions.CountingError, match="does not say its lanes"):
        instructions.count_engine(0, Path("kernel"))


@needs_compiler
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind counts the instructions")
@pytest.mark.parametrize(("lanes", "yardstick_lanes"), [(1, 1), (0, 8)])
def test_the_kernel_is_compiled_for_the_instructions_that_it_runs_with(
    lanes: int, yardstick_lanes: int
) -> None:
    # Counts, not times: where a part of it is not inlined, its fused multiply-adds become calls,
    # and a step takes eight times the instructions of the same step in C.
    try:
        program = instructions.kernel_example()
    except instructions.CountingError as error:
        pytest.skip(str(error))  # the Rust tests of `make test` build it
    engine = instructions.count_engine(lanes, program)
    reference = instructions.count_yardstick(yardstick_lanes, axial=True)
    assert engine.instructions < 1.5 * reference.instructions


def test_unknown_sections_are_refused_and_listed() -> None:
    refused = CliRunner().invoke(app, ["bench", "--only", "speed"])
    assert refused.exit_code == 2
    assert "--only speed: no such section" in refused.stderr
    assert all(name in drm("--list") for name in sections.SECTIONS)
    assert sections.chosen(["step", "kernel"]) == ["kernel", "step"]
    assert sections.chosen(None) == list(sections.SECTIONS)


SMALL: dict[str, dict[str, Any]] = {
    "kernel": {},
    "step": {"_ENGINE_STEPS": 10},
    "vector": {"SIZES": (1, 4), "_ENGINE_STEPS": 40},
    "learn": {"SIZES": (2,), "_STEPS": 8},
    "training": {"SHAPES": ((2, 8, 8, 1),)},
    "rollout": {"_NUMPY_EPISODES": 8, "_NUMPY_SAMPLES": 2, "_NUMBA_EPISODES": 1},
    "scaling": {"SIZES": (1, 256), "RATIO_SIZES": (256,)},
    "memory": {"_SMALL": 16, "_LARGE": 2048},
    "consistent": {"_EPISODES": 1, "_HORIZON": 0.1},
}
HEADLINES = {
    "kernel": "batch_kernel_ns_per_step",
    "step": "step_us_above_engine",
    "vector": "vector_4_over_engine",
    "learn": "learn_SlewResidual-v0_2_over_idle",
    "training": "training_2x8_over_stock",
    "rollout": "rollout_over_numpy",
    "scaling": "",
    "memory": "bytes_per_environment",
    "consistent": "consistent_over_thesis",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", list(sections.SECTIONS))
def test_every_section_runs_in_small(
    name: str, stand_in: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if name in ("learn", "training"):
        pytest.importorskip("stable_baselines3")
    if name == "memory":
        pytest.importorskip("psutil")
    module = importlib.import_module(f"drm_baselines.speed.sections.{name}")
    for attribute, value in SMALL[name].items():
        monkeypatch.setattr(module, attribute, value)
    shown: list[tuple[str, int, int]] = []
    bench = Bench(1, 0, 2, 64, lambda *progress: shown.append(progress))
    section = sections.run(name, bench)
    assert section.name == name
    assert section.rows
    assert section.notes
    assert shown[-1][1] == shown[-1][2]
    if HEADLINES[name]:
        assert isinstance(section.headline[HEADLINES[name]], float)
    json.dumps(report.data([section], bench))
    plots.plot_all([section], tmp_path)


def test_batches_are_stepped_through_their_resets() -> None:
    batch = drm_env.DrmVectorEnv(3, horizon=0.05)
    step = vector.batch_stepper(batch)
    for _ in range(12):
        step()
    batch.close()


def test_idle_environments_learn_like_others() -> None:
    pytest.importorskip("stable_baselines3")
    from drm_baselines.speed.sections.learn import idle_environment
    from drm_env.sb3 import make_sb3_vec

    venv = make_sb3_vec("drm_env/Slew-v0", n_envs=3)
    idle = idle_environment(venv)
    observations, rewards, dones, infos = idle.step(np.zeros((3, 2), np.float32))
    assert idle.observation_space == venv.observation_space
    assert isinstance(observations, np.ndarray)
    assert observations.shape == (3, *(venv.observation_space.shape or ()))
    assert rewards.shape == dones.shape == (3,)
    assert infos == [{}, {}, {}]
    assert infos[0] is not infos[1]
    venv.close()


@pytest.mark.slow
def test_memory_is_measured_in_fresh_processes() -> None:
    pytest.importorskip("psutil")
    found = memory.probe(2048, 4096)
    assert found["after_reset"] > found["before"]
    with pytest.raises(BaselineError, match="memory of 0 environments"):
        memory.probe(0)
