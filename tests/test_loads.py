"""The loads of a manoeuvre against balances of momentum and power, rigid limits and closed forms.

Expected values come from the places of the particles, integrated here by NumPy's Gauss rule:
with one shape a link the signals of a trajectory hold the whole motion.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import drm_env
from drm_env.constants import LOAD_NAMES, SIGNAL_NAMES

Array = NDArray[np.float64]

L1, L2 = 7.0, 8.0
RHO1, RHO2 = 100.0 / 7.0, 75.0 / 8.0
EI1, EI2 = 2.5e6, 3.0e6
MASS, LENGTH, WIDTH = 200.0, 1.0, 0.5
INERTIA = MASS * (LENGTH**2 + WIDTH**2) / 12.0


NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


class Particles:
    """Every mass along a trajectory: coordinates in the rotating frame and their rates."""

    def __init__(self, flight: Any, plant: str) -> None:
        self.flight, self.consistent = flight, plant == "consistent"
        self.theta, self.rate = flight["slew_angle"], flight["slew_rate"]
        self.a, self.ad = flight["extension"], flight["extension_rate"]
        self.q = flight["alpha"], flight["alpha_rate"], flight["beta"], flight["beta_rate"]

    def shape(self, u: Array) -> tuple[Array, Array, Array]:
        """Deflection per alpha or beta, its slope and curvature over u."""
        if self.consistent:
            return 2.0 * u**2, 4.0 * u, np.full_like(u, 4.0)
        return 3.0 * u**2 - u**3, 6.0 * u - 3.0 * u**2, 6.0 - 6.0 * u

    def place(self, xi: Array, moves: bool) -> tuple[Array, Array]:
        """Deflection of what is at xi (nodes, samples) and its rate following it."""
        alpha, alpha_rate, beta, beta_rate = self.q
        drift = self.ad if moves else 0.0 * self.ad
        value, slope, _ = self.shape(np.minimum(xi, L1) / L1)
        inner = value * alpha, value * alpha_rate + slope / L1 * drift * alpha
        x = np.maximum(xi - L1, 0.0)
        end, turn, _ = self.shape(np.ones_like(xi))
        turn = turn / L1 if self.consistent else 0.0 * turn
        value, slope, _ = self.shape(x / self.a)
        stretch = slope * (1.0 - x / self.a) / self.a
        outer = (
            (end + x * turn) * alpha + value * beta,
            (end + x * turn) * alpha_rate
            + turn * drift * alpha
            + value * beta_rate
            + stretch * drift * beta,
        )
        out = xi > L1
        return np.where(out, outer[0], inner[0]), np.where(out, outer[1], inner[1])

    def parts(self) -> list[tuple[Array, Array, bool]]:
        """Mass and xi of nodes over link 1, link 2 inside and outside, each (nodes, samples)."""
        zero = 0.0 * self.a
        spans = [
            (RHO1, zero, zero + L1, False),
            (RHO2, L1 + self.a - L2, zero + L1, True),
            (RHO2, zero + L1, L1 + self.a, True),
        ]
        found = []
        for density, low, high, moves in spans:
            half = (high - low) / 2.0
            xi = low + half * (1.0 + NODES[:, None])
            found.append((density * half * WEIGHTS[:, None], xi, moves))
        return found

    def payload(self) -> tuple[Array, Array, Array, Array]:
        """Distance, deflection, its rate of the centre, and the rate at which it turns in space."""
        alpha, alpha_rate, beta, beta_rate = self.q
        reach = (L1 + self.a)[None]
        w, rate = self.place(reach, True)
        _, slope, _ = self.shape(np.ones_like(reach))
        turn = slope / L1 if self.consistent else 0.0 * slope
        s = turn * alpha + slope / self.a * beta
        s_rate = turn * alpha_rate + slope / self.a * beta_rate - slope * self.ad / self.a**2 * beta
        centre = w + LENGTH / 2.0 * s, rate + LENGTH / 2.0 * s_rate
        return (reach + LENGTH / 2.0)[0], centre[0][0], centre[1][0], (self.rate + s_rate)[0]

    def sums(self) -> tuple[Array, Array, Array, Array]:
        """Linear momentum x and y, angular momentum about the shoulder, energy."""
        alpha, _, beta, _ = self.q
        along = across = turning = energy = 0.0 * self.a
        masses = [(m, xi, *self.place(xi, moves), moves) for m, xi, moves in self.parts()]
        distance, w, w_rate, spin = self.payload()
        masses.append((np.array([[MASS]]), distance[None], w[None], w_rate[None], True))
        for mass, xi, w, w_rate, moves in masses:
            v_along = (self.ad if moves else 0.0) - w * self.rate
            v_across = w_rate + xi * self.rate
            along = along + (mass * v_along).sum(0)
            across = across + (mass * v_across).sum(0)
            turning = turning + (mass * (xi * v_across - w * v_along)).sum(0)
            energy = energy + (0.5 * mass * (v_along**2 + v_across**2)).sum(0)
        turning = turning + INERTIA * spin
        energy = energy + 0.5 * INERTIA * spin**2
        for stiff, (_, xi, moves), q in zip(
            (EI1, EI2, EI2), self.parts(), (alpha, alpha, beta), strict=True
        ):
            outside = q is beta
            length = self.a if outside else L1
            u = (xi - L1) / self.a if outside else xi / L1
            weights = (self.parts()[2 if outside else int(moves)][0]) / (RHO2 if moves else RHO1)
            bend = self.shape(u)[2] / length**2 * q
            energy = energy + (0.5 * stiff * weights * bend**2).sum(0)
        cos, sin = np.cos(self.theta), np.sin(self.theta)
        return along * cos - across * sin, along * sin + across * cos, turning, energy


def integral(values: Array, dt: float) -> Array:
    """From the first sample to each, of what may jump at none of them (trapezoidal rule)."""
    steps = dt * (values[1:] + values[:-1]) / 2.0
    return np.concatenate([[0.0], np.cumsum(steps)])


def flight(plant: str, law: str = "linear", **parts: Any) -> Any:
    """A bit of the standard manoeuvre, vibrating, at a fine sample period."""
    scenario = {
        "plant": plant,
        "modes": [1, 1],
        "initial": {"alpha": 2e-3, "beta": -1e-3, "slew_rate": 0.05},
        "deployment": {"start": 3.0, "end": 6.0},
        "slew": {"angle": 0.8, "profile": "min_energy"},
        "sample_period": 1e-4,
        "integrator_step": 1e-4,
        "horizon": 1.0,
    } | parts
    return drm_env.simulate(scenario, law, loads=True)


def close(found: Array, expected: Array, tolerance: float) -> None:
    """Within a part of the largest magnitude."""
    size = np.abs(expected).max()
    assert np.abs(found - expected).max() <= tolerance * size


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_base_force_is_the_rate_of_linear_momentum(plant: str) -> None:
    """The momentum is that of the velocity field, at every sample."""
    # without held torques, whose jumps the trapezoidal rule would see
    flown = flight(plant, "none")
    x, y, _, _ = Particles(flown, plant).sums()
    for name, momentum in (("base_force_x", x), ("base_force_y", y)):
        close(integral(flown[name], 1e-4), momentum - momentum[0], 2e-5)


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
@pytest.mark.parametrize("law", ["none", "linear"])
def test_base_torque_is_the_rate_of_angular_momentum(plant: str, law: str) -> None:
    """With any number of shapes, whole manoeuvre; and link 1's root bears motor and root wheel."""
    scenario = {"plant": plant, "mass_error": 0.1, "sample_period": 1e-3}
    flown = drm_env.simulate(scenario, law, loads=True)
    momentum = flown["angular_momentum"]
    reached = integral(flown["base_torque"], 1e-3)
    # bang-bang: the trapezoidal rule is off where the torque jumps within a sample
    jump = np.abs(np.diff(flown["base_torque"])).max() * 1e-3
    assert np.abs(momentum - momentum[0] - reached).max() < 2.0 * jump
    balance = flown["slew_torque"] + flown["root_torque"]
    np.testing.assert_array_equal(flown["root_bending_moment_link1"], balance)


