"""A suite's flights cut into pieces that executors do: some episodes of one policy, or all.

A piece that has been flown is kept as a file until the policy's record is written, so that a
benchmark that was interrupted or killed on a cluster goes on with what is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drm_baselines.benchmark.competitors import Competitor
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.policies.pilots import Metrics, Pilot
from drm_baselines.suites import Manoeuvres, load
from drm_baselines.support import storage
from drm_baselines.support.executors import Tell

PARTS = "parts"

SIZES = {"bound": 10, "controller": 5}
"""Episodes of a piece by the kind of who flies, where pieces are spread: some seconds of a core."""
SIZE = 500
"""Episodes of a piece of all others."""


@dataclass(frozen=True, kw_only=True)
class Piece:
    """Some episodes of a suite, by their places, that one policy of a training seed flies."""

    policy: str
    seed: int
    episodes: tuple[int, ...]

    def file_in(self, folder: Path) -> Path:
        """Return where the piece is kept."""
        name = f"{self.policy}-{self.seed}-{self.episodes[0]}-{len(self.episodes)}.npz"
        return folder / PARTS / name


@dataclass(frozen=True, kw_only=True)
class Squadron:
    """Who flies the pieces of a suite, by policy and training seed."""

    suite: str
    digest: str
    pilots: Mapping[tuple[str, int], Pilot]


def fly_piece(squadron: Squadron, piece: Piece, tell: Tell) -> Metrics:
    """Fly a piece; return metrics by name, each of shape (episodes,).

    Raises
    ------
    BaselineError
        The suite of the package here is another one.
    """
    manoeuvres = load(squadron.suite)
    if manoeuvres.digest != squadron.digest:
        raise BaselineError(f"the suite {squadron.suite!r} of a worker is another one")
    return squadron.pilots[piece.policy, piece.seed].fly(
        [manoeuvres.scenarios[place] for place in piece.episodes],
        seed=list(piece.episodes),
        progress=tell,
    )


def pieces_of(
    competitor: Competitor, seeds: Sequence[int], manoeuvres: Manoeuvres, *, spread: bool
) -> Iterator[Piece]:
    """Yield the pieces of a competitor's flights: all of a seed unless they are to be spread."""
    episodes = competitor.episodes(manoeuvres).tolist()
    size = SIZES.get(competitor.kind, SIZE) if spread else len(episodes)
    for seed in seeds:
        for first in range(0, len(episodes), size):
            chosen = tuple(episodes[first : first + size])
            yield Piece(policy=competitor.policy, seed=seed, episodes=chosen)


def kept(folder: Path, piece: Piece, fingerprint: str) -> Metrics | None:
    """Return a piece that was flown before, if it was and what was kept is whole."""
    try:
        return storage.load_arrays(piece.file_in(folder), fingerprint)
    except RunError:
        return None


def keep(folder: Path, piece: Piece, flown: Metrics, fingerprint: str) -> None:
    """Keep a piece until the record of its policy is written."""
    storage.save_arrays(piece.file_in(folder), flown, fingerprint)


def forget(folder: Path, policy: str) -> None:
    """Remove the pieces of a policy, whose record is written."""
    for path in (folder / PARTS).glob(f"{policy}-*.npz"):
        path.unlink(missing_ok=True)
    if (folder / PARTS).is_dir() and not any((folder / PARTS).iterdir()):
        (folder / PARTS).rmdir()


def joined(flown: Mapping[Piece, Metrics], seeds: Sequence[int]) -> dict[str, NDArray[np.float64]]:
    """Return metrics by name, each of shape (seeds, episodes), of all pieces of a competitor."""
    rows = []
    for seed in seeds:
        own = sorted((piece for piece in flown if piece.seed == seed), key=lambda p: p.episodes)
        rows.append(
            {name: np.concatenate([flown[piece][name] for piece in own]) for name in flown[own[0]]}
        )
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}
