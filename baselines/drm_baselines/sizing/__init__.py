"""How strong an arm has to be: what drawn missions need, and what less would do to them."""

from drm_baselines.sizing.missions import Missions, corners
from drm_baselines.sizing.requirements import (
    NEEDS,
    Check,
    Need,
    Requirement,
    check,
    fewest_missions,
    fly_needs,
    requirements,
)
from drm_baselines.sizing.sweep import SweepPoint, sweep

__all__ = [
    "NEEDS",
    "Check",
    "Missions",
    "Need",
    "Requirement",
    "SweepPoint",
    "check",
    "corners",
    "fewest_missions",
    "fly_needs",
    "requirements",
    "sweep",
]
