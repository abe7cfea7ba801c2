"""Gains that ``drm tune`` found, as they come with the package in ``gains/``."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

from drm_baselines.errors import BaselineError

TUNED = {
    "linear_tuned": "linear",
    "lyapunov_tuned": "lyapunov",
    "lqr": "lqr",
    "linear_filtered": "linear_filtered",
    "lyapunov_filtered": "lyapunov_filtered",
    "linear_collocated": "linear_collocated",
    "collocated": "collocated",
}
"""Policies whose gains come from ``drm tune``, by name, and the name of their gains."""

FORMAT = "drm-gains"
FORMAT_VERSION = 1


def load_gains(law: str) -> dict[str, Any]:
    """Return the packaged result of tuning a law: its ``"law"`` flies, the rest says whence.

    Raises
    ------
    BaselineError
        No such law, or no packaged result of this version.
    """
    known = tuple(TUNED.values())
    if law not in known:
        raise BaselineError(f"{law!r} cannot be tuned; there are {', '.join(known)}")
    file = resources.files("drm_baselines") / "gains" / f"{law}.json"
    try:
        content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BaselineError(
            f"no tuned gains of {law!r} are packaged; drm tune {law} --package makes them"
        ) from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BaselineError(f"the packaged gains of {law!r} cannot be read: {error}") from error
    if not isinstance(content, dict) or (content.get("format"), content.get("format_version")) != (
        FORMAT, FORMAT_VERSION,
    ):  # fmt: skip
        raise BaselineError(
            f"the packaged gains of {law!r} are not of format {FORMAT!r} {FORMAT_VERSION}"
        )
    return content
