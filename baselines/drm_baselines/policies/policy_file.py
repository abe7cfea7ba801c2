"""A learned policy as numbers: a multilayer perceptron, or one behind layers of LSTM, in NumPy.

Weights travel as a ``safetensors`` file, which can hold nothing but arrays, beside a JSON
description (layers, activation, environment id and configuration, observation layout, training
record, digest of the weights). Nothing is unpickled and no torch is needed to fly a policy, so
that a file from elsewhere can do no more than steer badly.

A policy is published by one rename, that of its description. The new weights are there before,
under a name that holds their digest, and take the place of the old ones after; whoever reads, or
comes after a process that was killed in between, finds the weights of the description that is
there.

Both files are checked before an array is made of them: ordinary files of at most
:data:`MAX_WEIGHTS_BYTES` and :data:`MAX_DESCRIPTION_BYTES`, a description of the expected form, and
weights that are exactly the float32 arrays it announces, with the digest it states.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import re
import stat
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.errors import PolicyError, RunError, WriteError
from drm_baselines.policies.perceptron import ACTIVATIONS, OUTPUTS, Array, NetworkPolicy, Perceptron
from drm_baselines.policies.recurrent import Cell, RecurrentNetwork, RecurrentPolicy
from drm_baselines.support import storage
from drm_baselines.support.reading import parse_json, shown

WEIGHTS_FILE = "policy.safetensors"
DESCRIPTION_FILE = "policy.json"
FORMAT = "drm-policy"
FORMAT_VERSION = 1

MAX_WEIGHTS_BYTES = 64 << 20
"""Largest weights file that is read: 64 MiB."""
MAX_DESCRIPTION_BYTES = 4 << 20
"""Largest description that is read: 4 MiB."""
MAX_LAYERS = 16
"""Most layers of an exported policy."""
MAX_LAYER_SIZE = 4096
"""Most inputs or outputs of a layer of an exported policy."""
MAX_CELLS = 4
"""Most layers of LSTM of an exported policy."""
MAX_HIDDEN = 1024
"""Most hidden units of a layer of LSTM of an exported policy."""

_COMING = re.compile(r"policy-[0-9a-f]{16}\.safetensors")
_READS = 5  # of a policy that is renewed while it is read
_MAX_HEADER_BYTES = 64 << 10  # of the weights: 32 arrays with short names


_CELL = ("input_weight", "hidden_weight", "bias")
"""Arrays of a layer of LSTM."""


class _StrangeWeightsError(RunError):
    """Weights that are not those of the description."""


def save_policy(
    directory: Path, network: Perceptron, description: Mapping[str, Any], *, overwrite: bool = True
) -> list[Path]:
    """Write ``policy.safetensors`` and ``policy.json`` into ``directory``; return both paths.

    ``description`` must hold ``env_id``, ``config``, ``control_period`` (s) and
    ``observation_layout``; format, layers and the weights' digest are added.

    Raises
    ------
    PolicyError
        A network that :func:`load_policy` would refuse for its size; nothing has been written.
    """
    from safetensors.numpy import save

    layers = [list(weight.shape) for weight in network.weights]
    if wrong := _misfit_of(layers):
        raise PolicyError(f"the network cannot be exported: {wrong}")
    arrays: dict[str, NDArray[Any]] = {}
    for index, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        arrays[f"layers.{index}.weight"] = np.ascontiguousarray(weight, dtype=np.float32)
        arrays[f"layers.{index}.bias"] = np.ascontiguousarray(bias, dtype=np.float32)
    recurrent: dict[str, Any] = {}
    if isinstance(network, RecurrentNetwork):
        recurrent["recurrent"] = [[cell.hidden, cell.inputs] for cell in network.cells]
        if wrong := _misfit_of_cells(recurrent["recurrent"]):
            raise PolicyError(f"the network cannot be exported: {wrong}")
        for index, cell in enumerate(network.cells):
            for part in _CELL:
                arrays[f"recurrent.{index}.{part}"] = np.ascontiguousarray(
                    getattr(cell, part), dtype=np.float32
                )
    packed = save(arrays)
    digest = hashlib.sha256(packed).hexdigest()
    weights, published = directory / WEIGHTS_FILE, directory / DESCRIPTION_FILE
    if not overwrite:
        for path in (weights, published):
            if path.exists():
                storage.refuse(path)
    coming = _coming(directory, digest)
    there = coming.exists()
    with storage.atomic_path(coming, overwrite=True) as temporary:
        # not by its own writer, whose errors (a full disk) are of a class of their own
        temporary.write_bytes(packed)
    content = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        **recurrent,
        "layers": layers,
        "activation": network.activation,
        "output": network.output,
        "weights_file": WEIGHTS_FILE,
        "weights_sha256": digest,
        **description,
    }
    try:
        storage.write_json(published, content, overwrite=overwrite)
    except WriteError:
        if not there:
            coming.unlink(missing_ok=True)
        raise
    with storage.writing(weights):
        coming.replace(weights)
    for left in directory.iterdir():
        # of a process that was killed before this step: nobody describes them any more
        if _COMING.fullmatch(left.name):
            left.unlink(missing_ok=True)
    return [weights, published]


def remove_policy(directory: Path) -> None:
    """Remove the policy of a run that is begun anew, if there is one."""
    (directory / DESCRIPTION_FILE).unlink(missing_ok=True)
    (directory / WEIGHTS_FILE).unlink(missing_ok=True)
    if directory.is_dir():
        for left in directory.iterdir():
            if _COMING.fullmatch(left.name):
                left.unlink(missing_ok=True)


def _coming(directory: Path, digest: str) -> Path:
    """Return where weights wait until the description that names them is there."""
    return directory / f"policy-{digest[:16]}.safetensors"


def _read_file(path: Path, limit: int) -> bytes:
    """Return the bytes of an ordinary file of at most ``limit`` bytes.

    Raises
    ------
    RunError
        A link, a directory, a pipe, a larger file, or one that cannot be read.
    """
    # neither follow a link that took the file's place nor wait for somebody to fill a pipe
    flags = os.O_RDONLY
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY"):
        flags |= getattr(os, name, 0)
    try:
        if not stat.S_ISREG(path.lstat().st_mode):
            raise RunError(f"{path} is not an ordinary file (links are not followed)")
        with os.fdopen(os.open(path, flags), "rb") as stream:
            status = os.fstat(stream.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise RunError(f"{path} is not an ordinary file (links are not followed)")
            if status.st_size > limit:
                raise RunError(f"{path} has {status.st_size} bytes; at most {limit} are read")
            content = stream.read(limit + 1)
    except OSError as error:
        raise RunError(f"{path} cannot be read: {error}") from error
    if len(content) > limit:
        raise RunError(f"{path} has more than the {limit} bytes that are read")
    return content


def _parse_object(content: bytes, what: str) -> dict[str, Any]:
    """Return the JSON object in ``content``: not nested deeply, names unique, numbers finite.

    Raises
    ------
    RunError
        Anything else; the message begins with ``what``.
    """
    try:
        found = parse_json(content.decode("utf-8"))
    except ValueError as error:
        raise RunError(f"{what} cannot be read: {error}") from error
    if not isinstance(found, dict):
        raise RunError(f"{what} is not a JSON object, but {shown(found)}")
    return found


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return math.isfinite(value) if isinstance(value, float) else abs(value) < 2**53


def _is_entry(value: Any) -> bool:
    """Whether a value is name, unit, scale, low and high of an observation's entry."""
    return (
        isinstance(value, list)
        and len(value) == 5
        and all(isinstance(text, str) for text in value[:2])
        and _is_number(value[2])
        and all(bound is None or _is_number(bound) for bound in value[3:])
    )


