"""Refinement of a student by the gradient of the tip error through the plant.

The plant is linear in the wheel torques and known: how a manoeuvre's tip error depends on every
action of a flight follows from one sweep backwards in time (the adjoint of plant, wheels, inner law
and policy), and how the actions depend on the network's weights is what automatic differentiation
is for. The flights themselves are the engine's, and the student flies with what it sees; so it
learns what imitation cannot teach: to find out the payload soon, and to do what is best
for somebody who does not know it yet.

Manoeuvres differ by a factor of 10,000 in what is possible. What is minimised is

    x / (1 + x),  x = sqrt(e / e0)

with e the RMS of the tip error and e0 some millimetres: a manoeuvre counts most where e is near e0,
less where nothing is left to be gained and where nothing can be done. A flight of which a small
change of the actions changes everything gives a huge gradient that says nothing: it is scaled down.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

import drm_env
from drm_baselines.benchmark.programme import torque_limits
from drm_baselines.benchmark.suites import STRATA
from drm_baselines.errors import BaselineError
from drm_baselines.imitation.sensing import SEEN, Array, Sensing, Slope
from drm_baselines.imitation.sensitivity import Derivatives, Intervals, derivatives
from drm_baselines.imitation.student import Student
from drm_baselines.imitation.teacher import Teaching
from drm_baselines.network import Perceptron

_CHUNK = 8192  # observations at a time
# columns of what the policy sees among state (6), momenta (2) and torques (2)
_COLUMNS = np.array([*SEEN, 6, 7, 8, 9])


@dataclass(frozen=True, kw_only=True)
class Refinement:
    """How a student is refined.

    Attributes
    ----------
    manoeuvres
        How many there are to be drawn from, a quarter a stratum.
    steps
        Of the optimiser (Adam; warmed up, then down a cosine).
    batch
        Manoeuvres flown for each step, a quarter a stratum.
    learning_rate
        The largest.
    warm_up
        Steps until it is reached.
    tail
        Seconds after the slew that still count.
    scale
        Tip error RMS e0 (m) at which a manoeuvre counts most.
    floor
        Tip error RMS (m) below which nothing is gained.
    largest
        Largest length of a manoeuvre's gradient: relative change of its tip error by the torques of
        all decisions, in multiples of the wheels' limits.
    """

    manoeuvres: int = 1200
    steps: int = 500
    batch: int = 64
    learning_rate: float = 5.0e-4
    warm_up: int = 10
    tail: float = 4.0
    scale: float = 3.0e-3
    floor: float = 2.0e-4
    largest: float = 2.0

    def __post_init__(self) -> None:
        """Check that the manoeuvres can be shared among the strata."""
        for name in ("manoeuvres", "batch"):
            value = getattr(self, name)
            if value < len(STRATA) or value % len(STRATA):
                raise BaselineError(f"{name} must be a multiple of {len(STRATA)}, got {value}")


class Flown(NamedTuple):
    """A batch of manoeuvres as they were flown, one after the other.

    Attributes
    ----------
    counts
        Decisions of each, (manoeuvres,).
    observations
        At all decisions, (n, m).
    states
        The arm's, (n, 6).
    """

    counts: NDArray[np.int64]
    observations: Array
    states: Array


class Fleet:
    """Environments of all strata that fly a batch of manoeuvres.

    Parameters
    ----------
    teaching
        The environment's settings.
    batch
        Manoeuvres at a time, a quarter a stratum.
    """

    def __init__(self, teaching: Teaching, batch: int) -> None:
        self._each = batch // len(STRATA)
        self._envs = [
            # too few for threads to pay: the second processor is for another student
            drm_env.DrmVectorEnv(
                num_envs=self._each, config=teaching.config(stratum), num_threads=1
            )
            for stratum in range(len(STRATA))
        ]
        self.sensing = Sensing(teaching.config(0))

    def close(self) -> None:
        """Close the environments."""
        for env in self._envs:
            env.close()

    def fly(self, policy: Perceptron, seeds: Sequence[int], counts: NDArray[np.int64]) -> Flown:
        """Fly the manoeuvres of these seeds, stratum by stratum, for so many decisions each."""
        starts = np.cumsum(counts) - counts
        total = int(counts.sum())
        observations = np.empty((total, self.sensing.entries), dtype=np.float32)
        states = np.empty((total, 6), dtype=np.float32)
        parts = range(0, len(seeds), self._each)
        seen = [
            env.reset(seed=[int(seed) for seed in seeds[part : part + self._each]])[0]
            for env, part in zip(self._envs, parts, strict=True)
        ]
        for k in range(int(counts.max())):
            flying = np.flatnonzero(k < counts)
            rows = starts[flying] + k
            now = np.concatenate(seen)
            observations[rows] = now[flying]
            where = [
                self.sensing.states(env, part) for env, part in zip(self._envs, seen, strict=True)
            ]
            states[rows] = np.concatenate(where)[flying]
            actions = policy(now)
            seen = [
                env.step(actions[part : part + self._each])[0]
                for env, part in zip(self._envs, parts, strict=True)
            ]
        return Flown(counts, observations, states)


def feedback(student: Student, observations: torch.Tensor, seen: Sequence[Slope]) -> list[Array]:
    """Return how the actions depend on what was seen now, one decision ago, and so on.

    ``seen`` is from :meth:`drm_baselines.imitation.sensing.Sensing.slopes`. Shapes (n, 2, 8). An
    action at its limit depends on nothing.
    """
    ages = 1 + max(slope.age for slope in seen)
    found = [np.zeros((2, 8, len(observations)), dtype=np.float32) for _ in range(ages)]
    for start in range(0, len(observations), _CHUNK):
        part = slice(start, start + _CHUNK)
        given = observations[part].clone().requires_grad_(True)
        actions = student(given)
        inside = (actions.detach().abs() < 1.0).float()
        for i in range(2):
            (by_entry,) = torch.autograd.grad(actions[:, i].sum(), given, retain_graph=i == 0)
            by = np.ascontiguousarray((by_entry * inside[:, i, None]).numpy().T)
            for slope in seen:
                found[slope.age][i, slope.quantity, part] += by[slope.entry] * slope.slope[part]
    return [np.ascontiguousarray(array.transpose(2, 0, 1)) for array in found]


def adjoint(
    counts: NDArray[np.int64], onward: Array, cost: Array, policy: Sequence[Array]
) -> Array:
    """Return what a change of each action is worth, with all that follows from it, (n, 2).

    Parameters
    ----------
    counts
        Decisions of each manoeuvre, which follow one another in the other arrays.
    onward, cost
        See :class:`drm_baselines.imitation.sensitivity.Derivatives`.
    policy
        How the actions depend on what was seen now, one decision ago, and so on: (n, 2, 8) each.
    """
    starts = np.cumsum(counts) - counts
    back = np.ascontiguousarray(np.swapaxes(onward, 1, 2))
    through = [np.ascontiguousarray(np.swapaxes(part, 1, 2)) for part in policy]
    later = np.zeros((len(counts), 10), dtype=np.float32)
    worth = np.empty((len(cost), 2), dtype=np.float32)
    for k in range(int(counts.max()) - 1, -1, -1):
        flying = np.flatnonzero(k < counts)
        rows = starts[flying] + k
        direct = cost[rows] + (back[rows] @ later[flying][:, :, None])[:, :, 0]
        worth[rows] = direct[:, 6:]
        now = np.zeros((len(flying), 10), dtype=np.float32)
        now[:, :6] = direct[:, :6]
        now[:, 6:8] = later[flying, 6:8]  # momentum is kept
        for age, part in enumerate(through):
            seen = np.flatnonzero(k + age < counts[flying])
            then = rows[seen] + age
            now[np.ix_(seen, _COLUMNS)] += (part[then] @ worth[then][:, :, None])[:, :, 0]
        later[flying] = now
    return worth


def weights(
    squared: NDArray[np.float64], lengths: NDArray[np.float64], settings: Refinement
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return loss and weight of each manoeuvre's gradient.

    Parameters
    ----------
    squared
        Mean squared tip error, m^2, shape (n,).
    lengths
        Length of its gradient with respect to the torques of all decisions, in multiples of the
        wheels' limits.
    settings
        What the loss is.
    """
    floored = squared + settings.floor**2
    x = (np.sqrt(floored) / settings.scale) ** 0.5
    relative = 0.5 / floored  # derivative of the logarithm of the RMS
    length = np.maximum(lengths * relative, 1e-12)
    weight = relative * 0.5 * x / (1.0 + x) ** 2 * np.minimum(1.0, settings.largest / length)
    return x / (1.0 + x), np.where(np.isfinite(weight), weight, 0.0)


