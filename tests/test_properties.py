"""Properties of any configuration, by names and values that nobody picked.

Options come from what the package publishes: the names of `drm_env._options`, values around the
defaults and far from them. The profile ``soak`` (``make soak``) tries a hundred times as many.
"""

from __future__ import annotations

import math
import os
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import drm_env
from drm_env._options import Options, Parameters

SOAK = os.environ.get("DRM_PROFILE") == "soak"
SUPPRESSED = [HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large]


def tries(count: int) -> settings:
    """Return settings: so many examples, the same ones every time; more of them for a soak."""
    return settings(
        max_examples=100 * count if SOAK else count, deadline=None, derandomize=not SOAK,
        suppress_health_check=SUPPRESSED, database=None,
    )  # fmt: skip


PARAMETERS = sorted(Parameters.__annotations__)
OPTIONS = sorted(set(Options.__annotations__) - set(Parameters.__annotations__))
NUMBERS = {
    "payload_mass": 200.0, "payload_length": 1.0, "payload_width": 0.5, "mass_error": 0.1,
    "reported_payload_mass": 200.0, "reported_payload_length": 1.0, "reported_payload_width": 0.5,
    "slew_angle": 0.8, "slew_max_accel": 0.02, "slew_smoothing": 0.2, "deployment_start": 1.0,
    "deployment_end": 7.0, "deployment_force": 200.0, "initial_slew_angle": 0.1,
    "initial_slew_rate": 0.01, "initial_alpha": 0.01, "initial_alpha_rate": 0.01,
    "initial_beta": 0.01, "initial_beta_rate": 0.01, "root_torque_limit": 100.0,
    "root_momentum_limit": 50.0, "root_lag": 0.01, "root_dead_time": 0.01,
    "tip_torque_limit": 10.0, "tip_momentum_limit": 5.0, "tip_lag": 0.01, "tip_dead_time": 0.01,
    "angle_noise": 1e-4, "rate_noise": 1e-4, "deflection_noise": 1e-4,
    "deflection_rate_noise": 1e-3, "angle_resolution": 1e-4, "rate_resolution": 1e-4,
    "deflection_resolution": 1e-4, "deflection_rate_resolution": 1e-3, "sensor_delay": 0.01,
    "structural_damping": 1e-4, "link1_length": 7.0, "link1_bending_stiffness": 2.5e6,
    "link1_mass_per_length": 14.0, "link2_length": 8.0, "link2_bending_stiffness": 3e6,
    "link2_mass_per_length": 9.4, "damping_ratio": 0.005, "payload_offset": 0.05,
    "angle_bias": 1e-4, "rate_bias": 1e-4, "deflection_bias": 1e-4, "deflection_rate_bias": 1e-3,
    "tip_rate_bias": 1e-4, "link1_gauge_bias": 5.0, "link2_gauge_bias": 5.0,
    "tip_accelerometer_bias": 0.01,
}  # fmt: skip
"""A usual value of each parameter that is a number."""
NAMES: dict[str, list[str]] = {
    "payload_inertia": ["full", "slender"],
    "slew_profile": ["min_time", "min_energy"],
    "deployment_mode": ["coincident", "force_limited", "none"],
}


def test_every_parameter_has_a_usual_value() -> None:
    assert sorted(NUMBERS | NAMES) == PARAMETERS


@st.composite
def drawn(draw: st.DrawFn, name: str) -> Any:
    """Return a value of a parameter near a usual one, fixed or drawn for each episode."""
    if name in NAMES:
        return draw(st.sampled_from(NAMES[name]))
    factors = st.floats(0.3, 3.0)
    one, other = sorted((NUMBERS[name] * draw(factors), NUMBERS[name] * draw(factors)))
    kind = draw(st.sampled_from(["fixed", "fixed", "range", "choices"]))
    return {"fixed": one, "range": (one, other), "choices": {"choices": [one, other]}}[kind]


