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

A student refined like that answers tiny errors too stiffly and keeps the arm shaking by some
hundredths of a millimetre for ever, which e does not show. So a second refinement
(:func:`settling`) adds the same function of the tip error at rest, with hundredths of a
millimetre for e0. The rest begins some time after the slew, when what its end excites has died
away: beside that the shaking would not count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.imitation.observation_jacobian import (
    SEEN,
    Array,
    Sensing,
    Slope,
)
from drm_baselines.imitation.plant_jacobian import Derivatives, Intervals, derivatives
from drm_baselines.imitation.student import Student
from drm_baselines.imitation.teacher import Teaching
from drm_baselines.optimal_control.quadratic_program import torque_limits
from drm_baselines.policies.perceptron import Perceptron
from drm_baselines.suites import STRATA

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
    rest
        Weight of the tip error at rest as a goal of its own; 0 leaves it out.
    rest_scale, rest_floor
        What scale and floor are, at rest.
    rest_delay
        Seconds after the slew from which on the arm is to be at rest.
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
    rest: float = 0.0
    rest_scale: float = 2.0e-5
    rest_floor: float = 3.0e-6
    rest_delay: float = 2.0
    largest: float = 2.0

    def __post_init__(self) -> None:
        """Check that the manoeuvres can be shared among the strata."""
        for name in ("manoeuvres", "batch"):
            value = getattr(self, name)
            if value < len(STRATA) or value % len(STRATA):
                raise BaselineError(f"{name} must be a multiple of {len(STRATA)}, got {value}")
        if not 0.0 <= self.rest_delay < self.tail:
            raise BaselineError(
                f"rest_delay must be at least 0 and below tail ({self.tail}), got {self.rest_delay}"
            )


