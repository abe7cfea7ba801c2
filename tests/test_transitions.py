"""The discrete linear model of a manoeuvre beside flights and beside the equations of motion.

The flights have given torques, so that nothing but the equations of motion lies between them and
the model. What is not linear in them is the axial load: it misses terms of second order in the
deviation from the reference times the reference's own rate, which the size of the manoeuvre scales.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

import drm_env

Array = NDArray[np.float64]

SIGNALS = ("slew_angle", "reference_angle", "tip_deflection", "extension")
LIMITS = np.array([100.0, 10.0])
LINK1 = 7.0
# gentle enough for the linear model, with the switch of the profile at 7.07 s inside
SLEW = {"angle": 0.1, "max_accel": 0.002}
SCENARIO: dict[str, Any] = {"slew": SLEW, "horizon": 8.0}
FIXED = {"start": 5.0, "mode": "none"}


def predicted(model: drm_env.Transitions, torques: Array) -> Array:
    """Errors of the tip at all samples."""
    state, errors = model.start, []
    for k, torque in enumerate(torques):
        seen = model.error_state[k] @ state + model.error_input[k] @ torque
        errors.append(seen + model.error_offset[k])
        state = model.transition[k] @ state + model.input[k] @ torque + model.offset[k]
    return np.concatenate(errors)


def flown(scenario: dict[str, Any], torques: Array, hold: int) -> Array:
    """The same from a flight."""
    result = drm_env.rollout([scenario], torques=torques[None], hold=hold, signals=SIGNALS)
    angle, reference, deflection, extension = (result.trajectories[name][0, 1:] for name in SIGNALS)
    return np.asarray((LINK1 + extension) * (angle - reference) + deflection)


def random_torques(model: drm_env.Transitions, seed: int = 0) -> Array:
    """Both wheels anywhere within their limits."""
    rng = np.random.default_rng(seed)
    return np.asarray(rng.uniform(-1.0, 1.0, (len(model.offset), 2)) * LIMITS)


def missed(scenario: dict[str, Any], hold: int, seed: int = 0, size: float = 1.0) -> float:
    """Largest error of the prediction over that of the tip; `size` scales the torques."""
    model = drm_env.transitions(scenario, hold=hold)
    torques = size * random_torques(model, seed)
    errors = flown(scenario, torques, hold)
    assert errors.shape == (model.error_offset.size,)
    assert np.isfinite(errors).all()
    difference = np.abs(predicted(model, torques) - errors).max()
    return float(difference / np.abs(errors).max())


MANOEUVRES: dict[str, dict[str, Any]] = {
    "standard": {},
    "heavy, misreported": {"payload": {"mass": 500.0}, "mass_error": 0.15},
    "light": {"payload": {"mass": 50.0}, "mass_error": -0.15},
    "slender": {"payload": {"mass": 300.0, "length": 1.2, "width": 0.1, "inertia": "slender"}},
    "fixed": {"deployment": FIXED},
    "retracting": {"deployment": {"start": 8.0, "end": 1.0}},
    "pushed": {"deployment": {"mode": "force_limited"}},
    "smooth": {"slew": {**SLEW, "profile": "min_energy", "smoothing": 0.1}},
    "backwards": {"slew": {**SLEW, "angle": -0.1}},
    "damped": {"dynamics": {"structural_damping": 1e-3}},
    "particles followed": {"dynamics": {"particle_following": True}},
    "deflected": {
        "initial": {
            "slew_angle": 1e-3, "slew_rate": -1e-3, "alpha": 1e-4, "alpha_rate": -1e-3,
            "beta": 2e-4, "beta_rate": -5e-3,
        }
    },
}  # fmt: skip


@pytest.mark.parametrize("hold", [1, 10, 40])
@pytest.mark.parametrize("name", MANOEUVRES)
def test_the_model_predicts_flights_of_the_thesis_plant(name: str, hold: int) -> None:
    assert missed({**SCENARIO, **MANOEUVRES[name]}, hold) < 1e-3


CONSISTENT: dict[str, dict[str, Any]] = {
    "one mode each": {"modes": (1, 1)},
    "standard": {"modes": (2, 2)},
    "three and one": {"modes": (3, 1), "deployment": FIXED},
    "heavy, misreported": {"modes": (1, 2), "payload": {"mass": 500.0}, "mass_error": 0.15},
    "fixed": {"modes": (2, 2), "deployment": FIXED},
    "retracting": {"modes": (1, 2), "deployment": {"start": 8.0, "end": 1.0}},
    "deflected": {
        "modes": (2, 2),
        "initial": {"slew_angle": 1e-3, "slew_rate": -1e-3, "alpha": 1e-4, "beta": 1e-4},
    },
}


@pytest.mark.parametrize("hold", [10, 40])
@pytest.mark.parametrize("name", CONSISTENT)
def test_the_model_predicts_flights_of_the_consistent_plant(name: str, hold: int) -> None:
    """The method's last acceleration is no part of the state, so the step is short."""
    changes = {"plant": "consistent", "integrator_step": 1e-4, "horizon": 4.0}
    assert missed({**SCENARIO, **changes, **CONSISTENT[name]}, hold) < 1e-3