def test_base_torque_is_the_rate_of_angular_momentum_where_nothing_jumps() -> None:
    """To the order of the integration."""
    for plant in ("thesis", "consistent"):
        flown = flight(plant)
        momentum = flown["angular_momentum"]
        close(integral(flown["base_torque"], 1e-4), momentum - momentum[0], 1e-5)
        wheels = flown["root_wheel_momentum"] + flown["tip_wheel_momentum"]
        _, _, turning, _ = Particles(flown, plant).sums()
        # of the first order in the deflections
        close(momentum - wheels, turning, 2e-3)


@pytest.mark.parametrize(("plant", "tolerance"), [("thesis", 2e-2), ("consistent", 2e-4)])
def test_power_of_motor_wheels_and_deployment_changes_the_energy(
    plant: str, tolerance: float
) -> None:
    """Exact for the consistent plant without drawing near; the thesis leaves out loads."""
    dynamics = {"axial_load": False, "particle_following": True}
    flown = flight(plant, dynamics=dynamics)
    particles = Particles(flown, plant)
    _, _, _, energy = particles.sums()
    _, _, _, spin = particles.payload()
    power = (
        (flown["slew_torque"] + flown["root_torque"]) * flown["slew_rate"]
        + flown["tip_torque"] * spin
        + flown["deployment_force"] * flown["extension_rate"]
    )
    close(integral(power, 1e-4), energy - energy[0], tolerance)


