"""What to train, and who is told how it goes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from drm_baselines.evaluation.records import Episodes
from drm_baselines.rl import hyperparameters


@dataclass(frozen=True, kw_only=True)
class TrainingRequest:
    """What to train.

    Attributes
    ----------
    algorithm, env_id, options
        Name in `drm_baselines.rl.algorithms`, the environment's id and its keyword options.
    steps
        Environment steps of the whole run, over all environments and segments.
    seed
        Of the networks, the action noise and the episodes.
    settings
        Hyperparameters; ``n_envs`` among them.
    evaluations, evaluation_episodes
        Number of points of the learning curve, and episodes behind each.
    start
        Directory of a policy whose weights the actor begins with; none: random weights.
    """

    algorithm: str
    env_id: str
    options: Mapping[str, Any]
    steps: int
    seed: int
    settings: hyperparameters.Hyperparameters
    evaluations: int = 10
    evaluation_episodes: int = 100
    start: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Point:
    """One point of a learning curve."""

    steps: int
    wall_time: float
    episodes: Episodes


class Watcher(Protocol):
    """Whoever shows the progress of a run."""

    def advanced(self, steps: int, recent: Mapping[str, float]) -> None:
        """Called now and then with the steps so far and averages over recent episodes."""

    def evaluated(self, point: Point) -> None:
        """Called after each point of the learning curve."""


@dataclass
class SilentWatcher:
    """Shows nothing, keeps the points."""

    points: list[Point] = field(default_factory=list)

    def advanced(self, steps: int, recent: Mapping[str, float]) -> None:
        """Take note of nothing."""

    def evaluated(self, point: Point) -> None:
        """Keep the point."""
        self.points.append(point)
