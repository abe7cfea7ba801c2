"""Records that are kept: small files of which anybody makes the tables again, without flying."""

from __future__ import annotations

import importlib
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("jinja2")
pytest.importorskip("pyarrow")

from drm_baselines.benchmark import competitors as competing
from drm_baselines.benchmark import kept, recording, runner
from drm_baselines.benchmark.records import SUBMITTED, Record, SuiteResult
from drm_baselines.benchmark.report import documents, leaderboard, tables
from drm_baselines.cli import app
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.suites import load

parquet: Any = importlib.import_module("pyarrow.parquet")
ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "benchmark.md").read_text(encoding="utf-8")
PACKAGED = kept.suites_in(kept.packaged())


def made(policy: str = "ppo", kind: str = "learned", seeds: int = 2, **changes: Any) -> Record:
    """A record of six episodes with metrics of all kinds, one of them diverged."""
    rng = np.random.default_rng(3)
    shape = (seeds, 6)
    tip = rng.lognormal(-6.0, 2.0, shape)
    tip[0, 2] = np.nan
    whole = {
        "policy": policy,
        "title": policy,
        "kind": kind,
        "knows": "reported",
        "control_period": 0.1,
        "seeds": list(range(seeds)),
        "episodes": np.array([0, 2, 4, 6, 8, 10]),
        "strata": ["a", "a", "b", "b", "c", "c"],
        "metrics": {
            "tip_error_rms": tip,
            "settled": rng.integers(0, 2, shape).astype(float),
            "settling_time": rng.random(shape),
            "duration": np.full(shape, 30.0),
            "slew_end_time": np.full(shape, 15.0),
            "diverged": np.isnan(tip).astype(float),
            "overshoot": rng.random(shape),
        },
        "details": {
            "training": {
                str(seed): {
                    "algorithm": "ppo",
                    "seed": seed,
                    "steps": 38400 * 40,
                    "wall_time": 90.0 + 60.0 * seed,
                    "command": ["drm", "train", "--seed", str(seed)],
                    "hyperparameters": {"n_envs": 128, "model": {"n_steps": 300}},
                    "versions": {"torch": "2"},
                }
                for seed in range(seeds)
            }
        },
    }
    return Record(**{**whole, **changes})


def result(*records: Record, suite: str = "robust") -> SuiteResult:
    return SuiteResult(suite=suite, title="made up", records=records)


def test_what_is_kept_is_what_was_flown(tmp_path: Path) -> None:
    law = made("linear", "law", 1, details={"law": {"name": "linear"}}, control_period=0.002)
    path = kept.keep(tmp_path, result(made(), law), {"linear": "abc"})
    first, second = kept.read_kept(path)
    # in the order of tables, whatever the order of flights
    assert (first.policy, second.policy) == ("linear", "ppo")
    assert first.details == {"law": {"name": "linear"}, "fingerprint": "abc"}
    assert (second.kind, second.control_period, second.seeds) == ("learned", 0.1, [0, 1])
    np.testing.assert_array_equal(second.episodes, made().episodes)
    assert list(second.strata) == list(made().strata)
    for name, values in made().metrics.items():
        if name == "overshoot":  # no table shows it
            assert name not in second.metrics
        else:
            np.testing.assert_allclose(second.metrics[name], values, rtol=2.0**-24)


