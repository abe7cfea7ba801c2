"""Strain gauges, accelerometer and gyro: mechanics says what they read, and every door agrees."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson

import drm_env
from drm_env.constants import MEASURED_NAMES, SIGNAL_NAMES

Array = NDArray[np.float64]

FITTED = {name: {"fitted": True} for name in ("link1_gauge", "link2_gauge", "tip_accelerometer")}
MOMENTS = ("measured_link1_moment", "measured_link2_moment")
ACCELERATION = "measured_tip_acceleration"
TASKS = {"drm_env/Slew-v0": "slew", "drm_env/SlewFlexible-v0": "slew_flexible"}
OBSERVED = ["tip_gyro", "link2_gauge", "tip_accelerometer", "link1_gauge"]
ENTRIES = ["tip_turn_rate", "link2_moment", "tip_acceleration", "link1_moment"]
ROUGH: dict[str, Any] = {
    "observe_sensors": OBSERVED,
    "link1_gauge_noise": 2.0,
    "link2_gauge_bandwidth": 60.0,
    "link2_gauge_resolution": 0.5,
    "tip_accelerometer_noise": 0.01,
    "tip_accelerometer_bandwidth": 200.0,
    "tip_accelerometer_bias": (-0.02, 0.02),
    "tip_rate_noise": 1e-4,
    "tip_rate_bandwidth": 100.0,
    "sensor_delay": 0.006,
}


def fly(scenario: dict[str, Any], law: Any = "none", **more: Any) -> drm_env.Trajectory:
    return drm_env.simulate({"sensors": FITTED, **scenario}, law, sensors=True, **more)


def still(length: float = 5.0, **more: Any) -> dict[str, Any]:
    """An arm of fixed length that nobody slews."""
    return {
        "slew": {"angle": 0.0},
        "deployment": {"start": length, "end": length, "mode": "none"},
        **more,
    }


def arm(**changes: dict[str, float]) -> dict[str, Any]:
    """The thesis' arm with other properties of its links."""
    links = asdict(drm_env.default_config().scenario.arm)
    return {name: {**links[name], **changes.get(name, {})} for name in links}


