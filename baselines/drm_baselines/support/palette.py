"""The colours of pictures: those that the engine draws with."""

from __future__ import annotations

from drm_env.constants import PALETTE

OKABE_ITO = PALETTE
"""The palette, by colour; grey was added."""


def paler(colour: str, share: float) -> str:
    """Return a colour ``"#RRGGBB"`` mixed with white; ``share`` of it is white."""
    parts = (round(part + share * (255 - part)) for part in bytes.fromhex(colour[1:]))
    return "#{:02X}{:02X}{:02X}".format(*parts)


_DARK = 0.0104
"""Relative luminance of the background that is dark (``--card`` of the pages)."""


def _luminance(colour: str) -> float:
    """Relative luminance, as WCAG 2 defines it."""
    parts = [part / 255.0 for part in bytes.fromhex(colour[1:])]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def on_dark(colour: str) -> str:
    """Return a colour as it is drawn where it is dark: as little paler as it needs to be seen.

    Its contrast to the background is at least 5 to 1; black becomes nearly white.
    """
    if _luminance(colour) < 0.01:
        return "#F2F5FA"
    shares = (step / 20.0 for step in range(21))
    return next(
        found
        for found in (paler(colour, share) for share in shares)
        if (_luminance(found) + 0.05) / (_DARK + 0.05) >= 5.0
    )
