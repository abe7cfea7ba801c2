"""Bad input is refused with the field and the value, before anything changes.

Actions, calls out of order, options, configurations in every form they can come in, files, masks
and scenarios; single environment, batch and the functions around them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import drm_env

GOOD = np.array([0.3, -0.2], np.float32)

# Action, the error's type besides DrmError, and what the message has to say.
BAD_ACTIONS: dict[str, tuple[Any, type[Exception], str]] = {
    "nan": (np.array([0.0, np.nan], np.float32), ValueError, r"action\[1\].*finite.*(NaN|nan)"),
    "infinite": (np.array([np.inf, 0.0], np.float32), ValueError, r"action\[0\].*finite.*inf"),
    "infinite double": (np.array([0.0, -np.inf]), ValueError, r"action\[1\].*finite.*-inf"),
    "too long": (np.zeros(3, np.float32), ValueError, r"shape \(2,\), got \(3,\)"),
    "too short": (np.zeros(1, np.float32), ValueError, r"shape \(2,\), got \(1,\)"),
    "two axes": (np.zeros((1, 2), np.float32), ValueError, r"shape \(2,\), got \(1, 2\)"),
    "number": (0.5, ValueError, r"shape \(2,\), got \(\)"),
    "none": (None, TypeError, "real numbers.*None"),
    "text": (np.array(["a", "b"]), TypeError, "real numbers"),
    "objects": ([object(), 0.0], TypeError, "real numbers"),
    "complex": (np.zeros(2, complex), TypeError, "real numbers.*complex"),
    "bool": (np.array([True, False]), TypeError, "real numbers.*bool"),
    "ragged": ([[0.0], [0.0, 1.0]], TypeError, "numbers"),
}


def same_state_after(env: Any, act: Callable[[], Any], error: type[Exception], match: str) -> None:
    before = env.get_state()
    with pytest.raises(error, match=match) as raised:
        act()
    assert isinstance(raised.value, drm_env.DrmError)
    assert env.get_state() == before


@pytest.mark.parametrize("name", BAD_ACTIONS)
def test_bad_action_changes_nothing(name: str) -> None:
    action, error, match = BAD_ACTIONS[name]
    env = drm_env.DrmEnv()
    env.reset(seed=0)
    env.step(GOOD)
    same_state_after(env, lambda: env.step(action), error, match)
    reference = drm_env.DrmEnv()
    reference.reset(seed=0)
    reference.step(GOOD)
    assert env.step(GOOD)[0].tobytes() == reference.step(GOOD)[0].tobytes()


@pytest.mark.parametrize(
    ("change", "error", "match"),
    [
        (lambda a: a.__setitem__((2, 1), np.nan), ValueError, "finite.*(NaN|nan)"),
        (lambda a: a.__setitem__((0, 0), np.inf), ValueError, "finite.*inf"),
    ],
)
def test_one_bad_row_steps_no_sub_environment(
    change: Callable[[np.ndarray], None], error: type[Exception], match: str
) -> None:
    env = drm_env.DrmVectorEnv(3)
    env.reset(seed=0)
    env.step(np.zeros((3, 2), np.float32))
    for dtype in (np.float32, np.float64):
        actions = np.zeros((3, 2), dtype)
        change(actions)
        same_state_after(env, lambda a=actions: env.step(a), error, match)  # type: ignore[misc]


@pytest.mark.parametrize("shape", [(3,), (2, 3), (4, 2), (3, 3), (3, 2, 1)])
def test_wrong_shape_of_a_batch(shape: tuple[int, ...]) -> None:
    env = drm_env.DrmVectorEnv(3)
    env.reset(seed=0)
    actions = np.zeros(shape, np.float32)
    same_state_after(env, lambda: env.step(actions), ValueError, r"shape \(3, 2\)")


def test_wrong_type_of_a_batch() -> None:
    env = drm_env.DrmVectorEnv(3)
    env.reset(seed=0)
    same_state_after(env, lambda: env.step("zero"), TypeError, "real numbers")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "action",
    [
        np.array([0.5, -0.25], np.float64),
        np.array([0.5, -0.25], np.float16),
        [0.5, -0.25],
        np.array([[0.5, 9.0], [-0.25, 9.0]], np.float32)[:, 0],
        np.array([0.5, -0.25], ">f4"),
    ],
    ids=["double", "half", "list", "strided", "big endian"],
)
def test_other_kinds_of_numbers_are_converted(action: Any) -> None:
    env = drm_env.DrmEnv()
    env.reset(seed=0)
    converted = env.step(action)
    env.reset(seed=0)
    assert converted[0].tobytes() == env.step(np.array([0.5, -0.25], np.float32))[0].tobytes()


def test_integers_are_converted() -> None:
    env = drm_env.DrmEnv()
    env.reset(seed=0)
    converted = env.step(np.array([1, -1]))  # type: ignore[arg-type]
    env.reset(seed=0)
    assert converted[0].tobytes() == env.step(np.array([1, -1], np.float32))[0].tobytes()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_actions_beyond_the_box_are_clipped(dtype: Any) -> None:
    env = drm_env.DrmEnv()
    env.reset(seed=0)
    far = env.step(np.array([7.0, -1e30], dtype))
    env.reset(seed=0)
    assert far[0].tobytes() == env.step(np.array([1.0, -1.0], np.float32))[0].tobytes()
    env.reset(seed=0)
    if dtype is np.float64:
        # would be infinite as a float32
        assert env.step(np.array([1e300, -1e300]))[0].tobytes() == far[0].tobytes()


def test_calls_before_reset() -> None:
    env = drm_env.DrmEnv(render_mode="rgb_array")
    for call in (lambda: env.step(GOOD), env.render, env.signals, env.scenario):
        with pytest.raises(drm_env.ResetNeededError, match=r"reset") as raised:
            call()
        assert isinstance(raised.value, gym.error.ResetNeeded)
    batch = drm_env.DrmVectorEnv(2, autoreset_mode="Disabled")
    with pytest.raises(drm_env.ResetNeededError, match=r"reset"):
        batch.step(np.zeros((2, 2), np.float32))
    with pytest.raises(drm_env.ResetNeededError, match=r"reset"):
        batch.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(gym.error.ResetNeeded):
        gym.make("drm_env/Slew-v0").step(GOOD)


def test_step_after_the_end_needs_a_reset_and_a_reset_helps() -> None:
    env = drm_env.DrmEnv(horizon=0.02)
    env.reset(seed=0)
    env.step(GOOD)
    assert env.step(GOOD)[3]
    for _ in range(2):
        same_state_after(env, lambda: env.step(GOOD), drm_env.ResetNeededError, "ended.*reset")
    env.reset()
    env.step(GOOD)


def test_ended_sub_environment_without_autoreset_stops_the_batch() -> None:
    env = drm_env.DrmVectorEnv(2, autoreset_mode="Disabled", horizon=0.02)
    env.reset(seed=0)
    actions = np.zeros((2, 2), np.float32)
    env.step(actions)
    env.step(actions)
    env.reset(options={"reset_mask": np.array([True, False])})
    same_state_after(env, lambda: env.step(actions), drm_env.ResetNeededError, "ended.*reset")


@pytest.mark.parametrize("kind", [drm_env.DrmEnv, drm_env.DrmVectorEnv])
def test_closed_environment_says_so(kind: Any) -> None:
    env = kind()
    env.reset(seed=0)
    env.close()
    env.close()
    action = np.zeros(env.action_space.shape, np.float32)
    for call in (env.reset, lambda: env.step(action), env.get_state):
        with pytest.raises(drm_env.EnvironmentClosedError, match=r"closed") as raised:
            call()
        assert isinstance(raised.value, gym.error.ClosedEnvironmentError)


# Keyword options and what the message has to name.
BAD_OPTIONS: dict[str, tuple[dict[str, Any], str]] = {
    "unknown": ({"payload_weight": 1.0}, "payload_weight"),
    "negative mass": ({"payload_mass": -3.0}, r"payload.*-3"),
    "nan": ({"payload_mass": float("nan")}, r"payload_mass must be finite, got nan"),
    "infinite": ({"slew_angle": np.inf}, r"slew_angle must be finite, got inf"),
    "nan in a range": ({"payload_mass": (1.0, np.nan)}, r"payload_mass\[1\] must be finite"),
    "range backwards": ({"payload_mass": (5.0, 1.0)}, r"payload_mass.*5.*1"),
    "range beyond what is possible": ({"payload_mass": (-5.0, 1.0)}, r"payload.*-5"),
    "triple": ({"payload_mass": (1.0, 2.0, 3.0)}, r"payload_mass.*\(low, high\).*3"),
    "no choices": ({"payload_mass": []}, r"payload_mass.*at least one"),
    "text for a number": ({"payload_mass": "heavy"}, "heavy"),
    "flag for a number": ({"payload_mass": True}, "payload_mass"),
    "unknown name": ({"slew_profile": "sinus"}, "sinus"),
    "unknown choice": ({"slew_profile": ["min_time", "sinus"]}, "sinus"),
    "object": ({"payload_mass": object()}, "payload_mass.*object"),
    "set": ({"actuators": {"root_wheel"}}, "actuators.*set"),
    "log of zero": ({"payload_mass": drm_env.LogUniform(0.0, 1.0)}, "payload_mass"),
    "negative spread": ({"payload_mass": drm_env.Normal(1.0, -1.0)}, "payload_mass.*-1"),
    "unknown distribution": ({"payload_mass": {"triangular": [1, 2]}}, "payload_mass.*triangular"),
    "unknown kind": ({"payload_mass": {"distribution": "beta"}}, "payload_mass.*beta"),
    "incomplete kind": ({"payload_mass": {"distribution": "uniform", "low": 1}}, "'high'"),
    "zero period": ({"control_period": 0.0}, "control_period.*0"),
    "period between samples": ({"control_period": 0.003}, "control_period.*0.003"),
    "unstable step": (
        {"integrator_step": 0.05, "sample_period": 0.05, "control_period": 0.05},
        "integrator_step",
    ),
    "step that never ends": ({"integrator_step": 1e-9}, "integrator_step.*1/100000.*0.000000001"),
    "no actuators": ({"actuators": []}, "actuators"),
    "actuator twice": ({"actuators": ["tip_wheel", "tip_wheel"]}, "actuators"),
    "unknown actuator": ({"actuators": ["nose_wheel"]}, "nose_wheel"),
    "unknown law": ({"inner_law": "pid"}, "pid"),
    "unknown gain": ({"inner_law": {"name": "linear", "knee": {}}}, "knee"),
    "no history": ({"observation_history": 0}, "observation_history.*0"),
    "negative preview": ({"preview_times": [-1.0]}, "preview_times"),
    "unknown reward": ({"reward": {"speed": 1.0}}, "speed"),
    "negative weight": ({"reward": {"effort": -1.0}}, "effort.*-1"),
    "zero limit": ({"limits": {"tip_deflection": 0.0}}, "tip_deflection.*0"),
    "too far out": ({"deployment_end": 80.0}, "deployment.*80"),
    "negative limit": ({"root_torque_limit": -1.0}, "torque_limit.*-1"),
    "not a number of steps": ({"horizon": -1.0}, "horizon.*-1"),
    "unknown task": ({"task": "stir"}, "stir"),
    "task by number": ({"task": 3}, "3"),
    "render mode": ({"render_mode": "hologram"}, "hologram"),
    "config number": ({"config": 3}, "config.*int"),
    "config list": ({"config": [1]}, "config.*list"),
    "unknown part": ({"config": {"senario": {}}}, "senario"),
    "unknown field": ({"config": {"scenario": {"payload": {"weight": 1.0}}}}, "weight"),
    "value in config": ({"config": {"scenario": {"slew": {"max_accel": -0.5}}}}, "max_accel.*-0.5"),
    "nan in config": (
        {"config": {"scenario": {"payload": {"mass": float("nan")}}}},
        "scenario.payload.mass must be finite",
    ),
    "key in config": ({"config": {"scenario": {3: 1}}}, "scenario.*text.*3"),
}


@pytest.mark.parametrize("name", BAD_OPTIONS)
def test_bad_option_names_field_and_value(name: str) -> None:
    options, match = BAD_OPTIONS[name]
    for kind in (drm_env.DrmEnv, drm_env.DrmVectorEnv):
        with pytest.raises(drm_env.ConfigError, match=rf"(?s){match}") as raised:
            kind(**options)
        assert isinstance(raised.value, ValueError)


def test_bad_option_through_make() -> None:
    with pytest.raises(drm_env.ConfigError, match=r"payload_weight"):
        gym.make("drm_env/Slew-v0", payload_weight=3.0)
    with pytest.raises(drm_env.ConfigError, match=r"payload_weight"):
        gym.make_vec("drm_env/Slew-v0", num_envs=2, payload_weight=3.0)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"num_envs": 0}, "num_envs.*0"),
        ({"num_envs": -2}, "num_envs.*-2"),
        ({"num_envs": 1.5}, "num_envs.*1.5"),
        ({"num_threads": 0}, "num_threads.*0"),
        ({"max_episode_steps": 0}, "max_episode_steps.*0"),
        ({"autoreset_mode": "Sometimes"}, "autoreset_mode.*Sometimes"),
        ({"render_mode": "hologram"}, "hologram"),
    ],
)
def test_bad_arguments_of_a_batch(arguments: dict[str, Any], match: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=match):
        drm_env.DrmVectorEnv(**arguments)


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("config.json", '{"scenario": ', "config.json is not valid JSON"),
        ("config.json", "[1, 2]", "table, got list"),
        ("config.json", '{"scenario": {"horizon": NaN}}', "horizon must be finite"),
        ("config.toml", "scenario = {", "config.toml is not valid TOML"),
        ("config.toml", "[scenario]\nhorizon = 'long'\n", "scenario.horizon"),
        ("config.yaml", "scenario: {}", r"config.yaml must end in .json or .toml"),
    ],
)
def test_bad_configuration_file(tmp_path: Path, name: str, text: str, match: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(drm_env.ConfigError, match=match):
        drm_env.DrmEnv(config=path)


def test_unreadable_configuration_files(tmp_path: Path) -> None:
    with pytest.raises(drm_env.ConfigError, match=r"no such file.*missing.json"):
        drm_env.DrmEnv(config=tmp_path / "missing.json")
    with pytest.raises(drm_env.ConfigError, match=r"cannot read"):
        drm_env.DrmEnv(config=tmp_path)
    binary = tmp_path / "binary.json"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(drm_env.ConfigError, match=r"cannot read"):
        drm_env.DrmEnv(config=binary)
    deep = tmp_path / "deep.json"
    deep.write_text('{"scenario":' * 100_000)
    with pytest.raises(drm_env.ConfigError, match=r"not valid JSON"):
        drm_env.DrmEnv(config=deep)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"payload_weight": 1.0}, "payload_weight"),
        ({"payload_mass": -1.0}, "mass.*-1"),
        ({"payload_mass": np.nan}, "payload_mass must be finite"),
        ({"payload_mass": (2.0, 1.0)}, "payload_mass"),
        ({"control_period": 0.1}, "control_period"),
        ({"deployment_end": 80.0}, "80"),
        ({"slew_profile": "sinus"}, "sinus"),
        ([1.0], "mapping, got list"),
    ],
)
def test_bad_option_of_one_episode_changes_nothing(options: Any, match: str) -> None:
    env = drm_env.DrmEnv()
    env.reset(seed=0)
    env.step(GOOD)
    same_state_after(env, lambda: env.reset(options=options), ValueError, match)
    if isinstance(options, dict):
        same_state_after(env, lambda: env.set_context(**options), ValueError, match)
    batch = drm_env.DrmVectorEnv(3)
    batch.reset(seed=0)
    if isinstance(options, dict):
        same_state_after(batch, lambda: batch.reset(seed=3, options=options), ValueError, match)
        same_state_after(batch, lambda: batch.set_context(**options), ValueError, match)
    env.step(GOOD)


def test_bad_value_for_one_sub_environment_changes_nothing() -> None:
    env = drm_env.DrmVectorEnv(3)
    env.reset(seed=0)
    one_bad = {"payload_mass": np.array([60.0, -1.0, 70.0])}
    same_state_after(env, lambda: env.reset(options=one_bad), ValueError, "mass.*-1")
    same_state_after(env, lambda: env.set_context(**one_bad), ValueError, "mass.*-1")
    short = {"payload_mass": np.array([60.0, 70.0])}
    same_state_after(env, lambda: env.reset(options=short), ValueError, r"shape \(3,\)")


@pytest.mark.parametrize(
    ("mask", "error"),
    [
        ([True, False], TypeError),
        (np.array([1, 0]), TypeError),
        (np.array([True, False, True]), ValueError),
        (np.array([False, False]), ValueError),
    ],
)
def test_bad_mask(mask: Any, error: type[Exception]) -> None:
    env = drm_env.DrmVectorEnv(2)
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(error, match=r"reset_mask"):
        env.reset(options={"reset_mask": mask})
    assert env.get_state() == before


@pytest.mark.parametrize("seed", [-1, 1.5, "one"])
def test_bad_seed(seed: Any) -> None:
    env = drm_env.DrmEnv()
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises((gym.error.Error, TypeError)):
        env.reset(seed=seed)
    assert env.get_state() == before
    batch = drm_env.DrmVectorEnv(2)
    with pytest.raises((gym.error.Error, TypeError)):
        batch.reset(seed=seed)


def test_bad_scenarios_and_laws() -> None:
    with pytest.raises(drm_env.ConfigError, match=r"payload.mass.*-1"):
        drm_env.simulate({"payload": {"mass": -1.0}})
    with pytest.raises(drm_env.ConfigError, match=r"weight"):
        drm_env.simulate({"payload": {"weight": 1.0}})
    with pytest.raises(drm_env.ConfigError, match=r"scenario.*list"):
        drm_env.simulate([1])  # type: ignore[arg-type]
    with pytest.raises(drm_env.ConfigError, match=r"pid"):
        drm_env.simulate(law="pid")
    with pytest.raises(drm_env.ConfigError, match=r"law.*3"):
        drm_env.simulate(law=3)
    with pytest.raises(drm_env.ConfigError, match=r"knee"):
        drm_env.simulate(law={"name": "linear", "knee": 3})
    with pytest.raises(drm_env.ConfigError, match=r"decimation.*0"):
        drm_env.simulate(decimation=0)
    with pytest.raises(drm_env.ConfigError, match=r"scenarios\[1\].*mass.*-1"):
        drm_env.rollout([{}, {"payload": {"mass": -1.0}}])
    with pytest.raises(drm_env.ConfigError, match=r"sequence"):
        drm_env.rollout({"payload": {}})  # type: ignore[arg-type]
    with pytest.raises(drm_env.ConfigError, match=r"seed.*-1"):
        drm_env.sample_scenarios(seed=-1, n=2)
    with pytest.raises(drm_env.ConfigError, match=r"n .*-1"):
        drm_env.sample_scenarios(n=-1)


def test_bad_models() -> None:
    with pytest.raises(drm_env.ConfigError, match=r"mass.*-1"):
        drm_env.Model(payload={"mass": -1.0})
    with pytest.raises(drm_env.ConfigError, match=r"plant"):
        drm_env.Model(plant="rigid")
    model = drm_env.Model()
    with pytest.raises(drm_env.ConfigError, match=r"extension.*80"):
        model.matrices(80.0)
    with pytest.raises(drm_env.ConfigError, match=r"rate.*(NaN|nan)"):
        model.matrices(3.0, rate=np.nan)
    with pytest.raises(drm_env.DrmError, match=r"q must have shape \[3\], got \[2\]"):
        model.energy([0.0, 0.0], [0.0, 0.0, 0.0], 3.0)


def test_error_of_a_progress_callback_comes_through_and_ends_the_work() -> None:
    class ReportedError(Exception):
        pass

    def progress(flown: int, count: int) -> None:
        assert 0 <= flown <= count == 400
        raise ReportedError

    with pytest.raises(ReportedError):
        drm_env.rollout([{"horizon": 20.0}] * 400, progress=progress)


def test_trajectory_names_its_signals() -> None:
    trajectory = drm_env.simulate({"horizon": 0.1})
    with pytest.raises(KeyError, match=r"no signal 'speed'.*slew_rate"):
        trajectory["speed"]


def test_json_of_a_configuration_is_complete() -> None:
    text = drm_env.DrmEnv().config_json
    assert set(json.loads(text)) == {"scenario", "randomize", "task"}


TABLES = ("reward", "limits", "scenario", "randomize", "task")
LISTS: list[Any] = [
    [], [1.0], (2.0, 1.0), (1.0, 2.0), (1.0, 2.0, 3.0), [math.nan], [[1.0]], np.ones(2),
]  # fmt: skip


@pytest.mark.parametrize("value", LISTS, ids=repr)
@pytest.mark.parametrize("name", TABLES)
def test_a_list_is_no_table(name: str, value: Any) -> None:
    """What reads the text would take it for the fields of the table in their order."""
    with pytest.raises(drm_env.ConfigError, match=name):
        drm_env.resolve(config={name: value} if name == "task" else within(name, value))
    if name == "task":
        return  # as an option it is the name of a task
    with pytest.raises(drm_env.ConfigError, match=name):
        drm_env.resolve(**{name: value})
    with pytest.raises(drm_env.ConfigError, match=name):
        drm_env.DrmEnv(**{name: value})
    # beside options that are laid over the table
    with pytest.raises(drm_env.ConfigError, match=name):
        drm_env.resolve(**{name: value}, mass_error=0.1, payload_mass=300.0, payload_width=(1, 2))


def within(name: str, value: Any) -> dict[str, Any]:
    return {"task": {name: value}} if name in ("reward", "limits") else {name: value}


@pytest.mark.parametrize("value", [[], [1.0], [1.0, 2.0], (1.0, 2.0)], ids=repr)
def test_a_list_is_no_table_inside_of_one(value: Any) -> None:
    with pytest.raises(drm_env.ConfigError, match="payload"):
        drm_env.resolve(config={"scenario": {"payload": value}}, payload_mass=20.0)
    with pytest.raises(drm_env.ConfigError, match="payload"):
        drm_env.simulate(scenario={"payload": value})
    with pytest.raises(drm_env.ConfigError, match="payload"):
        drm_env.rollout([{"payload": value}])
    with pytest.raises(drm_env.ConfigError, match="payload"):
        drm_env.Model(payload=value)
    with pytest.raises(drm_env.ConfigError, match=r"law.*root"):
        drm_env.simulate(law={"name": "scheduled", "root": value})
    with pytest.raises(drm_env.ConfigError, match=r"inner_law.*root"):
        drm_env.resolve(inner_law={"name": "scheduled", "root": value})


@pytest.mark.parametrize("value", [["linear"], ["linear", 1.0, 2.0], ["none"]], ids=repr)
def test_a_list_is_no_law(value: Any) -> None:
    with pytest.raises(drm_env.ConfigError, match="law"):
        drm_env.simulate(law=value)
    with pytest.raises(drm_env.ConfigError, match="inner_law"):
        drm_env.resolve(inner_law=value)
    with pytest.raises(drm_env.ConfigError, match="law"):
        drm_env.rollout([{}], law=value)


MISSIONS: list[Any] = [
    ([], "mission"), ([[]], "mission"), ((1.0, 2.0), "mission"), ({"legs": {"kind": 1}}, "legs"),
    ({"legs": [["hold", 0.1]]}, r"legs\[0\]"), ({"legs": [["release"]]}, r"legs\[0\]"),
    ({"legs": [{"kind": "grapple", "payload": [9.0]}]}, r"legs\[0\]\.payload"),
    ({"legs": [{"kind": "hold", "duration": [0.1]}]}, r"legs\[0\]\.duration"),
]  # fmt: skip


@pytest.mark.parametrize(("mission", "place"), MISSIONS, ids=repr)
def test_a_list_is_no_mission_and_no_leg(mission: Any, place: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=place):
        drm_env.resolve(config={"mission": mission})
    with pytest.raises(drm_env.ConfigError, match=place):
        drm_env.simulate({"mission": mission})
    with pytest.raises(drm_env.ConfigError, match=place):
        drm_env.rollout([{"mission": mission}])


def test_nothing_is_no_table_either() -> None:
    """An option for what is drawn made a table of it."""
    with pytest.raises(drm_env.ConfigError, match="randomize"):
        drm_env.resolve(config={"randomize": None}, payload_mass=300.0)
