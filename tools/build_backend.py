"""What builds drm-env from its sources: maturin, with a plain word where Rust is missing.

Without Rust, maturin fetches one for the build. Where that does not work either, the traceback
says nothing of what to do.
"""

from __future__ import annotations

import os
import shutil
import sys
from typing import Any

import maturin

MESSAGE = """
drm-env needs Rust 1.89 or newer to be compiled; no cargo here, and none fetched ({reason}).
Install Rust (https://rustup.rs) and a C linker and try again, or a wheel, which needs neither.
"""

get_requires_for_build_sdist = maturin.get_requires_for_build_sdist
get_requires_for_build_wheel = maturin.get_requires_for_build_wheel
get_requires_for_build_editable = maturin.get_requires_for_build_editable
build_sdist = maturin.build_sdist


def _built(hook: Any, *arguments: Any) -> Any:
    """What maturin builds, or the end with the message."""
    if shutil.which("cargo"):
        return hook(*arguments)
    try:
        return hook(*arguments)
    except (Exception, SystemExit) as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        print(MESSAGE.format(reason=reason[-1][:200]), file=sys.stderr, flush=True)
        raise SystemExit(1) from None


def prepare_metadata_for_build_wheel(*arguments: Any) -> Any:
    """As in PEP 517."""
    return _built(maturin.prepare_metadata_for_build_wheel, *arguments)


def prepare_metadata_for_build_editable(*arguments: Any) -> Any:
    """As in PEP 660."""
    return _built(maturin.prepare_metadata_for_build_editable, *arguments)


def build_wheel(*arguments: Any) -> Any:
    """As in PEP 517, without the library's symbols: they are half of it, and nobody reads them."""
    os.environ.setdefault("MATURIN_PEP517_ARGS", "--strip")
    return _built(maturin.build_wheel, *arguments)


def build_editable(*arguments: Any) -> Any:
    """As in PEP 660."""
    return _built(maturin.build_editable, *arguments)
