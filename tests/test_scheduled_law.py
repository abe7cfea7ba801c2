"""The scheduled law: its formula, its kinship with the linear law, and where it can be used."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import drm_env
from drm_env._config import EnvConfig, ScheduledLaw, ScheduledWheel

GAINS = ("angle_gain", "rate_gain", "deflection_gain", "deflection_rate_gain")
SIGNALS = ("root_torque", "tip_torque", "slew_angle", "tip_deflection")
# the columns that the gains multiply
STATE = ("slew_error", "slew_error_rate", "link2_deflection", "link2_deflection_rate")


def constant(value: float) -> list[list[float]]:
    """The polynomial of a gain that depends on nothing."""
    table = [[0.0] * 4 for _ in range(3)]
    table[0][0] = value
    return table


def like_linear(rate: float = 8e4, angle: float = 8e3, tip: float = 500.0) -> dict[str, Any]:
    """The linear law: its tip gain multiplies beta', half the rate that this law is told."""
    return {
        "name": "scheduled",
        "root": {"rate_gain": constant(rate), "angle_gain": constant(angle)},
        "tip": {"deflection_rate_gain": constant(tip / 2.0)},
    }


def linear(rate: float = 8e4, angle: float = 8e3, tip: float = 500.0) -> dict[str, Any]:
    return {
        "name": "linear",
        "root": {"rate_gain": rate, "angle_gain": angle},
        "tip": {"rate_gain": tip},
    }


def scheduled(seed: int = 0) -> dict[str, Any]:
    """Gains that move with both: moderate, so that the arm stays calm."""
    rng = np.random.default_rng(seed)
    sizes = {"root": (2e3, 2e4, 200.0, 200.0), "tip": (20.0, 20.0, 20.0, 100.0)}
    law: dict[str, Any] = {"name": "scheduled"}
    for wheel, scales in sizes.items():
        law[wheel] = {
            name: (scale * rng.uniform(0.0, 1.0, (3, 4))).tolist()
            for name, scale in zip(GAINS, scales, strict=True)
        }
    return law


def columns() -> dict[str, int]:
    return {name: index for index, name in enumerate(drm_env.ControlLaw.MEASUREMENTS)}


def rows_at(mass: NDArray[np.float64], extension: NDArray[np.float64]) -> NDArray[np.float64]:
    """Measurements with random outputs."""
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(mass.size, len(columns()))) * 0.1
    place = columns()
    rows[:, place["payload_mass"]], rows[:, place["extension"]] = mass, extension
    return np.asarray(rows)


def torques_of(law: Any, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    control = drm_env.ControlLaw(law)
    start = np.ones(len(rows), bool)
    return control.torques(rows, control.initial_state(len(rows)), start)[0]


def test_gains_are_polynomials_of_mass_and_extension() -> None:
    """Entry (i, j) multiplies (mass / 500 kg)^i (extension / 8 m)^j, each wheel by itself."""
    law = scheduled()
    rng = np.random.default_rng(2)
    mass, extension = rng.uniform(0.0, 500.0, 200), rng.uniform(0.5, 8.0, 200)
    rows = rows_at(mass, extension)
    powers = (mass[:, None, None] / 500.0) ** np.arange(3)[:, None] * (
        extension[:, None, None] / 8.0
    ) ** np.arange(4)
    found = torques_of(law, rows)
    place = columns()
    for index, wheel in enumerate(("root", "tip")):
        expected = np.zeros(200)
        for name, measured in zip(GAINS, STATE, strict=True):
            gain = (powers * np.array(law[wheel][name])).sum(axis=(1, 2))
            expected -= gain * rows[:, place[measured]]
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found[:, index], expected, rtol=0.0, atol=1e-13 * scale)


def test_masses_beyond_the_scale_count_as_the_scale() -> None:
    """A polynomial says nothing beyond the masses that it was fitted to."""
    mass = np.array([500.0, 501.0, 3000.0])
    rows = np.repeat(rows_at(mass[:1], np.array([4.0])), 3, axis=0)
    rows[:, columns()["payload_mass"]] = mass
    found = torques_of(scheduled(), rows)
    np.testing.assert_array_equal(found, np.repeat(found[:1], 3, axis=0))


@pytest.mark.parametrize("wheel", ["root", "tip"])
@pytest.mark.parametrize("gain", range(4))
@pytest.mark.parametrize("entry", [(i, j) for i in range(3) for j in range(4)])
def test_each_coefficient_is_where_it_belongs(
    wheel: str, gain: int, entry: tuple[int, int]
) -> None:
    table = np.zeros((3, 4))
    table[entry] = 3.0
    mass, extension = np.array([250.0, 500.0, 125.0]), np.array([4.0, 8.0, 2.0])
    rows = rows_at(mass, extension)
    found = torques_of({"name": "scheduled", wheel: {GAINS[gain]: table.tolist()}}, rows)
    at = np.array([0.5, 1.0, 0.25])
    expected = -3.0 * at ** sum(entry) * rows[:, columns()[STATE[gain]]]
    index = ("root", "tip").index(wheel)
    np.testing.assert_allclose(found[:, index], expected, rtol=1e-14)
    np.testing.assert_array_equal(found[:, 1 - index], 0.0)


