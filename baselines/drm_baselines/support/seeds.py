"""Which seeds belong to whom: no draw of training is ever flown to judge what was trained.

Evaluations take any seed below training's (:func:`episode_seeds`), by default from 0 on; learning
curves and suites have places of their own there, so that nothing is chosen by what judges it.
"""

from __future__ import annotations

from drm_baselines.errors import BaselineError
from drm_baselines.support import memory

RANGES = {
    "evaluations": range(0, 800_000_000),
    "suites": range(800_000_000, 900_000_000),
    "learning curves": range(900_000_000, 910_000_000),
    "learning curves of imitation": range(910_000_000, 1_000_000_000),
    "training": range(1_000_000_000, 1_500_000_000),
    "tuning": range(1_500_000_000, 1_501_000_000),
    "training, seeds above 500": range(1_501_000_000, 2_000_000_000),
}
"""All of them, by what they are for; they never meet."""

SUITE_SEED = RANGES["suites"].start
"""First seed of the suites; each has a million to itself."""

CURVE_SEED = RANGES["learning curves"].start
"""First seed of the episodes behind learning curves: apart from training and from evaluations."""

IMITATION_CURVE_SEED = RANGES["learning curves of imitation"].start
"""The same for imitation, a thousand a stratum."""

TRAINING_SEED = RANGES["training"].start
"""First seed that training environments use: no evaluation should reach it."""

TUNING_SEED = RANGES["tuning"].start
"""First seed of the manoeuvres that gains are tuned on, the same for every seed of the search."""

_SEEDS_A_RUN = 1_000_000
_SEEDS_A_SEGMENT = 10_000
_EPISODE_BYTES = 16_000
"""What an episode takes: its scenario as data and as text, metrics, context and record."""


def episode_seeds(seed: int, episodes: int) -> list[int]:
    """Return the seeds ``seed .. seed + episodes - 1``, all apart from training's.

    Raises
    ------
    BaselineError
        A negative seed, no episodes, more than fit into memory, or seeds that training may have
        flown.
    """
    check_seeds(seed, episodes)
    memory.require(episodes * _EPISODE_BYTES, f"{episodes:,} episodes")
    return list(range(seed, seed + episodes))


def check_seeds(seed: int, episodes: int) -> None:
    """Check that the seeds ``seed .. seed + episodes - 1`` are all apart from training's.

    Raises
    ------
    BaselineError
        A negative seed, no episodes, or seeds that training may have flown.
    """
    if episodes < 1:
        raise BaselineError(f"episodes must be at least 1, got {episodes}")
    if seed < 0:
        raise BaselineError(f"seed must not be negative, got {seed}")
    if seed + episodes > TRAINING_SEED:
        raise BaselineError(
            f"seeds {seed}..{seed + episodes - 1} reach those kept for training "
            f"({TRAINING_SEED} and above)"
        )


def training_seed(run: int, segment: int) -> int:
    """Return the first seed of the environments that a run trains in.

    Parameters
    ----------
    run
        Seed of the run.
    segment
        How often it has been resumed.

    Raises
    ------
    BaselineError
        A run whose seeds belong to something else: they would not be training's.
    """
    first = TRAINING_SEED + run * _SEEDS_A_RUN + segment * _SEEDS_A_SEGMENT
    if not any(first in RANGES[name] for name in ("training", "training, seeds above 500")):
        raise BaselineError(
            f"seed {run} of a training would draw its episodes from seed {first:,} on, which is "
            "not kept for training; take another"
        )
    return first
