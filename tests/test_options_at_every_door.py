"""Options mean the same and are refused alike wherever they are given.

Unknown names, odd numbers, sequences of other libraries, deep nesting; options that somebody tries
to set as attributes; seeds of environments that nobody seeded; distributions as a context.
"""

from __future__ import annotations

import collections
import decimal
import fractions
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import drm_env
from drm_env.observation import observation_layout

ID = "drm_env/Slew-v0"


def make_sb3_vec(*arguments: Any, **options: Any) -> Any:
    return pytest.importorskip("drm_env.sb3").make_sb3_vec(*arguments, **options)


MAKERS: dict[str, Callable[..., Any]] = {
    "single": drm_env.DrmEnv,
    "make": lambda **o: gym.make(ID, **o),
    "batch": drm_env.DrmVectorEnv,
    "make_vec": lambda **o: gym.make_vec(ID, num_envs=2, **o),
    "sync": lambda **o: gym.make_vec(ID, num_envs=2, vectorization_mode="sync", **o),
    "sb3": lambda **o: make_sb3_vec(ID, 2, **o),
    "law": lambda **o: drm_env.ControlLaw(**o),
    "layout": lambda **o: observation_layout(**o),
    "sample": lambda **o: drm_env.sample_scenarios(n=1, **o),
    "rollout": lambda **o: drm_env.rollout([{}], **o),
    "resolve": lambda **o: drm_env.resolve(ID, **o),
}


@pytest.mark.parametrize("door", MAKERS)
def test_unknown_option_is_a_type_error_in_the_words_of_python(door: str) -> None:
    with pytest.raises(
        TypeError, match=r"got an unexpected keyword argument 'frameskip'"
    ) as raised:
        MAKERS[door](frameskip=1)
    assert isinstance(raised.value, drm_env.UnknownOptionError)
    assert isinstance(raised.value, drm_env.ConfigError)
    with pytest.raises(drm_env.UnknownOptionError, match=r"did you mean .*payload_mass") as raised:
        MAKERS[door](payload_mas=1.0)
    if door not in ("make", "make_vec", "sync"):  # where Gymnasium adds its own
        assert len(str(raised.value)) < 160


@pytest.mark.parametrize("door", ["single", "batch"])
def test_unknown_parameter_of_an_episode_is_refused_alike(door: str) -> None:
    env = MAKERS[door]()
    env.reset(seed=0)
    for act in (lambda: env.reset(options={"frameskip": 1}), lambda: env.set_context(frameskip=1)):
        with pytest.raises(drm_env.UnknownOptionError, match=r"unexpected .*'frameskip'"):
            act()
    with pytest.raises(drm_env.ConfigError, match=r"horizon is fixed when the environment is made"):
        env.set_context(horizon=3.0)


def test_libraries_that_try_an_argument_find_out_that_there_is_none() -> None:
    """As TorchRL's `GymEnv` does: it tries ``frameskip`` and looks at the error's words."""
    kwargs: dict[str, Any] = {"disable_env_checker": True, "frameskip": 1}
    env = None
    while env is None:
        try:
            env = gym.make(ID, **kwargs)
        except TypeError as error:
            if "unexpected keyword argument 'frameskip'" not in str(error):
                raise
            del kwargs["frameskip"]
    env.reset(seed=0)


