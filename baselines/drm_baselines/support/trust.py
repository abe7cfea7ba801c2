"""Files that can run code, and how a user's own are told from those of strangers.

Checkpoints of Stable-Baselines3 are pickles: whoever loads one does what its maker wants. A digest
in the record beside it says nothing of who made it, for a stranger can write both. So files are
sealed when they are written: a keyed digest (HMAC-SHA256) with a secret that was drawn for this
user and lies in the user's own state directory. A file without the right seal is not loaded.
"""

from __future__ import annotations

import contextlib
import hmac
import os
import secrets
import stat
import warnings
from pathlib import Path

from drm_baselines.support.extras import needing

_SECRET_BYTES = 32
_PURPOSE = b"drm-checkpoint 1\n"


def secret_file() -> Path:
    """Return where the secret of this user is kept."""
    with needing("checkpoints", "cli"):
        import platformdirs
    return platformdirs.user_state_path("drm-baselines", appauthor=False) / "checkpoint-secret"


def seal(digest: str) -> str | None:
    """Return the seal of a file of this digest; none, with a warning, if no secret can be kept."""
    secret = _secret() or _drawn()
    if secret is None:
        warnings.warn(
            f"{secret_file()} cannot be kept: checkpoints are not sealed, and resuming this run "
            "will need --trust",
            stacklevel=2,
        )
        return None
    return _sealed(secret, digest)


def is_sealed(digest: str, found: object) -> bool:
    """Return whether this user has sealed a file of this digest."""
    secret = _secret()
    return (
        secret is not None
        and isinstance(found, str)
        and hmac.compare_digest(_sealed(secret, digest).encode(), found.encode())
    )


def _sealed(secret: bytes, digest: str) -> str:
    return hmac.digest(secret, _PURPOSE + digest.encode(), "sha256").hex()


def _secret() -> bytes | None:
    """Return the secret if it is there and nobody else can have put or read it."""
    try:
        with secret_file().open("rb") as stream:
            status = os.fstat(stream.fileno())
            private = not hasattr(os, "getuid") or (
                status.st_uid == os.getuid() and not status.st_mode & 0o077
            )
            content = stream.read(_SECRET_BYTES + 1)
    except OSError:
        return None
    whole = stat.S_ISREG(status.st_mode) and len(content) == _SECRET_BYTES
    return content if whole and private else None


def _drawn() -> bytes | None:
    """Draw the secret, unless another process has done so meanwhile; none if it cannot be kept."""
    path = secret_file()
    # whole before it has its name: a process that is killed leaves none, not half of one
    temporary = path.with_name(f"{path.name}-{os.getpid()}-{secrets.token_hex(4)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "wb") as stream:
            stream.write(secrets.token_bytes(_SECRET_BYTES))
            stream.flush()
            os.fsync(stream.fileno())
        with contextlib.suppress(FileExistsError):
            os.link(temporary, path)
    except OSError:
        return None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
    return _secret()