def _misfit_of(layers: Any) -> str | None:
    """Return what is wrong with the (outputs, inputs) of layers, if anything."""
    if not isinstance(layers, list) or not 1 <= len(layers) <= MAX_LAYERS:
        return f"layers must be a list of 1 to {MAX_LAYERS} layer sizes, got {shown(layers)}"
    before: int | None = None
    for index, layer in enumerate(layers):
        if not isinstance(layer, list) or len(layer) != 2:
            return f"layers[{index}] must be outputs and inputs, got {shown(layer)}"
        for size in layer:
            if type(size) is not int or not 1 <= size <= MAX_LAYER_SIZE:
                return (
                    f"layers[{index}] must be layer sizes from 1 to {MAX_LAYER_SIZE}, "
                    f"got {shown(layer)}"
                )
        if before is not None and layer[1] != before:
            return f"layer sizes do not fit: layers[{index}] takes {layer[1]} of {before} inputs"
        before = layer[0]
    return None


def _misfit_of_cells(cells: Any) -> str | None:
    """Return what is wrong with the (hidden units, inputs) of layers of LSTM, if anything."""
    if not isinstance(cells, list) or not 1 <= len(cells) <= MAX_CELLS:
        return f"recurrent must be a list of 1 to {MAX_CELLS} sizes, got {shown(cells)}"
    for index, cell in enumerate(cells):
        if not isinstance(cell, list) or len(cell) != 2:
            return f"recurrent[{index}] must be hidden units and inputs, got {shown(cell)}"
        for size, most in zip(cell, (MAX_HIDDEN, MAX_LAYER_SIZE), strict=True):
            if type(size) is not int or not 1 <= size <= most:
                return f"recurrent[{index}] must be sizes from 1 to {most}, got {shown(cell)}"
        if index and cell != [cells[0][0]] * 2:
            return (
                f"recurrent[{index}] must be {[cells[0][0]] * 2}, as the first has "
                f"{cells[0][0]} units, got {shown(cell)}"
            )
    return None


