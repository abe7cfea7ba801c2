"""Policies check what they are given: environments, observations, periods, torque limits."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.vector import SyncVectorEnv
from numpy.typing import NDArray

import drm_env
from drm_baselines import PolicyError, PolicyWarning, make_policy
from drm_baselines.evaluation.contestants import fly_trajectory
from drm_baselines.evaluation.environments import environment_config
from drm_baselines.evaluation.episodes import fly_law, fly_policy
from drm_baselines.policies.compatibility import complete_config
from drm_baselines.policies.pilots import shipped_run
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.policies.registry import config_of, law_data

ID, THESIS = "drm_env/Slew-v0", "drm_env/SlewThesis-v0"
OWN: dict[str, Any] = {"control_period": 0.002}
"""Laws decide at their own period."""

_Actions = NDArray[np.float32]


def flown(env: Any, policy: Any, steps: int | None = None) -> dict[str, Any]:
    """Fly an episode (or some steps); return the last info."""
    observation, info = env.reset(seed=1)
    state, start, done = None, np.array([True]), False
    while not done:
        action, state = policy.predict(observation, state=state, episode_start=start)
        start = np.array([False])
        observation, _, terminated, truncated, info = env.step(action)
        steps = None if steps is None else steps - 1
        done = terminated or truncated or steps == 0
    return dict(info)


# --- torque limits and arms of the episode --------------------------------------------------------


def test_a_drawn_torque_limit_flies_as_the_same_limit_fixed() -> None:
    """With a root wheel of 200 N m 2.7 mm, not the 30.7 of a law that commands twice its torque."""
    errors = []
    for limit in (200.0, [200.0]):
        env = gym.make(THESIS, mass_error=0.02, root_torque_limit=limit)
        errors.append(flown(env, make_policy("linear", env=env))["metrics/tip_error_rms"])
    assert errors[0] == errors[1]
    assert errors[0] == pytest.approx(2.7e-3, abs=0.05e-3)


@pytest.mark.parametrize("name", ["linear", "lyapunov"])
def test_laws_as_policies_fly_as_in_the_engine_whatever_is_drawn(name: str) -> None:
    """Limits and arm differ between the environments of the batch; the engine knows each."""
    config = environment_config(
        ID,
        {
            "root_torque_limit": (40.0, 400.0), "tip_torque_limit": (4.0, 40.0),
            "link1_length": (7.0, 8.5), "link2_mass_per_length": (3.0, 6.0),
            "payload_inertia": ["full", "slender"], "wheel_scale": 2.0, "horizon": 6.0, **OWN,
        },
    )  # fmt: skip
    inside = fly_law(law_data(name), config, env_id=ID, seed=5, episodes=6)
    with pytest.raises(PolicyError, match="root_torque_limit is drawn"):
        make_policy(name, config=config)
    env = gym.make(ID, config=config)
    outside = fly_policy(make_policy(name, env=env), ID, config, seed=5, episodes=6, label=name)
    tip = "tip_error_rms"
    np.testing.assert_allclose(outside.metrics[tip], inside.metrics[tip], rtol=2e-3)
    # and one by one, at the door of single environments
    signals = fly_trajectory(make_policy(name, env=env), ID, config, 5)
    vector = gym.make_vec(ID, num_envs=1, config=config)
    again = fly_trajectory(make_policy(name, env=vector), ID, config, 5)
    np.testing.assert_array_equal(signals["root_torque"], again["root_torque"])
    scenario = drm_env.sample_scenarios(config=config, seed=5, n=1)[0]
    engine = drm_env.simulate(scenario, law=name)
    np.testing.assert_allclose(signals["slew_angle"][-1], engine["slew_angle"][-1], atol=2e-5)


def doors() -> dict[str, Callable[..., Any]]:
    """Every kind of vector environment, of three sub-environments."""

    def one() -> Any:
        return gym.make(ID, root_torque_limit=(50.0, 400.0), **OWN)

    def sb3(**options: Any) -> Any:
        return pytest.importorskip("drm_env.sb3").make_sb3_vec(ID, n_envs=3, seed=2, **options)

    def dummy() -> Any:
        module = pytest.importorskip("stable_baselines3.common.vec_env")
        return module.DummyVecEnv([one] * 3)

    drawn: dict[str, Any] = {"root_torque_limit": (50.0, 400.0), **OWN}
    return {
        "native": lambda: gym.make_vec(ID, num_envs=3, **drawn),
        "native, wrapped": lambda: wrappers.vector.RecordEpisodeStatistics(
            gym.make_vec(ID, num_envs=3, **drawn)
        ),
        "sync": lambda: SyncVectorEnv([one] * 3),
        "SB3": lambda: sb3(**drawn),
        "SB3's own": dummy,
    }


@pytest.mark.parametrize("door", doors())
def test_every_vector_environment_gives_each_episode_its_own_limit(door: str) -> None:
    env = doors()[door]()
    policy = make_policy("linear", env=env)
    first = env.reset()
    observations = first[0] if isinstance(first, tuple) else first
    inner = env.unwrapped
    batch = getattr(inner, "batch", inner)
    limits = np.array(
        [context["context/root_torque_limit"] for context in batch.get_attr("context")]
    )
    assert np.unique(limits).size == 3
    layout = {entry.name: entry for entry in drm_env.observation_layout(**OWN)}
    index = {name: place for place, name in enumerate(layout)}
    made = np.array(observations, dtype=np.float64)
    # T1 = -8e4 e' - 8e3 e with an error of 1 mrad
    made[:, index["slew_error"]] = 1e-3 / layout["slew_error"].scale
    made[:, index["slew_error_fine"]] = np.arcsinh(100.0) / layout["slew_error_fine"].scale
    actions, _ = policy.predict(made)
    np.testing.assert_allclose(actions[:, 0] * limits, -8.0, rtol=1e-5)


@pytest.mark.parametrize("make", [gym.make, gym.make_vec], ids=["single", "vector"])
def test_a_limit_fixed_at_a_reset_or_by_the_context_counts(make: Callable[..., Any]) -> None:
    env: Any = make(ID, payload_mass=300.0, mass_error=0.1, **OWN)
    policy = make_policy("linear", env=env)

    def action(**options: Any) -> float:
        observation, _ = env.reset(seed=1, **options)
        for _ in range(4):
            observation, *_ = env.step(np.zeros(env.action_space.shape, np.float32))
        return float(np.ravel(policy.predict(observation)[0])[1])

    plain = action()
    assert 0.0 < abs(plain) < 0.9
    assert action(options={"tip_torque_limit": 40.0}) == pytest.approx(plain / 4.0, rel=1e-6)
    env.unwrapped.set_context(tip_torque_limit=20.0)
    assert action() == pytest.approx(plain / 2.0, rel=1e-6)


def test_an_action_of_one_may_be_more_than_the_limit() -> None:
    """With wheel_scale 4 an action of 0.1 is 40 N m of 100."""
    options: dict[str, Any] = {"payload_mass": 300.0, "mass_error": 0.1, "horizon": 8.0, **OWN}
    errors = []
    for scale in (1.0, 4.0):
        env = gym.make(ID, wheel_scale=scale, **options)
        errors.append(flown(env, make_policy("linear", env=env))["metrics/tip_error_rms"])
    assert errors[1] == pytest.approx(errors[0], rel=1e-3)


def test_other_episodes_than_those_of_the_environment_are_refused() -> None:
    env = gym.make_vec(ID, num_envs=3, **OWN)
    env.reset(seed=0)
    policy = make_policy("linear", env=env)
    with pytest.raises(PolicyError, match=r"2 observations, .* flies 3 episodes"):
        policy.predict(env.reset(seed=0)[0][:2])


# --- environments that somebody has changed -------------------------------------------------------


class Scaled(gym.Wrapper[Any, Any, Any, Any]):
    """No ObservationWrapper, but a space of its own."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        self.observation_space = gym.spaces.Box(-1.0, 1.0, env.observation_space.shape)