def test_without_gains_it_is_the_open_loop() -> None:
    rows = rows_at(np.array([200.0, 300.0]), np.array([2.0, 3.0]))
    for law in ("scheduled", {"name": "scheduled"}, {"name": "scheduled", "root": {}, "tip": None}):
        np.testing.assert_array_equal(torques_of(law, rows), 0.0)
    flown, still = (drm_env.simulate({"horizon": 2.0}, law) for law in ("scheduled", "none"))
    for name in SIGNALS:
        np.testing.assert_array_equal(flown[name], still[name])


@pytest.mark.parametrize("off", ["root", "tip"])
def test_a_wheel_that_is_null_is_off(off: str) -> None:
    law = {**scheduled(), off: None}
    flown = drm_env.simulate({"horizon": 3.0, "mass_error": 0.1}, law)
    other = {"root": "tip", "tip": "root"}[off]
    assert not flown[f"{off}_torque"].any()
    assert np.abs(flown[f"{other}_torque"]).max() > 0.01


@given(
    rate=st.floats(0.0, 1e5),
    angle=st.floats(0.0, 1e4),
    tip=st.floats(0.0, 600.0),
    mass=st.floats(50.0, 500.0),
    extension=st.floats(1.0, 8.0),
)
@settings(max_examples=50, deadline=None)
def test_constant_gains_are_the_linear_law(
    rate: float, angle: float, tip: float, mass: float, extension: float
) -> None:
    rows = rows_at(np.full(8, mass), np.full(8, extension))
    expected = torques_of(linear(rate, angle, tip), rows)
    found = torques_of(like_linear(rate, angle, tip), rows)
    scale = np.abs(expected).max() + 1e-300
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-14 * scale)


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_constant_gains_fly_as_the_linear_law(plant: str) -> None:
    """Lower gains than the thesis': those keep saturating the wheel, which amplifies rounding."""
    gains = {"rate": 2e4, "angle": 2e3, "tip": 200.0}
    scenarios = [
        {"plant": plant, "modes": (1, 2), "payload": {"mass": mass}, "mass_error": error,
         "horizon": 8.0}
        for mass, error in ((200.0, 0.0), (450.0, 0.1), (60.0, -0.15))
    ]  # fmt: skip
    flown, expected = (
        drm_env.rollout(scenarios, law, signals=SIGNALS)
        for law in (like_linear(**gains), linear(**gains))
    )
    for name in SIGNALS:
        values = expected.trajectories[name]
        scale = np.abs(values).max()
        np.testing.assert_allclose(
            flown.trajectories[name], values, rtol=0.0, atol=1e-9 * scale, err_msg=name
        )


def test_it_is_told_the_reported_mass() -> None:
    """Gains that depend on the mass follow the report, not the truth."""
    table = np.zeros((3, 4))
    table[1, 0] = 1e4
    law = {"name": "scheduled", "root": {"angle_gain": table.tolist()}}
    scenario = {
        "payload": {"mass": 200.0, "length": 1.0, "width": 0.5},
        "reported_payload": {"mass": 300.0},
        "initial": {"slew_angle": 1e-3},
        "horizon": 0.1,
    }
    flown = drm_env.simulate(scenario, law)
    assert flown["root_torque"][0] == pytest.approx(-1e4 * 0.6 * 1e-3, rel=1e-12)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("wheel", ["root", "tip"])
@pytest.mark.parametrize("name", GAINS)
def test_gains_that_are_not_finite_are_refused(wheel: str, name: str, value: float) -> None:
    law: dict[str, Any] = {"name": "scheduled", wheel: {name: constant(1.0)}}
    law[wheel][name][2][3] = value
    match = rf"law\.{wheel}\.{name}\[2\]\[3\] must be finite, got -?(nan|inf)"
    with pytest.raises(drm_env.ConfigError, match=match):
        drm_env.simulate({}, law)
    with pytest.raises(drm_env.ConfigError, match=match):
        drm_env.ControlLaw(law)
    with pytest.raises(drm_env.ConfigError, match=rf"inner_{match}"):
        drm_env.DrmEnv(inner_law=law)


