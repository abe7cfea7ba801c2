"""Properties of the public functions beside the environments, for inputs that nobody picked.

`tests/test_public_names.py` says which public name is under which of them.
"""

from __future__ import annotations

import copy
import itertools
import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import drm_env
from drm_env.sb3 import make_sb3_vec
from test_properties import NAMES, NUMBERS, PARAMETERS, action_of, built, options, tries

TASKS = [
    "slew", "slew_residual", "slew_thesis", "slew_direct", "slew_v1", "slew_residual_v1",
    "slew_flexible",
]  # fmt: skip
LAWS: list[Any] = ["none", "linear", "lyapunov", "servo", {"name": "linear", "tip": None}]


@st.composite
def scenarios(draw: st.DrawFn) -> dict[str, Any]:
    """Return a short manoeuvre that may be flyable."""
    found: dict[str, Any] = {
        "horizon": draw(st.sampled_from([0.1, 0.4])),
        "payload": {"mass": draw(st.floats(0.0, 800.0)), "length": draw(st.floats(0.1, 3.0))},
        "mass_error": draw(st.floats(-0.9, 2.0)),
        "slew": {
            "angle": draw(st.floats(-1.0, 1.0)), "max_accel": draw(st.floats(0.005, 0.05)),
            "profile": draw(st.sampled_from(NAMES["slew_profile"])),
        },
        "deployment": {"start": draw(st.floats(0.5, 4.0)), "end": draw(st.floats(4.0, 8.0))},
        "sensors": {
            "rate_noise": draw(st.sampled_from([0.0, 1e-4])),
            "link2_gauge": {"fitted": draw(st.booleans()), "noise": draw(st.sampled_from([0, 1]))},
        },
    }  # fmt: skip
    if draw(st.booleans()):
        found |= {"plant": "consistent", "modes": [draw(st.integers(1, 3)), 2]}
    if draw(st.booleans()):
        found["root_wheel"] = {"lag": 0.01, "dead_time": draw(st.sampled_from([0.0, 0.006]))}
    return found


@tries(30)
@given(
    many=st.lists(scenarios(), min_size=1, max_size=9), law=st.sampled_from(LAWS), data=st.data()
)
def test_a_rollout_has_the_metrics_and_signals_of_each_flight_alone(
    many: list[dict[str, Any]], law: Any, data: st.DataObject
) -> None:
    threads = data.draw(st.sampled_from([1, 2]))
    every = data.draw(st.integers(1, 30))
    try:
        flown = drm_env.rollout(
            many, law, seed=5, num_threads=threads, signals=["time", "beta"], decimation=every
        )
    except drm_env.ConfigError:
        assert not all(flies(one, law) for one in many)
        return
    for index, one in enumerate(many):
        alone = drm_env.simulate(one, law, seed=5 + index, decimation=every)
        row = flown.trajectory(index)
        assert row["beta"].tobytes() == alone["beta"].tobytes()
        assert np.isfinite(row["time"]).all() and (np.diff(row["time"]) > 0.0).all()
        for name, value in alone.metrics.items():
            assert flown[name][index].tobytes() == np.float64(value).tobytes()
        assert {entry.name for entry in drm_env.episode_metrics()} == set(alone.metrics)
    again = copy.deepcopy(flown)
    assert json.dumps([list(map(str, again[name])) for name in again]) == json.dumps(
        [list(map(str, flown[name])) for name in flown]
    )


def flies(scenario: dict[str, Any], law: Any) -> bool:
    try:
        drm_env.simulate(scenario, law)
    except drm_env.ConfigError:
        return False
    return True


@tries(25)
@given(
    task=st.sampled_from(TASKS), found=options(4), seed=st.integers(0, 2**64), n=st.integers(0, 9)
)
def test_sampled_scenarios_are_what_environments_fly_and_within_their_distributions(
    task: str, found: dict[str, Any], seed: int, n: int
) -> None:
    try:
        sampled = drm_env.sample_scenarios(task, seed=seed, n=n, **found)
        env = drm_env.DrmEnv(task=task, **found)
    except drm_env.ConfigError:
        return
    assert len(sampled) == n
    for index, scenario in enumerate(sampled):
        env.reset(seed=seed + index)
        assert env.scenario() == scenario
        for name, value in found.items():
            if name in NUMBERS:
                inside(value, env.context[f"context/{name}"])


