"""What is installed with the project: free licences, exact versions, no address of an index."""

from __future__ import annotations

import importlib.metadata
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from drm_baselines.support.extras import EXTRAS

ROOT = Path(__file__).parents[1]
FREE = {
    "0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0", "HPND", "ISC",
    "LLVM-exception", "MIT", "MIT-0", "MIT-CMU", "MPL-2.0", "NCSA", "PSF-2.0", "Python-2.0",
    "Unlicense", "Unicode-3.0", "Zlib", "bzip2-1.0.6",
}  # fmt: skip
"""Licences that put no condition on who uses the project, by their SPDX names."""
SPELLINGS = (
    (r"\bapache\b", "Apache-2.0"), (r"\bmit\b", "MIT"), (r"\bbsd\b", "BSD-3-Clause"),
    (r"\bmpl\b|mozilla public", "MPL-2.0"), (r"\bpsf\b|python software foundation", "PSF-2.0"),
    (r"\bisc\b", "ISC"), (r"\bunlicense\b", "Unlicense"), (r"\bzlib\b", "Zlib"),
)  # fmt: skip
"""How older packages say it."""
ELSEWHERE = {
    # the graphics processor's libraries, which PyTorch's wheels for Linux bring: not free, and not
    # part of what this project gives to anybody
    "nvidia", "cuda", "triton",
}  # fmt: skip


def closure() -> dict[str, importlib.metadata.Distribution]:
    """Return the installed distributions that the two of the project need, with all extras."""
    project = tomllib.loads((ROOT / "baselines" / "pyproject.toml").read_text())["project"]
    engine = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    waiting = [
        *engine["dependencies"], *project["dependencies"],
        *(text for extra in project["optional-dependencies"].values() for text in extra),
    ]  # fmt: skip
    found: dict[str, importlib.metadata.Distribution] = {}
    while waiting:
        requirement = Requirement(waiting.pop())
        name = canonicalize_name(requirement.name)
        if name in found or name in ("drm-env", "drm-baselines"):
            continue
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            found[name] = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue  # of another platform
        waiting += found[name].requires or []
    return found


def names_of(expression: str) -> set[str]:
    """Return the names in an SPDX expression; of mere alternatives the free ones alone."""
    names = set(re.findall(r"[A-Za-z0-9.+-]+", expression)) - {"AND", "OR", "WITH"}
    alternatives = " OR " in expression and " AND " not in expression
    return (names & FREE or names) if alternatives else names


def licences_of(distribution: importlib.metadata.Distribution) -> set[str]:
    """Return the SPDX names of a distribution's licences, as well as it says them."""
    metadata = distribution.metadata
    if expression := metadata.get("License-Expression"):
        # GCC's run-time libraries may be linked into anything
        text = re.sub(r"GPL-3\.0-or-later WITH GCC-exception-3\.1", "MIT", expression)
        return names_of(text)
    said = [
        *(text for text in metadata.get_all("Classifier") or [] if text.startswith("License ::")),
        (metadata.get("License") or "").strip().split("\n")[0][:100],
    ]
    return {
        licence
        for text in said
        for pattern, licence in SPELLINGS
        if re.search(pattern, text.lower())
    } | {name for text in said for name in ("GPL", "AGPL") if re.search(rf"\bL?{name}", text)}


def test_every_python_package_has_a_free_licence() -> None:
    found = closure()
    assert {"numpy", "gymnasium", "torch", "optuna", "filelock", "platformdirs"} <= set(found)
    wrong = {}
    for name, distribution in found.items():
        if name.partition("-")[0] in ELSEWHERE:
            continue
        licences = licences_of(distribution)
        if not licences or not licences <= FREE:
            wrong[name] = sorted(licences)
    assert wrong == {}


@pytest.mark.parametrize(
    ("lines", "free"),
    [
        ("License-Expression: MIT", True),
        ("License-Expression: MIT OR GPL-3.0-only", True),
        ("License-Expression: MIT AND GPL-3.0-only", False),
        ("License-Expression: Proprietary", False),
        ("License: GNU GPLv3", False),
        ("License: LGPL", False),
        ("Classifier: License :: OSI Approved :: MIT License", True),
        ("Classifier: License :: OSI Approved :: GNU Affero General Public License (AGPL)", False),
        ("Summary: nothing said", False),
    ],
)
def test_a_licence_with_conditions_is_seen(tmp_path: Path, lines: str, free: bool) -> None:
    (tmp_path / "METADATA").write_text(f"Metadata-Version: 2.4\nName: some\n{lines}\n")
    found = licences_of(importlib.metadata.PathDistribution(tmp_path))
    assert (bool(found) and found <= FREE) is free


