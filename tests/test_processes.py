"""Workers of every kind of start, environments that threads share, and the interpreter's end."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

HEAD = """
import hashlib, multiprocessing, os, sys, threading
import numpy as np
import drm_env

def flown(seed, threads=2):
    env = drm_env.DrmVectorEnv(33, horizon=0.4, payload_mass=(50.0, 400.0), num_threads=threads)
    digest = hashlib.sha256(env.reset(seed=seed)[0].tobytes())
    rng = np.random.default_rng(seed)
    for _ in range(20):
        step = env.step(rng.uniform(-1, 1, (33, 2)).astype(np.float32))
        for part in step[:4]:
            digest.update(part.tobytes())
    env.close()
    return digest.hexdigest()
"""


def run(tmp_path: Path, program: str, timeout: float = 120.0) -> str:
    path = tmp_path / "program.py"
    path.write_text(HEAD + program)
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", str(path)],
        capture_output=True, text=True, timeout=timeout, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "panicked" not in done.stderr and "Traceback" not in done.stderr, done.stderr
    return done.stdout.strip()


@pytest.mark.skipif(sys.platform == "win32", reason="needs fork")
@pytest.mark.parametrize("start", ["fork", "spawn", "forkserver"])
def test_workers_have_the_bits_of_their_parent(tmp_path: Path, start: str) -> None:
    """Also after the parent has used its threads, and while an environment of it is alive."""
    output = run(
        tmp_path,
        f"""
if __name__ == "__main__":
    mine = [flown(seed) for seed in (1, 2)]
    alive = drm_env.DrmVectorEnv(16, num_threads=2)
    alive.reset(seed=0)
    with multiprocessing.get_context("{start}").Pool(2) as pool:
        theirs = pool.map(flown, (1, 2))
    alive.step(np.zeros((16, 2), np.float32))
    print(mine == theirs == [flown(seed, threads=1) for seed in (1, 2)], mine[0] != mine[1])
""",
    )
    assert output == "True True"


def test_two_threads_on_two_environments_do_not_disturb_each_other(tmp_path: Path) -> None:
    output = run(
        tmp_path,
        """
alone = {seed: flown(seed) for seed in (1, 2)}
found = {1: [], 2: []}
threads = [
    threading.Thread(target=lambda seed=seed: [found[seed].append(flown(seed)) for _ in range(8)])
    for seed in found
]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(all(found[seed] == [alone[seed]] * 8 for seed in found))
""",
    )
    assert output == "True"


@pytest.mark.parametrize("made", ["DrmEnv()", "DrmVectorEnv(8, num_threads=2)"])
def test_two_threads_on_one_environment_take_turns(tmp_path: Path, made: str) -> None:
    """Each call is whole: as many steps are counted as were taken, and nothing is torn."""
    output = run(
        tmp_path,
        f"""
env = drm_env.{made}
env.reset(seed=0)
action = np.zeros(env.action_space.shape, np.float32)
failures = []

def work():
    try:
        for _ in range(200):
            observation = env.step(action)[0]
            assert np.isfinite(observation).all()
            env.get_state()
    except Exception as error:
        failures.append(repr(error))

threads = [threading.Thread(target=work) for _ in range(2)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
other = drm_env.{made}
other.reset(seed=0)
for _ in range(400):
    other.step(action)
print(failures, env.get_state() == other.get_state())
""",
    )
    assert output == "[] True"


@pytest.mark.parametrize(
    "ending",
    [
        "pass",
        "sys.exit(0)",
        "threading.Thread(target=forever, daemon=True).start(); env.step(action)",
        "import atexit; atexit.register(lambda: env.step(action))",
        "global kept; kept = [env]; kept.append(kept)",
    ],
)
def test_an_interpreter_ends_with_living_environments(tmp_path: Path, ending: str) -> None:
    output = run(
        tmp_path,
        f"""
env = drm_env.DrmVectorEnv(64, num_threads=2)
single = drm_env.DrmEnv()
env.reset(seed=0)
single.reset(seed=0)
action = np.zeros((64, 2), np.float32)
env.step(action)

def forever():
    other = drm_env.DrmVectorEnv(64, num_threads=2)
    other.reset(seed=0)
    while True:
        other.step(action)

print("ends", flush=True)
{ending}
""",
        timeout=60.0,
    )
    assert output == "ends"
