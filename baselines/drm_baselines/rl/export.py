"""Taking the deterministic policy out of a Stable-Baselines3 model as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.errors import PolicyError
from drm_baselines.policies.perceptron import NetworkPolicy, Perceptron
from drm_baselines.policies.recurrent import Cell, RecurrentNetwork, RecurrentPolicy
from drm_baselines.support.extras import needing

with needing("training", "learn"):
    import torch
    from stable_baselines3.common.base_class import BaseAlgorithm
    from torch import nn

_ACTIVATIONS: dict[type[nn.Module], str] = {nn.Tanh: "tanh", nn.ReLU: "relu"}


def perceptron_of(model: BaseAlgorithm) -> Perceptron:
    """Return the network from observation to mean action of a trained model.

    Layers that normalise batches (CrossQ) are, with the averages that a trained policy uses,
    linear; they become part of the linear layer behind them.

    Raises
    ------
    PolicyError
        An unknown algorithm, or layers that are not a plain multilayer perceptron.
    """
    layers, output = _layers(model)
    weights: list[NDArray[np.float32]] = []
    biases: list[NDArray[np.float32]] = []
    activations = set()
    scale: NDArray[np.float64] | None = None
    shift: NDArray[np.float64] | None = None
    for layer in layers:
        if isinstance(layer, nn.Linear):
            weight, bias = _numpy(layer.weight), _numpy(layer.bias)
            if scale is not None and shift is not None:
                bias = bias + weight @ shift
                weight = weight * scale
                scale = shift = None
            weights.append(np.ascontiguousarray(weight, dtype=np.float32))
            biases.append(np.ascontiguousarray(bias, dtype=np.float32))
        elif scale is not None:
            raise PolicyError("a normalised batch that goes into no linear layer")
        elif type(layer).__name__ == "BatchRenorm1d":
            scale, shift = _normalisation(layer)
        elif type(layer) in _ACTIVATIONS:
            activations.add(_ACTIVATIONS[type(layer)])
        else:
            raise PolicyError(f"layers of type {type(layer).__name__} cannot be exported")
    if len(activations) != 1:
        raise PolicyError(f"one activation is needed, the network has {sorted(activations)}")
    return Perceptron(weights=weights, biases=biases, activation=activations.pop(), output=output)


def network_of(model: BaseAlgorithm) -> Perceptron:
    """Return the network of a trained model, with its memory if it has one.

    Raises
    ------
    PolicyError
        See :func:`perceptron_of`.
    """
    head = perceptron_of(model)
    memory: Any = getattr(model.policy, "lstm_actor", None)
    if memory is None:
        return head
    if memory.bidirectional or memory.proj_size or not memory.bias:
        raise PolicyError("an LSTM with projections, without biases or both ways is not exported")
    cells = []
    for index in range(memory.num_layers):
        bias = [_numpy(getattr(memory, f"bias_{kind}_l{index}")) for kind in ("ih", "hh")]
        cells.append(
            Cell(
                input_weight=_single(getattr(memory, f"weight_ih_l{index}")),
                hidden_weight=_single(getattr(memory, f"weight_hh_l{index}")),
                bias=np.ascontiguousarray(bias[0] + bias[1], dtype=np.float32),
            )
        )
    return RecurrentNetwork(
        weights=head.weights,
        biases=head.biases,
        activation=head.activation,
        output=head.output,
        cells=cells,
    )


def policy_of(model: BaseAlgorithm, description: Mapping[str, Any]) -> NetworkPolicy:
    """Return a trained model as the policy that its export is."""
    network = network_of(model)
    if isinstance(network, RecurrentNetwork):
        return RecurrentPolicy(network, description)
    return NetworkPolicy(network, description)


def actor_layers(model: BaseAlgorithm) -> tuple[list[nn.Linear], str]:
    """Return the linear layers of a model's actor in order, and what is made of the last output.

    There are none where something else is between them: a memory, or batches that are normalised.

    Raises
    ------
    PolicyError
        An unknown algorithm.
    """
    layers, output = _layers(model)
    plain = all(isinstance(layer, (nn.Linear, *_ACTIVATIONS)) for layer in layers)
    if not plain or hasattr(model.policy, "lstm_actor"):
        return [], output
    return [layer for layer in layers if isinstance(layer, nn.Linear)], output


def _layers(model: BaseAlgorithm) -> tuple[list[nn.Module], str]:
    """The actor's layers in order, and what is made of the last one's output."""
    policy: Any = model.policy
    if hasattr(policy, "mlp_extractor"):
        return [*policy.mlp_extractor.policy_net, policy.action_net], "clip"
    actor: Any = getattr(policy, "actor", None)
    if hasattr(actor, "latent_pi"):
        mean = actor.mu
        if isinstance(mean, nn.Sequential):  # clipped before it is squashed
            raise PolicyError("layers of type Hardtanh cannot be exported")
        return [*actor.latent_pi, mean], "tanh"
    if isinstance(getattr(actor, "mu", None), nn.Sequential) and isinstance(actor.mu[-1], nn.Tanh):
        return list(actor.mu[:-1]), "tanh"
    raise PolicyError(f"policies of {type(model).__name__} cannot be exported")


def _normalisation(layer: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Scale and shift of a layer that normalises with the averages it has kept."""
    scale = 1.0 / np.sqrt(_numpy(layer.ra_var) + layer.eps)
    shift = -_numpy(layer.ra_mean) * scale
    if layer.affine:
        gain = _numpy(layer.scale)
        scale, shift = scale * gain, shift * gain + _numpy(layer.bias)
    return scale, shift


def _single(parameter: torch.Tensor) -> NDArray[np.float32]:
    return np.ascontiguousarray(_numpy(parameter), dtype=np.float32)


def _numpy(parameter: torch.Tensor) -> NDArray[np.float64]:
    return parameter.detach().cpu().numpy().astype(np.float64)
