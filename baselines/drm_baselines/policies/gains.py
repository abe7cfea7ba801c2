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
    return _load(law, tuple(TUNED.values()), "gains")


CONTROLLERS = ("receding",)
"""Controllers whose settings were searched by ``drm tune``."""


def load_settings(controller: str) -> dict[str, Any]:
    """Return the packaged result of tuning a controller: it flies with its ``"settings"``.

    Raises
    ------
    BaselineError
        No such controller, or no packaged result of this version.
    """
    return _load(controller, CONTROLLERS, "settings")


def _load(name: str, known: tuple[str, ...], what: str) -> dict[str, Any]:
    if name not in known:
        raise BaselineError(f"{name!r} cannot be tuned; there are {', '.join(known)}")
    file = resources.files("drm_baselines") / "gains" / f"{name}.json"
    try:
        content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BaselineError(
            f"no tuned {what} of {name!r} are packaged; drm tune {name} --package makes them"
        ) from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BaselineError(f"the packaged {what} of {name!r} cannot be read: {error}") from error
    if not isinstance(content, dict) or (content.get("format"), content.get("format_version")) != (
        FORMAT, FORMAT_VERSION,
    ):  # fmt: skip
        raise BaselineError(
            f"the packaged {what} of {name!r} are not of format {FORMAT!r} {FORMAT_VERSION}"
        )
    return content
