"""One process at a time works in a directory, and unfinished work is taken up without --force."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from drm_baselines.errors import BusyError, ExistingResultError, WriteError
from drm_baselines.support import workplace
from drm_baselines.support.workplace import Work

HOLDER = """
import sys, time
from pathlib import Path
from drm_baselines.support.workplace import Work, working

with working(Path(sys.argv[1]), Work("drm reproduce")):
    (Path(sys.argv[1]) / "half.png").touch()
    print("working", flush=True)
    time.sleep(600)
"""
WORK = Work("drm reproduce")


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that works in ``tmp_path / "out"``."""
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "out")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "working\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.mark.parametrize("door", ["working", "noting", "check"])
def test_a_directory_in_use_is_refused_with_who_uses_it(
    tmp_path: Path, holder: subprocess.Popen[str], door: str
) -> None:
    out = tmp_path / "out"
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    entering: dict[str, Callable[[], Any]] = {
        "check": lambda: workplace.check(out, WORK, force=True),
        "working": lambda: workplace.working(out, WORK).__enter__(),
        "noting": lambda: workplace.noting(out, WORK).__enter__(),
    }
    with pytest.raises(BusyError, match=rf"in use by drm reproduce \(process {holder.pid} on "):
        entering[door]()
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_what_a_killed_process_began_is_taken_up(
    tmp_path: Path, holder: subprocess.Popen[str]
) -> None:
    out = tmp_path / "out"
    holder.kill()
    holder.wait()
    with pytest.raises(ExistingResultError, match="not empty"):
        workplace.check(out, Work("drm imitate"))
    with pytest.raises(
        ExistingResultError, match="an unfinished drm reproduce with other settings"
    ):
        workplace.check(out, Work("drm reproduce", {"seed": 1}))
    workplace.check(out, WORK)
    with workplace.working(out, WORK) as again:
        assert again
        assert (out / "half.png").exists()
    # finished: what is there is a result now
    with pytest.raises(ExistingResultError, match="not empty"):
        workplace.check(out, WORK)


def test_work_that_failed_stays_noted_and_finished_work_does_not(tmp_path: Path) -> None:
    def failing() -> None:
        with workplace.working(tmp_path, Work("drm imitate", {"seed": (1, 2)})):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        failing()
    assert Work("drm imitate", {"seed": [1, 2]}).is_noted(tmp_path)
    (tmp_path / "policy.json").touch()
    interrupted = Work("drm imitate", {"seed": [1, 2]})
    with workplace.working(tmp_path, interrupted) as again:
        assert again
        interrupted.finished = False
    assert interrupted.is_noted(tmp_path)
    with workplace.working(tmp_path, Work("drm imitate", {"seed": [1, 2]})):
        pass
    assert workplace.noted(tmp_path) is None


@pytest.mark.parametrize("text", ["", "[1]", "{", '{"format": "other"}', "\0\0"])
def test_a_damaged_note_vouches_for_nothing(tmp_path: Path, text: str) -> None:
    (tmp_path / workplace.NOTE_FILE).write_text(text)
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(ExistingResultError, match="not empty"):
        workplace.check(tmp_path, WORK)


def test_housekeeping_alone_leaves_a_directory_empty(tmp_path: Path) -> None:
    with workplace.noting(tmp_path, WORK):
        note = json.loads((tmp_path / workplace.NOTE_FILE).read_text())
        assert note["process"] == os.getpid()
    workplace.check(tmp_path, Work("drm imitate"))


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(WriteError, match=r"file.* cannot be written"):
        workplace.noting(tmp_path / "file" / "run", WORK).__enter__()