@st.composite
def options(draw: st.DrawFn, most: int = 6) -> dict[str, Any]:
    """Return some options that may go together."""
    chosen = draw(st.lists(st.sampled_from(PARAMETERS), unique=True, max_size=most))
    found: dict[str, Any] = {name: draw(drawn(name)) for name in chosen}
    found["horizon"] = draw(st.sampled_from([0.2, 0.6, 1.0]))
    found["control_period"] = draw(st.sampled_from([0.002, 0.01, 0.02, 0.2]))
    if {"damping_ratio", "payload_offset"} & set(chosen):
        found["plant"] = "consistent"
    if draw(st.booleans()):
        found["inner_law"] = draw(st.sampled_from(["linear", "lyapunov", {"name": "servo"}]))
    if draw(st.booleans()):
        found["observe_payload"] = draw(st.sampled_from(["reported", "true", "hidden"]))
    if draw(st.booleans()):
        found["actuators"] = draw(
            st.lists(
                st.sampled_from(["root_wheel", "tip_wheel", "slew_motor"]),
                unique=True, min_size=1, max_size=3,
            )
        )  # fmt: skip
    found["observation_history"] = draw(st.integers(1, 3))
    found["observe_identified"] = draw(st.booleans())
    found["observe_tip_error"] = draw(st.booleans())
    found["observe_payload_estimate"] = draw(st.booleans())
    found["observe_still_tip_error"] = draw(st.booleans())
    instruments = ["link1_gauge", "link2_gauge", "tip_accelerometer", "tip_gyro"]
    if draw(st.booleans()):
        seen = st.lists(st.sampled_from(instruments), unique=True, max_size=4)
        found["observe_sensors"] = draw(seen)
        for name in draw(st.lists(st.sampled_from(instruments[:3]), unique=True)):
            found[f"{name}_noise"] = draw(st.floats(0.0, 10.0))
            found[f"{name}_bandwidth"] = draw(st.one_of(st.none(), st.floats(1.0, 1e3)))
    return found


def built(found: dict[str, Any]) -> Any:
    """Return a checked configuration; none if it is refused by the name of an option."""
    try:
        return drm_env.resolve(**found)
    except drm_env.ConfigError as error:
        text = str(error)
        parts = {part for name in [*found, *NUMBERS, *NAMES] for part in name.split("_")}
        assert any(part in text for part in parts), text
        return None


@tries(40)
@given(found=options(), seed=st.integers(0, 2**64), data=st.data())
def test_any_configuration_flies_to_a_proper_end_or_is_refused_by_name(
    found: dict[str, Any], seed: int, data: st.DataObject
) -> None:
    config = built(found)
    if config is None:
        return
    env = drm_env.DrmEnv(config=config)
    try:
        observation, _ = env.reset(seed=seed)
    except drm_env.ConfigError:  # a draw that cannot be flown, refused before it begins
        return
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    scale = data.draw(st.sampled_from([0.0, 0.3, 1.0, 100.0]))
    steps = 0
    for _ in range(10_000):
        assert observation in env.observation_space
        action = scale * rng.uniform(-1.0, 1.0, env.action_space.shape)
        observation, reward, terminated, truncated, _ = env.step(action.astype(np.float32))
        steps += 1
        assert np.isfinite(observation).all()
        assert math.isfinite(reward) and reward <= 0.0
        if terminated or truncated:
            break
    assert terminated or steps == math.ceil(found["horizon"] / found["control_period"] - 1e-9)
    with pytest.raises(drm_env.ResetNeededError):
        env.step(action.astype(np.float32))
    env.close()


LISTS = ("preview_times", "slew_times", "slew_accelerations", "observe_sensors")
"""What may be an empty list."""

