"""Imitation: the teacher's plans are good, and a student learns them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_baselines.benchmark.competitors import shipped_runs
from drm_baselines.errors import BaselineError, ExistingResultError, RunError
from drm_baselines.imitation import teacher
from drm_baselines.optimal_control.quadratic_program import linear_feedback, torque_limits
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.suites import STRATA

pytest.importorskip("torch")
from drm_baselines.imitation import analytic_gradient, dagger, plant_jacobian
from drm_baselines.imitation.teacher_rollout import Flight

TEACHING = teacher.Teaching(scenarios=8)
REFINEMENT = analytic_gradient.Refinement(manoeuvres=8, steps=2, batch=4, tail=1.0, rest_delay=0.5)
SETTLING = analytic_gradient.settling(manoeuvres=8, steps=2, batch=4, tail=1.0, rest_delay=0.5)
STUDY = dagger.Study(
    rounds=2, kept=0.02, epochs=1, last_epochs=1, batch_size=64, layers=(16,),
    teaching=TEACHING, refinement=REFINEMENT, settling=SETTLING,
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
    plan = teacher.plan_of(scenario, TEACHING)
    assert plan.solved
    assert plan.torques.shape == (1500, 2)
    assert plan.gains.shape == (1500, 2, 6)
    # long after the slew nothing is left to be done
    assert np.abs(plan.torques[-100:]).max() < 1e-2
    jumpy = teacher.plan_of(scenario, replace(TEACHING, smoothing=1e-6))
    changes = [np.square(np.diff(one.torques, axis=0)).sum() for one in (plan, jumpy)]
    assert changes[0] < changes[1]


def test_feedback_leaves_a_saturated_wheel_at_its_limit(scenario: dict[str, Any]) -> None:
    plan = teacher.plan_of(scenario, TEACHING)
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


@pytest.fixture(scope="module")
def intervals(tmp_path_factory: pytest.TempPathFactory) -> plant_jacobian.Intervals:
    path = tmp_path_factory.mktemp("imitation") / "intervals.npz"
    return plant_jacobian.prepare(path, TEACHING, REFINEMENT.manoeuvres, REFINEMENT.tail)


@pytest.fixture(scope="module")
def run(
    plans: list[teacher.Plans], intervals: plant_jacobian.Intervals,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:  # fmt: skip
    """Return a whole run."""
    return dagger.imitate(tmp_path_factory.mktemp("run") / "run", STUDY, plans, intervals)


def test_student_is_saved_and_repeatable(
    plans: list[teacher.Plans], intervals: plant_jacobian.Intervals, run: Path, tmp_path: Path
) -> None:
    told: list[tuple[str, int, bool]] = []
    second = dagger.imitate(
        tmp_path / "second", STUDY, plans, intervals,
        watch=lambda stage, number, point: told.append((stage, number, point is not None)),
    )  # fmt: skip
    policy, again = load_policy(run), load_policy(second)
    for one, other in zip(policy.network.weights, again.network.weights, strict=True):
        np.testing.assert_array_equal(one, other)
    assert [entry for entry in told if entry[2]] == [
        ("imitation", 1, True), ("imitation", 2, True),
        ("refinement", 1, True), ("refinement", 2, True),
        ("settling", 1, True), ("settling", 2, True),
    ]  # fmt: skip
    assert policy.control_period == 0.02
    training = policy.description["training"]
    assert isinstance(training["command"], list)
    assert training["seed"] == 0
    assert training["finished"] is True
    # two rounds of eight manoeuvres, and what was flown for the gradient
    assert training["steps"] > 2 * 8 * 1500
    # numpy's and the engine's network are the same function
    observations = np.random.default_rng(1).normal(size=(50, policy.network.inputs))
    np.testing.assert_allclose(
        policy.network(observations), policy.network.engine()(observations), atol=2e-6
    )
    with pytest.raises(ExistingResultError):
        dagger.imitate(run, STUDY, plans, intervals)


def test_settling_begins_with_a_policy_as_a_whole_run_goes_on(
    plans: list[teacher.Plans], intervals: plant_jacobian.Intervals, run: Path, tmp_path: Path
) -> None:
    """In two sittings or in one: the same weights, counts and curve."""
    refined = replace(STUDY, settling=replace(SETTLING, steps=0))
    first = dagger.imitate(tmp_path / "first", refined, plans, intervals)
    other = replace(STUDY, teaching=replace(TEACHING, wheel_scale=2.0))
    with pytest.raises(BaselineError, match=r"config\.task\.wheel_scale must be 2\.0, got 4\.0"):
        dagger.imitate(tmp_path / "second", other, [], intervals, start=first)
    second = dagger.imitate(tmp_path / "second", STUDY, [], intervals, start=first)
    whole, parts = load_policy(run), load_policy(second)
    for one, other in zip(whole.network.weights, parts.network.weights, strict=True):
        np.testing.assert_array_equal(one, other)
    training = parts.description["training"]
    assert training["steps"] == whole.description["training"]["steps"]
    assert training["start"]["weights_sha256"] == load_policy(first).description["weights_sha256"]
    curves = [
        [line.split(",")[0] for line in (path / "evaluations.csv").read_text().splitlines()]
        for path in (run, second)
    ]
    assert curves[0] == curves[1]


def test_a_policy_that_is_no_student_is_refused(
    intervals: plant_jacobian.Intervals, run: Path, tmp_path: Path
) -> None:
    with pytest.raises(BaselineError, match=r"settling\.steps must be 0, got 2"):
        dagger.imitate(tmp_path / "out", STUDY, [], intervals, start=run)
    ppo = shipped_runs() / "ppo" / "seed_0"
    with pytest.raises(BaselineError, match=r"training\.algorithm must be 'dagger', got 'ppo'"):
        dagger.imitate(tmp_path / "out", STUDY, [], intervals, start=ppo)
    assert not (tmp_path / "out").exists()


def test_refinements_that_cannot_share_their_intervals_are_refused() -> None:
    with pytest.raises(BaselineError, match=r"settling\.tail must be .* \(1\.0\), got 2\.0"):
        replace(STUDY, settling=replace(SETTLING, tail=2.0))


def test_an_interrupted_student_is_taken_up_without_force(
    tmp_path: Path, plans: list[teacher.Plans], intervals: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dagger, "_CURVE_EPISODES", 2)
    still = {"refinement": replace(REFINEMENT, steps=0), "settling": replace(SETTLING, steps=0)}
    study = replace(STUDY, **still)
    whole = dagger.imitate(tmp_path / "whole", study, plans, intervals)
    directory = tmp_path / "run"

    def interrupting(stage: str, number: int, point: dict[str, float] | None) -> None:
        raise OSError("killed")

    with pytest.raises(OSError, match="killed"):
        dagger.imitate(directory, study, plans, intervals, watch=interrupting)
    kept = load_policy(directory)
    assert not kept.description["training"]["finished"]
    with pytest.raises(ExistingResultError, match="unfinished drm imitate with other settings"):
        dagger.imitate(directory, replace(study, seed=1), plans, intervals)
    assert load_policy(directory).description == kept.description
    dagger.imitate(directory, study, plans, intervals)
    digests = [load_policy(each).description["weights_sha256"] for each in (whole, directory)]
    assert digests[0] == digests[1]
    with pytest.raises(ExistingResultError, match="not empty"):
        dagger.imitate(directory, study, plans, intervals)
