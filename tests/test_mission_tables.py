"""Legs whose slew is a table of times and accelerations."""

from __future__ import annotations

import json
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import drm_env
from mission_doors import flown_at_every_door

Array = NDArray[np.float64]
PERIOD = 0.002
TABLE: dict[str, Any] = {
    "profile": "table",
    "times": [0.5, 1.5, 3.5, 4.5],
    "accelerations": [0.0, 0.06, -0.06, 0.0],
}
"""Through 0.12 rad: 0.06 rad/s in a second of ramp and a second of fall, and the same back."""
ANGLE = 0.12
BACK: dict[str, Any] = {
    "profile": "table",
    "times": [0.0, 1.0, 1.0, 3.0, 3.0, 4.0],
    "accelerations": [0.1, 0.1, -0.1, -0.1, 0.1, 0.1],
}
"""There and back: 0.1 rad out and in, with accelerations that jump."""


def leg(table: dict[str, Any] = TABLE, **others: Any) -> dict[str, Any]:
    return {"kind": "slew", **table, **others}


def mission(legs: list[dict[str, Any]], **parts: Any) -> dict[str, Any]:
    replan = parts.pop("replan", False)
    scenario = {
        "plant": "thesis",
        "modes": (2, 2),
        "mass_error": 0.15,
        "payload": {"mass": 300.0},
        "deployment": {"start": 2.0},
        **parts,
    }
    return {"scenario": scenario, "mission": {"legs": legs, "replan": replan}}


def integrated(times: list[float], accelerations: list[float], at: Array) -> tuple[Array, Array]:
    """Rate and angle of straight lines between accelerations, by their exact integrals."""
    rate, angle = np.zeros_like(at), np.zeros_like(at)
    for (t0, a0), (t1, a1) in pairwise(zip(times, accelerations, strict=True)):
        if t1 == t0:
            continue
        slope = (a1 - a0) / (t1 - t0)
        u = np.clip(at - t0, 0.0, t1 - t0)
        after = np.maximum(at - t1, 0.0)
        gained = a0 * u + slope * u**2 / 2.0
        angle += a0 * u**2 / 2.0 + slope * u**3 / 6.0 + gained * after
        rate += gained
    return rate, angle


def test_a_leg_is_what_a_scenario_with_the_table_is() -> None:
    """To the bit, with a deployment that coincides with the slew; the arm holds nothing."""
    empty = {"payload": {"mass": 0.0, "length": 0.0, "width": 0.0}, "mass_error": 0.0}
    one = {"deployment": {"start": 2.0, "end": 4.0}, "slew": TABLE, "horizon": 6.0, **empty}
    alone = drm_env.simulate(one, "linear")
    flight = drm_env.simulate(mission([leg(extension=4.0, duration=6.0)]), "linear")
    for name, values in alone.items():
        assert flight[name].tobytes() == values.tobytes(), name
    assert flight["reference_angle"][-1] == pytest.approx(ANGLE, abs=1e-15)


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_legs_go_on_from_the_angle_of_the_table(plant: str) -> None:
    legs = [
        leg(),
        {"kind": "grapple"},
        leg(BACK, extension=3.0, duration=5.0),
        {"kind": "slew", "angle": -0.2, "max_accel": 0.2},
        {"kind": "release"},
        leg(TABLE, angle=ANGLE),
        {"kind": "hold"},
    ]
    flight = drm_env.simulate(mission(legs, plant=plant), "linear")
    assert [each.angle for each in flight.legs] == pytest.approx(
        [0.0, ANGLE, ANGLE, ANGLE - 0.2, 2.0 * ANGLE - 0.2]
    )
    # the table's own end, to whole periods of 0.1 s; what is asked for where that is longer
    assert [each.metrics["duration"] for each in flight.legs[:2]] == pytest.approx([4.5, 5.0])
    assert flight.metrics["peak_slew_angle"] > 0.2
    for each, table in ((flight.legs[0], TABLE), (flight.legs[1], BACK), (flight.legs[3], TABLE)):
        begin = round(each.start / PERIOD)
        count = round(each.metrics["duration"] / PERIOD)
        rows = slice(begin, begin + count)
        own = PERIOD * np.arange(count)
        rate, angle = integrated(table["times"], table["accelerations"], own)
        np.testing.assert_allclose(flight["reference_angle"][rows] - each.angle, angle, atol=1e-13)
        np.testing.assert_allclose(flight["reference_rate"][rows], rate, atol=1e-13)
    # out and in with the length: it coincides with the table
    begin = round(flight.legs[1].start / PERIOD)
    assert flight["extension"][begin + 1000] == pytest.approx(2.5, abs=1e-12)
    assert flight["extension"][begin + 2000] == pytest.approx(3.0, abs=1e-12)