def differences(values: Array, step: float) -> Array:
    """Second derivative at the points between the first and the last."""
    return (values[2:] - 2.0 * values[1:-1] + values[:-2]) / step**2


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_accelerometer_is_the_second_difference_of_the_tip(plant: str) -> None:
    """Across the link at the tip, with an error of second order in the time between the places.

    Link 2 moves out at a steady acceleration meanwhile, and the arm slews and vibrates. The thesis'
    link 2 has the shape 3 u^2 - u^3 with the deflection 2 beta at its end: the slope 3 beta / a.
    """
    errors = []
    for period in (0.002, 0.001, 0.0005):
        scenario = {
            "plant": plant,
            "modes": [2, 2],
            "dynamics": {"structural_damping": 1e-3 if plant == "consistent" else 0.0},
            "slew": {"smoothing": 0.02},
            "sample_period": period,
            "integrator_step": 5e-5,
            "horizon": 2.2,
        }
        flight = fly(scenario, loads=True)
        if plant == "thesis":
            angle = flight["slew_angle"] + 3.0 * flight["beta"] / flight["extension"]
        else:
            angle = cumulative_simpson(flight["measured_tip_turn_rate"], dx=period, initial=0.0)
        x, y = (differences(flight[name], period) for name in ("tip_x", "tip_y"))
        across = y * np.cos(angle[1:-1]) - x * np.sin(angle[1:-1])
        read = flight[ACCELERATION][1:-1]
        # one second in which nothing switches
        within = np.abs(flight["time"][1:-1] - 1.6) < 0.5
        errors.append(np.abs(read - across)[within].max())
        scale = np.abs(read[within]).max()
    assert errors[-1] < 1e-3 * scale
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 3.5) & (ratios < 4.5)), ratios


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_gauges_are_in_equilibrium_with_what_is_beyond_them(plant: str) -> None:
    """At the root of link 1 with motor and root wheel; at that of link 2 with the payload alone.

    Links that weigh hardly anything, and a payload that is a point, leave the moment
    a m y'' across link 1's end, less the tip wheel's torque: the accelerometer's reading times
    mass and lever, as far as the arm is straight.
    """
    light = {"mass_per_length": 1e-6}
    scenario = {
        "plant": plant,
        "modes": [1, 1],
        "arm": arm(link1=light, link2=light),
        "payload": {"mass": 100.0, "length": 0.0, "width": 0.0},
        "deployment": {"start": 4.0, "end": 4.0, "mode": "none"},
        "integrator_step": 5e-6,
        "dynamics": {"axial_load": False, "spectral_radius": 0.8},
        "horizon": 0.4,
    }

    def law(_: Array) -> Array:
        return np.array([[40.0, -6.0]])

    if plant == "thesis":
        # without mass of its own a link has a mode too fast for an explicit method
        heavier = {"mass_per_length": 1.0}
        scenario["arm"] = arm(link1=heavier, link2=heavier)
        scenario["integrator_step"] = 1e-4
    flight = fly(scenario, law, loads=True)
    link1, link2 = (flight[name] for name in MOMENTS)
    np.testing.assert_allclose(link1[1:-1], flight["slew_torque"][1:-1] + 40.0, rtol=1e-9)
    if plant == "consistent":
        expected = 100.0 * 4.0 * flight[ACCELERATION][1:] + 6.0
        np.testing.assert_allclose(link2[1:], expected, rtol=2e-3, atol=2e-3 * np.abs(link2).max())
    # and as the loads are told, which are looked at after the torques have changed
    known = flight["root_bending_moment_link2"]
    np.testing.assert_allclose(link2[2:-1], known[2:-1], rtol=1e-9, atol=1e-9 * np.abs(known).max())


def test_gauge_and_deflection_are_those_of_a_cantilever() -> None:
    """A steady slew acceleration bends link 2 like a cantilever with a load at its end.

    F = m r theta'', the moment at its root F a, its deflection F a^3 / (3 EI), when vibrations
    have died away.
    """
    light = {"mass_per_length": 1e-3}
    mass, a, stiffness = 200.0, 4.0, 3.0e6
    scenario = {
        "plant": "consistent",
        "arm": arm(link1={**light, "bending_stiffness": 1e9}, link2=light),
        "payload": {"mass": mass, "length": 0.0, "width": 0.0},
        "deployment": {"start": a, "end": a, "mode": "none"},
        "dynamics": {"structural_damping": 0.05, "axial_load": False},
        "slew": {"angle": 0.5, "max_accel": 0.01},
        "horizon": 6.0,
    }
    flight = fly(scenario)
    reach, accel = 7.0 + a, 0.01
    late = flight["time"] > 4.0
    assert np.all(flight["reference_accel"][late] == accel)
    force = mass * reach * accel
    link1, link2 = (flight[name][late] for name in MOMENTS)
    np.testing.assert_allclose(link2, force * a, rtol=2e-3)
    np.testing.assert_allclose(link1, force * reach, rtol=2e-3)
    deflection = -flight["link2_tip_deflection"][late]
    np.testing.assert_allclose(deflection, force * a**3 / (3.0 * stiffness), rtol=5e-3)
    np.testing.assert_allclose(link2, 3.0 * stiffness * deflection / a**2, rtol=5e-3)


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_low_pass_is_that_of_first_order(plant: str) -> None:
    """A torque of the root wheel that is held is a step at the root of link 1: M (1 - e^(-w t))."""
    bandwidth, period = 40.0, 0.002
    sensors = {"link1_gauge": {"bandwidth": bandwidth}, "delay": 3 * period}
    scenario = still(plant=plant, horizon=0.4, sensors=sensors)
    flight = drm_env.simulate(scenario, lambda _: np.array([[60.0, 0.0]]), sensors=True)
    since = np.maximum(flight["time"] - 3 * period, 0.0)
    expected = 60.0 * (1.0 - np.exp(-bandwidth * since))
    np.testing.assert_allclose(flight[MOMENTS[0]], expected, rtol=1e-9, atol=1e-9)
    assert np.isnan(flight[MOMENTS[1]]).all(), "an instrument that is not there reads nothing"


