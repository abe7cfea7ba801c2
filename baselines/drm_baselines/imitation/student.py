"""The network that learns: an ordinary feed-forward policy of the residual environment."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn

from drm_baselines.policies.perceptron import Perceptron

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU}


class Student(nn.Module):
    """A network on standardised observations; the standardisation is folded in when exported."""

    mean: torch.Tensor
    deviation: torch.Tensor

    def __init__(
        self,
        layers: Sequence[int],
        activation: str,
        mean: NDArray[np.float32],
        deviation: NDArray[np.float32],
    ) -> None:
        super().__init__()
        sizes = [mean.size, *layers]
        hidden: list[nn.Module] = []
        for inputs, outputs in pairwise(sizes):
            hidden += [nn.Linear(inputs, outputs), _ACTIVATIONS[activation]()]
        self.layers = nn.Sequential(*hidden, nn.Linear(sizes[-1], 2))
        self.activation = activation
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("deviation", torch.from_numpy(deviation))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return actions, not limited, (n, 2)."""
        scaled = (observations - self.mean) / self.deviation
        actions: torch.Tensor = self.layers(scaled)
        return actions

    @classmethod
    def of(
        cls, network: Perceptron, mean: NDArray[np.float32], deviation: NDArray[np.float32]
    ) -> Student:
        """Return a student that is this network, with observations standardised anew."""
        student = cls(
            [len(bias) for bias in network.biases[:-1]], network.activation, mean, deviation
        )
        linear = [layer for layer in student.layers if isinstance(layer, nn.Linear)]
        weights = [np.asarray(weight, dtype=np.float64) for weight in network.weights]
        biases = [np.asarray(bias, dtype=np.float64) for bias in network.biases]
        biases[0] = biases[0] + weights[0] @ mean.astype(np.float64)
        weights[0] = weights[0] * deviation.astype(np.float64)
        with torch.no_grad():
            for layer, weight, bias in zip(linear, weights, biases, strict=True):
                layer.weight.copy_(torch.from_numpy(weight))
                layer.bias.copy_(torch.from_numpy(bias))
        return student

    def perceptron(self) -> Perceptron:
        """Return the same network as plain arrays."""
        linear = [layer for layer in self.layers if isinstance(layer, nn.Linear)]
        weights = [layer.weight.detach().numpy().astype(np.float64) for layer in linear]
        biases = [layer.bias.detach().numpy().astype(np.float64) for layer in linear]
        mean = np.asarray(self.mean, dtype=np.float64)
        weights[0] = weights[0] / np.asarray(self.deviation, dtype=np.float64)
        biases[0] = biases[0] - weights[0] @ mean
        return Perceptron(
            weights=[weight.astype(np.float32) for weight in weights],
            biases=[bias.astype(np.float32) for bias in biases],
            activation=self.activation,
            output="clip",
        )
