"""What an agent may see of the payload, and how far it may overrule an inner law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import drm_env
from drm_baselines import PolicyError, make_policy
from drm_env import constants


def identified(error: float, seconds: float, **options: object) -> float:
    env = drm_env.DrmEnv(
        observe_identified=True, payload_mass=300.0, mass_error=error, inner_law="linear", **options
    )
    place = [entry.name for entry in env.unwrapped.observation_layout].index(
        "identified_mass_error"
    )
    scale = env.unwrapped.observation_layout[place].scale
    observation, _ = env.reset(seed=0)
    assert observation[place] == 0.0
    for _ in range(round(seconds / 0.01)):
        observation, *_ = env.step(np.array([0.3, -0.2], dtype=np.float32))
    env.close()
    return float(observation[place]) * scale


@pytest.mark.parametrize("error", [-0.15, -0.05, 0.0, 0.1])
def test_momentum_tells_the_true_mass(error: float) -> None:
    """Dimensions known: what is identified is true / reported - 1, up to the vibration."""
    found = identified(error, 5.0, payload_length=1.0, payload_width=0.5)
    assert found == pytest.approx(1.0 / (1.0 + error) - 1.0, abs=0.01)


@pytest.mark.parametrize("inertia", ["full", "slender"])
def test_slopes_of_the_identified_error_are_its_differences(inertia: str) -> None:
    """The balance of angular momentum written down anew, the inertia by its particles."""
    config = drm_env.resolve(observe_identified=True, payload_inertia=inertia)
    arm = config.config.scenario.arm
    rng = np.random.default_rng(4)
    extension = rng.uniform(1.0, 8.0, 20)
    ranges = ((50.0, 500.0), (0.1, 2.0), (0.1, 1.0))
    payload = np.column_stack([rng.uniform(low, high, 20) for low, high in ranges])
    mass, length, width = payload.T
    reach = arm.link1.length + extension

    def line(density: float, begin: NDArray, end: NDArray) -> NDArray:
        """Moment of inertia of a straight link, by the midpoints of its particles."""
        parts = (np.arange(20_000) + 0.5) / 20_000
        places = begin[:, None] + (end - begin)[:, None] * parts
        return density * (end - begin) * (places**2).mean(axis=1)

    centre = length**2 + (width**2 if inertia == "full" else 0.0)
    of_payload = mass * ((reach + length / 2.0) ** 2 + centre / 12.0)
    reported = of_payload + line(
        arm.link1.mass_per_length, 0.0 * reach, 0.0 * reach + arm.link1.length
    )
    reported += line(arm.link2.mass_per_length, reach - arm.link2.length, reach)
    rate = rng.choice([-1.0, 1.0], 20) * rng.uniform(0.05, 0.3, 20)

    def error(rate: NDArray, of_wheels: float = 0.0) -> NDArray:
        return ((momentum - of_wheels) / rate - reported) / of_payload

    momentum = reported * rate * (1.0 + rng.uniform(-0.2, 0.2, 20))
    by_rate, by_momentum = config.identification_slopes(error(rate), rate, extension, payload)
    step = 1e-6
    expected = (error(rate + step) - error(rate - step)) / (2.0 * step)
    np.testing.assert_allclose(by_rate, expected, rtol=1e-6)
    expected = (error(rate, 1.0) - error(rate, -1.0)) / 2.0
    np.testing.assert_allclose(by_momentum, expected, rtol=1e-6)


def test_what_is_not_identified_has_no_slope() -> None:
    config = drm_env.resolve(observe_identified=True)
    limit, slowest = constants.LARGEST_IDENTIFIED_ERROR, constants.SLOWEST_IDENTIFICATION
    payload = [[200.0, 1.0, 0.5]] * 4 + [[0.0, 0.0, 0.0]]
    errors, rates = [0.1, limit, -limit, 0.1, 0.0], [0.1, 0.1, 0.1, 0.99 * slowest, 0.1]
    by_rate, by_momentum = config.identification_slopes(errors, rates, [3.0] * 5, payload)
    assert (by_rate != 0.0).tolist() == (by_momentum != 0.0).tolist() == [True] + [False] * 4
    with pytest.raises(drm_env.ConfigError, match=r"payload \(n, 3\), got .*\(4, 3\)"):
        config.identification_slopes(errors, rates, [3.0] * 5, payload[:4])


def test_identification_needs_an_open_loop_slew() -> None:
    with pytest.raises(drm_env.ConfigError, match="observe_identified"):
        drm_env.DrmEnv(task="slew_direct", observe_identified=True)


def test_entry_is_there_only_when_asked_for() -> None:
    plain = [entry.name for entry in drm_env.observation_layout()]
    shown = [entry.name for entry in drm_env.observation_layout(observe_identified=True)]
    assert "identified_mass_error" not in plain
    assert [name for name in shown if name != "identified_mass_error"] == plain


def test_vector_shows_what_the_single_environment_shows() -> None:
    options = {"observe_identified": True, "wheel_scale": 2.0, "inner_law": "linear"}
    vector = drm_env.DrmVectorEnv(num_envs=3, **options)
    single = drm_env.DrmEnv(**options)
    observations, _ = vector.reset(seed=5)
    observation, _ = single.reset(seed=6)
    action = np.array([0.4, -0.7], dtype=np.float32)
    for _ in range(100):
        observations, *_ = vector.step(np.tile(action, (3, 1)))
        observation, *_ = single.step(action)
    np.testing.assert_array_equal(observations[1], observation)


def test_scaled_action_is_a_larger_torque_and_still_limited() -> None:
    def torque(scale: float, action: float) -> float:
        env = drm_env.DrmEnv(wheel_scale=scale)
        env.reset(seed=0)
        env.step(np.array([action, 0.0], dtype=np.float32))
        return float(env.unwrapped.signals()["root_torque"])

    assert torque(1.0, 0.25) == pytest.approx(25.0)
    assert torque(3.0, 0.25) == pytest.approx(75.0)
    assert torque(3.0, 1.0) == pytest.approx(100.0)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan")])
def test_impossible_scale_is_refused(scale: float) -> None:
    with pytest.raises(drm_env.ConfigError, match="wheel_scale"):
        drm_env.DrmEnv(wheel_scale=scale)


def test_learned_policy_flies_in_its_own_task_alone() -> None:
    policy = make_policy("learned")
    env = drm_env.DrmEnv(config=policy.config)
    again = make_policy("learned", env=env)
    observation, _ = env.reset(seed=0)
    action, _ = again.predict(observation)
    assert action.shape == env.action_space.shape
    with pytest.raises(PolicyError, match="observation"):
        make_policy("learned", config=drm_env.DrmEnv().config)
    with pytest.raises(PolicyError, match="no parameter 'gain'"):
        make_policy("learned", gain=1.0)


@pytest.mark.parametrize("name", ["lqr", "linear_tuned", "lyapunov_tuned"])
def test_tuned_laws_are_policies(name: str) -> None:
    policy = make_policy(name, config=drm_env.DrmEnv(control_period=0.002).config)
    assert policy.control_period == 0.002
    with pytest.raises(PolicyError, match="drm tune"):
        make_policy(name, tip=None)


# --- the settings of version 1 of the tasks -------------------------------------------------------


def reward_terms(seed: int = 3, **options: object) -> np.ndarray:
    """Terms of the reward over three seconds under the same actions, (steps, 2)."""
    env = drm_env.DrmEnv(**options)
    env.reset(seed=seed)
    terms = []
    for step in range(300):
        action = np.array([np.sin(0.1 * step), np.cos(0.2 * step)], dtype=np.float32)
        info = env.step(action)[4]
        terms.append([info["reward/tip_vibration"], info["reward/slew_error"]])
    env.close()
    return np.array(terms)


def test_linear_part_of_the_reward_is_the_error_itself() -> None:
    """Errors in metres follow from the logarithm, which is inverted; the linear part adds them."""
    plain, mixed = reward_terms(), reward_terms(reward={"linear": 2.5})
    rates = np.array([0.5, 1.0]) * 0.01  # weights times the control period
    errors = np.expm1(-plain / rates * np.log1p(1e4)) * 1e-4
    assert errors.max() > 0.01
    np.testing.assert_allclose(plain - mixed, rates * 2.5 * errors, rtol=1e-6, atol=1e-12)


def test_a_charge_for_ending_early_has_the_linear_part_too() -> None:
    """The limit, at the reach where it was exceeded, held for the rest of the horizon."""

    def last(linear: float) -> tuple[float, float, int]:
        reward = {"linear": linear, "slew_time": 0.0}
        env = drm_env.DrmEnv(limits={"slew_error": 1e-4}, reward=reward, horizon=8.0)
        names = [entry.name for entry in env.unwrapped.observation_layout]
        env.reset(seed=0)
        terminated, steps = False, 0
        while not terminated:
            observation, _, terminated, _, info = env.step(np.ones(2, dtype=np.float32))
            steps += 1
        env.close()
        reach = 7.0 + 8.0 * float(observation[names.index("extension")])
        return float(info["reward/slew_error"]), reach, steps

    (plain, reach, steps), (mixed, _, _) = last(0.0), last(3.0)
    held = 3.0 * (8.0 - 0.01 * steps) * reach * 1e-4
    assert plain - mixed == pytest.approx(held, rel=0.02)


@pytest.mark.parametrize("with_deflection", [False, True])
def test_slew_error_counts_with_the_deflection_if_asked(with_deflection: bool) -> None:
    """By the definition, at the only sample of an action; the logarithm's resolution is 0.1 mm."""
    env = drm_env.DrmEnv(
        control_period=0.002, deployment_start=5.0, deployment_end=5.0,
        reward={"slew_time": 0.3, "with_deflection": with_deflection},
    )  # fmt: skip
    env.reset(seed=0)
    for _ in range(40):
        *_, info = env.step(np.ones(2, dtype=np.float32))
    signals = env.signals()
    env.close()
    reach = 12.0
    error = reach * (signals["slew_angle"] - signals["reference_angle"])
    rate = reach * (signals["slew_rate"] - signals["reference_rate"])
    if with_deflection:
        error += signals["tip_deflection"]
        rate += 2.0 * (signals["alpha_rate"] + signals["beta_rate"])
    assert abs(signals["tip_deflection"]) > 1e-5
    cost = np.log1p(abs(error + 0.3 * rate) / 1e-4) / np.log1p(1e4)
    assert info["reward/slew_error"] == pytest.approx(-0.002 * cost, rel=1e-9)


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_impossible_linear_part_is_refused(value: float) -> None:
    with pytest.raises(drm_env.ConfigError, match=r"reward\.linear"):
        drm_env.DrmEnv(reward={"linear": value})


