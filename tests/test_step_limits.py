"""A step limit means the same whichever way it is given.

`gym.make`, a registered id, a specification, the three vectorizations and the Stable-Baselines3
adapter: the same steps, rewards, charge for ending early, last info and specification.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit

import drm_env
from drm_env.vector import DrmVectorEnv

ID = "drm_env/Slew-v0"
OWN = "drm_env_test/Limited-v0"
LIMIT = 30
# ends early under full torques, long before the limit
EARLY: dict[str, Any] = {"limits": {"slew_error": 0.0004, "tip_deflection": 1.0}}
COMMON: dict[str, Any] = {"payload_mass": 300.0, "mass_error": 0.1, "horizon": 2.0}

Step = tuple[np.ndarray, float, bool, bool, dict[str, Any]]


@pytest.fixture(autouse=True)
def own_id() -> Iterator[None]:
    """An id of the user's own, with a limit in its registration."""
    gym.register(
        OWN,
        entry_point="drm_env.env:DrmEnv",
        vector_entry_point="drm_env.vector:DrmVectorEnv",
        max_episode_steps=LIMIT,
        kwargs={"task": "slew"},
    )
    yield
    del gym.registry[OWN]


def single(env: gym.Env[Any, Any]) -> Iterator[Step]:
    env.reset(seed=0)
    while True:
        yield env.step(np.ones(2, np.float32))


def native(env: gym.vector.VectorEnv) -> Iterator[Step]:
    env.reset(seed=0)
    try:
        while True:
            observations, rewards, ended, cut, info = env.step(np.ones((1, 2), np.float32))
            own = {
                key: values[0] for key, values in info.items() if info.get(f"_{key}", [False])[0]
            }
            yield observations[0], float(rewards[0]), bool(ended[0]), bool(cut[0]), own
    finally:
        env.close()


def sb3(*arguments: Any, **options: Any) -> Iterator[Step]:
    module = pytest.importorskip("drm_env.sb3")
    env = module.make_sb3_vec(*arguments, **options)
    env.seed(0)
    env.reset()
    while True:
        observations, rewards, dones, (info,) = env.step(np.ones((1, 2), np.float32))
        cut = bool(info["TimeLimit.truncated"])
        last = info.get("terminal_observation", observations[0])
        yield last, float(rewards[0]), bool(dones[0]) and not cut, cut, info


def round_trip(options: dict[str, Any]) -> gym.Env[Any, Any]:
    spec = gym.make(ID, max_episode_steps=LIMIT, **options).spec
    assert spec is not None
    return gym.make(EnvSpec.from_json(spec.to_json()))


DOORS: dict[str, Callable[[dict[str, Any]], Iterator[Step]]] = {
    "make": lambda o: single(gym.make(ID, max_episode_steps=LIMIT, **o)),
    "wrapper": lambda o: single(TimeLimit(drm_env.DrmEnv(**o), LIMIT)),
    "registration": lambda o: single(gym.make(OWN, **o)),
    "specification": lambda o: single(round_trip(o)),
    "native": lambda o: native(gym.make_vec(ID, num_envs=1, max_episode_steps=LIMIT, **o)),
    "native class": lambda o: native(DrmVectorEnv(1, max_episode_steps=LIMIT, **o)),
    "native registration": lambda o: native(gym.make_vec(OWN, num_envs=1, **o)),
    "sync": lambda o: native(
        gym.make_vec(ID, 1, vectorization_mode="sync", max_episode_steps=LIMIT, **o)
    ),
    "sync registration": lambda o: native(gym.make_vec(OWN, 1, vectorization_mode="sync", **o)),
    "async": lambda o: native(
        gym.make_vec(ID, 1, vectorization_mode="async", max_episode_steps=LIMIT, **o)
    ),
    "sb3": lambda o: sb3(ID, max_episode_steps=LIMIT, **o),
    "sb3 registration": lambda o: sb3(OWN, **o),
    "sb3 specification": lambda o: sb3(gym.make(ID, max_episode_steps=LIMIT, **o).spec),
}


def episode(steps: Iterator[Step]) -> list[Step]:
    """The steps of the first episode."""
    records = []
    for step in steps:
        records.append(step)
        if step[2] or step[3]:
            return records
        assert len(records) < 1000
    raise AssertionError


@pytest.mark.parametrize("door", DOORS)
def test_limit_truncates_and_the_last_info_is_that_of_the_episode(door: str) -> None:
    records = episode(DOORS[door](COMMON))
    assert len(records) == LIMIT
    *_, terminated, truncated, info = records[-1]
    assert (terminated, truncated) == (False, True)
    reference = drm_env.DrmEnv(**COMMON)
    reference.reset(seed=0)
    for step in records:
        expected = reference.step(np.ones(2, np.float32))
        np.testing.assert_array_equal(step[0], expected[0])
        assert np.float32(step[1]) == np.float32(expected[1])
    assert info["diverged"] == 0.0
    assert info["is_success"] == 0.0
    assert info["metrics/duration"] == pytest.approx(LIMIT * 0.01)
    for key, value in expected[4].items():
        assert info[key] == value, key


