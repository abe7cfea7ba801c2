"""Trials that are drawn together: the same digits however many of them go on at a time."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest

from drm_baselines.errors import BaselineError
from drm_baselines.support.executors import Here
from drm_baselines.support.places import Place
from drm_baselines.tuning import search
from drm_baselines.tuning.laws import LawRequest, tune_law
from drm_baselines.tuning.search import TRIALS_FILE

pytest.importorskip("optuna")

# more than the ten trials that the sampler draws without a model
REQUEST = LawRequest(law="linear", scenarios=4, trials=14, at_once=4)


def rows(directory: Path) -> list[dict[str, str]]:
    with (directory / TRIALS_FILE).open(newline="") as stream:
        table = list(csv.DictReader(stream))
    for row in table:
        del row["seconds"]
    return table


@pytest.fixture(scope="module")
def one_by_one(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    directory = tmp_path_factory.mktemp("search")
    tune_law(directory, REQUEST)
    return rows(directory)


def test_numbers_and_first_trial_are_as_ever(
    one_by_one: list[dict[str, str]], tmp_path: Path
) -> None:
    assert [row["number"] for row in one_by_one] == [str(number) for number in range(14)]
    tune_law(tmp_path, LawRequest(law="linear", scenarios=4, trials=1))
    assert rows(tmp_path)[0] == one_by_one[0]


def test_two_processes_find_the_same(one_by_one: list[dict[str, str]], tmp_path: Path) -> None:
    tune_law(tmp_path, REQUEST, place=Place(processes=2))
    assert rows(tmp_path) == one_by_one


class Backwards(Here):
    """Ends jobs in the reverse order."""

    def run(self, work: Any, shared: Any, jobs: Any, told: Any = None) -> Any:
        """See the class."""
        yield from super().run(work, shared, list(jobs)[::-1], told)


def test_the_order_in_which_trials_end_means_nothing(
    one_by_one: list[dict[str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import contextlib

    monkeypatch.setattr(search, "executor", lambda *_, **__: contextlib.nullcontext(Backwards()))
    tune_law(tmp_path, REQUEST)
    assert rows(tmp_path) == one_by_one


def test_an_interrupted_search_goes_on_inside_a_group(
    one_by_one: list[dict[str, str]], tmp_path: Path
) -> None:
    def stop(label: str, done: int, total: int, note: str) -> None:
        if done == 6:
            raise KeyboardInterrupt

    first = tune_law(tmp_path, REQUEST, progress=stop)
    assert first.interrupted and len(rows(tmp_path)) == 6
    second = tune_law(tmp_path, REQUEST)
    assert second.found == 6
    assert rows(tmp_path) == one_by_one


def test_another_number_at_once_is_another_search(tmp_path: Path) -> None:
    tune_law(tmp_path, LawRequest(law="linear", scenarios=4, trials=1))
    with pytest.raises(BaselineError, match="at once"):
        tune_law(tmp_path, LawRequest(law="linear", scenarios=4, trials=1, at_once=2))
    with pytest.raises(BaselineError, match="at_once is 1"):
        tune_law(
            tmp_path,
            LawRequest(law="linear", scenarios=4, trials=1),
            place=Place(processes=2),
        )