NUMBERS: dict[str, Any] = {
    "long double": np.longdouble(320),
    "half": np.float16(320),
    "unsigned": np.uint8(64) * np.uint16(5),
    "array without dimension": np.array(320.0),
    "fraction": fractions.Fraction(640, 2),
    "decimal": decimal.Decimal("320.0"),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_of_every_kind_are_taken(name: str) -> None:
    value = NUMBERS[name]
    env = drm_env.DrmEnv(payload_mass=value)
    assert env.reset(seed=0)[1]["context/payload_mass"] == 320.0
    other = drm_env.DrmEnv()
    assert other.reset(seed=0, options={"payload_mass": value})[1]["context/payload_mass"] == 320.0
    scenario = {"payload": {"mass": value}, "horizon": 0.1}
    same = drm_env.simulate({"payload": {"mass": 320.0}, "horizon": 0.1})
    np.testing.assert_equal(drm_env.simulate(scenario).metrics, same.metrics)


@pytest.mark.parametrize(
    "value",
    [
        np.longdouble("inf"),
        np.clongdouble(1),
        3 + 0j,
        10**400,
        -(10**5000),
        np.datetime64("2020-01-01", "ns"),
        decimal.Decimal("NaN"),
        fractions.Fraction(10**400),
        np.array("heavy"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_numbers_that_are_none_are_refused_by_name(value: Any) -> None:
    for act in (
        lambda: drm_env.DrmEnv(payload_mass=value),
        lambda: drm_env.DrmEnv(horizon=value),
        lambda: drm_env.DrmVectorEnv(1, payload_mass=value),
        lambda: drm_env.DrmEnv().set_context(payload_mass=value),
        lambda: drm_env.simulate({"payload": {"mass": value}}),
    ):
        with pytest.raises(drm_env.ConfigError, match=r"mass|horizon") as raised:
            act()
        assert len(str(raised.value)) < 200


class Listed(Sequence[Any]):
    """A sequence that is neither list nor tuple, as OmegaConf's."""

    def __init__(self, *items: Any) -> None:
        self.items = items

    def __getitem__(self, index: Any) -> Any:
        return self.items[index]

    def __len__(self) -> int:
        return len(self.items)


@pytest.mark.parametrize(
    "choices",
    [
        [60.0, 70.0, 80.0],
        Listed(60.0, 70.0, 80.0),
        collections.deque([60.0, 70.0, 80.0]),
        range(60, 81, 10),
        np.array([60.0, 70.0, 80.0]),
        np.array([60, 70, 80], dtype=np.longdouble),
    ],
    ids=lambda value: type(value).__name__,
)
def test_sequences_of_every_kind_are_choices(choices: Any) -> None:
    env = drm_env.DrmEnv(payload_mass=choices)
    masses = {env.reset(seed=seed)[1]["context/payload_mass"] for seed in range(40)}
    assert masses == {60.0, 70.0, 80.0}
    times = drm_env.DrmEnv(preview_times=Listed(0.5, 1.0))
    assert times.config_json == drm_env.DrmEnv(preview_times=[0.5, 1.0]).config_json
    names = drm_env.DrmEnv(actuators=Listed("tip_wheel"), modes=range(5, 7), plant="consistent")
    assert names.config.task.actuators == ("tip_wheel",)
    assert names.config.scenario.modes == (5, 6)


def test_sequences_longer_than_any_option_are_refused() -> None:
    with pytest.raises(drm_env.ConfigError, match=r"payload_mass must have at most .* entries"):
        drm_env.DrmEnv(payload_mass=range(10**12))


def nested(levels: int) -> Any:
    data: Any = {}
    for _ in range(levels):
        data = {"payload": data}
    return data


def test_deep_nesting_is_refused_by_name(tmp_path: Path) -> None:
    looped: dict[str, Any] = {}
    looped["payload"] = looped
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    path = tmp_path / "deep.json"
    path.write_text(json.dumps(nested(200)))
    toml = tmp_path / "deep.toml"
    toml.write_text("payload = " + "[" * 50_000)
    for act in (
        lambda: drm_env.simulate(nested(100_000)),
        lambda: drm_env.simulate(looped),
        lambda: drm_env.rollout([nested(100_000)]),
        lambda: drm_env.DrmEnv(scenario=nested(100_000)),
        lambda: drm_env.DrmEnv(config=looped),
        lambda: drm_env.DrmEnv(config=path),
        lambda: drm_env.DrmEnv(config=toml),
        lambda: drm_env.DrmEnv(payload_mass=deep),
        lambda: drm_env.simulate(law=nested(100_000)),
        lambda: drm_env.DrmVectorEnv(1).reset(options={"payload_mass": deep}),
    ):
        with pytest.raises(drm_env.ConfigError, match=r"payload|deep.toml") as raised:
            act()
        assert len(str(raised.value)) < 300


# -- Options of episodes -----------------------------------------------------------------------


def test_list_of_options_gives_each_sub_environment_its_own() -> None:
    env = drm_env.DrmVectorEnv(3, horizon=0.1)
    each = [{"payload_mass": 60.0}, {}, {"slew_angle": 0.5, "payload_mass": np.float32(80)}]
    _, info = env.reset(seed=4, options=each)
    _, own = drm_env.DrmEnv(horizon=0.1).reset(seed=5)
    assert info["context/payload_mass"].tolist() == [60.0, own["context/payload_mass"], 80.0]
    assert info["context/slew_angle"][2] == 0.5 != info["context/slew_angle"][0]
    before = env.get_state()
    for bad, match in (
        ([{}, {}], "3 entries, got 2"),
        ([{}, {}, 3], "mapping, got int"),
        ([{}, {}, {"payload_mass": -1.0}], "mass.*-1"),
        ("abc", "mapping"),
        (3, "mapping"),
    ):
        with pytest.raises(drm_env.ConfigError, match=match):
            env.reset(options=bad)  # type: ignore[arg-type]
    assert env.get_state() == before
    env.reset(options=[None, {}, None])
    env.reset(options=({}, {}, {}))  # type: ignore[arg-type]


def test_list_of_options_of_the_wrong_length_is_refused_by_the_sb3_adapter() -> None:
    env = make_sb3_vec(ID, 2, monitor=False)
    env.set_options([{"payload_mass": 60.0}])
    with pytest.raises(drm_env.ConfigError, match=r"2 entries, got 1"):
        env.reset()


# -- Attributes --------------------------------------------------------------------------------


@pytest.mark.parametrize("door", ["single", "make", "batch", "make_vec", "sync", "sb3"])
def test_options_cannot_be_set_as_attributes(door: str) -> None:
    env = MAKERS[door](payload_mass=339.0, horizon=0.1)
    for name, match in (
        ("payload_mass", r"payload_mass is an option.*set_context\(payload_mass="),
        ("horizon", r"horizon is an option.*make a new environment with horizon="),
    ):
        set_attr = (
            env.unwrapped.set_attr if hasattr(env.unwrapped, "set_attr") else env.set_wrapper_attr
        )
        with pytest.raises(drm_env.ConfigError, match=match):
            set_attr(name, 77.0)
        with pytest.raises(AttributeError):
            (env.get_attr if hasattr(env, "get_attr") else env.get_wrapper_attr)(name)
        if door in ("single", "batch", "sb3"):
            with pytest.raises(drm_env.ConfigError, match=match):
                setattr(env.unwrapped, name, 77.0)
    set_attr("label", 3)


def test_what_a_batch_shares_cannot_be_set_for_one() -> None:
    env = drm_env.DrmVectorEnv(2)
    with pytest.raises(drm_env.ConfigError, match=r"config is that of the whole batch"):
        env.set_attr("config", None)
    with pytest.raises(drm_env.ConfigError, match=r"render_mode is that of the whole batch"):
        env.envs[0].render_mode = "ansi"


def test_attributes_are_reached_through_gymnasiums_methods() -> None:
    env = make_sb3_vec(ID, 2, seed=3, horizon=0.1)
    env.reset()
    assert env.env_method("get_wrapper_attr", "control_period") == [0.01] * 2
    assert env.env_method("has_wrapper_attr", "nothing") == [False] * 2
    assert env.env_method("set_wrapper_attr", "label", 5) == [True] * 2
    assert env.env_method("set_wrapper_attr", "other", 5, force=False) == [False] * 2
    assert env.get_attr("label") == [5, 5]
    assert env.get_attr("np_random_seed") == [3, 4]


# -- Seeds -------------------------------------------------------------------------------------


def test_seed_of_an_unseeded_environment_repeats_its_episodes() -> None:
    env = drm_env.DrmEnv(horizon=0.05)
    episodes = [env.reset()[0].tobytes() for _ in range(3)]
    again = drm_env.DrmEnv(horizon=0.05)
    assert episodes[0] == again.reset(seed=env.np_random_seed)[0].tobytes()
    assert episodes[1:] == [again.reset()[0].tobytes() for _ in range(2)]
    wrapped = gym.make(ID, horizon=0.05)
    first = wrapped.reset()[0].tobytes()
    assert first == drm_env.DrmEnv(horizon=0.05).reset(seed=wrapped.np_random_seed)[0].tobytes()


def test_generator_that_is_given_makes_the_seed() -> None:
    first, second = drm_env.DrmEnv(), drm_env.DrmEnv()
    for env in (first, second):
        env.np_random = np.random.default_rng(8)
    assert first.np_random_seed == -1
    assert first.reset()[1] == second.reset()[1]


def test_seeds_of_an_unseeded_batch_repeat_its_episodes() -> None:
    env = drm_env.DrmVectorEnv(3, horizon=0.05)
    first = env.reset()[0]
    np.testing.assert_array_equal(
        first, drm_env.DrmVectorEnv(3, horizon=0.05).reset(seed=env.np_random_seed)[0]
    )
    for index, seed in enumerate(env.np_random_seed):
        alone = drm_env.DrmEnv(horizon=0.05).reset(seed=seed)[0]
        assert alone.tobytes() == first[index].tobytes()
    sync = gym.make_vec(ID, num_envs=3, vectorization_mode="sync", horizon=0.05)
    for seed in (9, [4, 5, 7]):
        env.reset(seed=seed)
        sync.reset(seed=seed)  # type: ignore[arg-type]
        assert env.np_random_seed == sync.np_random_seed
    env.reset(seed=[None, 50, 60], options={"reset_mask": np.array([True, True, False])})
    assert env.np_random_seed == (4, 50, 7)
    venv = make_sb3_vec(ID, 2, monitor=False, horizon=0.05)
    first = venv.reset()
    for index, seed in enumerate(venv.get_attr("np_random_seed")):
        assert drm_env.DrmEnv(horizon=0.05).reset(seed=seed)[0].tobytes() == first[index].tobytes()


# -- The Stable-Baselines3 door ----------------------------------------------------------------


def test_sb3_door_takes_what_gymnasiums_doors_take() -> None:
    assert make_sb3_vec(ID, num_envs=3).num_envs == 3
    assert make_sb3_vec(f"drm_env:{ID}", 2).num_envs == 2
    spec = gym.make(ID, payload_mass=(60.0, 70.0), max_episode_steps=9).spec
    env = make_sb3_vec(spec, 2, 0)
    env.reset()
    assert env.get_attr("spec") == [spec, spec]
    batch = gym.make_vec(ID, num_envs=4, payload_mass=(60.0, 70.0)).spec
    assert make_sb3_vec(batch).num_envs == 4
    assert make_sb3_vec(batch, 2).num_envs == 2
    gym.register("drm_env_test/Class-v0", entry_point=drm_env.DrmEnv, kwargs={"horizon": 0.5})
    try:
        (found,) = make_sb3_vec("drm_env_test/Class-v0").get_attr("spec")
        assert found.max_episode_steps == 50
    finally:
        del gym.registry["drm_env_test/Class-v0"]


def test_sb3_door_refuses_what_it_cannot_do() -> None:
    from gymnasium.wrappers import RescaleAction

    wrapped = RescaleAction(gym.make(ID), np.float32(-2), np.float32(2)).spec
    for arguments, options, match in (
        ((wrapped,), {}, r"additional_wrappers .*RescaleAction"),
        ((ID, 2), {"num_envs": 2}, r"one of n_envs and num_envs"),
        ((ID,), {"num_envs": 0}, r"num_envs.*0"),
        ((3,), {}, r"env_id must be an id or an EnvSpec, got 3"),
        (("Pendulum-v1",), {}, r"Pendulum-v1"),
        (("no_such_module:Env-v0",), {}, r"no_such_module"),
        ((ID,), {"wrappers": [RescaleAction]}, r"wrappers"),
        ((ID,), {"vectorization_mode": "sync"}, r"vectorization_mode.*sync"),
        ((ID,), {"copy": False}, r"copy is fixed"),
    ):
        with pytest.raises(drm_env.ConfigError, match=match):
            make_sb3_vec(*arguments, **options)


# -- Distributions as a context ----------------------------------------------------------------


def test_context_can_be_drawn_anew_in_each_episode() -> None:
    """A curriculum: wider ranges as training goes on, in the same environment."""
    env = drm_env.DrmEnv(payload_mass=100.0, horizon=0.05)
    env.set_context(payload_mass=(200.0, 300.0), deployment_mode=["coincident", "none"])
    env.reset(seed=0)
    infos = [env.reset()[1] for _ in range(30)]
    masses = [info["context/payload_mass"] for info in infos]
    assert len(set(masses)) == 30 and 200.0 <= min(masses) < 220.0 < 280.0 < max(masses) <= 300.0
    assert {info["context/deployment_mode"] for info in infos} == {0.0, 2.0}
    # the draws are those of an environment that has the ranges as options
    other = drm_env.DrmEnv(
        payload_mass=(200.0, 300.0), deployment_mode=["coincident", "none"], horizon=0.05
    )
    other.reset(seed=0)
    assert [other.reset()[1] for _ in range(30)] == infos
    again = drm_env.DrmEnv(payload_mass=100.0, horizon=0.05)
    again.set_state(env.get_state())
    assert again.reset()[1] == env.reset()[1] == other.reset()[1]
    env.set_context()
    assert env.reset()[1]["context/payload_mass"] == 100.0


def test_context_of_a_batch_can_be_drawn() -> None:
    env = drm_env.DrmVectorEnv(8, payload_mass=100.0, horizon=0.05)
    env.set_context(payload_mass=drm_env.LogUniform(200.0, 300.0))
    _, info = env.reset(seed=0, options={"slew_angle": (0.5, 0.6)})
    assert len(set(info["context/payload_mass"].tolist())) == 8
    assert ((info["context/slew_angle"] >= 0.5) & (info["context/slew_angle"] <= 0.6)).all()
    venv = make_sb3_vec(ID, 2, monitor=False, payload_mass=100.0)
    venv.env_method("set_context", indices=[1], payload_mass=(200.0, 300.0))
    venv.reset()
    masses = [info["context/payload_mass"] for info in venv.reset_infos]
    assert masses[0] == 100.0 and 200.0 <= masses[1] <= 300.0


@pytest.mark.parametrize(
    "context",
    [
        {"payload_mass": (-5.0, 100.0)},
        {"payload_mass": (100.0, 5.0)},
        {"payload_mass": drm_env.Normal(100.0, -1.0)},
        {"deployment_end": (8.0, 80.0)},
        {"slew_profile": ["min_time", "sinus"]},
        {"payload_mass": ["heavy", "light"]},
        {"payload_mass": []},
    ],
    ids=str,
)
def test_impossible_distribution_as_a_context_changes_nothing(context: dict[str, Any]) -> None:
    for env in (drm_env.DrmEnv(), drm_env.DrmVectorEnv(2)):
        env.reset(seed=0)
        before = env.get_state()
        with pytest.raises(drm_env.ConfigError, match=r"mass|deployment|slew_profile|profile"):
            env.set_context(**context)
        assert env.get_state() == before


# -- Tables ------------------------------------------------------------------------------------


def test_trajectories_and_metrics_are_tables_for_pandas() -> None:
    pandas = pytest.importorskip("pandas")
    trajectory = drm_env.simulate({"horizon": 0.2})
    frame = pandas.DataFrame(trajectory)
    assert list(frame.columns) == list(trajectory) and len(frame) == trajectory["time"].size > 50
    np.testing.assert_array_equal(frame["slew_angle"], trajectory["slew_angle"])
    flown = drm_env.rollout(
        [{"horizon": 0.2}, {"horizon": 0.1}], signals=["time", "tip_deflection"], decimation=5
    )
    table = pandas.DataFrame(flown)
    assert list(table.columns) == list(flown) and len(table) == 2
    short = flown.trajectory(1)
    assert pandas.DataFrame(short)["time"].iloc[-1] == pytest.approx(0.1)
    np.testing.assert_array_equal(
        short["tip_deflection"], drm_env.simulate({"horizon": 0.1}, decimation=5)["tip_deflection"]
    )
    np.testing.assert_equal(short.metrics["peak_deflection"], flown["peak_deflection"][1])
    with pytest.raises(IndexError):
        flown.trajectory(2)
