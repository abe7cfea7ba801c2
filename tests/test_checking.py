"""`check_vector_env` and `check_sb3_vec_env`: right batches pass, each planted fault is named."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import drm_env
from drm_env import CheckError, check_sb3_vec_env, check_vector_env

ID = "drm_env/Slew-v0"
STAGGERED: dict[str, Any] = {
    "horizon": 0.4,
    "initial_beta": (0.0, 0.02),
    "limits": {"tip_deflection": 0.03},
}
MODES = list(AutoresetMode)


# --- right ones -----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("copied", [True, False])
def test_the_native_batch_passes(mode: AutoresetMode, copied: bool) -> None:
    envs = gym.make_vec(ID, num_envs=4, autoreset_mode=mode, copy=copied, **STAGGERED)
    check_vector_env(envs, single=lambda: gym.make(ID, **STAGGERED))
    check_vector_env(RecordEpisodeStatistics(envs))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", [SyncVectorEnv, AsyncVectorEnv])
def test_those_of_gymnasium_pass(mode: AutoresetMode, kind: type[VectorEnv]) -> None:
    makers = [lambda: gym.make("CartPole-v1")] * 3
    envs = kind(makers, autoreset_mode=mode)
    try:
        check_vector_env(envs, steps=150, single=makers[0])
    finally:
        envs.close()


def test_spaces_that_are_no_boxes() -> None:
    """Observations of several parts, actions that are numbers."""

    class Parts(gym.Env):
        observation_space = gym.spaces.Dict(
            {"a": gym.spaces.Box(-9, 9, (2,)), "b": gym.spaces.Tuple([gym.spaces.Discrete(99)])}
        )
        action_space = gym.spaces.Tuple([gym.spaces.Discrete(3), gym.spaces.Box(-1, 1, (1,))])
        step_number = 0

        def see(self) -> Any:
            draw = self.np_random.uniform(-1, 1, 2).astype(np.float32)
            return {"a": draw, "b": (np.int64(self.step_number),)}

        def reset(self, *, seed: Any = None, options: Any = None) -> Any:
            super().reset(seed=seed)
            self.step_number = 0
            return self.see(), {}

        def step(self, action: Any) -> Any:
            self.step_number += 1
            return self.see(), float(action[0]), False, self.step_number == 5, {}

    for mode in MODES:
        check_vector_env(SyncVectorEnv([Parts] * 2, autoreset_mode=mode), single=Parts)


def test_that_no_episode_has_ended_is_said() -> None:
    envs = gym.make_vec(ID, num_envs=2)
    with pytest.warns(UserWarning, match="no episode has ended in 20 steps"):
        check_vector_env(envs, steps=20)


def test_what_is_no_vector_environment_is_refused() -> None:
    with pytest.raises(drm_env.ConfigError, match="got DrmEnv"):
        check_vector_env(gym.make(ID).unwrapped)  # type: ignore[arg-type]  # the mistake
    with pytest.raises(drm_env.ConfigError, match="steps"):
        check_vector_env(gym.make_vec(ID, num_envs=2), steps=0)


# --- faults ---------------------------------------------------------------------------------------


class Walk(VectorEnv):
    """A batch that is right, with its own memory: random walks that end at the fifth step."""

    def __init__(self, num_envs: int = 3, mode: AutoresetMode = AutoresetMode.NEXT_STEP) -> None:
        self.num_envs, self.mode = num_envs, mode
        self.metadata = {"autoreset_mode": mode}
        self.single_observation_space = gym.spaces.Box(-100, 100, (2,), np.float32)
        self.single_action_space = gym.spaces.Box(-1, 1, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.state = np.zeros((num_envs, 2), np.float32)
        self.age = np.zeros(num_envs, int)
        self.streams = [np.random.default_rng(i) for i in range(num_envs)]

    def begin(self, rows: np.ndarray) -> None:
        for i in np.flatnonzero(rows):
            self.state[i] = self.streams[i].uniform(-1, 1, 2)
            self.age[i] = 0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        if seeds is not None:
            self.streams = [np.random.default_rng(one) for one in seeds]
        rows = (options or {}).get("reset_mask", np.ones(self.num_envs, bool))
        self.begin(rows)
        return self.state.copy(), {}

    def step(self, actions: Any) -> Any:
        stepped = np.ones(self.num_envs, bool)
        if self.mode is AutoresetMode.NEXT_STEP:
            stepped = self.age < 5
            self.begin(~stepped)
        self.state[stepped] += actions[stepped]
        self.age[stepped] += 1
        rewards = np.where(stepped, self.state[:, 0].astype(np.float64), 0.0)
        truncated = stepped & (self.age == 5)
        infos: dict[str, Any] = {}
        if self.mode is AutoresetMode.SAME_STEP and truncated.any():
            infos = {"final_obs": self.state.copy(), "_final_obs": truncated.copy()}
            infos |= {"final_info": {}, "_final_info": truncated.copy()}
            self.begin(truncated)
        return self.state.copy(), rewards, np.zeros(self.num_envs, bool), truncated, infos


class AloneWalk(gym.Env):
    """One of them."""

    def __init__(self, drift: float = 0.0) -> None:
        self.batch, self.drift = Walk(1), drift
        self.observation_space = self.batch.single_observation_space
        self.action_space = self.batch.single_action_space

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        return self.batch.reset(seed=seed)[0][0], {}

    def step(self, action: Any) -> Any:
        observations, rewards, terminated, truncated, _ = self.batch.step(action[None])
        return observations[0] + np.float32(self.drift), rewards[0], terminated[0], truncated[0], {}


@pytest.mark.parametrize("mode", MODES)
def test_the_walk_itself_passes(mode: AutoresetMode) -> None:
    check_vector_env(Walk(mode=mode), single=AloneWalk)


class WrongSpace(Walk):
    def __init__(self) -> None:
        super().__init__()
        self.observation_space = batch_space(self.single_observation_space, 2)


class NoMode(Walk):
    def __init__(self) -> None:
        super().__init__()
        self.metadata = {}


class Doubles(Walk):
    def step(self, actions: Any) -> Any:
        observations, *rest = super().step(actions)
        return observations.astype(np.float64), *rest


class Outside(Walk):
    def step(self, actions: Any) -> Any:
        observations, *rest = super().step(actions)
        observations[1, 0] = 101.0
        return observations, *rest


class FlatRewards(Walk):
    def step(self, actions: Any) -> Any:
        observations, rewards, *rest = super().step(actions)
        return observations, rewards[:, None], *rest


class IntegerFlags(Walk):
    def step(self, actions: Any) -> Any:
        *rest, truncated, infos = super().step(actions)
        return *rest, truncated.astype(int), infos


class NotANumber(Walk):
    def step(self, actions: Any) -> Any:
        observations, rewards, *rest = super().step(actions)
        return observations, rewards * np.nan, *rest


class NoMask(Walk):
    def step(self, actions: Any) -> Any:
        *rest, _ = super().step(actions)
        return *rest, {"speed": np.zeros(self.num_envs)}


class Changes(Walk):
    def step(self, actions: Any) -> Any:
        result = super().step(actions)
        actions *= 2
        return result


class Views(Walk):
    def step(self, actions: Any) -> Any:
        _, *rest = super().step(actions)
        return self.state, *rest


class ViewsOfReset(Walk):
    def reset(self, **arguments: Any) -> Any:
        _, infos = super().reset(**arguments)
        return self.state, infos


class WritesThrough(Walk):
    """The array that is returned is new at each step, and the next step begins from it."""

    def step(self, actions: Any) -> Any:
        self.state = self.state.copy()
        _, *rest = super().step(actions)
        return self.state, *rest


class Unseeded(Walk):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        return super().reset(options=options)


class OneSeed(Walk):
    """All of them get the same seed."""

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        seeds = [seed] * self.num_envs if isinstance(seed, int) else seed
        return super().reset(seed=seeds, options=options)


class OneStream(Walk):
    """Draws of one sub-environment move those of another."""

    def step(self, actions: Any) -> Any:
        self.state[1] += 0.1 * actions[0]
        return super().step(actions)


class PaysResets(Walk):
    def step(self, actions: Any) -> Any:
        observations, _, *rest = super().step(actions)
        return observations, self.state[:, 0].astype(np.float64), *rest


class SecretlySameStep(Walk):
    """Says NEXT_STEP and resets in the same step."""

    def __init__(self) -> None:
        super().__init__(mode=AutoresetMode.SAME_STEP)
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}


class SecretlyNextStep(Walk):
    """Says SAME_STEP and resets at the next step."""

    def __init__(self) -> None:
        super().__init__()
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}


class SameStep(Walk):
    def __init__(self) -> None:
        super().__init__(mode=AutoresetMode.SAME_STEP)


class NoFinal(SameStep):
    def step(self, actions: Any) -> Any:
        return *super().step(actions)[:-1], {}


class FinalOfNext(SameStep):
    def step(self, actions: Any) -> Any:
        result = super().step(actions)
        if "final_obs" in result[-1]:
            result[-1]["final_obs"] = result[0].copy()
        return result


class FinalDoubles(SameStep):
    def step(self, actions: Any) -> Any:
        result = super().step(actions)
        if "final_obs" in result[-1]:
            result[-1]["final_obs"] = result[-1]["final_obs"].astype(np.float64)
        return result


class Disabled(Walk):
    def __init__(self) -> None:
        super().__init__(mode=AutoresetMode.DISABLED)


class MaskIgnored(Disabled):
    """A reset with a mask resets all; one of them is ahead, so that they end at other times."""

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        result = super().reset(seed=seed)
        self.age[0] = 2
        return result


FAULTS = {
    WrongSpace: "observation_space is not single_observation_space for 3 environments",
    NoMode: r"metadata\['autoreset_mode'\] must be an AutoresetMode, got None",
    Doubles: r"not in observation_space \(step 0: dtype float64, the space has float32\)",
    Outside: r"101.0\)? at \(1, 0\), the space has .*-100.0\)? to .*100.0",
    FlatRewards: r"rewards are not floating point numbers of shape \(3,\) .*float64 \(3, 1\)",
    IntegerFlags: r"truncated is not a boolean array of shape \(3,\) \(step 0: int64 \(3,\)\)",
    NotANumber: "rewards are not finite",
    NoMask: r"infos\['speed'\] has no boolean mask infos\['_speed'\]",
    Changes: r"step changes the actions it is given \(step 0\)",
    Views: "arrays that were returned change in later calls",
    ViewsOfReset: "arrays that were returned change in later calls",
    WritesThrough: r"writing into returned arrays changes the flight \(step 1\)",
    Unseeded: "the same seed and actions do not fly the same",
    OneSeed: "not the same as reset",
    OneStream: r"actions of sub-environment 0 change the flights of others \(step 0\)",
    PaysResets: r"the step that resets pays a reward.*\(step 5\)",
    SecretlySameStep: r"infos have final_obs.*\(step 4\)",
    SecretlyNextStep: r"_final_obs'\] is not where episodes have ended \(step 4\)",
    NoFinal: r"_final_obs'\] is not where episodes have ended \(step 4\)",
    FinalOfNext: "is still the last one",
    FinalDoubles: r"infos\['final_obs'\] is not in single_observation_space .*float64",
    MaskIgnored: "reset_mask resets others than those of the mask",
}


@pytest.mark.parametrize("kind", FAULTS, ids=lambda kind: kind.__name__)
def test_a_fault_is_found(kind: type[Walk]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(CheckError, match=FAULTS[kind]) as found:
            check_vector_env(kind(), steps=60)
    assert found.value.faults and kind.__name__ in str(found.value)
    assert isinstance(found.value, AssertionError)


def test_a_sub_environment_that_is_not_the_single_one_is_found() -> None:
    with pytest.raises(CheckError, match=r"sub-environment 0, step 0: observations"):
        check_vector_env(Walk(), single=lambda: AloneWalk(drift=1e-3))


# --- Stable-Baselines3 ----------------------------------------------------------------------------

sb3 = pytest.importorskip("stable_baselines3")

from stable_baselines3.common.vec_env import (  # noqa: E402
    DummyVecEnv,
    VecEnv,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
)

from drm_env.sb3 import DrmSB3VecEnv, make_sb3_vec  # noqa: E402


def test_the_native_batch_of_sb3_passes() -> None:
    def single() -> gym.Env:
        return gym.make(ID, **STAGGERED)

    check_sb3_vec_env(DrmSB3VecEnv(4, **STAGGERED), single=single)
    check_sb3_vec_env(make_sb3_vec(ID, 4, step_context=False, **STAGGERED), single=single)


def test_dummy_vec_env_passes() -> None:
    makers = [lambda: gym.make("CartPole-v1")] * 3
    check_sb3_vec_env(DummyVecEnv(makers), single=makers[0])
    check_sb3_vec_env(VecMonitor(DummyVecEnv(makers)), steps=150)


def test_wrappers_that_have_a_memory_are_seen() -> None:
    """One learns from what it sees, the other hands out its own frames."""
    with pytest.raises(CheckError, match="the same seed and actions do not fly the same"):
        check_sb3_vec_env(VecNormalize(DrmSB3VecEnv(2, **STAGGERED)))
    with pytest.raises(CheckError, match="writing into returned arrays changes the flight"):
        check_sb3_vec_env(VecFrameStack(DrmSB3VecEnv(2, **STAGGERED), 3))
    with pytest.raises(drm_env.ConfigError, match="venv must be a VecEnv, got DrmVectorEnv"):
        check_sb3_vec_env(drm_env.DrmVectorEnv(2))  # type: ignore[arg-type]  # the mistake


class SB3Walk(VecEnv):
    """The walks by the other interface."""

    def __init__(self) -> None:
        self.walk = Walk(mode=AutoresetMode.SAME_STEP)
        super().__init__(3, self.walk.single_observation_space, self.walk.single_action_space)

    def reset(self) -> Any:
        observations, _ = self.walk.reset(seed=self._seeds if None not in self._seeds else None)
        self._reset_seeds()
        return observations

    def step_async(self, actions: Any) -> None:
        self.actions = actions

    def step_wait(self) -> Any:
        observations, rewards, _, dones, info = self.walk.step(self.actions)
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": bool(done)} for done in dones]
        for i in np.flatnonzero(dones):
            infos[i]["terminal_observation"] = info["final_obs"][i]
        return observations, rewards.astype(np.float32), dones, infos

    def close(self) -> None: ...

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [None for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None: ...

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        return []

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]


def test_the_walk_of_sb3_passes() -> None:
    check_sb3_vec_env(SB3Walk(), single=AloneWalk)


class NoTerminal(SB3Walk):
    def step_wait(self) -> Any:
        *rest, infos = super().step_wait()
        return *rest, [{"TimeLimit.truncated": False} for _ in infos]


class NoTimeLimit(SB3Walk):
    def step_wait(self) -> Any:
        *rest, infos = super().step_wait()
        for info in infos:
            del info["TimeLimit.truncated"]
        return *rest, infos


class SameInfos(SB3Walk):
    def step_wait(self) -> Any:
        *rest, infos = super().step_wait()
        return *rest, infos if "terminal_observation" in infos[0] else [infos[0]] * 3


class TerminalOfNext(SB3Walk):
    def step_wait(self) -> Any:
        observations, *rest, infos = super().step_wait()
        for info, observation in zip(infos, observations, strict=True):
            if "terminal_observation" in info:
                info["terminal_observation"] = observation
        return observations, *rest, infos


class ViewsOfSB3(SB3Walk):
    def step_wait(self) -> Any:
        _, *rest = super().step_wait()
        return self.walk.state, *rest


class AnswersAll(SB3Walk):
    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * 3


class FloatDones(SB3Walk):
    def step_wait(self) -> Any:
        observations, rewards, dones, infos = super().step_wait()
        return observations, rewards, dones.astype(np.float32), infos


class UnseededSB3(SB3Walk):
    def reset(self) -> Any:
        self._reset_seeds()
        return super().reset()


SB3_FAULTS = {
    NoTerminal: r"terminal_observation is not in the infos of those that have ended alone \(step 4",
    NoTimeLimit: r"does not say in TimeLimit.truncated",
    SameInfos: "infos are the same dictionaries",
    TerminalOfNext: "is still the last one",
    ViewsOfSB3: "arrays that were returned change in later calls",
    AnswersAll: "env_is_wrapped answers 3 times, not 1",
    FloatDones: r"dones is not a boolean array of shape \(3,\) \(step 0: float32",
    UnseededSB3: "the same seed and actions do not fly the same",
}


@pytest.mark.parametrize("kind", SB3_FAULTS, ids=lambda kind: kind.__name__)
def test_a_fault_of_sb3_is_found(kind: type[SB3Walk]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(CheckError, match=SB3_FAULTS[kind]):
            check_sb3_vec_env(kind())
