"""A configuration is resolved without an environment, held as a value and taken at every door."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import drm_env
from drm_env import _engine

ID = "drm_env/Slew-v0"
VARIOUS: dict[str, Any] = {
    "payload_mass": (60.0, 90.0),
    "horizon": 0.5,
    "preview_times": [0.5],
    "observation_history": 2,
}


@pytest.fixture
def no_environments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any environment that is made fails the test."""

    def never(self: Any, *_: Any, **__: Any) -> None:
        raise AssertionError(f"made a {type(self).__name__}")

    monkeypatch.setattr(drm_env.DrmEnv, "__init__", never)
    monkeypatch.setattr(drm_env.DrmVectorEnv, "__init__", never)


def test_it_says_what_the_environment_will_be(env_id: str) -> None:
    held = drm_env.resolve(env_id, **VARIOUS)
    env: Any = gym.make(env_id, **VARIOUS)
    inner = env.unwrapped
    assert held.observation_space == env.observation_space
    assert held.action_space == env.action_space
    assert held.observation_layout == inner.observation_layout
    assert held.control_period == inner.control_period
    assert held.config == inner.config
    assert held.to_json() == inner.config_json
    assert held.to_dict() == json.loads(inner.config_json)
    assert held == inner.resolved_config
    assert held.horizon_steps == env.spec.max_episode_steps
    assert held.horizon == inner.config.scenario.horizon
    assert held.sample_period == inner.config.scenario.sample_period
    assert held.actuators == tuple(inner.config.task.actuators)
    assert held.action_size == len(held.actuators)
    _, info = env.reset(seed=0)
    assert tuple(f"context/{name}" for name in held.context_names) == drm_env.env.CONTEXT_KEYS
    assert set(held.drawn) >= {"payload_mass"}
    for name, value in held.context.items():
        if name not in held.drawn and not name.startswith(("payload", "reported")):
            assert info[f"context/{name}"] == min(value, drm_env.NO_VALUE)


def test_no_environment_is_made(no_environments: None) -> None:
    held = drm_env.resolve(ID, **VARIOUS)
    assert held.observation_space.shape == (len(held.observation_layout),)
    assert (held.horizon_steps, held.action_space.shape) == (50, (2,))
    assert drm_env.default_config("slew_direct") == drm_env.resolve("slew_direct").config


def test_it_is_a_value() -> None:
    held, same = drm_env.resolve(ID, **VARIOUS), drm_env.resolve("slew", **VARIOUS)
    other = drm_env.resolve(ID, **{**VARIOUS, "horizon": 0.6})
    assert held == same and hash(held) == hash(same) and held != other
    assert {held: 1}[same] == 1 and held != held.to_json()
    assert copy.copy(held) is held and copy.deepcopy(held) is held
    again = pickle.loads(pickle.dumps(held))  # noqa: S301
    assert again == held and again.to_json() == held.to_json()
    assert drm_env.ResolvedConfig.from_json(held.to_json()) == held
    with pytest.raises(AttributeError, match="horizon cannot be set"):
        held.horizon = 3.0  # type: ignore[misc]
    with pytest.raises(AttributeError, match="config cannot be deleted"):
        del held.config
    data = held.to_dict()
    data["scenario"]["horizon"] = 7.0
    assert held.to_dict()["scenario"]["horizon"] == 0.5
    assert "50 steps of 0.01 s" in repr(held) and "draws payload_mass" in repr(held)
    held.observation_space.seed(0)
    assert held.observation_space is not held.observation_space


@pytest.mark.parametrize("task", _engine.task_names())
def test_a_complete_configuration_leaves_nothing_of_the_defaults(task: str) -> None:
    for other in _engine.task_names():
        held = drm_env.resolve(other, payload_width=0.3, mass_error=[0.1, 0.2, 0.3])
        assert drm_env.DrmEnv(task=task, config=held).resolved_config == held
        assert drm_env.DrmEnv(task=task, config=held.to_dict()).resolved_config == held
        assert drm_env.DrmEnv(task=task, config=held.config).resolved_config == held


def sb3(**options: Any) -> Any:
    return pytest.importorskip("drm_env.sb3").make_sb3_vec(ID, 2, **options).venv.batch


DOORS: dict[str, Callable[..., Any]] = {
    "single": drm_env.DrmEnv,
    "make": lambda **o: gym.make(ID, **o).unwrapped,
    "batch": lambda **o: drm_env.DrmVectorEnv(2, **o),
    "make_vec": lambda **o: gym.make_vec(ID, num_envs=2, **o),
    "sb3": sb3,
    "resolve": lambda **o: drm_env.resolve(ID, **o),
}


@pytest.mark.parametrize("door", DOORS)
def test_every_door_takes_it(door: str) -> None:
    held = drm_env.resolve("drm_env/SlewDirect-v0", **VARIOUS)
    made = DOORS[door](config=held)
    assert getattr(made, "resolved_config", made) is held
    changed = DOORS[door](config=held, payload_mass=80.0)
    changed = getattr(changed, "resolved_config", changed)
    assert changed == drm_env.resolve("drm_env/SlewDirect-v0", **{**VARIOUS, "payload_mass": 80.0})
    with pytest.raises(drm_env.UnknownOptionError, match="payload_mas"):
        DOORS[door](config=held, payload_mas=80.0)


