"""Imitation of the teacher by dataset aggregation (DAgger, Ross et al. 2011), then refinement.

The student flies, the teacher says at every decision what it would have done, all of it is
learned, and so on. The student is an ordinary feed-forward policy of the residual environment:
what it sees is what any agent sees there. The wheels' stored momentum is in its observation,
and with the momentum that the motor was told to give it tells the true inertia; the last few
observations tell what is not measured: that is the student's memory. What the teacher knows and
the student cannot, no imitation teaches: the gradient of the tip error does
(:mod:`drm_baselines.imitation.analytic_gradient`). At last it settles: it learns to leave an arm
at rest alone.

A run is a directory like any other training run and ends in ``policy.safetensors`` and
``policy.json``. An interrupted one keeps the policy of its last finished round.
"""

from __future__ import annotations

import copy
import csv
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

import drm_env
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.imitation.analytic_gradient import (
    Fleet,
    Refinement,
    refine,
    settling,
)
from drm_baselines.imitation.observation_jacobian import Array
from drm_baselines.imitation.plant_jacobian import Intervals
from drm_baselines.imitation.student import Student
from drm_baselines.imitation.teacher import Plans, Teaching
from drm_baselines.imitation.teacher_rollout import Examples, Flight
from drm_baselines.policies.perceptron import NetworkPolicy, Perceptron
from drm_baselines.policies.policy_file import (
    load_policy,
    remove_policy,
    save_policy,
)
from drm_baselines.rl.run_record import EVALUATIONS_FILE
from drm_baselines.suites import STRATA
from drm_baselines.support import provenance, storage, workplace
from drm_baselines.support.interruption import stop_on_signal
from drm_baselines.support.seeds import IMITATION_CURVE_SEED

ALGORITHM = "dagger"
_CURVE_EPISODES = 50  # a stratum
_POINTS = {"refinement": 12, "settling": 4}  # of the curve
_LEVERS = np.array([12.0, 2.0, 2.0])  # m/rad at mid extension; deflections of the ends are twice


@dataclass(frozen=True, kw_only=True)
class Study:
    """How a student learns.

    Attributes
    ----------
    seed
        Of the initial weights, the examples that are kept, the minibatches, and the manoeuvres of
        each step of the refinement.
    rounds
        Times that the manoeuvres are flown: by the teacher first, then by the student.
    kept
        Share of the decisions that are kept as examples.
    tolerance
        Deviation from the plan (m, roughly at the tip) at which half the trust in the feedback
        around it is lost.
    precision
        Action error from which on errors count linearly and not by their square.
    epochs, last_epochs
        Passes over all examples after each round, and after the last.
    batch_size, learning_rate
        Of the optimiser (Adam, one cycle a round).
    layers, activation
        Hidden layers.
    teaching
        The teacher's settings.
    refinement
        What comes after imitation.
    settling
        What comes after that, with the same manoeuvres.
    """

    seed: int = 0
    rounds: int = 7
    kept: float = 0.15
    tolerance: float = 5.0e-3
    precision: float = 0.005
    epochs: int = 2
    last_epochs: int = 6
    batch_size: int = 2048
    learning_rate: float = 2.0e-3
    layers: tuple[int, ...] = (128, 128)
    activation: str = "tanh"
    teaching: Teaching = field(default_factory=Teaching)
    refinement: Refinement = field(default_factory=Refinement)
    settling: Refinement = field(default_factory=settling)

    def __post_init__(self) -> None:
        """Check that both refinements can use the same intervals."""
        for name in ("manoeuvres", "tail"):
            one, other = getattr(self.refinement, name), getattr(self.settling, name)
            if one != other:
                raise BaselineError(
                    f"settling.{name} must be that of the refinement ({one}), got {other}"
                )


