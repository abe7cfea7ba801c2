"""The learning algorithms: one table, which imports neither torch nor Stable-Baselines3."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drm_baselines.support.extras import needing

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm


@dataclass(frozen=True)
class Algorithm:
    """A learning algorithm and what differs between them.

    Attributes
    ----------
    package, type_name
        Where its class is imported from.
    replays
        Whether it learns from a buffer of old transitions (off-policy) or from what its policy
        has just done (on-policy).
    draws
        Whether its policy draws its actions, with a standard deviation that it learns. One that
        does not needs noise from outside to explore.
    remembers
        Whether its policy has a memory: layers of LSTM.
    """

    package: str
    type_name: str
    replays: bool
    draws: bool = True
    remembers: bool = False

    def load_type(self) -> type[BaseAlgorithm]:
        """Import and return the class.

        Raises
        ------
        MissingPackageError
            The package is not installed.
        """
        with needing(f"training with {self.type_name}", "learn"):
            loaded: type[BaseAlgorithm] = getattr(
                importlib.import_module(self.package), self.type_name
            )
        return loaded


ALGORITHMS = {
    "ppo": Algorithm("stable_baselines3", "PPO", replays=False),
    "sac": Algorithm("stable_baselines3", "SAC", replays=True),
    "td3": Algorithm("stable_baselines3", "TD3", replays=True, draws=False),
    "tqc": Algorithm("sb3_contrib", "TQC", replays=True),
    "crossq": Algorithm("sb3_contrib", "CrossQ", replays=True),
    "recurrent_ppo": Algorithm("sb3_contrib", "RecurrentPPO", replays=False, remembers=True),
}
"""By the name that ``drm train --algo`` takes."""
