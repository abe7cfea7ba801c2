"""Programme and feedback in stages, and models by mass, against what they are faster than."""

from __future__ import annotations

import numpy as np
import pytest

import drm_env
from drm_baselines.optimal_control.kalman_filter import late
from drm_baselines.optimal_control.payload_models import (
    MassModels,
    merged,
    prolonged,
    rest_of,
    weights,
)
from drm_baselines.optimal_control.quadratic_program import Programme, closed_loop, torque_limits
from drm_baselines.optimal_control.staged import feedback, plan, stages_of
from drm_baselines.optimal_control.tvlqr import feedback_around, saturation
from drm_env.constants import LINK_END_DEFLECTION

LIGHT = {"payload": {"mass": 150.0}, "slew": {"angle": 0.3, "smoothing": 0.1}, "horizon": 12.0}
HEAVY = {"payload": {"mass": 400.0}, "slew": {"angle": 1.2}, "horizon": 20.0}
NOTHING = np.zeros((2, 6))


def coarse(scenario: dict[str, object]) -> drm_env.Transitions:
    return merged(drm_env.transitions(scenario, hold=2), 5)


@pytest.mark.parametrize(("scenario", "saturates"), [(LIGHT, False), (HEAVY, True)])
@pytest.mark.parametrize("error", [0.0, 0.1])
def test_a_plan_is_the_one_of_the_other_solver(
    scenario: dict[str, object], saturates: bool, error: float
) -> None:
    """Whatever error was expected, which scales the programme."""
    model, limits = coarse(scenario), torque_limits(scenario)
    stages = stages_of(model, limits, 0.0)
    smoothing, authority = 1e-4, 0.99
    found = plan(stages, model.start, smoothing=smoothing, authority=authority, error=error)
    held, states, solved = Programme(
        model, limits, smoothing=np.full(2, smoothing), authority=authority
    ).solve(model.error_offset)
    assert found is not None and solved
    other = np.concatenate([states, held / limits], axis=1)

    def cost(z: np.ndarray) -> float:
        change = smoothing**2 * np.square(np.diff(z[:, 6:], axis=0)).sum()
        return float(stages.errors(z).sum() + change)

    assert saturates == (np.abs(other[:, 6:]) > authority - 1e-3).any()
    # a micrometre is what either solver leaves
    assert np.sqrt(cost(found) / len(found)) == pytest.approx(
        np.sqrt(cost(other) / len(other)), rel=2e-3, abs=1e-6
    )
    assert np.abs(found[:, 6:]).max() <= authority + 1e-6
    moved = (stages.motion @ found[:, :, None])[:, :, 0] + stages.offset
    np.testing.assert_allclose(found[1:, :6], moved[:-1], atol=1e-7)


def test_errors_are_those_of_the_model() -> None:
    model, limits = coarse(LIGHT), torque_limits(LIGHT)
    rng = np.random.default_rng(0)
    z = rng.standard_normal((len(model.offset), 8)) * 1e-2
    errors = (
        (model.error_state @ z[:, :6, None])[..., 0]
        + (model.error_input @ (z[:, 6:] * limits)[:, :, None])[..., 0]
        + model.error_offset
    )
    sway = 0.01 * LINK_END_DEFLECTION * z[:, 4:6].sum(axis=1)
    np.testing.assert_allclose(
        stages_of(model, limits, 0.01).errors(z), np.square(errors).mean(axis=1) + sway**2
    )