class _Lesson:
    """The planned manoeuvres of one stratum."""

    def __init__(self, plans: Plans, study: Study) -> None:
        self.study = study
        self.flight = Flight(plans, study.teaching)

    def fly(self, student: Perceptron | None, examples: Examples, rng: np.random.Generator) -> None:
        """Fly all manoeuvres, by the teacher without a student, and keep examples."""
        plans, study = self.flight.plans, self.study

        def looked(k: int, observations: Array, states: NDArray[np.float64], advice: Array) -> None:
            if rng.random() < study.kept:
                # the ends' deflections weigh a few times more than the slew error: metres roughly
                away = np.abs(states - plans.states[:, k])[:, :3] @ _LEVERS
                trust = 1.0 / (1.0 + np.square(away / study.tolerance))
                examples.keep(observations, advice, trust.astype(np.float32))

        self.flight.fly(student, looked)
        examples.decisions += plans.torques.shape[0] * plans.torques.shape[1]


def _learn(
    student: Student, examples: Examples, study: Study, epochs: int, rng: np.random.Generator,
    stopped: Callable[[], bool],
) -> float:  # fmt: skip
    observations, actions, trust = (torch.from_numpy(part) for part in examples.arrays())
    count = max(1, epochs * len(observations) // study.batch_size)
    optimiser = torch.optim.Adam(student.parameters())
    rate = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, max_lr=study.learning_rate, total_steps=count
    )
    recent = 0.0
    for step in range(count):
        if stopped():
            break
        chosen = torch.from_numpy(rng.integers(0, len(observations), study.batch_size))
        wrong = nn.functional.huber_loss(
            student(observations[chosen]), actions[chosen], delta=study.precision, reduction="none"
        )
        loss = (wrong.mean(dim=1) * trust[chosen]).mean()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it without types
        optimiser.step()
        rate.step()
        recent = loss.item() if step == 0 else recent + 0.01 * (loss.item() - recent)
    return recent


def _point(student: Student, study: Study) -> dict[str, NDArray[np.float64]]:
    network = student.perceptron().engine()
    parts = []
    for stratum in range(4):
        config = study.teaching.config(stratum)
        scenarios = drm_env.sample_scenarios(
            config=config, seed=IMITATION_CURVE_SEED + 1000 * stratum, n=_CURVE_EPISODES
        )
        parts.append(drm_env.rollout(scenarios, policy=network, config=config))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def imitate(
    directory: Path,
    study: Study,
    plans: Sequence[Plans],
    intervals: Intervals,
    *,
    start: Path | None = None,
    force: bool = False,
    watch: Callable[[str, int, dict[str, float] | None], None] | None = None,
) -> Path:
    """Teach one student and save its policy in ``directory``.

    Parameters
    ----------
    directory
        Of the run.
    study
        How the student learns.
    plans
        From :func:`drm_baselines.imitation.teacher.make_plans`.
    intervals
        From :func:`drm_baselines.imitation.plant_jacobian.prepare`, for the study's refinement.
    start
        Directory of a student that has been refined and has only to settle.
    force
        Start anew in a directory that is not empty. One in which the same student was begun and
        not finished is taken up without: it learns anew, to the same digits, and the policy that
        is there stays until there is a newer one.
    watch
        Called with the stage (``"imitation"``, ``"refinement"``, ``"settling"``), how many of its
        rounds or steps are done, and the curve's newest point if there is one.

    Raises
    ------
    ExistingResultError
        The directory is not empty and ``force`` is false.
    BusyError
        Another process works there.
    RunError
        Interrupted before the first round was over, ``start`` damaged.
    BaselineError
        ``start`` is no student of this teaching.
    """
    begun = None if start is None else _begun(start, study)
    points = [] if start is None or begun is None else _points_of(start, begun)
    work = work_of(study, start)
    with workplace.working(directory, work, force=force) as again:
        if not again:
            remove_policy(directory)
            (directory / EVALUATIONS_FILE).unlink(missing_ok=True)
        curve = _Curve(directory, study, watch, begun, points)
        _taught(study, plans, intervals, curve)
        work.finished = curve.finished
    return directory


def work_of(study: Study, start: Path | None) -> workplace.Work:
    """Return what is noted in the directory of a student while it learns.

    Raises
    ------
    RunError
        ``start`` damaged.
    """
    digest = None if start is None else load_policy(start).description["weights_sha256"]
    return workplace.Work("drm imitate", {"study": asdict(study), "start": digest})


