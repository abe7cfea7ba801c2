"""Rollouts beside the same manoeuvres flown one at a time and one step at a time."""

from __future__ import annotations

import copy
import itertools
import os
import signal
import threading
import time
from dataclasses import asdict
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import drm_env
from drm_baselines.evaluation.environments import environment_config
from drm_baselines.evaluation.episodes import fly_policy
from drm_baselines.policies.perceptron import NetworkPolicy, Perceptron

SHORT: dict[str, Any] = {"horizon": 3.0, "slew_max_accel": 0.4}
SIGNALS = ("time", "tip_deflection", "slew_torque", "motor_power")


def perceptron(
    task: str, activation: str = "tanh", output: str = "clip", **options: Any
) -> Perceptron:
    """A policy that steers moderately, the same for the same arguments."""
    rng = np.random.default_rng(5)
    inputs = len(drm_env.observation_layout(task=task, **options))
    sizes = [inputs, 32, 32, 2]
    return Perceptron(
        weights=[
            (rng.normal(size=(after, before)) / before**0.5 / 3).astype(np.float32)
            for before, after in itertools.pairwise(sizes)
        ],
        biases=[(rng.normal(size=size) / 10).astype(np.float32) for size in sizes[1:]],
        activation=activation,
        output=output,
    )


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("output", ["clip", "tanh"])
def test_actions_are_those_of_numpy_up_to_rounding(activation: str, output: str) -> None:
    policy = perceptron("slew", activation, output)
    network = policy.engine()
    observations = np.random.default_rng(1).normal(size=(50, network.inputs)).astype(np.float32)
    actions = network(observations)
    assert (actions.shape, actions.dtype) == ((50, 2), np.float32)
    np.testing.assert_allclose(actions, policy(observations), atol=2e-6)
    np.testing.assert_array_equal(network(observations[3]), actions[3])
    again = copy.deepcopy(network)
    np.testing.assert_array_equal(again(observations), actions)
    assert repr(again) == repr(network)


@pytest.mark.parametrize(
    ("task", "env_id", "options"),
    [
        ("slew", "drm_env/Slew-v0", {"observation_history": 2, "action_rate_limit": 5.0}),
        ("slew_residual", "drm_env/SlewResidual-v0", {"angle_noise": 1e-4, "preview_times": []}),
        ("slew", "drm_env/Slew-v0", {"limits.slew_error": 0.05}),
    ],
)
def test_a_policy_flies_the_episodes_of_the_environment_to_the_bit(
    task: str, env_id: str, options: dict[str, Any]
) -> None:
    config = None
    if "limits.slew_error" in options:
        config, options = {"task": {"limits": {"slew_error": 0.05}}}, {}
    options = {**SHORT, **options}
    network = perceptron(task, **options).engine()
    scenarios = drm_env.sample_scenarios(task, seed=20, n=5, **options)
    flown = drm_env.rollout(scenarios, policy=network, task=task, config=config, seed=20, **options)
    env = gym.make(env_id, config=config, **options)
    ended_early = []
    for index in range(5):
        observation, _ = env.reset(seed=20 + index)
        over = False
        total = 0.0
        while not over:
            observation, reward, terminated, truncated, info = env.step(network(observation))
            over, total = terminated or truncated, total + float(reward)
        for name, values in flown.items():
            seen = drm_env.info_metrics(info)[name]
            np.testing.assert_array_equal(values[index], seen, err_msg=name)
        assert flown["episode_return"][index] == total
        assert flown["diverged"][index] == terminated
        ended_early.append(terminated)
    assert any(ended_early) == (config is not None)


