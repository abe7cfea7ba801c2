"""Examples from new plans: what a teacher does who plans anew from where the student has gone.

The feedback around a plan is the best answer as long as the same wheels saturate. Where a student
has gone further, the programme is solved again from its state, again and again while the wheels
saturate ahead. That takes a hundred times as long as flying. So pilots fly for all students: the
first has learned from plans alone, each later one from what its predecessors' flights gave.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines import storage
from drm_baselines.imitation import dagger
from drm_baselines.imitation.flights import Array, Examples, Flight
from drm_baselines.imitation.teacher import Plans, Teaching, digest_of, plan_from
from drm_baselines.network import load_policy
from drm_baselines.policies import LAW_PERIOD
from drm_baselines.processes import process_pool

PILOT_SEED = 900
"""Seed of the first pilot's study: apart from those of students."""

_NAMES = ("observations", "actions", "trust")


# Every manoeuvre saturates the wheels when the slew begins; what counts is what comes later.
_BEGINNING, _OFTEN = 25, 25  # decisions
_AFTER = 3.0  # s after the slew that a new plan reaches to


def saturating(plans: Plans, teaching: Teaching, generation: int) -> Plans:
    """Return the plans of the manoeuvres to be planned anew: other ones in every generation."""
    often = plans.saturated[:, _BEGINNING:].any(axis=2).sum(axis=1) > _OFTEN
    found = np.flatnonzero(often)
    if teaching.replanned < 1.0:
        rng = np.random.default_rng([plans.stratum, generation, 31])
        count = math.ceil(teaching.replanned * len(found))
        found = np.sort(rng.permutation(found)[:count])
    return plans.of(found)


def replanned(
    plans: Sequence[Plans],
    student: Callable[[Array], Array],
    teaching: Teaching,
    generation: int,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Array, Array, Array]:
    """Fly a pilot and return observations, advice and trust (all 1) while there are new plans.

    ``progress`` is called with the number of decisions done and of all of them.
    """
    examples = Examples()
    done, total = 0, sum(plan.torques.shape[1] for plan in plans)
    with process_pool() as pool:
        for whole in plans:
            chosen = saturating(whole, teaching, generation)
            seeds = teaching.seeds(whole.stratum)
            scenarios = drm_env.sample_scenarios(
                config=teaching.config(whole.stratum), seed=seeds[0], n=len(seeds)
            )
            own = [scenarios[int(seed) - seeds[0]] for seed in chosen.seeds]
            flown = drm_env.rollout(own, law={"name": "none"}) if own else {}
            seconds = np.asarray(flown["slew_end_time"]) + _AFTER if own else np.zeros(0)
            ends = np.ceil(seconds / (teaching.hold * LAW_PERIOD)).astype(int)
            # planned anew, and not long ago
            fresh = np.zeros(len(own), dtype=bool)

            def before(
                k: int,
                states: NDArray[np.float64],
                chosen: Plans = chosen,
                own: list[dict[str, Any]] = own,
                ends: NDArray[np.int64] = ends,
                fresh: NDArray[np.bool_] = fresh,
            ) -> None:
                if k == 0:
                    fresh[:] = True
                if k == 0 or k % teaching.period:
                    return
                ahead = chosen.saturated[:, max(k, _BEGINNING) :].any(axis=(1, 2))
                ahead &= k < ends
                fresh[:] = False
                todo = np.flatnonzero(ahead & np.isfinite(states).all(axis=1))
                found = pool.map(
                    plan_from,
                    [own[i] for i in todo],
                    [teaching] * len(todo),
                    [k] * len(todo),
                    [states[i] for i in todo],
                    [int(ends[i]) for i in todo],
                )
                for i, plan in zip(todo, found, strict=True):
                    if plan.solved:
                        chosen.put(int(i), k, plan)
                        fresh[i] = True

            def looked(
                k: int,
                observations: Array,
                states: NDArray[np.float64],  # noqa: ARG001
                advice: Array,
                fresh: NDArray[np.bool_] = fresh,
            ) -> None:
                nonlocal done
                trust = np.ones(int(fresh.sum()), dtype=np.float32)
                examples.keep(observations[fresh], advice[fresh], trust)
                done += 1
                if progress is not None and k % teaching.period == 0:
                    progress(done, total)

            if own:
                Flight(chosen, teaching).fly(student, looked, before=before)
    if not examples.observations:
        entries = len(drm_env.observation_layout(config=teaching.config(0)))
        examples.keep(*(np.zeros(shape, dtype=np.float32) for shape in ((0, entries), (0, 2), 0)))
    return examples.arrays()


def prepare(
    directory: Path,
    plans: Sequence[Plans],
    teaching: Teaching,
    *,
    pilot: dagger.Study | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[tuple[Array, Array, Array]]:
    """Return the examples of all generations; what is in the directory already is read.

    Parameters
    ----------
    directory
        Where pilots and examples are kept.
    plans, teaching
        From :func:`drm_baselines.imitation.teacher.make_plans`.
    pilot
        How pilots learn; the seed is theirs.
    progress
        Called with what is done and how much of it, and of how much.

    Raises
    ------
    RunError
        A file in the directory is damaged.
    """
    pilot = pilot or dagger.Study(rounds=4, epochs=3, last_epochs=6, teaching=teaching)
    rounds = pilot.rounds
    shown: list[tuple[Array, Array, Array]] = []
    for generation in range(teaching.generations):
        path = directory / f"examples_{generation}.npz"
        study = replace(pilot, seed=PILOT_SEED + generation)
        digest = digest_of(teaching, study)
        found = storage.load_arrays(path, digest)
        if found is None:
            name = f"pilot {generation + 1}"
            run = directory / f"pilot_{generation}"
            dagger.imitate(
                run,
                study,
                plans,
                shown,
                force=True,
                watch=partial(_learned, progress, name, rounds),
            )
            network = load_policy(run).network
            parts = replanned(
                plans,
                network,
                teaching,
                generation,
                progress=partial(_tell, progress, f"new plans for {name}"),
            )
            found = dict(zip(_NAMES, parts, strict=True))
            storage.save_arrays(path, found, digest)
        shown.append((found["observations"], found["actions"], found["trust"]))
    return shown


def _tell(
    progress: Callable[[str, int, int], None] | None, what: str, done: int, all_: int
) -> None:
    if progress is not None:
        progress(what, done, all_)


def _learned(
    progress: Callable[[str, int, int], None] | None,
    what: str,
    rounds: int,
    number: int,
    point: dict[str, float],  # noqa: ARG001
) -> None:
    _tell(progress, what, number + 1, rounds)
