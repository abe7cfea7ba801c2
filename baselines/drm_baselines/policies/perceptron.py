"""A network as a policy: a perceptron in NumPy, and the engine's own behind it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import drm_env
from drm_baselines.errors import PolicyError
from drm_baselines.policies.compatibility import (
    ObservationCheck,
    check_trained_task,
    complete_config,
)

Array = NDArray[np.float32]


def _relu(values: Array) -> Array:
    return np.maximum(values, np.float32(0.0))


ACTIVATIONS: dict[str, Callable[[Array], Array]] = {"tanh": np.tanh, "relu": _relu}
OUTPUTS = ("clip", "tanh")


@dataclass(frozen=True, kw_only=True)
class Perceptron:
    """Layers of a multilayer perceptron.

    Attributes
    ----------
    weights
        One ``(outputs, inputs)`` float32 matrix a layer.
    biases
        One ``(outputs,)`` float32 vector a layer.
    activation
        ``"tanh"`` or ``"relu"``, after every layer but the last.
    output
        ``"clip"`` limits the last layer to [-1, 1] (Gaussian policies), ``"tanh"``
        squashes it (SAC).
    """

    weights: Sequence[Array]
    biases: Sequence[Array]
    activation: str
    output: str

    def __post_init__(self) -> None:
        """Check that the layers fit together and are finite."""
        if self.activation not in ACTIVATIONS:
            raise PolicyError(
                f"activation must be one of {sorted(ACTIVATIONS)}, got {self.activation!r}"
            )
        if self.output not in OUTPUTS:
            raise PolicyError(f"output must be one of {list(OUTPUTS)}, got {self.output!r}")
        if not self.weights or len(self.weights) != len(self.biases):
            raise PolicyError(
                f"{len(self.weights)} weight matrices and {len(self.biases)} "
                "bias vectors do not make a network"
            )
        size = None
        for index, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.ndim != 2 or bias.shape != weight.shape[:1]:
                raise PolicyError(
                    f"layer {index}: weight {weight.shape} and bias {bias.shape} do not fit"
                )
            if size is not None and weight.shape[1] != size:
                raise PolicyError(
                    f"layer {index} takes {weight.shape[1]} inputs, but the layer "
                    f"before gives {size}"
                )
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise PolicyError(f"layer {index} holds values that are not finite")
            size = weight.shape[0]

    @property
    def inputs(self) -> int:
        """Number of observation entries."""
        return int(self.weights[0].shape[1])

    @property
    def outputs(self) -> int:
        """Number of action entries."""
        return int(self.weights[-1].shape[0])

    def engine(self) -> drm_env.Network:
        """Return the same network as the engine flies it, for ``drm_env.rollout``.

        It computes in double precision: its actions differ from this one's by rounding.

        Raises
        ------
        drm_env.ConfigError
            Larger than the engine takes.
        """
        pairs = list(zip(self.weights, self.biases, strict=True))
        return drm_env.Network(pairs, activation=self.activation, output=self.output)

    def __call__(self, observations: ArrayLike) -> Array:
        """Return actions in [-1, 1], shape ``(n, outputs)``, for ``(n, inputs)`` observations."""
        activation = ACTIVATIONS[self.activation]
        values = np.asarray(observations, dtype=np.float32)
        last = len(self.weights) - 1
        for index, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            values = values @ weight.T + bias
            if index < last:
                values = activation(values)
        return np.tanh(values) if self.output == "tanh" else np.clip(values, -1.0, 1.0)


class NetworkPolicy:
    """A trained network behind the ``predict`` call of Stable-Baselines3.

    ``control_period`` is the time between two decisions it was trained with, in s; ``env_id``
    and ``config`` are the environment it was trained in, the configuration completed by what this
    version has and that of the training had not.
    """

    def __init__(self, network: Perceptron, description: Mapping[str, Any]) -> None:
        self.network = network
        self.description = dict(description)
        self.control_period = float(description["control_period"])
        self.env_id = str(description["env_id"])
        self.config = complete_config(description["config"])
        self.name = "learned"
        self._check = ObservationCheck(self.name, description["observation_layout"])

    def check_task(self, config: drm_env.EnvConfig) -> None:
        """Refuse an environment whose observations or actions are not those of the training.

        Raises
        ------
        PolicyError
            Another observation layout, other actuators, inner law or ``wheel_scale``.
        """
        layout = self.description["observation_layout"]
        check_trained_task(self.env_id, self.config, layout, config)

    def predict(
        self,
        observation: ArrayLike,
        state: tuple[NDArray[np.float64], ...] | None = None,
        episode_start: ArrayLike | None = None,  # noqa: ARG002
        deterministic: bool = True,
    ) -> tuple[Array, tuple[NDArray[np.float64], ...] | None]:
        """Return the mean action for one observation ``(d,)`` or a batch ``(n, d)``.

        The policy has no memory: ``state`` is handed back, ``episode_start`` is not looked at.

        Raises
        ------
        PolicyError
            Wrong observation size, values that are not finite, or a random action was asked for
            (exported policies carry no exploration noise).

        Warns
        -----
        PolicyWarning
            Once, of observations that the environment it was trained in cannot give: scaled,
            normalised or reordered ones.
        """
        actions = self.network(self._batch_of(observation, deterministic))
        return (actions[0] if np.ndim(observation) == 1 else actions), state

    def _batch_of(self, observation: ArrayLike, deterministic: bool) -> Array:
        """Check what is asked; return the observations as a batch, shape ``(n, d)``."""
        if not deterministic:
            raise PolicyError(
                "an exported policy is deterministic: call predict with deterministic=True"
            )
        array = np.asarray(observation, dtype=np.float32)
        if array.ndim not in (1, 2) or array.shape[-1] != self.network.inputs:
            raise PolicyError(
                f"observation has shape {array.shape}, but the policy was trained "
                f"on {self.network.inputs} entries"
            )
        batch = np.atleast_2d(array)
        self._check(batch)
        return batch
