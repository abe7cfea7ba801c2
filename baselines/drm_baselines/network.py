"""A learned policy as numbers: a multilayer perceptron that runs on numpy alone.

Weights travel as a ``safetensors`` file, which can hold nothing but arrays, beside a JSON
description (layers, activation, environment id and configuration, observation layout, training
record, digest of the weights). Nothing is unpickled and no torch is needed to fly a policy, so
that a file from elsewhere can do no more than steer badly.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import drm_env
from drm_baselines import storage
from drm_baselines.errors import PolicyError, RunError

WEIGHTS_FILE = "policy.safetensors"
DESCRIPTION_FILE = "policy.json"
FORMAT = "drm-policy"
FORMAT_VERSION = 1

_Array = NDArray[np.float32]


def _relu(values: _Array) -> _Array:
    return np.maximum(values, np.float32(0.0))


_ACTIVATIONS: dict[str, Callable[[_Array], _Array]] = {"tanh": np.tanh, "relu": _relu}
_OUTPUTS = ("clip", "tanh")


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

    weights: Sequence[_Array]
    biases: Sequence[_Array]
    activation: str
    output: str

    def __post_init__(self) -> None:
        """Check that the layers fit together and are finite."""
        if self.activation not in _ACTIVATIONS:
            raise PolicyError(
                f"activation must be one of {sorted(_ACTIVATIONS)}, got {self.activation!r}"
            )
        if self.output not in _OUTPUTS:
            raise PolicyError(f"output must be one of {list(_OUTPUTS)}, got {self.output!r}")
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

    def __call__(self, observations: ArrayLike) -> _Array:
        """Return actions in [-1, 1], shape ``(n, outputs)``, for ``(n, inputs)`` observations."""
        activation = _ACTIVATIONS[self.activation]
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
    and ``config`` are the environment it was trained in.
    """

    def __init__(self, network: Perceptron, description: Mapping[str, Any]) -> None:
        self.network = network
        self.description = dict(description)
        self.control_period = float(description["control_period"])
        self.env_id = str(description["env_id"])
        self.config: dict[str, Any] = dict(description["config"])
        self.name = "learned"

    def predict(
        self,
        observation: ArrayLike,
        state: tuple[NDArray[np.float64], ...] | None = None,
        episode_start: ArrayLike | None = None,  # noqa: ARG002
        deterministic: bool = True,
    ) -> tuple[_Array, tuple[NDArray[np.float64], ...] | None]:
        """Return the mean action for one observation ``(d,)`` or a batch ``(n, d)``.

        The policy has no memory: ``state`` is handed back, ``episode_start`` is not looked at.

        Raises
        ------
        PolicyError
            Wrong observation size, or a random action was asked for (exported
            policies carry no exploration noise).
        """
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
        actions = self.network(np.atleast_2d(array))
        return (actions[0] if array.ndim == 1 else actions), state


def save_policy(
    directory: Path, network: Perceptron, description: Mapping[str, Any], *, overwrite: bool = True
) -> list[Path]:
    """Write ``policy.safetensors`` and ``policy.json`` into ``directory``; return both paths.

    ``description`` must hold ``env_id``, ``config``, ``control_period`` (s) and
    ``observation_layout``; format, layers and the weights' digest are added.
    """
    from safetensors.numpy import save_file

    arrays: dict[str, NDArray[Any]] = {}
    for index, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        arrays[f"layers.{index}.weight"] = np.ascontiguousarray(weight, dtype=np.float32)
        arrays[f"layers.{index}.bias"] = np.ascontiguousarray(bias, dtype=np.float32)
    weights = directory / WEIGHTS_FILE
    with storage.atomic_path(weights, overwrite=overwrite) as temporary:
        save_file(arrays, temporary)
    content = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "layers": [list(weight.shape) for weight in network.weights],
        "activation": network.activation,
        "output": network.output,
        "weights_file": WEIGHTS_FILE,
        "weights_sha256": storage.sha256_of(weights),
        **description,
    }
    return [weights, storage.write_json(directory / DESCRIPTION_FILE, content, overwrite=overwrite)]


def _read_description(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise RunError(f"{path} cannot be read: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise RunError(f"{path} does not describe a policy (format {FORMAT!r})")
    if content.get("format_version") != FORMAT_VERSION:
        raise RunError(
            f"{path} has format version {content.get('format_version')!r}; this "
            f"version of drm-baselines reads {FORMAT_VERSION}"
        )
    needed = (
        "layers",
        "activation",
        "output",
        "weights_sha256",
        "env_id",
        "config",
        "control_period",
        "observation_layout",
    )
    missing = [name for name in needed if name not in content]
    if missing:
        raise RunError(f"{path} lacks {', '.join(missing)}")
    return content


def load_policy(directory: str | Path) -> NetworkPolicy:
    """Load the exported policy of a run directory, from safetensors and JSON only.

    Raises
    ------
    RunError
        No such directory, no exported policy, or files that are damaged or do not
        belong together.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load_file

    folder = Path(directory)
    if not folder.is_dir():
        raise RunError(f"no run directory {folder}")
    path, weights = folder / DESCRIPTION_FILE, folder / WEIGHTS_FILE
    for needed in (path, weights):
        if not needed.is_file():
            raise RunError(
                f"{folder} holds no {needed.name}: it is not the directory of a "
                "training run, or the run has not saved a policy yet"
            )
    description = _read_description(path)
    digest = storage.sha256_of(weights)
    if digest != description["weights_sha256"]:
        raise RunError(
            f"{weights} does not belong to {path.name}: SHA-256 {digest} instead of "
            f"{description['weights_sha256']}"
        )
    try:
        arrays = load_file(weights)
    except (SafetensorError, OSError) as error:
        raise RunError(f"{weights} cannot be read: {error}") from error
    try:
        count = len(description["layers"])
        network = Perceptron(
            weights=[arrays[f"layers.{index}.weight"] for index in range(count)],
            biases=[arrays[f"layers.{index}.bias"] for index in range(count)],
            activation=description["activation"],
            output=description["output"],
        )
    except KeyError as error:
        raise RunError(f"{weights} lacks the array {error}") from error
    if [list(weight.shape) for weight in network.weights] != description["layers"]:
        raise RunError(f"{weights} has other layer sizes than {path.name} says")
    return NetworkPolicy(network, description)
