"""Missions: legs that take over what the leg before has left, at every door with the same bits."""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import drm_env
from mission_doors import PLANTS, flown_at_every_door, turn

ID = "drm_env/Mission-v0"
PERIOD = 0.002


PICK_AND_PLACE: list[dict[str, Any]] = [
    turn(0.3, 3.0),
    {"kind": "wait_for_rest", "most": 1.0},
    {"kind": "grapple"},
    turn(-0.5, 2.0),
    {"kind": "hold", "duration": 0.5},
    {"kind": "release"},
    turn(0.2),
    {"kind": "hold", "duration": 0.3},
]
"""Payloads are grappled and released while the arm still vibrates."""


def mission(
    plant: str = "thesis", legs: list[dict[str, Any]] | None = None, **parts: Any
) -> dict[str, Any]:
    scenario = {
        "plant": plant,
        "modes": (2, 2),
        "mass_error": 0.15,
        "payload": {"mass": 300.0},
        "deployment": {"start": 2.0},
        **parts,
    }
    return {"scenario": scenario, "mission": {"legs": PICK_AND_PLACE if legs is None else legs}}


SHORT: dict[str, Any] = {
    **mission("thesis", horizon=30.0),
    "task": {"inner_law": "servo", "control_period": 0.1},
    "randomize": {"payload_mass": {"uniform": [100.0, 500.0]}},
}


def rows(flight: drm_env.Trajectory) -> list[int]:
    """Row of each leg's beginning."""
    return [int(np.argmin(np.abs(flight["time"] - leg.start))) for leg in flight.legs]


@pytest.mark.parametrize("plant", PLANTS)
def test_nothing_jumps_where_a_leg_ends(plant: str) -> None:
    flight = drm_env.simulate(mission(plant), "linear")
    assert [leg.leg for leg in flight.legs] == [0, 1, 3, 4, 6, 7]
    np.testing.assert_allclose(np.diff(flight["time"]), PERIOD, rtol=1e-6)
    # (signal, the fastest that it can change, per second)
    for name, rate in {
        "slew_angle": 1.0, "reference_angle": 1.0, "extension": 3.0, "tip_deflection": 3.0,
        "link2_tip_deflection": 3.0, "root_momentum": 101.0, "tip_momentum": 11.0,
    }.items():  # fmt: skip
        assert np.abs(np.diff(flight[name])).max() <= rate * PERIOD, name
    assert abs(flight["reference_angle"][-1]) < 1e-12
    assert flight["extension"][-1] == 2.0


@pytest.mark.parametrize("plant", PLANTS)
def test_energy_is_balanced_over_the_legs(plant: str) -> None:
    """At a fixed length: work of the slew motor, and what came with payloads."""
    legs = [
        turn(0.3), {"kind": "grapple"}, {"kind": "hold", "duration": 0.5}, turn(-0.5),
        {"kind": "release"}, turn(0.2), {"kind": "hold", "duration": 0.3},
    ]  # fmt: skip
    # one step a sample, and an integrator that takes nothing
    fine = {"sample_period": 5e-4, "integrator_step": 5e-4, "dynamics": {"spectral_radius": 1.0}}
    flight = drm_env.simulate(mission(plant, legs, **fine))
    power = flight["slew_torque"] * flight["slew_rate"]
    work, size = np.trapezoid(power, dx=5e-4), np.trapezoid(np.abs(power), dx=5e-4)
    brought = sum(leg.energy for leg in flight.legs)
    left = flight.legs[-1].metrics["residual_energy"]
    assert abs(left - work - brought) < 2e-4 * size
    # leg by leg too
    bounds = [*rows(flight), flight["time"].size - 1]
    before = 0.0
    for leg, start, end in zip(flight.legs, bounds[:-1], bounds[1:], strict=True):
        work = np.trapezoid(power[start : end + 1], dx=5e-4)
        after = leg.metrics["residual_energy"]
        assert abs(after - before - work - leg.energy) < 4e-4 * size, leg.kind
        before = after