def _taught(study: Study, plans: Sequence[Plans], intervals: Intervals, curve: _Curve) -> None:
    """Teach a student from round to round; whether to the end, the curve says.

    Raises
    ------
    RunError
        Interrupted before the first round was over.
    """
    begun = curve.begun
    torch.set_num_threads(1)
    torch.manual_seed(study.seed)
    rng = np.random.default_rng([study.seed, 20])
    student: Student | None = None
    with stop_on_signal() as stop:
        if begun is None:
            student, decisions = _imitated(study, plans, rng, curve, stop.is_set)
            if student is not None and not stop.is_set():
                decisions = _refined(student, intervals, rng, curve, decisions, stop.is_set)
            refined = None if student is None else student.perceptron()
        else:
            refined, decisions = begun.network, int(begun.description["training"]["steps"])
        settles = begun is not None or study.settling.steps > 0
        if refined is not None and settles and not stop.is_set():
            # from what a policy file holds: whether a run goes on or begins with one is the same
            student = Student.of(refined, *_usual(refined, intervals, study))
            rng = np.random.default_rng([study.seed, 21])
            _refined(student, intervals, rng, curve, decisions, stop.is_set, stage="settling")
        curve.finished = not stop.is_set()
        if student is not None and curve.points:
            curve.save(student)
    if not curve.points or student is None:
        raise RunError(f"{curve.directory}: interrupted before the first round was over")


def _begun(start: Path, study: Study) -> NetworkPolicy:
    """Return the student that a run begins with.

    Raises
    ------
    BaselineError
        It is none, not one of this teaching, or has settled already.
    """
    policy = load_policy(start)
    training = policy.description.get("training", {})
    if training.get("algorithm") != ALGORITHM:
        found = training.get("algorithm")
        raise BaselineError(f"{start}: training.algorithm must be {ALGORITHM!r}, got {found!r}")
    settled = training.get("hyperparameters", {}).get("settling", {}).get("steps", 0)
    if settled:
        raise BaselineError(
            f"{start}: training.hyperparameters.settling.steps must be 0, got {settled}"
        )
    wanted = describe(study, [{"steps": 0, "wall_time": 0.0}], False)["config"]["task"]
    task = policy.description["config"]["task"]
    for name, value in wanted.items():
        if task.get(name) != value:
            raise BaselineError(
                f"{start}: config.task.{name} must be {value!r}, got {task.get(name)!r}"
            )
    return policy


def _points_of(start: Path, begun: NetworkPolicy) -> list[dict[str, float]]:
    """Return the curve so far of the run that another begins with."""
    path = start / EVALUATIONS_FILE
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
        points = [{name: float(value) for name, value in row.items()} for row in rows]
        # one that was killed between curve and policy has a point too many
        last = float(begun.description["training"]["steps"])
        return [point for point in points if point["steps"] <= last]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise RunError(f"{path}: no learning curve: {error}") from error


