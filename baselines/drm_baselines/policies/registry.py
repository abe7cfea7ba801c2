"""Policies by name: what ``make_policy`` makes of the names that the commands know."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import drm_env
from drm_baselines.errors import PolicyError
from drm_baselines.policies.compatibility import (
    check_environment,
    check_period,
    config_of,
    decision_period,
)
from drm_baselines.policies.law_policy import LawPolicy
from drm_baselines.policies.names import find, names_of
from drm_baselines.policies.perceptron import NetworkPolicy
from drm_baselines.policies.pilots import law_data, shipped_run
from drm_baselines.policies.policy_file import load_policy

LAWS = names_of("open loop", "law")
"""Control laws by name: open loop, linear and Lyapunov-based feedback."""

LEARNED = "learned"
"""Name of the learned policy that comes with the package."""


def make_policy(
    name: str,
    *,
    env: Any = None,
    config: drm_env.EnvConfig
    | drm_env.ResolvedConfig
    | Mapping[str, Any]
    | str
    | Path
    | None = None,
    **law_parameters: Any,
) -> LawPolicy | NetworkPolicy:
    """Make a policy that acts on observations. No torch is imported.

    Parameters
    ----------
    name
        ``"none"`` (open loop, or the environment's inner law alone), ``"linear"`` or
        ``"lyapunov"`` with the thesis' gains; ``"lqr"``, ``"linear_tuned"`` or
        ``"lyapunov_tuned"`` with those of ``drm tune``; ``"dagger"`` (or ``"learned"``), ``"ppo"``,
        ``"sac"``, ``"ppo_direct"``, ``"ppo_robust"``, ``"ppo_flexible"`` or ``"sac_direct"``, the
        first network of that method that comes with the package, which acts in the task of its
        ``config``. What plans a whole manoeuvre (``"receding"``, ``"bound"``) does not act on
        observations: see :func:`drm_baselines.policies.pilots.pilot_named`.
    env
        The environment it will act in: single, vector or Stable-Baselines3. A law then divides by
        the torque limits of the very episodes that are flown; wrappers that change observations
        or actions are refused.
    config
        Its configuration, instead of ``env``; without either, that of ``drm_env/Slew-v0``. The
        observations alone are then checked.
    **law_parameters
        Gains other than the thesis', such as ``tip=None`` or ``root={"angle_gain": 4e3}``.

    Raises
    ------
    PolicyError
        Unknown name, or a policy that cannot act in this environment.
    drm_env.ConfigError
        Impossible gains or configuration.

    Warns
    -----
    PolicyWarning
        The environment asks at another period than the policy's own, such as a law at 100 Hz.
    """
    if env is not None and config is not None:
        raise PolicyError("give env or config, not both")
    kind = find(name).kind
    if kind == "learned":
        return _learned(name, env, config, law_parameters)
    if kind in ("controller", "bound"):
        raise PolicyError(
            f"{name!r} flies whole manoeuvres and does not act on observations: drm compare, "
            "evaluate, simulate and benchmark fly it"
        )
    law = law_data(name, **law_parameters)
    if env is not None:
        resolved = config_of(env)
    elif isinstance(config, drm_env.EnvConfig):
        resolved = config
    else:
        resolved = drm_env.resolve(config=config).config
    policy = LawPolicy(law, resolved, env)
    if name != "none":
        check_period(name, policy.control_period, decision_period(env, resolved))
    return policy


def shipped_policy() -> Path:
    """Return the directory of the learned policy that comes with the package."""
    return shipped_run(LEARNED)


def _learned(name: str, env: Any, config: Any, parameters: Mapping[str, Any]) -> NetworkPolicy:
    if parameters:
        raise PolicyError(f"{name!r} has no parameter {sorted(parameters)[0]!r}")
    policy = load_policy(shipped_run(name))
    if env is not None or config is not None:
        resolved = config_of(env) if env is not None else drm_env.resolve(config=config).config
        if env is not None:
            check_environment(env, resolved)
        policy.check_task(resolved)
        check_period(name, policy.control_period, decision_period(env, resolved))
    return policy
