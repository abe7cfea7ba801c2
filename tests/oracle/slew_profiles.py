"""The thesis' four slew profiles once more: pieces of the acceleration, integrated as polynomials.

Over u = t / t_f with a largest acceleration of one; the smooth step is 3 u^2 - 2 u^3 (section 3.2).
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

_STEP = Polynomial([0.0, 0.0, 3.0, -2.0])


def accelerations(profile: str, phi: float) -> list[tuple[float, Polynomial]]:
    """Starts of the pieces, and each as a polynomial of the distance from its start."""

    def step(length: float) -> Polynomial:
        return _STEP(Polynomial([0.0, 1.0 / length]))

    if profile == "min_time":
        if phi == 0.0:
            return [(0.0, Polynomial([1.0])), (0.5, Polynomial([-1.0]))]
        return [
            (0.0, step(phi)),
            (phi, Polynomial([1.0])),
            (0.5 - phi, 1.0 - 2.0 * step(2.0 * phi)),
            (0.5 + phi, Polynomial([-1.0])),
            (1.0 - phi, step(phi) - 1.0),
        ]
    ramp = Polynomial([1.0, -2.0 / (1.0 - 2.0 * phi)])
    if phi == 0.0:
        return [(0.0, ramp)]
    return [(0.0, step(phi)), (phi, ramp), (1.0 - phi, step(phi) - 1.0)]


def motion(profile: str, phi: float, u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Acceleration, rate and angle at places below 1 of a slew of unit angle, a row each."""
    pieces = accelerations(profile, phi)
    starts = [start for start, _ in pieces]
    found = np.zeros((3, u.size))
    rate = angle = 0.0
    for (start, acceleration), end in zip(pieces, [*starts[1:], 1.0], strict=True):
        rates = acceleration.integ(k=rate)
        angles = rates.integ(k=angle)
        here = (u >= start) & (u < end)
        for row, series in zip(found, (acceleration, rates, angles), strict=True):
            row[here] = series(u[here] - start)
        rate, angle = rates(end - start), angles(end - start)
    return found / angle
