"""Refinement: every derivative against differences of what the engine flies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.imitation.observation_jacobian import SEEN, Sensing
from drm_baselines.imitation.teacher import Teaching
from drm_baselines.optimal_control.quadratic_program import linear_feedback, torque_limits

pytest.importorskip("torch")
import torch

from drm_baselines.imitation import analytic_gradient, plant_jacobian
from drm_baselines.imitation.student import Student

TEACHING = Teaching(scenarios=8)
SETTINGS = analytic_gradient.Refinement(manoeuvres=8, steps=4, batch=4, tail=30.0, rest_delay=0.0)
LOSS = (SETTINGS.scale, SETTINGS.floor, SETTINGS.largest)
HORIZON = 1500  # decisions
LINK1 = drm_env.default_config().scenario.arm.link1.length
SIGNALS = ("time", "slew_angle", "reference_angle", "extension", "tip_deflection")


@pytest.fixture(scope="module")
def intervals(tmp_path_factory: pytest.TempPathFactory) -> plant_jacobian.Intervals:
    path = tmp_path_factory.mktemp("refining") / "intervals.npz"
    return plant_jacobian.prepare(path, TEACHING, SETTINGS.manoeuvres, SETTINGS.tail)


@pytest.fixture(scope="module")
def limits() -> torch.Tensor:
    scenario = drm_env.sample_scenarios(config=TEACHING.config(0), seed=1, n=1)[0]
    return torch.from_numpy(torque_limits(scenario).astype(np.float32))


@pytest.fixture(scope="module")
def seeds() -> NDArray[np.int64]:
    """Two manoeuvres a stratum."""
    return np.concatenate([np.array(TEACHING.seeds(stratum)) for stratum in range(4)])


def gentle_student(entries: int) -> Student:
    """Return a student of small gains, whose flights a small change changes little."""
    torch.manual_seed(3)
    student = Student((12,), "tanh", np.zeros(entries, np.float32), np.ones(entries, np.float32))
    with torch.no_grad():
        for parameter in student.parameters():
            parameter *= 0.05
    return student


def test_observations_depend_on_the_arm_as_the_sensing_says() -> None:
    """Differences of two flights of the same manoeuvre with slightly different torques."""
    config = TEACHING.config(1)
    sensing = Sensing(config)
    env = drm_env.DrmVectorEnv(num_envs=2, config=config)
    rng = np.random.default_rng(0)
    checked: dict[int, int] = {}
    try:
        observations, _ = env.reset(seed=[7, 7])
        for k in range(400):
            actions = np.repeat(rng.uniform(-0.1, 0.1, size=(1, 2)), 2, axis=0)
            actions[1] += 1e-3 * rng.normal(size=2)
            observations, *_ = env.step(actions.astype(np.float32))
            if k < 100 or k % 7:
                continue
            state = sensing.states(env, observations)
            wheels = [
                sensing.values(observations, f"{wheel}_{what}")
                for what in ("momentum", "torque")
                for wheel in ("root", "tip")
            ]
            eight = np.concatenate([state[:, SEEN], np.array(wheels).T], axis=1)
            change = eight[1] - eight[0]
            predicted = np.zeros(sensing.entries)
            for slope in sensing.slopes(observations):
                if slope.age == 0:
                    predicted[slope.entry] += slope.slope.mean() * change[slope.quantity]
            seen = (observations[1] - observations[0]).astype(np.float64)
            newest = np.arange(sensing.entries) >= sensing.entries * 2 // 3
            # float32 observations resolve a difference to some 1e-7 of the entry
            resolution = 4e-7 * np.abs(observations[0]) + 1e-9
            for entry in np.flatnonzero(newest & (np.abs(seen) > 300.0 * resolution)):
                assert predicted[entry] == pytest.approx(seen[entry], rel=0.05), entry
                checked[int(entry)] = checked.get(int(entry), 0) + 1
    finally:
        env.close()
    names = [entry.name for entry in drm_env.observation_layout(config=config)]
    found = {names[entry] for entry in checked}
    assert {"slew_error_fine", "link2_deflection_rate_fine", "identified_mass_error"} <= found
    assert {"root_momentum", "tip_momentum", "root_torque", "tip_torque"} <= found


def test_unlimited_interval_is_the_same_known_beforehand_and_followed(
    intervals: plant_jacobian.Intervals, limits: torch.Tensor
) -> None:
    """Far from the limits the matrices of the middle stand for those of all samples."""
    some = intervals.of(np.array([0]))
    rng = np.random.default_rng(1)
    count = len(some.onward)
    states = torch.from_numpy((1e-5 * rng.normal(size=(count, 6))).astype(np.float32))
    actions = torch.from_numpy((1e-3 * rng.normal(size=(count, 2))).astype(np.float32))
    quiet = np.abs(some.drift).max(axis=(1, 2)) == 0.0
    assert quiet.any()
    known = plant_jacobian.derivatives(some, states, actions, TEACHING, limits)
    parts = [torch.from_numpy(part) for part in (some.transition, some.given, some.drift)]
    seen = [
        torch.from_numpy(part) for part in (some.error_state, some.error_input, some.error_drift)
    ]
    feedback = torch.from_numpy(linear_feedback(TEACHING.inner_law).astype(np.float32))
    onward, cost, squared = plant_jacobian._followed(
        parts, seen, states, actions * TEACHING.wheel_scale * limits, feedback, limits,
        TEACHING.wheel_scale,
    )  # fmt: skip
    for one, other in ((known.onward, onward), (known.cost, cost), (known.squared, squared)):
        one, other = one[quiet], other[quiet]
        assert (one - other).abs().max() <= 2e-3 * other.abs().max()


def test_limited_interval_has_the_derivatives_of_its_differences(
    intervals: plant_jacobian.Intervals, limits: torch.Tensor
) -> None:
    """Central differences of the followed interval, in double precision, wheels at their limits."""
    some = intervals.of(np.array([2]))
    rng = np.random.default_rng(2)
    rows = np.arange(20, 420, 10)

    def tensors(*names: str) -> list[torch.Tensor]:
        return [torch.from_numpy(getattr(some, name)[rows].astype(np.float64)) for name in names]

    parts = tensors("transition", "given", "drift")
    seen = tensors("error_state", "error_input", "error_drift")
    feedback = torch.from_numpy(linear_feedback(TEACHING.inner_law))
    double = limits.double()
    states = torch.from_numpy(1e-3 * rng.normal(size=(len(rows), 6)))
    actions = torch.from_numpy(0.3 * rng.normal(size=(len(rows), 2)))

    torch.set_default_dtype(torch.float64)
    try:

        def followed(s: torch.Tensor, a: torch.Tensor) -> tuple[torch.Tensor, ...]:
            torques = a * TEACHING.wheel_scale * double
            return plant_jacobian._followed(
                parts, seen, s, torques, feedback, double, TEACHING.wheel_scale
            )

        cost = followed(states, actions)[1]
        step = 1e-7
        agree = []
        for i in range(8):
            moved = [states.clone(), actions.clone()]
            part, column = (moved[0], i) if i < 6 else (moved[1], i - 6)
            part[:, column] += step
            above = followed(*moved)[2]
            part[:, column] -= 2.0 * step
            below = followed(*moved)[2]
            difference = (above - below) / (2.0 * step)
            scale = cost[:, i].abs().max()
            agree.append(((cost[:, i] - difference).abs() <= 1e-4 * scale).double().mean().item())
    finally:
        torch.set_default_dtype(torch.float32)
    # a difference across the instant at which a limit is reached is off, and rare
    assert min(agree) >= 0.9


def test_squared_errors_and_gradient_are_the_engines(
    intervals: plant_jacobian.Intervals, limits: torch.Tensor, seeds: NDArray[np.int64]
) -> None:
    """Derivative along a direction of the weights against differences of flown tip errors."""
    fleet = analytic_gradient.Fleet(TEACHING, len(seeds))
    student = gentle_student(fleet.sensing.entries)
    torch.manual_seed(5)
    direction = [torch.randn_like(p) * p.detach().abs().mean() for p in student.parameters()]

    def move(step: float) -> None:
        with torch.no_grad():
            for parameter, along in zip(student.parameters(), direction, strict=True):
                parameter += step * along

    def flown_errors() -> NDArray[np.float64]:
        """Return the mean squared tip errors of the whole and after the slew, (2, manoeuvres)."""
        network = student.perceptron().engine()
        found = []
        for stratum in range(4):
            config = TEACHING.config(stratum)
            part = TEACHING.seeds(stratum)
            scenarios = drm_env.sample_scenarios(config=config, seed=part[0], n=len(part))
            flown = drm_env.rollout(scenarios, policy=network, config=config, signals=SIGNALS)
            for i, end in enumerate(flown["slew_end_time"]):
                time, angle, reference, extension, deflection = (
                    flown.trajectories[name][i] for name in SIGNALS
                )
                errors = np.square((angle - reference) * (LINK1 + extension) + deflection)
                resting = time >= np.ceil(end / 0.02) * 0.02 - 1e-9
                found.append((flown["tip_error_rms"][i] ** 2, errors[resting].mean()))
        return np.array(found).T

    try:
        flown = fleet.fly(student.perceptron(), [int(s) for s in seeds], intervals.counts)
        answers = analytic_gradient.Answers(student, flown.observations)
        goals = analytic_gradient.gradient(
            answers, flown, intervals, TEACHING, fleet.sensing, limits, HORIZON
        )
    finally:
        fleet.close()
    now = flown_errors()
    for goal, errors in zip(goals, now, strict=True):
        np.testing.assert_allclose(goal.squared, errors, rtol=0.01)

    observations = torch.from_numpy(flown.observations)
    step = 1e-3
    with torch.no_grad():
        move(step)
        above = student(observations)
        move(-2.0 * step)
        below = student(observations)
        move(step)
    along = ((above - below) / (2.0 * step)).numpy().astype(np.float64)
    starts = np.cumsum(flown.counts) - flown.counts
    move(step)
    errors_above = flown_errors()
    move(-2.0 * step)
    errors_below = flown_errors()
    move(step)
    differences = (errors_above - errors_below) / (2.0 * step)
    for goal, difference in zip(goals, differences, strict=True):
        predicted = np.add.reduceat((goal.worth * along).sum(axis=1), starts)
        scale = np.abs(difference).max()
        np.testing.assert_allclose(predicted, difference, rtol=0.1, atol=0.01 * scale)


def test_weights_are_the_slope_of_the_loss_and_capped() -> None:
    squared = np.array([1e-8, 1e-6, 1e-5, 1e-3, 1e-1])
    small = np.full(5, 1e-12)
    loss, weight = analytic_gradient.weights(squared, small, *LOSS)
    step = 1e-4 * squared
    above, below = (
        analytic_gradient.weights(squared + sign * step, small, *LOSS)[0] for sign in (1.0, -1.0)
    )
    np.testing.assert_allclose(weight, (above - below) / (2.0 * step), rtol=1e-4)
    assert (np.diff(loss) > 0).all()
    assert (loss < 1).all()
    # the relative change of a manoeuvre's error never counts for more than the largest
    for lengths in (np.full(5, 1.0), np.full(5, np.inf)):
        _, capped = analytic_gradient.weights(squared, lengths, *LOSS)
        assert np.isfinite(capped).all()
        finite = np.where(np.isfinite(lengths), lengths, 0.0)
        assert (capped * finite <= SETTINGS.largest + 1e-9).all()


@pytest.mark.parametrize("rest", [0.0, 1.0])
def test_refinement_makes_a_student_better_and_is_repeatable(
    intervals: plant_jacobian.Intervals, rest: float
) -> None:
    found = []
    for _ in range(2):
        student = gentle_student(Sensing(TEACHING.config(0)).entries)
        rng = np.random.default_rng(0)
        settings = analytic_gradient.Refinement(
            manoeuvres=8, steps=20, batch=8, tail=SETTINGS.tail, learning_rate=3e-3, warm_up=1,
            rest=rest,
        )  # fmt: skip
        told = list(analytic_gradient.refine(student, intervals, TEACHING, settings, rng))
        found.append((told, student.perceptron().weights))
    (first, weights), (second, again) = found
    assert [step for step, _, _ in first] == list(range(1, 21))
    assert all(decisions == 8 * HORIZON for _, decisions, _ in first)
    losses = [loss for _, _, loss in first]
    assert losses[-1] < 0.95 * losses[0]
    assert first == second
    for one, other in zip(weights, again, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", ["manoeuvres", "batch"])
@pytest.mark.parametrize("value", [0, 6])
def test_settings_that_no_strata_can_share_are_refused(name: str, value: int) -> None:
    with pytest.raises(BaselineError, match=f"{name} must be a multiple of 4, got {value}"):
        analytic_gradient.Refinement(**{name: value})


@pytest.mark.parametrize("delay", [-0.1, 4.0, float("nan")])
def test_rest_that_begins_after_the_flight_is_refused(delay: float) -> None:
    with pytest.raises(BaselineError, match=rf"rest_delay .* tail \(4\.0\), got {delay}"):
        analytic_gradient.settling(rest_delay=delay)


def test_manoeuvres_are_drawn_once_before_any_is_drawn_again() -> None:
    deck = analytic_gradient._Deck(10, np.random.default_rng(4))
    drawn = np.concatenate([deck.draw(5), deck.draw(5)])
    assert sorted(drawn.tolist()) == list(range(10))
    assert sorted(deck.draw(10).tolist()) == list(range(10))
    assert len(deck.draw(25)) == 25


def test_intervals_are_kept_and_read_back(
    intervals: plant_jacobian.Intervals, tmp_path: Path
) -> None:
    path = tmp_path / "intervals.npz"
    told: list[int] = []
    made = plant_jacobian.prepare(
        path, TEACHING, 4, 1.0, progress=lambda done, _: told.append(done)
    )
    assert told[-1] == 4
    told.clear()
    again = plant_jacobian.prepare(
        path, TEACHING, 4, 1.0, progress=lambda done, _: told.append(done)
    )
    assert not told
    for name in ("counts", "onward", "errors"):
        np.testing.assert_array_equal(getattr(made, name), getattr(again, name))
    # a shorter tail has fewer intervals of the same content
    assert made.counts[0] < intervals.counts[0]
    np.testing.assert_array_equal(
        made.of(np.array([0])).onward, intervals.of(np.array([0])).onward[: made.counts[0]]
    )
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(RunError, match=r"intervals\.npz"):
        plant_jacobian.prepare(path, TEACHING, 4, 1.0)
