"""Baselines for drm-env: control laws as policies, training, evaluation and comparison.

>>> import gymnasium as gym
>>> from drm_baselines import make_policy
>>> env = gym.make("drm_env/Slew-v0", control_period=0.002)
>>> law = make_policy("lyapunov", env=env)  # the engine's own law
>>> agent = make_policy("learned")  # safetensors and JSON; load_policy(directory) reads others
>>> observation, info = env.reset(seed=0)
>>> action, state = law.predict(observation, state=None, episode_start=None)

The ``drm`` command does the same from a terminal: ``drm --help``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drm_baselines import _moved
from drm_baselines.support.lazy import exports

if TYPE_CHECKING:
    from drm_baselines.errors import (
        BaselineError,
        ExistingResultError,
        PolicyError,
        PolicyWarning,
        RunError,
    )
    from drm_baselines.policies import LAW_PERIOD, LAWS, LawPolicy, load_policy, make_policy

__version__ = "0.1.0"

__all__ = [
    "LAWS",
    "LAW_PERIOD",
    "BaselineError",
    "ExistingResultError",
    "LawPolicy",
    "PolicyError",
    "PolicyWarning",
    "RunError",
    "__version__",
    "load_policy",
    "make_policy",
]

_moved.install()

__getattr__ = exports(
    __name__,
    {
        ".errors": [
            "BaselineError", "ExistingResultError", "PolicyError", "PolicyWarning", "RunError",
        ],
        ".policies": ["LAWS", "LAW_PERIOD", "LawPolicy", "load_policy", "make_policy"],
    },
)  # fmt: skip


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
