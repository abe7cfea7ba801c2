"""A policy is replaced in one step: whenever the writer is killed, the old or the new one is there.

The writer is stopped before and after every system call that changes the directory, which is what a
SIGKILL between two of them leaves.
"""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drm_baselines.errors import RunError, WriteError
from drm_baselines.policies.perceptron import Perceptron
from drm_baselines.policies.policy_file import load_policy, remove_policy, save_policy
from drm_baselines.policies.registry import shipped_policy

DESCRIPTION = {
    name: load_policy(shipped_policy()).description[name]
    for name in ("env_id", "config", "control_period", "observation_layout")
}
INPUTS = len(DESCRIPTION["observation_layout"])


def network(seed: int) -> Perceptron:
    rng = np.random.default_rng(seed)
    return Perceptron(
        weights=[rng.normal(size=(2, INPUTS)).astype(np.float32)],
        biases=[np.zeros(2, dtype=np.float32)],
        activation="tanh",
        output="clip",
    )


class Killed(BaseException):
    """Where the process would have ended."""


class Killer:
    """Counts the renames and removals, and ends the process before or after one of them."""

    def __init__(self, patch: pytest.MonkeyPatch, at: int, *, after: bool) -> None:
        self.count, self.dead = 0, False
        for name in ("replace", "rename", "unlink"):
            patch.setattr(os, name, self.wrapped(getattr(os, name), at, after))

    def wrapped(self, call: Any, at: int, after: bool) -> Any:
        def run(*args: Any, **kwargs: Any) -> Any:
            if self.dead:  # nothing is cleaned up after a SIGKILL
                raise Killed
            mine = self.count == at
            self.count += 1
            if mine and not after:
                self.dead = True
                raise Killed
            try:
                return call(*args, **kwargs)
            finally:
                if mine:
                    self.dead = True
                    raise Killed

        return run


def first_weight(directory: Path) -> float:
    return float(load_policy(directory).network.weights[0][0, 0])


@pytest.mark.parametrize("after", [False, True], ids=["before", "after"])
@pytest.mark.parametrize("old", [False, True], ids=["first", "replaced"])
def test_whenever_the_writer_is_killed_a_whole_policy_is_there(
    tmp_path: Path, old: bool, after: bool
) -> None:
    expected = [float(network(seed).weights[0][0, 0]) for seed in (1, 2, 3)]
    tried = 0
    for at in range(100):
        folder = tmp_path / str(at)
        folder.mkdir()
        if old:
            save_policy(folder, network(1), DESCRIPTION)
        with pytest.MonkeyPatch.context() as patch:
            killer = Killer(patch, at, after=after)
            try:
                save_policy(folder, network(2), DESCRIPTION)
            except Killed:
                tried += 1
        if not killer.dead:
            break
        if old or (folder / "policy.json").exists():
            assert first_weight(folder) in expected[:2]
        else:
            with pytest.raises(RunError, match=r"holds no policy\.json"):
                load_policy(folder)
        # whoever comes next replaces it, and nothing of before stays
        save_policy(folder, network(3), DESCRIPTION)
        assert first_weight(folder) == expected[2]
        visible = {path.name for path in folder.iterdir() if not path.name.startswith(".drm-")}
        assert visible == {"policy.json", "policy.safetensors"}
    assert tried >= 3


def test_a_description_that_cannot_be_written_leaves_the_old_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_policy(tmp_path, network(1), DESCRIPTION)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def full(self: Path, *_: Any, **__: Any) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(WriteError, match=r"policy\.json cannot be written: No space left"):
        save_policy(tmp_path, network(2), DESCRIPTION)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_who_reads_while_policies_are_published_always_gets_one(tmp_path: Path) -> None:
    save_policy(tmp_path, network(0), DESCRIPTION)
    ended = threading.Event()
    failures: list[BaseException] = []
    read = 0

    def reader() -> None:
        nonlocal read
        while not ended.is_set():
            try:
                load_policy(tmp_path)
                read += 1
            except BaseException as error:
                failures.append(error)
                return

    thread = threading.Thread(target=reader)
    thread.start()
    for seed in range(60):
        save_policy(tmp_path, network(seed), DESCRIPTION)
    ended.set()
    thread.join()
    assert not failures
    assert read > 0


def test_a_removed_policy_is_gone(tmp_path: Path) -> None:
    remove_policy(tmp_path / "nowhere")
    save_policy(tmp_path, network(1), DESCRIPTION)
    remove_policy(tmp_path)
    assert not list(tmp_path.iterdir())