@pytest.mark.parametrize("door", DOORS)
def test_ending_early_costs_the_rest_of_the_horizon_whatever_the_limit(door: str) -> None:
    options = {**COMMON, **EARLY}
    records = episode(DOORS[door](options))
    expected = episode(single(drm_env.DrmEnv(**options)))
    assert expected[-1][2] and len(expected) < LIMIT
    assert len(records) == len(expected)
    assert np.float32(records[-1][1]) == np.float32(expected[-1][1])
    assert records[-1][1] < -1.0
    assert records[-1][4]["diverged"] == 1.0
    assert records[-1][4]["metrics/episode_return"] == expected[-1][4]["metrics/episode_return"]


def test_specification_says_where_episodes_end() -> None:
    def steps(spec: EnvSpec | None) -> int | None:
        assert spec is not None
        return spec.max_episode_steps

    assert steps(gym.make(ID, **COMMON).spec) == 200
    assert steps(gym.make_vec(ID, num_envs=2, **COMMON).spec) == 200
    assert steps(gym.make(ID, max_episode_steps=-1, **COMMON).spec) == 200
    assert steps(gym.make_vec(ID, max_episode_steps=-1, **COMMON).spec) == 200
    for make in (gym.make, gym.make_vec):
        assert steps(make(ID, max_episode_steps=LIMIT, **COMMON).spec) == LIMIT  # type: ignore[operator]
        assert steps(make(OWN, **COMMON).spec) == LIMIT  # type: ignore[operator]
    sb3_module = pytest.importorskip("drm_env.sb3")
    (spec,) = sb3_module.make_sb3_vec(OWN, **COMMON).get_attr("spec")
    assert steps(spec) == LIMIT
    assert gym.make(spec).spec == gym.make(OWN, **COMMON).spec


def test_limit_beyond_the_horizon_is_told() -> None:
    with pytest.warns(
        UserWarning, match=r"max_episode_steps=5000 is longer than the horizon of 200"
    ):
        env = gym.make_vec(ID, max_episode_steps=5000, **COMMON)
    assert env.spec is not None and env.spec.max_episode_steps == 200
    env = gym.make(ID, max_episode_steps=5000, **COMMON)
    with pytest.warns(
        UserWarning, match=r"max_episode_steps=5000 is longer than the horizon of 200"
    ):
        spec = env.spec
    assert spec is not None and spec.max_episode_steps == 200
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        again = gym.make(spec)
    assert again.spec == spec
    assert len(episode(single(again))) == len(episode(single(env))) == 200


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"num_envs": 3, "max_episode_steps": 7},
        {"num_envs": 2, "payload_mass": (60.0, 300.0), "autoreset_mode": "SameStep"},
        {"num_envs": 2, "deployment_mode": ["coincident", "none"], "num_threads": 1, "copy": False},
    ],
)
def test_specification_of_a_batch_is_that_of_the_batch_it_makes(options: dict[str, Any]) -> None:
    spec = gym.make_vec(ID, **options).spec
    assert spec is not None
    assert gym.make_vec(spec).spec == spec
    again = EnvSpec.from_json(spec.to_json())
    assert again == spec
    assert gym.make_vec(again).spec == spec


def test_specification_of_a_sub_environment_makes_it_alone() -> None:
    options = {"payload_mass": (60.0, 300.0), "max_episode_steps": 7}
    env = gym.make_vec(ID, num_envs=2, autoreset_mode="SameStep", num_threads=1, **options)
    first, second = env.unwrapped.get_attr("spec")  # type: ignore[attr-defined]
    assert first == second
    assert gym.make(first).spec == gym.make(ID, **options).spec


def test_limit_of_a_batch_holds_in_every_mode_and_after_a_snapshot() -> None:
    for mode in gym.vector.AutoresetMode:
        env = DrmVectorEnv(3, max_episode_steps=5, autoreset_mode=mode, **COMMON)
        env.reset(seed=0)
        for _ in range(2):
            env.step(np.zeros((3, 2), np.float32))
        again = DrmVectorEnv(3, max_episode_steps=5, autoreset_mode=mode, **COMMON)
        again.set_state(env.get_state())
        for index in range(3):
            truncated = again.step(np.zeros((3, 2), np.float32))[3]
            assert truncated.all() == (index == 2)
