"""Section ``step``: one environment through Gymnasium, beside Pendulum and the engine alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils.performance import benchmark_step

import drm_env
from drm_baselines.speed import engine
from drm_baselines.speed.measure import (
    Measured,
    Spread,
    paired_ratio,
    seconds_per_call,
)
from drm_baselines.speed.results import Bench, Row, Section

ENV_ID, YARDSTICK_ID = "drm_env/Slew-v0", "Pendulum-v1"
ACTION = 0.01
"""The small action that is held all the time, in each entry."""

_ENGINE = "engine alone, inside Rust"
_BARE = "DrmEnv without wrappers, fixed action"
_MADE = "gym.make of Slew, fixed action"
_PENDULUM = "gym.make of Pendulum, fixed action"
_SAMPLED = "gym.make of Slew, gymnasium's benchmark_step"
_PENDULUM_SAMPLED = "gym.make of Pendulum, gymnasium's benchmark_step"
_MICRO = "us/step"
_ENGINE_STEPS = 20_000


def stepper(env: gym.Env[Any, Any], seed: int = 0) -> Callable[[], None]:
    """Return a function that makes one step with a fixed small action and resets at an end."""
    action = np.full(env.action_space.shape or (), ACTION, dtype=np.float32)
    env.reset(seed=seed)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    return step


def above(values: Measured, name: str, reference: str) -> Spread:
    """Return the spread of how much more ``name`` takes than ``reference``, pair by pair."""
    return Spread.of(values[name] - values[reference])


def run(bench: Bench) -> Section:
    """Measure steps of one environment."""
    notes = [
        f"Times include the resets at the ends of episodes; the action is {ACTION} in every entry, "
        "or sampled where gymnasium.utils.performance.benchmark_step makes the loop."
    ]
    env = gym.make(ENV_ID)
    pendulum = gym.make(YARDSTICK_ID)
    bare = drm_env.DrmEnv()
    sampled, pendulum_sampled = gym.make(ENV_ID), gym.make(YARDSTICK_ID)

    def timed(environment: gym.Env[Any, Any]) -> Callable[[], float]:
        step = stepper(environment)
        return lambda: 1e6 * seconds_per_call(step, bench.seconds, block=100)

    def gymnasium_loop(environment: gym.Env[Any, Any]) -> Callable[[], float]:
        return lambda: 1e6 / benchmark_step(environment, target_duration=bench.seconds, seed=0)

    candidates = {
        _MADE: timed(env),
        _BARE: timed(bare),
        _PENDULUM: timed(pendulum),
        _SAMPLED: gymnasium_loop(sampled),
        _PENDULUM_SAMPLED: gymnasium_loop(pendulum_sampled),
    }
    if engine.available("env_benchmark"):
        config = drm_env.resolve()

        def alone() -> float:
            return 1e6 * engine.env_benchmark(config, _ENGINE_STEPS) / _ENGINE_STEPS

        candidates = {_ENGINE: alone, **candidates}
    else:
        notes.append("engine left out: the installed engine has no env_benchmark")
    try:
        measured = bench.interleave("step", candidates)
    finally:
        for environment in (env, pendulum, bare, sampled, pendulum_sampled):
            environment.close()

    partners = {
        _MADE: [_PENDULUM, _ENGINE],
        _BARE: [_ENGINE],
        _SAMPLED: [_PENDULUM_SAMPLED],
    }
    rows: list[Row] = []
    for name, values in measured.items():
        pairs = [partner for partner in partners.get(name, ()) if partner in measured]
        rows.extend(
            Row(name, Spread.of(values), _MICRO, paired_ratio(values, measured[partner]), partner)
            for partner in pairs
        )
        if not pairs:
            rows.append(Row(name, Spread.of(values), _MICRO))
    headline: dict[str, float | None] = {
        "step_us": Spread.of(measured[_MADE]).median,
        "step_over_pendulum": paired_ratio(measured[_MADE], measured[_PENDULUM]).median,
        "step_us_above_engine": None,
    }
    if _ENGINE in measured:
        for name in (_MADE, _BARE):
            difference = above(measured, name, _ENGINE)
            rows.append(Row(f"{name}: above the engine's own time", difference, _MICRO))
        headline["step_us_above_engine"] = above(measured, _MADE, _ENGINE).median
    return Section("step", "One step of one environment", rows, notes, headline)