def test_error_at_the_tip_is_the_slew_error_times_the_reach() -> None:
    env = drm_env.DrmEnv(observe_tip_error=True)
    layout = env.unwrapped.observation_layout
    observation, _ = env.reset(seed=2)
    for _ in range(400):
        observation, *_ = env.step(np.array([0.5, -0.5], dtype=np.float32))
    env.close()
    value = {e.name: float(o) * e.scale for e, o in zip(layout, observation, strict=True)}
    error = (7.0 + value["extension"]) * value["slew_error"]
    assert abs(error) > 1e-3
    assert value["tip_error"] == pytest.approx(error, rel=1e-5)
    assert value["tip_error_fine"] == pytest.approx(np.arcsinh(error / 0.01), rel=1e-5)
    plain = [entry.name for entry in drm_env.observation_layout()]
    assert [e.name for e in layout if not e.name.startswith("tip_error")] == plain


@pytest.mark.parametrize("old", ["slew", "slew_residual"])
def test_both_versions_of_a_task_fly_the_same_episodes(old: str) -> None:
    new = drm_env.sample_scenarios(f"{old}_v1", seed=7, n=20)
    assert new == drm_env.sample_scenarios(old, seed=7, n=20)


def flown_with_estimate(**options: Any) -> tuple[dict[str, float], float]:
    """Entries in their units and the time, after 4.5 s under a small steady action."""
    env = drm_env.DrmEnv(observe_payload_estimate=True, **options)
    layout = env.unwrapped.observation_layout
    observation, _ = env.reset(seed=2)
    for _ in range(450):
        observation, *_ = env.step(np.array([0.1, -0.1], dtype=np.float32))
    time = env.signals()["time"]
    env.close()
    return {e.name: float(o) * e.scale for e, o in zip(layout, observation, strict=True)}, time


