"""A network with a memory as a policy: layers of LSTM before a perceptron, in NumPy.

The engine flies networks without a memory. These are flown through a batch of environments, one
forward pass a decision for all of them together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import drm_env
from drm_baselines.errors import PolicyError
from drm_baselines.policies.perceptron import Array, NetworkPolicy, Perceptron

Memory = tuple[Array, Array]
"""What an LSTM remembers: output and cell, each of shape (layers, n, hidden units)."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A layer of long short-term memory, as PyTorch's ``nn.LSTM`` has it.

    The rows of the arrays are input gate, forget gate, cell candidate and output gate, one below
    the other.

    Attributes
    ----------
    input_weight
        Shape (4 hidden, inputs).
    hidden_weight
        Shape (4 hidden, hidden).
    bias
        Shape (4 hidden,): PyTorch's two biases, added.
    """

    input_weight: Array
    hidden_weight: Array
    bias: Array

    @property
    def hidden(self) -> int:
        """Number of hidden units."""
        return int(self.hidden_weight.shape[1])

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return int(self.input_weight.shape[1])

    def step(self, values: Array, output: Array, cell: Array) -> Memory:
        """Return the new output and cell, shape (n, hidden), for inputs of shape (n, inputs)."""
        gates = values @ self.input_weight.T + output @ self.hidden_weight.T + self.bias
        inward, forget, candidate, outward = np.split(gates, 4, axis=1)
        new = _sigmoid(forget) * cell + _sigmoid(inward) * np.tanh(candidate)
        return _sigmoid(outward) * np.tanh(new), new


def _sigmoid(values: Array) -> Array:
    # by the hyperbolic tangent, which cannot overflow
    half = np.float32(0.5)
    found: Array = half * np.tanh(half * values) + half
    return found


@dataclass(frozen=True, kw_only=True)
class RecurrentNetwork(Perceptron):
    """Layers of LSTM whose last output goes through a perceptron.

    Attributes
    ----------
    cells
        The layers of LSTM, the first one takes the observation. The other attributes are those of
        the perceptron.
    """

    cells: Sequence[Cell]

    def __post_init__(self) -> None:
        """Check that the layers fit together and are finite."""
        super().__post_init__()
        if not self.cells:
            raise PolicyError("a recurrent network needs at least one layer of LSTM")
        size = None
        for index, cell in enumerate(self.cells):
            rows = 4 * cell.hidden
            if (
                cell.hidden_weight.shape[0] != rows
                or cell.input_weight.shape[0] != rows
                or cell.bias.shape != (rows,)
            ):
                raise PolicyError(
                    f"LSTM {index}: weights {cell.input_weight.shape} and "
                    f"{cell.hidden_weight.shape} and bias {cell.bias.shape} do not fit"
                )
            if size is not None and (cell.inputs, cell.hidden) != (size, size):
                raise PolicyError(
                    f"LSTM {index} takes {cell.inputs} inputs to {cell.hidden} units, but the one "
                    f"before has {size}: all must have as many"
                )
            arrays = (cell.input_weight, cell.hidden_weight, cell.bias)
            if not all(np.isfinite(array).all() for array in arrays):
                raise PolicyError(f"LSTM {index} holds values that are not finite")
            size = cell.hidden
        if self.weights[0].shape[1] != size:
            raise PolicyError(
                f"layer 0 takes {self.weights[0].shape[1]} inputs, but the LSTM gives {size}"
            )

    @property
    def inputs(self) -> int:
        """Number of observation entries."""
        return self.cells[0].inputs

    def engine(self) -> drm_env.Network:
        """Refuse: the engine's networks have no memory.

        Raises
        ------
        PolicyError
            Always; the message says how it flies.
        """
        raise PolicyError(
            "the engine flies no recurrent network: drm evaluate, compare and benchmark ask it in "
            "Python"
        )

    def __call__(self, observations: ArrayLike) -> Array:
        """Return the actions at the start of an episode, shape (n, outputs); see :meth:`step`."""
        values = np.asarray(observations, dtype=np.float32)
        return self.step(values, self.at_rest(values.shape[0]))[0]

    def at_rest(self, count: int) -> Memory:
        """Return the memory of ``count`` episodes that begin: zeros."""
        shape = (len(self.cells), count, self.cells[0].hidden)
        return np.zeros(shape, np.float32), np.zeros(shape, np.float32)

    def step(self, observations: Array, memory: Memory) -> tuple[Array, Memory]:
        """Return actions in [-1, 1], shape (n, outputs), and the new memory.

        Parameters
        ----------
        observations
            Shape (n, inputs), float32.
        memory
            Of these n episodes.
        """
        values, outputs, cells = observations, [], []
        for cell, output, kept in zip(self.cells, *memory, strict=True):
            values, new = cell.step(values, output, kept)
            outputs.append(values)
            cells.append(new)
        return super().__call__(values), (np.stack(outputs), np.stack(cells))


class RecurrentPolicy(NetworkPolicy):
    """A trained recurrent network behind the ``predict`` call of Stable-Baselines3.

    It remembers nothing itself: ``predict`` returns the memory, and takes it back at the next
    decision.
    """

    network: RecurrentNetwork

    def __init__(self, network: RecurrentNetwork, description: Mapping[str, Any]) -> None:
        super().__init__(network, description)

    def predict(
        self,
        observation: ArrayLike,
        state: tuple[NDArray[Any], ...] | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, tuple[NDArray[Any], ...] | None]:
        """Return the mean action for one observation ``(d,)`` or a batch ``(n, d)``.

        Parameters
        ----------
        observation
            As the environment gives it.
        state
            What the last call returned: output and cell of the LSTM, each of shape
            ``(layers, n, hidden units)``; ``None`` where all episodes begin.
        episode_start
            Booleans of shape ``(n,)``: where one holds, the memory is emptied before. ``None``:
            nowhere.
        deterministic
            Must be true.

        Raises
        ------
        PolicyError
            Wrong shapes, values that are not finite, or a random action was asked for.

        Warns
        -----
        PolicyWarning
            Once, of observations that the environment it was trained in cannot give.
        """
        batch = self._batch_of(observation, deterministic)
        count = len(batch)
        memory = self.network.at_rest(count)
        if state is not None:
            given = tuple(np.asarray(part, dtype=np.float32) for part in state)
            if len(given) != 2 or any(part.shape != memory[0].shape for part in given):
                raise PolicyError(
                    f"state must be two arrays of shape {memory[0].shape}, got "
                    f"{[part.shape for part in given]}"
                )
            if not all(np.isfinite(part).all() for part in given):
                raise PolicyError("state holds values that are not finite")
            starts = np.zeros(count, np.bool_) if episode_start is None else episode_start
            going = ~np.asarray(starts, dtype=np.bool_).reshape(-1)
            if going.shape != (count,):
                raise PolicyError(f"episode_start must have shape ({count},), got {going.shape}")
            memory = given[0] * going[:, None], given[1] * going[:, None]
        actions, memory = self.network.step(batch, memory)
        return (actions[0] if np.ndim(observation) == 1 else actions), memory
