"""Legs in which wheels are run down, the shoulder is braked or the base turns.

What is expected are balances of angular momentum and energy, the frequencies of a clamped arm by
finite elements, and the same bits at every door.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from scipy.linalg import eigh

import drm_env
from mission_doors import flown_at_every_door

PLANTS = ("thesis", "consistent")
PERIOD = 0.002
QUARTER_SINE = {"times": [0.0, 1.0, 3.0, 4.0], "accelerations": [0.0, 0.02, -0.02, 0.0]}
"""A base that turns through 0.04 rad in four seconds, from rest to rest."""
TURN = 0.04
GENTLE = {"name": "linear", "root": {"angle_gain": 350.0, "rate_gain": 2300.0}}
"""A law that brings the retracted arm to rest, about critically damped with 0.3 rad/s."""


def mission(plant: str, legs: list[dict[str, Any]], **parts: Any) -> dict[str, Any]:
    scenario = {
        "plant": plant,
        "modes": (2, 2),
        "deployment": {"start": 2.0},
        "payload": {"mass": 300.0},
        **parts,
    }
    return {"scenario": scenario, "mission": {"legs": legs}}


def rows(flight: drm_env.Trajectory) -> list[int]:
    """Row of each leg's beginning, and the last one."""
    starts = [int(np.argmin(np.abs(flight["time"] - leg.start))) for leg in flight.legs]
    return [*starts, flight["time"].size - 1]


# --- momentum desaturation --------------------------------------------------------------------


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("hardware", [False, True])
def test_the_motor_takes_the_wheels_momentum_into_the_base(plant: str, hardware: bool) -> None:
    parts: dict[str, Any] = {"initial": {"slew_rate": 0.01}}
    if hardware:
        parts["root_wheel"] = {"lag": 0.02, "dead_time": 0.004}
        parts["tip_wheel"] = {"lag": 0.02}
        parts["sensors"] = {"delay": 0.004, "rate_noise": 1e-6}
        parts["dynamics"] = {"structural_damping": 5e-3}
    # the law brings the arm to rest: its momentum is in the wheels then
    legs = [
        {"kind": "wait_for_rest", "most": 60.0, "slew_error": 1e-3, "deflection": 1e-3},
        {"kind": "desaturate", "torque": 20.0, "momentum": 0.1},
        {"kind": "hold", "duration": 1.0},
    ]
    flight = drm_env.simulate(mission(plant, legs, **parts), GENTLE, loads=True)
    _, begin, end, _ = rows(flight)
    stored = flight["root_momentum"] + flight["tip_momentum"]
    assert abs(stored[begin]) > 30.0
    assert abs(flight["root_momentum"][end]) <= 0.1 and abs(flight["tip_momentum"][end]) <= 0.1
    # what arm and wheels lose together is the motor's impulse, and it is what the wheels had
    impulse = flight["slew_torque"][begin:end].sum() * PERIOD
    whole = flight["angular_momentum"][end] - flight["angular_momentum"][begin]
    assert whole == pytest.approx(impulse, rel=1e-4)
    assert stored[end] - stored[begin] == pytest.approx(impulse, rel=5e-3)
    # no torque beyond what was asked for, and the arm is where it was, to a tenth of a milliradian
    for name in ("root_torque", "tip_torque"):
        assert np.abs(flight[name][begin + 200 : end - 1]).max() <= 20.0
    angle = flight["slew_angle"][begin : end + 1]
    assert abs(angle[-1] - angle[0]) < 1e-4
    assert np.ptp(angle) < 2e-4
    assert not flight.metrics["diverged"]
    kinds = [leg.kind for leg in flight.legs]
    assert kinds == ["wait_for_rest", "desaturate", "hold"]
    # with 20 N m it takes what it must, and not the 60 s that it may
    needed = abs(stored[begin]) / 20.0
    assert needed < flight.legs[1].metrics["duration"] < needed + 8.0