def changed(low: float, high: float) -> Callable[[Any], Any]:
    return lambda env: wrappers.RescaleObservation(env, np.float32(low), np.float32(high))


CHANGED: dict[str, Callable[[Any], Any]] = {
    "RescaleObservation": changed(-1.0, 1.0),
    "NormalizeObservation": wrappers.NormalizeObservation,
    "TransformObservation": lambda env: wrappers.TransformObservation(
        env, lambda observation: observation[::-1], env.observation_space
    ),
    "DelayObservation": lambda env: wrappers.DelayObservation(env, 2),
    "MaxAndSkipObservation": wrappers.MaxAndSkipObservation,
    "RescaleAction": lambda env: wrappers.RescaleAction(env, np.float32(-0.5), np.float32(0.5)),
    "StickyAction": lambda env: wrappers.StickyAction(env, 0.5),
    "observation space": lambda env: wrappers.FrameStackObservation(env, 2),
    "observation space ": Scaled,
}


@pytest.mark.parametrize("name", ["linear", "none", "learned"])
@pytest.mark.parametrize("change", CHANGED)
def test_changed_environments_are_refused(change: str, name: str) -> None:
    config = make_policy("learned").config if name == "learned" else None  # type: ignore[union-attr]
    options = {} if name == "learned" else OWN
    env = CHANGED[change](gym.make(ID, config=config, **options))
    with pytest.raises(PolicyError, match=change.strip()):
        make_policy(name, env=env)


