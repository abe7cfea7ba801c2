"""Taking the deterministic policy out of a Stable-Baselines3 model as plain arrays."""

from __future__ import annotations

import numpy as np

from drm_baselines.errors import PolicyError
from drm_baselines.policies.perceptron import Perceptron
from drm_baselines.support.extras import needing

with needing("training", "learn"):
    import torch
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.base_class import BaseAlgorithm
    from torch import nn

_ACTIVATIONS: dict[type[nn.Module], str] = {nn.Tanh: "tanh", nn.ReLU: "relu"}


def perceptron_of(model: BaseAlgorithm) -> Perceptron:
    """Return the network from observation to mean action of a PPO or SAC model.

    Raises
    ------
    PolicyError
        Another algorithm, or layers that are not a plain multilayer perceptron.
    """
    if isinstance(model, PPO):
        layers = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
        output = "clip"
    elif isinstance(model, SAC):
        layers = [*model.actor.latent_pi, model.actor.mu]
        output = "tanh"
    else:
        raise PolicyError(f"policies of {type(model).__name__} cannot be exported")
    weights, biases, activations = [], [], set()
    for layer in layers:
        if isinstance(layer, nn.Linear):
            weights.append(_numpy(layer.weight))
            biases.append(_numpy(layer.bias))
        elif type(layer) in _ACTIVATIONS:
            activations.add(_ACTIVATIONS[type(layer)])
        else:
            raise PolicyError(f"layers of type {type(layer).__name__} cannot be exported")
    if len(activations) != 1:
        raise PolicyError(f"one activation is needed, the network has {sorted(activations)}")
    return Perceptron(weights=weights, biases=biases, activation=activations.pop(), output=output)


def _numpy(parameter: torch.Tensor) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    array = parameter.detach().cpu().numpy().astype(np.float32, copy=True)
    return np.ascontiguousarray(array)