def test_it_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    held = drm_env.resolve(ID, **VARIOUS)
    network = drm_env.Network([(np.zeros((2, len(held.observation_layout))), np.zeros(2))])

    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("read once more")

    monkeypatch.setattr(_engine, "Config", never)
    env = drm_env.DrmEnv(config=held)
    drm_env.DrmVectorEnv(3, config=held).reset(seed=0)
    scenarios = drm_env.sample_scenarios(config=held, n=2)
    env.reset(seed=0)
    assert scenarios[0] == env.scenario()
    assert len(drm_env.rollout(scenarios, policy=network, config=held)["tip_error_rms"]) == 2
    assert drm_env.ControlLaw("linear", config=held).control_period == 0.01
    assert drm_env.observation_layout(config=held) is held.observation_layout
    copied = copy.deepcopy(env)
    assert copied.resolved_config is held


def test_pickled_environments_keep_it() -> None:
    env = drm_env.DrmEnv(**VARIOUS)
    env.reset(seed=3)
    again = pickle.loads(pickle.dumps(env))  # noqa: S301
    assert again.resolved_config == env.resolved_config
    action = np.zeros(2, dtype=np.float32)
    np.testing.assert_array_equal(again.step(action)[0], env.step(action)[0])


def test_a_manoeuvre_can_be_taken_from_it_if_nothing_is_drawn() -> None:
    held = drm_env.resolve("drm_env/SlewThesis-v0", horizon=0.5)
    flown = drm_env.simulate(held, "linear")
    np.testing.assert_array_equal(
        flown["slew_angle"], drm_env.simulate({"horizon": 0.5}, "linear")["slew_angle"]
    )
    assert drm_env.rollout([held], "linear")["tip_error_rms"][0] == flown.metrics["tip_error_rms"]
    assert len(drm_env.transitions(held).offset) == 25
    drawn = drm_env.resolve(ID)
    for act, name in (
        (drm_env.simulate, "scenario"),
        (drm_env.transitions, "scenario"),
        (lambda one: drm_env.rollout([held, one]), r"scenarios\[1\]"),
    ):
        told = rf"^{name} must be one manoeuvre, .* draws .*payload_mass.*sample_scenarios"
        with pytest.raises(drm_env.ConfigError, match=told):
            act(drawn)


def test_a_manoeuvre_of_a_held_configuration_is_neither_written_nor_read_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    held = drm_env.resolve("drm_env/SlewThesis-v0", horizon=0.2)

    def refuse(*_: object) -> str:
        raise AssertionError("it is taken as it is")

    monkeypatch.setattr(drm_env.ResolvedConfig, "to_json", refuse)
    monkeypatch.setattr(drm_env.ResolvedConfig, "to_dict", refuse)
    drm_env.simulate(held)
    drm_env.rollout([held, {"horizon": 0.2}])
    drm_env.transitions(held)


def test_specifications_with_it_survive_json() -> None:
    held = drm_env.resolve(ID, **VARIOUS)
    env: Any = gym.make("drm_env/SlewDirect-v0", config=held)
    spec = gym.envs.registration.EnvSpec.from_json(env.spec.to_json())
    assert gym.make(spec).unwrapped.resolved_config == held  # type: ignore[attr-defined]


def test_own_registrations_and_specifications_are_resolved() -> None:
    name = "OwnSlew-v0"
    gym.register(
        name,
        entry_point="drm_env:DrmEnv",
        max_episode_steps=7,
        kwargs={"task": "slew_direct", "horizon": 0.5, "render_mode": "ansi"},
    )
    try:
        held = drm_env.resolve(name, payload_mass=70.0)
        assert held == gym.make(name, payload_mass=70.0).unwrapped.resolved_config  # type: ignore[attr-defined]
        assert drm_env.resolve(gym.spec(name)) == drm_env.resolve("slew_direct", horizon=0.5)
        assert held.horizon_steps == 50
    finally:
        del gym.registry[name]


def test_what_it_cannot_be_is_refused(tmp_path: Path) -> None:
    with pytest.raises(drm_env.ConfigError, match="must be one of drm_env's environments"):
        drm_env.resolve("CartPole-v1")
    with pytest.raises(gym.error.Error, match="Did you mean: `Slew`"):
        drm_env.resolve("drm_env/Slow-v0")
    with pytest.raises(drm_env.ConfigError, match=r"payload\.mass must be .*-1"):
        drm_env.resolve(ID, payload_mass=-1.0)
    with pytest.raises(drm_env.ConfigError, match="no such file"):
        drm_env.resolve(ID, config=tmp_path / "none.json")
    with pytest.raises(drm_env.ConfigError, match="env_id must be"):
        drm_env.resolve(3)  # type: ignore[arg-type]
    held = drm_env.resolve(ID)
    with pytest.raises(drm_env.ConfigError, match="task must be one of"):
        drm_env.DrmEnv(task="slow", config=held)


def test_seeds_of_a_rollout_may_be_given_one_by_one() -> None:
    scenarios = drm_env.sample_scenarios(n=3, horizon=0.3, rate_noise=1e-3)
    whole = drm_env.rollout(scenarios, "linear", seed=5)["tip_error_rms"]
    chosen = drm_env.rollout([scenarios[2], scenarios[0]], "linear", seed=[7, 5])
    np.testing.assert_array_equal(chosen["tip_error_rms"], whole[[2, 0]])
    with pytest.raises(drm_env.ConfigError, match="seed must be a number or have 3 entries, got 2"):
        drm_env.rollout(scenarios, "linear", seed=[1, 2])
    with pytest.raises(drm_env.ConfigError, match="non-negative"):
        drm_env.rollout(scenarios, "linear", seed=[1, 2, -3])
