"""Processes that share work end with the one that shares it out, however that ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drm_baselines.support.processes import process_pool

# The second kind of work keeps the interpreter's lock while it sleeps, as solvers may.
PROGRAM = """
import ctypes, os, sys, time
from pathlib import Path
from drm_baselines.cli.common import guarded
from drm_baselines.support.processes import process_pool

def work(place):
    (Path(place) / str(os.getpid())).touch()
    if sys.argv[1] == "sleep":
        time.sleep(600)
    ctypes.PyDLL(None).sleep(600)

@guarded
def share(place):
    with process_pool(2) as pool:
        list(pool.map(work, [place] * 4))

if __name__ == "__main__":
    share(sys.argv[2])
"""


def lives(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize(
    ("work", "how"),
    [("sleep", "SIGKILL"), ("native", "SIGKILL"), ("native", "SIGTERM"), ("sleep", "SIGINT")],
)
def test_workers_end_with_their_parent(tmp_path: Path, work: str, how: str) -> None:
    program = tmp_path / "share.py"
    program.write_text(PROGRAM)
    place = tmp_path / "workers"
    place.mkdir()
    command = [sys.executable, str(program), work, str(place)]
    parent = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    workers: list[int] = []
    try:
        deadline = time.monotonic() + 60
        while len(workers) < 2 and time.monotonic() < deadline:
            time.sleep(0.05)
            workers = [int(path.name) for path in place.iterdir()]
        assert len(workers) == 2
        parent.send_signal(getattr(signal, how))
        parent.wait(timeout=20)
        deadline = time.monotonic() + 10
        while any(map(lives, workers)) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not [process for process in workers if lives(process)]
    finally:
        parent.kill()
        parent.wait()
        for process in workers:
            if lives(process):
                os.kill(process, signal.SIGKILL)


def test_an_error_ends_the_work_that_is_under_way() -> None:
    def failing() -> None:
        with process_pool(2) as pool:
            pool.submit(time.sleep, 600)
            pool.submit(abs, -1).result()
            raise KeyError

    began = time.monotonic()
    with pytest.raises(KeyError):
        failing()
    assert time.monotonic() - began < 60


def test_results_come_in_order() -> None:
    with process_pool(2) as pool:
        assert list(pool.map(abs, range(-5, 5))) == list(map(abs, range(-5, 5)))