def _one_of(names: Sequence[str]) -> tuple[str, Callable[[Any], bool]]:
    return f"one of {', '.join(names)}", lambda value: isinstance(value, str) and value in names


_FIELDS: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "activation": _one_of(sorted(ACTIVATIONS)),
    "output": _one_of(OUTPUTS),
    "weights_sha256": (
        "64 hexadecimal digits",
        lambda value: isinstance(value, str) and re.fullmatch("[0-9a-f]{64}", value) is not None,
    ),
    "env_id": ("text", lambda value: isinstance(value, str)),
    "config": ("an object", lambda value: isinstance(value, dict)),
    "control_period": ("a positive number", lambda value: _is_number(value) and value > 0),
    "observation_layout": (
        "a list of [name, unit, scale, low, high]",
        lambda value: isinstance(value, list) and all(map(_is_entry, value)),
    ),
}
"""What each field of a description must be, besides ``layers``."""


def _read_description(path: Path) -> dict[str, Any]:
    """Return the checked content of a description.

    Raises
    ------
    RunError
        Not a description, or one whose fields are missing, of the wrong type or at odds.
    """
    content = _parse_object(_read_file(path, MAX_DESCRIPTION_BYTES), str(path))
    if content.get("format") != FORMAT:
        raise RunError(f"{path} does not describe a policy (format {FORMAT!r})")
    version = content.get("format_version")
    if type(version) is not int or version != FORMAT_VERSION:
        raise RunError(
            f"{path} has format version {shown(version)}; this version of drm-baselines "
            f"reads {FORMAT_VERSION}"
        )
    missing = [name for name in ("layers", *_FIELDS) if name not in content]
    if missing:
        raise RunError(f"{path} lacks {', '.join(missing)}")
    for name, (form, fits) in _FIELDS.items():
        if not fits(content[name]):
            raise RunError(f"{path}: {name} must be {form}, got {shown(content[name])}")
    if wrong := _misfit_of(content["layers"]):
        raise RunError(f"{path}: {wrong}")
    if content.get("weights_file", WEIGHTS_FILE) != WEIGHTS_FILE:
        raise RunError(
            f"{path}: weights_file must be {WEIGHTS_FILE}, got {shown(content['weights_file'])}"
        )
    inputs = content["layers"][0][1]
    if "recurrent" in content:
        if wrong := _misfit_of_cells(content["recurrent"]):
            raise RunError(f"{path}: {wrong}")
        if content["recurrent"][0][0] != inputs:
            raise RunError(
                f"{path}: layers[0] takes {inputs} inputs, but recurrent gives "
                f"{content['recurrent'][0][0]}"
            )
        inputs = content["recurrent"][0][1]
    entries = len(content["observation_layout"])
    if entries != inputs:
        raise RunError(
            f"{path}: observation_layout has {entries} entries, but the network takes {inputs}: "
            "it is not the one the policy was trained on"
        )
    return content


def _shapes_of(description: Mapping[str, Any]) -> dict[str, list[int]]:
    """Return the shape of each array of the weights by name."""
    shapes = {}
    for index, (hidden, inputs) in enumerate(description.get("recurrent", ())):
        parts = ([4 * hidden, inputs], [4 * hidden, hidden], [4 * hidden])
        for part, shape in zip(_CELL, parts, strict=True):
            shapes[f"recurrent.{index}.{part}"] = shape
    for index, (outputs, inputs) in enumerate(description["layers"]):
        shapes[f"layers.{index}.weight"] = [outputs, inputs]
        shapes[f"layers.{index}.bias"] = [outputs]
    return shapes