def test_a_table_of_the_fastest_profile_is_that_profile() -> None:
    """Bang-bang through 0.3 rad at 0.05 rad/s^2 takes 2 sqrt(0.3 / 0.05) s."""
    tf = 2.0 * np.sqrt(0.3 / 0.05)
    table = {
        "profile": "table",
        "times": [0.0, tf / 2.0, tf / 2.0, tf],
        "accelerations": [0.05, 0.05, -0.05, -0.05],
    }
    fast = {"kind": "slew", "angle": 0.3, "max_accel": 0.05, "profile": "min_time"}
    found, expected = (
        drm_env.simulate(mission([first, {"kind": "hold"}]), "linear")
        for first in (leg(table), fast)
    )
    for name, values in expected.items():
        scale = np.abs(values).max()
        # torques on either side of the jump may fall on either sample
        if name not in ("reference_accel", "slew_torque", "motor_power"):
            np.testing.assert_allclose(found[name], values, atol=1e-9 * scale, err_msg=name)


@st.composite
def tables(draw: st.DrawFn) -> tuple[list[float], list[float]]:
    """Times and accelerations from rest to rest, with gaps and jumps."""
    count = draw(st.integers(2, 6))
    gaps = st.floats(0.05, 0.6)
    times = [draw(st.sampled_from([0.0, 0.3]))]
    accelerations = [draw(st.floats(-0.2, 0.2))]
    for _ in range(count):
        jumps = draw(st.booleans()) and len(times) > 1 and times[-1] != times[-2]
        times.append(times[-1] + (0.0 if jumps else draw(gaps)))
        accelerations.append(draw(st.floats(-0.2, 0.2)))
    # two more straight lines that take away what rate is left: a triangle over a second
    end = times[-1]
    left = integrated(times, accelerations, np.array([end]))[0][0] + 0.25 * accelerations[-1]
    times += [end + 0.5, end + 1.0, end + 1.5]
    accelerations += [0.0, -2.0 * left, 0.0]
    return times, accelerations


@given(table=tables())
@settings(max_examples=25, deadline=None)
def test_any_table_is_flown_as_it_is(table: tuple[list[float], list[float]]) -> None:
    """The reference is its exact integral, and the next leg begins where it has ended."""
    times, accelerations = table
    own = {"profile": "table", "times": times, "accelerations": accelerations}
    after = {"kind": "slew", "angle": 0.05, "max_accel": 0.5}
    content = mission([leg(own), after], sample_period=0.01, integrator_step=0.001)
    flight = drm_env.simulate(content)
    first, second = flight.legs
    assert second.start == pytest.approx(np.ceil(10.0 * times[-1] - 1e-6) / 10.0)
    rows = round(second.start / 0.01)
    rate, angle = integrated(times, accelerations, 0.01 * np.arange(rows))
    np.testing.assert_allclose(flight["reference_angle"][:rows], angle, atol=1e-12)
    # what is left of the rate at the table's end is rounding, and is taken for rest
    np.testing.assert_allclose(flight["reference_rate"][:rows], rate, atol=1e-12)
    end = integrated(times, accelerations, np.array([times[-1]]))[1][0]
    assert second.angle == pytest.approx(end, abs=1e-12)
    assert flight["reference_angle"][-1] == pytest.approx(end + 0.05, abs=1e-12)
    assert first.metrics["duration"] == pytest.approx(second.start)


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_every_door_flies_the_same_bits(plant: str) -> None:
    legs = [
        leg(),
        {"kind": "grapple"},
        leg(BACK, extension=3.0),
        {"kind": "release"},
        {"kind": "wait_for_rest", "most": 0.5},
    ]
    hardware = {"root_wheel": {"lag": 0.01}, "sensors": {"angle_noise": 1e-5}, "horizon": 12.0}
    missions = [
        mission(legs, plant=plant, payload={"mass": mass}, replan=True, **hardware)
        for mass in (100.0, 180.0, 260.0)
    ]
    for env, _ in flown_at_every_door(missions):
        # what an environment states of its mission is that mission again
        scenario = env.scenario()
        told = drm_env.simulate(scenario, "servo")
        assert repr(told.legs) == repr(drm_env.simulate(scenario, "servo").legs)
        assert [each.angle for each in told.legs] == [each.angle for each in env.legs]