def test_evaluation_by_the_engine_agrees_with_stepping_vector_environments() -> None:
    env_id = "drm_env/SlewResidual-v0"
    config = environment_config(env_id, SHORT)
    description = {
        "env_id": env_id,
        "config": asdict(config),
        "control_period": 0.02,
        "observation_layout": [list(entry) for entry in drm_env.observation_layout(config=config)],
    }
    policy = NetworkPolicy(perceptron("slew_residual", config=config), description)

    class Stepped(NetworkPolicy):
        """Not known to be what its network is: flown step by step."""

    stepped = Stepped(policy.network, description)
    reports: list[tuple[int, int]] = []
    flown, expected = (
        fly_policy(
            each,
            env_id,
            config,
            seed=3,
            episodes=12,
            label="learned",
            progress=lambda done, total: reports.append((done, total)),
        )
        for each in (policy, stepped)
    )
    assert reports[-1] == (12, 12)
    assert list(flown.metrics) == list(expected.metrics)
    assert flown.seeds == expected.seeds
    for name, values in expected.metrics.items():
        np.testing.assert_allclose(flown.metrics[name], values, rtol=1e-4, atol=1e-9, err_msg=name)


def test_kept_signals_are_those_of_simulate_to_the_bit() -> None:
    scenarios = [
        {"payload": {"mass": mass}, "horizon": horizon, "sensors": {"angle_noise": 1e-4}}
        for mass, horizon in ((100.0, 1.0), (300.0, 0.43), (200.0, 2.0))
    ]
    flown = drm_env.rollout(scenarios, "linear", seed=8, signals=SIGNALS, decimation=50)
    assert tuple(flown.trajectories) == SIGNALS
    for index, scenario in enumerate(scenarios):
        alone = drm_env.simulate(scenario, "linear", decimation=50, seed=8 + index)
        count = alone["time"].size
        for name in SIGNALS:
            values = flown.trajectories[name]
            assert (values.shape, values.dtype) == ((3, 21), np.float64)
            np.testing.assert_array_equal(values[index, :count], alone[name], err_msg=name)
            assert np.isnan(values[index, count:]).all()
        assert flown["tip_error_rms"][index] == alone.metrics["tip_error_rms"]


def test_signals_of_a_policy_leave_its_metrics_alone() -> None:
    network = perceptron("slew").engine()
    scenarios = drm_env.sample_scenarios("slew", seed=0, n=9, **SHORT)
    plain = drm_env.rollout(scenarios, policy=network, **SHORT)
    kept = drm_env.rollout(scenarios, policy=network, signals=["time"], decimation=7, **SHORT)
    assert plain.trajectories == {}
    for name, values in plain.items():
        np.testing.assert_array_equal(values, kept[name])
    times = kept.trajectories["time"]
    np.testing.assert_allclose(times[:, 0], 0.0)
    assert times.shape == (9, 216)
    for row, duration, diverged in zip(times, kept["duration"], kept["diverged"], strict=True):
        row = row[np.isfinite(row)]
        assert row[-1] == pytest.approx(duration)
        assert (row.size == 216) == (not diverged)
        np.testing.assert_allclose(np.diff(row[:-1]), 0.014)


def test_a_rollout_is_a_dict_of_metrics() -> None:
    flown = drm_env.rollout([{"horizon": 0.1}], signals=["time"])
    assert isinstance(flown, dict)
    assert next(iter(flown)) == "tip_error_rms"
    with pytest.raises(KeyError, match=r"no metric 'speed'.*tip_error_rms"):
        flown["speed"]
    again = copy.deepcopy(flown)
    assert list(again) == list(flown)
    np.testing.assert_array_equal(again.trajectories["time"], flown.trajectories["time"])
    assert repr(flown).startswith("Rollout(1 manoeuvres: tip_error_rms")


