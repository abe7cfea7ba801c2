"""The targets of `tools/fuzz_bindings.py` with the kept corpora and with bytes at random."""

from __future__ import annotations

import importlib.util
import os
import random
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pyarrow")
ROOT = Path(__file__).parents[1]
CORPORA = ROOT / "tests" / "corpora"
TRIES = 150_000 if os.environ.get("DRM_PROFILE") == "soak" else 1500


def bindings() -> Any:
    path = ROOT / "tools" / "fuzz_bindings.py"
    spec = importlib.util.spec_from_file_location("fuzz_bindings", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz_bindings"] = module
    spec.loader.exec_module(module)
    return module


FUZZ = bindings()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", FUZZ.TARGETS)
def test_nothing_but_the_package_s_own_errors_comes_out(name: str) -> None:
    target = FUZZ.TARGETS[name]
    kept = sorted((CORPORA / name).iterdir())
    assert kept
    for path in kept:
        target(path.read_bytes())
    rng = random.Random(name)
    # files cost more: they are written and read
    for _ in range(TRIES if name == "arrays" else TRIES // 3):
        data = rng.randbytes(rng.randint(1, 120))
        try:
            target(data)
        except Exception as error:
            raise AssertionError(f"{name}({data!r})") from error


@pytest.mark.filterwarnings("ignore")
def test_sound_files_are_read() -> None:
    """What the damage is done to is taken as it is: byte 1 begins an empty damage at no place."""
    for name in FUZZ.READERS:
        assert FUZZ.sound_files()[name]
    assert set(FUZZ.READERS) < set(FUZZ.sound_files())