STIFF = {
    "link1": {"length": L1, "bending_stiffness": 1e11, "mass_per_length": RHO1},
    "link2": {"length": L2, "bending_stiffness": 1e11, "mass_per_length": RHO2},
}


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_rigid_arm_turning_steadily(plant: str) -> None:
    """Closed forms of an arm that turns at a constant rate: only the pull remains."""
    rate, a = 0.3, 5.0
    flown = drm_env.simulate(
        {
            "plant": plant,
            "modes": [1, 1],
            "arm": STIFF,
            "slew": {"angle": 0.0},
            "deployment": {"mode": "none", "start": a},
            "initial": {"slew_rate": rate},
            "integrator_step": 2e-6,
            "sample_period": 1e-4,
            "horizon": 1e-3,
        },
        loads=True,
    )
    reach = L1 + a
    moved = MASS * (reach + LENGTH / 2) + RHO2 * L2 * (reach - L2 / 2)
    pull = (moved + RHO1 * L1**2 / 2) * rate**2
    theta = flown["slew_angle"]
    np.testing.assert_allclose(flown["deployment_force"], -moved * rate**2, rtol=1e-4)
    np.testing.assert_allclose(flown["base_force_x"], -pull * np.cos(theta), rtol=1e-4)
    np.testing.assert_allclose(flown["payload_acceleration"], (reach + 0.5) * rate**2, rtol=1e-4)
    np.testing.assert_allclose(flown["root_shear_link1"], 0.0, atol=1e-2 * pull)
    np.testing.assert_allclose(flown["tip_x"], reach * np.cos(theta), rtol=1e-6)
    np.testing.assert_allclose(flown["tip_y"], reach * np.sin(theta), atol=1e-5)


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_stiff_arm_under_a_steady_acceleration(plant: str) -> None:
    """Shear and moment at both roots are those of a rigid arm, a statics exercise."""
    accel, a = 0.02, 4.0
    flown = drm_env.simulate(
        {
            "plant": plant,
            "arm": {name: dict(link, bending_stiffness=2e7) for name, link in STIFF.items()},
            "slew": {"max_accel": accel, "smoothing": 0.2},
            "deployment": {"mode": "none", "start": a},
            "dynamics": {"structural_damping": 2e-4},
            "integrator_step": 2.5e-4,
        },
        loads=True,
    )
    held = (flown["reference_accel"] > accel * (1 - 1e-9)) & (flown["time"] > 3.2)
    assert held.sum() > 100
    reach = L1 + a
    centre = reach + LENGTH / 2
    inertia = (
        RHO1 * L1**3 / 3 + RHO2 * (reach**3 - (reach - L2) ** 3) / 3 + MASS * centre**2 + INERTIA
    )
    first = RHO1 * L1**2 / 2 + RHO2 * L2 * (reach - L2 / 2) + MASS * centre
    outer = RHO2 * (reach**2 - L1**2) / 2 + MASS * centre
    moment = (
        RHO2 * (reach**3 - L1**3) / 3
        - RHO2 * L1 * (reach**2 - L1**2) / 2
        + MASS * centre * (centre - L1)
        + INERTIA
    )
    mean = {name: float(flown[name][held].mean()) for name in LOAD_NAMES}
    assert mean["root_bending_moment_link1"] == pytest.approx(inertia * accel, rel=1e-6)
    assert mean["root_shear_link1"] == pytest.approx(first * accel, rel=2e-3)
    assert mean["root_shear_link2"] == pytest.approx(outer * accel, rel=2e-3)
    assert mean["root_bending_moment_link2"] == pytest.approx(moment * accel, rel=2e-3)


