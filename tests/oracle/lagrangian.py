"""Equations of motion of the three-coordinate deploying arm, derived numerically from energies.

Only the kinematics, the kinetic energy and the potential energy are written down here. The
Lagrangian is evaluated with second-order jets in (q, q', a, a') and Lagrange's equations

    d/dt (dL/dq'_i) - dL/dq_i = Q_i

are formed from its exact second derivatives, with d/dt taken by the chain rule along a(t). No
coefficient of the resulting equations appears in the source.

Coordinates are q = (theta, alpha, beta): the slew angle and the amplitudes of one shape
phi(u) = 3 u^2 - u^3 on each link. a is the length of link 2 outside link 1. All units are SI.

Two kinematic models are offered:

* plain: inside the integrals the deflection rate is the partial derivative at a fixed place, the
  axial velocity is dropped, and link 2 is translated but not turned by the end of link 1;
* particle following: the rate is that of the particle of link 2 which happens to be at the place.
  Link 2 and the payload are then a fixed set of particles, so Lagrange's equations hold without
  boundary terms. Of the squared axial velocity (a' - w theta')^2 the part a'^2 is left out (no
  coordinate enters it) and so is (w theta')^2, which is of second order in the deflection.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .jet import Array, Jet, constant, independent, integral

# Order of the independent variables of the Lagrangian.
_Q = slice(0, 3)
_RATE = slice(3, 6)
_LENGTH = 6
_LENGTH_RATE = 7
_VARIABLES = 8


@dataclass(frozen=True)
class Link:
    """Length (m), bending stiffness (N m^2) and mass per length (kg/m) of one link."""

    length: float
    bending_stiffness: float
    mass_per_length: float


@dataclass(frozen=True)
class Payload:
    """A rigid body fixed to the tip: mass (kg), length along the arm (m) and width (m).

    ``slender`` neglects the width in the rotary inertia.
    """

    mass: float = 0.0
    length: float = 0.0
    width: float = 0.0
    slender: bool = False

    @property
    def central_inertia(self) -> float:
        """Rotary inertia about the payload's own centre, of a uniform rectangle (kg m^2)."""
        width = 0.0 if self.slender else self.width
        return self.mass * (self.length**2 + width**2) / 12.0


@dataclass(frozen=True)
class Arm:
    """The arm with its payload, and which terms of its energies are kept."""

    link1: Link = field(default_factory=lambda: Link(7.0, 2.5e6, 100.0 / 7.0))
    link2: Link = field(default_factory=lambda: Link(8.0, 3.0e6, 75.0 / 8.0))
    payload: Payload = field(default_factory=Payload)
    axial_load: bool = True
    particle_following: bool = False


@dataclass(frozen=True)
class Deployment:
    """Length of link 2 outside link 1 (m), its rate (m/s) and its acceleration (m/s^2)."""

    length: float
    rate: float = 0.0
    accel: float = 0.0


@dataclass(frozen=True)
class Torques:
    """Slew motor, root wheel and tip wheel torques (N m).

    ``tip_turns_slew`` is false where the tip torque is to act on beta alone.
    """

    slew: float = 0.0
    root: float = 0.0
    tip: float = 0.0
    tip_turns_slew: bool = True


class Matrices(NamedTuple):
    """M, C and K, each (3, 3), in the order (theta, alpha, beta)."""

    M: Array
    C: Array
    K: Array


# The assumed shape and its derivatives with respect to u.
def _phi(u: Jet) -> Jet:
    return u * u * (3.0 - u)


def _phi_u(u: Jet) -> Jet:
    return u * (6.0 - 3.0 * u)


def _phi_uu(u: Jet) -> Jet:
    return 6.0 - 6.0 * u