def test_memory_of_the_implicit_method_is_second_order_in_the_step() -> None:
    """What the state leaves out falls with the square of the step."""
    still = {"plant": "consistent", "modes": (1, 1), "slew": {"angle": 0.0}, "deployment": FIXED}
    errors = [
        missed({**still, "integrator_step": step, "horizon": 2.0}, hold=1)
        for step in (5e-4, 1.25e-4)
    ]
    assert 12.0 < errors[0] / errors[1] < 20.0
    assert errors[0] < 1e-3


scenarios = st.fixed_dictionaries(
    {
        "payload": st.fixed_dictionaries(
            {
                "mass": st.floats(50.0, 500.0),
                "inertia": st.sampled_from(["full", "slender"]),
            }
        ),
        "mass_error": st.floats(-0.15, 0.15),
        "slew": st.fixed_dictionaries(
            {
                "angle": st.floats(0.001, 0.008) | st.floats(-0.008, -0.001),
                "max_accel": st.floats(0.0001, 0.0002),
                "profile": st.sampled_from(["min_time", "min_energy"]),
                "smoothing": st.sampled_from([0.0, 0.1]),
            }
        ),
        "deployment": st.fixed_dictionaries(
            {
                "start": st.floats(1.0, 8.0),
                "end": st.floats(1.0, 8.0),
                "mode": st.sampled_from(["coincident", "force_limited", "none"]),
            }
        ),
        "initial": st.fixed_dictionaries(
            {
                "slew_angle": st.floats(-1e-4, 1e-4),
                "slew_rate": st.floats(-5e-5, 5e-5),
                "alpha": st.floats(-1e-5, 1e-5),
                "beta": st.floats(-5e-6, 5e-6),
            }
        ),
    }
)


@settings(max_examples=15, deadline=None)
@given(scenario=scenarios, hold=st.sampled_from([5, 10, 25, 100]), seed=st.integers(0, 2**32))
def test_the_model_predicts_drawn_manoeuvres(
    scenario: dict[str, Any], hold: int, seed: int
) -> None:
    """Small ones: what the model misses is of third order, a mistake in it would be of first."""
    assert missed({**scenario, "horizon": 6.0}, hold, seed, size=0.1) < 1e-3


def test_what_the_model_misses_is_of_third_order() -> None:
    """Slew, torques and deviation made ten times smaller: what is missed falls a thousandfold."""
    errors = []
    for size in (0.5, 0.05):
        slew = {"angle": 0.87 * size, "max_accel": 0.02 * size}
        scenario = {"slew": slew, "horizon": 16.0}
        model = drm_env.transitions(scenario, hold=10)
        torques = size * random_torques(model)
        errors.append(np.abs(predicted(model, torques) - flown(scenario, torques, 10)).max())
    assert 500.0 < errors[0] / errors[1] < 2000.0


