"""Build the lab: the engine as WebAssembly and a page around it, in one file that needs no network.

    tools/lab.py OUTPUT        (``make lab`` writes site/lab/index.html)

The engine is compiled twice: with the fused multiply-add of WebAssembly's relaxed instructions, and
without it for browsers and processors that lack it. The page takes the first where its numbers are
those of every other machine (drm_env/web/page/worker.js). Both, the page's scripts and the policies
that fly in it are embedded.
"""

from __future__ import annotations

import argparse
import base64
import gzip
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from drm_baselines.errors import BaselineError
from drm_baselines.policies.names import POLICIES, PolicyName
from drm_baselines.policies.pilots import law_data, shipped_run
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.support import storage

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "drm_env" / "web" / "page"
TARGET = "wasm32-unknown-unknown"
MODULES = {"portable": "", "relaxed": "-Ctarget-feature=+simd128,+relaxed-simd"}
"""Compiler flags of the two modules."""
SCRIPTS = ("arm", "chart", "engine", "options", "spectrum", "lab")
"""Modules of the page, the one that begins last."""
SHORT = {
    "none": "Open loop",
    "linear": "Linear law",
    "lyapunov": "Lyapunov law",
    "servo": "Servo",
    "lqr": "LQR",
    "dagger": "Imitation",
    "ppo": "PPO",
}
"""Policies that fly in the page, with names for places where their titles have no room."""
LARGEST = 3_000_000
"""Bytes that the page may have."""


def missing_tool() -> str | None:
    """Return what has to be installed before the engine compiles to WebAssembly, if anything."""
    if shutil.which("cargo") is None or shutil.which("rustc") is None:
        return "the lab needs Rust: install it from https://rustup.rs"
    library = subprocess.run(
        ["rustc", "--print", "target-libdir", "--target", TARGET],
        capture_output=True,
        text=True,
        check=False,
    )
    folder = Path(library.stdout.strip())
    if library.returncode == 0 and any(folder.glob("libstd-*.rlib")):
        return None
    return (
        f"the lab needs Rust's standard library for {TARGET}: install it with "
        f"'rustup target add {TARGET}'"
    )


def compile_engine(name: str, target: Path) -> bytes:
    """Return the engine as the WebAssembly module of this name.

    Raises
    ------
    subprocess.CalledProcessError
        It does not compile; the compiler has said why.
    """
    command = [
        "cargo", "build", "--quiet", "--locked", "--package", "drm-env-web", "--profile", "web",
        "--target", TARGET, "--target-dir", str(target / name),
    ]  # fmt: skip
    # the page holds the module: no paths of this machine in it
    flags = f"{MODULES[name]} --remap-path-prefix={ROOT}=. --remap-path-prefix={Path.home()}=~"
    subprocess.run(command, check=True, cwd=ROOT, env={**os.environ, "RUSTFLAGS": flags.strip()})
    return (target / name / TARGET / "web" / "drm_env_web.wasm").read_bytes()


def dashes(policy: PolicyName) -> list[float]:
    """Return a policy's line as a canvas draws it."""
    if policy.line == "-":
        return []
    return [7.0, 4.0] if policy.line == "--" else [2.0, 3.0]


def entry(policy: PolicyName) -> dict[str, Any]:
    """Return what the page knows of a policy."""
    found: dict[str, Any] = {
        "name": policy.name,
        "title": policy.title[0].upper() + policy.title[1:],
        "short": SHORT[policy.name],
        "colour": policy.colour,
        "dash": dashes(policy),
    }
    if policy.kind in ("open loop", "law"):
        return {**found, "law": policy.name}
    if policy.kind == "tuned law":
        return {**found, "law": law_data(policy.name)}
    learned = load_policy(shipped_run(policy.name))
    network, description = learned.network, learned.description
    pairs = zip(network.weights, network.biases, strict=True)
    numbers = b"".join(part.astype("<f4").tobytes() for pair in pairs for part in pair)
    return {
        **found,
        "weights": base64.b64encode(numbers).decode(),
        "policy": {
            "config": description["config"],
            "layers": description["layers"],
            "activation": network.activation,
            "output": network.output,
        },
    }


def element(name: str, kind: str, text: str) -> str:
    """Return a script element that holds data."""
    if "</script" in text.lower():
        raise ValueError(f"{name} cannot stand in a page: it ends the script that it is in")
    return f'<script id="{name}" type="{kind}">{text}</script>'


def packed(content: bytes) -> str:
    """Return bytes as the page unpacks them: gzip, then base64."""
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


def page(modules: dict[str, bytes]) -> str:
    """Return the page around the engine's modules."""
    policies = json.dumps([entry(POLICIES[name]) for name in SHORT], separators=(",", ":"))
    data = [
        element("policies", "application/json", policies.replace("<", "\\u003c")),
        element("worker", "text/plain", (PAGE / "worker.js").read_text()),
        *(element(f"module-{name}", "text/plain", packed(code)) for name, code in modules.items()),
    ]
    # modules in one file: the browser's own way of naming them
    addresses = {
        f"lab/{name}.js": "data:text/javascript;base64,"
        + base64.b64encode((PAGE / f"{name}.js").read_bytes()).decode()
        for name in SCRIPTS
    }
    scripts = [
        f'<script type="importmap">{json.dumps({"imports": addresses})}</script>',
        '<script type="module">import "lab/lab.js";</script>',
    ]
    return (
        (PAGE / "index.html")
        .read_text()
        .replace("<!--style-->", f"<style>\n{(PAGE / 'style.css').read_text()}</style>")
        .replace("<!--data-->", "\n".join(data))
        .replace("<!--scripts-->", "\n".join(scripts))
    )


def main() -> int:
    """Build what the command line names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("output", type=Path, help="the page, such as site/lab/index.html")
    parser.add_argument(
        "--target-dir",
        type=Path,
        default=Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "lab",
        help="where the engine is compiled",
    )
    arguments = parser.parse_args()
    if missing := missing_tool():
        print(missing, file=sys.stderr)
        return 2
    try:
        modules = {name: compile_engine(name, arguments.target_dir) for name in MODULES}
        text = page(modules)
    except (subprocess.CalledProcessError, BaselineError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    size = len(text.encode())
    if size > LARGEST:
        print(f"the page would have {size} bytes, more than {LARGEST}", file=sys.stderr)
        return 1
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    with storage.atomic_path(arguments.output, overwrite=True) as temporary:
        temporary.write_text(text)
    sizes = ", ".join(f"{name} {len(code) / 1e6:.2f} MB" for name, code in modules.items())
    print(f"{arguments.output}: {size / 1e6:.2f} MB (engine before packing: {sizes})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
