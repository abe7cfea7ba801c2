"""A linear-quadratic regulator, scheduled over extension and reported mass.

For each mass and extension of a grid the arm at rest is linearised (:class:`drm_env.Model`),
link 1 taken as rigid, since its deflection is not measured, and the discrete regulator for the
law's sampling period solved. Its gains, smooth over the grid, are fitted by the polynomials of
the engine's ``scheduled`` law. What is weighed are the error of the tip, its rate, the
deflection rate of link 2 and the torques; the weights are tuned like the gains of the other
laws.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.optimal_control.quadratic_program import torque_limits
from drm_env.constants import (
    LAW_PERIOD,
    LINK_END_DEFLECTION,
    SCHEDULED_EXTENSION_SCALE,
    SCHEDULED_MASS_SCALE,
)

MASSES = (50.0, 125.0, 200.0, 350.0, 500.0)
"""Reported masses of the grid, kg: Table 2-7 and between."""
EXTENSIONS = tuple(float(a) for a in np.linspace(1.0, 8.0, 8))
"""Extensions of the grid, m."""

_GAINS = ("angle_gain", "rate_gain", "deflection_gain", "deflection_rate_gain")


def gains_at(
    mass: float,
    extension: float,
    *,
    root_effort: float,
    tip_effort: float,
    rate: float,
    vibration: float,
) -> NDArray[np.float64]:
    """Return the regulator's gains at one mass (kg) and extension (m), shape (2, 4).

    Rows are root and tip wheel; columns multiply the slew error (rad), its rate, the deflection of
    link 2's tip (m) and its rate.

    Parameters
    ----------
    mass, extension
        Where the arm is linearised.
    root_effort, tip_effort
        Weight of a wheel's full torque against 1 mm of tip error.
    rate
        Weight of 1 mm/s of the tip's error rate, likewise.
    vibration
        Weight of 1 mm/s of the deflection rate of link 2's tip, likewise.

    Raises
    ------
    BaselineError
        The regulator has no solution.
    """
    matrices = drm_env.Model({"mass": mass}).matrices(extension)
    kept = np.ix_([0, 2], [0, 2])
    inertia, stiffness = matrices.M[kept], matrices.K[kept]
    limits = torque_limits({})
    force = np.array([[1.0, 1.0], [0.0, 3.0 / extension]]) * limits
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2:, :2] = -np.linalg.solve(inertia, stiffness)
    b = np.vstack([np.zeros((2, 2)), np.linalg.solve(inertia, force)])
    ad, bd, *_ = signal.cont2discrete((a, b, np.eye(4), np.zeros((4, 2))), LAW_PERIOD)
    reach = drm_env.default_config().scenario.arm.link1.length + extension
    rows = 1e3 * np.array(
        [
            [reach, LINK_END_DEFLECTION, 0.0, 0.0],
            [0.0, 0.0, rate * reach, LINK_END_DEFLECTION * rate],
            [0.0, 0.0, 0.0, LINK_END_DEFLECTION * vibration],
        ]
    )
    weight = rows.T @ rows
    try:
        cost = linalg.solve_discrete_are(ad, bd, weight, np.diag([root_effort**2, tip_effort**2]))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise BaselineError(f"no regulator for {mass} kg at {extension} m: {error}") from error
    gain = np.linalg.solve(
        np.diag([root_effort**2, tip_effort**2]) + bd.T @ cost @ bd, bd.T @ cost @ ad
    )
    # the state is (e, beta, e', beta'); the law is told the deflection of link 2's end and its rate
    told = np.array([1.0, 1.0, 1.0 / LINK_END_DEFLECTION, 1.0 / LINK_END_DEFLECTION])
    return np.asarray(limits[:, None] * gain[:, [0, 2, 1, 3]] * told)


def scheduled_law(weights: Mapping[str, float]) -> dict[str, Any]:
    """Return the engine's ``scheduled`` law for a choice of weights, see :func:`gains_at`.

    Raises
    ------
    BaselineError
        The regulator has no solution.
    """
    grid = [(mass, extension) for mass in MASSES for extension in EXTENSIONS]
    gains = np.array([gains_at(mass, extension, **weights) for mass, extension in grid])
    powers = np.array(
        [
            [
                (mass / SCHEDULED_MASS_SCALE) ** i * (extension / SCHEDULED_EXTENSION_SCALE) ** j
                for i in range(3)
                for j in range(4)
            ]
            for mass, extension in grid
        ]
    )
    law: dict[str, Any] = {"name": "scheduled"}
    for row, wheel in enumerate(("root", "tip")):
        law[wheel] = {}
        for column, name in enumerate(_GAINS):
            # relative errors count, for gains grow tenfold with the extension
            values = gains[:, row, column]
            scale = 1.0 / (np.abs(values) + 0.05 * np.abs(values).max() + 1e-12)
            fit, *_ = np.linalg.lstsq(powers * scale[:, None], values * scale, rcond=None)
            law[wheel][name] = fit.reshape(3, 4).tolist()
    return law
