"""Metrics are described where users look, and the descriptions are true."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import drm_env
from drm_baselines.cli import app
from drm_baselines.evaluation.metrics import METRICS
from drm_env import _engine

REACH = 7.0
"""Length of link 1, m: the reach is it and the extension."""


def test_every_metric_of_the_engine_is_described() -> None:
    entries = drm_env.episode_metrics()
    assert [entry.name for entry in entries] == list(_engine.metric_names())
    assert all(all(entry) for entry in entries)


def test_tables_convert_from_the_units_that_are_described() -> None:
    units = {entry.name: entry.unit for entry in drm_env.episode_metrics()}
    factors = {
        ("m", "mm"): 1e3, ("rad", "deg"): 180.0 / math.pi, ("1", "%"): 100.0,
        ("s", "s"): 1.0, ("J", "J"): 1.0, ("1", ""): 1.0,
    }  # fmt: skip
    for name, metric in METRICS.items():
        assert metric.scale == factors[units[name], metric.unit], name


@pytest.mark.parametrize(
    ("scenario", "law"),
    [
        ({"mass_error": 0.15}, "linear"),
        ({"mass_error": -0.1, "slew": {"angle": -0.5}}, "lyapunov"),
        ({"mass_error": 0.15, "horizon": 5.0}, "none"),
        ({"payload": {"mass": 400.0}, "mass_error": 0.15, "horizon": 40.0}, "none"),
        ({}, "linear"),
    ],
)
def test_the_formulas_give_the_engines_numbers(scenario: dict[str, object], law: str) -> None:
    """The formulas that are described, written down once more on the signals of a flight."""
    flight = drm_env.simulate(scenario, law)
    found = flight.metrics
    now = {name: values[1:] for name, values in flight.items()}
    dt = flight["time"][1] - flight["time"][0]
    e = now["slew_angle"] - now["reference_angle"]
    y, r = now["tip_deflection"], REACH + now["extension"]
    sign = np.sign(now["reference_angle"][-1])
    end = found["slew_end_time"]
    s = now["time"] >= end - 1e-9
    expected = {
        "tip_error_rms": np.sqrt(np.mean((r * e + y) ** 2)),
        "peak_deflection": np.abs(flight["tip_deflection"]).max(),
        "peak_slew_angle": (sign * flight["slew_angle"]).max(),
        "final_slew_error": e[-1],
        "wheel_effort": dt
        * np.sum((now["root_torque"] / 100.0) ** 2 + (now["tip_torque"] / 10.0) ** 2),
        "slew_energy": dt * np.sum(flight["motor_power"][:-1]),
        "duration": y.size * dt,
        "diverged": 0.0,
        "episode_return": 0.0,
    }
    if s.any():
        settled = (np.abs(y) <= 1e-3) & (np.abs(r * e) <= 1e-2)
        unsettled = np.flatnonzero(s & ~settled)
        expected["residual_rms"] = np.sqrt(np.mean(y[s] ** 2))
        expected["residual_peak"] = np.abs(y[s]).max()
        expected["settled"] = float(settled[-1])
        final = sign * now["reference_angle"][-1]
        expected["overshoot"] = max(0.0, expected["peak_slew_angle"] - final)
        expected["settling_time"] = math.nan
        if settled[-1]:
            last = unsettled[-1] + 1 if unsettled.size else None
            expected["settling_time"] = 0.0 if last is None else now["time"][last] - end
    else:
        expected |= dict.fromkeys(("residual_rms", "residual_peak", "settling_time"), math.nan)
        expected["settled"] = 0.0
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-6, abs=1e-12, nan_ok=True), name


def test_the_page_says_what_the_package_says() -> None:
    text = (Path(__file__).parents[3] / "docs" / "metrics.md").read_text(encoding="utf-8")
    rows = [
        [cell.strip().replace("\\|", "|") for cell in line.replace("\\|", "\0").split("|")[1:-1]]
        for line in text.splitlines()
        if line.startswith("| ")
    ]
    rows = [[cell.replace("\0", "|") for cell in row] for row in rows]
    found = [row for row in rows if len(row) == 4][1:]
    assert found == [[f"`{name}`", *rest] for name, *rest in drm_env.episode_metrics()]
    symbols = [row for row in rows if len(row) == 2][1:]
    assert symbols == [list(item) for item in drm_env.METRIC_SYMBOLS.items()]


def test_the_command_lists_metrics_with_unit_and_formula() -> None:
    result = CliRunner().invoke(app, ["info", "--metrics"])
    assert result.exit_code == 0
    printed = "".join(result.stdout.split())
    for entry in drm_env.episode_metrics():
        assert entry.name in printed
        assert "".join(entry.formula.split())[:12] in printed
    content = json.loads(CliRunner().invoke(app, ["info", "--json"]).stdout)
    assert content["metrics"] == [entry._asdict() for entry in drm_env.episode_metrics()]


def test_the_command_lists_options_with_default_and_limits() -> None:
    result = CliRunner().invoke(app, ["info", "--json", "--set", "horizon=12"])
    options = json.loads(result.stdout)["options"]
    assert options.keys() == drm_env.option_names().keys()
    assert options["horizon"]["default"] == 12.0
    assert options["payload_mass"]["default"] == {"uniform": [50.0, 500.0]}
    assert options["control_period"]["default"] == 0.01
    assert options["plant"]["limits"] == ["thesis or consistent"]
    assert options["modes"]["limits"] == ["1 to 8 for each link"]
    assert options["axial_load"]["limits"] == ["true or false"]
    assert options["payload_mass"]["limits"] == ["finite and not negative"]
    assert options["link2_bending_stiffness"]["limits"] == ["positive and finite"]
    assert "positive and finite" in options["control_period"]["limits"]
    assert options["horizon"]["limits"] == ["at most 1e9 sample periods"]
    assert options["observation_history"]["limits"] == ["1 to 100"]
    for name, entry in options.items():
        # what the engine says to a value is said of this option, not of another one that it breaks
        assert not any("Runge-Kutta" in limit for limit in entry["limits"]), name
        assert {"unit", "default", "limits", "description", "randomizable"} <= entry.keys(), name
    printed = CliRunner().invoke(app, ["info", "--options"]).stdout
    assert all(name in printed for name in ("default", "must be", "payload_mass", "kg"))
    direct = json.loads(
        CliRunner().invoke(app, ["info", "--json", "--env", "drm_env/SlewThesis-v0"]).stdout
    )
    assert direct["options"]["control_period"]["default"] == 0.002