@pytest.mark.parametrize("mass_error", [-0.15, -0.05, 0.0, 0.12])
@pytest.mark.parametrize("profile", ["min_time", "min_energy"])
def test_payload_estimate_is_the_error_of_the_report(mass_error: float, profile: str) -> None:
    """The report is true (1 + e): true / reported is 1 / (1 + e), vibration or not."""
    value, _ = flown_with_estimate(mass_error=mass_error, payload_mass=300.0, slew_profile=profile)
    expected = 1.0 / (1.0 + mass_error) - 1.0
    assert value["estimated_mass_error"] == pytest.approx(expected, abs=0.02)


def test_payload_estimate_begins_with_the_report() -> None:
    env = drm_env.DrmEnv(observe_payload_estimate=True, observe_identified=True)
    observation, _ = env.reset(seed=1)
    layout = env.unwrapped.observation_layout
    env.close()
    value = {e.name: float(o) for e, o in zip(layout, observation, strict=True)}
    names = [name for name in value if name.startswith(("estimated", "mean", "missing"))]
    assert names == [
        "estimated_mass_error", "mean_tip_rate", "mean_tip_rate_fine", "missing_torque",
        *(f"missing_torque+{t:g}s" for t in (0.1, 0.25, 0.5, 1.0, 2.0)),
    ]  # fmt: skip
    assert not any(value[name] for name in names)


