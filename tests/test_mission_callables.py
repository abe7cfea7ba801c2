"""Missions under a law that is a Python callable: legs, payloads and ends as under a law."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import drm_env
from mission_doors import PLANTS, turn

Array = NDArray[np.float64]
COLUMNS = drm_env.ControlLaw.MEASUREMENTS


LEGS: list[dict[str, Any]] = [
    turn(0.3, 3.0),
    {"kind": "wait_for_rest", "most": 1.0},
    {"kind": "grapple"},
    turn(-0.5, 2.0),
    {"kind": "hold", "duration": 0.5},
    {"kind": "release"},
    turn(0.2),
    {"kind": "desaturate", "most": 0.5},
    {"kind": "hold", "duration": 0.3, "base": "locked"},
    {"kind": "hold", "duration": 0.1},
]
"""Payloads come and go while the arm vibrates; wheels are run down, and brakes close."""
TIMED = [0, 1, 3, 4, 6, 7, 8, 9]


def mission(plant: str = "thesis", legs: Any = None, **parts: Any) -> dict[str, Any]:
    replan = parts.pop("replan", False)
    scenario = {
        "plant": plant,
        "modes": (2, 2),
        "mass_error": 0.15,
        "payload": {"mass": 300.0},
        "deployment": {"start": 2.0},
        **parts,
    }
    return {
        "scenario": scenario,
        "mission": {"legs": LEGS if legs is None else legs, "replan": replan},
    }


HARDWARE = {
    "root_wheel": {"lag": 0.01, "dead_time": 0.006},
    "sensors": {"angle_noise": 1e-5, "delay": 0.004},
}


class Same:
    """The engine's linear law by `ControlLaw`, called from Python."""

    def __init__(self, n: int) -> None:
        self.law = drm_env.ControlLaw("linear", control_period=0.002)
        self.state, self.start = self.law.initial_state(n), np.ones(n, bool)

    def __call__(self, seen: Array) -> Array:
        torques, self.state = self.law.torques(seen, self.state, self.start)
        return torques


def assert_same(found: drm_env.Trajectory, expected: drm_env.Trajectory) -> None:
    assert list(found) == list(expected)
    for name, values in expected.items():
        assert found[name].tobytes() == values.tobytes(), name
    assert repr(found.metrics) == repr(expected.metrics)
    assert repr(found.legs) == repr(expected.legs)


@pytest.mark.parametrize("replan", [False, True])
@pytest.mark.parametrize("plant", PLANTS)
def test_the_engines_law_called_from_python_has_the_engines_bits(plant: str, replan: bool) -> None:
    """Alone and side by side, with real hardware and loads, also where the law is not heard."""
    missions = [
        mission(plant, replan=replan, payload={"mass": mass}, **HARDWARE)
        for mass in (120.0, 250.0, 400.0)
    ]
    engine = drm_env.simulate(missions[0], "linear", decimation=10, seed=7, loads=True)
    assert [leg.leg for leg in engine.legs] == TIMED
    python = drm_env.simulate(missions[0], Same(1), decimation=10, seed=7, loads=True)
    assert_same(python, engine)
    given: dict[str, Any] = {"signals": list(engine), "decimation": 10, "loads": True, "seed": 7}
    many = drm_env.rollout(missions, "linear", **given)
    asked = drm_env.rollout(missions, Same(3), **given)
    assert repr(asked.legs) == repr(many.legs)
    for index in range(3):
        assert_same(asked.trajectory(index), many.trajectory(index))
    assert_same(asked.trajectory(0), engine)


@pytest.mark.parametrize("law", ["lyapunov", "servo"])
def test_recorded_torques_fly_the_same_mission(law: str) -> None:
    """Whatever law it was, and whatever it remembers: ideal wheels give what is asked for."""
    content = mission(legs=LEGS[:7])
    engine = drm_env.simulate(content, law)
    torques = np.stack([engine["root_torque"], engine["tip_torque"]], axis=1)
    row = iter(torques)
    python = drm_env.simulate(content, lambda _: next(row)[None])
    for name, values in engine.items():
        np.testing.assert_array_equal(python[name], values, err_msg=name)
    assert [(leg.kind, leg.start) for leg in python.legs] == [
        (leg.kind, leg.start) for leg in engine.legs
    ]