def inside(wanted: Any, value: float) -> None:
    """Check a drawn number against what it is drawn from."""
    if isinstance(wanted, tuple):
        assert wanted[0] <= value <= wanted[1]
    elif isinstance(wanted, dict):
        assert value in wanted["choices"]
    else:
        assert value == wanted


@st.composite
def distributions(draw: st.DrawFn) -> tuple[Any, float, float]:
    """Return a distribution of masses, and the least and the largest that it may give."""
    low, high = sorted((draw(st.floats(1.0, 400.0)), draw(st.floats(1.0, 400.0))))
    kind = draw(st.sampled_from(["uniform", "log", "normal", "choices"]))
    if kind == "uniform":
        return drm_env.Uniform(low, high), low, high
    if kind == "log":
        return drm_env.LogUniform(low, high), low, high
    if kind == "normal":
        mean = draw(st.floats(low, high))
        std = draw(st.floats(1e-3, 300.0))
        return drm_env.Normal(mean, std, low=low, high=high), low, high
    return drm_env.Choices([low, high]), low, high


@tries(60)
@given(case=distributions(), seed=st.integers(0, 2**40))
def test_draws_stay_within_their_bounds_and_repeat(
    case: tuple[Any, float, float], seed: int
) -> None:
    distribution, low, high = case
    try:
        config = drm_env.resolve(payload_mass=distribution)
    except drm_env.ConfigError:
        # nothing between the limits, or too little of a normal distribution
        assert low == high or isinstance(distribution, drm_env.Normal)
        return
    assert config.drawn == ("payload_mass", "mass_error")
    masses = [
        scenario["payload"]["mass"]
        for scenario in drm_env.sample_scenarios(seed=seed, n=40, config=config)
    ]
    assert all(low <= mass <= high for mass in masses)
    if isinstance(distribution, drm_env.Choices):
        assert set(masses) <= {low, high}
    again = drm_env.sample_scenarios(seed=seed, n=40, config=config)
    assert masses == [scenario["payload"]["mass"] for scenario in again]


@tries(40)
@given(task=st.sampled_from(TASKS), found=options())
def test_a_configuration_comes_back_from_every_form_of_it(task: str, found: dict[str, Any]) -> None:
    try:
        config = drm_env.resolve(task, **found)
    except drm_env.ConfigError:
        return
    assert drm_env.ResolvedConfig.from_json(config.to_json()) == config
    assert drm_env.resolve(task, config=config.to_dict()) == config
    assert drm_env.resolve(task, config=config.config) == config
    assert copy.deepcopy(config) == config
    layout = config.observation_layout
    assert config.observation_space.shape == (len(layout),)
    assert config.action_size == len(config.actuators) == config.action_space.shape[0]
    assert config.horizon_steps == math.ceil(config.horizon / config.control_period - 1e-9)
    assert set(config.context) == set(config.context_names) == set(PARAMETERS)
    assert {name for name, value in found.items() if isinstance(value, (tuple, dict))} & set(
        PARAMETERS
    ) <= set(config.drawn)
    known = drm_env.option_names()
    assert set(found) <= set(known)
    plain = drm_env.default_config(task)
    assert drm_env.resolve(task, config=plain) == drm_env.resolve(task)
    names = [entry.name for entry in drm_env.observation_layout(task, **found)]
    assert names == [entry.name for entry in layout] and len(names) == len(set(names))


