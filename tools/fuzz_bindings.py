"""Feed the Python side with bytes: arrays in any layout, and files and snapshots that were damaged.

A target takes any bytes and fails if anything but the package's own error comes out, or if an array
is flown as other numbers than those in it. With Atheris installed (``pip install atheris``; Linux)
libFuzzer makes the bytes up:

    python tools/fuzz_bindings.py arrays -max_total_time=600
    python tools/fuzz_bindings.py files -max_total_time=600

``tests/test_fuzz_bindings.py`` gives the same functions the kept corpora and bytes at random.
"""

from __future__ import annotations

import contextlib
import importlib
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.benchmark.records import Record, read_record, write_record
from drm_baselines.errors import BaselineError
from drm_baselines.policies.perceptron import Perceptron
from drm_baselines.policies.policy_file import load_policy, save_policy
from drm_baselines.policies.registry import shipped_policy
from drm_baselines.support import storage

LANES = 3
"""Environments in the batch that arrays are given to."""


class Bytes:
    """Numbers that are read from bytes one after the other; zeros when there are no more."""

    def __init__(self, data: bytes) -> None:
        """Begins at the first byte."""
        self._data = data
        self._at = 0

    def byte(self, below: int = 256) -> int:
        """Return a number from 0 to below ``below``."""
        value = self._data[self._at] if self._at < len(self._data) else 0
        self._at += 1
        return value % below

    def pick(self, choices: Any) -> Any:
        """Return one of a sequence."""
        return choices[self.byte(len(choices))]

    def take(self, count: int) -> bytes:
        """Return so many bytes."""
        found = self._data[self._at : self._at + count]
        self._at += count
        return found.ljust(count, b"\0")

    def rest(self) -> bytes:
        """Return what is left."""
        return self._data[self._at :]


DTYPES = (
    "f4", "f4", "f8", "f2", "i1", "i2", "i4", "i8", "u1", "u2", "u8", "g", "?", "c8", "c16", "S3",
    "U2", "O", "M8[s]", "m8[ms]", "V5",
)  # fmt: skip
"""Types of entries: numbers, and what is none."""