@pytest.mark.skipif(shutil.which("cargo") is None, reason="needs cargo")
def test_every_crate_has_a_free_licence_and_comes_from_the_registry() -> None:
    done = subprocess.run(
        ["cargo", "metadata", "--format-version", "1", "--offline", "--locked"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        pytest.skip(f"crates are not here: {done.stderr.strip()[-200:]}")
    packages = json.loads(done.stdout)["packages"]
    assert len(packages) > 10
    for package in packages:
        if package["source"] is None:
            assert Path(package["manifest_path"]).is_relative_to(ROOT)
            continue
        assert package["source"].startswith("registry+"), package["name"]
        # of alternatives one is enough, of parts all are needed
        expression = (package["license"] or "").replace("/", " OR ")
        names = set(re.findall(r"[A-Za-z0-9.-]+", expression)) - {"AND", "OR", "WITH"}
        alternatives = " OR " in expression and " AND " not in expression
        assert names & FREE if alternatives else names and names <= FREE, (
            package["name"], expression,
        )  # fmt: skip


def test_crates_are_locked_with_checksums_and_none_is_there_in_two_major_versions() -> None:
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text())
    majors: dict[str, set[str]] = {}
    sources: set[str] = set()
    for package in lock["package"]:
        if package["name"].startswith("drm-env") or package["name"] == "drm_env":
            continue
        assert re.fullmatch("[0-9a-f]{64}", package["checksum"]), package["name"]
        assert package["source"].startswith("registry+"), package["name"]
        sources.add(package["source"])
        numbers = package["version"].split(".")
        major = numbers[0] if numbers[0] != "0" else ".".join(numbers[:2])
        majors.setdefault(package["name"], set()).add(major)
    # all from one registry, Cargo's own
    assert len(sources) == 1
    runtime = {"pyo3", "numpy", "ndarray", "serde", "serde_json", "schemars", "libm", "rand"}
    assert {name for name, found in majors.items() if name in runtime and len(found) > 1} == set()


def pinned_in(path: str) -> list[str]:
    """The requirements of a file, each with its hashes."""
    return re.split(r"\n(?=[a-z])", (ROOT / path).read_text().strip())


def wanted_by(path: str) -> set[str]:
    lines = (ROOT / path).read_text().splitlines()
    return {
        canonicalize_name(Requirement(line).name)
        for line in lines if line and not line.startswith("#")
    }  # fmt: skip


def release_of(entry: str) -> tuple[str, set[str]]:
    """Name with version, and hashes."""
    return entry.split()[0], set(re.findall(r"sha256:[0-9a-f]{64}", entry))


def test_the_demo_installs_a_small_part_of_the_same_packages() -> None:
    """So that `make demo` and the other targets work in one environment, in any order."""
    every = dict(release_of(entry) for entry in pinned_in("requirements-dev.txt"))
    few = [release_of(entry) for entry in pinned_in("requirements-demo.txt")]
    for release, hashes in few:
        assert hashes and hashes <= every[release], release
    names = {canonicalize_name(release.partition("==")[0]) for release, _ in few}
    assert wanted_by("requirements-demo.in") <= names
    # what `drm demo` asks for, by the table of the extras, and the distributions' own
    extra = {name.replace("_", "-") for name in EXTRAS["evaluate"]}
    assert extra | {"gymnasium", "numpy", "safetensors"} <= names
    assert not names & {"torch", "stable-baselines3", "pandas", "pyarrow", "ray"}


def test_requirements_are_exact_with_hashes_and_name_no_index() -> None:
    entries = pinned_in("requirements-dev.txt")
    assert len(entries) > 50
    for entry in (*entries, *pinned_in("requirements-demo.txt")):
        if entry.startswith("#"):
            continue
        assert re.match(r"[a-z0-9._-]+(\[[a-z0-9,_-]+\])?==[^\s]+", entry), entry[:80]
        assert "--hash=sha256:" in entry, entry[:80]
    for path in ("requirements-dev.txt", "requirements-dev.in", "requirements-demo.txt",
                 "requirements-demo.in", "pyproject.toml", "baselines/pyproject.toml",
                 "Makefile"):  # fmt: skip
        content = (ROOT / path).read_text()
        assert not re.search(r"index-url|extra-index|find-links\s+http", content.replace(
            "--no-emit-index-url", "").replace("--no-emit-find-links", "")), path  # fmt: skip
    pinned = {canonicalize_name(entry.partition("==")[0].partition("[")[0]) for entry in entries}
    assert wanted_by("requirements-dev.in") <= pinned


def test_the_licences_that_cargo_deny_allows_are_free() -> None:
    settings = tomllib.loads((ROOT / "deny.toml").read_text())
    assert {name for text in settings["licenses"]["allow"] for name in names_of(text)} <= FREE
    assert set(settings["sources"].values()) == {"deny"}


@pytest.mark.skipif(shutil.which("cargo-deny") is None, reason="needs cargo-deny")
def test_cargo_deny_finds_nothing_in_what_it_can_check_without_a_network() -> None:
    done = subprocess.run(
        ["cargo", "deny", "--offline", "check", "licenses", "bans", "sources"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]


def test_a_bill_of_materials_lists_what_is_released_and_no_folder_of_the_machine(
    tmp_path: Path,
) -> None:
    pytest.importorskip("cyclonedx_py")
    done = subprocess.run(
        [sys.executable, ROOT / "tools" / "sbom.py", tmp_path],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if "without its bill" in done.stderr:
        pytest.skip("this engine was not installed by maturin")
    assert done.returncode == 0, done.stderr
    engine = (tmp_path / "engine.cdx.json").read_text()
    assert not re.search(r"file:///(?!drm_env)", engine)
    parts = {part["name"]: part for part in json.loads(engine)["components"]}
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
    locked = {(package["name"], package["version"]) for package in lock}
    assert {"drm_env", "nalgebra", "pyo3", "serde_json"} <= set(parts)
    assert {(part["name"], part["version"]) for part in parts.values()} <= locked
    python = json.loads((tmp_path / "python.cdx.json").read_text())
    assert python["bomFormat"] == "CycloneDX"
    named = {canonicalize_name(part["name"]): part for part in python["components"]}
    text = (ROOT / "requirements-dev.txt").read_text()
    pinned = re.findall(r"^([a-z0-9._-]+)(?:\[[^\]]*\])?==", text, re.MULTILINE)
    assert {canonicalize_name(name) for name in pinned} <= set(named)
    assert "hashes" in json.dumps(named["numpy"])