@pytest.mark.parametrize("plant", PLANTS)
def test_angular_momentum_is_balanced_over_the_legs(plant: str) -> None:
    """What the motor gave and payloads brought is in the arm and in the wheels."""
    fine = {"sample_period": 5e-4, "integrator_step": 5e-4}
    # without the wait, so that the arm vibrates when it grapples
    legs = [PICK_AND_PLACE[0], *PICK_AND_PLACE[2:-1], {"kind": "hold", "duration": 8.0}]
    flight = drm_env.simulate(mission(plant, legs, **fine), "linear")
    impulse = np.trapezoid(flight["slew_torque"], dx=5e-4)
    size = np.trapezoid(np.abs(flight["slew_torque"]), dx=5e-4)
    brought = sum(leg.momentum for leg in flight.legs)
    assert abs(flight.legs[1].momentum) > 1e-6 * size
    stored = flight["root_momentum"][-1] + flight["tip_momentum"][-1]
    model = drm_env.Model({"mass": 0.0, "length": 0.0, "width": 0.0}, plant="thesis")
    q, v = (
        np.array([flight[name][-1] for name in names])
        for names in (("slew_angle", "alpha", "beta"), ("slew_rate", "alpha_rate", "beta_rate"))
    )
    arm = model.angular_momentum(q, v, extension=2.0)
    # of the consistent arm this is its momentum up to what little it still bends
    tolerance = 2e-5 if plant == "thesis" else 5e-3
    assert abs(arm + stored - impulse - brought) < tolerance * size


def test_a_payload_brings_what_a_body_moving_with_the_tip_has() -> None:
    """The thesis' velocity field, written down for the payload alone."""
    payload = {"mass": 100.0, "length": 0.8, "width": 0.4}
    hold = {"kind": "hold", "duration": 0.1}
    flight = drm_env.simulate(
        mission(
            legs=[hold, {"kind": "grapple", "payload": payload}, hold],
            dynamics={"axial_load": False},
            initial={"slew_rate": 0.05, "beta": 1e-3},
        )
    )
    row = rows(flight)[1]
    at = {name: values[row] for name, values in flight.items()}
    length = at["extension"]
    lever = drm_env.Scenario().arm.link1.length + length + 0.4
    slope_rate = 3.0 * at["beta_rate"] / length
    speed = lever * at["slew_rate"] + 2.0 * (at["alpha_rate"] + at["beta_rate"]) + 0.4 * slope_rate
    turning = at["slew_rate"] + slope_rate
    inertia = 100.0 * (0.8**2 + 0.4**2) / 12.0
    leg = flight.legs[1]
    assert leg.momentum == pytest.approx(100.0 * lever * speed + inertia * turning, rel=1e-9)
    energy = 0.5 * (100.0 * speed**2 + inertia * turning**2)
    assert leg.energy == pytest.approx(energy, rel=1e-9)


def test_a_deployment_has_its_own_start() -> None:
    legs = [
        {"kind": "slew", "extension": 3.0},
        {
            "kind": "slew", "angle": 0.1, "extension": 2.5, "deployment": "force_limited",
            "deployment_start": 1.0,
        },
    ]  # fmt: skip
    flight = drm_env.simulate(mission(legs=legs))
    row, length = rows(flight)[1], flight["extension"]
    assert (length[0], length[row], length[row + 500], length[-1]) == (2.0, 3.0, 3.0, 2.5)
    assert length[row + 600] < 3.0
    assert (flight["reference_angle"][: row + 1] == 0.0).all()
    # 75 kg of link 2 over a metre with 200 N, up and down, to whole periods of 0.1 s
    needed = 2.0 * math.sqrt(75.0 / 200.0)
    assert flight.legs[0].metrics["duration"] == pytest.approx(math.ceil(needed * 10.0) / 10.0)


def test_waiting_ends_at_rest_or_in_time() -> None:
    def waited(law: str, most: float) -> drm_env.Trajectory:
        legs = [{"kind": "wait_for_rest", "most": most, "quiet": 0.5}]
        return drm_env.simulate(mission(legs=legs, initial={"beta": 1e-3}), law)

    damped = waited("linear", 20.0)
    assert 0.5 <= damped.metrics["duration"] < 19.0
    assert np.abs(damped["tip_deflection"][-250:]).max() < 1.2e-3
    assert waited("none", 2.0).metrics["duration"] == pytest.approx(2.0)