def test_one_row_an_episode_policy_and_seed_that_pandas_reads(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_parquet(kept.keep(tmp_path, result(made())))
    assert len(frame) == 2 * 6
    row = frame[(frame.policy == "ppo") & (frame.seed == 1) & (frame.episode == 8)].iloc[0]
    assert row.stratum == "c"
    assert row.tip_error_rms == np.float32(made().metrics["tip_error_rms"][1, 4])


def test_flying_one_policy_again_leaves_the_rows_of_others(tmp_path: Path) -> None:
    kept.keep(tmp_path, result(made("sac"), made()))
    path = kept.keep(tmp_path, result(made("sac", control_period=0.2)))
    assert [(one.policy, one.control_period) for one in kept.read_kept(path)] == [
        ("ppo", 0.1),
        ("sac", 0.2),
    ]


def test_learned_rows_say_steps_updates_and_minutes(tmp_path: Path) -> None:
    path = kept.keep(tmp_path, result(made()))
    record = kept.read_kept(path)[0]
    # 128 environments x 300 steps are 38,400 decisions an update: forty of them; 1.5 and 2.5 min
    assert record.details["training"]["1"]["updates"] == 40
    assert tables.trained_on(record) == "1.54 M steps, 40 updates, 2.00 min"
    assert "hyperparameters" not in record.details["training"]["0"]
    text = tables.markdown_table(result(record))
    assert "1.54 M steps, 40 updates, 2.00 min" in text
    assert "An update is a batch of experience for PPO" in text


def test_leaderboard_ranks_who_flew_everything(tmp_path: Path) -> None:
    def level(policy: str, kind: str, millimetres: float, **changes: Any) -> Record:
        values = np.full((1, 6), millimetres * 1e-3)
        return made(policy, kind, 1, metrics={"tip_error_rms": values}, details={}, **changes)

    few = replace(
        level("receding", "controller", 0.1),
        episodes=np.array([0]),
        strata=["a"],
        metrics={"tip_error_rms": np.full((1, 1), 1e-4)},
    )
    mine = level("mine", SUBMITTED, 2.0)
    mine = replace(
        mine,
        details={
            "weights_sha256": "0123456789abcdef",
            "training": {"0": {"steps": 5, "command": ["<script>alert(1)</script>|`x`"]}},
        },
    )
    text = leaderboard.leaderboard(
        [result(level("bound", "bound", 0.5), level("linear", "law", 3.0), few, mine)]
    )
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| ")]
    assert [(row[0], row[1]) for row in rows[1:5]] == [
        ("| -", "receding \\*"),
        ("| -", "bound"),
        ("| 1", "mine"),
        ("| 2", "linear"),
    ]
    assert "| 5 steps |" in text
    assert "weights 0123456789ab" in text
    assert "<" not in text.replace("<!--", "")


# --- hostile files --------------------------------------------------------------------------------


def changed(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Rewrite a file of records with another header."""
    table = parquet.read_table(path)
    header = json.loads(table.schema.metadata[b"drm_records"])
    change(header)
    parquet.write_table(table.replace_schema_metadata({"drm_records": json.dumps(header)}), path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda header: header.update(format="other"), "holds no kept records"),
        (lambda header: header.update(format_version=2), "format version 2"),
        (lambda header: header.update(policies=[]), "damaged"),
        (lambda header: header["policies"].update(more={}), "other policies than the rows"),
        (lambda header: header["policies"]["ppo"].update(kind="best"), "kind must be one of"),
        (lambda header: header["policies"]["ppo"].update(knows=3), "knows must be one of"),
        (lambda header: header["policies"]["ppo"].update(control_period=-1), "must be a time"),
        (lambda header: header["policies"]["ppo"].update(control_period="1"), "must be a time"),
        (lambda header: header["policies"]["ppo"].update(metrics=["bound_solved"]), "damaged"),
        (lambda header: header["policies"]["ppo"].update(metrics=7), "damaged"),
        (lambda header: header["policies"]["ppo"].update(details=[1]), "damaged"),
        (lambda header: header["policies"].update(ppo=None), "damaged"),
        (lambda header: header["policies"]["ppo"].pop("kind"), "damaged"),
    ],
)
def test_a_strange_header_is_refused(
    tmp_path: Path, change: Callable[[dict[str, Any]], Any], message: str
) -> None:
    path = kept.keep(tmp_path, result(made()))
    changed(path, change)
    with pytest.raises(RunError, match=message) as caught:
        kept.read_kept(path)
    assert str(path) in str(caught.value)


def test_strange_rows_are_refused(tmp_path: Path) -> None:
    path = kept.keep(tmp_path, result(made()))
    table = parquet.read_table(path)
    for rows in (table.slice(0, 7), table.take([0, 1, 2, 3, 4, 4, 6, 7, 8, 9, 10, 10])):
        parquet.write_table(rows, path)
        with pytest.raises(RunError, match="damaged"):
            kept.read_kept(path)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(RunError, match="cannot be read"):
        kept.read_kept(path)
    with pytest.raises(RunError, match="no records of a benchmark"):
        kept.results_in(tmp_path / "nowhere")
    with pytest.raises(RunError, match=r"no thesis\.parquet"):
        kept.results_in(tmp_path, ["thesis"])


# --- what comes with the package ------------------------------------------------------------------


def published(suite: str) -> dict[str, dict[str, str]]:
    """The table of a suite in docs/benchmark.md: cells by title and heading."""
    place = re.search(rf"<!-- benchmark:{suite} -->\n(.*?)<!-- /benchmark", PAGE, re.DOTALL)
    assert place is not None
    lines = [line for line in place[1].splitlines() if line.startswith("|")]
    headings, _, *rows = [[cell.strip() for cell in line[1:-1].split("|")] for line in lines]
    return {row[0].removesuffix(" \\*"): dict(zip(headings, row, strict=True)) for row in rows}


@pytest.mark.parametrize("suite", PACKAGED)
def test_packaged_records_are_of_what_would_fly_today(suite: str) -> None:
    """Else ``drm benchmark --suite SUITE --package --documents .`` makes them anew."""
    everybody = {one.policy: one for one in competing.competitors()}
    manoeuvres = load(suite)
    records = kept.results_in(kept.packaged(), [suite])[0].records
    assert records
    for record in records:
        stamp = record.details["fingerprint"]
        assert stamp == runner.fingerprint(everybody[record.policy], manoeuvres), record.policy
        assert set(record.episodes.tolist()) <= set(range(len(manoeuvres)))
        chosen = [manoeuvres.strata[place] for place in record.episodes]
        assert list(record.strata) == chosen


@pytest.mark.parametrize("suite", PACKAGED)
def test_published_figures_follow_from_the_packaged_records(suite: str) -> None:
    """Every figure and interval of a row, and the whole table where all rows are kept."""
    table = published(suite)
    found = kept.results_in(kept.packaged(), [suite])[0]
    assert len(found.records) >= 4
    headings = tables.headings_of()
    for cells in tables.rows_of(found):
        mine = dict(zip(headings, cells, strict=True))
        row = table[mine["policy"].removesuffix(" *")]
        for heading in headings[1:]:
            if heading == "times the bound" and "bound" not in {r.policy for r in found.records}:
                continue
            if heading in row:  # the page may be older than a column
                assert row[heading] == mine[heading], (mine["policy"], heading)
    complete = {record.title for record in found.records} == set(table)
    if complete and tables.TRAINED in next(iter(table.values())):
        assert tables.markdown_table(found) in PAGE


@pytest.mark.parametrize("suite", PACKAGED)
def test_packaged_records_name_no_place_of_a_machine(suite: str) -> None:
    for record in kept.results_in(kept.packaged(), [suite])[0].records:
        assert not [word for word in record.details["command"] if Path(word).is_absolute()]


def test_the_leaderboard_is_that_of_the_packaged_records() -> None:
    page = (ROOT / "docs" / "leaderboard.md").read_text(encoding="utf-8")
    assert leaderboard.leaderboard(kept.results_in(kept.packaged())) in page


def test_rows_of_a_page_are_not_lost(tmp_path: Path) -> None:
    page = tmp_path / "benchmark.md"
    whole = result(made("linear", "law"), made("ppo"))
    page.write_text(
        f"<!-- benchmark:robust -->\n{tables.markdown_table(whole)}\n<!-- /benchmark:robust -->\n"
    )
    documents.check_rows(page, [whole])
    with pytest.raises(BaselineError, match=r"the table of robust has rows .* ppo"):
        documents.check_rows(page, [result(made("linear", "law"))])


def test_the_command_makes_tables_of_records_without_flying(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nobody(*_: Any, **__: Any) -> Any:
        raise AssertionError("somebody flew")

    monkeypatch.setattr(runner, "fly_suite", nobody)
    path = tmp_path / "summary.json"
    arguments = ["benchmark", "--from-records", "--suite", "thesis", "--policy", "linear",
                 "--policy", "lqr", "--out", str(tmp_path / "out"),
                 "--json-file", str(path)]  # fmt: skip
    run = CliRunner().invoke(app, arguments)
    assert run.exit_code == 0, run.output
    content = json.loads(path.read_text())
    assert set(content["policies"]) == {"linear", "lqr"}
    assert (tmp_path / "out" / "benchmark.html").is_file()


@pytest.mark.parametrize(
    "arguments",
    [
        ["--from-records", "--again"],
        ["--from-records", "--package"],
        ["--from-records", "--learned", "."],
        ["--submit", "mine=x", "--package"],
    ],
)
def test_options_that_contradict_each_other_are_refused(
    tmp_path: Path, arguments: list[str]
) -> None:
    run = CliRunner().invoke(app, ["benchmark", "--out", str(tmp_path / "out"), *arguments])
    assert run.exit_code != 0
    assert "cannot be given with" in run.output
    assert not (tmp_path / "out").exists()


def test_records_are_kept_by_the_command_that_flies(tmp_path: Path) -> None:
    arguments = ["benchmark", "--suite", "thesis", "--policy", "linear", "--policy", "none",
                 "--out", str(tmp_path / "out"), "--keep", str(tmp_path / "kept")]  # fmt: skip
    run = CliRunner().invoke(app, arguments)
    assert run.exit_code == 0, run.output
    flown = runner.fly_suite(
        "thesis", competing.chosen(competing.competitors(), ["linear"]), tmp_path / "out"
    ).records[0]
    found = recording.recorded(tmp_path / "kept", "thesis", tmp_path / "out", None, ["linear"])
    np.testing.assert_allclose(
        found.records[0].metrics["tip_error_rms"], flown.metrics["tip_error_rms"], rtol=1e-7
    )
    summary = json.loads((tmp_path / "kept" / "summary.json").read_text())
    assert set(summary["policies"]) == {"none", "linear"}