def array_of(given: Bytes, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return an array whose type, memory and entries follow from bytes, mostly of a shape."""
    kind = np.dtype(given.pick(DTYPES)).newbyteorder(given.pick("<>="))
    odd = given.byte()
    if odd < 24:
        sizes = tuple(given.byte(5) for _ in range(given.byte(4)))
    elif odd < 48:
        sizes = (given.pick((0, 1, shape[0] + 1)), *shape[1:])
    else:
        sizes = shape
    count = int(np.prod(sizes))
    if kind.kind in "OSUVMm":
        values = np.zeros(sizes, kind)
    elif given.byte(4) and kind.kind == "f":
        numbers = np.frombuffer(given.take(count), np.int8).astype(float) / 100.0
        values = numbers.astype(kind).reshape(sizes)
    else:
        raw = given.take(count * kind.itemsize)
        if kind.kind == "b":
            raw = bytes(byte & 1 for byte in raw)
        values = np.frombuffer(raw, kind).reshape(sizes)
    layout = given.byte(6)
    if layout == 1:
        values = np.asfortranarray(values)
    elif layout == 2 and values.ndim:
        values = values[::-1].copy()[::-1]
    elif layout == 3 and kind.kind != "O":
        memory = np.zeros(values.nbytes + 8, np.uint8)
        offset = 1 + given.byte(7)
        moved = np.ndarray(values.shape, kind, buffer=memory.data, offset=offset)
        moved[...] = values
        values = moved
    elif layout == 4 and values.ndim:
        steps = tuple(1 + given.byte(3) for _ in values.shape)
        wide = np.zeros(tuple(n * s for n, s in zip(values.shape, steps, strict=True)), kind)
        sparse = wide[tuple(slice(None, None, step) for step in steps)]
        sparse[...] = values
        values = sparse
    elif layout == 5 and values.shape[:1] > (0,):
        values = np.broadcast_to(values[:1], values.shape)
    if given.byte(2) and values.flags.writeable:
        values.flags.writeable = False
    return values


def numbers_in(array: NDArray[Any]) -> NDArray[np.float32] | None:
    """Return the numbers in an array, limited as actions are; none if some are not finite."""
    if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        return None
    return np.array(np.clip(array, -1.0, 1.0), np.float32, order="C")


@cache
def machinery() -> tuple[Any, Any, Any, Any, Any]:
    """Return what arrays are given to, made once."""
    warnings.simplefilter("ignore")
    env = drm_env.DrmEnv(horizon=0.4)
    batch = drm_env.DrmVectorEnv(LANES, horizon=0.4)
    reference = drm_env.DrmVectorEnv(LANES, horizon=0.4)
    rng = np.random.default_rng(0)
    network = drm_env.Network([(rng.normal(size=(4, 6)), np.zeros(4))])
    law = drm_env.ControlLaw("lyapunov", control_period=0.002)
    return env, batch, reference, network, law


def arrays(data: bytes) -> None:
    """Arrays in any layout, as actions, observations, torques and weights."""
    given = Bytes(data)
    env, batch, reference, network, law = machinery()
    door = given.byte(6)
    if door == 0:
        _steps(batch, reference, given)
    elif door == 1:
        env.reset(seed=given.byte())
        array = array_of(given, (2,))
        before, numbers = env.get_state(), numbers_in(array)
        try:
            seen, reward, *_ = env.step(array)
        except drm_env.DrmError:
            assert env.get_state() == before
            assert numbers is None or array.shape != (2,)
            return
        assert numbers is not None and array.shape == (2,)
        assert np.isfinite(seen).all() and np.isfinite(reward)
    elif door == 2:
        array = array_of(given, (2, 6))
        try:
            actions = network(array)
        except (drm_env.DrmError, TypeError, ValueError):
            return
        numbers = np.atleast_2d(np.array(array).astype(np.float32))
        wanted = network(numbers.copy())
        assert np.atleast_2d(actions).tobytes() == wanted.tobytes()
    elif door == 3:
        columns = len(law.MEASUREMENTS)
        parts = [
            array_of(given, shape) for shape in ((2, columns), law.initial_state(2).shape, (2,))
        ]
        try:
            torques, state = law.torques(*parts)
        except (drm_env.DrmError, TypeError, ValueError):
            return
        assert torques.shape == (len(state), 2)
    elif door == 4:
        torques = array_of(given, (1, 3, 2))
        try:
            flown = drm_env.rollout([{"horizon": 0.1}], torques=torques, hold=1 + given.byte(4))
        except (drm_env.DrmError, TypeError, ValueError):
            return
        assert flown["duration"].shape == (1,)
    else:
        layers = [
            (array_of(given, (3, 2)), array_of(given, (3,))) for _ in range(1 + given.byte(2))
        ]
        try:
            made = drm_env.Network(layers, given.pick(("tanh", "relu", "x")), "clip")
        except drm_env.DrmError:
            return
        actions = made(np.zeros((2, made.inputs)))
        assert (np.abs(actions) <= 1.0).all()


def _steps(batch: Any, reference: Any, given: Bytes) -> None:
    seed = given.byte()
    batch.reset(seed=seed)
    reference.reset(seed=seed)
    for _ in range(3):
        array = array_of(given, (LANES, 2))
        before, numbers = batch.get_state(), numbers_in(array)
        kept = array.tobytes() if array.dtype != object else b""
        try:
            flown = batch.step(array)
        except drm_env.DrmError:
            assert batch.get_state() == before
            assert numbers is None or array.shape != (LANES, 2)
            return
        assert numbers is not None and array.shape == (LANES, 2)
        assert array.dtype == object or array.tobytes() == kept
        wanted = reference.step(numbers)
        assert flown[0].tobytes() == wanted[0].tobytes()
        assert flown[1].tobytes() == wanted[1].tobytes()


@cache
def sound_files() -> dict[str, bytes]:
    """Return files as the package writes them, by the names in their folders."""
    found: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        policy = load_policy(shipped_policy())
        rng = np.random.default_rng(0)
        small = Perceptron(
            weights=[rng.normal(size=(2, policy.network.inputs)).astype(np.float32)],
            biases=[np.zeros(2, np.float32)], activation="tanh", output="clip",
        )  # fmt: skip
        save_policy(folder, small, policy.description)
        write_record(
            folder / "record.parquet",
            Record(
                policy="linear", title="linear", kind="law", knows="nothing", control_period=0.002,
                seeds=[0], episodes=np.arange(20), strata=["a"] * 20,
                metrics={"tip_error_rms": rng.random((1, 20))},
            ),
        )  # fmt: skip
        storage.save_arrays(folder / "plan.npz", {"x": np.ones(9), "y": rng.random((3, 2))}, "d")
        for path in folder.iterdir():
            if path.is_file():
                found[path.name] = path.read_bytes()
    env, batch, *_ = machinery()
    env.reset(seed=1)
    batch.reset(seed=1)
    found["single.snapshot"] = env.get_state()
    found["batch.snapshot"] = batch.get_state()
    return found


READERS: dict[str, Callable[[Path], Any]] = {
    "policy.json": lambda path: load_policy(path.parent),
    "policy.safetensors": lambda path: load_policy(path.parent),
    "record.parquet": read_record,
    "plan.npz": lambda path: storage.load_arrays(path, "d"),
}
"""Who reads which file."""


def damaged(whole: bytes, given: Bytes) -> bytes:
    """Return bytes with some damage that other bytes describe."""
    found = bytearray(whole)
    for _ in range(1 + given.byte(4)):
        if not found:
            break
        at = int.from_bytes(given.take(3), "little") % len(found)
        kind = given.byte(6)
        if kind == 0:
            found[at] ^= 1 << given.byte(8)
        elif kind == 1:
            found[at] = given.byte()
        elif kind == 2:
            del found[at:]
        elif kind == 3:
            found[at:at] = given.take(1 + given.byte(8))
        elif kind == 4:
            del found[at : at + 1 + given.byte(16)]
        else:
            word = given.take(8)
            found[at : at + 8] = word[: len(found[at : at + 8])]
    return bytes(found)


def files(data: bytes) -> None:
    """Files and snapshots that were damaged, or are something else altogether."""
    given = Bytes(data)
    name = given.pick(sorted(sound_files()))
    content = given.rest() if given.byte(8) == 0 else damaged(sound_files()[name], given)
    env, batch, *_ = machinery()
    if name.endswith(".snapshot"):
        who = env if name.startswith("single") else batch
        who.reset(seed=2)
        before = who.get_state()
        try:
            who.set_state(content)
        except drm_env.DrmError:
            assert who.get_state() == before
        else:
            assert who.get_state() is not None
        return
    with tempfile.TemporaryDirectory(prefix="drm-fuzz-") as folder:
        for other in ("policy.json", "policy.safetensors"):
            (Path(folder) / other).write_bytes(sound_files()[other])
        path = Path(folder) / name
        path.write_bytes(content)
        if name not in READERS:
            return
        with contextlib.suppress(BaselineError, drm_env.DrmError):
            READERS[name](path)


TARGETS: dict[str, Callable[[bytes], None]] = {"arrays": arrays, "files": files}
"""What can be fuzzed, by name."""


def main() -> None:
    """Hand a target to Atheris."""
    atheris: Any = importlib.import_module("atheris")

    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in TARGETS:
        sys.exit(f"give one of {', '.join(TARGETS)}, then libFuzzer's arguments")
    machinery()
    sound_files()
    # which branches were taken is what the fuzzer goes by
    readers = (load_policy, read_record, storage.load_arrays)
    for function in (*TARGETS.values(), _steps, array_of, damaged, *readers):
        atheris.instrument_func(function)
    # inputs of full length from the beginning: short ones are mostly zeros
    atheris.Setup([sys.argv[0], "-len_control=0", "-max_len=600", *sys.argv[2:]], TARGETS[name])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
