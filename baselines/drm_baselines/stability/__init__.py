"""Whether a law keeps the arm stable: poles of the sampled loop over lengths and payloads."""

from drm_baselines.stability.closed_loop import (
    STABLE,
    Loop,
    StabilityMap,
    Stepped,
    closed_loop,
    growth_rate,
    stability_map,
)

__all__ = [
    "STABLE",
    "Loop",
    "StabilityMap",
    "Stepped",
    "closed_loop",
    "growth_rate",
    "stability_map",
]