def test_low_pass_of_the_gyro_follows_a_ramp_behind() -> None:
    """A steady acceleration is a ramp of the rate: a first-order lag is 1/w behind it."""
    stiff = {"bending_stiffness": 1e9}
    scenario = {
        "plant": "consistent",
        "arm": arm(link1=stiff, link2=stiff),
        "deployment": {"start": 5.0, "end": 5.0, "mode": "none"},
        "slew": {"angle": 1.0, "max_accel": 0.05},
        "dynamics": {"structural_damping": 0.01},
        "horizon": 2.0,
    }
    read = {}
    for bandwidth in (None, 20.0):
        scenario["sensors"] = {"tip_rate_bandwidth": bandwidth}
        read[bandwidth] = drm_env.simulate(scenario, sensors=True)["measured_tip_turn_rate"]
    behind = (read[None] - read[20.0])[-100:]
    # as far as half a sample, for which the method holds what it reads
    np.testing.assert_allclose(behind, 0.05 / 20.0, rtol=0.03)


def test_errors_are_what_they_are_called() -> None:
    """Bias, noise and resolution by themselves, of one instrument, beside the exact reading."""
    scenario = still(initial={"beta": 2e-3}, horizon=20.0)
    exact = fly(scenario)
    for name, field in zip((*MOMENTS, ACCELERATION), FITTED, strict=True):
        size = 3.0 if "moment" in name else 0.05

        def errors(field: str = field, name: str = name, **given: float) -> Array:
            sensors = {**FITTED, field: given}
            flight = fly({**scenario, "sensors": sensors})
            for other in (*SIGNAL_NAMES, *MEASURED_NAMES):
                if other != name:
                    np.testing.assert_array_equal(flight[other], exact[other])
            return flight[name] - exact[name]

        np.testing.assert_allclose(errors(bias=size), size)
        noise = errors(noise=size)
        assert len(noise) == 10_001
        # 5 standard deviations of mean and standard deviation of so many
        assert abs(noise.mean()) < 5.0 * size / 100.0
        assert abs(noise.std() / size - 1.0) < 5.0 / np.sqrt(2e4)
        rounded = exact[name] + errors(resolution=size)
        np.testing.assert_allclose(rounded / size, np.round(rounded / size), atol=1e-9)
        assert np.abs(rounded - exact[name]).max() <= 0.5 * size + 1e-12
    # instruments do not draw each other's noise
    both = {name: {"noise": 1.0} for name in FITTED}
    flight = fly({**scenario, "sensors": both})
    parts = [flight[name] - exact[name] for name in (*MOMENTS, ACCELERATION)]
    assert np.abs(np.corrcoef(parts) - np.eye(3)).max() < 0.05


