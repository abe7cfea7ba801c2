"""What a learned policy was given to learn from: steps, updates and time, by its own record."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from drm_baselines.support.format import significant


@dataclass(frozen=True, kw_only=True)
class Budget:
    """What one training took, or the mean over the seeds of a method.

    Attributes
    ----------
    steps
        Decisions of all environments together.
    updates
        How often the policy was changed by new experience: batches of experience for the
        algorithms that learn from what the policy has just done (PPO), gradient steps for those
        that learn from a buffer (SAC, TD3, TQC, CrossQ), rounds and gradient steps of refinement
        for imitation.
    minutes
        Time of the training, min, on the machine that it ran on.

    What the record does not say is ``None``.
    """

    steps: float | None
    updates: float | None
    minutes: float | None

    def told(self) -> str:
        """Return it in words: ``"1.54 M steps, 40 updates, 0.983 min"``."""
        parts = []
        if self.steps is not None:
            large = self.steps >= 1e5
            number = significant(self.steps / 1e6) if large else f"{self.steps:,.0f}"
            parts.append(f"{number} M steps" if large else f"{number} steps")
        if self.updates is not None:
            parts.append(f"{self.updates:,.0f} updates")
        if self.minutes is not None:
            parts.append(f"{significant(self.minutes)} min")
        return ", ".join(parts)


def budget_of(training: Mapping[str, Any]) -> Budget:
    """Return what the record of a training says.

    Parameters
    ----------
    training
        The entry ``training`` of a policy's description. It may come from a stranger: what is no
        positive number counts as not said.
    """
    seconds = _number(training.get("wall_time"))
    return Budget(
        steps=_number(training.get("steps")),
        updates=updates_of(training),
        minutes=None if seconds is None else seconds / 60.0,
    )


def mean_budget(trainings: Mapping[Any, Mapping[str, Any]]) -> Budget | None:
    """Return the mean over several trainings, ``None`` if they say nothing."""
    found = [budget_of(training) for training in trainings.values()]

    def mean(name: str) -> float | None:
        values = [getattr(each, name) for each in found]
        return float(np.mean(values)) if values and None not in values else None

    whole = Budget(steps=mean("steps"), updates=mean("updates"), minutes=mean("minutes"))
    return whole if whole.told() else None


def updates_of(training: Mapping[str, Any]) -> int | None:
    """Return the updates of a training, see :class:`Budget`; ``None`` if the record lacks them.

    New records state the number; of older ones it follows from the steps and the settings.
    """
    stated = _number(training.get("updates"))
    if stated is not None:
        return round(stated)
    settings, steps = training.get("hyperparameters"), _number(training.get("steps"))
    if not isinstance(settings, Mapping):
        return None
    if training.get("algorithm") == "dagger":
        return _of_imitation(settings)
    model, count = settings.get("model"), _number(settings.get("n_envs"))
    if not isinstance(model, Mapping) or steps is None or count is None:
        return None
    return updates_after(model, round(count), round(steps))


def updates_after(model: Mapping[str, Any], n_envs: int, steps: int) -> int | None:
    """Return the updates that Stable-Baselines3 makes in ``steps`` decisions of ``n_envs`` arms.

    Parameters
    ----------
    model
        Arguments of the algorithm's class: with ``n_steps`` it learns from each batch of that many
        steps an environment, with ``train_freq`` it makes ``gradient_steps`` every so many.
    """
    batch = _number(model.get("n_steps"))
    if batch is not None:
        return math.ceil(steps / (batch * n_envs))
    every, each = _number(model.get("train_freq")), model.get("gradient_steps", 1)
    if every is None or isinstance(each, bool) or not isinstance(each, int):
        return None
    waiting = _number(model.get("learning_starts")) or 0.0
    at_once = every * n_envs
    rounds = max(0, int(steps // at_once) - int(waiting // at_once))
    return rounds * (each if each >= 0 else round(at_once))


def _of_imitation(settings: Mapping[str, Any]) -> int | None:
    stages = [settings.get(name) for name in ("refinement", "settling")]
    parts = [settings.get("rounds")]
    parts += [stage.get("steps") for stage in stages if isinstance(stage, Mapping)]
    numbers = [_number(part) for part in parts]
    known = [number for number in numbers if number is not None]
    return round(sum(known)) if known else None


def _number(value: Any) -> float | None:
    """A positive number that a file states, if it does."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value) if 0 < value < 2**53 else None
