"""The consistent plant wherever the thesis plant flies: environments, batches, snapshots, rollouts.

Contracts are those of the other tests of environments; the physics is held against what follows
without a flight: momentum, frequencies of beam finite elements, the decay of a damped mode.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import drm_env

ID = "drm_env/Slew-v0"
PLANT: dict[str, Any] = {"plant": "consistent", "modes": (4, 4)}
SHORT: dict[str, Any] = {**PLANT, "horizon": 0.12}
STAGGERED: dict[str, Any] = {
    **PLANT,
    "horizon": 0.3,
    "initial_beta": (0.0, 0.02),
    "limits": {"tip_deflection": 0.03},
}
PAYLOADS = {
    "P0": {"mass": 50.0, "length": 0.1, "width": 0.1},
    "P1": {"mass": 200.0, "length": 1.0, "width": 0.5},
    "P3": {"mass": 500.0, "length": 2.0, "width": 1.0},
}


def released(length: float, **scenario: Any) -> dict[str, Any]:
    """An arm of constant length at rest, link 2 let go from a deflection of 2 mm."""
    return {
        "plant": "consistent",
        "slew": {"angle": 0.0},
        "deployment": {"start": length, "end": length, "mode": "none"},
        "initial": {"beta": 1e-3},
        **scenario,
    }


def actions(count: int, *shape: int, seed: int = 5) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (count, *shape)).astype(np.float32)


# What a batch says of episodes that have ended alone.
WHOLE_EPISODE = ("metrics/", "diverged", "is_success")


def assert_same(actual: Any, expected: Any, path: str = "") -> None:
    """The same keys, types and bits."""
    if isinstance(expected, Mapping):
        assert actual.keys() == expected.keys(), path
        for key in expected:
            where, held = f"{path}/{key}", actual.get(f"_{key}")
            if key.startswith(WHOLE_EPISODE) and held is not None:
                assert (held <= expected[f"_{key}"]).all(), where
                assert_same(actual[key][held], expected[key][held], where)
            elif not key.removeprefix("_").startswith(WHOLE_EPISODE):
                assert_same(actual[key], expected[key], where)
        return
    actual, expected = np.asarray(actual), np.asarray(expected)
    assert (actual.dtype, actual.shape) == (expected.dtype, expected.shape), path
    if actual.dtype == object:
        for one, other in zip(actual.flat, expected.flat, strict=True):
            assert (one is None) == (other is None), path
            if other is not None:
                assert_same(one, other, path)
        return
    np.testing.assert_array_equal(actual, expected, err_msg=path)


# Environments


def test_check_env_of_gymnasium_has_nothing_to_say(env_id: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        check_env(gym.make(env_id, **PLANT, horizon=0.3).unwrapped)


def test_check_env_of_stable_baselines3_has_nothing_to_say(env_id: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        checker.check_env(gym.make(env_id, **PLANT, horizon=0.3).unwrapped, warn=True)


def test_the_plant_matters_from_the_first_action() -> None:
    observed = []
    for plant in ("thesis", "consistent"):
        env = gym.make(ID, plant=plant, horizon=1.0)
        env.reset(seed=1)
        observed.append([env.step(action)[0] for action in actions(20, 2)])
    assert (np.array(observed[0][-1]) != np.array(observed[1][-1])).any()


def test_numbers_of_modes_matter() -> None:
    ends = []
    for modes in ((1, 1), (2, 2), (4, 4), (4, 5)):
        env = gym.make(ID, plant="consistent", modes=modes, horizon=1.0)
        env.reset(seed=1)
        ends.append([env.step(action)[0] for action in actions(50, 2)][-1].tobytes())
    assert len(set(ends)) == len(ends)


@pytest.mark.parametrize(
    "modes", [(4, 5), [4, 5], np.array([4, 5]), (np.int64(4), np.int32(5))], ids=repr
)
def test_modes_are_numbers_and_no_distribution(modes: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        env = drm_env.DrmEnv(plant="consistent", modes=modes)
    assert tuple(env.config.scenario.modes) == (4, 5)
    assert not drm_env.option_names()["modes"]["randomizable"]
    assert "context/modes" not in env.reset(seed=0)[1]
    again = drm_env.DrmEnv(config=env.config)
    assert again.config_json == env.config_json


def test_specification_makes_the_same_environment_again() -> None:
    env = gym.make(ID, **SHORT)
    assert env.spec is not None
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    for one in (env, again):
        one.reset(seed=4)
    for action in actions(12, 2):
        left, right = env.step(action), again.step(action)
        assert left[0].tobytes() == right[0].tobytes()
        assert left[1] == right[1]


@pytest.mark.parametrize(
    ("modes", "words"),
    [
        ((0, 4), r"modes .*\[0, 4\]"),
        ((4, 0), r"modes .*\[4, 0\]"),
        ((8, 9), r"modes .*\[8, 9\]"),
        ((40, 40), r"modes .*\[40, 40\]"),
        ((4,), r"modes.*length 1"),
        ((4, 4, 4), r"modes.*length 3"),
        (4, r"modes.*4"),
        ("four", r"modes.*four"),
        ((2.5, 2), r"modes\[0\].*2\.5"),
        ((True, 2), r"modes\[0\].*true"),
        ((-1, 3), r"modes\[0\].*-1"),
        (None, r"modes.*null"),
        ((math.nan, 2), r"modes\[0\].*nan"),
        (drm_env.Uniform(1, 4), r"modes"),
    ],
    ids=repr,
)
def test_impossible_modes_are_refused_with_name_and_value(modes: Any, words: str) -> None:
    for make in (
        lambda: drm_env.DrmEnv(plant="consistent", modes=modes),
        lambda: drm_env.simulate({"plant": "consistent", "modes": modes}),
    ):
        with pytest.raises(drm_env.ConfigError, match=words):
            make()


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"plant": "elastic"}, r"plant.*elastic"),
        ({"spectral_radius": -0.1}, r"spectral_radius.*-0\.1"),
        ({"spectral_radius": 1.5}, r"spectral_radius.*1\.5"),
        ({"structural_damping": -1e-3}, r"structural_damping.*-0\.001"),
        ({"integrator_step": 0.0}, r"integrator_step.*0"),
    ],
    ids=repr,
)
def test_other_options_are_refused_with_name_and_value(option: dict[str, Any], words: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=words):
        drm_env.DrmEnv(**{**PLANT, **option})


# Batches


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("options", [SHORT, STAGGERED], ids=["together", "staggered"])
@pytest.mark.parametrize("n", [1, 3])
def test_a_batch_is_its_single_environments(
    n: int, options: dict[str, Any], mode: AutoresetMode
) -> None:
    ours = gym.make_vec(ID, num_envs=n, autoreset_mode=mode, **options)
    theirs = SyncVectorEnv([lambda: gym.make(ID, **options)] * n, autoreset_mode=mode)
    for one, other in zip(ours.reset(seed=21), theirs.reset(seed=21), strict=True):
        assert_same(one, other)
    ends = 0
    for action in actions(75, n, 2):
        step = ours.step(action)
        for one, other in zip(step, theirs.step(action), strict=True):
            assert_same(one, other)
        ends += int((step[2] | step[3]).sum())
    assert ends >= 2 * n


def test_size_and_threads_do_not_show_in_a_lane() -> None:
    steps = actions(30, 11, 2)
    lanes: list[bytes] = []
    for n, num_threads in ((11, 1), (11, 2), (5, 2)):
        batch = gym.make_vec(ID, num_envs=n, num_threads=num_threads, **SHORT)
        found = [batch.reset(seed=3)[0][:5]]
        found += [batch.step(action[:n])[0][:5] for action in steps]
        lanes.append(np.array(found).tobytes())
    assert len(set(lanes)) == 1


def test_the_adapter_equals_dummy_vec_env() -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.vec_env import DummyVecEnv

    from drm_env.sb3 import make_sb3_vec

    ours = make_sb3_vec(ID, n_envs=3, monitor=False, **STAGGERED)
    theirs = DummyVecEnv([lambda: gym.make(ID, **STAGGERED)] * 3)
    assert ours.seed(30) == theirs.seed(30)
    assert_same(ours.reset(), theirs.reset())
    ends = 0
    for action in actions(60, 3, 2):
        step, expected = ours.step(action), theirs.step(action)
        for one, other in zip(step[:3], expected[:3], strict=True):
            assert_same(one, other)
        for one, other in zip(step[3], expected[3], strict=True):
            over = "terminal_observation" in other
            keys = {key for key in other if over or not key.startswith(WHOLE_EPISODE)}
            assert one.keys() == keys
            for key in keys:
                np.testing.assert_equal(one[key], other[key], err_msg=key)
        ends += int(step[2].sum())
    assert ends >= 6


# Snapshots


def walk(env: drm_env.DrmEnv, steps: np.ndarray) -> list[Any]:
    """Everything that comes out of steps, with resets where episodes end."""
    records: list[Any] = []
    for action in steps:
        observation, *rest = env.step(action)
        records.append((observation.tobytes(), repr(rest)))
        if rest[1] or rest[2]:
            observation, info = env.reset()
            records.append((observation.tobytes(), repr(info)))
    return records


def started(steps: int, **options: Any) -> drm_env.DrmEnv:
    env = drm_env.DrmEnv(
        **{**SHORT, "inner_law": "lyapunov", "angle_noise": 1e-4, "root_lag": 0.02, **options}
    )
    env.reset(seed=steps)
    walk(env, actions(steps, 2))
    return env


@pytest.mark.parametrize("steps", [0, 1, 7, 12, 29])
def test_a_restored_environment_and_a_clone_continue_with_the_same_bits(steps: int) -> None:
    env = started(steps)
    state = env.get_state()
    target, clone = started(5), env.clone()
    target.set_state(state)
    assert target.get_state() == state
    further = actions(40, 2, seed=9)
    expected = walk(env, further)
    assert walk(target, further) == expected
    assert walk(clone, further) == expected


@pytest.mark.parametrize(
    "other", [{"plant": "thesis"}, {"modes": (4, 3)}, {"modes": (3, 4)}, {"spectral_radius": 0.7}]
)
def test_a_snapshot_of_another_plant_is_refused(other: dict[str, Any]) -> None:
    state = started(9, **other).get_state()
    env = started(9)
    before = env.get_state()
    with pytest.raises(drm_env.SnapshotError):
        env.set_state(state)
    assert env.get_state() == before
    with pytest.raises(drm_env.SnapshotError):
        started(9, **other).set_state(before)


def test_lanes_of_a_batch_can_be_saved() -> None:
    batch = drm_env.DrmVectorEnv(3, **SHORT)
    batch.reset(seed=1)
    for action in actions(7, 3, 2):
        batch.step(action)
    other = drm_env.DrmVectorEnv(3, **SHORT)
    other.set_state(batch.get_state())
    for action in actions(20, 3, 2, seed=2):
        for one, expected in zip(other.step(action), batch.step(action), strict=True):
            assert_same(one, expected)


# Flights


@pytest.mark.parametrize("law", ["none", "linear", "lyapunov", "servo"])
def test_a_rollout_has_the_metrics_of_single_flights(law: str) -> None:
    scenarios = [
        {"plant": "consistent", "modes": modes, "payload": payload, "horizon": 6.0}
        for modes, payload in zip(((4, 4), (1, 2), (4, 4)), PAYLOADS.values(), strict=True)
    ]
    together = drm_env.rollout(scenarios, law)
    for index, scenario in enumerate(scenarios):
        alone = drm_env.simulate(scenario, law).metrics
        for name, values in together.items():
            np.testing.assert_equal(values[index], alone[name], err_msg=name)


def test_the_environment_flies_what_simulate_flies() -> None:
    options: dict[str, Any] = {**PLANT, "payload_mass": 200.0, "mass_error": 0.0}
    env = drm_env.DrmEnv(**options, horizon=2.0, control_period=0.002, sample_period=0.002)
    env.reset(seed=0)
    flight = drm_env.simulate(env.config.scenario, "none")
    for index in range(1, 900):
        env.step(np.zeros(2, np.float32))
        if index % 100 == 0:
            signals = env.signals()
            for name in ("slew_angle", "alpha", "beta", "tip_deflection"):
                assert signals[name] == flight[name][index], name


@pytest.mark.parametrize("law", ["none", "linear", "lyapunov", "servo"])
@pytest.mark.parametrize("payload", PAYLOADS)
def test_an_exact_payload_arrives_under_each_law(payload: str, law: str) -> None:
    scenario = {"plant": "consistent", "modes": (4, 4), "payload": PAYLOADS[payload]}
    flight = drm_env.simulate(scenario, law)
    for name in flight:
        assert np.isfinite(flight[name]).all(), name
    assert not flight.metrics["diverged"]
    # The open loop turns the rigid arm to 50 deg and stops it. What bends carries no momentum
    # away, so that the arm ends there but for its vibration, which the wheels cannot outgrow.
    late = flight["slew_angle"][flight["time"] > 18.0]
    assert math.degrees(late.mean()) == pytest.approx(50.0, abs=1.0)


def test_signals_rates_and_metrics_belong_together() -> None:
    scenario = {
        "plant": "consistent",
        "modes": (2, 2),
        "slew": {"profile": "min_energy", "smoothing": 0.05},
    }
    flight = drm_env.simulate(scenario)
    step = flight["time"][1]
    for name, rate in (
        ("slew_angle", "slew_rate"),
        ("alpha", "alpha_rate"),
        ("beta", "beta_rate"),
    ):
        numeric = np.gradient(flight[name], step)[1:-1]
        scale = np.abs(numeric).max()
        assert np.abs(flight[rate][1:-1] - numeric).max() < 0.02 * scale, name
    largest = np.abs(flight["tip_deflection"]).max()
    assert largest == pytest.approx(flight.metrics["peak_deflection"], rel=1e-9)
    # Beyond link 1 the axis turns with its end, so that the tip is further out than the sum.
    late = flight["time"] > 12.0
    own = 2.0 * (flight["alpha"] + flight["beta"])
    assert np.abs(flight["tip_deflection"] - own)[late].max() > 0.1 * largest


@pytest.mark.parametrize("length", [1.0, 8.0])
def test_a_release_swings_with_the_frequency_of_the_finite_elements(length: float) -> None:
    flight = drm_env.simulate(released(length, dynamics={"structural_damping": 1e-3}))
    first = drm_env.Model(plant="finite_element").natural_frequencies(length)[0]
    # The first mode remains; it decays with omega^2 tau / 2 and hardly changes its frequency.
    late = flight["time"] > 2.0
    signal, time = flight["beta"][late], flight["time"][late]
    rising = np.nonzero((signal[:-1] < 0.0) & (signal[1:] >= 0.0))[0][:20]
    at = time[rising] - signal[rising] * (time[1] - time[0]) / (signal[rising + 1] - signal[rising])
    assert 1.0 / np.diff(at).mean() == pytest.approx(first, rel=0.01)


def test_structural_damping_damps_as_the_first_mode_demands() -> None:
    damping, length = 1e-3, 8.0
    found = {}
    for tau in (0.0, damping):
        scenario = released(length, dynamics={"structural_damping": tau, "spectral_radius": 1.0})
        flight = drm_env.simulate(scenario)
        period = 1.0 / drm_env.Model(plant="consistent").natural_frequencies(length)[0]

        def size(start: float, flight: Any = flight, period: float = period) -> float:
            time = flight["time"]
            part = (time >= start) & (time < start + 10.0 * period)
            return float(np.sqrt(np.mean(flight["beta"][part] ** 2)))

        found[tau] = math.log(size(6.0) / size(14.0)) / 8.0
    omega = 2.0 * math.pi / period
    assert found[damping] == pytest.approx(omega**2 * damping / 2.0, rel=0.02)
    assert abs(found[0.0]) < 0.02 * found[damping]
