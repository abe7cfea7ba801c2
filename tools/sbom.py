"""Bills of materials of a release, in CycloneDX's form: what is in it, in which versions.

    python tools/sbom.py dist         # make sbom; after `make dist`

writes ``engine.cdx.json``, the crates that are compiled into the engine, as maturin has put it into
the wheel (cargo-cyclonedx's), without the folders of the machine; and ``python.cdx.json``, the
Python packages that the release was tested with, with their hashes (cyclonedx-py's).
"""

from __future__ import annotations

import argparse
import importlib.metadata
import re
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ENGINE = "engine.cdx.json"
PYTHON = "python.cdx.json"


def of_wheel(folder: Path) -> str | None:
    """Return the engine's bill from the wheel in a folder, or from the engine that is installed."""
    for wheel in sorted(folder.glob("drm_env-*.whl")):
        with zipfile.ZipFile(wheel) as archive:
            for name in archive.namelist():
                if name.endswith(".cyclonedx.json"):
                    return archive.read(name).decode()
    try:
        files = importlib.metadata.distribution("drm-env").files or []
    except importlib.metadata.PackageNotFoundError:
        return None
    for file in files:
        if file.name.endswith(".cyclonedx.json"):
            return file.read_text()
    return None


def without_folders(bill: str) -> str:
    """Return a bill that names the project's folders and no place of the machine."""
    return re.sub(r'file:///[^"#]*?/drm_env(?=[/#])', "file:///drm_env", bill)


def write(folder: Path) -> list[Path]:
    """Write both bills into a folder and return their paths.

    Raises
    ------
    SystemExit
        No engine has a bill, or cyclonedx-py fails.
    """
    folder.mkdir(parents=True, exist_ok=True)
    bill = of_wheel(folder)
    if bill is None:
        raise SystemExit("the engine came without its bill: build it with maturin (make dist)")
    (folder / ENGINE).write_text(without_folders(bill))
    done = subprocess.run(
        [
            sys.executable, "-m", "cyclonedx_py", "requirements", "--output-reproducible",
            "--pyproject", str(ROOT / "baselines" / "pyproject.toml"), "--of", "JSON",
            "--output-file", str(folder / PYTHON), str(ROOT / "requirements-dev.txt"),
        ],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(f"cyclonedx-py failed (package cyclonedx-bom): {done.stderr[-1000:]}")
    return [folder / ENGINE, folder / PYTHON]


def main() -> None:
    """Write the bills and say where."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "dist")
    for path in write(parser.parse_args().folder):
        print(f"{path.stat().st_size / 1e6:6.2f} MB  {path.name}")


if __name__ == "__main__":
    main()