def test_snapshots_within_a_table() -> None:
    content = mission([leg(), {"kind": "grapple"}, leg(BACK)], horizon=12.0)
    config = {**content, "task": {"control_period": 0.1}}
    env, other = (drm_env.DrmEnv(task="slew_thesis", config=config) for _ in range(2))
    env.reset(seed=0)
    other.reset(seed=1)
    done, step = False, 0
    while not done:
        action = np.array([np.sin(step), np.cos(step)], dtype=np.float32)
        if step % 9 == 4:
            other.set_state(env.get_state())
        seen, reward, done, _, info = env.step(action)
        if step > 3:
            again = other.step(action)
            assert again[0].tobytes() == seen.tobytes()
            assert (again[1], repr(again[4])) == (reward, repr(info))
        step += 1
    assert step == 85  # of 0.1 s: 4.5 s and 4 s


def test_a_table_does_not_follow_the_mass() -> None:
    """Planned anew, the motor gives what the identified mass needs for the same slew."""
    legs = [{"kind": "grapple"}, leg(), {"kind": "hold"}, leg(), {"kind": "hold"}]
    blind, seeing = (drm_env.simulate(mission(legs, replan=replan)) for replan in (False, True))
    np.testing.assert_array_equal(blind["reference_angle"], seeing["reference_angle"])
    assert blind.legs[2].planned_mass == pytest.approx(345.0)
    assert seeing.legs[2].planned_mass == pytest.approx(300.0, rel=0.02)
    missed = [
        abs(flight["slew_angle"][-1] - flight["slew_angle"][round(flight.legs[2].start / PERIOD)]
            - ANGLE)
        for flight in (blind, seeing)
    ]  # fmt: skip
    assert missed[1] < 0.25 * missed[0]


def test_a_shaper_shapes_a_table_too() -> None:
    """It ends later by half a period of the lowest mode, at the same angle, and at rest."""
    shaped = {"slew": {"shaper": {"kind": "zv", "frequency": 8.0}}}
    flight = drm_env.simulate(mission([leg(), {"kind": "hold"}], **shaped))
    assert flight.legs[0].metrics["slew_end_time"] == pytest.approx(4.5 + np.pi / 8.0)
    assert flight.legs[1].angle == pytest.approx(ANGLE, abs=1e-12)