def test_the_feedback_is_the_one_of_the_general_sweep() -> None:
    model, limits, sway = coarse(HEAVY), torque_limits(HEAVY), 3e-4
    stages = stages_of(model, limits, sway)
    found = plan(stages, model.start, smoothing=1e-4, authority=0.99)
    assert found is not None
    saturated = saturation(found[:, 6:], found[:, :6], NOTHING, np.ones(2), 0.99)
    assert {0, 1, 2} == set(np.abs(saturated).sum(axis=1).tolist())
    # the sway as one more sample of the error, which counts for all of them
    samples = model.error_offset.shape[1]
    row = np.zeros((len(found), 1, 6))
    row[..., 4:] = LINK_END_DEFLECTION * sway * np.sqrt(samples)
    swaying = model._replace(
        error_state=np.concatenate([model.error_state * np.sqrt(1.0 + 1.0 / samples), row
                                    * np.sqrt(1.0 + 1.0 / samples)], axis=1),
        error_input=np.concatenate([model.error_input * np.sqrt(1.0 + 1.0 / samples),
                                    np.zeros((len(found), 1, 2))], axis=1),
    )  # fmt: skip
    expected = feedback_around(swaying, limits, NOTHING, saturated, 1e-3)
    gains = feedback(stages, saturated, 1e-3)
    scale = np.abs(expected).max(axis=0)
    assert (np.abs(gains - expected) <= 1e-6 * scale).all()
    assert (gains[saturated != 0] == 0.0).all()


def test_merged_intervals_are_those_of_the_law_that_is_none() -> None:
    fine = drm_env.transitions(LIGHT, hold=1)
    for one, other in zip(merged(fine, 10), closed_loop(fine, NOTHING, 10), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


def test_nothing_changes_once_the_reference_rests() -> None:
    whole = coarse(LIGHT)
    rest = rest_of(whole)
    assert 0 < rest < len(whole.offset) - 50
    short = coarse({**LIGHT, "horizon": 0.02 * (rest + 1)})
    for one, other in zip(prolonged(short, len(whole.offset)), whole, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-9 * np.abs(other).max())


def test_models_between_measured_masses() -> None:
    masses = []

    def measure(mass: float) -> tuple[drm_env.Transitions, ...]:
        masses.append(mass)
        return (coarse({**LIGHT, "payload": {"mass": mass}}),)

    models = MassModels(measure)
    models.at(150.0)
    models.at(165.0)
    assert masses == pytest.approx([150.0, 151.5, 165.0, 166.65])
    (found,), (slope,) = models.at(166.0)
    assert models.measured == 4
    (truth,), (more,), (less,) = measure(166.0), measure(166.0 * 1.001), measure(166.0 * 0.999)
    for name in ("transition", "input", "offset"):
        one, other = getattr(found, name), getattr(truth, name)
        change = (getattr(more, name) - getattr(less, name)) / 0.002
        # as good as a mass that is known to 1e-4
        assert np.abs(one - other).max() < 1e-4 * np.abs(change).max()
        assert np.abs(getattr(slope, name) - change).max() < 0.02 * np.abs(change).max()
    models.at(169.0)
    assert masses[-1] == 169.0 and models.measured == 5


def test_a_payload_of_no_mass_has_no_slope() -> None:
    (_,), (slope,) = MassModels(lambda _: (coarse(LIGHT),)).at(0.0)
    assert not slope.transition.any()


def test_weights_are_those_of_the_parabola() -> None:
    values, slopes = weights([1.0, 2.0, 4.0], 3.0)
    sample = [1.0 + 2.0 * x - 0.5 * x**2 for x in (1.0, 2.0, 4.0)]
    assert np.dot(values, sample) == pytest.approx(1.0 + 6.0 - 4.5)
    assert np.dot(slopes, sample) == pytest.approx(2.0 - 3.0)


def test_late_is_where_the_arm_was() -> None:
    fine, delay = drm_env.transitions(LIGHT, hold=1), 3
    past = late(fine, 10, delay)
    rng = np.random.default_rng(0)
    k, torque, state = 4, rng.standard_normal(2), rng.standard_normal(6) * 1e-3
    for sample in range(10 * k, 10 * (k + 1)):
        if sample == 10 * (k + 1) - delay:
            then = state
        state = fine.transition[sample] @ state + fine.input[sample] @ torque + fine.offset[sample]
    found = past.state[k] @ state - past.torque[k] @ torque - past.offset[k]
    np.testing.assert_allclose(found, then, rtol=1e-6, atol=1e-9)
