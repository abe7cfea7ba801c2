"""Imitation: the teacher's plans are good, and a student learns them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_baselines.benchmark.programme import (
    closed_loop,
    linear_feedback,
    propagate,
    rms,
    torque_limits,
)
from drm_baselines.benchmark.suites import STRATA
from drm_baselines.errors import ExistingResultError, RunError
from drm_baselines.imitation import teacher
from drm_baselines.network import load_policy

pytest.importorskip("torch")
from drm_baselines.imitation import dagger, replanning
from drm_baselines.imitation.flights import Flight

TEACHING = teacher.Teaching(scenarios=8, generations=1, replanned=1.0, period=200)
STUDY = dagger.Study(
    rounds=2, share=1.0, kept=0.02, epochs=1, last_epochs=1, batch_size=64, layers=(16,),
    teaching=TEACHING,
)  # fmt: skip


@pytest.fixture(scope="module")
def plans() -> list[teacher.Plans]:
    return teacher.make_plans(TEACHING)


@pytest.fixture(scope="module")
def scenario() -> dict[str, Any]:
    found: dict[str, Any] = drm_env.sample_scenarios(
        config=TEACHING.config(1), seed=TEACHING.first_seed, n=1
    )[0]
    return found


def test_plan_is_smooth_and_comes_to_rest(scenario: dict[str, Any]) -> None:
    plan = teacher.plan_from(scenario, TEACHING)
    assert plan.solved
    assert plan.torques.shape == (1500, 2)
    assert plan.gains.shape == (1500, 2, 6)
    # long after the slew nothing is left to be done
    assert np.abs(plan.torques[-100:]).max() < 1e-2
    jumpy = teacher.plan_from(scenario, replace(TEACHING, smoothing=1e-6))
    changes = [np.square(np.diff(one.torques, axis=0)).sum() for one in (plan, jumpy)]
    assert changes[0] < changes[1]


def test_plan_from_a_state_of_the_plan_is_its_rest(scenario: dict[str, Any]) -> None:
    whole = teacher.plan_from(scenario, TEACHING)
    rest = teacher.plan_from(scenario, TEACHING, 400, whole.states[400].astype(np.float64))
    # but for the smoothness of the first torque, which the plan anew does not know (principle of
    # optimality)
    np.testing.assert_allclose(rest.torques[25:], whole.torques[425:], atol=0.02)
    np.testing.assert_allclose(rest.states[25:], whole.states[425:], atol=2e-5)


def test_feedback_leaves_a_saturated_wheel_at_its_limit(scenario: dict[str, Any]) -> None:
    plan = teacher.plan_from(scenario, TEACHING)
    law = linear_feedback(TEACHING.inner_law) / torque_limits(scenario)[:, None]
    intervals, wheels = np.nonzero(plan.saturated)
    assert intervals.size
    # r = u - F x: the torque u stays where it is whatever the deviation
    np.testing.assert_allclose(plan.gains[intervals, wheels], -law[wheels], rtol=1e-5, atol=1e-6)
    total = plan.torques + plan.states @ law.T
    np.testing.assert_array_equal(
        np.sign(total[intervals, wheels]), plan.saturated[intervals, wheels]
    )


def test_flying_the_plans_is_far_better_than_the_inner_law(plans: list[teacher.Plans]) -> None:
    for plan in plans:
        flight = Flight(plan, TEACHING)
        planned = flight.fly(None, lambda *_: None)["tip_error_rms"]
        scenarios = drm_env.sample_scenarios(
            config=flight.config, seed=flight.seeds[0], n=len(flight.seeds)
        )
        inner = drm_env.rollout(scenarios, law=dict(TEACHING.inner_law))["tip_error_rms"]
        assert np.median(planned) < 0.2 * np.median(inner)


def test_a_new_plan_under_way_is_better_than_the_old_one(plans: list[teacher.Plans]) -> None:
    """Half way the arm is pushed off its plan: the plan anew knows best, in its own model."""
    plan = plans[1]
    index = int(np.argmax(np.abs(plan.saturated).sum(axis=(1, 2))))
    seed = int(plan.seeds[index])
    first = TEACHING.seeds(1)[0]
    scenario = drm_env.sample_scenarios(config=TEACHING.config(1), seed=seed, n=1)[0]
    assert seed >= first
    k = 200
    pushed = plan.states[index, k].astype(np.float64)
    pushed[0] += 0.01
    anew = teacher.plan_from(scenario, TEACHING, k, pushed)
    assert anew.solved
    feedback, limits = linear_feedback(TEACHING.inner_law), torque_limits(scenario)
    model = closed_loop(drm_env.transitions(scenario, hold=1), feedback, TEACHING.hold)
    later = drm_env.Transitions(pushed, *(part[k:] for part in model[1:]))
    _, best = propagate(later, anew.torques * limits)
    # the old plan with its feedback, wheels limited
    state, held = pushed, []
    for i in range(k, len(model.offset)):
        wanted = plan.torques[index, i] + plan.gains[index, i] @ (state - plan.states[index, i])
        law = feedback @ state / limits
        torque = (np.clip(wanted + law, -1.0, 1.0) - law) * limits
        held.append(torque)
        state = model.transition[i] @ state + model.input[i] @ torque + model.offset[i]
    _, old = propagate(later, np.array(held))
    assert rms(best) < rms(old)


def test_pilots_examples_are_made_once(plans: list[teacher.Plans], tmp_path: Path) -> None:
    pilot = replace(STUDY, rounds=1)
    told: list[str] = []
    first = replanning.prepare(
        tmp_path, plans, TEACHING, pilot=pilot, progress=lambda what, *_: told.append(what)
    )
    assert len(first) == 1
    observations, actions, trust = first[0]
    assert len(observations) == len(actions) == len(trust) > 0
    assert np.isfinite(observations).all()
    assert np.abs(actions).max() <= 1.0
    assert {"pilot 1", "new plans for pilot 1"} == set(told)
    told.clear()
    again = replanning.prepare(
        tmp_path, plans, TEACHING, pilot=pilot, progress=lambda what, *_: told.append(what)
    )
    assert not told
    np.testing.assert_array_equal(again[0][1], actions)
    damaged = tmp_path / "examples_0.npz"
    damaged.write_bytes(damaged.read_bytes()[:100])
    with pytest.raises(RunError, match=r"examples_0\.npz"):
        replanning.prepare(tmp_path, plans, TEACHING, pilot=pilot)


def test_plans_are_kept_and_read_back(plans: list[teacher.Plans], tmp_path: Path) -> None:
    path = teacher.save_plans(tmp_path / "plans.npz", plans, TEACHING)
    again = teacher.load_plans(path, TEACHING)
    assert again is not None
    assert len(again) == len(STRATA)
    for first, second in zip(plans, again, strict=True):
        np.testing.assert_array_equal(first.torques, second.torques)
        np.testing.assert_array_equal(first.seeds, second.seeds)
    assert teacher.load_plans(path, replace(TEACHING, smoothing=2e-3)) is None
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(RunError, match=r"plans\.npz"):
        teacher.load_plans(path, TEACHING)


def test_student_is_saved_and_repeatable(plans: list[teacher.Plans], tmp_path: Path) -> None:
    points: list[dict[str, float]] = []
    first = dagger.imitate(tmp_path / "first", STUDY, plans, watch=lambda _, p: points.append(p))
    second = dagger.imitate(tmp_path / "second", STUDY, plans)
    policy, again = load_policy(first), load_policy(second)
    for one, other in zip(policy.network.weights, again.network.weights, strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(points) == 2
    assert policy.control_period == 0.02
    training = policy.description["training"]
    assert isinstance(training["command"], list)
    assert training["seed"] == 0
    assert training["steps"] == 2 * 8 * 1500
    # numpy's and the engine's network are the same function
    observations = np.random.default_rng(1).normal(size=(50, policy.network.inputs))
    np.testing.assert_allclose(
        policy.network(observations), policy.network.engine()(observations), atol=2e-6
    )
    with pytest.raises(ExistingResultError):
        dagger.imitate(first, STUDY, plans)
