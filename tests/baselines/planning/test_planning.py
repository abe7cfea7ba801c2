"""Trade curves, drawn cases, and ``drm plan``."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.planning import TRADED, draw_case, fly_cases, front
from drm_baselines.planning.free import free_profile
from typed_command import TypedCommand

PICTURES = ("loads.png", "path.png", "trades.png")


_command = TypedCommand("plan")
succeed, refuse = _command.succeed, _command.refuse


def candidate(**values: float) -> drm_env.SlewCandidate:
    usual = dict.fromkeys(TRADED, 0.0)
    time = values.pop("final_time", 1.0)
    return drm_env.SlewCandidate(
        profile="min_time", smoothing=0.0, final_time=time, max_accel=1.0,
        values={**usual, **values}, worst=None,
    )  # fmt: skip


def test_the_front_is_what_nothing_beats() -> None:
    fast = candidate(final_time=1.0, energy=9.0)
    cheap = candidate(final_time=2.0, energy=4.0)
    beaten = candidate(final_time=2.0, energy=5.0)
    calm = candidate(final_time=3.0, energy=9.5, vibration=-1.0)
    assert front([beaten, calm, cheap, fast]) == [fast, cheap, calm]
    assert front([]) == []


# --- drawn cases ----------------------------------------------------------------------------------


def judge(plant: str, count: int) -> dict[str, Any]:
    counts = fly_cases(range(count), plant).counts()
    assert counts["failed_seeds"] == []
    assert counts["within_limits"] == counts["planned"] > 0
    assert counts["largest_part_used"] <= 1.0 + 1e-9
    return counts


def test_drawn_plans_keep_their_limits() -> None:
    """Thirty of the thousand that ``drm plan --cases 1000`` draws."""
    counts = judge("thesis", 30)
    assert counts["refused"] > 0 and counts["acceleration_only"] > 0
    assert counts["slowest_over_closed_form"] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
def test_drawn_plans_of_the_flexible_arm_keep_their_limits() -> None:
    judge("consistent", 8)


def test_a_case_is_drawn_by_its_seed() -> None:
    assert draw_case(7, "thesis") == draw_case(7, "thesis")
    assert draw_case(7, "thesis") != draw_case(8, "thesis")


# --- the free profile -----------------------------------------------------------------------------


def test_a_free_profile_uses_the_motor_at_every_length() -> None:
    """Retracted the arm has a quarter of its inertia, and the same torque."""
    plan = drm_env.plan_slew(
        start=(8.0, 0.0), goal=(0.0, 14.0), limits={"motor_torque": 900.0},
        shapes=[("min_time", 0.0), ("min_time", 0.05)], watch=2.0,
    )  # fmt: skip
    found = free_profile(plan)
    assert found.final_time < 0.8 * plan.best.final_time
    flight = drm_env.simulate(found.scenario)
    torque = np.abs(flight["slew_torque"])
    assert torque.max() <= 900.0
    moving = flight["time"] < found.final_time
    # most of the way at the limit: what bang-bang torque is
    assert np.mean(torque[moving] > 0.98 * 900.0) > 0.85
    assert flight["slew_angle"][-1] == pytest.approx(math.pi / 2.0, abs=2e-3)
    assert flight["extension"][-1] == pytest.approx(7.0)


def test_a_free_profile_at_a_fixed_length_is_bang_bang() -> None:
    """Where the inertia stays, nothing beats the thesis' minimum time."""
    plan = drm_env.plan_slew(
        {"slew": {"angle": 1.0}, "deployment": {"mode": "none", "start": 8.0}},
        limits={"acceleration": 0.04}, shapes=[("min_time", 0.0)], watch=2.0,
    )  # fmt: skip
    found = free_profile(plan)
    assert plan.best.final_time == pytest.approx(10.0)
    # ramps over an interval of 1/48 at the ends and across zero cost two per cent
    assert 10.0 <= found.final_time < 10.4


def test_a_free_profile_keeps_the_limits_of_the_elastic_arm() -> None:
    limits = {"motor_torque": 1500.0, "deflection": 0.03, "deployment_force": 80.0}
    plan = drm_env.plan_slew(
        {"plant": "consistent"}, start=(8.0, 1.0), goal=(6.0, 9.0), limits=limits,
        shapes=[("min_time", 0.1)], watch=1.0,
    )  # fmt: skip
    found = free_profile(plan)
    flight = drm_env.simulate(found.scenario, loads=True)
    assert np.abs(flight["tip_deflection"]).max() <= 0.03
    assert flight.metrics["deployment_force_peak"] <= 80.0
    assert set(found.used) == set(limits)


