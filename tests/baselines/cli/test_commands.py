"""The ``drm`` command: what it prints and writes, and that errors are one clear line."""

from __future__ import annotations

import csv
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from drm_baselines.cli import app
from drm_baselines.cli.common import parse_options, parse_value
from drm_baselines.cli.demo import fresh_directory, verdict
from drm_baselines.errors import BaselineError
from drm_baselines.policies.names import listed

COMMANDS = (
    "info",
    "modes",
    "simulate",
    "compare",
    "render",
    "train",
    "imitate",
    "tune",
    "evaluate",
    "benchmark",
    "sweep",
    "demo",
    "reproduce",
    "bench",
)

TINY_PPO = """
algorithm = "ppo"
n_envs = 4
learning_rate = 1e-3
[model]
n_steps = 16
batch_size = 32
n_epochs = 1
[network]
layers = [8]
"""


def drm(*arguments: str | Path | float) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def succeed(*arguments: str | Path | float) -> str:
    result = drm(*arguments)
    assert result.exit_code == 0, result.output + result.stderr
    return result.stdout


def refuse(*arguments: str | Path | float) -> str:
    """Run a command that must be refused; return its message, which is no traceback."""
    result = drm(*arguments)
    assert result.exit_code == 2, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert "Traceback" not in result.stderr
    return " ".join(result.stderr.split())


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A tiny training run."""
    settings = tmp_path / "tiny.toml"
    settings.write_text(TINY_PPO)
    directory = tmp_path / "tiny"
    succeed("train", "--out", directory, "--hyperparameters", settings, "--steps", 128,
            "--set", "horizon=0.4", "--evaluations", 1, "--evaluation-episodes", 2)  # fmt: skip
    return directory


def test_help_of_the_whole_names_every_command() -> None:
    text = succeed("--help")
    assert all(command in text for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_each_command(command: str) -> None:
    assert "--" in succeed(command, "--help")


def test_info_is_the_environments_own_description() -> None:
    import drm_env

    content = json.loads(succeed("info", "--json", "--env", "drm_env/SlewDirect-v0"))
    layout = drm_env.observation_layout("slew_direct")
    assert [entry["name"] for entry in content["observation"]] == [entry.name for entry in layout]
    assert content["actuators"] == ["root_wheel", "tip_wheel", "slew_motor"]
    assert content["versions"]["numpy"]
    assert "payload_mass" in content["options"]
    assert "slew_error" in succeed("info")
    assert "payload_mass" in succeed("info", "--options")
    assert "horizon" in succeed("info", "--config")


def test_simulate_reproduces_the_published_overshoot(tmp_path: Path) -> None:
    """+15 % reported mass, open loop: 56.21 deg is published (slender payload)."""
    out = tmp_path / "flight"
    scenario = tmp_path / "scenario.toml"
    scenario.write_text('[payload]\nmass = 200.0\nlength = 1.0\nwidth = 0.5\ninertia = "slender"\n')
    text = succeed("simulate", scenario, "--mass-error", 0.15, "--law", "none", "--law",
                   "lyapunov", "--out", out, "--json")  # fmt: skip
    metrics = json.loads(text)["metrics"]
    assert math.degrees(metrics["none"]["peak_slew_angle"]) == pytest.approx(56.21, abs=0.02)
    assert math.degrees(metrics["lyapunov"]["peak_slew_angle"]) == pytest.approx(50.07, abs=0.03)
    stored = json.loads((out / "simulation.json").read_text())
    assert stored["metrics"] == metrics
    with (out / "none.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert max(math.degrees(float(row["slew_angle"])) for row in rows) == pytest.approx(
        56.21, abs=0.03
    )
    assert (out / "manoeuvre.png").stat().st_size > 10_000


def test_simulate_flags_win_over_the_file_and_angles_are_in_degrees(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.json"
    scenario.write_text(json.dumps({"payload": {"mass": 50.0}, "horizon": 3.0}))
    options = ("--payload-mass", 80, "--slew-angle-deg", 30, "--law", "none", "--json")
    stored = json.loads(succeed("simulate", scenario, *options))
    assert stored["scenario"]["payload"] == {"mass": 80.0}
    assert stored["scenario"]["slew"]["angle"] == pytest.approx(math.pi / 6)
    assert stored["metrics"]["none"]["duration"] == pytest.approx(3.0)


def test_simulate_takes_a_final_time_and_a_motor() -> None:
    """The slew takes the time that is given; a motor of 500 N m leaves the arm behind."""
    options = ("--slew-final-time", 15, "--law", "none", "--horizon", 16, "--json")
    free = json.loads(succeed("simulate", *options))["metrics"]["none"]
    assert free["slew_end_time"] == 15.0
    limited = json.loads(succeed("simulate", *options, "--motor-torque-limit", 500))
    assert limited["scenario"]["slew_motor"] == {"open_loop_limit": 500.0}
    assert limited["metrics"]["none"]["final_slew_error"] < -0.1 < free["final_slew_error"]
    assert "open_loop_limit" in refuse("simulate", "--motor-torque-limit", -1)
    assert "final_time" in refuse("simulate", "--slew-final-time", 0)


def test_simulate_refuses_what_it_cannot_fly(tmp_path: Path) -> None:
    assert "no scenario file" in refuse("simulate", tmp_path / "missing.json")
    assert ".json or .toml" in refuse("simulate", tmp_path / "scenario.yaml")
    broken = tmp_path / "broken.json"
    broken.write_text("{")
    assert "cannot be read" in refuse("simulate", broken)
    unknown = tmp_path / "unknown.toml"
    unknown.write_text("[payload]\nmas = 3.0\n")
    assert "mas" in refuse("simulate", unknown)
    assert "payload.mass" in refuse("simulate", "--payload-mass", -3)
    assert "none, linear, lyapunov" in refuse("simulate", "--law", "pid")
    assert "given twice" in refuse("simulate", "--law", "none", "--law", "none")


def test_compare_writes_a_complete_report(tmp_path: Path) -> None:
    out = tmp_path / "comparison"
    arguments = ("compare", "none", "linear", "--episodes", 6, "--seed", 5,
                 "--set", "payload_mass=50..100", "--out", out)  # fmt: skip
    report = json.loads(succeed(*arguments, "--json"))
    assert report == json.loads((out / "comparison.json").read_text())
    assert (report["format"], report["format_version"]) == ("drm-comparison", 1)
    assert (report["seed"], report["episodes"]) == (5, 6)
    assert [policy["label"] for policy in report["policies"]] == ["open loop", "linear law"]
    for policy in report["policies"]:
        assert policy["control_period"] == 0.002
        estimate = policy["metrics"]["tip_error_rms"]
        assert estimate["low"] <= estimate["value"] <= estimate["high"]
        assert estimate["count"] == 6
    paired = report["paired"]
    assert paired["reference"] == "open loop"
    assert paired["candidates"]["linear law"]["tip_error_rms"]["verdict"] == "better"
    assert {"versions", "platform", "git_commit"} <= report["provenance"].keys()
    with (out / "episodes.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["policy"], row["seed"]) for row in rows] == [
        (label, str(seed)) for label in ("open loop", "linear law") for seed in range(5, 11)
    ]
    assert all(50.0 <= float(row["context/payload.mass"]) <= 100.0 for row in rows)
    settings = json.loads((out / "episodes.settings.json").read_text())
    assert settings["environment"]["config"]["scenario"]["horizon"] == 20.0
    for name in ("comparison.png", "tip_error.png", "manoeuvre.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    before = (out / "comparison.json").read_text()
    assert "not empty" in refuse(*arguments)
    assert (out / "comparison.json").read_text() == before
    succeed(*arguments, "--force")


def test_compare_prints_units() -> None:
    text = succeed("compare", "linear", "none", "--episodes", 4)
    assert "(mm)" in text
    assert "(deg)" in text
    assert "open loop minus linear law" in text


def test_compare_knows_every_policy_by_the_name_and_title_of_the_benchmark() -> None:
    text = succeed("compare", "lqr", "learned", "--episodes", 2, "--json")
    labels = [policy["label"] for policy in json.loads(text)["policies"]]
    assert labels == ["LQR, scheduled and tuned", "imitation and gradient, residual, seed 0"]


def test_unknown_policies_and_environments_are_named() -> None:
    message = refuse("compare", "lqq")
    assert "'lqq'" in message
    assert listed() in message
    assert "drm_env/Slew-v0" in refuse("compare", "--env", "Slew-v0")
    assert "payload_mas" in refuse("compare", "--set", "payload_mas=3")
    assert "KEY=VALUE" in refuse("compare", "--set", "payload_mass")
    assert "kept for training" in refuse("compare", "--seed", 1_000_000_000)
    assert "only once" in refuse("compare", "none", "none", "--episodes", 4)


def test_evaluate_law_to_csv_and_json(tmp_path: Path) -> None:
    out, records = tmp_path / "report.json", tmp_path / "episodes.csv"
    arguments = ("evaluate", "--policy", "lyapunov", "--episodes", 4, "--out", out,
                 "--records", records)  # fmt: skip
    succeed(*arguments)
    report = json.loads(out.read_text())
    assert report["policy"]["label"] == "Lyapunov law"
    with records.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 4
    assert "exists" in refuse(*arguments)
    assert ".csv or .parquet" in refuse("evaluate", "--policy", "none", "--records",
                                        tmp_path / "x.xlsx")  # fmt: skip


def test_train_resume_evaluate_and_compare(run: Path) -> None:
    stored = json.loads((run / "run.json").read_text())
    assert (stored["status"], stored["steps"], stored["seed"]) == ("finished", 128, 0)
    assert "finished after 256" in succeed("train", "--resume", "--out", run, "--steps", 256)
    report = json.loads(succeed("evaluate", "--policy", run, "--episodes", 3, "--json"))
    assert report["environment"]["id"] == "drm_env/SlewResidual-v0"
    assert report["environment"]["config"]["scenario"]["horizon"] == 0.4
    assert report["policy"]["control_period"] == 0.02
    assert report["policy"]["details"]["training"]["steps"] == 256
    both = json.loads(
        succeed("compare", "linear", run, "--episodes", 3, "--set", "horizon=0.4", "--json")
    )
    assert [policy["control_period"] for policy in both["policies"]] == [0.002, 0.02]
    learned = both["policies"][1]["metrics"]["tip_error_rms"]
    assert learned == report["policy"]["metrics"]["tip_error_rms"]


def test_evaluating_a_run_needs_no_checkpoint_and_no_torch(run: Path) -> None:
    for path in (run / "checkpoints").iterdir():
        path.unlink()
    program = """