def test_rollouts_that_are_refused() -> None:
    network = perceptron("slew").engine()
    good: list[dict[str, Any]] = [{}, {}]

    def refused(match: str, *arguments: Any, **options: Any) -> None:
        def progress(*_: int) -> None:
            raise AssertionError("it flies")

        with pytest.raises(drm_env.ConfigError, match=match):
            drm_env.rollout(*arguments, progress=progress, **options)

    refused("either law or policy.*linear", good, "linear", policy=network)
    refused("policy must be a drm_env.Network, got str", good, policy="ppo")
    refused("task belongs to the task of a policy", good, task="slew")
    refused("control_period belongs", good, "linear", control_period=0.01)
    refused("policy must have 70 inputs.*got 35", good, policy=network, observation_history=2)
    refused("policy must have 3 outputs.*got 2", good, policy=network, task="slew_direct")
    refused(
        r"scenarios\[1\].sample_period must be 0.002.*got 0.001",
        [{}, {"sample_period": 1e-3}],
        policy=network,
    )
    refused(r"scenarios\[0\].horizon must be 5.*got 20", good, policy=network, horizon=5.0)
    refused(r"control_perod", good, policy=network, control_perod=0.01)
    refused(r"signals must be a sequence of names, got 'time'", good, signals="time")
    refused(r"signals\[1\] must be one of time.*got speed", good, signals=["time", "speed"])
    refused(r"signals\[1\] must be named once", good, signals=["time", "time"])
    refused(r"decimation.*0", good, signals=["time"], decimation=0)
    refused(r"decimation needs signals.*got 5", good, decimation=5)
    refused(
        r"signals must take at most 16 GiB.*got 3 of 5000 manoeuvres, which takes 111\.8 GiB",
        [{"horizon": 2000.0}] * 5000,
        signals=["time", "alpha", "beta"],
    )


def test_networks_that_are_refused() -> None:
    def refused(match: str, layers: Any, *arguments: Any) -> None:
        with pytest.raises(drm_env.ConfigError, match=match):
            drm_env.Network(layers, *arguments)

    pair = (np.zeros((2, 3), np.float32), np.zeros(2, np.float32))
    refused("activation must be one of tanh, relu, got gelu", [pair], "gelu")
    refused("output must be one of clip, tanh, got none", [pair], "tanh", "none")
    refused("activation must be text, got None", [pair], None)
    refused("layers must hold 1 to 64 layers, got 0", [])
    refused(r"layers\[0\] must be a pair", [np.zeros((2, 3))])
    refused(r"layers\[1\].weights must hold 2 x 2 numbers, got 6", [pair, pair])
    refused(r"layers\[0\].weights must have 3 rows.*got 2", [(pair[0], np.zeros(3))])
    refused(r"layers\[0\].biases must have 1 dimensions", [(pair[0], pair[0])])
    refused(r"layers\[0\].weights must be an array of real numbers", [(["a"], pair[1])])
    refused(r"layers\[0\].biases\[1\] must be finite, got inf", [(pair[0], [0.0, 1e300])])
    with pytest.raises(drm_env.ConfigError, match=r"observations must have shape \(3,\)"):
        drm_env.Network([pair])(np.zeros(4))


@pytest.mark.parametrize("kind", ["law", "policy", "signals"])
def test_an_interruption_is_noticed_within_a_second(kind: str) -> None:
    scenarios: list[dict[str, Any]] = [{}] * 20_000
    arguments: dict[str, Any] = {"law": "lyapunov"}
    if kind == "policy":
        arguments = {"policy": perceptron("slew").engine()}
    if kind == "signals":
        arguments |= {"signals": ["time", "alpha"], "decimation": 20}
    sent: list[float] = []
    # a shell that starts the tests in the background has the signal ignored
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def progress(_flown: int, _count: int) -> None:
        if not sent:
            sent.append(time.monotonic())
            threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()

    try:
        with pytest.raises(KeyboardInterrupt):
            drm_env.rollout(scenarios, progress=progress, **arguments)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - sent[0] < 1.0


def test_progress_of_a_policy_ends_with_everything() -> None:
    network = perceptron("slew").engine()
    reports: list[tuple[int, int]] = []
    scenarios = drm_env.sample_scenarios("slew", seed=0, n=40, **SHORT)
    drm_env.rollout(
        scenarios, policy=network, progress=lambda *report: reports.append(report), **SHORT
    )
    assert reports[-1] == (40, 40)
    assert sorted(reports) == reports