def test_missing_torque_is_what_the_reported_payload_lacks_of_the_inverse_dynamics() -> None:
    """Equation 3.2.1 of the thesis, for a thin rod that begins at the tip."""
    times = [0.5, 4.0]
    options: dict[str, Any] = {
        "payload_mass": 300.0,
        "mass_error": 0.12,
        "payload_inertia": "slender",
        "preview_times": times,
        "slew_profile": "min_energy",
    }
    value, time = flown_with_estimate(**options)
    mass, length = value["payload_mass"], value["payload_length"]
    error = value["estimated_mass_error"]
    assert abs(error) > 0.05

    def moment(extension: float) -> float:
        """The moment of inertia about the shoulder."""
        near, far = 7.0 + extension, 7.0 + extension + length
        return mass * (far**3 - near**3) / (3.0 * length)

    course = drm_env.simulate(drm_env.resolve(**options).config.scenario)
    for ahead in (0.0, *times):
        suffix = f"+{ahead:g}s" if ahead else ""
        momentum = [
            moment(float(np.interp(at, course["time"], course["extension"])))
            * float(np.interp(at, course["time"], course["reference_rate"]))
            for at in (time + ahead - 0.01, time + ahead + 0.01)
        ]
        lacking = error * (momentum[1] - momentum[0]) / 0.02
        assert value[f"missing_torque{suffix}"] == pytest.approx(lacking, rel=2e-3, abs=0.02)


def seen_after_six_seconds(**options: Any) -> dict[str, float]:
    """Entries in their units after 6 s with the wheels at rest."""
    env = drm_env.DrmEnv(observe_still_tip_error=True, **options)
    layout = env.unwrapped.observation_layout
    observation, _ = env.reset(seed=2)
    for _ in range(600):
        observation, *_ = env.step(np.zeros(2, dtype=np.float32))
    env.close()
    return {e.name: float(o) * e.scale for e, o in zip(layout, observation, strict=True)}


