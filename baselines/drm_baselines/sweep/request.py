"""What a sweep flies: the request, who flies, and how the episodes are cut into blocks."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.evaluation.contestants import Arena, Contestant, contestant_named
from drm_baselines.policies.names import find, is_name
from drm_baselines.support import storage
from drm_baselines.support.seeds import check_seeds

BLOCKS = {"bound": 50, "controller": 20}
"""Episodes of a block by the kind of who flies: some seconds of one core."""
BLOCK = 5000
"""Episodes of a block of all others."""

_NAME = re.compile(r"[\w.-]+")


@dataclass(frozen=True, kw_only=True)
class SweepRequest:
    """What a sweep flies.

    Attributes
    ----------
    policies
        Who flies: names of policies, or directories of training runs.
    env_id, options
        Where the manoeuvres are drawn from, with keyword options.
    payload_mass
        Range of the true payload, kg, drawn uniformly; none: as the environment draws it.
    mass_error
        Largest error of the reported mass, as a part of the true one; drawn uniformly from both
        sides of zero. None: as the environment draws it.
    episodes
        Manoeuvres that everybody flies.
    seed
        Manoeuvre i is that of ``reset(seed=seed + i)``.
    """

    policies: Sequence[str]
    env_id: str = "drm_env/Slew-v0"
    options: Mapping[str, Any] = field(default_factory=dict)
    payload_mass: tuple[float, float] | None = (50.0, 500.0)
    mass_error: float | None = 0.15
    episodes: int = 1000
    seed: int = 0

    def __post_init__(self) -> None:
        """Check what the environment does not check.

        Raises
        ------
        BaselineError
            A range that is none, an option given twice, or seeds that training may have flown.
        """
        check_seeds(self.seed, self.episodes)
        if not self.policies:
            raise BaselineError("policies: there is none to fly")
        if self.payload_mass is not None:
            low, high = self.payload_mass
            if not low < high:
                raise BaselineError(
                    f"payload_mass must be a range LOW HIGH with LOW below HIGH, got {low:g} "
                    f"{high:g}"
                )
        if self.mass_error is not None and not 0.0 < self.mass_error < 1.0:
            raise BaselineError(f"mass_error must be between 0 and 1, got {self.mass_error:g}")
        for name, value in (("payload_mass", self.payload_mass), ("mass_error", self.mass_error)):
            if value is not None and name in self.options:
                raise BaselineError(f"{name} is given twice")

    @property
    def drawn(self) -> dict[str, Any]:
        """The environment's options, the two ranges among them."""
        drawn = dict(self.options)
        if self.payload_mass is not None:
            drawn["payload_mass"] = self.payload_mass
        if self.mass_error is not None:
            drawn["mass_error"] = (-self.mass_error, self.mass_error)
        return drawn


@dataclass(frozen=True, kw_only=True)
class Block:
    """Consecutive episodes of one policy: what one job of a sweep flies and one file holds."""

    policy: str
    index: int
    seed: int
    episodes: int


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """Everybody who flies in a sweep, by name, over whose manoeuvres.

    Attributes
    ----------
    arena
        Where the manoeuvres come from.
    contestants, sizes
        Who flies, and episodes of a block, by the name in files.
    """

    arena: Arena
    contestants: Mapping[str, Contestant]
    sizes: Mapping[str, int]

    @classmethod
    def of(cls, request: SweepRequest) -> Fleet:
        """Return who flies, after checking that each can.

        Raises
        ------
        BaselineError, drm_env.ConfigError
            No such policy, one named twice or that does not fit, options that are none.
        """
        arena = Arena(
            env_id=request.env_id,
            options=request.drawn,
            seed=request.seed,
            episodes=request.episodes,
        )
        contestants: dict[str, Contestant] = {}
        sizes = {}
        for text in request.policies:
            name = find(text).name if is_name(text) else Path(text).resolve().name
            if name in contestants:
                raise BaselineError(f"two policies are called {name!r}: name each only once")
            # a check of a learned one draws some episodes
            contestants[name] = contestant_named(replace(arena, episodes=1), text)
            if not _NAME.fullmatch(name):
                raise BaselineError(f"{name!r} cannot be a part of a file's name")
            sizes[name] = BLOCKS.get(find(name).kind, BLOCK) if is_name(text) else BLOCK
        return cls(arena=arena, contestants=contestants, sizes=sizes)

    def blocks(self, policy: str) -> Iterator[Block]:
        """Yield the blocks of a policy; where they begin does not depend on how many there are."""
        size, total = self.sizes[policy], self.arena.episodes
        for index in range(math.ceil(total / size)):
            first = index * size
            yield Block(
                policy=policy,
                index=index,
                seed=self.arena.seed + first,
                episodes=min(size, total - first),
            )

    def digest(self, policy: str) -> str:
        """Return a digest of all that decides what a policy's blocks hold."""
        contestant = self.contestants[policy]
        details = contestant.details if contestant.pilot is None else contestant.pilot.details
        content = {
            "config": self.arena.resolved.to_dict(),
            "env_id": self.arena.env_id,
            "seed": self.arena.seed,
            "block": self.sizes[policy],
            "policy": {"name": policy, **details},
            "engine": drm_env.__version__,
        }
        text = json.dumps(storage.plain(content), sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()
