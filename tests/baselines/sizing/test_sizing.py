"""Sizes by order statistics, and ``drm size``."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.policies.pilots import law_data
from drm_baselines.sizing import Missions, check, corners, fewest_missions, fly_needs, requirements
from typed_command import TypedCommand

_command = TypedCommand("size")
succeed, refuse = _command.succeed, _command.refuse


# --- statistics -----------------------------------------------------------------------------------


def test_a_size_is_the_order_statistic_of_the_binomial() -> None:
    """The smallest k with P(Binomial(n, p) < k) >= confidence, of distinct values."""
    values = np.random.default_rng(3).permutation(np.arange(1.0, 601.0))
    (found,) = requirements({"motor_torque": values}, 0.99, 0.95)
    k = next(k for k in range(601) if stats.binom.cdf(k - 1, 600, 0.99) >= 0.95)
    assert found.size == float(k)
    assert found.low <= found.quantile <= found.high
    assert found.quantile == 594.0 and found.largest == 600.0


def test_sizes_cover_as_often_as_they_say() -> None:
    rng = np.random.default_rng(5)
    true = float(stats.expon.ppf(0.95))
    draws = rng.exponential(size=(400, 200))
    covered = [requirements({"motor_torque": row}, 0.95, 0.9)[0].size >= true for row in draws]
    # at least the confidence; 400 trials have a deviation of 1.5 %
    assert np.mean(covered) > 0.9 - 0.045


def test_fewest_missions_are_those_of_the_largest_of_all() -> None:
    assert fewest_missions(0.99, 0.95) == 299  # 0.99^299 = 0.0495
    with pytest.raises(BaselineError, match="at least 299"):
        requirements({"motor_torque": np.arange(298.0)}, 0.99, 0.95)
    (found,) = requirements({"motor_torque": np.arange(299.0)}, 0.99, 0.95)
    assert found.size == 298.0


# --- missions -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("payload", "by_hand"), [(200.0, 573.0), (500.0, 1110.0)])
def test_momentum_figures_by_hand(payload: float, by_hand: float) -> None:
    """docs/thesis.md, section 3.3: a mass reported 15 % too large, the linear law."""
    found = corners(Missions(payload=payload), law_data("linear"), 0)
    (above,) = (each for each in found if each.mass_error > 0.0)
    assert above.root_momentum == pytest.approx(by_hand, rel=1e-3)
    # torque limits let the wheel take up less, never more
    assert above.root_momentum < above.by_hand * 1.01


def test_needs_are_those_of_the_flight() -> None:
    missions = Missions(payload=200.0).draw(4, 2)
    needs = fly_needs(missions, law_data("linear"))
    for index, mission in enumerate(missions):
        flight = drm_env.simulate(mission, law="linear")
        for name, signal in (("root_wheel_momentum", "root_momentum"),
                             ("motor_torque", "slew_torque"),
                             ("tip_wheel_torque", "tip_torque")):  # fmt: skip
            assert needs[name][index] == pytest.approx(np.abs(flight[signal]).max(), rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("payload", [200.0, 500.0])
def test_a_sized_wheel_flies_99_percent_of_fresh_missions(payload: float) -> None:
    law, missions = law_data("linear"), Missions(payload=payload)
    needs = fly_needs(missions.draw(0, 1000), law)
    sizes = {each.name: each.size for each in requirements(needs, 0.99, 0.95)}
    for each in check(missions.draw(1000, 1000), law, sizes):
        if each.name.endswith("wheel_momentum"):
            assert each.part >= 0.99, each


def test_a_wheel_that_fills_up_was_too_small() -> None:
    law, missions = law_data("linear"), Missions(payload=200.0).draw(0, 20)
    needs = fly_needs(missions, law)
    sizes = {name: float(np.sort(values)[9]) for name, values in needs.items()}
    found = {each.name: each for each in check(missions, law, sizes)}
    # the tenth of twenty fills its wheel to the brim
    assert found["root_wheel_momentum"].within == 9
    assert found["motor_torque"].within == 10


def test_a_law_that_diverges_sizes_nothing() -> None:
    missions = Missions(payload=200.0, options={"horizon": 1.0}).draw(0, 2)
    for mission in missions:
        mission["initial"]["beta"] = 10.0
    with pytest.raises(BaselineError, match="2 of the first 2 missions diverge"):
        fly_needs(missions, law_data("none"))


# --- the command ----------------------------------------------------------------------------------

FEW = ("--missions", 60, "--fraction", 0.95)


def test_everything_that_is_written(tmp_path: Path) -> None:
    out = tmp_path / "size"
    line = ("--payload-class", 1, *FEW, "--check", 40, "--sweep", 10, "--out", out)
    text = succeed(*line)
    assert "573" in text and "fresh missions" in text and "smaller wheels" in text
    assert {file.name for file in out.iterdir()} == {
        "size.json", "missions.csv", "sweep.csv", "needs.png", "sweep.png",
    }  # fmt: skip
    content = json.loads((out / "size.json").read_text())
    rows = list(csv.DictReader((out / "missions.csv").open()))
    sizes = {row["name"]: row for row in content["requirements"]}
    momenta = [float(row["root_wheel_momentum"]) for row in rows]
    assert len(momenta) == 60 and max(momenta) == sizes["root_wheel_momentum"]["largest"]
    assert all(abs(float(row["mass_error"])) <= 0.15 for row in rows)
    assert {each["missions"] for each in content["check"]} == {40}
    # with a tenth of the momentum the arm is led astray
    swept = [row for row in content["sweep"] if row["name"] == "root_wheel_momentum"]
    assert swept[0]["factor"] == 0.1 and swept[0]["final_error"] > 10 * swept[-1]["final_error"]
    assert str(out) in refuse(*line)


def test_missions_and_arm_are_what_is_set() -> None:
    content = json.loads(
        succeed("--payload-mass", "100..300", "--set", "slew_angle=0.5..1.0",
                "--set", "link1_bending_stiffness=4e6", "--law", "servo", "--json",
                "--missions", 14, "--fraction", 0.8)
    )  # fmt: skip
    assert content["payload_mass"] == [100.0, 300.0]
    assert content["law"]["name"] == "servo"
    assert [row["payload"] for row in content["corners"]] == [100.0, 100.0, 300.0, 300.0]
    assert all(math.isfinite(row["size"]) for row in content["requirements"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "give either --payload-class or --payload-mass"),
        (("--payload-class", 1, "--payload-mass", 200), "give either"),
        (("--payload-class", 4), "--payload-class must be 0 to 3"),
        (("--payload-mass", "heavy"), "--payload-mass takes a mass"),
        (("--payload-mass", -1), "payload"),
        (("--payload-class", 1, "--mass-error", 2), "--mass-error must be"),
        (("--payload-class", 1, "--set", "mass_error=0.1"), "not by --set"),
        (("--payload-class", 1, "--set", "slew_angel=1"), "slew_angel"),
        (("--payload-class", 1, "--missions", 200), "--missions must be at least 299"),
        (("--payload-class", 1, "--fraction", 1), "--fraction must be between"),
        (("--payload-class", 1, "--law", "magic"), "magic"),
    ],
)
def test_bad_requests_are_refused(arguments: tuple[str | float, ...], words: str) -> None:
    assert words in refuse(*arguments)