def gradient(
    student: Student, flown: Flown, intervals: Intervals, teaching: Teaching, sensing: Sensing,
    limits: torch.Tensor, samples: int,
) -> tuple[Array, NDArray[np.float64]]:  # fmt: skip
    """Return the derivatives of the manoeuvres' mean squared errors by the network's outputs.

    Shape (n, 2), with the mean squared errors (manoeuvres,); the mean is over ``samples`` decisions
    whatever was flown.
    """
    observations = torch.from_numpy(flown.observations)
    with torch.no_grad():
        wanted = torch.cat([student(part) for part in torch.split(observations, _CHUNK)])
    found: Derivatives = derivatives(
        intervals, torch.from_numpy(flown.states), wanted.clamp(-1.0, 1.0), teaching, limits
    )
    policy = feedback(student, observations, sensing.slopes(flown.observations))
    worth = adjoint(flown.counts, found.onward.numpy(), found.cost.numpy(), policy)
    starts = np.cumsum(flown.counts) - flown.counts
    squared = np.add.reduceat(found.squared.numpy().astype(np.float64), starts) / samples
    inside = wanted.abs().numpy() < 1.0
    return np.nan_to_num(worth * inside / np.float32(samples)), squared


def refine(
    student: Student, intervals: Intervals, teaching: Teaching, settings: Refinement,
    rng: np.random.Generator,
) -> Iterator[tuple[int, int, float]]:  # fmt: skip
    """Refine a student step by step; yields step, decisions flown for it, and mean loss.

    ``intervals`` are those of the manoeuvres :meth:`Teaching.seeds` of so many as the settings say.
    """
    seeds = np.concatenate(
        [np.array(teaching.seeds(stratum, settings.manoeuvres)) for stratum in range(len(STRATA))]
    )
    scenario = drm_env.sample_scenarios(config=teaching.config(0), seed=int(seeds[0]), n=1)[0]
    limits = torch.from_numpy(torque_limits(scenario).astype(np.float32))
    samples = round(scenario["horizon"] / teaching.task()["control_period"])
    decks = [_Deck(len(seeds) // len(STRATA), rng) for _ in STRATA]
    optimiser = torch.optim.Adam(student.parameters(), betas=(0.9, 0.99))
    fleet = Fleet(teaching, settings.batch)
    try:
        for step in range(settings.steps):
            each = settings.batch // len(STRATA)
            chosen = np.concatenate(
                [i * deck.size + deck.draw(each) for i, deck in enumerate(decks)]
            )
            flown = fleet.fly(student.perceptron(), seeds[chosen], intervals.counts[chosen])
            worth, squared = gradient(
                student, flown, intervals.of(chosen), teaching, fleet.sensing, limits, samples
            )
            starts = np.cumsum(flown.counts) - flown.counts
            per_torque = np.square(worth.astype(np.float64) / teaching.wheel_scale).sum(axis=1)
            lengths = np.sqrt(np.add.reduceat(per_torque, starts))
            loss, weight = weights(squared, lengths, settings)
            towards = worth * np.repeat(weight / settings.batch, flown.counts)[:, None]
            _descend(student, optimiser, flown.observations, towards, _rate(step, settings))
            yield step + 1, len(worth), float(loss.mean())
    finally:
        fleet.close()


def _rate(step: int, settings: Refinement) -> float:
    cosine = 0.5 * (1.0 + math.cos(math.pi * step / settings.steps))
    return settings.learning_rate * min((step + 1) / settings.warm_up, cosine)


def _descend(
    student: Student, optimiser: torch.optim.Optimizer, observations: Array,
    towards: NDArray[np.float64], rate: float,
) -> None:  # fmt: skip
    optimiser.zero_grad()
    seen, wanted = torch.from_numpy(observations), torch.from_numpy(towards.astype(np.float32))
    for part, direction in zip(torch.split(seen, _CHUNK), torch.split(wanted, _CHUNK), strict=True):
        (student(part) * direction).sum().backward()
    for group in optimiser.param_groups:
        group["lr"] = rate
    optimiser.step()


class _Deck:
    """Manoeuvres drawn without repetition until all have been."""

    def __init__(self, size: int, rng: np.random.Generator) -> None:
        self.size, self._rng = size, rng
        self._left: list[int] = []

    def draw(self, count: int) -> NDArray[np.int64]:
        """Return so many, sorted."""
        drawn: list[int] = []
        while len(drawn) < count:
            if not self._left:
                self._left = [int(i) for i in self._rng.permutation(self.size)]
            drawn.append(self._left.pop())
        return np.sort(np.array(drawn, dtype=np.int64))
