"""The characteristic equation of the arm with a rigid link 1 (thesis section 2.3.3).

With y = -C0 (L1 + x) + C1 sin kx + C2 cos kx + C3 sinh kx + C4 cosh kx the displacement of link 2
from the rotating axis, five boundary conditions make a determinant of k, and its zeros give the
frequencies k^2 sqrt(EI2 / rho2). The engine has the same frequencies as plant
``exact_rigid_link1``; here is the function itself, which figures 2.4 to 2.9 show.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drm_baselines.thesis.arm import LINK1, LINK2, inertia_about_tip, payload
from drm_baselines.thesis.beams import roots

_Array = NDArray[np.float64]


def conditions(
    k: _Array, name: str, a: float, *, as_published: bool, mass_factor: float = 1.0
) -> _Array:
    """Return the boundary conditions as matrices on (C0, ..., C4), shape (len(k), 5, 5).

    Parameters
    ----------
    k
        Wave numbers, 1/m.
    name
        Payload.
    a
        Length of link 2 outside link 1, m.
    as_published
        Leave out the two terms of the payload's slope that the thesis leaves out: without them
        the payload's centre of mass does not follow the rotation of the tip.
    mass_factor
        By which the payload's mass and inertia are multiplied.
    """
    load = payload(name)
    Mp, Lp = mass_factor * load["mass"], load["length"]
    J = mass_factor * inertia_about_tip(name)
    L1, rho2 = LINK1.length, LINK2.mass_per_length
    c, R = L1 + a - LINK2.length, L1 + a
    s, co, sh, ch = np.sin(k * a), np.cos(k * a), np.sinh(k * a), np.cosh(k * a)
    zero, one = np.zeros_like(k), np.ones_like(k)
    Y = np.stack([zero, s, co, sh, ch], axis=-1)
    S = np.stack([zero, k * co, -k * s, k * ch, k * sh], axis=-1)
    kk = (k**2)[:, None]
    curvature = kk * np.stack([zero, -s, -co, sh, ch], axis=-1)
    shear = kk * np.stack([zero, -k * co, k * s, k * ch, k * sh], axis=-1)
    # mu EI2-free: omega^2 / EI2 = k^4 / rho2
    mu = (k**4 / rho2)[:, None]
    slope = 0.0 if as_published else 1.0
    moment = np.stack(
        [
            zero,
            -R * co / k + s / k**2 + L1 / k,
            R * s / k + co / k**2 - 1.0 / k**2,
            R * ch / k - sh / k**2 - L1 / k,
            R * sh / k - ch / k**2 + 1.0 / k**2,
        ],
        axis=-1,
    )
    inner = LINK1.mass_per_length * L1**3 / 3.0 + rho2 * (L1**3 - c**3) / 3.0
    hub = np.stack([inner * one, zero, zero, zero, zero], axis=-1)
    overhang = np.stack([one, zero, zero, zero, zero], axis=-1) if as_published else S
    rows = [
        np.stack([-L1 * one, zero, one, zero, one], axis=-1),
        np.stack([-one, k, zero, k, zero], axis=-1),
        curvature - mu * (J * S + Mp * Lp / 2.0 * Y),
        shear + mu * (Mp * Y + slope * Mp * Lp / 2.0 * S),
        hub + rho2 * moment + J * S + Mp * (R + Lp / 2.0) * Y + Mp * Lp / 2.0 * R * overhang,
    ]
    return np.stack(rows, axis=-2)


def function(
    k: _Array, name: str, a: float, *, as_published: bool = True, mass_factor: float = 1.0
) -> _Array:
    """Return the characteristic function f(k), shape of ``k``; arguments as for `conditions`."""
    matrices = conditions(k, name, a, as_published=as_published, mass_factor=mass_factor)
    return np.asarray(np.linalg.det(matrices))


def wave_numbers(
    name: str, a: float, count: int, *, as_published: bool = True, mass_factor: float = 1.0
) -> _Array:
    """Return the first ``count`` zeros of f above zero, 1/m."""
    found = roots(
        lambda k: function(k, name, a, as_published=as_published, mass_factor=mass_factor),
        0.05 / a,
        math.pi * (count + 1.5) / a,
        count,
        2000,
    )
    return np.asarray(found)


def frequencies(
    name: str, a: float, count: int, *, as_published: bool = True, mass_factor: float = 1.0
) -> _Array:
    """Return the first natural frequencies, Hz; arguments as for `conditions`."""
    k = wave_numbers(name, a, count, as_published=as_published, mass_factor=mass_factor)
    speed = math.sqrt(LINK2.bending_stiffness / LINK2.mass_per_length)
    return np.asarray(k**2 * speed / (2.0 * math.pi))


def shapes(name: str, a: float, count: int, x: _Array, *, as_published: bool = True) -> _Array:
    """Return elastic displacements of link 2 in the first modes, largest 1, (count, len(x))."""
    k = wave_numbers(name, a, count, as_published=as_published)
    found = []
    for one, matrix in zip(k, conditions(k, name, a, as_published=as_published), strict=True):
        scale = np.abs(matrix).max(axis=1, keepdims=True)
        C = np.linalg.svd(matrix / scale)[2][-1]
        y = (
            -C[0] * (LINK1.length + x)
            + C[1] * np.sin(one * x)
            + C[2] * np.cos(one * x)
            + C[3] * np.sinh(one * x)
            + C[4] * np.cosh(one * x)
        )
        found.append(y / y[np.argmax(np.abs(y))])
    return np.array(found)