def test_deployment_takes_what_the_centrifugal_pull_adds() -> None:
    """Of the standard manoeuvre: mass times acceleration is 44 N, with the pull 96 N.

    That is of a rigid arm. A smoothed slew hardly vibrates and comes near it.
    """
    moving = MASS + RHO2 * L2
    for smoothing, tolerance in ((0.0, 0.5), (0.1, 0.05)):
        flown = drm_env.simulate({"slew": {"smoothing": smoothing}}, loads=True)
        accel = np.gradient(flown["extension_rate"], flown["time"])
        reach = L1 + flown["extension"]
        moved = MASS * (reach + LENGTH / 2) + RHO2 * L2 * (reach - L2 / 2)
        rigid = np.abs(moving * accel - moved * flown["reference_rate"] ** 2).max()
        if smoothing == 0.0:
            assert np.abs(moving * accel).max() == pytest.approx(44.0, abs=0.5)
            assert rigid == pytest.approx(96.0, abs=1.0)
        assert flown.metrics["deployment_force_peak"] == pytest.approx(rigid, rel=tolerance)


def test_motor_is_that_of_the_thesis() -> None:
    """Current, voltage and energy by Table 4-1 and section 4.3."""
    flown = drm_env.simulate(loads=True)
    rate, accel = flown["reference_rate"], flown["reference_accel"]
    current = (
        flown["slew_torque"] / 1845.0 + 1.65e-4 * 1845.0 * rate + 2.67e-3 * 1845.0 * accel
    ) / 0.318
    np.testing.assert_allclose(flown["motor_current"], current, rtol=1e-9, atol=1e-9)
    voltage = 5.16 * current + 0.318 * 1845.0 * rate
    np.testing.assert_allclose(flown["motor_voltage"], voltage, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(flown["motor_power"], 5.16 * current**2, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(flown["motor_input_power"], voltage * current, rtol=1e-9, atol=1e-9)
    assert flown["motor_energy"][-1] == pytest.approx(flown.metrics["slew_energy"], rel=1e-12)
    assert flown["motor_energy"][-1] == pytest.approx(185.5, rel=1e-3)  # thesis section 4.3


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_peaks_and_mean_squares_are_those_of_the_signals(plant: str) -> None:
    """Of `simulate` and of `rollout`, whatever is kept; and nothing else moves."""
    scenario = {"plant": plant, "horizon": 3.0, "mass_error": 0.15}
    other = scenario | {"slew": {"max_accel": 0.03}, "payload": {"mass": 50.0}}
    alone = drm_env.simulate(scenario, "lyapunov", loads=True)
    sparse = drm_env.simulate(scenario, "lyapunov", loads=True, decimation=7)
    plain = drm_env.simulate(scenario, "lyapunov")
    assert set(alone) == set(SIGNAL_NAMES) | set(LOAD_NAMES)
    for name in SIGNAL_NAMES:
        np.testing.assert_array_equal(alone[name], plain[name])
    np.testing.assert_equal(plain.metrics, {name: alone.metrics[name] for name in plain.metrics})
    flown = drm_env.rollout([other, scenario, other], "lyapunov", loads=True)
    kept = drm_env.rollout([other, scenario], "lyapunov", signals=LOAD_NAMES, decimation=10)
    assert "tip_x_peak" not in kept
    for name in LOAD_NAMES:
        peak, rms = f"{name}_peak", f"{name}_rms"
        assert alone.metrics[peak] == np.abs(alone[name]).max()
        assert alone.metrics[rms] == pytest.approx(math.sqrt(np.mean(alone[name] ** 2)), rel=1e-9)
        assert sparse.metrics[peak] == alone.metrics[peak] == flown[peak][1]
        assert sparse.metrics[rms] == alone.metrics[rms] == flown[rms][1]
        np.testing.assert_array_equal(kept.trajectories[name][1], alone[name][::10])
    assert flown["root_shear_link1_peak"][0] == flown["root_shear_link1_peak"][2]


def test_a_manoeuvre_that_leaves_the_equations_has_no_loads() -> None:
    """As its metrics."""
    scenario = {"initial": {"beta": 3.0}, "horizon": 1.0}
    flown = drm_env.rollout([scenario, {"horizon": 1.0}], loads=True)
    assert flown["diverged"].tolist() == [1.0, 0.0]
    for name in LOAD_NAMES:
        assert np.isnan(flown[f"{name}_peak"]).tolist() == [True, False]


def test_a_policy_has_loads_too() -> None:
    """A network's episode; zero actions are the open loop."""
    env = drm_env.DrmEnv(task="slew", horizon=2.0, mass_error=0.1)
    assert env.observation_space.shape is not None
    size = env.observation_space.shape[0]
    layers = [(np.zeros((2, size), np.float32), np.zeros(2, np.float32))]
    network = drm_env.Network(layers, activation="tanh", output="clip")
    scenario = {"horizon": 2.0, "mass_error": 0.1}
    flown = drm_env.rollout([scenario], policy=network, horizon=2.0, loads=True)
    alone = drm_env.simulate(scenario, loads=True)
    for name in ("root_bending_moment_link2", "deployment_force", "motor_energy"):
        assert flown[f"{name}_peak"][0] == alone.metrics[f"{name}_peak"]


def test_unknown_names_and_flags_are_refused() -> None:
    """With what there is."""
    with pytest.raises(drm_env.ConfigError, match=r"signals\[0\].*deployment_force.*bending"):
        drm_env.rollout([{}], signals=["bending"])
    with pytest.raises(drm_env.ConfigError, match="loads must be True or False, got 1"):
        drm_env.simulate(loads=1)  # type: ignore[arg-type]


def test_the_page_says_what_the_package_says() -> None:
    """docs/loads.md, row by row."""
    text = (Path(__file__).parents[1] / "docs" / "loads.md").read_text(encoding="utf-8")
    entries = drm_env.load_signals()
    assert tuple(entry.name for entry in entries) == LOAD_NAMES
    for name, unit, description, formula in entries:
        escaped = formula.replace("|", r"\|")
        row = f"| `{name}` | {unit} | {description} | {escaped} |"
        assert row in text, row
    for symbol, meaning in drm_env.LOAD_SYMBOLS.items():
        assert f"| {symbol} | {meaning} |" in text, symbol


def test_a_smoothed_slew_has_the_same_loads_on_both_plants_and_with_any_step() -> None:
    """Peaks that size an arm: of a rigid arm they are statics, and a smoothed slew hardly bends."""
    base: dict[str, Any] = {"slew": {"smoothing": 0.1}, "horizon": 16.0}
    thesis = drm_env.simulate(base, loads=True).metrics
    consistent = base | {"plant": "consistent"}
    coarse = drm_env.simulate(consistent, loads=True).metrics
    fine = drm_env.simulate(consistent | {"integrator_step": 2.5e-4}, loads=True).metrics
    for name in LOAD_NAMES:
        peak = f"{name}_peak"
        assert coarse[peak] == pytest.approx(fine[peak], rel=1e-3, abs=1e-9), name
        assert thesis[peak] == pytest.approx(coarse[peak], rel=2e-2, abs=1e-9), name
