"""The deploying arm's equations of motion against a derivation from the energies.

Every expected number comes from ``oracle.lagrangian``: Lagrange's equations formed from the
kinetic and potential energies by Gauss-Legendre quadrature and exact differentiation. The oracle
shares no formula with the engine and is itself held against Newton's law in ``oracle``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import drm_env
from oracle import lagrangian
from oracle.jet import Array
from oracle.lagrangian import Arm, Deployment, Link, Payload, Torques

TOLERANCE = 1e-9
# Of bending stiffness alone; far below the deployment terms it shares an entry of K with.
STIFFNESS_TOLERANCE = 1e-11

STANDARD_PAYLOADS = {
    "none": (0.0, 0.0, 0.0),
    "payload-0": (50.0, 0.10, 0.10),
    "payload-1": (200.0, 1.0, 0.5),
    "payload-2": (350.0, 1.5, 0.75),
    "payload-3": (500.0, 2.0, 1.0),
}


@dataclass(frozen=True)
class Case:
    """One arm in one state of motion."""

    arm: Arm
    deployment: Deployment
    q: Array
    q_rate: Array
    torques: Torques


def random_case(seed: int) -> Case:
    """An arm and a state drawn at random.

    Each seed picks one combination of (axial load, particle following), a third of the payloads
    are slender and every seventh arm carries none. Deflections are exaggerated and the stiffness
    reaches down to nearly nothing, so that no small term hides behind a large one.
    """
    rng = np.random.default_rng(seed)
    length1 = rng.uniform(5.0, 9.0)
    length2 = rng.uniform(max(4.0, length1 - 3.0), length1 + 1.5)
    payload = Payload()
    if seed % 7:
        mass, length, width = rng.uniform([1.0, 0.05, 0.05], [500.0, 3.0, 2.0])
        payload = Payload(mass, length, width, slender=seed % 3 == 0)
    arm = Arm(
        Link(length1, 10.0 ** rng.uniform(0.0, 7.0), rng.uniform(3.0, 30.0)),
        Link(length2, 10.0 ** rng.uniform(0.0, 7.0), rng.uniform(3.0, 30.0)),
        payload,
        axial_load=seed % 2 == 0,
        particle_following=seed // 2 % 2 == 0,
    )
    lowest, highest = max(1.0, length2 - length1 + 0.01), min(8.0, length2 - 0.01)
    deployment = Deployment(rng.uniform(lowest, highest), *rng.uniform(-2.0, 2.0, 2))
    q, q_rate = rng.uniform([-2.0, -0.5, -0.5], [2.0, 0.5, 0.5]), rng.uniform(-1.0, 1.0, 3)
    slew, root, tip = rng.uniform(-1.0, 1.0, 3) * [2000.0, 100.0, 10.0]
    torques = Torques(slew, root, tip, tip_turns_slew=seed // 4 % 2 == 0)
    return Case(arm, deployment, q, q_rate, torques)


def payload_table(payload: Payload) -> dict[str, Any]:
    return {
        "mass": payload.mass,
        "length": payload.length,
        "width": payload.width,
        "inertia": "slender" if payload.slender else "full",
    }


def engine_model(arm: Arm, *, tip_turns_slew: bool = True) -> drm_env.Model:
    links = {
        name: {
            "length": link.length,
            "bending_stiffness": link.bending_stiffness,
            "mass_per_length": link.mass_per_length,
        }
        for name, link in (("link1", arm.link1), ("link2", arm.link2))
    }
    return drm_env.Model(
        payload=payload_table(arm.payload),
        arm=links,
        plant="thesis",
        dynamics={
            "axial_load": arm.axial_load,
            "particle_following": arm.particle_following,
            "tip_torque": "slew_and_tip" if tip_turns_slew else "tip_only",
            "structural_damping": 0.0,
        },
    )


def assert_within(actual: Array, expected: Array, allowed: Array) -> None:
    actual = np.asarray(actual)
    assert actual.shape == expected.shape
    assert np.all(np.isfinite(actual))
    error = np.abs(actual - expected)
    assert np.all(error <= allowed), f"\n{actual=}\n{expected=}\n{error=}\n{allowed=}"


def assert_same_matrices(model: drm_env.Model, arm: Arm, d: Deployment, slew_rate: float) -> None:
    """Compare entry by entry, at 1e-9 of what an entry of its row and column can amount to.

    The yardstick is sqrt(M_ii M_jj), times a'/a for C and times a'^2/a^2 + |a''|/a + theta'^2
    for the inertial part of K. At rest C therefore has to vanish identically.
    """
    expected = lagrangian.matrices(arm, d, slew_rate)
    actual = model.matrices(d.length, rate=d.rate, accel=d.accel, slew_rate=slew_rate)
    mass = np.sqrt(np.outer(np.diag(expected.M), np.diag(expected.M)))
    inertial = (d.rate / d.length) ** 2 + abs(d.accel) / d.length + slew_rate**2
    bending = lagrangian.matrices(replace(arm, axial_load=False), Deployment(d.length)).K
    assert_within(actual.M, expected.M, TOLERANCE * mass)
    assert_within(actual.C, expected.C, TOLERANCE * mass * abs(d.rate) / d.length)
    assert_within(
        actual.K, expected.K, TOLERANCE * mass * inertial + STIFFNESS_TOLERANCE * np.abs(bending)
    )


@pytest.mark.parametrize("seed", range(320))
def test_matrices_of_random_arms_equal_lagrange_equations_of_the_energies(seed: int) -> None:
    case = random_case(seed)
    assert_same_matrices(engine_model(case.arm), case.arm, case.deployment, case.q_rate[0])


@pytest.mark.parametrize("particle_following", [False, True])
@pytest.mark.parametrize("inertia", ["full", "slender"])
@pytest.mark.parametrize("payload", STANDARD_PAYLOADS)
def test_matrices_of_the_default_arm_equal_lagrange_equations_of_the_energies(
    payload: str, inertia: str, particle_following: bool
) -> None:
    arm = Arm(
        payload=Payload(*STANDARD_PAYLOADS[payload], slender=inertia == "slender"),
        particle_following=particle_following,
    )
    # The links are left out here on purpose: their defaults are the published ones.
    model = drm_env.Model(
        payload=payload_table(arm.payload),
        plant="thesis",
        dynamics={"axial_load": True, "particle_following": particle_following},
    )
    for d in (
        Deployment(1.0, 0.5, 0.3),
        Deployment(2.5, -1.1, 0.4),
        Deployment(5.0),
        Deployment(5.0, accel=0.8),
        Deployment(8.0, 0.9, -0.7),
    ):
        assert_same_matrices(model, arm, d, slew_rate=0.2)


@pytest.mark.parametrize("seed", range(1000, 1400))
def test_acceleration_equals_lagrange_equations_of_the_energies(seed: int) -> None:
    case = random_case(seed)
    d, torques = case.deployment, case.torques
    expected = lagrangian.acceleration(case.arm, case.q, case.q_rate, d, torques)
    actual = engine_model(case.arm, tip_turns_slew=torques.tip_turns_slew).acceleration(
        case.q,
        case.q_rate,
        d.length,
        rate=d.rate,
        accel=d.accel,
        slew_torque=torques.slew,
        root_torque=torques.root,
        tip_torque=torques.tip,
    )
    # Weighted by sqrt(M_ii) the three accelerations are comparable with each other.
    mass, _ = lagrangian.equations(case.arm, case.q, case.q_rate, d, torques)
    weight = np.sqrt(np.diag(mass))
    assert_within(actual, expected, TOLERANCE * np.max(weight * np.abs(expected)) / weight)


@pytest.mark.parametrize("torque", ["slew", "root", "tip"])
@pytest.mark.parametrize("tip_turns_slew", [True, False])
def test_response_to_each_torque_equals_its_virtual_work(torque: str, tip_turns_slew: bool) -> None:
    arm = Arm(payload=Payload(200.0, 1.0, 0.5))
    d, rest = Deployment(3.0), np.zeros(3)
    torques = Torques(**{torque: 10.0}, tip_turns_slew=tip_turns_slew)
    actual = engine_model(arm, tip_turns_slew=tip_turns_slew).acceleration(
        rest,
        rest,
        d.length,
        slew_torque=torques.slew,
        root_torque=torques.root,
        tip_torque=torques.tip,
    )
    forces = lagrangian.generalised_forces(arm, d, torques)
    mass = lagrangian.matrices(arm, d).M
    assert_within(mass @ actual, forces, np.full(3, TOLERANCE * np.max(np.abs(forces))))


@pytest.mark.parametrize("seed", range(2000, 2200))
def test_energy_equals_quadrature_of_the_energy_densities(seed: int) -> None:
    case = random_case(seed)
    # The engine's energy is asked for without the deployment's acceleration.
    d = replace(case.deployment, accel=0.0)
    kinetic, potential = lagrangian.energies(case.arm, case.q, case.q_rate, d)
    energy = engine_model(case.arm).energy(case.q, case.q_rate, d.length, rate=d.rate)
    assert energy.kinetic == pytest.approx(kinetic, rel=TOLERANCE)
    assert energy.potential == pytest.approx(potential, rel=TOLERANCE)
    assert energy.total == pytest.approx(kinetic + potential, rel=TOLERANCE)


@pytest.mark.parametrize("seed", range(3000, 3200))
def test_angular_momentum_equals_derivative_of_the_lagrangian(seed: int) -> None:
    case = random_case(seed)
    d = replace(case.deployment, accel=0.0)
    expected = lagrangian.angular_momentum(case.arm, case.q, case.q_rate, d)
    actual = engine_model(case.arm).angular_momentum(case.q, case.q_rate, d.length, rate=d.rate)
    # Row by row the momentum may cancel; measure by the slew inertia at a unit rate.
    inertia = lagrangian.matrices(case.arm, d).M[0, 0]
    assert abs(actual - expected) <= TOLERANCE * inertia * np.max(np.abs(case.q_rate))
