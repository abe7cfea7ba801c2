"""Shared by the tests of the Python package."""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

# The oracle package of the tests is imported by name.
sys.path.insert(0, str(Path(__file__).parent))
# Windows of the "human" render mode need no display here.
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
# What the package keeps for a user is not what tests leave behind.
_STATE = tempfile.TemporaryDirectory(prefix="drm-state-")
os.environ["XDG_STATE_HOME"] = _STATE.name
# Tests that were started in the background or by nohup ignore signals that some of them send.
for _name, _handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    if hasattr(signal, _name) and signal.getsignal(getattr(signal, _name)) is signal.SIG_IGN:
        signal.signal(getattr(signal, _name), _handler)

IDS = (
    "drm_env/Slew-v1",
    "drm_env/SlewResidual-v1",
    "drm_env/Slew-v0",
    "drm_env/SlewResidual-v0",
    "drm_env/SlewThesis-v0",
    "drm_env/SlewDirect-v0",
    "drm_env/SlewFlexible-v0",
)


@pytest.fixture(params=IDS, ids=lambda name: name.removeprefix("drm_env/"))
def env_id(request: pytest.FixtureRequest) -> str:
    """The id of each registered environment in turn."""
    name: str = request.param
    return name


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium without a window; tests that want it are skipped where it is not installed."""
    api = pytest.importorskip("playwright.sync_api")
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        pytest.skip("needs Chromium ('apt-get install chromium')")
    with api.sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=path,
            args=[
                "--no-sandbox",
                "--disable-gpu",
                "--disable-quic",
                "--no-first-run",
                "--disable-background-networking",
                "--disable-component-update",
                "--disable-sync",
            ],
        )
        yield started
        started.close()


_CAPABILITY_VERSION_3 = 0x20080522
_DAC_OVERRIDE_AND_READ_SEARCH = 1 << 1 | 1 << 2


@pytest.fixture
def as_a_user() -> Iterator[None]:
    """Permissions of files hold for this thread as they do for everybody, also where it is root's.

    Root passes them by two capabilities of Linux; they are put aside for the time of the test.
    """
    if not hasattr(os, "geteuid"):
        pytest.skip("needs permissions of POSIX")
    if os.geteuid() != 0:
        yield
        return
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION_3, 0)
    # effective, permitted, inheritable; twice, for 64 bits
    sets = (ctypes.c_uint32 * 6)()
    if not hasattr(libc, "capget") or libc.capget(header, sets) != 0:
        pytest.skip("this system does not let root put its privileges aside")
    before = sets[0]
    sets[0] = before & ~_DAC_OVERRIDE_AND_READ_SEARCH
    if libc.capset(header, sets) != 0:
        pytest.skip(f"this system keeps root's privileges: {os.strerror(ctypes.get_errno())}")
    yield
    sets[0] = before
    assert libc.capset(header, sets) == 0