def test_changed_vector_environments_are_refused() -> None:
    inside = SyncVectorEnv([lambda: changed(-1.0, 1.0)(gym.make(ID, **OWN))] * 2)
    outside = wrappers.vector.RescaleObservation(
        gym.make_vec(ID, num_envs=2, **OWN), np.float32(-1.0), np.float32(1.0)
    )
    for env in (inside, outside):
        with pytest.raises(PolicyError, match="RescaleObservation"):
            make_policy("linear", env=env)
    acting = wrappers.vector.RescaleAction(
        gym.make_vec(ID, num_envs=2, **OWN), np.float32(-2.0), np.float32(2.0)
    )
    with pytest.raises(PolicyError, match="RescaleAction"):
        make_policy("linear", env=acting)


def test_changed_environments_of_stable_baselines_are_refused() -> None:
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    venv = pytest.importorskip("drm_env.sb3").make_sb3_vec(ID, n_envs=2, **OWN)
    with pytest.raises(PolicyError, match="VecNormalize"):
        make_policy("linear", env=vec_env.VecMonitor(vec_env.VecNormalize(venv)))
    with pytest.raises(PolicyError, match="observation space"):
        make_policy("linear", env=vec_env.VecFrameStack(venv, 2))
    rewards = vec_env.VecNormalize(venv, norm_obs=False)
    assert make_policy("linear", env=rewards).predict(rewards.reset())[0].shape == (2, 2)


def test_wrappers_that_change_no_value_are_taken() -> None:
    env = wrappers.ClipAction(gym.make(ID, **OWN))
    with np.errstate(over="ignore"):  # in Gymnasium's own comparison of bounds
        env = wrappers.DtypeObservation(wrappers.RecordEpisodeStatistics(env), np.float64)
    plain = gym.make(ID, **OWN)
    ends = [flown(one, make_policy("linear", env=one), 50) for one in (env, plain)]
    assert ends[0]["reward/slew_error"] == ends[1]["reward/slew_error"]


def test_sub_environments_of_different_tasks_are_refused() -> None:
    env = SyncVectorEnv([lambda: gym.make(ID, **OWN), lambda: gym.make(ID, wheel_scale=2.0, **OWN)])
    with pytest.raises(PolicyError, match="different tasks"):
        config_of(env)


@pytest.mark.parametrize(
    ("options", "field"),
    [({"wheel_scale": 2.0}, "wheel_scale"), ({"inner_law": "lyapunov"}, "inner_law")],
)
def test_learned_policy_refuses_a_task_whose_actions_mean_something_else(
    options: dict[str, Any], field: str
) -> None:
    policy: Any = make_policy("learned")
    env = gym.make(policy.env_id, config={**policy.config, "task": {
        **policy.config["task"], **options,
    }})  # fmt: skip
    with pytest.raises(PolicyError, match=rf"task\.{field} of this environment"):
        make_policy("learned", env=env)
    with pytest.raises(PolicyError, match=rf"task\.{field} of this environment"):
        fly_policy(policy, policy.env_id, config_of(env), seed=0, episodes=1, label="learned")


def test_tuned_regulator_refuses_a_hidden_payload() -> None:
    with pytest.raises(PolicyError, match="hidden"):
        make_policy("lqr", env=gym.make(ID, observe_payload="hidden", **OWN))


# --- observations alone ---------------------------------------------------------------------------


def observations_of(config: Any, count: int = 30) -> NDArray[np.float32]:
    env = gym.make(ID, config=config, payload_mass=400.0, mass_error=0.15)
    rows = [env.reset(seed=3)[0]]
    for _ in range(count):
        rows.append(env.step(np.zeros(2, np.float32))[0])
    return np.array(rows)


@pytest.mark.parametrize("name", ["linear", "learned"])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows / 100.0, "contradicts"),
        (lambda rows: (rows - rows.mean(0)) / (rows.std(0) + 1e-8), "contradicts"),
        (lambda rows: rows[:, ::-1], "contradicts"),
        (lambda rows: rows * np.float32(1.02), "contradicts"),
        (lambda rows: rows + np.float32(200.0), "not within"),
    ],
    ids=["scaled", "normalised", "reordered", "scaled a little", "beyond"],
)
def test_observations_no_environment_gives_are_warned_of_once(
    name: str, change: Callable[[Any], Any], message: str
) -> None:
    """The only door that SB3's evaluate_policy leaves open."""
    policy: Any = (
        make_policy("learned") if name == "learned" else make_policy(name, config=OWN_CONFIG)
    )
    rows = observations_of(policy.config if name == "learned" else OWN_CONFIG)
    with warnings.catch_warnings():
        warnings.simplefilter("error", PolicyWarning)
        policy.predict(rows)
    with pytest.warns(PolicyWarning, match=message):
        policy.predict(change(rows))
    with warnings.catch_warnings():
        warnings.simplefilter("error", PolicyWarning)
        policy.predict(change(rows))


