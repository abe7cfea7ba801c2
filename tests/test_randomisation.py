"""Each episode's parameters: drawn, reproducible by seed, reported in the info, and of effect.

The last test takes every parameter of the context in turn and shows that the motion or the
observation depends on it.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import drm_env

CONTEXT_NAMES = [name for name, option in drm_env.option_names().items() if option["randomizable"]]
STILL = np.zeros(2, np.float32)


def drawn(name: str, count: int, **options: Any) -> np.ndarray:
    """Values of one parameter in the first episodes of ``count`` seeds."""
    env = drm_env.DrmEnv(**options)
    return np.array([env.reset(seed=seed)[1][f"context/{name}"] for seed in range(count)])


def test_context_holds_every_randomizable_parameter() -> None:
    _, info = drm_env.DrmEnv().reset(seed=0)
    found = {key for key in info if key.startswith("context/")}
    assert found == {f"context/{name}" for name in CONTEXT_NAMES}


def test_defaults_of_slew_are_drawn_from_their_ranges() -> None:
    env = drm_env.DrmEnv()
    contexts = [env.reset(seed=seed)[1] for seed in range(400)]
    mass = np.array([context["context/payload_mass"] for context in contexts])
    error = np.array([context["context/mass_error"] for context in contexts])
    reported = np.array([context["context/reported_payload_mass"] for context in contexts])
    assert 50 <= mass.min() < 60 and 490 < mass.max() <= 500
    assert -0.15 <= error.min() < -0.14 and 0.14 < error.max() <= 0.15
    np.testing.assert_allclose(reported, mass * (1 + error), rtol=1e-12)
    assert abs(np.corrcoef(mass, error)[0, 1]) < 0.15


def test_thesis_task_has_nothing_random() -> None:
    env = drm_env.DrmEnv(task="slew_thesis")
    assert env.reset(seed=0)[1] == env.reset(seed=1)[1]


def test_uniform_has_the_moments_of_a_uniform() -> None:
    values = drawn("slew_angle", 2000, slew_angle=(0.4, 1.0))
    assert values.min() >= 0.4 and values.max() <= 1.0
    # three standard errors of the mean and of the variance
    assert values.mean() == pytest.approx(0.7, abs=3 * 0.6 / np.sqrt(12 * 2000))
    assert values.var() == pytest.approx(0.03, abs=3 * 0.03 * np.sqrt(0.8 / 2000))


def test_log_uniform_has_a_uniform_logarithm() -> None:
    values = np.log(drawn("payload_mass", 2000, payload_mass=drm_env.LogUniform(5.0, 500.0)))
    low, high = np.log(5.0), np.log(500.0)
    assert low <= values.min() and values.max() <= high
    assert values.mean() == pytest.approx(
        (low + high) / 2, abs=3 * (high - low) / np.sqrt(12 * 2000)
    )


def test_normal_has_its_moments_and_keeps_its_limits() -> None:
    free = drawn("payload_mass", 2000, payload_mass=drm_env.Normal(200.0, 20.0))
    assert free.mean() == pytest.approx(200.0, abs=3 * 20 / np.sqrt(2000))
    assert free.std() == pytest.approx(20.0, abs=3 * 20 / np.sqrt(4000))
    cut = drawn("payload_mass", 500, payload_mass=drm_env.Normal(200.0, 20.0, low=190.0))
    assert cut.min() >= 190.0
    assert cut.max() > 230.0


def test_choices_are_equally_likely() -> None:
    values = drawn("payload_mass", 1500, payload_mass=drm_env.Choices((100.0, 150.0, 200.0)))
    counts = [int((values == choice).sum()) for choice in (100.0, 150.0, 200.0)]
    assert sum(counts) == 1500
    assert min(counts) > 500 - 3 * np.sqrt(1500 * 2 / 9)


def test_choices_of_names() -> None:
    env = drm_env.DrmEnv(deployment_mode=["coincident", "none"])
    modes = set()
    for seed in range(20):
        env.reset(seed=seed)
        modes.add(env.scenario()["deployment"]["mode"])
    assert modes == {"coincident", "none"}


def test_draws_of_one_parameter_do_not_move_those_of_another() -> None:
    for name in ("payload_mass", "mass_error"):
        plain = drawn(name, 20)
        for other in ({"link2_bending_stiffness": (2.9e6, 3.1e6)}, {"payload_length": (0.5, 1.0)}):
            np.testing.assert_array_equal(plain, drawn(name, 20, **other))


def test_value_given_in_any_way_is_no_longer_drawn() -> None:
    configuration = {"scenario": {"payload": {"mass": 222.0}, "mass_error": 0.05}}
    for options in ({"payload_mass": 222.0, "mass_error": 0.05}, {"config": configuration}):
        for name, value in (("payload_mass", 222.0), ("mass_error", 0.05)):
            assert set(drawn(name, 5, **options).tolist()) == {value}
    both = {**configuration, "randomize": {"payload_mass": [60.0, 70.0]}}
    assert 60.0 <= drawn("payload_mass", 20, config=both).max() <= 70.0


def test_draws_survive_autoreset_and_equal_the_single_environments() -> None:
    vector = gym.make_vec(
        "drm_env/Slew-v0", num_envs=4, horizon=0.03, autoreset_mode=AutoresetMode.SAME_STEP
    )
    _, info = vector.reset(seed=50)
    seen = [info["context/payload_mass"].copy()]
    for _ in range(9):
        _, _, terminated, truncated, info = vector.step(np.zeros((4, 2), np.float32))
        if (terminated | truncated).all():
            seen.append(info["context/payload_mass"].copy())
    assert len(seen) == 4
    assert len(set(np.concatenate(seen).tolist())) == 16
    for index in range(4):
        env = drm_env.DrmEnv(horizon=0.03)
        masses = [env.reset(seed=50 + index)[1]["context/payload_mass"]]
        masses += [env.reset()[1]["context/payload_mass"] for _ in range(3)]
        assert masses == [values[index] for values in seen]


def test_options_of_reset_hold_for_one_episode() -> None:
    env = drm_env.DrmEnv()
    plain = [env.reset(seed=4)[1], env.reset()[1], env.reset()[1]]
    _, first = env.reset(seed=4, options={"payload_mass": 123.0})
    assert first["context/payload_mass"] == 123.0
    assert first["context/mass_error"] == plain[0]["context/mass_error"]
    # neither the stream nor the next episodes notice
    assert env.reset()[1] == plain[1]
    assert env.reset()[1] == plain[2]


def test_context_holds_until_changed() -> None:
    env = drm_env.DrmEnv()
    plain = [env.reset(seed=4)[1], env.reset()[1], env.reset()[1]]
    env.reset(seed=4)
    env.set_context(payload_mass=123.0)
    assert env.reset()[1]["context/payload_mass"] == 123.0
    _, both = env.reset(options={"payload_mass": 77.0, "slew_angle": 0.5})
    assert (both["context/payload_mass"], both["context/slew_angle"]) == (77.0, 0.5)
    env.set_context(slew_angle=0.6)
    _, changed = env.reset(seed=4)
    assert changed["context/slew_angle"] == 0.6
    assert changed["context/payload_mass"] == plain[0]["context/payload_mass"]
    env.set_context()
    assert [env.reset(seed=4)[1], env.reset()[1], env.reset()[1]] == plain


def test_sampled_scenarios_are_those_of_the_environments() -> None:
    options: dict[str, Any] = {"payload_mass": (60.0, 400.0), "slew_angle": (0.5, 1.0)}
    scenarios = drm_env.sample_scenarios(seed=7, n=5, **options)
    env = drm_env.DrmEnv(**options)
    for index, scenario in enumerate(scenarios):
        _, info = env.reset(seed=7 + index)
        assert env.scenario() == scenario
        assert scenario["payload"]["mass"] == info["context/payload_mass"]


def test_environment_without_action_flies_the_simulated_open_loop() -> None:
    """The same scenario through the environment and through `simulate`."""
    env = drm_env.DrmEnv(task="slew", horizon=3.0)
    env.reset(seed=3)
    scenario = env.scenario()
    trajectory = drm_env.simulate(scenario, law="none")
    angles = []
    truncated = False
    while not truncated:
        _, _, _, truncated, info = env.step(STILL)
        angles.append(env.signals()["slew_angle"])
    every = round(env.control_period / (trajectory["time"][1] - trajectory["time"][0]))
    np.testing.assert_array_equal(angles, trajectory["slew_angle"][every::every])
    for name in ("tip_error_rms", "peak_deflection", "slew_energy", "residual_energy"):
        assert info[f"metrics/{name}"] == trajectory.metrics[name]


def test_payload_in_the_observation() -> None:
    values = {}
    for mode in ("reported", "true", "hidden"):
        env = drm_env.DrmEnv(observe_payload=mode)
        observation, info = env.reset(seed=2)
        index = [entry.name for entry in env.observation_layout].index("payload_mass")
        values[mode] = observation[index] * env.observation_layout[index].scale
    assert values["reported"] == pytest.approx(info["context/reported_payload_mass"])
    assert values["true"] == pytest.approx(info["context/payload_mass"])
    assert values["hidden"] == 0.0


TABLE_2_7 = np.array([(0, 0, 0), (50, 0.1, 0.1), (200, 1, 0.5), (350, 1.5, 0.75), (500, 2, 1)])
"""Mass (kg), length and width (m) of the thesis' payloads, after none."""