TABLES = ("reward", "limits", "scenario", "randomize")
POISON: list[Any] = [
    math.nan, math.inf, -math.inf, 1e21, -1e21, "four", "", b"1", [], {}, {"uniform": [2.0, 1.0]},
    {"uniform": [0.0, math.nan]}, {"normal": 3}, (2.0, 1.0), (1.0, math.inf), (1.0, 2.0, 3.0),
    [math.nan], object(), 1j, 10**400, np.array([[1.0]]), [[1.0]], {"choices": []}, lambda: 1.0,
]  # fmt: skip


@tries(400)
@given(name=st.sampled_from(PARAMETERS + OPTIONS), value=st.sampled_from(POISON))
def test_a_value_that_is_none_is_refused_by_its_name(name: str, value: Any) -> None:
    nothing = isinstance(value, dict) and not value  # a table of which nothing is given
    empty = isinstance(value, list) and not value
    if (nothing and name in TABLES) or (empty and name in LISTS):
        return
    if name == "preview_times" and isinstance(value, tuple) and math.inf not in value:
        return  # any times are
    words = "|".join(name.split("_"))
    with pytest.raises(drm_env.ConfigError, match=words):
        drm_env.resolve(**{name: value})


@tries(60)
@given(
    name=st.text(st.characters(codec="utf-8"), min_size=1, max_size=20).filter(
        lambda name: name not in PARAMETERS + OPTIONS
    )
)
def test_an_option_that_there_is_not_is_named(name: str) -> None:
    reserved = ("task", "config", "env_id", "self")
    if name in reserved:
        return
    with pytest.raises(drm_env.ConfigError) as raised:
        drm_env.resolve(**{name: 1.0})
    if name.isascii() and name.isalnum():
        assert name in str(raised.value)


@tries(25)
@given(found=options(4), seed=st.integers(0, 2**64), before=st.integers(0, 8))
def test_a_snapshot_at_any_moment_goes_on_with_the_same_bits(
    found: dict[str, Any], seed: int, before: int
) -> None:
    config = built(found)
    if config is None:
        return
    env, other = drm_env.DrmEnv(config=config), drm_env.DrmEnv(config=config)
    try:
        env.reset(seed=seed)
    except drm_env.ConfigError:
        return
    rng = np.random.default_rng(before)
    ended = False
    for _ in range(before):
        if ended:
            break
        _, _, terminated, truncated, _ = env.step(action_of(env, rng))
        ended = terminated or truncated
    state = env.get_state()
    other.set_state(state)
    assert other.get_state() == state
    while not ended:
        action = action_of(env, rng)
        one, two = env.step(action), other.step(action)
        assert one[0].tobytes() == two[0].tobytes()
        assert one[1:4] == two[1:4]
        ended = one[2] or one[3]
    assert env.get_state() == other.get_state()
    env.set_state(state)
    assert env.get_state() == state


def action_of(env: Any, rng: np.random.Generator) -> NDArray[np.float32]:
    return rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)


@tries(20)
@given(found=options(4), seed=st.integers(0, 2**31), lanes=st.integers(1, 19))
def test_a_batch_has_the_bits_of_single_environments(
    found: dict[str, Any], seed: int, lanes: int
) -> None:
    config = built(found)
    if config is None:
        return
    batch = drm_env.DrmVectorEnv(lanes, config=config, autoreset_mode="Disabled", num_threads=2)
    singles = [drm_env.DrmEnv(config=config) for _ in range(lanes)]
    seeds = list(range(seed, seed + lanes))
    try:
        observations, _ = batch.reset(seed=seeds)
    except drm_env.ConfigError:
        return
    for single, number, row in zip(singles, seeds, observations, strict=True):
        assert single.reset(seed=number)[0].tobytes() == row.tobytes()
    rng = np.random.default_rng(seed)
    for _ in range(6):
        actions = rng.uniform(-1.2, 1.2, batch.action_space.shape).astype(np.float32)
        observations, rewards, terminated, truncated, _ = batch.step(actions)
        for index, single in enumerate(singles):
            one = single.step(actions[index])
            assert one[0].tobytes() == observations[index].tobytes()
            assert one[1:4] == (rewards[index], terminated[index], truncated[index])
        if (terminated | truncated).any():
            break
    batch.close()


