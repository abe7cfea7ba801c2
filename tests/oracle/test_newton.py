"""The derivation from energies against Newton's law, particle by particle.

Nothing below uses the energies: accelerations come from differentiating each particle's place
twice in time (jets in the single variable t), the axial load from the work done on each
particle's shortening. Terms of second order in the deflection that the kinetic energy leaves out
are left out here as well.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from .jet import Array, Jet, constant, independent
from .lagrangian import Arm, Deployment, Link, Payload, equations, potential

PHI = Polynomial([0.0, 0.0, 3.0, -1.0])
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


def in_time(value: float | Array, rate: float, accel: float) -> Jet:
    """A quantity as a jet in t, so that its Hessian is the second time derivative."""
    array = np.asarray(value, dtype=np.float64)
    shape = array.shape
    return Jet(array, np.full((*shape, 1), rate), np.full((*shape, 1, 1), accel))


def shape_of(u: Jet) -> Jet:
    return u * u * (3.0 - u)


def slope_of(u: Jet) -> Jet:
    return u * (6.0 - 3.0 * u)


def random_arm(rng: np.random.Generator) -> tuple[Arm, Deployment]:
    length1 = rng.uniform(5.0, 9.0)
    length2 = rng.uniform(length1 - 3.0, length1 + 1.5)
    payload = Payload(rng.uniform(0.0, 500.0), rng.uniform(0.1, 3.0), rng.uniform(0.1, 2.0))
    extension = rng.uniform(max(1.0, length2 - length1), length2)
    arm = Arm(
        Link(length1, 0.0, rng.uniform(3.0, 30.0)),
        Link(length2, 0.0, rng.uniform(3.0, 30.0)),
        payload,
    )
    return arm, Deployment(extension, *rng.uniform(-2.0, 2.0, 2))


def newton_left_hand_side(
    arm: Arm, q: Array, q_rate: Array, q_accel: Array, d: Deployment
) -> tuple[Array, Array]:
    """Virtual work of (mass times acceleration), and the sum of the magnitudes of its parts.

    A particle at (xi, w) in the turning axes has the transverse acceleration
    w'' + xi theta'' + 2 xi' theta' and the axial acceleration xi'' (to first order); turning the
    axes moves it by (-w, xi).
    """
    theta, alpha, beta = (in_time(*state) for state in zip(q, q_rate, q_accel, strict=True))
    theta_rate, theta_accel = theta.gradient[0], theta.hessian[0, 0]
    length1, length2 = arm.link1.length, arm.link2.length
    a = in_time(d.length, d.rate, d.accel)
    parts: list[Array] = []

    def add(mass: Array | float, xi: Jet, w: Jet, rows: tuple[Array | float, ...]) -> None:
        transverse = (
            w.hessian[..., 0, 0] + xi.value * theta_accel + 2.0 * xi.gradient[..., 0] * theta_rate
        )
        axial = xi.hessian[..., 0, 0]
        parts.append(
            np.array(
                [
                    np.sum(mass * (xi.value * transverse - w.value * axial)),
                    np.sum(mass * rows[0] * transverse),
                    np.sum(mass * rows[1] * transverse),
                ]
            )
        )

    def span(lower: float, upper: float) -> tuple[Array, Array]:
        half = 0.5 * (upper - lower)
        return 0.5 * (upper + lower) + half * NODES, half * WEIGHTS

    x, weights = span(0.0, length1)
    u = in_time(x / length1, 0.0, 0.0)
    xi = in_time(x, 0.0, 0.0)
    add(arm.link1.mass_per_length * weights, xi, alpha * shape_of(u), (PHI(x / length1), 0.0))

    x, weights = span(length1 + d.length - length2, length1)
    xi = in_time(x, d.rate, d.accel)
    w = alpha * shape_of(xi / length1)
    add(arm.link2.mass_per_length * weights, xi, w, (PHI(x / length1), 0.0))

    x, weights = span(0.0, d.length)
    xi = in_time(length1 + x, d.rate, d.accel)
    w = alpha * PHI(1.0) + beta * shape_of((xi - length1) / a)
    add(arm.link2.mass_per_length * weights, xi, w, (PHI(1.0), PHI(x / d.length)))

    # Link 2 is not turned by link 1's end: particles that pass the joint lose, in an instant,
    # the transverse speed that the slope of link 1 had given them.
    lost = -d.rate * float(alpha.value) * PHI.deriv()(1.0) / length1
    stream = arm.link2.mass_per_length * d.rate * lost
    parts.append(stream * np.array([length1, PHI(1.0), 0.0]))

    mass, offset = arm.payload.mass, 0.5 * arm.payload.length
    slope = beta * slope_of(constant(1.0, 1)) / a
    slope_row = PHI.deriv()(1.0) / d.length
    w = (alpha + beta) * PHI(1.0) + offset * slope
    xi = in_time(length1 + d.length + offset, d.rate, d.accel)
    add(mass, xi, w, (PHI(1.0), PHI(1.0) + offset * slope_row))
    turning = float(slope.hessian[0, 0]) + theta_accel
    parts.append(arm.payload.central_inertia * turning * np.array([1.0, 0.0, slope_row]))

    return np.sum(parts, axis=0), np.sum(np.abs(parts), axis=0)


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("deploying", [True, False])
def test_lagrange_equations_equal_newtons_law_for_particles(seed: int, deploying: bool) -> None:
    rng = np.random.default_rng([seed, 1])
    arm, d = random_arm(rng)
    if not deploying:
        d = Deployment(d.length)
    arm = Arm(arm.link1, arm.link2, arm.payload, axial_load=False, particle_following=deploying)
    q, q_rate, q_accel = rng.uniform(-1.0, 1.0, (3, 3))
    mass, right_hand_side = equations(arm, q, q_rate, d)
    expected, magnitude = newton_left_hand_side(arm, q, q_rate, q_accel, d)
    error = np.abs(mass @ q_accel - right_hand_side - expected)
    assert np.all(error <= 1e-12 * magnitude), error / magnitude


@pytest.mark.parametrize("seed", range(40))
def test_axial_potential_equals_work_on_the_shortening_of_each_particle(seed: int) -> None:
    rng = np.random.default_rng([seed, 2])
    arm, d = random_arm(rng)
    q, q_rate = rng.uniform(-1.0, 1.0, (2, 3))
    length1, density = arm.link1.length, arm.link2.mass_per_length
    start = length1 + d.length - arm.link2.length

    def pull(eta: float | Array) -> Array:
        return np.asarray(-d.accel + eta * q_rate[0] ** 2)

    slope1 = (q[1] * PHI.deriv() / length1) ** 2
    slope2 = (q[2] * PHI.deriv() / d.length) ** 2
    # d/du = L d/dx, so the antiderivative in x is L times that in u = x / L.
    shortening1 = 0.5 * length1 * slope1.integ(lbnd=start / length1)
    shortening2 = 0.5 * d.length * slope2.integ()
    at_joint, at_tip = shortening1(1.0), shortening1(1.0) + shortening2(1.0)

    half1, half2 = 0.5 * (length1 - start), 0.5 * d.length
    x1, x2 = 0.5 * (length1 + start) + half1 * NODES, half2 * (1.0 + NODES)
    expected = [
        density * half1 * np.sum(WEIGHTS * pull(x1) * shortening1(x1 / length1)),
        density * half2 * np.sum(WEIGHTS * pull(x2) * (at_joint + shortening2(x2 / d.length))),
        arm.payload.mass * pull(d.length + arm.payload.length) * at_tip,
    ]
    # The links have no bending stiffness here, so all of the potential is axial.
    assert abs(potential(arm, q, q_rate, d) - np.sum(expected)) <= 1e-12 * np.sum(np.abs(expected))


def test_jets_equal_hand_differentiated_functions() -> None:
    x, y = independent([0.7, -1.3])
    jet = x * y / (2.0 - x) - y.square() / x + 3.0 * (1.0 / y)
    u, v = 0.7, -1.3
    assert jet.value == pytest.approx(u * v / (2 - u) - v**2 / u + 3 / v, rel=1e-14)
    gradient = [2 * v / (2 - u) ** 2 + v**2 / u**2, u / (2 - u) - 2 * v / u - 3 / v**2]
    np.testing.assert_allclose(jet.gradient, gradient, rtol=1e-14)
    mixed = 2 / (2 - u) ** 2 + 2 * v / u**2
    hessian = [[4 * v / (2 - u) ** 3 - 2 * v**2 / u**3, mixed], [mixed, -2 / u + 6 / v**3]]
    np.testing.assert_allclose(jet.hessian, hessian, rtol=1e-14)