class _State:
    """Independent variables as jets, and the kinematic quantities the energies are made of.

    ``q`` and ``q_rate`` are (..., 3); leading axes hold several states at once.
    """

    def __init__(self, arm: Arm, q: Array, q_rate: Array, deployment: Deployment) -> None:
        variables = independent(
            [
                *np.moveaxis(q, -1, 0),
                *np.moveaxis(q_rate, -1, 0),
                deployment.length,
                deployment.rate,
            ]
        )
        self.arm = arm
        _, self.alpha, self.beta = variables[_Q]
        self.theta_rate, self.alpha_rate, self.beta_rate = variables[_RATE]
        self.a = variables[_LENGTH]
        self.a_rate = variables[_LENGTH_RATE]
        self.a_accel = deployment.accel
        states = self.a.value.shape
        self.zero = constant(np.zeros(states), _VARIABLES)
        self.l1 = constant(np.full(states, arm.link1.length), _VARIABLES)
        # Distance from the shoulder at which link 2 begins, inside link 1.
        self.overlap_start = self.l1 + self.a - arm.link2.length
        one = constant(1.0, _VARIABLES)
        self.end1 = self.alpha * _phi(one)
        self.end1_rate = self.alpha_rate * _phi(one)
        self.tip = self.end1 + self.beta * _phi(one)
        self.tip_rate = self.end1_rate + self.beta_rate * _phi(one)
        # The slope beta phi_u(1) / a also changes because the length below it does.
        self.tip_slope = self.beta * _phi_u(one) / self.a
        self.tip_slope_rate = (
            self.beta_rate * _phi_u(one) / self.a - self.tip_slope * self.a_rate / self.a
        )

    def inside(self, x: Jet) -> tuple[Jet, Jet, Jet]:
        """Deflection, its rate at a fixed place and its slope, x from the shoulder, x < L1."""
        u = x / self.l1
        return self.alpha * _phi(u), self.alpha_rate * _phi(u), self.alpha * _phi_u(u) / self.l1

    def outside(self, x: Jet) -> tuple[Jet, Jet, Jet]:
        """Deflection, its rate at a fixed place and its slope, x from the end of link 1."""
        u = x / self.a
        slope = self.beta * _phi_u(u) / self.a
        # At a fixed x the argument u = x / a falls as a grows.
        rate = self.beta_rate * _phi(u) - slope * u * self.a_rate
        return self.end1 + self.beta * _phi(u), self.end1_rate + rate, slope


def _link1_kinetic(s: _State) -> Jet:
    def density(x: Jet) -> Jet:
        return (x * s.theta_rate + s.inside(x)[1]).square()

    return integral(density, s.zero, s.l1) * (0.5 * s.arm.link1.mass_per_length)


def _link2_kinetic(s: _State) -> Jet:
    def density(xi: Jet, deflection: Jet, rate: Jet, slope: Jet) -> Jet:
        if not s.arm.particle_following:
            return (xi * s.theta_rate + rate).square()
        transverse = xi * s.theta_rate + rate + s.a_rate * slope
        return transverse.square() - 2.0 * s.a_rate * s.theta_rate * deflection

    def inside(x: Jet) -> Jet:
        return density(x, *s.inside(x))

    def outside(x: Jet) -> Jet:
        return density(s.l1 + x, *s.outside(x))

    total = integral(inside, s.overlap_start, s.l1) + integral(outside, s.zero, s.a)
    return total * (0.5 * s.arm.link2.mass_per_length)


def _payload_kinetic(s: _State) -> Jet:
    payload = s.arm.payload
    offset = 0.5 * payload.length
    transverse = (s.l1 + s.a + offset) * s.theta_rate + s.tip_rate + offset * s.tip_slope_rate
    turning = s.theta_rate + s.tip_slope_rate
    squared = transverse.square()
    if s.arm.particle_following:
        squared = squared - 2.0 * s.a_rate * s.theta_rate * (s.tip + offset * s.tip_slope)
    return 0.5 * payload.mass * squared + 0.5 * payload.central_inertia * turning.square()


def _bending_potential(s: _State) -> Jet:
    link1, link2 = s.arm.link1, s.arm.link2

    def curvature1(x: Jet) -> Jet:
        return (s.alpha * _phi_uu(x / s.l1) / (s.l1 * s.l1)).square()

    def curvature2(x: Jet) -> Jet:
        return (s.beta * _phi_uu(x / s.a) / (s.a * s.a)).square()

    return 0.5 * (
        link1.bending_stiffness * integral(curvature1, s.zero, s.l1)
        + link2.bending_stiffness * integral(curvature1, s.overlap_start, s.l1)
        + link2.bending_stiffness * integral(curvature2, s.zero, s.a)
    )


def _axial_potential(s: _State) -> Jet:
    """Work of the axial force (tension positive) on the shortening of link 2.

    As in the source model, the distance eta in the centrifugal part restarts at the end of link 1
    and the payload's mass is taken at the far end of the payload.
    """
    density = s.arm.link2.mass_per_length

    def pull(eta: Jet) -> Jet:
        return eta * s.theta_rate.square() - s.a_accel

    def payload_pull() -> Jet:
        return s.arm.payload.mass * pull(s.a + s.arm.payload.length)

    def tension_outside(x: Jet) -> Jet:
        return density * integral(pull, x, s.a) + payload_pull()

    def tension_inside(x: Jet) -> Jet:
        inner = density * integral(pull, x, s.l1)
        return inner + density * integral(pull, s.zero, s.a) + payload_pull()

    def inside(x: Jet) -> Jet:
        return tension_inside(x) * s.inside(x)[2].square()

    def outside(x: Jet) -> Jet:
        return tension_outside(x) * s.outside(x)[2].square()

    return 0.5 * (integral(inside, s.overlap_start, s.l1) + integral(outside, s.zero, s.a))