LANES = 5
DTYPES = ["f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u4", "?", "c8", "U3", "O", "M8[s]", "S3"]


@st.composite
def laid_out(draw: st.DrawFn) -> tuple[Any, NDArray[np.float32] | None]:
    """Return an array as actions, and the numbers in it if they are ones of the right shape."""
    dtype = draw(st.sampled_from(DTYPES))
    order = draw(st.sampled_from("<>"))
    rows = draw(st.sampled_from([LANES, LANES, LANES, 0, 1, LANES + 1]))
    columns = draw(st.sampled_from([2, 2, 2, 0, 1, 3]))
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    values = rng.integers(0, 2, (rows, columns)).astype(np.float32)
    kind = np.dtype(dtype).newbyteorder(order)
    array: Any = values.astype(kind) if dtype not in ("M8[s]",) else values.astype("i8").view(kind)
    layout = draw(st.sampled_from(["plain", "strided", "reversed", "fortran", "offset", "zero"]))
    if layout == "strided":
        wide = np.zeros((2 * rows, 3 * columns), kind)
        wide[::2, ::3] = array
        array = wide[::2, ::3]
    elif layout == "reversed":
        array = array[::-1, ::-1].copy()[::-1, ::-1]
    elif layout == "fortran":
        array = np.asfortranarray(array)
    elif layout == "offset" and dtype != "O" and array.size:
        raw = np.zeros(array.nbytes + 1, np.uint8)
        moved = raw[1:].view(np.uint8)[: array.nbytes]
        shifted = np.ndarray(array.shape, kind, buffer=moved.data)
        shifted[...] = array
        array = shifted
    elif layout == "zero" and rows:
        array = np.broadcast_to(array[:1], array.shape)
    expected = np.array(array).astype(np.float32) if kind.kind in "fiu" else None
    if array.shape != (LANES, 2):
        expected = None
    array.flags.writeable = draw(st.booleans()) and array.flags.writeable
    return array, expected


@tries(150)
@given(case=laid_out())
def test_any_array_is_flown_as_the_numbers_in_it_or_refused(
    case: tuple[Any, NDArray[np.float32] | None],
) -> None:
    array, expected = case
    one = drm_env.DrmVectorEnv(LANES, horizon=1.0)
    other = drm_env.DrmVectorEnv(LANES, horizon=1.0)
    one.reset(seed=1)
    other.reset(seed=1)
    before = array.tobytes() if array.dtype != object else None
    state = one.get_state()
    try:
        flown = one.step(array)
    except drm_env.ActionError:
        assert expected is None
        assert one.get_state() == state
        return
    if before is not None:
        assert array.tobytes() == before
    numbers = expected if expected is not None else np.array(array).astype(np.float32)
    assert numbers.shape == (LANES, 2), "an array of another shape was flown"
    wanted = other.step(np.ascontiguousarray(numbers))
    assert flown[0].tobytes() == wanted[0].tobytes()
    assert flown[1].tobytes() == wanted[1].tobytes()


@tries(100)
@given(seed=st.one_of(st.integers(0, 2**200), st.integers(-(2**70), -1)))
def test_a_seed_of_any_size_is_repeatable_or_refused(seed: int) -> None:
    env = drm_env.DrmEnv(payload_mass=(50.0, 500.0))
    if seed < 0:
        with pytest.raises((drm_env.DrmError, gym.error.Error), match=r"[sS]eed"):
            env.reset(seed=seed)
        return
    first, _ = env.reset(seed=seed)
    second, info = env.reset(seed=seed)
    assert first.tobytes() == second.tobytes()
    assert 50.0 <= info["context/payload_mass"] <= 500.0
