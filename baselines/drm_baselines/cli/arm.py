"""The arm of a command: lengths, stiffnesses and masses of its links as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from drm_baselines.cli.common import parse_value
from drm_baselines.errors import BaselineError
from drm_baselines.support.reading import shown

ARM_HELP = (
    "Another arm, as KEY=VALUE in SI units: link1_length, link1_bending_stiffness, "
    "link1_mass_per_length and those of link2. May be repeated."
)


def parse_arm(items: Sequence[str] | None) -> dict[str, Any] | None:
    """Return the arm as a scenario has it, ``None`` for the thesis' one.

    Raises
    ------
    BaselineError
        A text without ``=``, an unknown name, one given twice, or no number.
    """
    if not items:
        return None
    import drm_env
    from drm_env.configuration import to_data

    arm: dict[str, Any] = to_data(drm_env.Scenario().arm)
    names = {f"{link}_{field}": (link, field) for link in arm for field in arm[link]}
    seen: set[str] = set()
    for item in items:
        name, equals, text = item.partition("=")
        name = name.strip()
        if not equals or name not in names:
            raise BaselineError(f"--arm takes KEY=VALUE with {', '.join(names)}; got {shown(item)}")
        if name in seen:
            raise BaselineError(f"--arm {name} is given twice")
        value = parse_value(text.strip())
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise BaselineError(f"--arm {name} must be a number, got {shown(text)}")
        seen.add(name)
        link, field = names[name]
        arm[link][field] = float(value)
    return arm