def _kinetic(s: _State) -> Jet:
    return _link1_kinetic(s) + _link2_kinetic(s) + _payload_kinetic(s)


def _potential(s: _State) -> Jet:
    bending = _bending_potential(s)
    return bending + _axial_potential(s) if s.arm.axial_load else bending


def _mass_and_remainder(lagrangian: Jet, q_rate: Array, d: Deployment) -> tuple[Array, Array]:
    """Split Lagrange's left-hand side into mass (..., 3, 3) times q'' and the rest (..., 3).

    The dependence of L on a'' is not followed: only the part of V that is free of the rates
    contains a'', so dL/dq' does not.
    """
    momentum_slopes = lagrangian.hessian[..., _RATE, :]
    remainder = (
        np.einsum("...ij,...j->...i", momentum_slopes[..., _Q], q_rate)
        + momentum_slopes[..., _LENGTH] * d.rate
        + momentum_slopes[..., _LENGTH_RATE] * d.accel
        - lagrangian.gradient[..., _Q]
    )
    return momentum_slopes[..., _RATE], remainder


def matrices(arm: Arm, deployment: Deployment, slew_rate: float = 0.0) -> Matrices:
    """Coefficient matrices of M q'' + C q' + K q.

    T and the bending energy are quadratic, so the columns of C and K are the left-hand sides at
    unit rates and unit coordinates. The axial potential adds to K its second derivatives with
    respect to the coordinates at the given slew rate (rad/s).
    """
    unit, none = np.eye(3), np.zeros((3, 3))
    q_rate = np.concatenate([unit, none])
    s = _State(arm, np.concatenate([none, unit]), q_rate, deployment)
    mass, columns = _mass_and_remainder(_kinetic(s) - _bending_potential(s), q_rate, deployment)
    stiffness = columns[3:].T
    if arm.axial_load:
        s = _State(arm, np.zeros(3), np.array([slew_rate, 0.0, 0.0]), deployment)
        stiffness = stiffness + _axial_potential(s).hessian[_Q, _Q]
    return Matrices(mass[0], columns[:3].T, stiffness)


def generalised_forces(arm: Arm, deployment: Deployment, torques: Torques) -> Array:
    """Forces (3,) from the virtual work of the torques.

    The slew motor and the root wheel turn the arm through d(theta); the tip wheel turns the tip
    through d(theta) + d(tip slope).
    """
    slope = _State(arm, np.zeros(3), np.zeros(3), deployment).tip_slope.gradient[_Q]
    theta = np.array([1.0, 0.0, 0.0])
    tip = slope + theta if torques.tip_turns_slew else slope
    return (torques.slew + torques.root) * theta + torques.tip * tip


def equations(
    arm: Arm, q: Array, q_rate: Array, deployment: Deployment, torques: Torques | None = None
) -> tuple[Array, Array]:
    """Mass (3, 3) and right-hand side (3,) of the full nonlinear equations at a state."""
    s = _State(arm, q, q_rate, deployment)
    mass, remainder = _mass_and_remainder(_kinetic(s) - _potential(s), q_rate, deployment)
    return mass, generalised_forces(arm, deployment, torques or Torques()) - remainder


def acceleration(
    arm: Arm, q: Array, q_rate: Array, deployment: Deployment, torques: Torques | None = None
) -> Array:
    """Second derivatives (3,) of the coordinates."""
    mass, right_hand_side = equations(arm, q, q_rate, deployment, torques)
    return np.asarray(np.linalg.solve(mass, right_hand_side), dtype=np.float64)


def energies(arm: Arm, q: Array, q_rate: Array, deployment: Deployment) -> tuple[float, float]:
    """Kinetic and potential energy (J), with L = T - V as in the equations of motion.

    The part of the axial potential that goes with the square of the slew rate counts as (negative)
    kinetic energy: then T + V is what is conserved at a fixed length (Jacobi's integral).
    """
    s = _State(arm, q, q_rate, deployment)
    at_rest = _State(arm, q, np.array([0.0, q_rate[1], q_rate[2]]), deployment)
    static = float(_potential(at_rest).value)
    return float(_kinetic(s).value) - (float(_potential(s).value) - static), static


def potential(arm: Arm, q: Array, q_rate: Array, deployment: Deployment) -> float:
    """V of L = T - V (J): bending and the whole axial load, its centrifugal part included."""
    return float(_potential(_State(arm, q, q_rate, deployment)).value)


def angular_momentum(arm: Arm, q: Array, q_rate: Array, deployment: Deployment) -> float:
    """dL/dtheta' (kg m^2/s)."""
    s = _State(arm, q, q_rate, deployment)
    return float((_kinetic(s) - _potential(s)).gradient[_RATE][0])
