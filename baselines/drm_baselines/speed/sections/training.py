"""Section ``training``: where the time of PPO goes, and how it was cut, at equal updates."""

from __future__ import annotations

import functools
import importlib
import importlib.util
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from drm_baselines.speed.measure import Spread, paired_ratio, seconds_of
from drm_baselines.speed.results import Bench, Row, Section

if TYPE_CHECKING:
    from stable_baselines3 import PPO

ENV_ID = "drm_env/SlewResidual-v1"
SHAPES = ((32, 128, 256, 10), (64, 64, 512, 10), (128, 200, 2560, 5))
"""Environments, steps of each an update, samples of a minibatch, epochs: those of docs/training.md,
of docs/learning.md, and of the packaged settings."""
PARTS = ("update", "engine", "infos", "inference", "buffer")
"""Updates, the engine's steps, infos and wrappers around them, actions with the loop around them,
and what is done with the buffer."""
_TITLE = "Training: where PPO's time goes"


class Clock:
    """Adds up what some methods of a model and its environments take.

    Parameters
    ----------
    model
        A model on a batch of this project, whose methods are timed from now on.
    """

    def __init__(self, model: PPO) -> None:
        self.spent = dict.fromkeys(("update", "rollout", "engine", "step", "buffer"), 0.0)
        env: Any = model.env
        self._time(model, "train", "update")
        self._time(model, "collect_rollouts", "rollout")
        self._time(env, "step", "step")
        self._time(env.unwrapped.batch, "advance", "engine")
        self._time(model.rollout_buffer, "add", "buffer")
        self._time(model.rollout_buffer, "compute_returns_and_advantage", "buffer")

    def _time(self, owner: Any, name: str, part: str) -> None:
        method: Callable[..., Any] = getattr(owner, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            found: list[Any] = []
            self.spent[part] += seconds_of(lambda: found.append(method(*args, **kwargs)))
            return found[0]

        setattr(owner, name, timed)


def shares(model: PPO, frames: int) -> dict[str, float]:
    """Learn once and return the share of the time that each of :data:`PARTS` takes."""
    clock = Clock(model)
    total = seconds_of(
        lambda: model.learn(frames, reset_num_timesteps=False, log_interval=1_000_000)
    )
    spent = clock.spent
    parts = {
        **spent,
        "infos": spent["step"] - spent["engine"],
        "inference": spent["rollout"] - spent["step"] - spent["buffer"],
    }
    return {name: parts[name] / total for name in PARTS}


def models(shape: tuple[int, int, int, int]) -> dict[str, PPO]:
    """Return the library's model with its usual environments, and the one of ``drm train``."""
    from stable_baselines3 import PPO

    from drm_env.sb3 import make_sb3_vec

    # looked up by name: the room of training is above this one
    fast: type[PPO] = importlib.import_module("drm_baselines.rl.fast_ppo").FastPPO
    n_envs, n_steps, batch_size, n_epochs = shape
    made = {}
    for name, kind, plain in (("stock", PPO, True), ("ours", fast, False)):
        env = make_sb3_vec(ENV_ID, n_envs=n_envs, seed=0, monitor=plain, step_context=plain)
        made[name] = kind(
            "MlpPolicy", env, n_steps=n_steps, batch_size=batch_size, n_epochs=n_epochs,
            device="cpu", seed=0,
        )  # fmt: skip
    return made


def run(bench: Bench) -> Section:
    """Learn in turn with both loops, then once more with clocks in them."""
    if importlib.util.find_spec("stable_baselines3") is None:
        note = "left out: stable-baselines3 is not installed (the extra 'learn' has it)"
        return Section("training", _TITLE, [], [note])
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return _measured(bench)
    finally:
        torch.set_num_threads(before)


def _steps_per_second(model: PPO, frames: int) -> float:
    taken = seconds_of(
        lambda: model.learn(frames, reset_num_timesteps=False, log_interval=1_000_000)
    )
    return frames / taken


def _measured(bench: Bench) -> Section:
    rows: list[Row] = []
    notes: list[str] = []
    headline: dict[str, float | None] = {}
    for shape in SHAPES:
        frames = shape[0] * shape[1]
        made = models(shape)

        for model in made.values():
            _steps_per_second(model, frames)  # warm
        label = f"{shape[0]} x {shape[1]} steps, minibatches of {shape[2]}, {shape[3]} epochs"
        measured = bench.interleave(
            f"training: {label}",
            {
                name: functools.partial(_steps_per_second, model, frames)
                for name, model in made.items()
            },
        )
        ratio = paired_ratio(measured["ours"], measured["stock"])
        rows.append(
            Row(f"drm train, {label}", Spread.of(measured["ours"]), "steps/s", ratio, "stock")
        )
        rows.append(Row(f"stock, {label}", Spread.of(measured["stock"]), "steps/s"))
        headline[f"training_{shape[0]}x{shape[1]}_over_stock"] = ratio.median
        for name, model in made.items():
            told = shares(model, frames)
            parts = ", ".join(f"{part} {100 * share:.0f} %" for part, share in told.items())
            notes.append(f"{'drm train' if name == 'ours' else name}, {label}: {parts}.")
            assert model.env is not None
            model.env.close()
    notes.append(
        "Stock is Stable-Baselines3's PPO on drm_env.sb3.make_sb3_vec, ours the one of drm train "
        "with fast_updates: the same algorithm, minibatches and networks, one torch thread each. "
        "The shares are of one more update with clocks in it; inference has the loop around it."
    )
    return Section("training", _TITLE, rows, notes, headline)