@pytest.mark.parametrize(
    ("bias", "name"),
    [
        ("angle_bias", "measured_slew_angle"),
        ("rate_bias", "measured_slew_rate"),
        ("deflection_bias", "measured_link2_tip_deflection"),
        ("deflection_rate_bias", "measured_link2_tip_deflection_rate"),
        ("tip_rate_bias", "measured_tip_turn_rate"),
    ],
)
def test_other_sensors_have_a_bias_too(bias: str, name: str) -> None:
    exact = drm_env.simulate({"horizon": 0.2}, sensors=True)
    biased = drm_env.simulate({"horizon": 0.2, "sensors": {bias: 0.125}}, sensors=True)
    for other in MEASURED_NAMES:
        shift = 0.125 if other == name else 0.0
        np.testing.assert_allclose(biased[other], exact[other] + shift, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
@pytest.mark.parametrize("law", ["none", "linear"])
def test_instruments_move_nothing(plant: str, law: str) -> None:
    base = {"plant": plant, "horizon": 1.0}
    without = drm_env.simulate(base, law)
    flight = fly(base, law)
    for name in SIGNAL_NAMES:
        np.testing.assert_array_equal(flight[name], without[name])
    np.testing.assert_equal(flight.metrics, without.metrics)
    assert all(np.isfinite(flight[name]).all() for name in MEASURED_NAMES)
    assert tuple(flight) == (*SIGNAL_NAMES, *MEASURED_NAMES)


@pytest.mark.parametrize("id_", TASKS)
def test_observed_sensors_stand_behind_the_rest(id_: str) -> None:
    """And the rest keeps its bits; readings are those of the signals."""
    plain, seeing = (gym.make(id_, **o) for o in ({}, {"observe_sensors": OBSERVED}))
    layout = seeing.unwrapped.observation_layout
    size = len(plain.unwrapped.observation_layout)
    assert layout[:size] == plain.unwrapped.observation_layout
    assert [entry.name for entry in layout[size:]] == ENTRIES
    assert [entry.unit for entry in layout[size:]] == ["rad/s", "N m", "m/s^2", "N m"]
    assert all(getattr(seeing.unwrapped.config.scenario.sensors, name).fitted for name in FITTED)
    (first, _), (more, _) = (env.reset(seed=5) for env in (plain, seeing))
    np.testing.assert_array_equal(more[:size], first)
    scales = np.array([entry.scale for entry in layout[size:]])
    (scenario,) = drm_env.sample_scenarios(TASKS[id_], seed=5, n=1, observe_sensors=OBSERVED)
    calm = drm_env.simulate(scenario, sensors=True, seed=5)
    steps = round(seeing.unwrapped.config.task.control_period / scenario["sample_period"])
    places = [MEASURED_NAMES.index(f"measured_{name}") for name in ENTRIES]
    for step in range(1, 40):
        (first, *_), (more, *_) = (env.step(np.zeros(2, np.float32)) for env in (plain, seeing))
        np.testing.assert_array_equal(more[:size], first)
        read = [calm[MEASURED_NAMES[i]][step * steps] for i in places]
        np.testing.assert_allclose(more[size:] * scales, read, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("id_", ["drm_env/SlewDirect-v0", "drm_env/SlewFlexible-v0"])
def test_batch_and_snapshots_have_the_bits_of_one(id_: str) -> None:
    options = {**ROUGH, "observation_history": 2}
    rng = np.random.default_rng(0)
    batch = gym.make_vec(id_, num_envs=5, **options)
    singles = [gym.make(id_, **options) for _ in range(5)]
    observed, _ = batch.reset(seed=11)
    for lane, env in enumerate(singles):
        np.testing.assert_array_equal(env.reset(seed=11 + lane)[0], observed[lane])
    kept: list[bytes] = []
    later: list[Array] = []
    actions = rng.uniform(-1.0, 1.0, (24, *batch.action_space.shape)).astype(np.float32)
    for step, action in enumerate(actions):
        if step == 12:
            kept = [env.unwrapped.get_state() for env in singles]
        observed, reward, *_ = batch.step(action)
        for lane, env in enumerate(singles):
            seen, paid, *_ = env.step(action[lane])
            np.testing.assert_array_equal(seen, observed[lane])
            assert paid == reward[lane]
        if step >= 12:
            later.append(observed.copy())
    other = gym.make(id_, **options)
    other.reset(seed=0)
    for lane, state in enumerate(kept):
        other.unwrapped.set_state(state)
        for action, observed in zip(actions[12:], later, strict=True):
            np.testing.assert_array_equal(other.step(action[lane])[0], observed[lane])


def test_every_door_takes_them(tmp_path: Any) -> None:
    """The same configuration, and the same reading at the beginning and after a step."""
    pytest.importorskip("stable_baselines3")
    from drm_env.sb3 import make_sb3_vec

    env = drm_env.DrmEnv(**ROUGH)
    config = tmp_path / "task.json"
    config.write_text(json.dumps(json.loads(env.config_json)))
    seen = [env.reset(seed=3)[0]]
    seen.append(env.step(np.zeros(2, np.float32))[0])
    again = drm_env.DrmEnv(config=config)
    assert again.config_json == env.config_json
    vector = make_sb3_vec("drm_env/Slew-v0", 2, seed=3, **ROUGH)
    first = vector.reset()[0]
    sync = gym.make_vec("drm_env/Slew-v0", 2, vectorization_mode="sync", **ROUGH)
    for row in (first, again.reset(seed=3)[0], sync.reset(seed=3)[0][0]):
        np.testing.assert_array_equal(row, seen[0])
    after = vector.step(np.zeros((2, 2), np.float32))[0][0]
    np.testing.assert_array_equal(after, seen[1])
    names = ["time", *MEASURED_NAMES]
    scenarios = drm_env.sample_scenarios(seed=3, n=3, **ROUGH)
    many = drm_env.rollout(scenarios, "linear", signals=names, seed=3, decimation=10)
    asked = drm_env.rollout(
        scenarios, signals=names, seed=3, decimation=10, torques=np.zeros((3, 1, 2))
    )
    for i, scenario in enumerate(scenarios):
        one = drm_env.simulate(scenario, "linear", seed=3 + i, sensors=True, decimation=10)
        for name in names:
            np.testing.assert_array_equal(many.trajectories[name][i], one[name])
    assert np.isfinite(asked.trajectories["measured_link2_moment"]).all()
    biases = [item["sensors"]["tip_accelerometer"]["bias"] for item in scenarios]
    assert len(set(biases)) == 3 and max(np.abs(biases)) <= 0.02


def test_callables_are_told_the_readings() -> None:
    told: list[Array] = []

    def law(seen: Array) -> Array:
        told.append(seen[0].copy())
        return np.array([[5.0, -1.0]])

    flight = fly({"horizon": 0.2, "sensors": {"link2_gauge": {"noise": 1.0}}}, law)
    columns = drm_env.ControlLaw.MEASUREMENTS
    rows = np.array(told)
    read = rows[:, columns.index("link2_moment")]
    np.testing.assert_array_equal(read, flight["measured_link2_moment"][:-1])
    assert not rows[:, columns.index("link1_moment")].any(), "it is not there"


def test_a_law_of_the_gyro_flies_on_observations_that_show_it() -> None:
    """As below an agent, whose law is told by the engine."""
    law = {"name": "collocated"}
    options: dict[str, Any] = {"control_period": 0.002, "observe_sensors": ["tip_gyro"]}
    control = drm_env.ControlLaw(law, **options)
    env, below = drm_env.DrmEnv(**options), drm_env.DrmEnv(inner_law=law, **options)
    (seen, _), _ = env.reset(seed=1), below.reset(seed=1)
    state, start = control.initial_state(1), [True]
    limits = np.array(control.torque_limits)
    for _ in range(200):
        torques, state = control.torques(control.measurements(seen[None]), state, start)
        start = [False]
        seen, *_ = env.step((torques[0] / limits).astype(np.float32))
        other, *_ = below.step(np.zeros(2, np.float32))
    np.testing.assert_allclose(seen, other, rtol=2e-3, atol=2e-3)
    with pytest.raises(drm_env.ConfigError, match=r"does not hold 'tip_turn_rate'"):
        drm_env.ControlLaw(law, control_period=0.002).measurements(seen[None, :-1])


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_gauges_know_what_brakes_bear(plant: str) -> None:
    """Legs of a mission in which something else than the plan holds the shoulder: as the loads."""
    legs = [
        {"kind": "slew", "angle": 0.3},
        {"kind": "hold", "duration": 1.0, "base": "locked"},
    ]
    mission = {
        "scenario": {"plant": plant, "modes": [2, 2], "sensors": FITTED},
        "mission": {"legs": legs},
    }
    flight = drm_env.simulate(mission, loads=True, sensors=True, decimation=5)
    held = flight["time"] > flight.legs[1].start + 0.1
    held[-1] = False
    for name, load in zip(MOMENTS, ("link1", "link2"), strict=True):
        known = flight[f"root_bending_moment_{load}"][held]
        assert np.abs(known).max() > 1.0
        np.testing.assert_allclose(flight[name][held], known, atol=2e-3 * np.abs(known).max())
    np.testing.assert_array_equal(flight["measured_slew_angle"], flight["slew_angle"])


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("link1_gauge_noise", -1.0, "sensors.link1_gauge.noise must .* got -1"),
        ("link2_gauge_resolution", -0.5, "sensors.link2_gauge.resolution must .* got -0.5"),
        ("tip_accelerometer_bandwidth", 0.0, "tip_accelerometer.bandwidth must be pos.* got 0"),
        ("tip_rate_bandwidth", -3.0, "sensors.tip_rate_bandwidth must be positive .* got -3"),
        ("tip_accelerometer_bias", 1e30, "sensors.tip_accelerometer.bias must be .* got 1e30"),
        ("observe_sensors", ["tip_gyro"] * 2, "observe_sensors must list .* at most once"),
        ("observe_sensors", ["thermometer"], "observe_sensors.*thermometer"),
        ("link2_gauge_noise", "loud", "link2_gauge.noise.*loud"),
    ],
)
def test_what_no_sensor_has_is_refused(option: str, value: Any, message: str) -> None:
    for make in (drm_env.DrmEnv, drm_env.resolve, lambda **o: drm_env.DrmVectorEnv(2, **o)):
        with pytest.raises(drm_env.ConfigError, match=message):
            make(**{option: value})


