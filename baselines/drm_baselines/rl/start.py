"""Training that begins with a policy that is there: fine-tuning of a student."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drm_baselines.errors import RunError
from drm_baselines.policies.perceptron import NetworkPolicy
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.rl.hyperparameters import Hyperparameters


def task_of_start(
    directory: Path, env_id: str | None, options: Mapping[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Return the environment that a policy goes on in: the one that it was trained in.

    Parameters
    ----------
    directory
        Of the policy.
    env_id, options
        What the user has given: an id in the place of the policy's own, and options that win over
        those of its configuration.

    Raises
    ------
    RunError
        No policy there, or a damaged one.
    """
    policy = load_policy(directory)
    if env_id is not None:
        return env_id, dict(options)
    return policy.env_id, {"config": policy.config, **options}


def settings_of_start(directory: Path, settings: Hyperparameters) -> Hyperparameters:
    """Return packaged settings with the network of a policy, to go on in its own task.

    Layers and activation are the policy's, and the options of the environment that belong to the
    settings, such as a longer control period, are dropped.

    Raises
    ------
    RunError
        No policy there, a damaged one, or one with a memory.
    """
    policy = load_policy(directory)
    if type(policy) is not NetworkPolicy:
        raise RunError(f"{directory}: only a policy without a memory can be begun with")
    layers = tuple(int(weight.shape[0]) for weight in policy.network.weights[:-1])
    if not layers:
        raise RunError(f"{directory}: only a policy with a hidden layer can be begun with")
    network = replace(settings.network, layers=layers, activation=policy.network.activation)
    return replace(settings, env={}, network=network)
