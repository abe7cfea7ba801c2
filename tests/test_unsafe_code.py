"""docs/reliability.md lists the engine's unsafe code: every file, with the number of places."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLACE = re.compile(r"\bunsafe (?:fn|impl|extern|\{)")


def test_the_list_of_unsafe_code_is_complete() -> None:
    found = {
        str(path.relative_to(ROOT)): len(PLACE.findall(path.read_text(encoding="utf-8")))
        for folder in ("drm_env/src", "drm_env/py/src", "drm_env/web/src", "drm_env/fuzz/src")
        for path in (ROOT / folder).rglob("*.rs")
        if path.name != "tests.rs"
    }
    page = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
    listed = re.findall(r"`(drm_env/[a-z0-9_/]+\.rs)` \((\d+)\)", page)
    assert {name: int(count) for name, count in listed} == {
        name: count for name, count in found.items() if count
    }