def test_the_whole_manoeuvre_is_predicted_up_to_a_percent_of_its_deflection() -> None:
    scenario: dict[str, Any] = {"horizon": 16.0}
    model = drm_env.transitions(scenario, hold=10)
    torques = random_torques(model)
    deflection = drm_env.simulate(scenario)["tip_deflection"]
    difference = predicted(model, torques) - flown(scenario, torques, 10)
    assert np.abs(difference).max() < 0.01 * np.abs(deflection).max()


RESTING: dict[str, Any] = {
    "slew": {"angle": 0.0}, "deployment": FIXED, "horizon": 0.2, "integrator_step": 1e-4,
}  # fmt: skip


@pytest.mark.parametrize("name", ["resting", "standard", "fixed", "retracting", "deflected"])
def test_two_intervals_are_one_of_twice_the_length(name: str) -> None:
    """To rounding at rest; else the second half is linearised about where the first one leads."""
    scenario = RESTING if name == "resting" else {**SCENARIO, **MANOEUVRES[name]}
    tolerance = 1e-8 if name == "resting" else 5e-6
    short, long = (drm_env.transitions(scenario, hold=hold) for hold in (10, 20))
    first, second = slice(0, None, 2), slice(1, None, 2)

    def close(found: Array, expected: Array) -> None:
        atol = tolerance * np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=atol)

    def after(matrices: Array, vectors: Array) -> Array:
        return np.asarray((matrices @ vectors[..., None])[..., 0])

    a, c, d = (
        values[second] for values in (short.transition, short.error_state, short.error_input)
    )
    np.testing.assert_array_equal(short.start, long.start)
    close(a @ short.transition[first], long.transition)
    close(a @ short.input[first] + short.input[second], long.input)
    close(after(a, short.offset[first]) + short.offset[second], long.offset)
    # errors of the tip: the first half as they are, the second seen through the first
    close(short.error_state[first], long.error_state[:, :10])
    close(short.error_input[first], long.error_input[:, :10])
    close(short.error_offset[first], long.error_offset[:, :10])
    close(c @ short.transition[first], long.error_state[:, 10:])
    close(c @ short.input[first] + d, long.error_input[:, 10:])
    offset = (c @ short.offset[first][..., None])[..., 0] + short.error_offset[second]
    close(offset, long.error_offset[:, 10:])


@pytest.mark.parametrize("extension", [1.0, 5.0, 8.0])
@pytest.mark.parametrize("dynamics", [{}, {"structural_damping": 1e-3}])
def test_an_arm_at_rest_has_the_exponential_of_its_equations(
    extension: float, dynamics: dict[str, float]
) -> None:
    deployment = {**FIXED, "start": extension}
    changes = {"deployment": deployment, "dynamics": dynamics, "integrator_step": 2e-5}
    model = drm_env.transitions({**RESTING, **changes}, hold=10)
    linear = drm_env.Model(dynamics=dynamics).linearize(extension)
    size = len(linear.A)
    whole = np.zeros((size + 2, size + 2))
    whole[:size, :size], whole[:size, size:] = linear.A, linear.B[:, 1:]
    whole = expm(0.02 * whole)
    a, b = whole[:size, :size], whole[:size, size:]
    for k in range(10):
        np.testing.assert_allclose(model.transition[k], a, rtol=0.0, atol=1e-6 * np.abs(a).max())
        np.testing.assert_allclose(model.input[k], b, rtol=0.0, atol=1e-6 * np.abs(b).max())
    for constant in (model.start, model.offset, model.error_offset):
        assert not constant.any()


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_eigenvalues_of_a_fixed_arm_are_those_of_its_equations(plant: str) -> None:
    """Also while it turns; of the consistent plant those that the step resolves."""
    slew = {"angle": 0.5, "max_accel": 0.01}
    scenario = {"plant": plant, "deployment": FIXED, "slew": slew, "horizon": 4.0}
    options = {"plant": plant}
    if plant == "consistent":
        options["modes"] = scenario["modes"] = (2, 2)  # type: ignore[assignment]
    model = drm_env.transitions({**scenario, "integrator_step": 1e-4}, hold=10)
    for k in (0, 100, 199):
        linear = drm_env.Model(**options).linearize(5.0, slew_rate=0.01 * 0.02 * (k + 0.5))
        exponents = np.linalg.eigvals(linear.A)
        expected = np.exp(0.02 * exponents[np.abs(exponents) < 200.0])
        assert expected.size >= 6
        found = np.linalg.eigvals(model.transition[k])
        # the double eigenvalue 1 of the rigid arm moves with the root of what is left out
        elastic = np.abs(expected - 1.0) > 0.02
        assert elastic.sum() >= 4
        for value in expected[elastic]:
            assert np.abs(found - value).min() < 2e-4
        assert np.sort(np.abs(found - 1.0))[1] < 1e-2


