"""Every entry that takes an array takes any array of its shape, however it lies in memory."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import drm_env
from drm_env import _engine

Array = NDArray[Any]

# Columns of what a law is told and of what it remembers.
MEASURED = len(drm_env.ControlLaw.MEASUREMENTS)
REMEMBERED = drm_env.ControlLaw().initial_state(1).shape[1]


def unaligned(plain: Array) -> Array:
    """Contiguous, a byte beside where its entries would lie."""
    memory = np.zeros(plain.nbytes + 1, np.uint8)
    copy = memory[1:].view(plain.dtype).reshape(plain.shape)
    copy[...] = plain
    assert plain.dtype.alignment == 1 or not copy.size or not copy.flags.aligned
    return copy


def packed(plain: Array) -> Array:
    """A field of packed records."""
    records = np.zeros(plain.shape, np.dtype([("flag", "u1"), ("value", plain.dtype)]))
    records["value"] = plain
    return records["value"]


def byte_swapped(plain: Array) -> Array:
    """Of the other byte order."""
    return plain.astype(plain.dtype.newbyteorder())


def backwards(plain: Array) -> Array:
    """With negative strides."""
    step = (slice(None, None, -1),) * plain.ndim
    return plain[step].copy()[step]


def every_other(plain: Array) -> Array:
    """With gaps between its entries."""
    wide = np.full([2 * size for size in plain.shape], 99).astype(plain.dtype)
    gaps = wide[(slice(None, None, 2),) * plain.ndim]
    gaps[...] = plain
    return gaps


def by_columns(plain: Array) -> Array:
    """In Fortran's order."""
    return np.asfortranarray(plain)


def repeated(plain: Array) -> Array:
    """Whose rows are the same memory."""
    return np.broadcast_to(plain[:1], plain.shape)


def read_only(plain: Array) -> Array:
    """That cannot be written to."""
    copy = plain.copy()
    copy.flags.writeable = False
    return copy


LAYOUTS = [unaligned, packed, byte_swapped, backwards, every_other, by_columns, repeated, read_only]


def single_step(lay: Callable[[Array], Array]) -> Array:
    env = drm_env.DrmEnv()
    env.reset(seed=0)
    return env.step(lay(np.array([0.25, 0.25], np.float32)))[0]


def vector_step(lay: Callable[[Array], Array]) -> Array:
    env = drm_env.DrmVectorEnv(3)
    env.reset(seed=0)
    return env.step(lay(np.tile(np.array([0.25, -0.5], np.float32), (3, 1))))[0]


def stable_baselines_step(lay: Callable[[Array], Array]) -> Array:
    from drm_env.sb3 import DrmSB3VecEnv

    env = DrmSB3VecEnv(3)
    env.seed(0)
    env.reset()
    return env.step(lay(np.tile(np.array([0.25, -0.5], np.float32), (3, 1))))[0]


def given_torques(lay: Callable[[Array], Array]) -> Array:
    torques = lay(np.tile(np.array([30.0, -2.0]), (2, 4, 1)))
    scenarios = [{"horizon": 0.1}] * 2
    flown = drm_env.rollout(scenarios, torques=torques, hold=5, signals=["alpha"])
    return flown.trajectories["alpha"]


def network(lay: Callable[[Array], Array]) -> Array:
    weights, biases = np.full((2, 3), 0.125, np.float32), np.full(2, 0.25, np.float32)
    made = drm_env.Network([(lay(weights), lay(biases))])
    return made(lay(np.full((4, 3), 0.5, np.float32)))


def law(lay: Callable[[Array], Array]) -> Array:
    made = drm_env.ControlLaw("linear")
    measurements = np.tile(np.linspace(0.1, 0.8, MEASURED), (3, 1))
    start = lay(np.array([True, True, True]))
    return np.hstack(made.torques(lay(measurements), lay(np.zeros((3, REMEMBERED))), start))


def partial_reset(lay: Callable[[Array], Array]) -> Array:
    env = drm_env.DrmVectorEnv(3)
    env.reset(seed=0)
    env.step(np.ones((3, 2), np.float32))
    return env.reset(options={"reset_mask": lay(np.array([True, True, True]))})[0]


def lane_options(lay: Callable[[Array], Array]) -> Array:
    env = drm_env.DrmVectorEnv(3, observe_payload="true")
    return env.reset(seed=0, options={"payload_mass": lay(np.full(3, 123.0))})[0]


def acceleration(lay: Callable[[Array], Array]) -> Array:
    q = lay(np.full(3, 0.01))
    return drm_env.Model().acceleration(q, q, 4.0)