import sys

class Without:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("torch", "stable_baselines3"):
            raise ModuleNotFoundError(f"No module named {name!r}")

sys.meta_path.insert(0, Without())
from drm_baselines.cli import app
app(sys.argv[1:])
"""

    def without_torch(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False
        )

    done = without_torch("evaluate", "--policy", str(run), "--episodes", "2")
    assert done.returncode == 0, done.stderr
    refused = without_torch("train", "--out", str(run / "next"))
    assert refused.returncode == 2
    assert "extra 'learn'" in " ".join(refused.stderr.split())


def test_run_directories_that_are_none_are_refused(tmp_path: Path, run: Path) -> None:
    missing = tmp_path / "missing"
    assert "no run directory" in refuse("train", "--resume", "--out", missing)
    assert "neither one of" in refuse("evaluate", "--policy", missing)
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "holds no run.json" in refuse("train", "--resume", "--out", empty)
    assert "holds no policy.json" in refuse("evaluate", "--policy", empty)
    assert "not empty" in refuse("train", "--out", run)
    assert "--seed cannot be given" in refuse("train", "--resume", "--out", run, "--seed", 3)
    assert "larger --steps" in refuse("train", "--resume", "--out", run)


def test_a_policy_is_not_flown_on_another_observation(run: Path) -> None:
    description = json.loads((run / "policy.json").read_text())
    description["observation_layout"].pop()
    (run / "policy.json").write_text(json.dumps(description))
    assert "not the one the policy was trained on" in refuse("evaluate", "--policy", run)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("50..500", (50.0, 500.0)),
        ("-0.15..0.15", (-0.15, 0.15)),
        ("1e-3..2.5e-3", (1e-3, 2.5e-3)),
        ("200", 200),
        ("null", None),
        ("true", True),
        ("min_energy", "min_energy"),
        ("[1, 2]", [1, 2]),
        ('{"log_uniform": [1, 10]}', {"log_uniform": [1, 10]}),
        ("1...2", "1...2"),
    ],
)
def test_option_values(text: str, value: Any) -> None:
    assert parse_value(text) == value


def test_option_given_twice_is_refused() -> None:
    with pytest.raises(BaselineError, match="twice"):
        parse_options(["a=1", "a=2"])


def test_demo_takes_the_next_free_directory(tmp_path: Path) -> None:
    base = tmp_path / "results"
    assert fresh_directory(base) == base
    base.mkdir()
    assert fresh_directory(base) == base
    (base / "x").touch()
    assert fresh_directory(base) == tmp_path / "results-2"


def _entry(value: float, low: float, high: float, verdict_: str) -> dict[str, Any]:
    estimate = {"value": value, "low": low, "high": high, "count": 100}
    chance = {"value": 0.4, "low": 0.3, "high": 0.5, "count": 100}
    return {"difference": estimate, "probability_of_improvement": chance, "verdict": verdict_}


def test_verdict_admits_a_loss() -> None:
    lines = verdict(
        {
            "tip_error_rms": _entry(0.004, 0.001, 0.006, "worse"),
            "residual_rms": _entry(-1e-4, -2e-4, -1e-5, "better"),
            "wheel_effort": _entry(1.0, 0.5, 1.5, "worse"),
        }
    )
    assert lines[0].startswith("The trained agent is worse")
    assert "+4.00 mm [+1.00, +6.00]" in lines[0]
    assert lines[1:] == ["Also better in residual vibration RMS.", "Worse in wheel effort."]


def test_verdict_names_who_was_compared() -> None:
    entry = {"tip_error_rms": _entry(-0.004, -0.006, -0.001, "better")}
    (line,) = verdict(entry, agent="imitation", reference="the linear law")
    assert line.startswith("Imitation beats the linear law: tip error RMS -4.00 mm")


PICTURES = ("comparison.png", "episode.png", "tip_error.png", "manoeuvre_mass_+15_percent.png")


def test_settings_of_a_training_that_the_demo_does_not_do_are_refused(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    for option in ("--steps", "--seed", "--n-envs"):
        result = drm("demo", "--out", out, option, 7)
        assert result.exit_code == 2
        assert f"{option} 7 is for the training: add --train" in result.stderr
    assert not out.exists()


@pytest.mark.slow
def test_demo_without_a_training(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    text = succeed("demo", "--out", out, "--episodes", 8)
    assert "beats the linear law" in text
    assert str(out / "comparison.html") in text
    report = json.loads((out / "comparison.json").read_text())
    assert [policy["label"] for policy in report["policies"]] == [
        "open loop", "linear law", "Lyapunov law", "servo with modal damping",
        "PPO, residual, seed 0", "imitation and gradient, residual, seed 0",
    ]  # fmt: skip
    assert report["paired"]["reference"] == "linear law"
    for name in PICTURES:
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    page = (out / "comparison.html").read_text(encoding="utf-8")
    assert all(policy["label"] in page for policy in report["policies"])
    assert not list(out.glob("ppo*"))


@pytest.mark.slow
def test_demo_from_end_to_end(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    out = tmp_path / "demo"
    text = succeed("demo", "--train", "--out", out, "--steps", 40_960, "--episodes", 8)
    assert "inner law + PPO" in text
    assert "agent" in text
    report = json.loads((out / "comparison.json").read_text())
    assert [policy["label"] for policy in report["policies"]] == [
        "open loop", "linear law", "Lyapunov law", "servo with modal damping",
        "inner law alone (linear)", "inner law + PPO",
    ]  # fmt: skip
    assert report["verdict"]
    metrics = {policy["label"]: policy["metrics"] for policy in report["policies"]}
    linear, inner = metrics["linear law"], metrics["inner law alone (linear)"]
    # The law inside the environment, below a zero action, is the law that the engine flies.
    assert linear["tip_error_rms"]["value"] == pytest.approx(
        inner["tip_error_rms"]["value"], rel=1e-9
    )
    for name in ("learning_curve.png", *PICTURES):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    assert "inner law + PPO" in (out / "comparison.html").read_text(encoding="utf-8")