@tries(30)
@given(
    extension=st.floats(1.0, 8.0), mass=st.floats(0.0, 500.0),
    plant=st.sampled_from(["thesis", "consistent"]), rate=st.floats(-0.2, 0.2),
    state=st.lists(st.floats(-0.05, 0.05), min_size=6, max_size=6),
)  # fmt: skip
def test_models_have_symmetric_masses_positive_energies_and_rising_frequencies(
    extension: float, mass: float, plant: str, rate: float, state: list[float]
) -> None:
    model = drm_env.Model(payload={"mass": mass}, plant=plant)
    matrices = model.matrices(extension, slew_rate=rate)
    np.testing.assert_allclose(matrices.M, matrices.M.T, rtol=1e-12, atol=1e-9)
    assert (np.linalg.eigvalsh(matrices.M) > 0.0).all()
    np.testing.assert_allclose(matrices.K, matrices.K.T, rtol=1e-9, atol=1e-6)
    frequencies = model.natural_frequencies(extension)
    assert (frequencies > 0.0).all() and (np.diff(frequencies) > 0.0).all()
    shapes = model.mode_shapes(extension, 1)
    assert np.abs(shapes.displacements).max() == pytest.approx(1.0)
    np.testing.assert_allclose(shapes.frequencies, frequencies[:1], rtol=1e-9)
    linear = model.linearize(extension, slew_rate=rate)
    count = len(matrices.M)
    assert linear.A.shape == (2 * count, 2 * count)
    np.testing.assert_allclose(
        linear.A[count:, :count], -np.linalg.solve(matrices.M, matrices.K), rtol=1e-6, atol=1e-3
    )
    spatial = drm_env.Model(
        payload={"mass": mass}, plant="spatial", elements=12, grapple={"centre": state[:3]}
    )
    modes = spatial.spatial_modes(extension, 4)
    assert (modes.frequencies > 0.0).all() and (np.diff(modes.frequencies) >= 0.0).all()
    np.testing.assert_allclose(modes.shares.sum(axis=1), 1.0)
    assert spatial.mode_kinds(extension, 4) == modes.kinds
    if plant == "thesis":
        q, v = state[:3], state[3:]
        energy = model.energy(q, v, extension)
        assert energy.kinetic >= 0.0
        assert energy.total == pytest.approx(energy.kinetic + energy.potential)
        # the momentum is linear in the rates at a fixed length
        one = model.angular_momentum(q, v, extension)
        two = model.angular_momentum(q, [2.0 * x for x in v], extension)
        assert two == pytest.approx(2.0 * one, rel=1e-9, abs=1e-9)
        assert np.isfinite(model.acceleration(q, v, extension)).all()


@tries(12)
@given(scenario=scenarios(), hold=st.sampled_from([1, 5, 10]))
def test_transitions_have_finite_matrices_that_follow_each_other(
    scenario: dict[str, Any], hold: int
) -> None:
    scenario["horizon"] = 0.1
    try:
        linear = drm_env.transitions(scenario, hold=hold)
    except (drm_env.ConfigError, drm_env.SimulationError):
        return
    count, size = linear.offset.shape
    assert count * hold == 50
    assert linear.transition.shape == (count, size, size)
    assert linear.input.shape == (count, size, 2)
    assert linear.error_state.shape == (count, hold, size)
    assert all(np.isfinite(part).all() for part in linear)


@tries(40)
@given(
    sizes=st.lists(st.integers(1, 9), min_size=2, max_size=4), seed=st.integers(0, 999),
    activation=st.sampled_from(["tanh", "relu"]), output=st.sampled_from(["clip", "tanh"]),
    rows=st.integers(0, 12), scale=st.sampled_from([0.0, 1.0, 1e3, 1e30]),
)  # fmt: skip
def test_networks_act_within_bounds_and_as_numpy_does(
    sizes: list[int], seed: int, activation: str, output: str, rows: int, scale: float
) -> None:
    rng = np.random.default_rng(seed)
    layers = [
        (rng.normal(size=(after, before)).astype(np.float32), rng.normal(size=after))
        for before, after in itertools.pairwise(sizes)
    ]
    network = drm_env.Network(layers, activation, output)
    assert (network.inputs, network.outputs) == (sizes[0], sizes[-1])
    seen = (scale * rng.normal(size=(rows, sizes[0]))).astype(np.float32)
    actions = network(seen)
    assert actions.shape == (rows, sizes[-1]) and (np.abs(actions) <= 1.0).all()
    value = seen.astype(float)
    for index, (weights, biases) in enumerate(layers):
        value = value @ weights.astype(float).T + biases.astype(np.float32)
        if index < len(layers) - 1:
            value = np.tanh(value) if activation == "tanh" else np.maximum(value, 0.0)
    value = np.tanh(value) if output == "tanh" else np.clip(value, -1.0, 1.0)
    if scale <= 1.0:  # hidden hyperbolic tangents are good to 1e-4
        np.testing.assert_allclose(actions, value, atol=2e-3)
    for row in range(rows):
        assert network(seen[row]).tobytes() == actions[row].tobytes()
    same = copy.deepcopy(network)
    assert same(seen).tobytes() == actions.tobytes()


