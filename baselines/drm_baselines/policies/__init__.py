"""Policies: the control laws and learned networks behind one ``predict`` call.

    policy = make_policy("lyapunov", env=env)
    action, state = policy.predict(observation, state=None, episode_start=None)

``registry`` makes them by name, ``names`` says how they are called and drawn, ``pilots`` flies
whole manoeuvres under each of these names, ``law_policy`` and ``perceptron`` are the two kinds,
``policy_file`` and ``gains`` read what is stored of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drm_baselines.support.lazy import exports

if TYPE_CHECKING:
    from drm_baselines.policies.compatibility import config_of
    from drm_baselines.policies.gains import TUNED, load_gains
    from drm_baselines.policies.law_policy import LawPolicy, Policy, law_name
    from drm_baselines.policies.names import find, names_of
    from drm_baselines.policies.perceptron import NetworkPolicy, Perceptron
    from drm_baselines.policies.pilots import Pilot, law_data, pilot_named
    from drm_baselines.policies.policy_file import load_policy, save_policy
    from drm_baselines.policies.registry import LAWS, LEARNED, make_policy, shipped_policy
    from drm_env.constants import LAW_PERIOD

__all__ = [
    "LAWS",
    "LAW_PERIOD",
    "LEARNED",
    "TUNED",
    "LawPolicy",
    "NetworkPolicy",
    "Perceptron",
    "Pilot",
    "Policy",
    "config_of",
    "find",
    "law_data",
    "law_name",
    "load_gains",
    "load_policy",
    "make_policy",
    "names_of",
    "pilot_named",
    "save_policy",
    "shipped_policy",
]

__getattr__ = exports(
    __name__,
    {
        ".registry": ["LAWS", "LEARNED", "make_policy", "shipped_policy"],
        ".names": ["find", "names_of"],
        ".pilots": ["Pilot", "law_data", "pilot_named"],
        ".law_policy": ["LAW_PERIOD", "LawPolicy", "Policy", "law_name"],
        ".gains": ["TUNED", "load_gains"],
        ".perceptron": ["NetworkPolicy", "Perceptron"],
        ".policy_file": ["load_policy", "save_policy"],
        ".compatibility": ["config_of"],
    },
)


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
