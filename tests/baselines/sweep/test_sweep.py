"""``drm sweep``: episodes are those of ``drm compare``, kept block by block, whoever flies them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import drm_env
from drm_baselines.cli import app
from drm_baselines.errors import BaselineError, ExistingResultError
from drm_baselines.evaluation import environment_config, fly_law
from drm_baselines.support.places import Place
from drm_baselines.support.seeds import TRAINING_SEED
from drm_baselines.sweep import request as requests
from drm_baselines.sweep import runner
from drm_baselines.sweep.parts import EPISODES, part_of
from drm_baselines.sweep.request import Fleet, SweepRequest
from drm_baselines.sweep.summary import _figures_of, _medians, summary_of

pandas = pytest.importorskip("pandas")
pytest.importorskip("pyarrow")

SHORT = {"horizon": 6.0}


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requests, "BLOCK", 8)


def request(**changes: Any) -> SweepRequest:
    arguments = {"policies": ("linear", "lqr"), "options": SHORT, "episodes": 20, "seed": 5}
    return SweepRequest(**{**arguments, **changes})


def episodes_of(directory: Path) -> Any:
    return pandas.read_parquet(directory / EPISODES)


def drm(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["sweep", *map(str, arguments)])


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("sweep")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(requests, "BLOCK", 8)
        runner.sweep(directory, request())
    return directory


def test_the_episodes_are_those_of_the_environment(flown: Path) -> None:
    options = {**SHORT, "payload_mass": (50.0, 500.0), "mass_error": (-0.15, 0.15)}
    config = environment_config("drm_env/Slew-v0", options)
    alone = fly_law({"name": "linear"}, config, env_id="drm_env/Slew-v0", seed=5, episodes=20)
    table = episodes_of(flown)
    linear = table[table.policy == "linear"]
    assert linear.seed.tolist() == alone.seeds
    for name, values in alone.metrics.items():
        np.testing.assert_array_equal(linear[name], values)
    for column, path in (("payload_mass", "payload.mass"), ("mass_error", "mass_error")):
        np.testing.assert_allclose(linear[column], alone.context[path], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        linear.reported_mass, linear.payload_mass * (1.0 + linear.mass_error), rtol=1e-12
    )
    assert table.mass_error.abs().max() < 0.15 and table.payload_mass.between(50, 500).all()


def test_processes_give_the_same_files(flown: Path, tmp_path: Path) -> None:
    runner.sweep(tmp_path, request(), place=Place(processes=2))
    own = sorted(path.relative_to(flown) for path in (flown / EPISODES).rglob("*.parquet"))
    assert len(own) == 6
    assert all((tmp_path / path).read_bytes() == (flown / path).read_bytes() for path in own)


def interrupted_after(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> tuple[list[int], Callable[[], None]]:
    """Have a sweep interrupted when so many blocks are written; return what is written."""
    written: list[int] = []
    plain = runner.write_part

    def write(path: Path, columns: Any, digest: str) -> Path:
        if len(written) == count:
            raise KeyboardInterrupt
        written.append(1)
        return plain(path, columns, digest)

    monkeypatch.setattr(runner, "write_part", write)
    return written, lambda: monkeypatch.setattr(runner, "write_part", plain)


def test_an_interrupted_sweep_goes_on(
    flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, undisturbed = interrupted_after(4, monkeypatch)
    with pytest.raises(KeyboardInterrupt):
        runner.sweep(tmp_path, request())
    undisturbed()
    outcome = runner.sweep(tmp_path, request())
    assert (outcome.found, outcome.flown) == (4, 2)
    pandas.testing.assert_frame_equal(episodes_of(tmp_path), episodes_of(flown), check_exact=True)


def test_policies_and_episodes_can_be_added(flown: Path, tmp_path: Path) -> None:
    runner.sweep(tmp_path, request(policies=("lqr",), episodes=10))
    outcome = runner.sweep(tmp_path, request())
    # the second block of 8 was cut short
    assert (outcome.found, outcome.flown) == (1, 5)
    pandas.testing.assert_frame_equal(episodes_of(tmp_path), episodes_of(flown), check_exact=True)


def test_a_damaged_block_is_flown_again(flown: Path, tmp_path: Path) -> None:
    runner.sweep(tmp_path, request())
    fleet = Fleet.of(request())
    block = list(fleet.blocks("linear"))[1]
    path = part_of(tmp_path, block)
    path.write_bytes(path.read_bytes()[:-50])
    outcome = runner.sweep(tmp_path, request())
    assert (outcome.found, outcome.flown) == (5, 1)
    assert path.read_bytes() == part_of(flown, block).read_bytes()


def test_another_sweep_is_refused(flown: Path, tmp_path: Path) -> None:
    with pytest.raises(BaselineError, match="was begun with seed 5, not 6"):
        runner.sweep(flown, request(seed=6))
    with pytest.raises(BaselineError, match=r"config\.scenario\.horizon 6\.0, not 7\.0"):
        runner.sweep(flown, request(options={"horizon": 7.0}))
    (tmp_path / "something").write_text("else")
    with pytest.raises(ExistingResultError, match="not empty"):
        runner.sweep(tmp_path, request())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"payload_mass": (500.0, 50.0)}, "payload_mass must be a range LOW HIGH.*got 500 50"),
        ({"mass_error": 0.0}, "mass_error must be between 0 and 1, got 0"),
        ({"mass_error": math.nan}, "mass_error must be between 0 and 1, got nan"),
        ({"options": {"mass_error": 0.1}}, "mass_error is given twice"),
        ({"episodes": 0}, "episodes must be at least 1, got 0"),
        ({"seed": TRAINING_SEED - 1}, "kept for training"),
        ({"policies": ()}, "none to fly"),
    ],
)
def test_a_request_that_is_none_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(BaselineError, match=message):
        request(**changes)


def test_a_learned_policy_flies_too(tmp_path: Path) -> None:
    runner.sweep(tmp_path, request(policies=("dagger",), options={}, episodes=3))
    table = episodes_of(tmp_path)
    assert len(table) == 3 and {"episode_return", "tip_error_rms"} <= set(table.columns)


# --- the summary


def test_quantiles_and_map_are_those_of_a_plain_count() -> None:
    rng = np.random.default_rng(0)
    count = 4001
    payload, misreport = rng.uniform(50, 500, count), rng.uniform(-0.15, 0.15, count)
    error = rng.lognormal(size=count)
    diverged = rng.random(count) < 0.01
    edges = (np.linspace(50, 500, 4), np.linspace(-0.15, 0.15, 3))
    columns = {
        "seed": np.arange(count), "payload_mass": payload, "mass_error": misreport,
        "tip_error_rms": np.where(diverged, math.nan, error),
        "settled": np.ones(count), "diverged": diverged.astype(float),
    }  # fmt: skip
    found = _figures_of("somebody", columns, edges)
    bad = np.where(diverged, math.inf, error)
    for level, value in found.quantiles.items():
        # the share of episodes that are no worse reaches the level there, and not before
        assert np.mean(bad <= value) >= level > np.mean(bad < value)
    low, high = found.median_interval
    assert low < found.quantiles[0.5] < high
    assert (found.worst, found.worst_seed) == (
        error[~diverged].max(),
        np.flatnonzero(error == error[~diverged].max())[0],
    )
    assert found.diverged == np.mean(diverged) and found.settled == 1.0
    for row, column in np.ndindex(3, 2):
        inside = (
            (payload >= edges[0][row]) & (payload < edges[0][row + 1])
            & (misreport >= edges[1][column]) & (misreport < edges[1][column + 1])
        )  # fmt: skip
        values = np.sort(bad[inside])
        assert found.cells[row, column] == values[math.ceil(len(values) / 2) - 1]


def test_a_cell_with_hardly_any_episode_says_nothing() -> None:
    edges = (np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0]))
    found = _medians(np.array([1.0, 2.0, 3.0, 9.0]), np.array([0.1, 0.2, 2.0, 0.3]), np.zeros(4),
                     edges)  # fmt: skip
    assert found[0, 0] == 2.0 and np.isnan(found[1, 0])


def test_the_interval_of_the_median_holds_in_95_of_100() -> None:
    rng = np.random.default_rng(1)
    edges = (np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    inside = 0
    for _ in range(400):
        plain = {name: np.zeros(101) for name in ("seed", "payload_mass", "mass_error", "settled",
                                                  "diverged")}  # fmt: skip
        found = _figures_of("", {**plain, "tip_error_rms": rng.exponential(size=101)}, edges)
        low, high = found.median_interval
        inside += low <= math.log(2.0) <= high
    assert inside / 400 > 0.93  # three standard deviations below 0.96


def test_the_columns_are_documented() -> None:
    text = (Path(__file__).parents[3] / "docs" / "scale.md").read_text()
    own = ("policy", "seed", "payload_mass", "reported_mass", "mass_error", "slew_angle")
    assert all(f"`{name}`" in text for name in own)
    metrics = drm_env.rollout(drm_env.sample_scenarios(n=1), num_threads=1)
    assert metrics and "metrics.md" in text


# --- the command


def test_the_command_writes_table_map_and_summary(tmp_path: Path) -> None:
    out = tmp_path / "sweep"
    given = ("--law", "linear", "--policy", "lqr", "--episodes", 60, "--set", "horizon=6", "--out",
             out, "--payload-mass", 100, 300, "--mass-error", 0.1)  # fmt: skip
    result = drm(*given)
    assert result.exit_code == 0, result.output
    assert "linear law" in result.stdout and "LQR, scheduled and tuned" in result.stdout
    content = json.loads((out / "summary.json").read_text())
    entry = content["policies"]["lqr"]
    assert entry["episodes"] == 60
    table = episodes_of(out)
    lqr = np.sort(table[table.policy == "lqr"].tip_error_rms)
    assert entry["tip_error_rms"]["quantile_0.5"] == lqr[29]
    assert (out / "tip_error.png").read_bytes()[:4] == b"\x89PNG"
    assert content["payload_mass_edges"][0] >= 100.0 and content["payload_mass_edges"][-1] <= 300.0
    again = drm(*given, "--json")
    assert json.loads(again.stdout)["policies"]["lqr"] == entry
    fleet = Fleet.of(request(policies=("linear", "lqr"), episodes=60, seed=0))
    assert summary_of(out, fleet).figures["lqr"].quantiles[0.5] == lqr[29]


def test_the_command_says_what_a_sweep_costs(tmp_path: Path, monkeypatch: Any) -> None:
    from drm_baselines.sweep import cost

    monkeypatch.setattr(cost, "_SECONDS", 0.01)
    out = tmp_path / "sweep"
    result = drm("--law", "linear", "--cost", "--json", "--out", out, "--set", "horizon=6")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)["policies"][0]
    assert found["policy"] == "linear" and found["seconds"] > 0.0
    # what travels for a block: four numbers there, some columns of doubles back
    assert found["job_bytes"] < 1000
    assert 15 <= found["result_bytes"] / found["block"] / 8 <= 40
    assert not out.exists()