@pytest.mark.parametrize("mass_error", [0.0, 0.15, -0.15])
@pytest.mark.parametrize(
    "damped", [{"structural_damping": 5e-3}, {"plant": "consistent", "damping_ratio": 0.1}]
)
def test_still_tip_error_is_that_of_the_tip_once_the_vibration_is_gone(
    damped: dict[str, Any], mass_error: float
) -> None:
    """Against the deflection of a damped arm that follows the reference, its mass being known.

    Of an estimated mass there is as much as the estimate knows after 6 s.
    """
    manoeuvre = {
        "payload_mass": 300.0, "deployment_start": 4.0, "deployment_end": 4.0, "slew_angle": 1.5,
        **damped,
    }  # fmt: skip
    value = seen_after_six_seconds(mass_error=mass_error, **manoeuvre)
    known = drm_env.resolve(mass_error=0.0, **manoeuvre).config.scenario
    flight = drm_env.simulate(known)
    now = int(np.searchsorted(flight["time"], 6.0 - 1e-9))
    assert value["reference_accel"] == pytest.approx(0.02)
    bent = flight["tip_deflection"][now]
    assert bent < -3e-3
    told = value["still_tip_error"] - 11.0 * value["slew_error"]
    assert told == pytest.approx(bent, rel=0.02)
    fine = np.arcsinh(value["still_tip_error"] / 5e-4)
    assert value["still_tip_error_fine"] == pytest.approx(fine, rel=1e-5)


@pytest.mark.parametrize(
    ("task", "shown"),
    [("slew", False), ("slew_residual", False), ("slew_thesis", False), ("slew_direct", False),
     ("slew_v1", True), ("slew_residual_v1", True), ("slew_flexible", True), ("mission", True)],
)  # fmt: skip
def test_tasks_made_for_learning_show_where_the_tip_is(task: str, shown: bool) -> None:
    """docs/learning.md; version 0 keeps its layout."""
    names = [entry.name for entry in drm_env.observation_layout(task=task)]
    assert ("still_tip_error" in names) == ("still_tip_error_fine" in names) == shown


def test_still_tip_error_believes_the_arm_that_is_built_and_not_the_one_that_is_drawn() -> None:
    """Links of half the stiffness bend twice as much, and the agent is told of once."""

    def told(**stiffness: Any) -> float:
        value = seen_after_six_seconds(
            structural_damping=5e-3, payload_mass=300.0, mass_error=0.0, deployment_start=4.0,
            deployment_end=4.0, slew_angle=1.5, **stiffness,
        )  # fmt: skip
        return value["still_tip_error"] - 11.0 * value["slew_error"]

    built = told()
    soft = {"link1_bending_stiffness": 1.25e6, "link2_bending_stiffness": 1.5e6}
    drawn = {name: {"choices": [value]} for name, value in soft.items()}
    assert told(**drawn) == pytest.approx(built, rel=0.01)
    assert told(**soft) == pytest.approx(2.0 * built, rel=0.01)


def test_mean_tip_rate_is_the_rate_of_the_error_without_the_vibration() -> None:
    """Over the second half of a slew, its integral is how much the error at the tip has grown."""
    env = drm_env.DrmEnv(
        observe_payload_estimate=True, observe_tip_error=True, mass_error=0.1, payload_mass=200.0,
        deployment_start=6.0, deployment_end=6.0,
    )  # fmt: skip
    layout = env.unwrapped.observation_layout
    at = {entry.name: (i, entry.scale) for i, entry in enumerate(layout)}
    observation, _ = env.reset(seed=2)
    seen = []
    for _ in range(800):
        observation, *_ = env.step(np.array([0.2, 0.0], dtype=np.float32))
        seen.append([
            float(observation[at[name][0]]) * at[name][1]
            for name in ("mean_tip_rate", "tip_error", "slew_error_rate", "mean_tip_rate_fine")
        ])  # fmt: skip
    env.close()
    rate, error, slew_rate, fine = np.array(seen)[300:].T
    grown = np.convolve(error, np.ones(50) / 50.0, "valid")
    integral = 0.01 * np.convolve(np.cumsum(rate), np.ones(50) / 50.0, "valid")
    assert abs(grown[-1] - grown[0]) > 0.1
    assert integral[-1] - integral[0] == pytest.approx(grown[-1] - grown[0], rel=0.02)
    # the measured rate shakes
    assert np.ptp(rate) < 0.2 * np.ptp(13.0 * slew_rate)
    assert fine == pytest.approx(np.arcsinh(rate / 0.01), rel=1e-5)


def test_payload_estimate_needs_an_open_loop() -> None:
    with pytest.raises(drm_env.ConfigError, match="observe_payload_estimate"):
        drm_env.resolve("drm_env/SlewDirect-v0", observe_payload_estimate=True)