def test_what_a_network_observes_is_fitted() -> None:
    """Also to scenarios that do not have it, and to the legs of missions."""
    size = len(drm_env.observation_layout(observe_sensors=["link2_gauge"]))
    network = drm_env.Network([(np.zeros((2, size)), np.zeros(2))])
    given: dict[str, Any] = {"policy": network, "observe_sensors": ["link2_gauge"]}
    given["signals"] = ["time", *MOMENTS]
    fitted = {"sensors": {"link2_gauge": {"fitted": True}}}
    without, fitted = drm_env.rollout([{}, fitted], **given).trajectories["measured_link2_moment"]
    np.testing.assert_array_equal(without, fitted)
    assert np.abs(without).max() > 1.0
    missions = drm_env.sample_scenarios("mission", n=1)
    size = len(drm_env.observation_layout("mission", observe_sensors=["link2_gauge"]))
    given["policy"] = drm_env.Network([(np.zeros((2, size)), np.zeros(2))])
    flown = drm_env.rollout(missions, task="mission", **given)
    read = flown.trajectories["measured_link2_moment"]
    assert np.isfinite(read[np.isfinite(flown.trajectories["time"])]).all()
    assert len(flown.legs[0]) > 1 and np.isnan(flown.trajectories[MOMENTS[0]]).all()


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_instruments_outlive_a_flight_that_diverges(plant: str) -> None:
    """Whatever they read there: the flight ends as it does without them."""
    scenario = {"plant": plant, "initial": {"beta_rate": 300.0}, "horizon": 2.0}
    flight, without = fly(scenario), drm_env.simulate(scenario)
    assert flight.metrics["diverged"] == 1.0
    np.testing.assert_equal(flight.metrics, without.metrics)
    env = drm_env.DrmEnv(
        plant=plant, observe_sensors=OBSERVED, initial_beta_rate=300.0, link2_gauge_bandwidth=50.0
    )
    observation, _ = env.reset(seed=0)
    terminated = False
    while not terminated:
        observation, _, terminated, truncated, _ = env.step(np.zeros(2, np.float32))
        assert np.isfinite(observation).all() and not truncated
    state = env.get_state()
    env.reset(seed=1)
    env.set_state(state)
    assert env.get_state() == state
