"""Flying policies over the same episodes, and what the records say.

``episodes`` flies, ``contestants`` and ``comparison`` are behind ``drm compare``; ``records`` and
``metrics`` hold what was measured, ``statistics`` judges it, ``tables`` and ``plots`` show it,
``datasets`` keeps flights for offline learning.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drm_baselines.support.lazy import exports

if TYPE_CHECKING:
    from drm_baselines.evaluation.datasets import create_minari_dataset
    from drm_baselines.evaluation.environments import (
        config_data,
        environment_config,
        known_ids,
        scenarios_of,
        task_of,
    )
    from drm_baselines.evaluation.episodes import Progress, fly_law, fly_policy
    from drm_baselines.support.seeds import TRAINING_SEED, episode_seeds

__all__ = [
    "TRAINING_SEED",
    "Progress",
    "config_data",
    "create_minari_dataset",
    "environment_config",
    "episode_seeds",
    "fly_law",
    "fly_policy",
    "known_ids",
    "scenarios_of",
    "task_of",
]

__getattr__ = exports(
    __name__,
    {
        ".datasets": ["create_minari_dataset"],
        ".episodes": ["Progress", "fly_law", "fly_policy"],
        ".environments": [
            "config_data",
            "environment_config",
            "known_ids",
            "scenarios_of",
            "task_of",
        ],
        "..support.seeds": ["TRAINING_SEED", "episode_seeds"],
    },
)


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