def settling(**changes: Any) -> Refinement:
    """Return the settings of the second refinement."""
    settings: dict[str, Any] = {"steps": 120, "learning_rate": 2.0e-4, "rest": 1.0}
    return Refinement(**{**settings, **changes})


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
        each = batch // len(STRATA)
        strata = range(len(STRATA))
        self._parts = [slice(stratum * each, (stratum + 1) * each) for stratum in strata]
        self._envs = [
            # too few for threads to pay: the second processor is for another student
            drm_env.DrmVectorEnv(num_envs=each, config=teaching.config(stratum), num_threads=1)
            for stratum in strata
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
        seen = [
            env.reset(seed=[int(seed) for seed in seeds[part]])[0]
            for env, part in zip(self._envs, self._parts, strict=True)
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
                env.step(actions[part])[0]
                for env, part in zip(self._envs, self._parts, strict=True)
            ]
        return Flown(counts, observations, states)


class Answers:
    """What a student answers to observations (n, m), kept for its derivatives.

    Attributes
    ----------
    actions
        Not limited, (n, 2).
    """

    def __init__(self, student: Student, observations: Array) -> None:
        self._given = [
            part.clone().requires_grad_(True)
            for part in torch.split(torch.from_numpy(observations), _CHUNK)
        ]
        self._parts = [student(given) for given in self._given]
        self._weights = list(student.parameters())
        self.actions = torch.cat([part.detach() for part in self._parts])

    def feedback(self, seen: Sequence[Slope]) -> list[Array]:
        """Return how the actions depend on what was seen now, one decision ago, and so on.

        ``seen`` is from :meth:`drm_baselines.imitation.observation_jacobian.Sensing.slopes`.
        Shapes (n, 2, 8). An action at its limit depends on nothing.
        """
        ages = 1 + max(slope.age for slope in seen)
        count = len(self.actions)
        found = [np.zeros((2, 8, count), dtype=np.float32) for _ in range(ages)]
        inside = (self.actions.abs() < 1.0).float()
        start = 0
        for given, actions in zip(self._given, self._parts, strict=True):
            part = slice(start, start + len(given))
            start = part.stop
            for i in range(2):
                (by_entry,) = torch.autograd.grad(actions[:, i].sum(), given, retain_graph=True)
                by = np.ascontiguousarray((by_entry * inside[part, i, None]).numpy().T)
                for slope in seen:
                    found[slope.age][i, slope.quantity, part] += by[slope.entry] * slope.slope[part]
        return [np.ascontiguousarray(array.transpose(2, 0, 1)) for array in found]

    def backward(self, towards: NDArray[np.float64]) -> None:
        """Add to the gradients of the weights; ``towards`` are the derivatives by the actions.

        What was kept for derivatives is gone then.
        """
        wanted = torch.split(torch.from_numpy(towards.astype(np.float32)), _CHUNK)
        for actions, direction in zip(self._parts, wanted, strict=True):
            actions.backward(direction, inputs=self._weights)


def adjoint(
    counts: NDArray[np.int64], onward: Array, cost: Array, policy: Sequence[Array]
) -> Array:
    """Return what a change of each action is worth, with all that follows from it, (n, 2, m).

    Parameters
    ----------
    counts
        Decisions of each manoeuvre, which follow one another in the other arrays.
    onward
        See :class:`drm_baselines.imitation.plant_jacobian.Derivatives`.
    cost
        Derivatives of what it is worth to each of m goals, (n, 8, m).
    policy
        How the actions depend on what was seen now, one decision ago, and so on: (n, 2, 8) each.
    """
    starts = np.cumsum(counts) - counts
    goals = cost.shape[2]
    back = np.ascontiguousarray(np.swapaxes(onward, 1, 2))
    through = [np.ascontiguousarray(np.swapaxes(part, 1, 2)) for part in policy]
    later = np.zeros((len(counts), 10, goals), dtype=np.float32)
    worth = np.empty((len(cost), 2, goals), dtype=np.float32)
    for k in range(int(counts.max()) - 1, -1, -1):
        flying = np.flatnonzero(k < counts)
        rows = starts[flying] + k
        direct = cost[rows] + back[rows] @ later[flying]
        worth[rows] = direct[:, 6:]
        now = np.zeros((len(flying), 10, goals), dtype=np.float32)
        now[:, :6] = direct[:, :6]
        now[:, 6:8] = later[flying, 6:8]  # momentum is kept
        for age, part in enumerate(through):
            seen = np.flatnonzero(k + age < counts[flying])
            then = rows[seen] + age
            now[np.ix_(seen, _COLUMNS)] += part[then] @ worth[then]
        later[flying] = now
    return worth


class Goal(NamedTuple):
    """What of the manoeuvres is to be small.

    Attributes
    ----------
    squared
        The mean squared error of each manoeuvre, m^2, (manoeuvres,).
    worth
        Its derivatives by what the network puts out at every decision, (n, 2).
    """

    squared: NDArray[np.float64]
    worth: Array


def weights(
    squared: NDArray[np.float64], lengths: NDArray[np.float64], scale: float, floor: float,
    largest: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Return loss and weight of each manoeuvre's gradient.

    Parameters
    ----------
    squared
        Mean squared error, m^2, shape (n,).
    lengths
        Length of its gradient with respect to the torques of all decisions, in multiples of the
        wheels' limits.
    scale, floor, largest
        See :class:`Refinement`.
    """
    floored = squared + floor**2
    x = (np.sqrt(floored) / scale) ** 0.5
    relative = 0.5 / floored  # derivative of the logarithm of the RMS
    length = np.maximum(lengths * relative, 1e-12)
    weight = relative * 0.5 * x / (1.0 + x) ** 2 * np.minimum(1.0, largest / length)
    return x / (1.0 + x), np.where(np.isfinite(weight), weight, 0.0)


def gradient(
    answers: Answers, flown: Flown, intervals: Intervals, teaching: Teaching, sensing: Sensing,
    limits: torch.Tensor, samples: int,
) -> tuple[Goal, Goal]:  # fmt: skip
    """Return the tip errors of the whole and of the rest of each manoeuvre with their derivatives.

    The mean over the whole is over ``samples`` decisions whatever was flown.
    """
    found: Derivatives = derivatives(
        intervals,
        torch.from_numpy(flown.states),
        answers.actions.clamp(-1.0, 1.0),
        teaching,
        limits,
    )
    policy = answers.feedback(sensing.slopes(flown.observations))
    starts = np.cumsum(flown.counts) - flown.counts
    decision = np.arange(len(flown.states)) - np.repeat(starts, flown.counts)
    rest = decision >= np.repeat(intervals.ends, flown.counts)
    counted = np.stack([np.ones_like(rest), rest], axis=1).astype(np.float32)
    cost = found.cost.numpy()[:, :, None] * counted[:, None]
    worth = adjoint(flown.counts, found.onward.numpy(), cost, policy)
    worth *= (answers.actions.abs().numpy() < 1.0)[:, :, None]
    squared = found.squared.numpy().astype(np.float64)
    goals = []
    for i, over in enumerate((np.full_like(flown.counts, samples), flown.counts - intervals.ends)):
        mean = np.add.reduceat(squared * counted[:, i], starts) / over
        each = np.repeat(over, flown.counts).astype(np.float32)[:, None]
        goals.append(Goal(mean, np.nan_to_num(worth[:, :, i] / each)))
    return goals[0], goals[1]


def refine(
    student: Student, intervals: Intervals, teaching: Teaching, settings: Refinement,
    rng: np.random.Generator,
) -> Iterator[tuple[int, int, float]]:  # fmt: skip
    """Refine a student step by step; yields step, decisions flown for it, and mean loss.

    ``intervals`` are those of the manoeuvres :meth:`Teaching.seeds` of so many as the settings say.
    """
    strata = range(len(STRATA))
    seeds = np.concatenate([np.array(teaching.seeds(i, settings.manoeuvres)) for i in strata])
    scenario = drm_env.sample_scenarios(config=teaching.config(0), seed=int(seeds[0]), n=1)[0]
    limits = torch.from_numpy(torque_limits(scenario).astype(np.float32))
    period = teaching.task()["control_period"]
    samples = round(scenario["horizon"] / period)
    each = settings.batch // len(STRATA)
    delay = math.ceil(settings.rest_delay / period)
    intervals = replace(intervals, ends=intervals.ends + delay)
    decks = [_Deck(settings.manoeuvres // len(STRATA), rng) for _ in strata]
    optimiser = torch.optim.Adam(student.parameters(), betas=(0.9, 0.99))
    fleet = Fleet(teaching, settings.batch)
    try:
        for step in range(settings.steps):
            chosen = np.concatenate(
                [i * deck.size + deck.draw(each) for i, deck in enumerate(decks)]
            )
            flown = fleet.fly(student.perceptron(), seeds[chosen], intervals.counts[chosen])
            answers = Answers(student, flown.observations)
            goals = gradient(
                answers, flown, intervals.of(chosen), teaching, fleet.sensing, limits, samples
            )
            loss, towards = _towards(goals, flown.counts, teaching, settings)
            for group in optimiser.param_groups:
                group["lr"] = _rate(step, settings)
            optimiser.zero_grad()
            answers.backward(towards)
            optimiser.step()
            yield step + 1, len(towards), loss
    finally:
        fleet.close()


def _towards(
    goals: Sequence[Goal], counts: NDArray[np.int64], teaching: Teaching, settings: Refinement
) -> tuple[float, NDArray[np.float64]]:
    """Return the mean loss of the manoeuvres and its derivatives by what the network puts out."""
    starts = np.cumsum(counts) - counts
    priced = (
        (1.0, settings.scale, settings.floor),
        (settings.rest, settings.rest_scale, settings.rest_floor),
    )
    total, towards = 0.0, np.zeros(goals[0].worth.shape)
    for goal, (price, scale, floor) in zip(goals, priced, strict=True):
        per_torque = np.square(goal.worth.astype(np.float64) / teaching.wheel_scale).sum(axis=1)
        lengths = np.sqrt(np.add.reduceat(per_torque, starts))
        loss, weight = weights(goal.squared, lengths, scale, floor, settings.largest)
        total += price * float(loss.mean())
        towards += goal.worth * np.repeat(price * weight / len(counts), counts)[:, None]
    return total, towards


def _rate(step: int, settings: Refinement) -> float:
    cosine = 0.5 * (1.0 + math.cos(math.pi * step / settings.steps))
    return settings.learning_rate * min((step + 1) / settings.warm_up, cosine)


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
