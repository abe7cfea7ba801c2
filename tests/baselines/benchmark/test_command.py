"""``drm benchmark``: from flights to files, resumable, the same bytes each time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import drm_env
from drm_baselines.benchmark import competitors as competing
from drm_baselines.benchmark import runner
from drm_baselines.benchmark.records import read_record, write_record
from drm_baselines.benchmark.report import targets as report
from drm_baselines.cli import app
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.suites import load

LAWS = ("none", "linear", "lyapunov", "linear_tuned", "lyapunov_tuned", "lqr")


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("benchmark")


def invoke(directory: Path, *arguments: str) -> str:
    names = [item for law in LAWS for item in ("--policy", law)]
    result = CliRunner().invoke(
        app, ["benchmark", "--suite", "thesis", "--out", str(directory), *names, *arguments]
    )
    assert result.exit_code == 0, result.output
    return result.output


def test_json_has_every_policy_and_metric(directory: Path) -> None:
    path = directory / "thesis.json"
    assert "thesis: flights took" in invoke(directory, "--json-file", str(path))
    content = json.loads(path.read_text())
    assert set(content["policies"]) == set(LAWS)
    for entry in content["policies"].values():
        for metric in ("tip_error_rms", "residual_rms", "settled", "final_slew_error"):
            assert {"iqm", "mean", "ci95"} <= set(entry[metric])
            low, high = entry[metric]["ci95"]
            assert low <= entry[metric]["iqm"] <= high
    assert (directory / "benchmark.html").is_file()


def test_flown_again_is_the_same_to_the_bit(directory: Path, tmp_path: Path) -> None:
    invoke(directory)
    invoke(tmp_path, "--again")
    for law in LAWS:
        first = read_record(runner.record_file(directory, "thesis", law))
        second = read_record(runner.record_file(tmp_path, "thesis", law))
        for name, values in first.metrics.items():
            np.testing.assert_array_equal(values, second.metrics[name])


def test_records_are_not_flown_again_until_something_changes(directory: Path) -> None:
    invoke(directory)
    path = runner.record_file(directory, "thesis", "linear")
    before = path.stat().st_mtime_ns
    invoke(directory)
    assert path.stat().st_mtime_ns == before
    path.write_bytes(path.read_bytes()[:100])
    invoke(directory)
    assert read_record(path).metrics["tip_error_rms"].shape == (1, 108)


def test_record_says_what_flew(directory: Path) -> None:
    invoke(directory)
    record = read_record(runner.record_file(directory, "thesis", "lqr"))
    assert record.details["law"]["name"] == "scheduled"
    assert record.details["suite"] == load("thesis").digest
    assert record.control_period == 0.002


def test_thesis_is_judged_on_the_third_with_the_exact_mass(directory: Path) -> None:
    invoke(directory)
    everybody = competing.chosen(competing.competitors(), ["linear"])
    result = runner.fly_suite("thesis", everybody, directory)
    judged = report.judged_part(result).records[0].episodes
    errors = {load("thesis").scenarios[place]["mass_error"] for place in judged}
    assert (len(judged), errors) == (36, {0.0})


def test_old_records_are_shown_under_the_names_of_today(directory: Path) -> None:
    invoke(directory)
    path = runner.record_file(directory, "thesis", "linear")
    write_record(path, replace(read_record(path), title="of old"))
    everybody = competing.chosen(competing.competitors(), ["linear"])
    assert runner.fly_suite("thesis", everybody, directory).records[0].title == "linear law"


def test_unknown_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BaselineError, match="'lqq'"):
        competing.chosen(competing.competitors(), ["lqq"])
    with pytest.raises(RunError, match="holds no learned policies"):
        competing.check_runs(tmp_path)


@pytest.mark.parametrize(
    "method", [m for m in competing.LEARNERS if competing.runs_in(competing.shipped_runs() / m)]
)
def test_shipped_policies_fly_and_do_not_depend_on_threads(method: str) -> None:
    from drm_baselines.policies.policy_file import load_policy

    runs = competing.runs_in(competing.shipped_runs() / method)
    assert sorted(runs) == list(range(10))
    policy = load_policy(runs[0])
    scenarios = load("robust").scenarios[::100]
    config = competing.task_in(policy, scenarios)
    network = policy.network.engine()
    one = drm_env.rollout(scenarios, policy=network, config=config, num_threads=1)
    two = drm_env.rollout(scenarios, policy=network, config=config, num_threads=2)
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name])
    training = policy.description["training"]
    assert {"command", "seed", "steps", "wall_time"} <= set(training)


def test_learned_policy_imports_no_torch() -> None:
    code = (
        "import sys, numpy as np, drm_baselines as b\n"
        "policy = b.make_policy('learned')\n"
        "obs = np.zeros(policy.network.inputs, dtype=np.float32)\n"
        "action, _ = policy.predict(obs)\n"
        "assert action.shape == (2,)\n"
        "assert not {'torch', 'stable_baselines3', 'optuna'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env=dict(os.environ))