def test_dimensions_that_follow_from_the_mass_are_reported_for_the_reported_mass() -> None:
    """Those of the true mass would tell it to whoever looks at them."""
    env = drm_env.DrmEnv()
    for seed in range(50):
        _, info = env.reset(seed=seed)
        for column, name in enumerate(("length", "width"), start=1):
            for kind in ("payload", "reported_payload"):
                mass = info[f"context/{kind}_mass"]
                expected = np.interp(mass, TABLE_2_7[:, 0], TABLE_2_7[:, column])
                assert info[f"context/{kind}_{name}"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("mode", ["coincident", "force_limited"])
def test_payloads_that_are_reported_alike_look_alike(mode: str) -> None:
    """Nothing that is observed, planned or commanded before anything moves tells the true mass."""
    env = drm_env.DrmEnv(mass_error=0.0, deployment_mode=mode)
    seen = []
    for mass in (60.0, 180.0, 490.0):
        options = {"payload_mass": mass, "reported_payload_mass": 240.0}
        observation, info = env.reset(seed=1, options=options)
        assert info["context/payload_mass"] == mass
        flight = drm_env.simulate({**env.scenario(), "horizon": 8.0})
        seen.append((observation, *(flight[name] for name in ("slew_torque", "extension"))))
    for other in seen[1:]:
        for one, another in zip(seen[0], other, strict=True):
            np.testing.assert_array_equal(one, another)


def test_dimensions_that_are_given_are_reported_as_given() -> None:
    env = drm_env.DrmEnv(payload_length=1.3)
    _, info = env.reset(seed=0)
    assert info["context/reported_payload_length"] == 1.3
    width = np.interp(info["context/reported_payload_mass"], TABLE_2_7[:, 0], TABLE_2_7[:, 2])
    assert info["context/reported_payload_width"] == pytest.approx(width, rel=1e-12)
    _, info = env.reset(seed=0, options={"payload_width": 0.4, "reported_payload_length": 1.1})
    assert info["context/payload_length"] == 1.3
    assert info["context/reported_payload_length"] == 1.1
    assert info["context/reported_payload_width"] == 0.4


def test_an_exact_report_is_the_true_payload() -> None:
    env = drm_env.DrmEnv(mass_error=0.0)
    for seed in range(20):
        _, info = env.reset(seed=seed)
        for name in ("mass", "length", "width"):
            assert info[f"context/reported_payload_{name}"] == info[f"context/payload_{name}"]


def test_dimensions_of_a_payload_that_is_not_drawn_are_known() -> None:
    """As in the thesis: there is nothing to tell, whatever mass is reported."""
    for env in (
        drm_env.DrmEnv(task="slew_thesis", mass_error=0.15),
        drm_env.DrmEnv(payload_mass=200.0),
    ):
        _, info = env.reset(seed=0)
        assert info["context/reported_payload_mass"] != 200.0
        assert info["context/reported_payload_length"] == 1.0
        assert info["context/reported_payload_width"] == 0.5
    angle = drm_env.simulate({"mass_error": 0.15}).metrics["peak_slew_angle"]
    assert np.degrees(angle) == pytest.approx(56.18, abs=0.01)


# What a parameter is changed to, and what else has to hold for it to matter.
CHANGES: dict[str, tuple[Any, dict[str, Any]]] = {
    "payload_mass": (150.0, {}),
    "payload_length": (1.3, {}),
    "payload_width": (0.9, {}),
    "payload_inertia": ("slender", {}),
    "mass_error": (0.1, {}),
    "reported_payload_mass": (230.0, {}),
    "reported_payload_length": (1.4, {}),
    "reported_payload_width": (0.9, {}),
    "slew_angle": (0.7, {}),
    "slew_max_accel": (0.03, {}),
    "slew_profile": ("min_energy", {}),
    "slew_smoothing": (0.05, {}),
    "deployment_start": (2.0, {}),
    "deployment_end": (6.0, {}),
    "deployment_mode": ("none", {}),
    "deployment_force": (300.0, {"deployment_mode": "force_limited"}),
    "initial_slew_angle": (0.01, {}),
    "initial_slew_rate": (0.01, {}),
    "initial_alpha": (0.001, {}),
    "initial_alpha_rate": (0.01, {}),
    "initial_beta": (0.001, {}),
    "initial_beta_rate": (0.01, {}),
    "root_torque_limit": (50.0, {}),
    "root_momentum_limit": (1.0, {}),
    "root_lag": (0.05, {}),
    "root_dead_time": (0.02, {}),
    "tip_torque_limit": (5.0, {}),
    "tip_momentum_limit": (0.1, {}),
    "tip_lag": (0.05, {}),
    "tip_dead_time": (0.02, {}),
    "angle_noise": (1e-3, {}),
    "rate_noise": (1e-3, {}),
    "deflection_noise": (1e-3, {}),
    "deflection_rate_noise": (1e-3, {}),
    "angle_resolution": (1e-2, {}),
    "rate_resolution": (1e-2, {}),
    "deflection_resolution": (1e-2, {}),
    "deflection_rate_resolution": (1e-2, {}),
    "sensor_delay": (0.02, {}),
    "structural_damping": (1e-3, {}),
    "damping_ratio": (0.02, {}),
    "payload_offset": (0.3, {}),
    "link1_length": (6.5, {"deployment_start": 2.0}),
    "link1_bending_stiffness": (2.0e6, {}),
    "link1_mass_per_length": (12.0, {}),
    "link2_length": (8.5, {"deployment_start": 2.5}),
    "link2_bending_stiffness": (2.0e6, {}),
    "link2_mass_per_length": (8.0, {}),
    "angle_bias": (1e-3, {}),
    "rate_bias": (1e-3, {}),
    "deflection_bias": (1e-3, {}),
    "deflection_rate_bias": (1e-3, {}),
    "tip_rate_bias": (1e-3, {}),
    "link1_gauge_bias": (20.0, {}),
    "link2_gauge_bias": (20.0, {}),
    "tip_accelerometer_bias": (0.02, {}),
}
OF_THE_CONSISTENT_PLANT = {"damping_ratio", "payload_offset"}
ONLY_MEASURED = {
    "angle_noise",
    "rate_noise",
    "deflection_noise",
    "deflection_rate_noise",
    "angle_resolution",
    "rate_resolution",
    "deflection_resolution",
    "deflection_rate_resolution",
    "sensor_delay",
    *(name for name in CHANGES if name.endswith("_bias")),
}


def plant_with(name: str) -> str:
    """The plant that has a parameter of the context."""
    return "consistent" if name in OF_THE_CONSISTENT_PLANT else "thesis"


def flown(options: dict[str, Any], plant: Any) -> tuple[np.ndarray, np.ndarray]:
    """Motion and observations of half a second with full wheel torques, from option to state."""
    env = drm_env.DrmEnv(
        task="slew_thesis", control_period=0.01, horizon=0.5, plant=plant,
        observe_sensors=["link1_gauge", "link2_gauge", "tip_accelerometer", "tip_gyro"],
    )  # fmt: skip
    observation, _ = env.reset(seed=1, options=options)
    observations, motion = [observation], []
    for index in range(50):
        observation = env.step(np.array([1.0, 1.0 if index < 25 else -1.0], np.float32))[0]
        observations.append(observation)
        signals = env.signals()
        motion.append([signals[name] for name in ("slew_angle", "alpha", "beta")])
    return np.array(motion), np.array(observations)


@pytest.mark.parametrize("name", CONTEXT_NAMES)
def test_every_parameter_of_the_context_has_an_effect(name: str) -> None:
    value, also = CHANGES[name]
    plant = plant_with(name)
    motion, observations = flown(also, plant)
    changed_motion, changed_observations = flown({**also, name: value}, plant)
    if name in ONLY_MEASURED:
        np.testing.assert_array_equal(changed_motion, motion)
        assert np.abs(changed_observations - observations).max() > 1e-6
    else:
        difference = np.abs(changed_motion - motion).max(axis=0)
        assert difference.max() > 1e-7, difference


def test_every_change_is_reported_in_the_context() -> None:
    assert set(CHANGES) == set(CONTEXT_NAMES)
    envs: dict[str, Any] = {
        plant: drm_env.DrmEnv(config={"scenario": {"plant": plant}}, task="slew_thesis")
        for plant in ("thesis", "consistent")
    }
    for name, (value, also) in CHANGES.items():
        env = envs[plant_with(name)]
        _, plain = env.reset(seed=1)
        _, info = env.reset(seed=1, options={**also, name: value})
        if isinstance(value, float):
            assert info[f"context/{name}"] == pytest.approx(value, rel=1e-12), name
        else:
            assert info[f"context/{name}"] != plain[f"context/{name}"], name
