"""The colours of pictures: those that the engine draws with."""

from __future__ import annotations

from drm_env.constants import PALETTE

OKABE_ITO = PALETTE
"""The palette, by colour; grey was added."""


def paler(colour: str, share: float) -> str:
    """Return a colour ``"#RRGGBB"`` mixed with white; ``share`` of it is white."""
    parts = (round(part + share * (255 - part)) for part in bytes.fromhex(colour[1:]))
    return "#{:02X}{:02X}{:02X}".format(*parts)
