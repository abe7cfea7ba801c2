"""The engine with the instructions of other processors than this one: the same bits.

``DRM_ENV_INSTRUCTIONS`` is read once by a process, so each set of instructions flies in its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

PROGRAM = """
import hashlib, json
import numpy as np
import drm_env
from drm_env import _engine

found = {}

def keep(name, *arrays):
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    found[name] = digest.hexdigest()

for plant in ("thesis", "consistent"):
    options = dict(
        horizon=0.4, plant=plant, payload_mass=(50.0, 500.0), mass_error=(-0.1, 0.1), root_lag=0.05,
        root_dead_time=0.006, angle_noise=1e-4,
    )
    batch = drm_env.DrmVectorEnv(13, **options)
    rng = np.random.default_rng(0)
    rows = [batch.reset(seed=3)[0]]
    for _ in range(8):
        seen, reward, *_ = batch.step(rng.uniform(-1.0, 1.0, (13, 2)).astype(np.float32))
        rows += [seen, reward]
    keep(f"batch, {plant}", *rows, np.frombuffer(batch.get_state(), np.uint8))
    env = drm_env.DrmEnv(**options)
    rows = [env.reset(seed=3)[0]]
    for _ in range(8):
        seen, reward, *_ = env.step(np.array([0.3, -0.2], np.float32))
        rows += [seen, np.float64(reward)]
    keep(f"single, {plant}", *rows)
    masses = [40.0 * (i + 1) for i in range(11)]
    scenarios = [{"plant": plant, "horizon": 0.3, "payload": {"mass": mass}} for mass in masses]
    for law in ("linear", "lyapunov", {"name": "scheduled"}):
        flown = drm_env.rollout(scenarios, law=law)
        keep(f"rollout, {plant}, {law}", *(flown[name] for name in sorted(flown)))
    flown = drm_env.simulate(scenarios[0], law="lyapunov")
    keep(f"simulate, {plant}", *(flown[name] for name in sorted(flown)))
print(json.dumps([_engine.instructions(), found]))
"""
"""Flies through every door that has code for several sets of instructions and prints digests."""

NAMES = ("baseline", "avx2", "avx-512")
"""From the narrowest to the widest."""


def ask(program: str, instructions: str | None) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ}
    environment.pop("DRM_ENV_INSTRUCTIONS", None)
    if instructions is not None:
        environment["DRM_ENV_INSTRUCTIONS"] = instructions
    return subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


def flown(instructions: str | None) -> tuple[str, list[int], dict[str, str]]:
    """Return the instructions in use, the widths of their packs, and digests of flights."""
    done = ask(PROGRAM, instructions)
    assert done.returncode == 0, done.stderr[-2000:]
    (name, widths), found = json.loads(done.stdout)
    return name.lower(), widths, found


@pytest.fixture(scope="module")
def own() -> tuple[str, list[int], dict[str, str]]:
    return flown(None)


@pytest.mark.parametrize("wanted", NAMES)
def test_every_set_of_instructions_has_the_same_bits(
    own: tuple[str, list[int], dict[str, str]], wanted: str
) -> None:
    name, widths, expected = own
    if NAMES.index(wanted) >= NAMES.index(name) and wanted != name:
        pytest.skip(f"this processor has {name}")
    found = flown(wanted)
    assert found[0] == wanted
    assert wanted == "baseline" or max(found[1]) == {"avx2": 4, "avx-512": 8}[wanted]
    assert (max(found[1]) < max(widths)) == (wanted != name)
    assert len(expected) == 12
    assert found[2] == expected


def test_instructions_that_the_processor_has_not_are_not_entered() -> None:
    """The name is the widest that may be used, not what must be there."""
    name, _, _ = flown("avx-512")
    assert name == flown(None)[0]


def test_a_wrong_name_is_refused_when_the_package_is_imported() -> None:
    done = ask("import drm_env", "sse9")
    assert done.returncode != 0
    assert "DRM_ENV_INSTRUCTIONS" in done.stderr
    assert "sse9" in done.stderr
    assert "baseline, avx2, avx-512" in done.stderr