def test_legs_are_planned_for_the_identified_mass() -> None:
    legs = [{"kind": "grapple"}, turn(0.5), {"kind": "hold"}, turn(-0.5), {"kind": "hold"}]

    def missed(replan: bool) -> tuple[float, float]:
        content = mission(legs=legs)
        content["mission"]["replan"] = replan
        flight = drm_env.simulate(content)
        third, fourth = rows(flight)[2:4]
        angle = flight["slew_angle"]
        return flight.legs[2].planned_mass, abs(angle[fourth] - angle[third] + 0.5)

    reported, blind = missed(False)
    identified, seeing = missed(True)
    assert reported == pytest.approx(345.0)
    assert identified == pytest.approx(300.0, rel=0.02)
    assert seeing < 0.25 * blind


@pytest.mark.parametrize("plant", PLANTS)
def test_every_door_flies_the_same_bits(plant: str) -> None:
    """Alone, side by side, and in environments whose inner law flies."""
    hardware = {
        "root_wheel": {"lag": 0.01, "dead_time": 0.006},
        "sensors": {"angle_noise": 1e-5, "delay": 0.004},
        "horizon": 30.0,
    }
    missions = [
        mission(plant, payload={"mass": mass}, **hardware) for mass in (100.0, 180.0, 260.0)
    ]
    for content in missions:
        content["mission"]["replan"] = True
    for env, info in flown_at_every_door(missions):
        paid = sum(sum(leg.reward.values()) for leg in env.legs)
        assert paid == pytest.approx(info["metrics/episode_return"])
        assert info["leg/3/effort"] == env.legs[2].reward["effort"]
        assert info["mission/leg"] == len(PICK_AND_PLACE)


def test_a_batch_flies_what_single_environments_fly() -> None:
    batch = drm_env.DrmVectorEnv(
        5, task="slew_thesis", config=SHORT, autoreset_mode=AutoresetMode.SAME_STEP
    )
    singles = [drm_env.DrmEnv(task="slew_thesis", config=SHORT) for _ in range(5)]
    seen, _ = batch.reset(seed=3)
    for index, env in enumerate(singles):
        assert env.reset(seed=3 + index)[0].tobytes() == seen[index].tobytes()
    random = np.random.default_rng(0)
    ended = 0
    for _ in range(220):
        actions = random.uniform(-0.5, 0.5, (5, 2)).astype(np.float32)
        seen, rewards, terminated, truncated, info = batch.step(actions)
        assert not truncated.any()
        for index, env in enumerate(singles):
            observation, reward, over, _, own = env.step(actions[index])
            assert (reward, over) == (rewards[index], terminated[index])
            if over:
                final = info["final_info"]
                assert info["final_obs"][index].tobytes() == observation.tobytes()
                assert final["leg/6/effort"][index] == own["leg/6/effort"] < 0.0
                observation, own = env.reset()
                ended += 1
            assert observation.tobytes() == seen[index].tobytes()
            assert info["mission/leg"][index] == own["mission/leg"]
    assert ended > 4


@pytest.mark.parametrize("plant", PLANTS)
def test_snapshots_in_the_middle_of_a_leg(plant: str) -> None:
    config = {**SHORT, **mission(plant, horizon=30.0, sensors={"delay": 0.01, "rate_noise": 1e-5})}
    env = drm_env.DrmEnv(task="slew_thesis", config=config)
    other = drm_env.DrmEnv(task="slew_thesis", config=config)
    env.reset(seed=5)
    other.reset(seed=6)
    random = np.random.default_rng(1)
    done, step = False, 0
    while not done:
        action = random.uniform(-1.0, 1.0, 2).astype(np.float32)
        observation, reward, done, _, info = env.step(action)
        if step % 7 == 3:
            other.set_state(env.get_state())
        elif step > 3:
            again = other.step(action)
            assert again[0].tobytes() == observation.tobytes()
            assert (again[1], repr(again[4])) == (reward, repr(info))
        step += 1
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):  # noqa: S301
        assert twin.get_state() == env.get_state()
        assert repr(twin.legs) == repr(env.legs)
        with pytest.raises(drm_env.ResetNeededError):
            twin.step([0.0, 0.0])
    state = env.get_state()
    with pytest.raises(drm_env.SnapshotError):
        other.set_state(state[:-3])
    batch = drm_env.DrmVectorEnv(3, task="slew_thesis", config=config)
    batch.reset(seed=0)
    batch.envs[1].set_state(state)
    assert batch.envs[1].get_state() == state


