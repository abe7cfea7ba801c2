"""Linear state-space forms of ``drm_env.Model`` against its matrices, modes and whole flights."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import drm_env

Matrix = NDArray[np.float64]

PLANTS: dict[str, dict[str, Any]] = {
    "thesis": {},
    "thesis following": {"dynamics": {"particle_following": True}},
    "consistent (1, 1)": {"plant": "consistent", "modes": (1, 1)},
    "consistent (2, 3)": {"plant": "consistent", "modes": (2, 3)},
    "consistent": {"plant": "consistent"},
}
MOTION = {"rate": 0.4, "accel": -0.3, "slew_rate": 0.2}


@pytest.fixture(params=list(PLANTS))
def model(request: pytest.FixtureRequest) -> drm_env.Model:
    return drm_env.Model(**PLANTS[request.param])


def test_names_are_those_of_the_rows_and_columns(model: drm_env.Model) -> None:
    linear = model.linearize(4.0, **MOTION)
    k = model.matrices(4.0).M.shape[0]
    assert linear.A.shape == (2 * k, 2 * k)
    assert linear.B.shape == (2 * k, 3)
    assert linear.C.shape == (7, 2 * k)
    assert len(linear.states) == 2 * k
    assert len(set(linear.states)) == 2 * k
    assert linear.states[0] == "slew_angle"
    assert linear.states[k] == "slew_rate"
    for name, rate in zip(linear.states[1:k], linear.states[k + 1 :], strict=True):
        assert rate == f"{name}_rate"
    assert linear.inputs == ("slew_torque", "root_torque", "tip_torque")
    assert linear.outputs == (
        "slew_angle",
        "slew_rate",
        "link2_deflection",
        "link2_deflection_rate",
        "tip_deflection",
        "tip_deflection_rate",
        "tip_turn_rate",
    )


def test_coordinates_have_names() -> None:
    assert drm_env.Model().linearize(4.0).states[:3] == ("slew_angle", "alpha", "beta")
    names = drm_env.Model(plant="consistent", modes=(1, 2)).linearize(4.0).states
    assert names[:4] == ("slew_angle", "link1_1", "link2_1", "link2_2")


def test_accelerations_balance_the_matrices(model: drm_env.Model) -> None:
    linear = model.linearize(4.0, **MOTION)
    M, C, K = model.matrices(4.0, **MOTION)
    k = M.shape[0]
    np.testing.assert_array_equal(linear.A[:k], np.eye(k, 2 * k, k))
    np.testing.assert_array_equal(linear.B[:k], 0.0)
    for product, expected in ((linear.A[k:, :k], -K), (linear.A[k:, k:], -C)):
        rounding = 1e-14 * (np.abs(M) @ np.abs(product)).max()
        np.testing.assert_allclose(M @ product, expected, rtol=0.0, atol=rounding)
    # motor and root wheel turn the arm; the tip wheel also bends it
    force = M @ linear.B[k:]
    np.testing.assert_allclose(force[:, 0], np.eye(k)[0], atol=1e-12)
    np.testing.assert_array_equal(linear.B[:, 0], linear.B[:, 1])
    assert force[0, 2] == pytest.approx(1.0)
    assert np.all(force[-1:, 2] != 0.0)


def test_eigenvalues_at_rest_are_the_natural_frequencies(model: drm_env.Model) -> None:
    linear = model.linearize(5.0)
    frequencies = np.sort(np.abs(np.linalg.eigvals(linear.A).imag)) / (2.0 * np.pi)
    expected = np.repeat(model.natural_frequencies(5.0), 2)
    np.testing.assert_allclose(frequencies[-expected.size :], expected, rtol=1e-7)


def test_thesis_outputs_are_twice_the_coordinates() -> None:
    state = np.array([0.3, 0.01, -0.02, 0.1, 0.03, 0.04])
    # the gyro at the tip: the slew rate and 3/a beta'
    expected = [0.3, 0.1, -0.04, 0.08, -0.02, 0.14, 0.1 + 0.75 * 0.04]
    np.testing.assert_allclose(drm_env.Model().linearize(4.0).C @ state, expected, rtol=1e-14)


def exponential(matrix: Matrix) -> Matrix:
    """Scaling and squaring of the Taylor series."""
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300)))) + 3)
    small = matrix / 2.0**halvings
    term = np.eye(matrix.shape[0])
    total = term.copy()
    for order in range(1, 16):
        term = term @ small / order
        total += term
    for _ in range(halvings):
        total = total @ total
    return total


def predicted(model: drm_env.Model, trajectory: drm_env.Trajectory) -> Matrix:
    """Outputs of x' = A x + B u from rest, A and B taken anew in the middle of every sample.

    The flight accelerates steadily, both the slew and the deployment.
    """
    time, slew_rate, torque = (trajectory[name] for name in ("time", "slew_rate", "slew_torque"))
    accel = float(trajectory["extension_rate"][-1] / time[-1])
    start = float(trajectory["extension"][0])

    def extension(t: float) -> tuple[float, float, float]:
        return start + accel * t * t / 2.0, accel * t, accel

    first = model.linearize(*extension(0.0))
    states = len(first.states)
    x = np.zeros(states)
    outputs = [first.C @ x]
    for i, (t, h) in enumerate(zip(time[:-1], np.diff(time), strict=True)):
        rate = (slew_rate[i] + slew_rate[i + 1]) / 2.0
        middle = model.linearize(*extension(t + h / 2.0), slew_rate=rate)
        held = np.array([(torque[i] + torque[i + 1]) / 2.0, 0.0, 0.0])
        whole = np.zeros((states + 1, states + 1))
        whole[:-1, :-1] = middle.A
        whole[:-1, -1] = middle.B @ held
        x = (exponential(whole * h) @ np.append(x, 1.0))[:-1]
        rate = slew_rate[i + 1]
        outputs.append(model.linearize(*extension(t + h), slew_rate=rate).C @ x)
    return np.array(outputs).T


FLIGHTS: dict[str, dict[str, Any]] = {
    "thesis": {"plant": "thesis"},
    "thesis following": {"plant": "thesis", "dynamics": {"particle_following": True}},
    "consistent": {"plant": "consistent", "modes": (2, 2)},
}


@pytest.mark.parametrize("mode", ["none", "force_limited"])
@pytest.mark.parametrize("name", list(FLIGHTS))
def test_a_flight_is_that_of_the_linear_system(name: str, mode: str) -> None:
    """Half a second of a slew under the motor's torque, the arm fixed and deploying.

    So slow a slew that the squares of rates and deflections are negligible. The errors of the
    integrators, of the order of the second and the fourth power of the step, are extrapolated
    away. What is left is that of holding A and B over a sample of 0.5 ms, second order in
    it: below 1e-5 of the largest value.
    """
    plant = FLIGHTS[name]
    scenario = plant | {
        "deployment": {"start": 4.0, "end": 8.0, "mode": mode},
        "slew": {"max_accel": 2e-4},
        "sample_period": 5e-4,
        "horizon": 0.5,
    }
    power = 4 if name == "consistent" else 16
    coarse, fine = (drm_env.simulate(scenario | {"integrator_step": step}) for step in (2e-5, 1e-5))
    model = drm_env.Model(**plant)
    found = predicted(model, fine)

    def extrapolated(signal: str) -> Matrix:
        return (power * fine[signal] - coarse[signal]) / (power - 1)

    expected = {
        "slew_angle": extrapolated("slew_angle"),
        "slew_rate": extrapolated("slew_rate"),
        "link2_deflection": 2.0 * extrapolated("beta"),
        "link2_deflection_rate": 2.0 * extrapolated("beta_rate"),
        "tip_deflection": extrapolated("tip_deflection"),
    }
    for output, values in expected.items():
        row = found[model.linearize(4.0).outputs.index(output)]
        atol = 1e-5 * np.abs(values).max()
        np.testing.assert_allclose(row, values, rtol=0.0, atol=atol, err_msg=output)


@pytest.mark.parametrize("plant", ["finite_element", "exact_rigid_link1"])
def test_plants_without_equations_of_motion_are_refused(plant: str) -> None:
    model = drm_env.Model(plant=plant)
    with pytest.raises(drm_env.ConfigError, match=rf"plant.*{plant}"):
        model.linearize(4.0)
    with pytest.raises(drm_env.ConfigError, match=rf"plant.*{plant}"):
        model.matrices(4.0)


def test_what_only_the_thesis_plant_has_is_refused() -> None:
    model = drm_env.Model(plant="consistent")
    zero = np.zeros(3)
    for call in (
        lambda: model.acceleration(zero, zero, 3.0),
        lambda: model.energy(zero, zero, 3.0),
        lambda: model.angular_momentum(zero, zero, 3.0),
    ):
        with pytest.raises(drm_env.ConfigError, match=r"plant.*thesis.*consistent"):
            call()


@pytest.mark.parametrize("modes", [(0, 3), (9, 1)])
def test_numbers_of_modes_that_do_not_move_are_refused(modes: tuple[int, int]) -> None:
    model = drm_env.Model(plant="consistent", modes=modes)
    with pytest.raises(drm_env.ConfigError, match=r"modes.*1 to 8"):
        model.linearize(4.0)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"extension": 0.5}, "extension"),
        ({"extension": np.nan}, "extension"),
        ({"extension": 4.0, "rate": np.inf}, "rate"),
        ({"extension": 4.0, "accel": np.nan}, "accel"),
        ({"extension": 4.0, "slew_rate": np.nan}, "slew_rate"),
    ],
)
def test_impossible_motions_are_refused(
    model: drm_env.Model, arguments: dict[str, float], name: str
) -> None:
    with pytest.raises(drm_env.ConfigError, match=name):
        model.linearize(**arguments)
    with pytest.raises(drm_env.ConfigError, match=name):
        model.matrices(**arguments)
