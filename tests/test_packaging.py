"""What is given away: metadata, the word where Rust is missing, workflows, citation.

That wheels and source distributions install and fly in empty environments, `make dist` shows.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


def backend() -> ModuleType:
    pytest.importorskip("maturin")
    spec = importlib.util.spec_from_file_location("build_backend", ROOT / "tools/build_backend.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_without_rust_the_end_is_one_plain_message(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    module = backend()

    def fails(*_: object) -> None:
        raise OSError("no route to host")

    monkeypatch.setattr(shutil, "which", lambda *_, **__: None)
    monkeypatch.setattr(module.maturin, "prepare_metadata_for_build_wheel", fails)
    with pytest.raises(SystemExit) as ended:
        module.prepare_metadata_for_build_wheel("somewhere")
    assert ended.value.code == 1
    said = capfd.readouterr().err
    assert "needs Rust 1.89" in said and "no route to host" in said and "Traceback" not in said
    # with Rust a failure is maturin's own, with all that it says
    monkeypatch.setattr(shutil, "which", lambda *_, **__: "/bin/cargo")
    with pytest.raises(OSError, match="no route"):
        module.prepare_metadata_for_build_wheel("somewhere")


@pytest.mark.skipif(os.name == "nt", reason="a PATH without cargo is made of links here")
def test_a_build_without_rust_says_so_in_two_lines(tmp_path: Path) -> None:
    """As a frontend calls the hook, in a process of its own; the place of Rust's files is dead."""
    pytest.importorskip("maturin")
    (tmp_path / "cc").symlink_to(shutil.which("cc") or "/usr/bin/cc")
    code = "import build_backend; build_backend.prepare_metadata_for_build_wheel('.')"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        env={
            "PATH": str(tmp_path), "HOME": str(tmp_path), "PYTHONPATH": str(ROOT / "tools"),
            "RUSTUP_UPDATE_ROOT": "http://127.0.0.1:9", "RUSTUP_DIST_SERVER": "http://127.0.0.1:9",
        },
    )  # fmt: skip
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    first, second = done.stderr.strip().splitlines()[-2:]
    assert "needs Rust" in first and "no cargo" in first
    assert "Install Rust" in second


def test_the_message_names_the_rust_that_is_needed() -> None:
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text())
    assert f"Rust {cargo['workspace']['package']['rust-version']}" in backend().MESSAGE


def test_metadata_are_whole_and_name_no_address() -> None:
    for place in (ROOT, ROOT / "baselines"):
        project = tomllib.loads((place / "pyproject.toml").read_text())["project"]
        assert {"description", "readme", "license", "keywords", "classifiers"} <= set(project)
        assert "urls" not in project  # there is none yet
        for name in (project["readme"], *project["license-files"]):
            assert (place / name).exists()
    licences = [(place / "LICENSE").read_text() for place in (ROOT, ROOT / "baselines")]
    assert licences[0] == licences[1]


def test_importing_loads_the_engine_and_nothing_else_beyond_gymnasium() -> None:
    code = (
        "import sys, gymnasium; before = set(sys.modules); import drm_env\n"
        "print(sorted(name.partition('.')[0] for name in set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(re.findall(r"'(\w+)'", done.stdout)) - set(sys.stdlib_module_names) == {"drm_env"}


def test_workflows_can_be_read_and_use_targets_that_there_are() -> None:
    yaml = pytest.importorskip("yaml")
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.M))
    found = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
    assert [path.stem for path in found] == ["docs", "tests", "wheels"]
    for path in found:
        text = path.read_text()
        jobs = yaml.safe_load(text)["jobs"]
        assert all(job["steps"] and job["runs-on"] for job in jobs.values())
        assert set(re.findall(r"run: make (\w+)", text)) <= targets
        for place in re.findall(r"python ((?:tools|tests)/\S+\.py)", text):
            assert (ROOT / place).exists()


def test_the_citation_names_the_thesis() -> None:
    yaml = pytest.importorskip("yaml")
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    (thesis,) = citation["references"]
    assert thesis["type"] == "thesis" and thesis["authors"] and thesis["title"]
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    assert citation["version"] == version
