"""Rollouts under torques that are given beforehand, beside the same flights under laws."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import drm_env
from drm_baselines.policies.perceptron import Perceptron

TORQUES = ("root_torque", "tip_torque")
SIGNALS = (*TORQUES, "slew_angle", "tip_deflection", "alpha", "beta_rate", "motor_power")
PLANTS: dict[str, dict[str, Any]] = {
    "thesis": {},
    "consistent": {"plant": "consistent", "modes": (2, 1)},
}


def assert_same(found: drm_env.Rollout, expected: drm_env.Rollout) -> None:
    """All metrics and signals to the bit."""
    assert list(found) == list(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    assert list(found.trajectories) == list(expected.trajectories)
    for name, values in expected.trajectories.items():
        np.testing.assert_array_equal(found.trajectories[name], values, err_msg=name)


def recorded(result: drm_env.Rollout) -> NDArray[np.float64]:
    """Torques that were flown at every sample, shape (scenarios, samples, 2)."""
    # the last row repeats the torques of the last sample
    return np.stack([result.trajectories[name][:, :-1] for name in TORQUES], axis=-1)


@pytest.mark.parametrize("rows", [0, 1, 7, 5000])
@pytest.mark.parametrize("plant", PLANTS)
def test_no_torques_are_the_open_loop_to_the_bit(plant: str, rows: int) -> None:
    scenarios = [{**PLANTS[plant], "mass_error": 0.1, "horizon": 4.0}] * 2
    expected = drm_env.rollout(scenarios, "none", signals=SIGNALS)
    zeros = np.zeros((2, rows, 2))
    assert_same(drm_env.rollout(scenarios, torques=zeros, signals=SIGNALS), expected)
    assert_same(drm_env.rollout(scenarios, torques=zeros, hold=13, signals=SIGNALS), expected)


@pytest.mark.parametrize("law", ["linear", "lyapunov"])
@pytest.mark.parametrize("plant", PLANTS)
def test_recorded_torques_of_a_law_reproduce_its_flight(plant: str, law: str) -> None:
    scenarios = [
        {**PLANTS[plant], "payload": {"mass": mass}, "mass_error": error, "horizon": 5.0}
        for mass, error in ((200.0, 0.15), (80.0, -0.1), (450.0, 0.05))
    ]
    expected = drm_env.rollout(scenarios, law, signals=SIGNALS)
    flown = drm_env.rollout(scenarios, torques=recorded(expected), signals=SIGNALS)
    for name, values in expected.trajectories.items():
        scale = np.abs(values).max()
        np.testing.assert_allclose(
            flown.trajectories[name], values, rtol=0.0, atol=1e-12 * scale, err_msg=name
        )
    for name, values in expected.items():
        if name != "saturation":  # what a law asked for beyond the limit is not recorded
            np.testing.assert_allclose(flown[name], values, rtol=1e-10, err_msg=name)


def test_rows_are_held_and_zero_follows_the_last() -> None:
    scenario = {"horizon": 0.1}
    torques = np.array([[[30.0, -2.0], [-50.0, 4.0], [10.0, 0.0]]])
    flown = drm_env.rollout([scenario], torques=torques, hold=7, signals=TORQUES)
    expected = np.zeros((50, 2))
    expected[:21] = np.repeat(torques[0], 7, axis=0)
    np.testing.assert_array_equal(recorded(flown)[0], expected)
    # held rows are repeated rows, and what follows the end of the manoeuvre is not looked at
    held = drm_env.rollout([scenario], torques=torques, hold=7, signals=SIGNALS)
    every = np.zeros((1, 80, 2))
    every[0, :21] = expected[:21]
    every[0, 50:] = 1e3
    assert_same(drm_env.rollout([scenario], torques=every, signals=SIGNALS), held)


def test_wheels_limit_lag_and_delay_the_torques() -> None:
    torques = np.full((1, 50, 2), [1e6, -1e6])
    limited = drm_env.rollout([{"horizon": 0.1}], torques=torques, signals=TORQUES)
    np.testing.assert_array_equal(recorded(limited)[0], np.full((50, 2), [100.0, -10.0]))
    assert limited["saturation"][0] == 1.0
    root = {"root_wheel": {"dead_time": 0.01, "lag": 0.05}}
    late = recorded(drm_env.rollout([{"horizon": 0.1, **root}], torques=torques, signals=TORQUES))[
        0, :, 0
    ]
    assert not late[:5].any()
    time = 0.002 * np.arange(45)
    np.testing.assert_allclose(late[5:], 100.0 * (1.0 - np.exp(-time / 0.05)), atol=1e-9)


@pytest.mark.filterwarnings("ignore:num_threads")
def test_each_manoeuvre_gets_its_torques_whatever_flies_beside_it() -> None:
    """Manoeuvres of several lengths and plants, so that lanes change hands at different times."""
    rng = np.random.default_rng(3)
    scenarios = [
        {
            **PLANTS["consistent" if index % 5 == 4 else "thesis"],
            "payload": {"mass": 60.0 + 20.0 * index},
            "horizon": 0.3 + 0.17 * (index % 4),
        }
        for index in range(21)
    ]
    torques = rng.uniform(-1.0, 1.0, (21, 40, 2)) * [100.0, 10.0]
    together = drm_env.rollout(scenarios, torques=torques, hold=9, signals=SIGNALS, num_threads=1)
    for threads in (2, 3, 7):
        again = drm_env.rollout(
            scenarios, torques=torques, hold=9, signals=SIGNALS, num_threads=threads
        )
        assert_same(again, together)
    for index, scenario in enumerate(scenarios):
        alone = drm_env.rollout(
            [scenario], torques=torques[index : index + 1], hold=9, signals=SIGNALS
        )
        for name, values in alone.items():
            np.testing.assert_array_equal(together[name][index], values[0], err_msg=name)
        for name, values in alone.trajectories.items():
            row = together.trajectories[name][index]
            np.testing.assert_array_equal(row[: values.shape[1]], values[0], err_msg=name)
            assert np.isnan(row[values.shape[1] :]).all()


def test_torques_of_any_layout_are_taken() -> None:
    scenario = {"horizon": 0.1}
    whole = np.random.default_rng(0).integers(-8, 8, (1, 60, 4))
    plain = np.ascontiguousarray(whole[:, ::2, ::2], dtype=np.float64)
    expected = drm_env.rollout([scenario], torques=plain, signals=SIGNALS)
    for torques in (
        whole[:, ::2, ::2],
        plain.tolist(),
        plain.astype(np.float32),
        np.asfortranarray(plain),
        plain[:, ::-1][:, ::-1],
    ):
        assert_same(drm_env.rollout([scenario], torques=torques, signals=SIGNALS), expected)
    read_only = plain.copy()
    read_only.flags.writeable = False
    assert_same(drm_env.rollout([scenario], torques=read_only, signals=SIGNALS), expected)
    nothing = drm_env.rollout([], torques=np.zeros((0, 3, 2)))
    assert nothing["tip_error_rms"].shape == (0,)


def network() -> drm_env.Network:
    sizes = [len(drm_env.observation_layout()), 4, 2]
    weights = [np.zeros((after, before), np.float32) for before, after in itertools.pairwise(sizes)]
    biases = [np.zeros(size, np.float32) for size in sizes[1:]]
    return Perceptron(weights=weights, biases=biases, activation="tanh", output="clip").engine()


def _holding(value: float) -> NDArray[np.float64]:
    torques = np.zeros((2, 3, 2))
    torques[1, 2, 1] = value
    return torques


GOOD = np.zeros((2, 3, 2))


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"torques": np.zeros((2, 3))}, r"torques must have shape \(2, rows, 2\), got \(2, 3\)"),
        ({"torques": np.zeros((1, 3, 2))}, r"torques .* \(2, rows, 2\), got \(1, 3, 2\)"),
        ({"torques": np.zeros((3, 3, 2))}, r"torques .* \(2, rows, 2\), got \(3, 3, 2\)"),
        ({"torques": np.zeros((2, 3, 3))}, r"torques .* \(2, rows, 2\), got \(2, 3, 3\)"),
        ({"torques": np.zeros((2, 2, 3, 2))}, r"torques .* got \(2, 2, 3, 2\)"),
        ({"torques": _holding(np.nan)}, "torques must be finite, got NaN"),
        ({"torques": _holding(np.inf)}, "torques must be finite, got inf"),
        ({"torques": _holding(-np.inf)}, "torques must be finite, got -inf"),
        ({"torques": GOOD, "hold": 0}, "hold must be a positive integer, got 0"),
        ({"torques": GOOD, "hold": -3}, "hold must be a positive integer, got -3"),
        ({"torques": GOOD, "hold": 2.0}, "hold must be a positive integer, got 2.0"),
        ({"torques": GOOD, "hold": True}, "hold must be a positive integer, got True"),
        ({"torques": GOOD, "hold": None}, "hold must be a positive integer, got None"),
        ({"torques": GOOD, "law": "linear"}, "give one of law, policy and torques"),
        ({"torques": GOOD, "law": "none"}, "give one of law, policy and torques"),
        ({"torques": GOOD, "policy": network}, "give one of law, policy and torques"),
        ({"torques": GOOD, "task": "slew"}, "task belongs to the task of a policy"),
        ({"torques": GOOD, "config": {}}, "config belongs to the task of a policy"),
        ({"torques": GOOD, "horizon": 3.0}, "horizon belongs to the task of a policy"),
        ({"torques": [[[1.0, 2.0]], [[1.0]]]}, "torques must be an array of numbers"),
        ({"torques": [[["a", "b"]]] * 2}, "torques must be an array of numbers"),
        ({"hold": 5}, "hold belongs to torques, got 5 without torques"),
        ({"law": "linear", "hold": "5"}, "hold belongs to torques, got '5' without torques"),
    ],
)
def test_torques_that_are_refused(options: dict[str, Any], match: str) -> None:
    def progress(*_: int) -> None:
        raise AssertionError("it flies")

    if "policy" in options:
        options = {**options, "policy": options["policy"]()}
    with pytest.raises(drm_env.ConfigError, match=match):
        drm_env.rollout([{}, {}], progress=progress, **options)


def test_a_scenario_that_is_wrong_is_named() -> None:
    with pytest.raises(drm_env.ConfigError, match=r"scenarios\[1\].payload.mass.*got -1"):
        drm_env.rollout([{}, {"payload": {"mass": -1.0}}], torques=GOOD)


def test_flights_that_diverge_end_alone() -> None:
    """A wheel without limit throws one arm away; those beside it are flown to the end."""
    wild = {"root_wheel": {"torque_limit": 1e20}, "horizon": 0.5}
    torques = np.zeros((3, 1, 2))
    torques[1] = 1e20
    with np.errstate(all="ignore"):
        flown = drm_env.rollout([wild] * 3, torques=torques, hold=250, num_threads=1)
    assert flown["diverged"].tolist() == [0.0, 1.0, 0.0]
    calm = drm_env.rollout([wild], "none")
    assert flown["tip_error_rms"][0] == flown["tip_error_rms"][2] == calm["tip_error_rms"][0]