def test_what_stable_baselines3_is_told() -> None:
    sb3 = pytest.importorskip("drm_env.sb3")
    venv = sb3.DrmSB3VecEnv(3, task="slew_thesis", config=SHORT)
    venv.seed(2)
    venv.reset()
    for _ in range(120):
        _, _, dones, infos = venv.step(np.zeros((3, 2), dtype=np.float32))
        for index in np.flatnonzero(dones):
            info = infos[index]
            assert not info["TimeLimit.truncated"]
            assert not info["diverged"]
            assert info["leg/3/tip_vibration"] < 0.0
            return
    pytest.fail("no mission ended")


def test_the_registered_environment() -> None:
    env = gym.make(ID)
    assert env.spec is not None
    assert env.spec.max_episode_steps == 1200
    check_env(env.unwrapped, skip_render_check=True)
    _, info = env.reset(seed=0)
    assert 50.0 <= info["context/payload_mass"] <= 500.0
    assert "leg/0/tip_vibration" in info
    scenario = env.unwrapped.scenario()  # type: ignore[attr-defined]
    flown = drm_env.rollout([scenario], "servo", seed=0)
    assert not flown["diverged"][0]
    assert [leg.kind for leg in flown.legs[0]] == ["slew", "wait_for_rest"] * 3
    assert flown.legs[0][2].planned_mass > 0.0 == flown.legs[0][0].planned_mass


def test_pictures_follow_missions() -> None:
    env = drm_env.DrmEnv(task="slew_thesis", config=SHORT, render_mode="rgb_array")
    env.reset(seed=0)
    frames = []
    for _ in range(60):
        env.step([0.0, 0.0])
        frames.append(env.render())
    assert (frames[0] != frames[-1]).any()


@pytest.mark.parametrize(
    ("legs", "message"),
    [
        ([{"kind": "hold"}, {"kind": "release"}], r"mission\.legs\[1\]\.kind"),
        ([turn(0.1, 80.0)], r"mission\.legs\[0\]\.deployment\.end .*80"),
        ([turn(1.0, duration=0.5)], r"mission\.legs\[0\]\.duration .*0\.5"),
        ([{"kind": "wait_for_rest", "most": -1.0}], r"mission\.legs\[0\]\.most .*-1"),
        ([{"kind": "hop"}], "hop"),
        ([], r"mission\.legs"),
    ],
)
def test_impossible_legs_are_named(legs: list[dict[str, Any]], message: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=message):
        drm_env.simulate(mission(legs=legs))


def test_what_does_not_go_together_is_refused() -> None:
    with pytest.raises(drm_env.ConfigError, match="horizon must be at least"):
        drm_env.simulate(mission(horizon=3.0))
    with pytest.raises(drm_env.ConfigError, match=r"mission\.period"):
        drm_env.DrmEnv(task="mission", control_period=0.07 * 1)
    with pytest.raises(drm_env.ConfigError, match="cannot be flown in one rollout"):
        drm_env.rollout([mission(), {}])
    with pytest.raises(drm_env.ConfigError, match="decimation must divide"):
        drm_env.simulate(mission(), decimation=7)


def test_the_example_is_flown() -> None:
    path = Path(__file__).parents[1] / "examples" / "mission.toml"
    env = gym.make(ID, config=path, payload_mass=400.0, mass_error=0.15)
    env.reset(seed=0)
    flight = drm_env.simulate(env.unwrapped.scenario(), "servo")  # type: ignore[attr-defined]
    assert flight.legs[-1].kind == "wait_for_rest"
    assert not flight.metrics["diverged"]