def test_what_no_free_profile_can_do_is_refused() -> None:
    alone = drm_env.plan_slew(
        {"slew": {"angle": 0.0}}, limits={"deployment_force": 100.0}, watch=1.0
    )
    with pytest.raises(BaselineError, match="needs a slew"):
        free_profile(alone)
    plan = drm_env.plan_slew(limits={"deployment_force": 100.0}, watch=1.0,
                             shapes=[("min_time", 0.1)])  # fmt: skip
    with pytest.raises(BaselineError, match="needs a limit on acceleration"):
        free_profile(plan)


# --- the command ----------------------------------------------------------------------------------


def test_a_plan_with_everything_it_writes(tmp_path: Path) -> None:
    out = tmp_path / "plan"
    line = ("--from", 8, 0, "--to", 0, 14, "--limit", "motor_torque=900", "--mass-error", 0.1,
            "--limit", "root_wheel_momentum=600", "--law", "linear", "--free",
            "--out", out)  # fmt: skip
    text = succeed(*line)
    assert all(name in text for name in ("motor_torque", "limit", "wheel momentum", "fastest",
                                        "free profile of 49 knots"))  # fmt: skip
    assert {file.name for file in out.iterdir()} == {
        *PICTURES, "plan.json", "candidates.csv", "scenario.json", "flight.csv",
        "free_scenario.json",
    }  # fmt: skip
    content = json.loads((out / "plan.json").read_text())
    assert content["limits"] == {"motor_torque": 900.0, "root_wheel_momentum": 600.0}
    assert content["goal"]["angle"] == pytest.approx(math.pi / 2.0)
    rows = list(csv.DictReader((out / "candidates.csv").open()))
    assert len(rows) == len(content["candidates"])
    assert sum(row["best"] == "True" for row in rows) == 1
    # what is written is what drm simulate flies
    flight = drm_env.simulate(json.loads((out / "scenario.json").read_text()), law="linear")
    assert np.abs(flight["slew_torque"]).max() <= 900.0
    assert str(out) in refuse(*line)


def test_json_is_the_plan() -> None:
    arguments = ("--angle-deg", 40, "--extension", 2, 6, "--payload-mass", 350, "--json",
                 "--limit", "acceleration=0.02")  # fmt: skip
    content = json.loads(succeed(*arguments))
    expected = 2.0 * math.sqrt(math.radians(40.0) / 0.02)
    assert content["best"]["final_time"] == pytest.approx(expected, rel=1e-12)
    scenario = content["scenario"]
    assert (scenario["deployment"]["start"], scenario["deployment"]["end"]) == (2.0, 6.0)
    assert scenario["payload"]["mass"] == 350.0


def test_another_arm_has_another_workspace() -> None:
    goal = ("--from", 10, 0, "--to", 0, 18, "--limit", "acceleration=0.02", "--json")
    assert "beyond the outer edge of the workspace (15 m)" in refuse(*goal)
    content = json.loads(succeed(*goal, "--arm", "link1_length=9", "--arm", "link2_length=9"))
    assert content["goal"]["extension"] == pytest.approx(9.0)
    assert content["scenario"]["arm"]["link1"]["length"] == 9.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--limit", "motor_torque"), "--limit takes NAME=VALUE"),
        (("--limit", "motor_torque=big"), "--limit motor_torque must be a number"),
        (("--limit", "motor_torque=1", "--limit", "motor_torque=2"), "given twice"),
        (("--limit", "power=2"), "limits.power is unknown"),
        (("--from", 9, 0), "give both --from and --to"),
        (("--from", 9, 0, "--to", 0, 9, "--angle-deg", 5), "give either --from and --to, or"),
        (("--plant", "rigid"), "--plant must be one of"),
        (("--objective", "nicest"), "objective must be one of"),
        (("--arm", "link3_length=2"), "--arm takes KEY=VALUE"),
        (("--arm", "link1_length=long"), "must be a number"),
        (("--arm", "link1_length=-2"), "link1.length"),
        (("--law", "magic"), "magic"),
        (("--free",), "add one of them, such as --limit motor_torque=900"),
        (("--free", "--limit", "deflection=0.05"), "motor_rate, got deflection alone"),
        (("--from", 9, 0, "--to", 9, 17, "--limit", "acceleration=1"), "beyond the outer edge"),
        (("--limit", "motor_torque=400", "--final-time", 9), "more than the 400 N m allowed"),
        (("--limit", "motor_torque=400", "--limit", "final_time=9"), "motor_torque (400 N m)"),
    ],
)  # fmt: skip
def test_bad_requests_are_refused(arguments: tuple[str | float, ...], words: str) -> None:
    assert words in refuse(*arguments)


def test_cases_are_counted() -> None:
    content = json.loads(succeed("--cases", 2, "--plant", "thesis", "--json"))
    (row,) = content["plants"]
    assert row["cases"] == 2 and row["failed_seeds"] == []
