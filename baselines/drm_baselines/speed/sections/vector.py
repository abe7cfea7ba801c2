"""Section ``vector``: batches, beside NumPy's CartPole, the engine and single environments."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

import drm_env
from drm_baselines.speed import engine
from drm_baselines.speed.measure import (
    Measured,
    Spread,
    paired_ratio,
    seconds_per_call,
)
from drm_baselines.speed.results import (
    Bench,
    Curve,
    Row,
    Section,
    cores,
)
from drm_baselines.speed.sections.step import ACTION, ENV_ID, stepper

SIZES = (1, 4, 16, 64, 256, 1024, 4096)
_FEW = 4
_UNIT = "us/batch step"
_OURS, _CARTPOLE, _ALONE = "gym.make_vec of Slew", "NumPy CartPole", "engine alone"
_ENGINE_STEPS = 200_000
_EPISODE = 2000
_POOL = 64


def batch_stepper(env: gym.vector.VectorEnv[Any, Any, Any], seed: int = 0) -> Callable[[], None]:
    """Return a function that makes one step of a batch; it resets itself.

    Boxes get a fixed small action, discrete spaces random ones drawn beforehand.
    """
    space = env.action_space
    env.reset(seed=seed)
    if isinstance(space, gym.spaces.Box):
        actions = [np.full(space.shape, ACTION, dtype=space.dtype)]
    else:
        space.seed(seed)
        actions = [space.sample() for _ in range(_POOL)]
    turn = 0

    def step() -> None:
        nonlocal turn
        env.step(actions[turn % len(actions)])
        turn += 1

    return step


def _size(bench: Bench, num_envs: int, config: drm_env.ResolvedConfig) -> Measured:
    ours = gym.make_vec(ENV_ID, num_envs=num_envs)
    cartpole = gym.make_vec(
        "CartPole-v1", num_envs=num_envs, vectorization_mode="vector_entry_point"
    )

    def timed(env: gym.vector.VectorEnv[Any, Any, Any]) -> Callable[[], float]:
        step = batch_stepper(env)
        block = max(1, 256 // num_envs)
        return lambda: 1e6 * seconds_per_call(step, bench.seconds, block=block)

    # A step costs less once the arm is deployed: both make the same ones of the same episodes.
    steps = min(_EPISODE - 1, max(20, _ENGINE_STEPS // num_envs))
    actions = np.full(ours.action_space.shape or (), ACTION, dtype=np.float32)

    def through_gymnasium() -> float:
        ours.reset(seed=0)
        ours.step(actions)
        begin = time.perf_counter()
        for _ in range(steps):
            ours.step(actions)
        return 1e6 * (time.perf_counter() - begin) / steps

    candidates = {_OURS: through_gymnasium, _CARTPOLE: timed(cartpole)}
    if engine.available("batch_benchmark"):

        def alone() -> float:
            return 1e6 * engine.batch_benchmark(config, num_envs, steps, None) / steps

        candidates[_ALONE] = alone
    try:
        return bench.interleave(f"vector: {num_envs}", candidates)
    finally:
        ours.close()
        cartpole.close()


def _against_single(bench: Bench) -> Row:
    batch = gym.make_vec(ENV_ID, num_envs=_FEW)
    singles = [gym.make(ENV_ID) for _ in range(_FEW)]
    steps = [stepper(env, seed) for seed, env in enumerate(singles)]

    def loop() -> None:
        for step in steps:
            step()

    step_batch = batch_stepper(batch)
    candidates = {
        "batch": lambda: 1e6 * seconds_per_call(step_batch, bench.seconds, block=25),
        "loop": lambda: 1e6 * seconds_per_call(loop, bench.seconds, block=25),
    }
    try:
        measured = bench.interleave(f"vector: {_FEW} singly", candidates)
    finally:
        batch.close()
        for env in singles:
            env.close()
    return Row(
        f"{_OURS}, {_FEW}",
        Spread.of(measured["batch"]),
        _UNIT,
        paired_ratio(measured["batch"], measured["loop"]),
        f"a loop over {_FEW} single environments of gym.make",
    )


def run(bench: Bench) -> Section:
    """Measure batches of all sizes."""
    notes = [
        f"A step of Slew is a control period of 10 ms (20 Runge-Kutta steps of each environment), "
        f"one of CartPole is one Euler step. Threads as many as pay off, {cores()} core(s); resets "
        "included."
    ]
    if not engine.available("batch_benchmark"):
        notes.append("engine alone left out: the installed engine has no batch_benchmark")
    config = drm_env.resolve()
    rows, headline = [], {}
    lines: dict[str, list[Spread]] = {}
    for num_envs in SIZES:
        measured = _size(bench, num_envs, config)
        for name, values in measured.items():
            lines.setdefault(name, []).append(Spread.of(num_envs * 1e6 / values))
        for partner in (_CARTPOLE, _ALONE):
            if partner in measured:
                ratio = paired_ratio(measured[_OURS], measured[partner])
                rows.append(
                    Row(
                        f"{_OURS}, {num_envs}",
                        Spread.of(measured[_OURS]),
                        _UNIT,
                        ratio,
                        f"{partner}, {num_envs}",
                    )
                )
                key = "cartpole" if partner == _CARTPOLE else "engine"
                headline[f"vector_{num_envs}_over_{key}"] = ratio.median
    rows.append(_against_single(bench))
    curve = Curve(
        "vector-steps",
        "Batches through Gymnasium",
        "environments",
        "environment steps per second",
        {name: (SIZES, values) for name, values in lines.items()},
    )
    return Section("vector", "One step of a batch", rows, notes, headline, [curve])