def energy(lay: Callable[[Array], Array]) -> Array:
    q = lay(np.full(3, 0.01))
    found = drm_env.Model().energy(q, q, 4.0)
    return np.array([*found, drm_env.Model().angular_momentum(q, q, 4.0)])


ENTRIES = [
    single_step, vector_step, stable_baselines_step, given_torques, network, law, partial_reset,
    lane_options, acceleration, energy,
]  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.__name__)
@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.__name__)
def test_the_layout_of_an_array_does_not_show(
    entry: Callable[[Callable[[Array], Array]], Array], layout: Callable[[Array], Array]
) -> None:
    expected = entry(lambda plain: plain)
    assert entry(layout).tobytes() == expected.tobytes()


@pytest.mark.parametrize("dtype", [np.float16, np.float64, np.longdouble, np.int8, np.uint64])
def test_other_real_numbers_are_converted(dtype: type[np.generic]) -> None:
    env = drm_env.DrmVectorEnv(3)
    env.reset(seed=0)
    reference = drm_env.DrmVectorEnv(3)
    reference.reset(seed=0)
    found = env.step(unaligned(np.ones((3, 2), dtype)))[0]  # type: ignore[type-var]
    assert found.tobytes() == reference.step(np.ones((3, 2), np.float32))[0].tobytes()


@pytest.mark.parametrize("lay", [unaligned, every_other], ids=lambda lay: lay.__name__)
def test_no_rows_are_no_results(lay: Callable[[Array], Array]) -> None:
    made = drm_env.Network([(np.ones((2, 3), np.float32), np.zeros(2, np.float32))])
    assert made(lay(np.zeros((0, 3), np.float32))).shape == (0, 2)
    torques, state = drm_env.ControlLaw("linear").torques(
        lay(np.zeros((0, MEASURED))), lay(np.zeros((0, REMEMBERED))), lay(np.zeros(0, np.bool_))
    )
    assert torques.shape == (0, 2)
    assert state.shape == (0, REMEMBERED)
    flown = drm_env.rollout([{"horizon": 0.1}], torques=lay(np.zeros((1, 0, 2))))
    assert flown["tip_error_rms"].shape == (1,)


def test_what_is_written_to_must_be_contiguous_and_aligned() -> None:
    env = drm_env.DrmVectorEnv(3)
    env.reset(seed=0)
    for lay in (unaligned, every_other):
        with pytest.raises(ValueError, match="C-contiguous, aligned"):
            env._engine.coordinates(lay(np.zeros((3, 6))))


def test_every_byte_but_zero_is_true() -> None:
    bytes_ = np.array([0, 1, 2, 255], np.uint8)
    odd, plain = bytes_.view(np.bool_), bytes_ != 0
    results = []
    for mask in (odd, plain):
        env = drm_env.DrmVectorEnv(4)
        env.reset(seed=0)
        env.step(np.ones((4, 2), np.float32))
        results.append(env.reset(seed=[7, 8, 9, 10], options={"reset_mask": mask})[0])
        made = drm_env.ControlLaw("linear")
        measurements = np.tile(np.linspace(0.1, 0.8, MEASURED), (4, 1))
        results.append(made.torques(measurements, np.ones((4, REMEMBERED)), mask)[0])
    assert results[0].tobytes() == results[2].tobytes()
    assert results[1].tobytes() == results[3].tobytes()


def test_flags_are_zero_or_one_in_arrays_that_held_other_bytes() -> None:
    engine = _engine.Batch(_engine.Config("slew", None, None), 4, "next_step", 1, None)
    size = engine.observation_size
    observations = np.zeros((4, size), np.float32)
    engine.reset([bytes([i]) for i in range(4)], [None] * 4, None, observations)
    flags = [np.full(4, 255, np.uint8).view(np.bool_) for _ in range(2)]
    actions = np.zeros((4, 2), np.float32)
    engine.step(actions, observations, np.zeros(4), *flags, np.zeros((4, 3)))
    for flag in flags:
        assert set(flag.view(np.uint8).tolist()) <= {0, 1}


def test_what_another_thread_writes_meanwhile_is_not_flown() -> None:
    """Actions are checked and flown as they were when the call began."""
    env = drm_env.DrmVectorEnv(4096, autoreset_mode="SameStep")
    env.reset(seed=0)
    actions = np.full((4096, 2), 0.5, np.float32)
    stop = threading.Event()

    def write() -> None:
        while not stop.is_set():
            # the last one is checked at once and flown late
            actions[-1, 0] = np.nan
            actions[-1, 0] = 0.5

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for _ in range(200):
            # another error is that of a NaN that has been flown
            with contextlib.suppress(drm_env.ActionError):
                env.step(actions)
    finally:
        stop.set()
        writer.join()