@pytest.mark.parametrize("name", ["linear", "learned"])
def test_observations_that_are_not_finite_are_refused(name: str) -> None:
    policy: Any = (
        make_policy("learned") if name == "learned" else make_policy(name, config=OWN_CONFIG)
    )
    rows = observations_of(policy.config if name == "learned" else OWN_CONFIG, 2)
    rows[1, 4] = np.nan
    with pytest.raises(PolicyError, match=r"observation\[4\], 'slew_angle(@-2)?', must be finite"):
        policy.predict(rows)


OWN_CONFIG = {"task": OWN}


@pytest.mark.parametrize(
    "options",
    [
        {"angle_noise": 1e-3, "rate_noise": 1e-2, "deflection_noise": 1e-2},
        {"angle_resolution": 1e-4, "deflection_resolution": 1e-4, "sensor_delay": 0.01},
        {"observation_history": 3},
        {"initial_slew_rate": 3.0, "limits": {"slew_error": 100.0, "tip_deflection": 100.0}},
    ],
    ids=["noise", "resolution", "history", "clipped"],
)
def test_every_observation_of_an_environment_is_taken(options: dict[str, Any]) -> None:
    """The check finds nothing wrong in what an environment gives, whatever its sensors."""
    env = gym.make_vec(ID, num_envs=8, initial_beta=(-0.05, 0.05), **options, **OWN)
    policy = make_policy("linear", env=env)
    observations, _ = env.reset(seed=0)
    env.action_space.seed(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error", PolicyWarning)
        for _ in range(300):
            policy.predict(observations)
            observations, *_ = env.step(env.action_space.sample())


# --- periods --------------------------------------------------------------------------------------


def test_a_law_at_another_period_warns_with_both() -> None:
    with pytest.warns(PolicyWarning, match=r"'lyapunov' .* every 2 ms and is asked every 10 ms"):
        make_policy("lyapunov")
    with pytest.warns(PolicyWarning, match="every 10 ms"):
        make_policy("lqr", env=gym.make_vec(ID, num_envs=2))
    repeated = wrappers.RepeatAction(gym.make(ID, **OWN), 3)
    with pytest.warns(PolicyWarning, match="every 6 ms"):
        make_policy("linear", env=repeated)


def test_a_warning_points_at_the_line_of_the_caller() -> None:
    with pytest.warns(PolicyWarning) as caught:
        make_policy("linear")
    assert [warning.filename for warning in caught] == [__file__]


def test_learned_policies_and_evaluations_warn_likewise() -> None:
    policy: Any = make_policy("learned")
    config = {**policy.config, "task": {**policy.config["task"], "control_period": 0.1}}
    with pytest.warns(PolicyWarning, match="every 20 ms and is asked every 100 ms"):
        make_policy("learned", config=config)
    law = make_policy("linear", config=OWN_CONFIG)
    slow = environment_config(ID, {"horizon": 0.5})
    with pytest.warns(PolicyWarning, match="every 10 ms"):
        fly_policy(law, ID, slow, seed=0, episodes=2, label="linear law")
    slower = environment_config(ID, {"horizon": 0.5, "sample_period": 0.01})
    with pytest.warns(PolicyWarning, match="every 10 ms"):
        fly_law({"name": "linear"}, slower, env_id=ID, seed=0, episodes=2)


def test_policies_at_their_own_period_do_not_warn() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", PolicyWarning)
        for name in ("linear", "lyapunov", "lqr"):
            make_policy(name, env=gym.make(ID, **OWN))
        make_policy("none")
        make_policy("none", env=gym.make("drm_env/SlewResidual-v0"))
        policy: Any = make_policy("learned")
        make_policy("learned", config=policy.config)


def test_a_policy_flies_in_its_id_after_that_has_learned_to_show_more() -> None:
    """PPO end to end was trained before ``observe_still_tip_error``, which its id has by now."""
    run = shipped_run("ppo_direct")
    kept = json.loads((run / "policy.json").read_text(encoding="utf-8"))["config"]["task"]
    assert "observe_still_tip_error" not in kept
    policy = load_policy(run)
    assert policy.config["task"]["observe_still_tip_error"] is False
    with gym.make(policy.env_id, config=policy.config) as env:
        inner: Any = env.unwrapped
        policy.check_task(inner.config)
        observation, _ = env.reset(seed=0)
        policy.predict(observation)
    assert "still_tip_error" in [e.name for e in drm_env.observation_layout(task="slew_v1")]


def test_a_configuration_of_another_version_stays_as_it_is() -> None:
    assert complete_config({"task": {"of_tomorrow": 1}}) == {"task": {"of_tomorrow": 1}}