def test_shapes_and_start() -> None:
    initial = {"slew_angle": 0.01, "alpha": 1e-3, "beta": 2e-3, "slew_rate": 0.1, "beta_rate": 0.3}
    found = drm_env.transitions({"horizon": 1.0, "initial": initial}, hold=25)
    np.testing.assert_array_equal(found.start, [0.01, 1e-3, 2e-3, 0.1, 0.0, 0.3])
    shapes = [values.shape for values in found]
    assert shapes == [(6,), (20, 6, 6), (20, 6, 2), (20, 6), (20, 25, 6), (20, 25, 2), (20, 25)]
    assert all(values.dtype == np.float64 for values in found)
    consistent = {"plant": "consistent", "modes": (3, 2), "horizon": 0.1}
    assert drm_env.transitions(consistent, hold=50).transition.shape == (1, 12, 12)
    assert drm_env.transitions({"horizon": 0.1}).error_offset.shape == (5, 10)


def test_wheels_and_sensors_are_ideal() -> None:
    plain = drm_env.transitions({"horizon": 0.2})
    real = {
        "root_wheel": {"lag": 0.05, "dead_time": 0.01, "momentum_limit": 1.0},
        "tip_wheel": {"lag": 0.01, "dead_time": 0.02, "torque_limit": 3.0},
        "sensors": {"angle_noise": 1e-3, "delay": 0.01, "rate_resolution": 1e-3},
    }
    found = drm_env.transitions({"horizon": 0.2, **real})
    for one, other in zip(plain, found, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-7 * max(1.0, np.abs(one).max()))


@pytest.mark.parametrize(
    ("scenario", "hold", "match"),
    [
        ({}, 0, "hold must be a positive integer, got 0"),
        ({}, -10, "hold must be a positive integer, got -10"),
        ({}, 2.0, "hold must be a positive integer, got 2.0"),
        ({}, True, "hold must be a positive integer, got True"),
        ({"horizon": 1.0}, 7, "hold must divide the 500 samples of the manoeuvre, got 7"),
        ({"horizon": 1.0}, 501, "hold must divide the 500 samples of the manoeuvre, got 501"),
        ({"payload": {"mass": -3.0}}, 10, "payload.mass must be finite and not negative, got -3"),
        ({"payload": {"mas": 3.0}}, 10, "mas"),
        ({"sample_period": 0.0}, 10, "sample_period must be positive and finite, got 0"),
        (3, 10, "scenario must be a mapping"),
    ],
)
def test_what_has_no_model_is_refused(scenario: Any, hold: Any, match: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=match):
        drm_env.transitions(scenario, hold=hold)