def test_hold_and_wait_stand_still_where_the_scenario_has_a_table() -> None:
    """A table of the scenario is that of no leg; a leg's own needs no profile then."""
    own = {key: value for key, value in TABLE.items() if key != "profile"}
    legs = [{"kind": "hold"}, {"kind": "wait_for_rest", "most": 2.0}, leg(own), {"kind": "hold"}]
    flight = drm_env.simulate(mission(legs, slew=BACK))
    before = round(flight.legs[2].start / PERIOD)
    assert (flight["reference_angle"][: before + 1] == 0.0).all()
    assert flight["reference_angle"][-1] == pytest.approx(ANGLE, abs=1e-15)
    other = {"kind": "slew", "profile": "min_time", "angle": 0.1, "max_accel": 0.1}
    assert drm_env.simulate(mission([other], slew=BACK))["reference_angle"][-1] == 0.1


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"angle": 0.2}, r"angle must be left out or the 0\.1[12]\d* rad .* got 0\.2"),
        ({"angle": 0.0}, r"angle must be left out .* got 0"),
        ({"smoothing": 0.1}, r"smoothing must be 0 for a table, got 0\.1"),
        ({"max_accel": 0.1}, r"max_accel must be null: a table .* got 0\.1"),
        ({"times": [0.5, 1.5, 3.5]}, r"accelerations must have 3 entries.* got 4"),
        ({"times": []}, r"times must have at least 2 entries for a table, got 0"),
        ({"times": [0.5, 0.4, 3.5, 4.5]}, r"times\[1\] must not be before .* got 0\.4"),
        ({"times": [-0.5, 1.5, 3.5, 4.5]}, r"times\[0\] .* got -0\.5"),
        ({"accelerations": [0.0, 0.06, -0.05, 0.0]}, "accelerations must bring the arm to rest"),
        ({"accelerations": [0.0, 1e30, -0.06, 0.0]}, r"accelerations\[1\]"),
        ({"times": [0.1] * 65}, r"times.* at most 64"),
        ({"times": "soon"}, "times"),
        ({"duration": 4.0}, r"duration must be at least the 4\.5 s .* got 4"),
        ({"base": "locked"}, "profile must not be a table: the brakes hold the shoulder"),
        ({"profile": "min_time"}, r"times must be empty: only the profile \"table\" has any"),
        ({"profile": None}, r"times must be empty"),
    ],
)
def test_impossible_tables_are_named(changed: dict[str, Any], message: str) -> None:
    """With the path of the leg's entry, before anything is flown."""
    legs = [{"kind": "hold"}, leg({**TABLE, **changed})]
    with pytest.raises(drm_env.ConfigError, match=r"mission\.legs\[1\]\." + message):
        drm_env.simulate(mission(legs))


def test_a_scenarios_table_is_that_of_no_leg() -> None:
    legs = [{"kind": "slew", "extension": 3.0}]
    with pytest.raises(drm_env.ConfigError, match=r"mission\.legs\[0\]\.profile must be given"):
        drm_env.simulate(mission(legs, slew=TABLE))


def test_toml_json_and_dictionaries_say_the_same(tmp_path: Path) -> None:
    """In a file of an environment as well."""
    content = mission([leg(), {"kind": "hold"}], horizon=6.0)
    expected = drm_env.simulate(content, "linear")
    text = """
        [scenario]
        plant = "thesis"
        modes = [2, 2]
        mass_error = 0.15
        payload = { mass = 300.0 }
        deployment = { start = 2.0 }
        horizon = 6.0

        [[mission.legs]]
        kind = "slew"
        profile = "table"
        times = [0.5, 1.5, 3.5, 4.5]
        accelerations = [0.0, 0.06, -0.06, 0.0]

        [[mission.legs]]
        kind = "hold"
        """
    toml, as_json = tmp_path / "mission.toml", tmp_path / "mission.json"
    toml.write_text(text, encoding="utf-8")
    as_json.write_text(json.dumps(content), encoding="utf-8")
    for read in (tomllib.loads(text), json.loads(json.dumps(content))):
        flight = drm_env.simulate(read, "linear")
        assert flight["slew_angle"].tobytes() == expected["slew_angle"].tobytes()
    for file in (toml, as_json):
        env = drm_env.DrmEnv(task="slew_thesis", config=file)
        env.reset(seed=0)
        stated = env.scenario()
        assert stated["mission"]["legs"][0]["times"] == TABLE["times"]
        assert stated["mission"]["legs"][0]["angle"] is None
        flight = drm_env.simulate(stated, "linear")
        assert flight.legs[1].angle == expected.legs[1].angle
