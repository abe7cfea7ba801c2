"""A few of the kills of which `make soak` does many: killed commands end as undisturbed ones."""

from __future__ import annotations

import importlib.util
import random
import sys
from pathlib import Path
from types import ModuleType

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc"),
]


@pytest.fixture(scope="module")
def soak() -> ModuleType:
    path = Path(__file__).parents[3] / "tools" / "soak.py"
    spec = importlib.util.spec_from_file_location("soak", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["soak"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("name", "kills"), [("tune", 2), ("reproduce", 2), ("sweep", 2)])
def test_a_killed_command_ends_as_an_undisturbed_one(
    soak: ModuleType, tmp_path: Path, name: str, kills: int
) -> None:
    tally = soak.attack(soak.CASES[name], tmp_path, kills, random.Random(5))
    assert tally.faults == []
    assert (tally.kills, tally.orphans, tally.leftovers) == (kills, 0, 0)


def test_a_lost_result_is_seen(soak: ModuleType, tmp_path: Path) -> None:
    """The harness itself: a command that forgets what it had is not passed over."""
    program = (
        "import os, sys, time; os.makedirs(sys.argv[1], exist_ok=True); path = sys.argv[1] + '/n'; "
        "old = os.path.exists(path); time.sleep(0.3 if not old else 0.0); "
        "open(path, 'a').write('x'); time.sleep(0.3)"
    )

    def command(out: Path) -> list[str]:
        return [sys.executable, "-c", program, str(out)]

    case = soak.Case(command, command, lambda out: (out / "n").read_text())
    faults = [
        fault
        for seed in range(6)
        for place in [tmp_path / str(seed)]
        if not place.mkdir()
        for fault in soak.attack(case, place, 2, random.Random(seed)).faults
    ]
    assert any("another result than undisturbed" in fault for fault in faults)


def test_memory_stays_when_a_batch_is_stepped_long(soak: ModuleType) -> None:
    found = soak.walk(2_000_000)
    assert found.steps >= 2_000_000
    assert found.episodes >= 4 * soak.ENVIRONMENTS
    assert found.growth <= soak.GROWTH
    assert soak.Walk(1, 0, [1 << 20, 6 << 20, 1 << 20], 0.0).growth > soak.GROWTH
