"""The arm and payloads of the thesis, and models of them."""

from __future__ import annotations

import functools
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_env.constants import TABLE_2_7

PAYLOADS: dict[str, tuple[float, float, float]] = dict(
    zip(("PNone", "P0", "P1", "P2", "P3"), TABLE_2_7, strict=True)
)
"""Mass (kg), length along the arm and width (m) of the payloads of table 2-7."""

PAYLOAD_TITLES = {
    "PNone": "no payload",
    "P0": "Payload 0",
    "P1": "Payload 1",
    "P2": "Payload 2",
    "P3": "Payload 3",
}

_SCENARIO = drm_env.Scenario()
LINK1 = _SCENARIO.arm.link1
LINK2 = _SCENARIO.arm.link2


class PayloadData(TypedDict):
    """A payload as `drm_env` takes it."""

    mass: float
    length: float
    width: float
    inertia: str


def payload(name: str, inertia: str = "full") -> PayloadData:
    """Return a payload of table 2-7; ``inertia`` is ``"full"`` or ``"slender"``."""
    mass, length, width = PAYLOADS[name]
    return {"mass": mass, "length": length, "width": width, "inertia": inertia}


def inertia_about_tip(name: str, inertia: str = "full") -> float:
    """Return the payload's inertia about the point where it is held, kg m^2."""
    mass, length, width = PAYLOADS[name]
    return mass * (4.0 * length**2 + (width**2 if inertia == "full" else 0.0)) / 12.0


@functools.cache
def model(name: str, inertia: str = "full", plant: str = "thesis", **options: Any) -> drm_env.Model:
    """Return the arm with a payload; ``options`` as for `drm_env.Model`."""
    return drm_env.Model(dict(payload(name, inertia)), plant=plant, **options)


def frequencies(
    name: str, a: float, inertia: str = "full", plant: str = "thesis", **options: Any
) -> NDArray[np.float64]:
    """Return natural frequencies at a frozen length ``a`` (m), rising, Hz."""
    return model(name, inertia, plant, **options).natural_frequencies(a)
