"""Threads, forked processes and internal errors: a batch works, or says that it cannot."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pytest

import drm_env
from drm_env import _engine

CONFIG = _engine.Config("slew", None, None)
PROCESSORS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def run(script: str, timeout: float = 120.0) -> list[str]:
    head = """
        import os, signal, sys, threading, time
        import numpy as np
        import drm_env
        from drm_env import _engine
        ID = "drm_env/Slew-v0"
        actions = np.full((64, 2), 0.25, np.float32)

        def child(work, seconds=20.0):
            '''What a forked process prints, or that it hangs or dies.'''
            read, write = os.pipe()
            pid = os.fork()
            if pid == 0:
                try:
                    text = str(work())
                except BaseException as error:
                    text = f"{type(error).__name__}: {error}"
                os.write(write, text.encode())
                os._exit(0)
            os.close(write)
            end = time.monotonic() + seconds
            while os.waitpid(pid, os.WNOHANG) == (0, 0):
                if time.monotonic() > end:
                    os.kill(pid, signal.SIGKILL)
                    os.waitpid(pid, 0)
                    return "it hangs"
                time.sleep(0.01)
            with os.fdopen(read) as file:
                return file.read() or "it died"
    """
    text = textwrap.dedent(head) + textwrap.dedent(script)
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", text],
        capture_output=True, text=True, timeout=timeout, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "panicked" not in done.stderr, done.stderr
    return done.stdout.splitlines()


# -- Threads ---------------------------------------------------------------------------------

DOORS = {
    "make_vec": "import gymnasium as gym; gym.make_vec(ID, num_envs=64, num_threads=COUNT)",
    "make_sb3_vec": "from drm_env.sb3 import make_sb3_vec; make_sb3_vec(ID, 64, num_threads=COUNT)",
    "rollout": "drm_env.rollout([{'horizon': 1.0}] * 64, 'linear', num_threads=COUNT)",
    "batch benchmark": "_engine.batch_benchmark(_engine.Config('slew', None, None), 64, 3, COUNT)",
}


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
@pytest.mark.parametrize("name", DOORS)
@pytest.mark.parametrize("asked", ["5000", "2**70"])
def test_no_call_has_more_threads_than_processors_and_it_says_so(name: str, asked: str) -> None:
    *imports, call = DOORS[name].replace("COUNT", asked).split("; ")
    lines = run(
        "\n".join(imports)
        + textwrap.dedent(
            f"""
            import warnings
            most = 0
            def count():
                global most
                while True:
                    most = max(most, len(os.listdir("/proc/self/task")))
                    time.sleep(0.0005)
            threading.Thread(target=count, daemon=True).start()
            time.sleep(0.1)
            before = len(os.listdir("/proc/self/task"))
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                made = {call}
            if hasattr(made, "step_async"):
                made.reset(); made.step(actions)
            elif hasattr(made, "step"):
                made.reset(seed=0); made.step(actions)
            text = [str(w.message) for w in caught if w.category is UserWarning]
            print(most - before, text)
            """
        )
    )
    threads, text = lines[0].split(" ", 1)
    assert int(threads) <= PROCESSORS
    assert f"is more than the processors: {PROCESSORS} are used" in text


def test_as_many_threads_as_processors_are_no_cause_for_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=r".*is out of date")
        drm_env.DrmVectorEnv(64, num_threads=PROCESSORS)
        drm_env.rollout([{"horizon": 0.1}], num_threads=PROCESSORS)


# -- Internal errors -------------------------------------------------------------------------


@pytest.mark.parametrize("num_threads", [1, 2])
def test_a_batch_is_not_used_again_after_an_internal_error(num_threads: int) -> None:
    env = drm_env.DrmVectorEnv(64, num_threads=min(num_threads, PROCESSORS or 1))
    env.reset(seed=0)
    actions = np.full((64, 2), 0.25, np.float32)
    env.step(actions)
    state = env.get_state()
    _engine.panic_after_parts(5)
    with pytest.raises(drm_env.DrmError, match="internal error, please report it"):
        env.step(actions)
    for call in (
        lambda: env.step(actions),
        lambda: env.reset(seed=0),
        lambda: env.get_state(),
        lambda: env.set_state(state),
        lambda: env.set_context(payload_mass=100.0),
        lambda: env.envs[0].signals(),
    ):
        with pytest.raises(drm_env.SimulationError, match="unusable after an internal error"):
            call()
    env.close()
    other = drm_env.DrmVectorEnv(64)
    other.set_state(state)
    other.step(actions)


# -- Forks -----------------------------------------------------------------------------------

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")


@needs_fork
def test_a_forked_process_goes_on_with_the_batch_that_it_inherits() -> None:
    lines = run(
        """
        env = drm_env.DrmVectorEnv(64)
        env.reset(seed=0)
        for _ in range(3):
            env.step(actions)
        def work():
            for _ in range(3):
                found = env.step(actions)[0]
            env.close()
            import gc; gc.collect()
            return found.tobytes().hex()
        forked = [child(work) for _ in range(5)]
        here = [env.step(actions)[0] for _ in range(3)][-1].tobytes().hex()
        print(all(found == here for found in forked), forked[0][:30])
        """
    )
    assert lines[0].startswith("True"), lines


@needs_fork
def test_a_forked_process_lets_the_threads_of_others_alone() -> None:
    """Its new threads may get the numbers of those that it did not inherit; they can be joined."""
    lines = run(
        """
        import ctypes, gc
        libc = ctypes.CDLL(None)
        START = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)
        body = START(lambda argument: None)
        like_rust = ctypes.create_string_buffer(64)
        libc.pthread_attr_init(like_rust)
        libc.pthread_attr_setstacksize(like_rust, ctypes.c_size_t(2 << 20))
        def joined():
            numbers = [ctypes.c_ulong() for _ in range(8)]
            for number in numbers:
                assert libc.pthread_create(ctypes.byref(number), like_rust, body, None) == 0
            time.sleep(0.05)
            global env
            env.close()
            env = None
            gc.collect()
            return [libc.pthread_join(number, None) for number in numbers]
        env = drm_env.DrmVectorEnv(64)
        env.reset(seed=0)
        env.step(actions)
        print(child(joined))
        """
    )
    assert lines == [str([0] * 8)]


@needs_fork
def test_a_process_that_is_forked_while_another_thread_steps_does_not_hang() -> None:
    lines = run(
        """
        env = drm_env.DrmVectorEnv(64)
        other = drm_env.DrmVectorEnv(64)
        for made in (env, other):
            made.reset(seed=0)
            made.step(actions)
        expected = drm_env.DrmVectorEnv(64)
        expected.set_state(other.get_state())
        expected = expected.step(actions)[0].tobytes().hex()
        stop = threading.Event()
        def step():
            while not stop.is_set():
                env.step(actions)
        thread = threading.Thread(target=step)
        thread.start()
        def work():
            try:
                env.step(actions)
                first = "stepped"
            except drm_env.SimulationError as error:
                first = str(error)
            env.close()
            second = other.step(actions)[0].tobytes().hex() == expected
            drm_env.rollout([{"horizon": 0.1}] * 8, "linear")
            return f"{second} {first}"
        for _ in range(20):
            print(child(work))
        stop.set()
        thread.join()
        """
    )
    assert len(lines) == 20
    for line in lines:
        assert line == "True stepped" or line.startswith(
            "True unusable, for another thread was using it when this process was forked"
        ), lines


@needs_fork
def test_a_process_that_is_forked_during_a_rollout_flies_its_own() -> None:
    lines = run(
        """
        CONSISTENT = {"plant": "consistent", "modes": [1, 1], "horizon": 0.02}
        drm_env.rollout  # imported here: Python's own locks are not ours to mend
        stop = threading.Event()
        def fly():
            while not stop.is_set():
                drm_env.rollout([CONSISTENT] * 32, "linear")
        thread = threading.Thread(target=fly)
        thread.start()
        def work():
            return len(drm_env.rollout([CONSISTENT] * 4, "linear")["tip_error_rms"])
        print([child(work) for _ in range(20)])
        stop.set()
        thread.join()
        """
    )
    assert lines == [str(["4"] * 20)]
