"""Imitation: the teacher's plans are good, and a student learns them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import drm_env
from drm_baselines.benchmark.suites import STRATA
from drm_baselines.errors import ExistingResultError, RunError
from drm_baselines.imitation import teacher
from drm_baselines.network import load_policy

pytest.importorskip("torch")
from drm_baselines.imitation import dagger

TEACHING = teacher.Teaching(scenarios=8)
STUDY = dagger.Study(
    rounds=2, share=1.0, kept=0.02, epochs=1, last_epochs=1, batch_size=64, layers=(16,),
    teaching=TEACHING,
)  # fmt: skip


@pytest.fixture(scope="module")
def plans() -> list[teacher.Plans]:
    return teacher.make_plans(TEACHING)


def test_plan_is_smooth_and_leaves_authority() -> None:
    scenario = drm_env.sample_scenarios(config=TEACHING.config(1), seed=TEACHING.first_seed, n=1)[0]
    torques, angle, solved = teacher.plan_of(scenario, TEACHING)
    assert solved
    assert torques.shape == (1500, 2)
    assert angle.shape == (1500,)
    jumpy = replace(TEACHING, smoothing=1e-6)
    rough, _, _ = teacher.plan_of(scenario, jumpy)
    assert np.square(np.diff(torques, axis=0)).sum() < np.square(np.diff(rough, axis=0)).sum()


def test_flying_the_plans_is_far_better_than_the_inner_law(plans: list[teacher.Plans]) -> None:
    rng = np.random.default_rng(0)
    for plan in plans:
        lesson = dagger._Lesson(plan, STUDY, rng)
        env = drm_env.DrmVectorEnv(num_envs=len(lesson.seeds), config=lesson.config)
        observations, _ = env.reset(seed=lesson.seeds)
        for k in range(plan.torques.shape[1]):
            observations, _, _, _, info = env.step(lesson.advice(k, observations))
        env.close()
        planned = np.asarray(info["metrics/tip_error_rms"])
        scenarios = drm_env.sample_scenarios(
            config=lesson.config, seed=lesson.seeds[0], n=len(lesson.seeds)
        )
        inner = drm_env.rollout(scenarios, law=dict(TEACHING.inner_law))["tip_error_rms"]
        assert np.median(planned) < 0.5 * np.median(inner)


def test_plans_are_kept_and_read_back(plans: list[teacher.Plans], tmp_path: Path) -> None:
    path = teacher.save_plans(tmp_path / "plans.npz", plans, TEACHING)
    again = teacher.load_plans(path, TEACHING)
    assert again is not None
    assert len(again) == len(STRATA)
    for first, second in zip(plans, again, strict=True):
        np.testing.assert_array_equal(first.torques, second.torques)
        np.testing.assert_array_equal(first.seeds, second.seeds)
    assert teacher.load_plans(path, replace(TEACHING, smoothing=1e-3)) is None
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
