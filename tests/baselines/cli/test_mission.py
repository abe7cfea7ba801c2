"""``drm mission``: legs as a table and JSON, the picture, and what planning anew is worth."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import drm_env
from drm_baselines.cli import app
from drm_baselines.evaluation.missions import tip_path

SHORT = """
[scenario]
mass_error = 0.15
payload = { mass = 300.0 }
deployment = { start = 2.0 }
slew = { max_accel = 0.2, smoothing = 0.1 }

[mission]
legs = [
    { kind = "slew", angle = 0.3, extension = 3.0 },
    { kind = "grapple" },
    { kind = "slew", angle = -0.5 },
    { kind = "hold", duration = 0.5 },
    { kind = "slew", angle = -0.3 },
    { kind = "release" },
    { kind = "hold", duration = 0.2 },
]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "short.toml"
    path.write_text(SHORT, encoding="utf-8")
    return path


def drm_mission(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["mission", *(str(argument) for argument in arguments)])


def test_results_are_those_of_simulate(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = drm_mission(file, "--law", "linear", "--law", "none", "--out", out, "--json")
    assert result.exit_code == 0, result.output + result.stderr
    report = json.loads(result.stdout)
    flight = drm_env.simulate(report["mission"], "linear")
    found = report["metrics"]["linear"]
    assert {name: value for name, value in found.items() if value is not None} == {
        name: value for name, value in flight.metrics.items() if not math.isnan(value)
    }
    assert [row["kind"] for row in report["legs"]["none"]] == [
        "slew",
        "slew",
        "hold",
        "slew",
        "hold",
    ]
    header, *rows = (out / "linear.csv").read_text(encoding="utf-8").splitlines()
    assert header.startswith("time,slew_angle")
    assert float(rows[-1].split(",")[0]) == pytest.approx(flight["time"][-1])
    assert (out / "mission.png").read_bytes().startswith(b"\x89PNG")
    assert (out / "mission.json").exists()


def test_a_table_for_each_law(file: Path) -> None:
    result = drm_mission(file, "--law", "linear")
    assert result.exit_code == 0, result.output + result.stderr
    for word in ("slew", "hold", "345.0"):
        assert word in result.stdout


def test_planning_anew_is_compared(file: Path) -> None:
    result = drm_mission(file, "--replan", "--law", "none", "--json")
    assert result.exit_code == 0, result.output + result.stderr
    rows = json.loads(result.stdout)["replanning"]["none"]
    assert [(row["mass error (%)"], row["planned for"]) for row in rows] == [
        (error, planned) for error in (-15.0, 0.0, 15.0) for planned in ("reported", "identified")
    ]
    for blind, seeing in zip(rows[::2], rows[1::2], strict=True):
        assert seeing["last planned mass (kg)"] == pytest.approx(300.0, rel=0.03)
        if blind["mass error (%)"]:
            assert seeing["tip error rms (mm)"] < blind["tip error rms (mm)"]


def test_the_tip_is_where_the_arm_points() -> None:
    quarter = {
        "extension": np.array([3.0, 3.0]),
        "slew_angle": np.array([0.0, np.pi / 2.0]),
        "tip_deflection": np.array([0.1, 0.1]),
    }
    x, y = tip_path(quarter, 5.0)
    np.testing.assert_allclose(x, [8.0, -0.1], atol=1e-12)
    np.testing.assert_allclose(y, [0.1, 8.0], atol=1e-12)


def test_what_is_no_mission_is_refused(tmp_path: Path, file: Path) -> None:
    path = tmp_path / "none.toml"
    path.write_text("[scenario]\nmass_error = 0.1\n", encoding="utf-8")
    result = drm_mission(path)
    assert result.exit_code == 2
    assert "no mission" in result.stderr


@pytest.mark.parametrize("name", ["receding", "lqg", "bound"])
def test_who_plans_a_single_manoeuvre_ahead_is_refused(file: Path, name: str) -> None:
    result = drm_mission(file, "--law", name)
    assert result.exit_code == 2
    assert f"{name} is made for single manoeuvres" in " ".join(result.stderr.split())
