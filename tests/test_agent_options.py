"""What an agent may see of the payload, and how far it may overrule an inner law."""

from __future__ import annotations

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