def _check_header(content: bytes, shapes: Mapping[str, list[int]], path: Path) -> None:
    """Refuse weights that are not exactly float32 arrays of these shapes, from their header alone.

    Raises
    ------
    RunError
        Other arrays, or no header.
    """
    length = int.from_bytes(content[:8], "little")
    if len(content) < 8 + length or length > _MAX_HEADER_BYTES:
        raise RunError(f"{path} cannot be read: it has no header of safetensors")
    header = _parse_object(content[8 : 8 + length], f"header of {path}")
    header.pop("__metadata__", None)
    for verb, names in (("lacks", shapes.keys() - header), ("also holds", header.keys() - shapes)):
        if names:
            raise RunError(f"{path} {verb} the array {shown(min(names))}")
    for name, shape in shapes.items():
        entry = header[name]
        dtype, found = (
            (entry.get("dtype"), entry.get("shape")) if isinstance(entry, dict) else (None, None)
        )
        if dtype != "F32":
            raise RunError(f"{path}: {name} must hold float32 (F32), got {shown(dtype)}")
        if found != shape:
            raise RunError(
                f"{path} has other layer sizes than {DESCRIPTION_FILE} says: {name} has shape "
                f"{shown(found)} instead of {shape}"
            )
    size = 4 * sum(math.prod(shape) for shape in shapes.values())
    if len(content) != 8 + length + size:
        raise RunError(
            f"{path} cannot be read: {len(content) - 8 - length} bytes of weights instead of {size}"
        )


def _read_weights(path: Path, description: Mapping[str, Any]) -> dict[str, Array]:
    """Return the arrays that a checked description announces.

    Raises
    ------
    RunError
        Damaged weights, those of another description, or values that are not finite.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    expected = description["weights_sha256"]
    coming = _coming(path.parent, expected)
    content = b""
    if os.path.lexists(coming):  # only between two renames; it may be gone by now
        with contextlib.suppress(RunError):
            content = _read_file(coming, MAX_WEIGHTS_BYTES)
    if hashlib.sha256(content).hexdigest() != expected:
        content = _read_file(path, MAX_WEIGHTS_BYTES)
    digest = hashlib.sha256(content).hexdigest()
    if digest != expected:
        raise _StrangeWeightsError(
            f"{path} does not belong to {DESCRIPTION_FILE}: SHA-256 {digest} instead of {expected}"
        )
    shapes = _shapes_of(description)
    _check_header(content, shapes, path)
    try:
        arrays = load(content)
    except (SafetensorError, ValueError) as error:
        raise RunError(f"{path} cannot be read: {error}") from error
    for name, shape in shapes.items():
        array = arrays.get(name)
        if array is None or array.dtype != np.float32 or list(array.shape) != shape:
            raise RunError(f"{path} cannot be read: its header is ambiguous about {name}")
        if not np.isfinite(array).all():
            raise RunError(f"{path}: {name} holds values that are not finite")
    return arrays


def load_policy(directory: str | Path) -> NetworkPolicy:
    """Load the exported policy of a run directory, from safetensors and JSON only.

    A network with a memory is a :class:`drm_baselines.policies.recurrent.RecurrentPolicy`.

    Raises
    ------
    RunError
        No such directory, no exported policy, or files that are damaged, too large, links, or do
        not belong together. The message names file and reason; no network has been made.

    Examples
    --------
    >>> from drm_baselines import load_policy
    >>> from drm_baselines.policies import shipped_policy
    >>> policy = load_policy(shipped_policy())
    >>> policy.env_id, policy.control_period
    ('drm_env/SlewResidual-v0', 0.02)
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise RunError(f"no run directory {folder}")
    path, weights = folder / DESCRIPTION_FILE, folder / WEIGHTS_FILE
    for needed in (path, weights):
        if not os.path.lexists(needed) and not (
            needed == weights and any(_COMING.fullmatch(each.name) for each in folder.iterdir())
        ):
            raise RunError(
                f"{folder} holds no {needed.name}: it is not the directory of a "
                "training run, or the run has not saved a policy yet"
            )
    for left in reversed(range(_READS)):
        description = _read_description(path)
        try:
            arrays = _read_weights(weights, description)
            break
        except _StrangeWeightsError:
            # unless a new policy was published between the two files
            if left == 0 or _read_description(path) == description:
                raise
    count = len(description["layers"])
    parts: dict[str, Any] = {
        "weights": [arrays[f"layers.{index}.weight"] for index in range(count)],
        "biases": [arrays[f"layers.{index}.bias"] for index in range(count)],
        "activation": description["activation"],
        "output": description["output"],
    }
    if "recurrent" not in description:
        return NetworkPolicy(Perceptron(**parts), description)
    cells = [
        Cell(**{part: arrays[f"recurrent.{index}.{part}"] for part in _CELL})
        for index in range(len(description["recurrent"]))
    ]
    return RecurrentPolicy(RecurrentNetwork(**parts, cells=cells), description)
