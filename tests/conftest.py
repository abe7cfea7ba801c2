"""Shared by the tests of the Python package."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from pathlib import Path

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
