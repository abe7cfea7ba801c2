"""Builds what is given away and tries it: wheels and source distributions of both packages.

    python tools/dist.py                # into dist/, and tried in empty environments
    python tools/dist.py --no-sources   # without compiling the source distribution once more
    python tools/dist.py --try-only     # what lies in dist/ already

The wheel is built for an old C library (manylinux_2_28: RHEL 8 and everything younger) by the
linker of the package ziglang, where that is installed; else for this machine alone, with a word.
Wheels are tried without Rust on the PATH, source distributions with it; what was linked for an old
C library and what is compiled here must fly the same bits.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
import zipfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import sbom

ROOT = Path(__file__).resolve().parent.parent
LIBC = "manylinux_2_28"


def run(*command: str | Path, **arguments: Any) -> str:
    """Run a command and return what it prints."""
    done = subprocess.run(
        [str(word) for word in command], stdout=subprocess.PIPE, text=True, check=False, **arguments
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}\n{done.stdout}\nfailed: {done.returncode}")
    return str(done.stdout)


def build(out: Path) -> None:
    """Both distributions of both packages."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    bins = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": bins, "PYO3_PYTHON": sys.executable}
    old: list[str] = []
    if sys.platform == "linux":
        if find_spec("ziglang"):
            old = ["--zig", "--compatibility", LIBC]
        else:
            print("ziglang is not installed: the wheel is for a C library as new as this one's")
    common: dict[str, Any] = {"cwd": ROOT, "env": environment}
    run("maturin", "build", "--release", "--strip", *old, "--out", out, **common)
    run("maturin", "sdist", "--out", out, **common)
    code = (
        "import sys; import hatchling.build as b; "
        "print(b.build_wheel(sys.argv[1]), b.build_sdist(sys.argv[1]))"
    )
    run(sys.executable, "-c", code, out, cwd=ROOT / "baselines", env=environment)


def without_rust(path: str) -> str:
    """A PATH on which there is no cargo."""
    places = path.split(os.pathsep)
    return os.pathsep.join(place for place in places if not shutil.which("cargo", path=place))


def attempt(files: list[Path], path: str, label: str) -> dict[str, Any]:
    """Install into an empty environment, fly, ask for the version."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "venv"
        venv.create(place, with_pip=True)
        bins = place / ("Scripts" if os.name == "nt" else "bin")
        environment = {**os.environ, "PATH": f"{bins}{os.pathsep}{path}", "PYTHONPATH": ""}
        environment.pop("PYO3_PYTHON", None)
        begun = time.monotonic()
        engine, policies = files
        run(
            bins / "python", "-m", "pip", "install", "--quiet", engine, f"{policies}[cli]",
            env=environment, cwd=folder,
        )  # fmt: skip
        seconds = time.monotonic() - begun
        smoke = shutil.copy(ROOT / "tools" / "smoke.py", folder)
        said = run(bins / "python", smoke, "--json", env=environment, cwd=folder).splitlines()
        version = run(bins / "drm", "--version", env=environment, cwd=folder).strip()
    print(f"{label}: installed in {seconds:.0f} s; {said[-2]}; drm --version: {version}")
    found: dict[str, Any] = json.loads(said[-1])
    return found


def main() -> None:
    """Build, try, say."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--out", type=Path, default=ROOT / "dist")
    options.add_argument("--no-sources", action="store_true")
    options.add_argument("--try-only", action="store_true")
    given = options.parse_args()
    out = given.out.resolve()
    if not given.try_only:
        build(out)
    (engine,) = out.glob("drm_env-*.whl")
    (policies,) = out.glob("drm_baselines-*.whl")
    sources = [next(out.glob(f"{name}-*.tar.gz")) for name in ("drm_env", "drm_baselines")]
    for path in (engine, policies, *sources):
        print(f"{path.stat().st_size / 1e6:6.2f} MB  {path.name}")
    with zipfile.ZipFile(engine) as archive:
        infos = archive.infolist()
        library = next(info for info in infos if info.filename.endswith((".so", ".pyd")))
    print(f"{library.file_size / 1e6:6.2f} MB  {library.filename} in it")
    path = os.environ["PATH"]
    found = attempt([engine, policies], without_rust(path), "wheels, without Rust")
    print(
        f"import drm_env: {found['import_drm_env_ms']:.0f} ms, "
        f"{found['import_drm_env_ms'] - found['import_gymnasium_ms']:.0f} ms beyond gymnasium's "
        f"{found['import_gymnasium_ms']:.0f} ms ({found['import_ratio']:.2f} times)"
    )
    if not given.no_sources:
        compiled = attempt(sources, path, "source distributions, with Rust")
        if compiled["bits"] != found["bits"]:
            raise SystemExit(f"bits of the wheel {found['bits']}, compiled here {compiled['bits']}")
        print(f"both fly the same bits: {found['bits'][:16]}")
    for bill in sbom.write(out):
        print(f"{bill.stat().st_size / 1e6:6.2f} MB  {bill.name}")


if __name__ == "__main__":
    main()
