"""Controllers that fly whole manoeuvres, by name."""

from __future__ import annotations

from drm_baselines.errors import PolicyError
from drm_baselines.optimal_control.lqg import LqgPilot
from drm_baselines.optimal_control.mpc import RecedingPilot


def pilot(name: str) -> LqgPilot | RecedingPilot:
    """Return who flies under the name of a controller.

    Raises
    ------
    PolicyError
        No controller has it.
    """
    if name == "lqg":
        return LqgPilot(name)
    if name == "receding":
        return RecedingPilot(name)
    raise PolicyError(f"{name!r} is no controller; there are lqg, receding")
