"""Executors do the same work wherever they do it; here without Ray, see test_on_ray.py."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest

from drm_baselines.errors import BaselineError
from drm_baselines.support import cores
from drm_baselines.support.executors import Executor, Here, Processes, Tell
from drm_baselines.support.places import Place, executor


def power(exponent: int, base: int, tell: Tell) -> tuple[int, int]:
    tell(1, 1)
    if base < 0:
        raise BaselineError(f"base must not be negative, got {base}")
    return base**exponent, os.getpid()


def threads(_: None, name: str, tell: Tell) -> tuple[str | None, int | None]:
    return os.environ.get(name), cores.given()


@pytest.fixture(params=["here", "processes"])
def workers(request: pytest.FixtureRequest) -> Iterator[Executor]:
    with executor(Place(processes=1 if request.param == "here" else 2)) as found:
        yield found


def test_every_job_is_done_once_and_told_of(workers: Executor) -> None:
    heard: list[tuple[Any, int, int]] = []
    jobs = ((f"job {base}", base) for base in range(9))
    told = lambda *words: heard.append(words)  # noqa: E731
    results = list(workers.run(power, 3, jobs, told))
    assert sorted((key, value) for key, (value, _) in results) == [
        (f"job {base}", base**3) for base in range(9)
    ]
    assert {key for key, _, _ in heard} <= {f"job {base}" for base in range(9)}
    pids = {pid for _, (_, pid) in results}
    assert (pids == {os.getpid()}) == workers.is_here


def test_what_a_job_raises_is_raised(workers: Executor) -> None:
    with pytest.raises(BaselineError, match="got -2"):
        list(workers.run(power, 3, [(0, 1), (1, -2)]))


def test_jobs_are_taken_as_there_is_room() -> None:
    taken: list[int] = []

    def endless() -> Iterator[tuple[int, int]]:
        for number in range(10**9):
            taken.append(number)
            yield number, number

    found = Here().run(power, 2, endless())
    assert [next(found)[1][0] for _ in range(3)] == [0, 1, 4]
    assert len(taken) == 3


def test_processes_keep_to_their_cores() -> None:
    names = [(name, name) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")]
    found = dict(Processes(2, cores_each=1).run(threads, None, names))
    assert found == {name: ("1", 1) for name, _ in names}


def test_cores_are_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    before = cores.given()
    with cores.kept_to(3):
        assert (cores.given(), cores.count(), os.environ["OMP_NUM_THREADS"]) == (3, 3, "3")
    assert (cores.given(), os.environ["OMP_NUM_THREADS"]) == (before, "7")


@pytest.mark.parametrize(
    ("place", "message"),
    [(Place(processes=0), "at least 1, got 0"), (Place(ray="auto", processes=2), "either")],
)
def test_a_place_that_is_none_is_refused(place: Place, message: str) -> None:
    with pytest.raises(BaselineError, match=message), executor(place):
        pass
