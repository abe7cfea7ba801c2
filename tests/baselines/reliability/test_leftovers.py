"""Temporary files of processes that were killed go away; those of living ones do not."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drm_baselines.support import storage
from drm_baselines.support.liveness import is_alive, machine_mark

WRITER = """
import sys, time
from pathlib import Path
from drm_baselines.support import storage

with storage.atomic_path(Path(sys.argv[1]), overwrite=True) as temporary:
    temporary.write_text("half")
    print("writing", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def writer(tmp_path: Path) -> subprocess.Popen[str]:
    """A process in the middle of a write."""
    command = [sys.executable, "-c", WRITER, str(tmp_path / "result.json")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "writing\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


def test_what_a_killed_writer_left_goes_at_the_next_write(
    tmp_path: Path, writer: subprocess.Popen[str]
) -> None:
    result = tmp_path / "result.json"
    result.write_text("old")
    (half,) = (path for path in tmp_path.iterdir() if storage.is_temporary(path.name))
    assert storage.sweep(tmp_path) == [], "its process lives"
    assert half.exists()
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    assert result.read_text() == "old"
    strangers = [
        tmp_path / f".drm-00000000-{writer.pid}-abc.json",  # another machine's
        tmp_path / f".drm-{machine_mark()}-{os.getpid()}-abc.json",  # this process'
        tmp_path / ".result-abc.json",
        tmp_path / "drm-notes.txt",
    ]
    for path in strangers:
        path.write_text("mine")
    storage._swept.discard(tmp_path)  # as in a process that has not written here
    storage.write_text(tmp_path / "other.txt", "x")
    assert not half.exists()
    assert sorted(tmp_path.iterdir()) == sorted([result, tmp_path / "other.txt", *strangers])


def test_whether_a_process_lives(writer: subprocess.Popen[str]) -> None:
    assert is_alive(os.getpid())
    assert is_alive(writer.pid)
    writer.kill()
    writer.wait()
    assert not is_alive(writer.pid)
    assert is_alive(2**70), "no process number: nothing is known, nothing is removed"


def test_links_and_folders_of_that_name_are_left(
    tmp_path: Path, writer: subprocess.Popen[str]
) -> None:
    writer.kill()
    writer.wait()
    storage.sweep(tmp_path)
    outside = tmp_path / "outside"
    outside.write_text("mine")
    name = f".drm-{machine_mark()}-{writer.pid}-"
    (tmp_path / f"{name}a").mkdir()
    (tmp_path / f"{name}b").symlink_to(outside)
    assert storage.sweep(tmp_path) == []
    assert outside.read_text() == "mine"