@pytest.mark.parametrize(
    ("wheel", "match"),
    [
        ({"angle_gain": [[0.0] * 4] * 2}, "invalid length 2, expected an array of length 3"),
        ({"angle_gain": [[0.0] * 4] * 4}, "array of length 3|3 elements|fewer elements"),
        ({"angle_gain": [[0.0] * 3] * 3}, "invalid length 3, expected an array of length 4"),
        ({"angle_gain": 3.0}, "expected an array of length 3"),
        ({"angle_gain": None}, "null"),
        ({"angle_gain": [["a"] * 4] * 3}, "string"),
        ({"angle": constant(1.0)}, "unknown field `angle`"),
    ],
)
def test_tables_of_another_form_are_refused(wheel: dict[str, Any], match: str) -> None:
    for law in ({"name": "scheduled", "root": wheel}, {"name": "scheduled", "tip": wheel}):
        with pytest.raises(drm_env.ConfigError, match=match):
            drm_env.simulate({}, law)
    with pytest.raises(drm_env.ConfigError, match="unknown field `knee`"):
        drm_env.simulate({}, {"name": "scheduled", "knee": wheel})


def as_tuples(table: list[list[float]]) -> Any:
    return tuple(tuple(row) for row in table)


def dataclass_of(law: dict[str, Any]) -> ScheduledLaw:
    wheels = {
        wheel: ScheduledWheel(**{name: as_tuples(law[wheel][name]) for name in GAINS})
        for wheel in ("root", "tip")
    }
    return ScheduledLaw(**wheels)


def test_dataclasses_and_json_say_the_same() -> None:
    law = scheduled()
    made = dataclass_of(law)
    assert made.name == "scheduled"
    rows = rows_at(np.array([100.0, 400.0]), np.array([2.0, 7.0]))
    np.testing.assert_array_equal(torques_of(made, rows), torques_of(law, rows))
    again = json.loads(json.dumps(dataclasses.asdict(made)))
    assert again == law
    np.testing.assert_array_equal(torques_of(again, rows), torques_of(law, rows))
    # defaults: both wheels off, no gain
    assert ScheduledLaw() == ScheduledLaw(root=None, tip=None)
    zero = as_tuples([[0.0] * 4] * 3)
    assert ScheduledWheel() == ScheduledWheel(**dict.fromkeys(GAINS, zero))
    hash(made)


def test_configurations_keep_it() -> None:
    law = scheduled()
    for given_law in (law, dataclass_of(law)):
        env = drm_env.DrmEnv(inner_law=given_law)
        stored = json.loads(env.config_json)["task"]["inner_law"]
        assert stored == law
        config = env.config
        assert isinstance(config, EnvConfig)
        assert isinstance(config.task.inner_law, ScheduledLaw)
        assert json.loads(json.dumps(dataclasses.asdict(config.task.inner_law))) == law
        assert drm_env.DrmEnv(config=config).config_json == env.config_json


def test_an_environment_above_it_flies_as_simulated() -> None:
    law = scheduled()
    env = drm_env.DrmEnv(inner_law=law, horizon=4.0)
    env.reset(seed=3)
    expected = drm_env.simulate(env.scenario(), law)
    every = round(env.control_period / 0.002)
    rows = []
    truncated = False
    while not truncated:
        _, _, _, truncated, info = env.step(np.zeros(2, np.float32))
        rows.append([env.signals()[name] for name in ("slew_angle", "tip_deflection")])
    for name, values in zip(("slew_angle", "tip_deflection"), np.array(rows).T, strict=True):
        np.testing.assert_array_equal(values, expected[name][every::every], err_msg=name)
    for name in ("tip_error_rms", "peak_deflection", "wheel_effort"):
        assert info[f"metrics/{name}"] == expected.metrics[name]
    assert expected.metrics["wheel_effort"] > 0.0


def test_vector_environments_equal_single_ones() -> None:
    options: dict[str, Any] = {"inner_law": scheduled(), "horizon": 1.0, "angle_noise": 1e-4}
    vector = gym.make_vec("drm_env/Slew-v0", num_envs=5, **options)
    single = [drm_env.DrmEnv(**options) for _ in range(5)]
    observations, _ = vector.reset(seed=11)
    for index, env in enumerate(single):
        np.testing.assert_array_equal(env.reset(seed=11 + index)[0], observations[index])
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (40, 5, 2)).astype(np.float32)
    for step in actions:
        observations, rewards, *_ = vector.step(step)
        for index, env in enumerate(single):
            observation, reward, *_ = env.step(step[index])
            np.testing.assert_array_equal(observation, observations[index])
            assert reward == rewards[index]


@pytest.mark.filterwarnings("ignore:num_threads")
def test_rows_and_threads_do_not_matter() -> None:
    law = scheduled()
    scenarios = drm_env.sample_scenarios(seed=5, n=13, horizon=2.0)
    one, three = (drm_env.rollout(scenarios, law, num_threads=n) for n in (1, 3))
    for name, values in one.items():
        np.testing.assert_array_equal(three[name], values, err_msg=name)
        for index in (0, 7, 12):
            alone = drm_env.rollout(scenarios[index : index + 1], law)
            np.testing.assert_array_equal(alone[name][0], values[index], err_msg=name)