def _usual(
    network: Perceptron, intervals: Intervals, study: Study
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return mean and deviation of what a student sees on the first manoeuvres of each stratum."""
    settings, strata = study.settling, range(len(STRATA))
    seeds = [seed for i in strata for seed in study.teaching.seeds(i, settings.batch)]
    each = len(seeds) // len(STRATA)
    firsts = [i * settings.manoeuvres // len(STRATA) + np.arange(each) for i in strata]
    fleet = Fleet(study.teaching, settings.batch)
    try:
        seen = fleet.fly(network, seeds, intervals.counts[np.concatenate(firsts)]).observations
    finally:
        fleet.close()
    return seen.mean(axis=0), seen.std(axis=0) + np.float32(1e-3)


def _refined(
    student: Student, intervals: Intervals, rng: np.random.Generator, curve: _Curve,
    decisions: int, stopped: Callable[[], bool], stage: str = "refinement",
) -> int:  # fmt: skip
    """Refine a student; return the decisions so far. A stopped one is as at the last point."""
    study: Study = curve.study
    settings: Refinement = getattr(study, stage)
    before = study.refinement.steps if stage == "settling" else 0
    best = copy.deepcopy(student.state_dict())
    every = max(1, settings.steps // _POINTS[stage])
    for step, flown, loss in refine(student, intervals, study.teaching, settings, rng):
        decisions += flown
        if stopped():
            student.load_state_dict(best)
            break
        if curve.watch is not None:
            curve.watch(stage, step, None)
        if step % every == 0 or step == settings.steps:
            curve.point(stage, step, student, decisions, loss, refined=before + step)
            best = copy.deepcopy(student.state_dict())
    return decisions


def _imitated(
    study: Study, plans: Sequence[Plans], rng: np.random.Generator, curve: _Curve,
    stopped: Callable[[], bool],
) -> tuple[Student | None, int]:  # fmt: skip
    """Return the student of the last round that was finished, if any, and its decisions."""
    lessons = [_Lesson(plan, study) for plan in plans]
    examples = Examples()
    student: Student | None = None
    for number in range(study.rounds):
        flown = None if student is None else student.perceptron()
        for lesson in lessons:
            if stopped():
                return student, examples.decisions
            lesson.fly(flown, examples, rng)
        if student is None:
            seen = examples.arrays()[0]
            student = Student(
                study.layers, study.activation,
                seen.mean(axis=0), seen.std(axis=0) + np.float32(1e-3),
            )  # fmt: skip
        best = copy.deepcopy(student.state_dict())
        epochs = study.last_epochs if number + 1 == study.rounds else study.epochs
        loss = _learn(student, examples, study, epochs, rng, stopped)
        if stopped():
            student.load_state_dict(best)
            break
        curve.point("imitation", number + 1, student, examples.decisions, loss)
    return student, examples.decisions


class _Curve:
    """The learning curve of a run, saved with the policy after every point."""

    def __init__(
        self, directory: Path, study: Study,
        watch: Callable[[str, int, dict[str, float] | None], None] | None,
        begun: NetworkPolicy | None, points: list[dict[str, float]],
    ) -> None:  # fmt: skip
        self.directory, self.study, self.watch, self.begun = directory, study, watch, begun
        self.points = points
        self.finished = False
        before = 0.0 if begun is None else float(begun.description["training"]["wall_time"])
        self._begun = time.monotonic() - before

    def point(
        self, stage: str, number: int, student: Student, decisions: int, loss: float,
        refined: int = 0,
    ) -> None:  # fmt: skip
        """Judge the student, save it and tell."""
        from drm_baselines.evaluation.statistics import interquartile_mean

        judged = _point(student, self.study)
        point = {
            "steps": float(decisions),
            "wall_time": time.monotonic() - self._begun,
            "refined": float(refined),
            "loss": loss,
            "tip_error_rms": interquartile_mean(np.nan_to_num(judged["tip_error_rms"], nan=10)),
            "residual_rms": interquartile_mean(np.nan_to_num(judged["residual_rms"], nan=10)),
            "settled": float(np.mean(judged["settled"])),
        }
        self.points.append(point)
        self.save(student)
        if self.watch is not None:
            self.watch(stage, number, point)

    def save(self, student: Student) -> None:
        """Write policy and curve."""
        storage.write_rows(self.directory / EVALUATIONS_FILE, self.points, overwrite=True)
        description = describe(self.study, self.points, self.finished)
        if self.begun is not None:
            before = self.begun.description
            description["training"]["start"] = {
                "weights_sha256": before["weights_sha256"], **before["training"],
            }  # fmt: skip
        save_policy(self.directory, student.perceptron(), description)


def describe(study: Study, points: Sequence[dict[str, float]], finished: bool) -> dict[str, Any]:
    """Return what travels with the weights of a student."""
    config = drm_env.resolve(config=study.teaching.config(0))
    return {
        "env_id": "drm_env/SlewResidual-v0",
        "config": config.to_dict(),
        "control_period": config.control_period,
        "observation_layout": [list(entry) for entry in config.observation_layout],
        "training": {
            "algorithm": ALGORITHM,
            "seed": study.seed,
            "steps": int(points[-1]["steps"]),
            "wall_time": points[-1]["wall_time"],
            "finished": finished,
            "hyperparameters": asdict(study),
            **provenance.provenance(),
        },
    }
