"""Numbers as text."""

from __future__ import annotations


def significant(value: float) -> str:
    """Return a number with three or four significant digits and no exponent, thousands grouped."""
    if value == 0.0:
        return "0"
    digits = max(0, 2 - int(f"{abs(value):e}".split("e")[1]))
    return f"{value:,.{digits}f}"