@pytest.mark.parametrize("hold", [1, 7, 50, 60])
def test_a_law_is_asked_from_the_missions_beginning_on(hold: int) -> None:
    """At its own period, which need not be that of the legs; given torques do the same."""
    content = mission(**HARDWARE)
    answers: list[Array] = []

    def law(seen: Array) -> Array:
        answers.append(np.array([[30.0 * np.sin(len(answers)), np.cos(2.0 * len(answers))]]))
        return answers[-1]

    python = drm_env.simulate(content, law, law_period=hold * 0.002, decimation=10)
    names = [name for name in python if name in drm_env.simulate({"horizon": 0.1})]
    given = drm_env.rollout(
        [content],
        torques=np.stack(answers, axis=1),
        hold=hold,
        signals=names,
        decimation=10,
    )
    assert_same(python, given.trajectory(0))
    samples = round(python.metrics["duration"] / 0.002)
    assert len(answers) == -(-samples // hold)


def test_what_is_told_is_of_the_leg_under_way() -> None:
    """The payload as it is reported there, errors and references from the leg's beginning."""
    rows: list[Array] = []

    def law(seen: Array) -> Array:
        rows.append(seen[0].copy())
        return np.zeros((1, 2))

    payload = {"mass": 80.0, "length": 0.6, "width": 0.3}
    legs = [
        turn(0.1),
        {"kind": "grapple"},
        turn(-0.1),
        {"kind": "release"},
        {"kind": "grapple", "payload": payload, "reported": {"mass": 90.0}},
        turn(0.1),
        {"kind": "release"},
        {"kind": "hold", "duration": 0.2},
    ]
    flight = drm_env.simulate(mission(legs=legs), law)
    seen = {name: np.array(rows)[:, i] for i, name in enumerate(COLUMNS)}
    np.testing.assert_array_equal(seen["extension"], flight["extension"][:-1])
    np.testing.assert_array_equal(seen["reference_rate"], flight["reference_rate"][:-1])
    error = (flight["slew_angle"] - flight["reference_angle"])[:-1]
    np.testing.assert_allclose(seen["slew_error"], error, atol=1e-12)
    starts = pairwise([*(round(leg.start / 0.002) for leg in flight.legs), len(rows)])
    reported = [(0.0, 0.0, 0.0), None, (90.0, 0.6, 0.3), (0.0, 0.0, 0.0)]
    for leg, (begin, end), told in zip(flight.legs, starts, reported, strict=True):
        assert (seen["payload_mass"][begin:end] == leg.planned_mass).all()
        for name, value in zip(("mass", "length", "width"), told or (345.0,), strict=False):
            np.testing.assert_allclose(seen[f"payload_{name}"][begin:end], value, rtol=1e-12)


def test_a_law_is_told_the_mass_that_a_leg_is_planned_for() -> None:
    told: list[float] = []

    def law(seen: Array) -> Array:
        told.append(seen[0, COLUMNS.index("payload_mass")])
        return np.zeros((1, 2))

    legs = [{"kind": "grapple"}, turn(0.5), {"kind": "hold"}, turn(-0.5), {"kind": "hold"}]
    flight = drm_env.simulate(mission(legs=legs, replan=True), law)
    assert told[0] == pytest.approx(345.0)
    assert told[-1] == flight.legs[-1].planned_mass == pytest.approx(300.0, rel=0.02)


def test_waiting_ends_early_and_rows_stay() -> None:
    """A mission that has ended keeps the row it was last told, as a manoeuvre does."""
    waiting = [{"kind": "wait_for_rest", "most": 20.0, "quiet": 0.5}, {"kind": "hold"}]
    contents = [
        mission(legs=waiting),
        mission(legs=waiting, initial={"beta": 1e-2}),
    ]
    seen: list[Array] = []
    same = Same(2)

    def law(told: Array) -> Array:
        seen.append(told.copy())
        return same(told)

    flown = drm_env.rollout(contents, law, signals=["time"])
    # at rest from the beginning on: the half second, and the hold
    assert flown["duration"][0] == pytest.approx(1.5)
    assert 1.5 < flown["duration"][1] < 21.0
    assert len(seen) == round(flown["duration"].max() / 0.002)
    np.testing.assert_array_equal(seen[749][0], seen[-1][0])
    assert (seen[748][1] != seen[-1][1]).any()
    assert [len(flown.trajectory(i)["time"]) for i in (0, 1)] == [751, len(seen) + 1]


def test_a_mission_that_diverges_ends_in_its_leg() -> None:
    """The other one flies on."""
    first = COLUMNS.index("payload_mass")

    def law(seen: Array) -> Array:
        push = np.where((seen[:, first] > 0.0) & (np.arange(len(seen)) == 0), 1e5, 0.0)
        return np.stack([push, 0.0 * push], axis=1)

    wheels = {"root_wheel": {"torque_limit": 1e6, "momentum_limit": None}}
    legs = [turn(0.1), {"kind": "grapple"}, turn(0.1, duration=5.0), {"kind": "hold"}]
    flown = drm_env.rollout([mission(legs=legs, **wheels)] * 2, law)
    assert flown["diverged"].tolist() == [1.0, 0.0]
    lost, whole = flown.legs
    assert lost[-1].metrics["diverged"] == 1.0 and not lost[0].metrics["diverged"]
    assert len(lost) < len(whole) == 3
    assert flown["duration"][0] < flown["duration"][1]
    np.testing.assert_equal(lost[0], whole[0])


def test_what_cannot_be_flown_is_refused_before_the_law_is_asked() -> None:
    def law(seen: Array) -> Array:
        pytest.fail("it has been asked")

    cases: list[tuple[list[Any], dict[str, Any], str]] = [
        ([mission(legs=[{"kind": "release"}])], {}, r"scenarios\[0\]\.mission\.legs\[0\]\.kind"),
        ([mission(), {}], {}, "cannot be flown in one rollout"),
        ([mission(horizon=3.0)], {}, "horizon must be at least"),
        ([mission()], {"signals": ["time"], "decimation": 7}, "decimation must divide"),
        ([mission()], {"law_period": 0.003}, "law_period must be a multiple"),
    ]
    for contents, options, message in cases:
        with pytest.raises(drm_env.ConfigError, match=message):
            drm_env.rollout(contents, law, **options)


def test_torques_that_are_none_are_named() -> None:
    late = iter([0.0] * 400 + [np.inf])
    with pytest.raises(drm_env.ConfigError, match=r"root torque of scenarios\[0\] must be finite"):
        drm_env.simulate(mission(), lambda _: np.array([[next(late), 0.0]]))


def test_an_environments_mission_flies_too() -> None:
    """A held configuration stands for the mission in it, and progress is told."""
    content = mission(horizon=30.0)
    resolved = drm_env.resolve("slew_thesis", config=content, payload_mass=300.0, mass_error=0.15)
    told: list[tuple[int, int]] = []
    flown = drm_env.rollout([resolved] * 2, Same(2), progress=lambda *x: told.append(x))
    expected = drm_env.rollout([resolved] * 2, "linear")
    assert repr(dict(flown)) == repr(dict(expected)) and repr(flown.legs) == repr(expected.legs)
    assert told == [(2, 2)]
