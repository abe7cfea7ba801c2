"""Learned policies as the engine flies them: multilayer perceptrons of plain arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env import _engine
from drm_env.errors import ConfigError

__all__ = ["Network"]

LayerLike = tuple[ArrayLike, ArrayLike]


def _single(values: ArrayLike, name: str, rank: int) -> NDArray[np.float32]:
    """A contiguous read-only float32 copy of an array of real numbers.

    Raises
    ------
    ConfigError
        not real numbers, or another number of dimensions.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ConfigError(f"{name} must be an array of real numbers, got dtype {array.dtype}")
    if array.ndim != rank:
        raise ConfigError(f"{name} must have {rank} dimensions, got shape {array.shape}")
    with np.errstate(over="ignore"):  # what overflows is infinite, which the engine refuses
        copy = np.array(array, dtype=np.float32, order="C")
    copy.setflags(write=False)
    return copy


class Network:
    """A multilayer perceptron from observations to actions in [-1, 1].

    Parameters
    ----------
    layers
        for each layer its weights, shape (outputs, inputs), and its biases, shape (outputs,);
        float32, or converted to it. Weights of PyTorch's ``Linear`` have this shape.
    activation
        after every layer but the last: ``"tanh"`` or ``"relu"``.
    output
        of the last layer: ``"clip"`` limits it to [-1, 1] (Gaussian policies), ``"tanh"`` squashes
        it (SAC).

    Attributes
    ----------
    layers
        weights and biases as they are flown, float32, read-only.
    activation, output
        as given.

    Raises
    ------
    ConfigError
        no layer, layers that do not fit together or are too large (4096), numbers that are not
        finite, an unknown name.

    Examples
    --------
    >>> import numpy as np
    >>> import drm_env
    >>> entries = len(drm_env.observation_layout("slew"))
    >>> idle = drm_env.Network([(np.zeros((2, entries)), np.zeros(2))])
    >>> scenarios = drm_env.sample_scenarios("slew", seed=0, n=4)
    >>> flown = drm_env.rollout(scenarios, policy=idle, task="slew")
    >>> open_loop = drm_env.rollout(scenarios)
    >>> bool((flown["peak_slew_angle"] == open_loop["peak_slew_angle"]).all())
    True
    """

    def __init__(
        self,
        layers: Sequence[LayerLike],
        activation: str = "tanh",
        output: str = "clip",
    ) -> None:
        """Makes the network; see the class for the arguments."""
        pairs = list(layers)
        plain = []
        for index, pair in enumerate(pairs):
            if not isinstance(pair, Sequence) or len(pair) != 2:
                raise ConfigError(
                    f"layers[{index}] must be a pair of weights and biases, "
                    f"got {type(pair).__name__}"
                )
            weights = _single(pair[0], f"layers[{index}].weights", 2)
            plain.append((weights, _single(pair[1], f"layers[{index}].biases", 1)))
        for name, value in (("activation", activation), ("output", output)):
            if not isinstance(value, str):
                raise ConfigError(f"{name} must be text, got {value!r}")
        self.layers: tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...] = tuple(plain)
        self.activation = activation
        self.output = output
        self._engine = _engine.Network(plain, activation, output)

    @property
    def inputs(self) -> int:
        """Entries of an observation."""
        return self._engine.inputs

    @property
    def outputs(self) -> int:
        """Entries of an action."""
        return self._engine.outputs

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Actions (outputs,) of one observation (inputs,), or (n, outputs) of many (n, inputs).

        They are those of a rollout to the bit: computed in double precision, rounded to float32.

        Raises
        ------
        ConfigError
            another shape.
        """
        array = np.asarray(observations, dtype=np.float32)
        if array.ndim not in (1, 2) or array.shape[-1] != self.inputs:
            raise ConfigError(
                f"observations must have shape ({self.inputs},) or (n, {self.inputs}), "
                f"got {array.shape}"
            )
        actions = self._engine.act(np.ascontiguousarray(np.atleast_2d(array)))
        return actions[0] if array.ndim == 1 else actions

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are made from the arguments."""
        return type(self), (self.layers, self.activation, self.output)

    def __repr__(self) -> str:
        """Sizes and functions."""
        sizes = [self.inputs, *(len(biases) for _, biases in self.layers)]
        shape = "-".join(str(size) for size in sizes)
        return f"Network({shape}, activation={self.activation!r}, output={self.output!r})"