def test_what_the_motor_holds_beyond_its_limit_is_told() -> None:
    legs = [
        {"kind": "wait_for_rest", "most": 60.0},
        {"kind": "desaturate", "most": 3.0, "momentum": 0.0, "torque": 20.0},
    ]
    flight = drm_env.simulate(
        mission("thesis", legs, initial={"slew_rate": 0.01}, slew_motor={"open_loop_limit": 5.0}),
        GENTLE,
        loads=True,
    )
    # all of the time, for nothing counts as empty
    assert flight.legs[1].metrics["duration"] == pytest.approx(3.0)
    begin = rows(flight)[1]
    excess = np.maximum(np.abs(flight["slew_torque"][begin:-1]) - 5.0, 0.0)
    assert excess.max() > 10.0
    np.testing.assert_allclose(flight["motor_excess"][begin:-1], excess, atol=1e-12)


def test_laws_do_not_count_what_has_gone_into_the_base() -> None:
    """A mass is identified after brakes have held an arm whose wheels were full."""
    legs = [
        {"kind": "wait_for_rest", "most": 40.0},
        {"kind": "grapple"},
        {"kind": "hold", "duration": 0.5, "base": {**QUARTER_SINE, "times": [0.0, 0.1, 0.3, 0.4]}},
        {"kind": "hold", "duration": 0.5, "base": "locked"},
        {"kind": "slew", "angle": 0.5, "smoothing": 0.1},
        {"kind": "hold", "duration": 1.0},
        {"kind": "slew", "angle": -0.5, "smoothing": 0.1},
    ]
    content = mission("thesis", legs, initial={"slew_rate": 0.01}, mass_error=0.15)
    content["mission"]["replan"] = True
    flight = drm_env.simulate(content, "linear")
    start = rows(flight)[3]
    assert abs(flight["root_momentum"][start] + flight["tip_momentum"][start]) > 10.0
    assert flight.legs[3].planned_mass == pytest.approx(345.0)
    assert flight.legs[-1].planned_mass == pytest.approx(300.0, rel=0.02)
    assert not flight.metrics["diverged"]


# --- brakes -----------------------------------------------------------------------------------