@tries(25)
@given(law=st.sampled_from(LAWS), seed=st.integers(0, 999), count=st.integers(0, 9))
def test_laws_of_many_are_the_laws_of_each(law: Any, seed: int, count: int) -> None:
    made = drm_env.ControlLaw(law, control_period=0.002)
    env = drm_env.DrmVectorEnv(max(count, 1), task="slew_thesis")
    seen = env.reset(seed=seed)[0][:count]
    measured = made.measurements(seen)
    assert measured.shape == (count, len(made.MEASUREMENTS))
    start = np.arange(count) % 2 == 0
    torques, state = made.torques(measured, made.initial_state(count), start)
    assert torques.shape == (count, 2) and np.isfinite(torques).all()
    again, later = made.torques(measured, state, np.zeros(count, bool))
    assert again.shape == torques.shape
    for row in range(count):
        one, kept = made.torques(
            measured[row : row + 1], made.initial_state(1), start[row : row + 1]
        )
        assert one.tobytes() == torques[row : row + 1].tobytes()
        assert kept.tobytes() == state[row : row + 1].tobytes()
    assert later.shape == state.shape


@tries(8)
@given(scenario=scenarios(), width=st.integers(64, 200), height=st.integers(64, 200))
def test_pictures_have_the_size_that_was_asked_for(
    scenario: dict[str, Any], width: int, height: int
) -> None:
    try:
        flight = drm_env.simulate(scenario, decimation=10)
        film = drm_env.Film(scenario, flight, width=width, height=height)
    except drm_env.ConfigError:
        return
    other = drm_env.Film(scenario, flight, width=width, height=height)
    film.share_axes(other)
    assert film.duration == flight["time"][-1] and film.magnification > 0.0
    for time in (-1.0, 0.0, 0.5 * film.duration, 10.0 * film.duration):
        frame = film.frame(time)
        assert frame.shape == (height, width, 3) and frame.dtype == np.uint8
        assert frame.tobytes() == other.frame(time).tobytes()
    assert sum(1 for _ in film.frames(fps=5.0)) == math.ceil(5.0 * film.duration - 1e-9) + 1


@tries(15)
@given(found=options(4), seed=st.integers(0, 2**40), count=st.integers(1, 7), data=st.data())
def test_the_doors_of_an_environment_say_the_same(
    found: dict[str, Any], seed: int, count: int, data: st.DataObject
) -> None:
    """Context, scenario, signals, copies, sub-environments and the SB3 adapter, of one state."""
    config = built(found)
    if config is None:
        return
    env = drm_env.DrmEnv(config=config)
    batch = drm_env.DrmVectorEnv(count, config=config, autoreset_mode="Disabled")
    adapter = make_sb3_vec("drm_env/Slew-v0", count, config=config)
    try:
        env.reset(seed=seed)
        first, _ = batch.reset(seed=seed)
        adapter.seed(seed)
        assert adapter.reset().tobytes() == first.tobytes()
        env.set_context(payload_mass=150.0)
        batch.set_context(payload_mass=150.0)
        env.reset()
        batch.reset()
        rows = batch.reset_envs([None] * count, [{} for _ in range(count)])
        env.reset()
    except drm_env.ConfigError:
        return
    assert rows.shape == batch.observation_space.shape
    assert env.context["context/payload_mass"] == 150.0
    assert (batch.context[PARAMETERS_INDEX] == 150.0).all()
    rng = np.random.default_rng(seed)
    other = env.clone()
    sub = batch.envs[0]
    sub.set_state(env.get_state())
    action = action_of(env, rng)
    one, two = env.step(action), other.step(action)
    assert one[0].tobytes() == two[0].tobytes() and one[1:4] == two[1:4]
    actions = np.tile(action, (count, 1))
    many = batch.step(actions)
    assert many[0][0].tobytes() == one[0].tobytes()
    assert sub.signals() == env.signals() and sub.get_state() == env.get_state()
    assert all(math.isfinite(value) for value in env.signals().values())
    assert env.scenario()["payload"]["mass"] == 150.0
    metrics = drm_env.info_metrics(one[4])
    assert set(metrics) <= {entry.name for entry in drm_env.episode_metrics()}
    assert np.isfinite(batch.coordinates).all()
    adapter.step_async(actions)
    seen, rewards, _, _ = adapter.step_wait()
    assert np.isfinite(seen).all() and np.isfinite(rewards).all()


PARAMETERS_INDEX = list(drm_env.resolve().context_names).index("payload_mass")
