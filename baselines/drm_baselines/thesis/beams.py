"""Test beams of appendices B and E, which are not the arm: cantilevers, a stepped beam, a shaft.

Shape functions enter the Ritz method only by the space they span. The families (B.7) and (B.8)
span polynomials, so that orthogonal polynomials give their frequencies without the loss of
digits of the functions themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.polynomial import Legendre, Polynomial
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import brentq

_Array = NDArray[np.float64]


def _values(family: str, n: int, u: _Array) -> tuple[_Array, _Array]:
    """Functions and second derivatives at ``u``, each of shape (n, points)."""
    shapes, bends = [], []
    for order in range(n):
        if family == "B9":
            w = (order + 1) * math.pi
            sign = (-1.0) ** order
            shapes.append((1.0 - np.cos(w * u) + sign * (w * u) ** 2 / 2.0) / w**2)
            bends.append(np.cos(w * u) + sign)
            continue
        # Curvatures: u (B.7) or 1 - u (B.8) times any polynomial below degree n.
        factor = Legendre([0.5, 0.5 if family == "B7" else -0.5], domain=[0.0, 1.0])
        bend = factor * Legendre.basis(order, domain=[0.0, 1.0])
        shapes.append(bend.integ(1, lbnd=0.0).integ(1, lbnd=0.0)(u))
        bends.append(bend(u))
    return np.array(shapes), np.array(bends)


def cantilever_ritz(family: str, n: int, tip_mass: float = 0.0) -> _Array:
    """Return frequencies of a cantilever with EI = rho = L = 1 by the Ritz method, rad/s.

    Parameters
    ----------
    family
        ``"B7"``, ``"B8"`` or ``"B9"`` as numbered in appendix B.
    n
        Number of functions.
    tip_mass
        Point mass at the free end.
    """
    nodes, weights = np.polynomial.legendre.leggauss(100)
    u, w = (nodes + 1.0) / 2.0, weights / 2.0
    shapes, bends = _values(family, n, u)
    tip, _ = _values(family, n, np.array([1.0]))
    # Functions with orthonormal curvatures: the stiffness is the identity and the low frequencies
    # are the large eigenvalues of the mass, which keep their digits.
    change = np.linalg.inv(np.linalg.qr((bends * np.sqrt(w)).T, mode="r"))
    shapes, tip = change.T @ shapes, change.T @ tip
    mass = (shapes * w) @ shapes.T + tip_mass * tip @ tip.T
    inverse = np.linalg.eigvalsh(mass)
    return np.asarray(1.0 / np.sqrt(inverse[inverse > 0.0][::-1]))


def roots(
    function: Callable[[_Array], _Array], low: float, high: float, count: int, points: int
) -> _Array:
    """Return the first ``count`` sign changes of ``function`` in an interval, refined.

    Raises
    ------
    ValueError
        There are fewer.
    """
    grid = np.linspace(low, high, points)
    values = function(grid)
    places = np.nonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)[0][:count]
    if places.size < count:
        raise ValueError(f"only {places.size} of {count} roots between {low:g} and {high:g}")
    found = [
        float(brentq(lambda k: float(function(np.array([k]))[0]), grid[i], grid[i + 1], xtol=1e-13))
        for i in places
    ]
    return np.array(found)


def cantilever_exact(count: int, tip_mass: float = 0.0) -> _Array:
    """Return the exact frequencies of that cantilever, rad/s."""

    def characteristic(k: _Array) -> _Array:
        # Divided by cosh k, which keeps it of order one.
        free = 1.0 / np.cosh(k) + np.cos(k)
        return np.asarray(free + tip_mass * k * (np.cos(k) * np.tanh(k) - np.sin(k)))

    return roots(characteristic, 0.05, math.pi * (count + 1), count, 200 * (count + 1)) ** 2


def _hermite(length: float, density: float, stiffness: float) -> tuple[_Array, _Array]:
    """Mass and stiffness of a cubic beam element."""
    nodes = [Polynomial(c) for c in ([1, 0, -3, 2], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1])]
    scale = np.array([1.0, length, 1.0, length])
    mass, bend = np.empty((4, 4)), np.empty((4, 4))
    for i, p in enumerate(nodes):
        for j, q in enumerate(nodes):
            mass[i, j] = (p * q).integ()(1.0)
            bend[i, j] = (p.deriv(2) * q.deriv(2)).integ()(1.0)
    outer = np.outer(scale, scale)
    return density * length * mass * outer, stiffness / length**3 * bend * outer


def stepped_beam(
    segments: Sequence[tuple[float, float, float]],
    payload: tuple[float, float, float],
    *,
    elements: int = 8,
) -> tuple[_Array, float]:
    """Return elastic frequencies (Hz) and rigid inertia (kg m^2) of a stepped pinned beam.

    Parameters
    ----------
    segments
        Length (m), mass per length (kg/m) and bending stiffness (N m^2) from the pin outward.
    payload
        Mass (kg), inertia about its centre (kg m^2), distance of the centre from the tip (m).
    elements
        Elements a segment.
    """
    parts = [(length / elements, d, e) for length, d, e in segments for _ in range(elements)]
    size = 2 * (len(parts) + 1)
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    for index, (length, density, bending) in enumerate(parts):
        m, k = _hermite(length, density, bending)
        place = slice(2 * index, 2 * index + 4)
        mass[place, place] += m
        stiffness[place, place] += k
    heavy, inertia, offset = payload
    arm = np.array([1.0, offset])
    mass[-2:, -2:] += heavy * np.outer(arm, arm) + inertia * np.diag([0.0, 1.0])
    mass, stiffness = mass[1:, 1:], stiffness[1:, 1:]  # the pin holds the first displacement
    x = np.concatenate([[0.0], np.cumsum([part[0] for part in parts])])
    rotation = np.empty(size - 1)
    rotation[0::2], rotation[1::2] = 1.0, x[1:]
    squares: _Array = eigh(stiffness, mass, eigvals_only=True)
    return np.sqrt(squares[1:]) / (2.0 * math.pi), float(rotation @ mass @ rotation)


def torsional_stiffness(outer: float, inner: float, shear: float) -> float:
    """Return G J (N m^2) of a tube: diameters in m, shear modulus in Pa."""
    return shear * math.pi * (outer**4 - inner**4) / 32.0


def shaft(parts: Sequence[tuple[float, float, float, float]], inertia: float) -> float:
    """Return the torsional frequency (Hz) of a shaft without mass, fixed at one end.

    Parameters
    ----------
    parts
        Length, outer and inner diameter (m) and shear modulus (Pa) of each tube.
    inertia
        At the free end, kg m^2.
    """
    flexibility = sum(
        length / torsional_stiffness(outer, inner, shear) for length, outer, inner, shear in parts
    )
    return math.sqrt(1.0 / (inertia * flexibility)) / (2.0 * math.pi)
