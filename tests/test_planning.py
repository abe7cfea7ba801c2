"""Manoeuvres planned within limits: closed forms of the rigid arm, and what is flown."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_env.planning import SHAPES
from drm_env.slew_limits import LIMITED
from oracle import slew_profiles

SHORT: dict[str, Any] = {"watch": 1.0}
"""Little is flown after the slew where only the slew is judged."""

# the thesis' arm and Payload 1, from its data: kg, m
LINK1, LINK2, LENGTH1, LENGTH2 = 100.0, 75.0, 7.0, 8.0
MASS, LENGTH, WIDTH = 200.0, 1.0, 0.5


def inertia(extension: float, mass: float = MASS) -> float:
    """Moment of inertia of the rigid arm about the shoulder, kg m^2."""
    reach = LENGTH1 + extension
    link1 = LINK1 * LENGTH1**2 / 3.0
    link2 = LINK2 * (LENGTH2**2 / 12.0 + (reach - LENGTH2 / 2.0) ** 2)
    payload = mass * ((LENGTH**2 + WIDTH**2) / 12.0 + (reach + LENGTH / 2.0) ** 2)
    return link1 + link2 + payload


def fixed(extension: float = 8.0, angle: float = 0.8, **rest: Any) -> dict[str, Any]:
    """A manoeuvre at a fixed length."""
    return {
        "slew": {"angle": angle},
        "deployment": {"mode": "none", "start": extension},
        "payload": {"mass": MASS, "length": LENGTH, "width": WIDTH},
        **rest,
    }


# --- profiles -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("profile", "smoothing"), SHAPES)
def test_profiles_are_those_that_are_flown(profile: str, smoothing: float) -> None:
    angle, accel = -1.1, 0.05
    final_time = drm_env.slew_final_time(angle, accel, profile, smoothing)
    flown = drm_env.simulate(
        {
            "slew": {
                "angle": angle, "max_accel": accel, "profile": profile, "smoothing": smoothing,
            },
            "horizon": 12.0,
        }
    )  # fmt: skip
    assert final_time == pytest.approx(flown.metrics["slew_end_time"], rel=1e-12)
    again = drm_env.slew_acceleration(angle, final_time, profile, smoothing)
    assert again == pytest.approx(accel, rel=1e-12)
    slewing = flown["time"] < final_time
    motion = drm_env.slew_motion(flown["time"][slewing] / final_time, profile, smoothing)
    for name, values, power in (
        ("reference_angle", motion.angle, 0),
        ("reference_rate", motion.rate, 1),
        ("reference_accel", motion.acceleration, 2),
    ):
        expected = flown[name][slewing]
        np.testing.assert_allclose(angle * values / final_time**power, expected, atol=1e-13)


@pytest.mark.parametrize(("profile", "smoothing"), SHAPES)
def test_profiles_are_the_integrals_of_their_accelerations(profile: str, smoothing: float) -> None:
    u = np.linspace(0.0, 0.999, 700)
    found = drm_env.slew_motion(u, profile, smoothing)
    np.testing.assert_allclose(found, slew_profiles.motion(profile, smoothing, u), atol=1e-12)
    assert drm_env.slew_motion(1.0, profile, smoothing) == (0.0, 0.0, 1.0)


def test_final_times_of_the_thesis() -> None:
    """Section 3.2: t_f^2 = 4 angle / accel, and 6 angle / accel for least energy."""
    assert drm_env.slew_final_time(1.0, 0.04) == pytest.approx(10.0)
    assert drm_env.slew_final_time(1.0, 0.06, "min_energy") == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: drm_env.slew_final_time(1.0, 0.0), "max_accel must be"),
        (lambda: drm_env.slew_final_time(math.nan, 1.0), "angle"),
        (lambda: drm_env.slew_acceleration(1.0, -1.0), "final_time must be"),
        (
            lambda: drm_env.slew_final_time(1.0, 1.0, "sinus"),
            "unknown variant `sinus`, expected one of",
        ),
        (lambda: drm_env.slew_final_time(1.0, 1.0, "min_time", 0.25), "smoothing must be at least"),
        (lambda: drm_env.slew_motion(1.5), "u must be from 0 to 1"),
    ],
)
def test_impossible_profiles_are_refused(call: Any, words: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=words):
        call()


# --- kinematics -----------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [-3.0, -0.4, 0.0, 1.2, 3.1])
@pytest.mark.parametrize("extension", [1.0, 2.5, 8.0])
def test_the_arm_stands_where_its_tip_is(angle: float, extension: float) -> None:
    x, y = drm_env.tip_position(angle, extension)
    assert math.hypot(x, y) == pytest.approx(7.0 + extension)
    found = drm_env.inverse_kinematics(x, y)
    assert found == pytest.approx((angle, extension), abs=1e-12)
    # the edges are part of the workspace, and the engine takes what comes out
    drm_env.Model().natural_frequencies(found.extension)


def test_points_outside_the_workspace_say_by_how_much() -> None:
    with pytest.raises(drm_env.InfeasibleError, match=r"2 m beyond the outer edge") as beyond:
        drm_env.inverse_kinematics(0.0, 17.0)
    assert (beyond.value.limit, beyond.value.needed) == ("workspace edge", 17.0)
    with pytest.raises(drm_env.InfeasibleError, match=r"goal .*3 m inside the hole") as inside:
        drm_env.inverse_kinematics(3.0, 4.0, name="goal")
    assert (inside.value.limit, inside.value.allowed) == ("workspace hole", 8.0)
    kept = pickle.loads(pickle.dumps(inside.value))  # noqa: S301
    assert (kept.limit, kept.needed, str(kept)) == ("workspace hole", 5.0, str(inside.value))
    with pytest.raises(drm_env.ConfigError, match="y must be finite"):
        drm_env.inverse_kinematics(3.0, math.nan)


def test_the_ring_is_that_of_the_arm() -> None:
    links = drm_env.resolve().to_dict()["scenario"]["arm"]
    links["link1"]["length"], links["link2"]["length"] = 5.0, 4.0
    assert drm_env.workspace(links) == (5.0, 9.0)
    with pytest.raises(drm_env.InfeasibleError):
        drm_env.inverse_kinematics(5.0, 0.0, links)  # an extension of 0
    assert drm_env.inverse_kinematics(9.0, 0.0, links).extension == pytest.approx(4.0)
    with pytest.raises(drm_env.ConfigError, match=r"arm\.link1\.length"):
        drm_env.workspace({"link1": {}})


# --- what the rigid arm needs ---------------------------------------------------------------------


def test_demands_at_a_fixed_length() -> None:
    time, angle = 10.0, 0.8
    needs = drm_env.slew_demands(fixed(angle=angle), final_time=time, mass_error=0.1)
    accel, rate = 4.0 * angle / time**2, 2.0 * angle / time
    assert needs["acceleration"] == pytest.approx(accel)
    assert needs["motor_rate"] == pytest.approx(rate)
    assert needs["motor_torque"] == pytest.approx(inertia(8.0, 1.1 * MASS) * accel)
    wrong = inertia(8.0, 1.1 * MASS) - inertia(8.0)
    assert needs["root_wheel_torque"] == pytest.approx(wrong * accel)
    assert needs["root_wheel_momentum"] == pytest.approx(wrong * rate)
    # the pull alone: (Mp (R + Lp/2) + m2 (R - L2/2)) theta'^2
    pull = (MASS * 15.5 + LINK2 * 11.0) * rate**2
    assert needs["deployment_force"] == pytest.approx(pull)


def test_demands_of_a_deployment_alone() -> None:
    job = fixed(angle=0.0, deployment={"start": 2.0, "end": 7.0})
    needs = drm_env.slew_demands(job, final_time=8.0)
    assert needs["deployment_force"] == pytest.approx((MASS + LINK2) * 4.0 * 5.0 / 8.0**2)
    assert needs["motor_torque"] == needs["motor_rate"] == 0.0


@pytest.mark.parametrize(("profile", "smoothing"), [("min_time", 0.0), ("min_energy", 0.1)])
def test_demands_while_the_arm_deploys_are_those_of_the_flight(
    profile: str, smoothing: float
) -> None:
    scenario = {"slew": {"angle": 0.8}, "deployment": {"start": 7.0, "end": 2.0}}
    needs = drm_env.slew_demands(scenario, final_time=9.0, profile=profile, smoothing=smoothing)
    accel = drm_env.slew_acceleration(0.8, 9.0, profile, smoothing)
    scenario["slew"] |= {"max_accel": accel, "profile": profile, "smoothing": smoothing}
    flown = drm_env.simulate(scenario)
    # samples are 2 ms apart and miss the corners
    assert np.abs(flown["slew_torque"]).max() == pytest.approx(needs["motor_torque"], rel=2e-3)
    assert np.abs(flown["reference_rate"]).max() == pytest.approx(needs["motor_rate"], rel=1e-3)


@pytest.mark.parametrize(("mass", "by_hand"), [(200.0, 573.0)])
def test_momentum_by_hand_of_a_wrong_mass(mass: float, by_hand: float) -> None:
    """What the root wheel takes up where its torque suffices (docs/thesis.md)."""
    time = drm_env.slew_final_time(math.radians(50.0), 0.02)
    needs = drm_env.slew_demands({"payload": {"mass": mass}}, final_time=time, mass_error=0.15)
    assert needs["root_wheel_momentum"] == pytest.approx(by_hand, rel=3e-3)


# --- plans ----------------------------------------------------------------------------------------


def test_where_only_the_acceleration_limits_a_plan_is_the_closed_form() -> None:
    plan = drm_env.plan_slew(fixed(angle=1.0), limits={"acceleration": 0.04}, **SHORT)
    assert (plan.best.profile, plan.best.smoothing) == ("min_time", 0.0)
    assert plan.best.final_time == pytest.approx(10.0, rel=1e-12)  # sqrt(4 angle / accel)
    assert plan.best.max_accel == pytest.approx(0.04, rel=1e-12)


@pytest.mark.parametrize(
    ("limits", "time"),
    [
        # S = I theta'', theta'' = 4 angle / t_f^2
        ({"motor_torque": 600.0}, math.sqrt(4.0 * 0.8 * inertia(8.0) / 600.0)),
        ({"motor_torque": 600.0, "motor_rate": 9.9}, math.sqrt(4.0 * 0.8 * inertia(8.0) / 600.0)),
    ],
)
def test_the_shortest_time_of_a_motor(limits: dict[str, float], time: float) -> None:
    plan = drm_env.plan_slew(fixed(), limits=limits, shapes=[("min_time", 0.0)], **SHORT)
    assert plan.best.final_time == pytest.approx(time, rel=2e-3)
    assert plan.best.final_time >= time
    assert plan.best.worst is not None and plan.best.worst[0] == "motor_torque"


def test_the_shortest_deployment_alone() -> None:
    job = fixed(angle=0.0, deployment={"start": 2.0, "end": 7.0})
    plan = drm_env.plan_slew(job, limits={"deployment_force": 100.0}, **SHORT)
    # 2 sqrt(distance mass / force), as the thesis' force-limited deployment
    assert plan.best.final_time == pytest.approx(2.0 * math.sqrt(5.0 * 275.0 / 100.0), rel=2e-3)
    flown = drm_env.simulate(plan.scenario)
    assert flown["extension"][-1] == pytest.approx(7.0)


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_a_plan_keeps_its_limits_when_it_is_flown(plant: str) -> None:
    limits = {"motor_torque": 1500.0, "motor_rate": 0.4, "deflection": 0.03}
    plan = drm_env.plan_slew(
        {"plant": plant}, start=(8.0, 1.0), goal=(6.0, 9.0), limits=limits,
        shapes=[("min_time", 0.1), ("min_energy", 0.1)], **SHORT,
    )  # fmt: skip
    flown = drm_env.simulate(plan.scenario)
    assert np.abs(flown["slew_torque"]).max() <= 1500.0
    assert np.abs(flown["slew_rate"]).max() <= 0.4
    assert np.abs(flown["tip_deflection"]).max() <= 0.03
    # nor is it much slower than it has to be
    assert plan.best.worst is not None and plan.best.worst[1] > 0.95
    path = plan.tip_path(flown)
    np.testing.assert_allclose(path[0], [8.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(path[-1], [6.0, 9.0], atol=0.03)


def test_limits_hold_for_every_error_of_the_mass() -> None:
    limits = {"root_wheel_momentum": 300.0, "acceleration": 0.02}
    plan = drm_env.plan_slew(
        limits=limits, mass_error=0.15, law="linear", shapes=[("min_time", 0.05)]
    )
    assert plan.scenario["root_wheel"]["momentum_limit"] == 300.0
    flown = {
        error: np.abs(
            drm_env.simulate({**plan.scenario, "mass_error": error}, law="linear")["root_momentum"]
        ).max()
        for error in (-0.15, 0.0, 0.1, 0.15)
    }
    assert max(flown.values()) < 300.0
    # nor is it slower than it has to be
    assert plan.best.worst is not None and plan.best.worst[0] == "root_wheel_momentum"
    assert max(flown.values()) > 0.99 * 300.0
    needs = drm_env.slew_demands(final_time=plan.best.final_time, smoothing=0.05, mass_error=0.15)
    assert needs["root_wheel_momentum"] == pytest.approx(flown[0.15], rel=0.02)


def test_objectives() -> None:
    job: dict[str, Any] = {
        "scenario": {"payload": {"mass": 500.0}},
        "limits": {"motor_torque": 2500.0, "final_time": 25.0},
        "shapes": [("min_time", 0.0), ("min_time", 0.1), ("min_energy", 0.0), ("min_energy", 0.2)],
        "times": 4,
    }
    plans = {name: drm_env.plan_slew(objective=name, **job)
             for name in ("fastest", "cheapest", "calmest")}  # fmt: skip
    assert all(plan.best.feasible for plan in plans.values())
    for name, value in (("fastest", "final_time"), ("cheapest", "energy"),
                        ("calmest", "vibration")):  # fmt: skip
        least = min(plan.best.value(value) for plan in plans.values())
        assert plans[name].best.value(value) == pytest.approx(least, rel=1e-9)
    # the thesis: least energy is a ramp, and takes all the time that there is
    cheap = plans["cheapest"].best
    assert cheap.profile == "min_energy" and cheap.final_time == pytest.approx(25.0)
    assert plans["calmest"].best.smoothing > 0.0
    rows = plans["calmest"].to_dict()["candidates"]
    assert {row["profile"] for row in rows} == {"min_time", "min_energy"}


def test_a_final_time_is_kept() -> None:
    plan = drm_env.plan_slew(final_time=17.0, limits={"motor_torque": 1200.0}, **SHORT)
    assert plan.best.final_time == 17.0
    assert drm_env.simulate(plan.scenario).metrics["slew_end_time"] == pytest.approx(17.0)
    free = drm_env.plan_slew(final_time=17.0, objective="cheapest", **SHORT)
    assert free.best.profile == "min_energy"


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        ("deflection", 0.02),
        ("residual", 0.002),
        ("root_shear", 60.0),
        ("link2_bending_moment", 300.0),
        ("link2_shear", 50.0),
    ],
)
def test_every_limit_is_enough_alone(name: str, limit: float) -> None:
    """It is kept when it is flown, and the manoeuvre is not slower than it has to be."""
    shape = ("min_time", 0.1)
    plan = drm_env.plan_slew(fixed(), limits={name: limit}, shapes=[shape], watch=3.0)
    assert plan.best.feasible
    assert plan.best.worst is not None and plan.best.worst[0] == name
    # the residual of a smoothed slew has zeros between which it may fall
    assert plan.best.values[name] <= limit
    assert name == "residual" or plan.best.values[name] > 0.9 * limit
    scale = {"loads": True} if "deflection" not in name and name != "residual" else {}
    flown = drm_env.simulate(plan.scenario, **scale).metrics
    metric = {
        "deflection": "peak_deflection",
        "residual": "residual_peak",
        "root_shear": "root_shear_link1_peak",
        "link2_bending_moment": "root_bending_moment_link2_peak",
        "link2_shear": "root_shear_link2_peak",
    }[name]
    assert flown[metric] <= limit * (1.0 + 1e-9)


def test_a_shear_alone_states_the_time_of_statics() -> None:
    """With a soft start the arm bends as under the steady acceleration: shear = moment of mass."""
    reach = LENGTH1 + 8.0
    moment = LINK1 * LENGTH1 / 2.0 + LINK2 * (reach - LENGTH2 / 2.0) + MASS * (reach + LENGTH / 2.0)
    plan = drm_env.plan_slew(
        fixed(), limits={"root_shear": 60.0}, shapes=[("min_time", 0.1)], watch=1.0
    )
    time = drm_env.slew_final_time(0.8, 60.0 / moment, "min_time", 0.1)
    assert plan.best.final_time == pytest.approx(time, rel=0.02)


def test_what_no_profile_can_do_names_the_limit() -> None:
    needed = 4.0 * 0.8 * inertia(8.0) / 5.0**2  # the least of all shapes is bang-bang
    with pytest.raises(drm_env.InfeasibleError, match=r"limits\.motor_torque: in 5 s") as torque:
        drm_env.plan_slew(fixed(), final_time=5.0, limits={"motor_torque": 600.0}, **SHORT)
    assert torque.value.limit == "motor_torque" and torque.value.allowed == 600.0
    assert torque.value.needed == pytest.approx(needed, rel=1e-6)
    assert f"{needed - 600.0:,.4g} N m" in str(torque.value)
    shortest = math.sqrt(4.0 * 0.8 * inertia(8.0) / 600.0)
    with pytest.raises(drm_env.InfeasibleError, match=r"motor_torque .600 N m. takes") as slow:
        drm_env.plan_slew(
            fixed(), limits={"motor_torque": 600.0, "final_time": 0.9 * shortest}, **SHORT
        )
    assert slow.value.limit == "final_time"
    assert slow.value.needed == pytest.approx(shortest, rel=2e-3)
    with pytest.raises(drm_env.InfeasibleError, match=r"2 s more than limits\.final_time"):
        drm_env.plan_slew(fixed(), final_time=9.0, limits={"final_time": 7.0})
    with pytest.raises(drm_env.InfeasibleError, match="longer than an hour"):
        drm_env.plan_slew(fixed(), limits={"motor_torque": 1e-3})
    with pytest.raises(drm_env.InfeasibleError, match=r"goal .* beyond the outer edge"):
        drm_env.plan_slew(start=(9.0, 0.0), goal=(9.0, 19.0), limits={"motor_torque": 500.0})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"limits": {"torque": 1.0}}, r"limits\.torque is unknown"),
        ({"limits": {"motor_torque": -1.0}}, r"limits\.motor_torque must be a positive"),
        ({"limits": [1.0]}, "limits must be a mapping"),
        ({"limits": {}}, "limits bound no slew"),
        ({"limits": {"tip_wheel_momentum": 9.0}, "shapes": [("min_time", 0.1)], "watch": 0.5},
         "needs none of them"),
        ({"objective": "prettiest"}, "objective must be one of"),
        ({"final_time": math.nan}, "final_time must be"),
        ({"mass_error": 1.5}, "mass_error must be at least 0"),
        ({"scenario": {"mass_error": 0.1}}, "give the largest error"),
        ({"scenario": {"payload": {"mass": -1.0}}}, "mass"),
        ({"scenario": "fast"}, "scenario must be a mapping"),
        ({"start": (9.0, 0.0)}, "both start and goal"),
        ({"start": (9.0,), "goal": (9.0, 1.0)}, "start must be a point"),
        ({"start": (9.0, 0.0), "goal": (9.0, 0.0)}, "nothing to plan"),
        ({"shapes": []}, "shapes must not be empty"),
        ({"shapes": [("min_time", 0.5)]}, "smoothing must be"),
        ({"patience": 0.5}, "patience must be"),
        ({"times": 0}, "times must be"),
        ({"watch": 0.0}, "watch must be"),
        ({"law": "magic"}, "law"),
    ],
)  # fmt: skip
def test_bad_requests_are_refused(arguments: dict[str, Any], words: str) -> None:
    usual: dict[str, Any] = {"limits": {"acceleration": 0.02}}
    with pytest.raises(drm_env.ConfigError, match=words):
        drm_env.plan_slew(**{**usual, **arguments})


def test_what_is_given_is_not_changed() -> None:
    scenario = fixed()
    before = copy.deepcopy(scenario)
    drm_env.plan_slew(scenario, limits={"acceleration": 0.05}, shapes=[("min_time", 0.1)], **SHORT)
    assert scenario == before


def test_every_limit_says_what_it_is() -> None:
    assert all(entry.unit and entry.power in (1, 2) for entry in LIMITED.values())
    assert set(LIMITED) | {"final_time"} == set(drm_env.SlewLimits.__dataclass_fields__)