def clamped_frequencies(payload: tuple[float, float, float]) -> NDArray[np.float64]:
    """Natural frequencies of the clamped, fully extended arm, rad/s, by Hermite elements.

    The payload, mass (kg), length and width (m), is a rigid block behind the tip.
    """
    arm = drm_env.Scenario().arm
    elements = 40
    size = 4 * elements + 2
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    links = [link for link in (arm.link1, arm.link2) for _ in range(elements)]
    for index, link in enumerate(links):
        h = link.length / elements
        m = link.mass_per_length * h / 420.0
        k = link.bending_stiffness / h**3
        here = slice(2 * index, 2 * index + 4)
        mass[here, here] += m * np.array(
            [
                [156, 22 * h, 54, -13 * h],
                [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                [54, 13 * h, 156, -22 * h],
                [-13 * h, -3 * h * h, -22 * h, 4 * h * h],
            ]
        )
        stiffness[here, here] += k * np.array(
            [
                [12, 6 * h, -12, 6 * h],
                [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                [-12, -6 * h, 12, -6 * h],
                [6 * h, 2 * h * h, -6 * h, 4 * h * h],
            ]
        )
    block, length, width = payload
    lever = 0.5 * length
    inertia = block * (length**2 + width**2) / 12.0
    mass[-2:, -2:] += np.array(
        [[block, block * lever], [block * lever, block * lever**2 + inertia]]
    )
    # clamped: neither deflection nor slope at the shoulder
    return np.sqrt(eigh(stiffness[2:, 2:], mass[2:, 2:], eigvals_only=True))


def thesis_frequencies(payload: tuple[float, float, float]) -> NDArray[np.float64]:
    """Of the thesis' two elastic coordinates alone, rad/s."""
    names = ("mass", "length", "width")
    model = drm_env.Model(dict(zip(names, payload, strict=True)))
    matrices = model.matrices(8.0)
    return np.sqrt(eigh(matrices.K[1:, 1:], matrices.M[1:, 1:], eigvals_only=True))


def slowest(signal: NDArray[np.float64]) -> float:
    """Angular frequency of the strongest line of a signal, rad/s: a parabola through its peak."""
    weighed = signal * np.blackman(signal.size)
    spectrum = np.log(np.abs(np.fft.rfft(weighed, 8 * signal.size)))
    peak = int(np.argmax(spectrum))
    low, top, high = spectrum[peak - 1 : peak + 2]
    place = peak + 0.5 * (low - high) / (low - 2.0 * top + high)
    return float(2.0 * np.pi * place / (8 * signal.size * PERIOD))


@pytest.mark.parametrize("plant", PLANTS)
def test_a_braked_arm_is_a_clamped_beam(plant: str) -> None:
    block = (200.0, 1.0, 0.5)
    payload = dict(zip(("mass", "length", "width"), block, strict=True))
    legs = [
        {"kind": "grapple", "payload": payload},
        {"kind": "hold", "duration": 60.0, "base": "locked"},
    ]
    flight = drm_env.simulate(
        mission(
            plant, legs, modes=(4, 4), initial={"alpha": 1e-3, "beta": 2e-3},
            deployment={"start": 8.0}, dynamics={"spectral_radius": 1.0, "axial_load": False},
        )
    )  # fmt: skip
    assert (flight["slew_angle"] == 0.0).all() and (flight["slew_rate"] == 0.0).all()
    expected = (thesis_frequencies if plant == "thesis" else clamped_frequencies)(block)[0]
    assert slowest(flight["tip_deflection"]) == pytest.approx(expected, rel=1e-3)
    # the free arm is faster: its rotation goes along
    legs[1] = {"kind": "hold", "duration": 60.0}
    free = drm_env.simulate(
        mission(
            plant, legs, modes=(4, 4), initial={"alpha": 1e-3, "beta": 2e-3},
            deployment={"start": 8.0},
        )
    )  # fmt: skip
    assert slowest(free["tip_deflection"]) > 1.5 * expected


@pytest.mark.parametrize("plant", PLANTS)
def test_brakes_do_no_work_and_bear_the_momentum(plant: str) -> None:
    """A turning arm is braked, vibrates like a cantilever, and goes on free from there."""
    hold = {"kind": "hold", "duration": 2.0}
    legs = [hold, {**hold, "base": "locked"}, {**hold, "base": "locked"}, hold]
    flight = drm_env.simulate(
        mission(
            plant, legs, initial={"slew_rate": 0.01}, sample_period=5e-4, integrator_step=5e-4,
            dynamics={"spectral_radius": 1.0},
        ),
        loads=True,
    )  # fmt: skip
    _, closed, between, opened, last = rows(flight)
    energies = [leg.metrics["residual_energy"] for leg in flight.legs]
    # what the brakes took when they closed is stated, and then nothing more
    assert flight.legs[1].energy < 0.0 > flight.legs[1].momentum
    size = energies[0]
    assert energies[1] - energies[0] == pytest.approx(flight.legs[1].energy, abs=1e-4 * size)
    assert energies[2] == pytest.approx(energies[1], rel=1e-4)
    assert energies[3] == pytest.approx(energies[2], rel=1e-4)
    assert flight.legs[2].energy == flight.legs[3].energy == 0.0
    # nothing moves at the shoulder, and no deflection jumps
    held = slice(closed, opened)
    assert (flight["slew_rate"][held] == 0.0).all()
    assert np.ptp(flight["slew_angle"][held]) == 0.0
    assert np.abs(np.diff(flight["tip_deflection"])).max() < 1.0 * 5e-4
    # what the brakes bear changes the momentum, and after them nothing does
    momentum = flight["angular_momentum"]
    torque = flight["base_torque"][closed : opened + 1].copy()
    # once free the torque at the shoulder is none
    torque[-1] = 2.0 * torque[-2] - torque[-3]
    impulse = np.trapezoid(torque, dx=5e-4)
    size = np.trapezoid(np.abs(torque), dx=5e-4)
    assert momentum[opened] - momentum[closed] == pytest.approx(impulse, abs=2e-4 * size)
    before = momentum[closed - 1]
    assert momentum[closed] - before == pytest.approx(flight.legs[1].momentum, rel=1e-3)
    np.testing.assert_allclose(momentum[opened:last], momentum[opened], atol=1e-7 * size)
    # brakes need no power
    assert flight.legs[1].metrics["slew_energy"] == 0.0
    assert (flight["motor_power"][held] == 0.0).all()
    assert (flight["motor_torque"][held] == 0.0).all()
    assert between > closed


def test_wheels_are_run_down_into_brakes_too() -> None:
    legs = [
        {"kind": "wait_for_rest", "most": 40.0},
        {"kind": "desaturate", "base": "locked", "torque": 20.0},
    ]
    flight = drm_env.simulate(
        mission("consistent", legs, initial={"slew_rate": 0.01}), GENTLE, loads=True
    )
    _, begin, end = rows(flight)
    assert abs(flight["root_momentum"][end]) <= 1.0
    assert np.ptp(flight["slew_angle"][begin:]) == 0.0
    assert flight.legs[1].metrics["slew_energy"] == 0.0


def test_brakes_are_waited_on_for_the_vibration_alone() -> None:
    legs = [
        {"kind": "hold", "duration": 1.0},
        {"kind": "wait_for_rest", "most": 60.0, "base": "locked"},
    ]
    flight = drm_env.simulate(
        mission(
            "consistent", legs, initial={"slew_rate": 0.01, "beta": 1e-3},
            dynamics={"damping_ratio": 0.05},
        )
    )  # fmt: skip
    assert abs(flight["slew_angle"][-1]) > 5e-3
    assert flight.metrics["duration"] < 30.0
    assert np.abs(flight["tip_deflection"][-500:]).max() < 1.2e-3


def test_a_length_changes_behind_brakes() -> None:
    legs = [{"kind": "slew", "extension": 3.0, "base": "locked"}]
    flight = drm_env.simulate(mission("thesis", legs, initial={"beta": 1e-3}))
    assert flight["extension"][-1] == 3.0
    assert (flight["slew_angle"] == 0.0).all()
    assert np.abs(flight["tip_deflection"]).max() > 1e-3


# --- a base that turns ------------------------------------------------------------------------


def base_motion(time: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angle and rate of the base of `QUARTER_SINE`, rad and rad/s, integrated by hand."""
    fine = np.linspace(0.0, 4.0, 400_001)
    accel = np.interp(fine, QUARTER_SINE["times"], QUARTER_SINE["accelerations"])
    rate = np.concatenate(([0.0], np.cumsum(0.5 * (accel[1:] + accel[:-1]) * np.diff(fine))))
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(fine))))
    return np.interp(time, fine, angle), np.interp(time, fine, rate)


@pytest.mark.parametrize("plant", PLANTS)
def test_a_base_that_turns_carries_a_braked_arm(plant: str) -> None:
    legs = [
        {"kind": "hold", "duration": 5.0, "base": {**QUARTER_SINE, "locked": True}},
        {"kind": "hold", "duration": 0.5},
    ]
    flight = drm_env.simulate(
        mission(
            plant, legs, sample_period=5e-4, integrator_step=5e-4,
            dynamics={"spectral_radius": 1.0},
        ),
        loads=True,
    )  # fmt: skip
    _, free, last = rows(flight)
    assert (flight["slew_angle"][:free] == 0.0).all()
    time = flight["time"][:free]
    angle, rate = base_motion(time)
    # momentum and energy are what the base brings
    torque = flight["base_torque"][:free]
    impulse = np.concatenate(([0.0], np.cumsum(0.5 * (torque[1:] + torque[:-1]) * 5e-4)))
    size = np.abs(impulse).max()
    assert size > 1.0
    np.testing.assert_allclose(flight["angular_momentum"][:free], impulse, atol=2e-4 * size)
    work = np.trapezoid(torque * rate, dx=5e-4)
    moved = np.trapezoid(np.abs(torque * rate), dx=5e-4)
    assert flight.legs[0].metrics["residual_energy"] == pytest.approx(work, abs=2e-4 * moved)
    # the rigid arm's moment of inertia is what the base feels while it accelerates
    model = drm_env.Model({"mass": 0.0, "length": 0.0, "width": 0.0}, plant="thesis")
    rigid = float(model.matrices(2.0).M[0, 0])
    assert np.abs(torque).max() == pytest.approx(0.02 * rigid, rel=0.2)
    # in space the tip has turned with the base, and stays there
    tip = np.arctan2(flight["tip_y"], flight["tip_x"])
    np.testing.assert_allclose(tip[:free], angle, atol=1e-3)
    np.testing.assert_allclose(tip[free:last], TURN, atol=1e-3)


@pytest.mark.parametrize("plant", PLANTS)
def test_a_free_arm_stays_where_it_is(plant: str) -> None:
    """The bearing has no friction, so that the base turns under the arm."""
    legs = [{"kind": "hold", "duration": 5.0, "base": QUARTER_SINE}]
    flight = drm_env.simulate(mission(plant, legs), loads=True)
    angle, rate = base_motion(np.clip(flight["time"], 0.0, 4.0))
    np.testing.assert_allclose(flight["slew_angle"], -angle, atol=1e-9)
    np.testing.assert_allclose(flight["slew_rate"], -rate, atol=1e-9)
    assert np.abs(flight["angular_momentum"]).max() < 1e-9
    assert np.abs(flight["tip_deflection"]).max() < 1e-9
    assert np.abs(flight["tip_y"]).max() < 1e-9
    # a law turns the arm after the base, with the momentum in its wheels until it is there
    followed = drm_env.simulate(
        mission(plant, [*legs, {"kind": "wait_for_rest", "most": 40.0}]), "servo"
    )
    assert abs(followed["slew_angle"][-1]) < 2e-3
    assert np.abs(followed["root_momentum"]).max() > 20.0


# --- every door -------------------------------------------------------------------------------

ALL_KINDS: list[dict[str, Any]] = [
    {"kind": "hold", "duration": 0.6, "base": {
        "times": [0.0, 0.1, 0.1, 0.3], "accelerations": [0.2, 0.2, -0.1, -0.1]}},
    {"kind": "slew", "angle": 0.2, "max_accel": 0.2, "smoothing": 0.1, "extension": 3.0},
    {"kind": "hold", "duration": 0.3, "base": "locked"},
    {"kind": "grapple"},
    {"kind": "hold", "duration": 0.5, "base": {
        "times": [0.0, 0.05, 0.15, 0.2], "accelerations": [0.0, 0.1, -0.1, 0.0], "locked": True}},
    {"kind": "desaturate", "most": 1.5, "torque": 15.0},
    {"kind": "slew", "angle": -0.2, "max_accel": 0.2, "smoothing": 0.1},
    {"kind": "wait_for_rest", "most": 0.7, "base": "locked"},
    {"kind": "hold", "duration": 0.3},
]  # fmt: skip


def varied(plant: str) -> list[dict[str, Any]]:
    """Missions of several kinds of legs, with noise and delays, and one that is simple."""
    hardware: dict[str, Any] = {
        "root_wheel": {"lag": 0.01, "dead_time": 0.006},
        "sensors": {"angle_noise": 1e-5, "delay": 0.004},
        "initial": {"slew_rate": 0.02},
        "horizon": 30.0,
    }
    legs = [ALL_KINDS, ALL_KINDS[1:], ALL_KINDS[5:6] + ALL_KINDS[1:3], ALL_KINDS[1:2] * 2]
    missions = []
    for index, list_of_legs in enumerate(legs):
        content = mission(plant, list_of_legs, mass_error=0.05 * index, **hardware)
        content["mission"]["replan"] = True
        missions.append(content)
    return missions


@pytest.mark.parametrize("plant", PLANTS)
def test_every_door_flies_the_same_bits(plant: str) -> None:
    missions = varied(plant)
    assert len(list(flown_at_every_door(missions))) == len(missions)


@pytest.mark.parametrize("plant", PLANTS)
def test_batches_and_snapshots_fly_what_single_environments_fly(plant: str) -> None:
    config = {
        **mission(plant, ALL_KINDS, horizon=20.0, initial={"slew_rate": 0.02}),
        "task": {"inner_law": "linear", "control_period": 0.1},
        "randomize": {"payload_mass": {"uniform": [100.0, 500.0]}},
    }
    count = 3
    batch = drm_env.DrmVectorEnv(
        count, task="slew_thesis", config=config, autoreset_mode=AutoresetMode.SAME_STEP
    )
    singles = [drm_env.DrmEnv(task="slew_thesis", config=config) for _ in range(count)]
    other = drm_env.DrmEnv(task="slew_thesis", config=config)
    other.reset(seed=9)
    seen, _ = batch.reset(seed=3)
    for index, env in enumerate(singles):
        assert env.reset(seed=3 + index)[0].tobytes() == seen[index].tobytes()
    random = np.random.default_rng(0)
    ended = 0
    for step in range(110):
        actions = random.uniform(-0.5, 0.5, (count, 2)).astype(np.float32)
        seen, rewards, terminated, _, _ = batch.step(actions)
        for index, env in enumerate(singles):
            observation, reward, over, _, info = env.step(actions[index])
            assert (reward, over) == (rewards[index], terminated[index])
            if index == 0 and step % 3:
                again = other.step(actions[index])
                assert again[0].tobytes() == observation.tobytes()
                assert (again[1], repr(again[4])) == (reward, repr(info))
            if over:
                observation, _ = env.reset()
                ended += 1
            assert observation.tobytes() == seen[index].tobytes()
            if index == 0 and step % 3 == 0:
                other.set_state(env.get_state())
            elif index == 0 and over:
                other.reset()
    assert ended >= count


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("leg", "message"),
    [
        ({"kind": "hold", "base": "loose"}, "loose"),
        ({"kind": "hold", "base": 3}, "locked"),
        ({"kind": "slew", "angle": 0.3, "base": "locked"}, r"legs\[0\]\.angle .*brakes.*0\.3"),
        ({"kind": "hold", "base": {"times": [0.0, 1.0], "accelerations": [0.1, 0.1]}},
         r"legs\[0\]\.base\.accelerations must bring"),
        ({"kind": "hold", "base": {"times": [0.0], "accelerations": [0.1]}},
         r"legs\[0\]\.base\.times must have at least 2"),
        ({"kind": "hold", "duration": 2.0, "base": QUARTER_SINE}, r"legs\[0\]\.duration .*4 s.*2"),
        ({"kind": "wait_for_rest", "base": QUARTER_SINE}, r"legs\[0\]\.base.*locked"),
        ({"kind": "desaturate", "base": QUARTER_SINE}, r"legs\[0\]\.base.*locked"),
        ({"kind": "desaturate", "torque": 0.0}, r"legs\[0\]\.torque .*0"),
        ({"kind": "desaturate", "momentum": -1.0}, r"legs\[0\]\.momentum .*-1"),
        ({"kind": "desaturate", "most": 0.0}, r"legs\[0\]\.most .*0"),
    ],
)  # fmt: skip
def test_impossible_legs_are_named(leg: dict[str, Any], message: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=message):
        drm_env.simulate(mission("thesis", [leg]))


def test_a_mission_does_not_begin_turning_behind_brakes() -> None:
    legs = [{"kind": "hold", "base": "locked"}]
    with pytest.raises(drm_env.ConfigError, match=r"initial\.slew_rate .*locked"):
        drm_env.simulate(mission("thesis", legs, initial={"slew_rate": 0.01}))
