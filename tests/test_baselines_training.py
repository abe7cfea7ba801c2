"""Training runs: recorded, exported, interrupted and resumed. Small enough to take seconds."""

from __future__ import annotations

import csv
import json
import os
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from drm_baselines import load_policy
from drm_baselines.asymmetric import PRIVILEGED, PrivilegedObservations
from drm_baselines.errors import BaselineError, ExistingResultError, RunError
from drm_baselines.evaluation import TRAINING_SEED, environment_config
from drm_baselines.export import perceptron_of
from drm_baselines.hyperparameters import from_data, load_hyperparameters
from drm_baselines.runs import load_run
from drm_baselines.staggering import StaggeredStart
from drm_baselines.training import (
    CURVE_SEED,
    Point,
    SilentWatcher,
    TrainingRequest,
    resume,
    train,
)
from drm_env.sb3 import make_sb3_vec

ENV_ID = "drm_env/SlewResidual-v0"
SETTINGS: dict[str, dict[str, Any]] = {
    "ppo": {
        "algorithm": "ppo", "n_envs": 4, "learning_rate": 1e-3,
        "model": {"n_steps": 16, "batch_size": 32, "n_epochs": 1, "use_sde": True,
                  "sde_sample_freq": 4},
        "network": {"layers": [8], "activation": "tanh"},
    },
    "sac": {
        "algorithm": "sac", "n_envs": 4, "learning_rate": 1e-3,
        "model": {"buffer_size": 1000, "learning_starts": 40, "batch_size": 16, "train_freq": 4,
                  "use_sde": True},
        "network": {"layers": [8], "activation": "relu"},
    },
}  # fmt: skip


def request(algorithm: str = "ppo", steps: int = 256, **changes: Any) -> TrainingRequest:
    arguments: dict[str, Any] = {
        "algorithm": algorithm, "env_id": ENV_ID, "options": {"horizon": 0.4}, "steps": steps,
        "seed": 1, "settings": from_data(SETTINGS[algorithm]), "evaluations": 2,
        "evaluation_episodes": 4,
    }  # fmt: skip
    return TrainingRequest(**{**arguments, **changes})


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_run_leaves_everything_to_repeat_and_to_judge_it(tmp_path: Path, algorithm: str) -> None:
    directory = tmp_path / "run"
    watcher = SilentWatcher()
    record = train(directory, request(algorithm), watcher=watcher)
    assert record.status == "finished"
    assert record.steps >= 256
    stored = json.loads((directory / "run.json").read_text())
    assert stored["env_id"] == ENV_ID
    assert stored["config"]["scenario"]["horizon"] == 0.4
    assert stored["config"]["task"]["inner_law"]["name"] == "linear"
    assert stored["hyperparameters"]["model"] == SETTINGS[algorithm]["model"]
    assert stored["segments"][0]["first_seed"] >= TRAINING_SEED > CURVE_SEED
    assert {"drm-env", "torch"} <= stored["segments"][0]["versions"].keys()
    with (directory / "evaluations.csv").open(newline="") as stream:
        steps = [int(row["steps"]) for row in csv.DictReader(stream)]
    assert steps[0] == 0
    assert steps[-1] == record.steps
    assert steps == [point.steps for point in watcher.points]
    assert any((directory / "tensorboard").iterdir())


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_the_exported_policy_is_the_trained_one(tmp_path: Path, algorithm: str) -> None:
    from stable_baselines3 import PPO, SAC

    directory = tmp_path / "run"
    record = train(directory, request(algorithm))
    assert record.checkpoint is not None
    path = directory / record.checkpoint["model"]["file"]
    model = {"ppo": PPO, "sac": SAC}[algorithm].load(path, device="cpu")
    policy = load_policy(directory)
    observations = np.random.default_rng(0).normal(size=(64, policy.network.inputs))
    observations = (0.5 * observations).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    np.testing.assert_allclose(policy.predict(observations)[0], expected, atol=2e-6)
    assert np.abs(expected).max() < 1.0, "clipped actions would agree whatever the network"
    untrained = perceptron_of(model)
    assert untrained.inputs == policy.network.inputs


def test_the_same_request_gives_the_same_policy(tmp_path: Path) -> None:
    first = train(tmp_path / "a", request())
    second = train(tmp_path / "b", request())
    third = train(tmp_path / "c", request(seed=2))
    digests = [
        json.loads((tmp_path / name / "policy.json").read_text())["weights_sha256"]
        for name in "abc"
    ]
    assert digests[0] == digests[1] != digests[2]
    assert first.steps == second.steps == third.steps


class _Interrupter(SilentWatcher):
    """Sends this process Ctrl-C after the first evaluation within training."""

    def evaluated(self, point: Point) -> None:
        super().evaluated(point)
        if point.steps > 0:
            os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_an_interrupted_run_is_saved_and_resumed(tmp_path: Path, algorithm: str) -> None:
    directory = tmp_path / "run"
    before = signal.getsignal(signal.SIGINT)
    record = train(directory, request(algorithm, steps=512), watcher=_Interrupter())
    assert signal.getsignal(signal.SIGINT) is before
    assert record.status == "interrupted"
    assert 0 < record.steps < 512
    stopped = load_policy(directory).description["weights_sha256"]
    resumed = resume(directory)
    assert resumed.status == "finished"
    assert resumed.steps >= 512
    assert len(resumed.segments) == 2
    assert resumed.segments[1]["begin_steps"] == record.segments[0]["end_steps"]
    assert resumed.segments[1]["first_seed"] != resumed.segments[0]["first_seed"]
    assert load_policy(directory).description["weights_sha256"] != stopped
    assert load_run(directory).wall_time >= record.wall_time
    with pytest.raises(RunError, match="larger --steps"):
        resume(directory)
    assert resume(directory, steps=640).steps >= 640


def test_a_checkpoint_that_is_not_the_runs_own_is_not_loaded(tmp_path: Path) -> None:
    directory = tmp_path / "run"
    record = train(directory, request())
    assert record.checkpoint is not None
    path = directory / record.checkpoint["model"]["file"]
    path.write_bytes(path.read_bytes() + b"x")
    with pytest.raises(RunError, match="SHA-256"):
        resume(directory, steps=512)


def test_existing_runs_are_kept_and_force_starts_anew(tmp_path: Path) -> None:
    directory = tmp_path / "run"
    train(directory, request())
    before = (directory / "run.json").read_text()
    with pytest.raises(ExistingResultError, match="not empty"):
        train(directory, request())
    assert (directory / "run.json").read_text() == before
    assert train(directory, request(steps=64), force=True).steps == 64


def test_impossible_requests_leave_no_directory(tmp_path: Path) -> None:
    import drm_env

    with pytest.raises(drm_env.ConfigError, match=r"payload\.mass"):
        train(tmp_path / "run", request(options={"payload_mass": -1.0}))
    with pytest.raises(BaselineError, match="there are drm_env/Slew"):
        train(tmp_path / "run", request(env_id="drm_env/Slow-v0"))
    assert not (tmp_path / "run").exists()


def test_environments_start_spread_over_the_episode() -> None:
    config = environment_config(ENV_ID, {"horizon": 0.4})
    env = StaggeredStart(make_sb3_vec(ENV_ID, n_envs=5, config=config, monitor=False), 20)
    env.seed(3)
    env.reset()
    ends: dict[int, list[int]] = {index: [] for index in range(5)}
    for step in range(40):
        _, _, dones, _ = env.step(np.zeros((5, 2), np.float32))
        for index in np.flatnonzero(dones):
            ends[int(index)].append(step)
    env.close()
    assert all(len(steps) == 2 and steps[1] - steps[0] == 20 for steps in ends.values())
    assert len({steps[0] for steps in ends.values()}) == 5


VARIOUS = {
    "horizon": 0.4,
    "payload_mass": (50.0, 500.0),
    "mass_error": (-0.15, 0.15),
}


def asymmetric(**changes: Any) -> TrainingRequest:
    """A request whose critic sees the payload."""
    network = {**SETTINGS["ppo"]["network"], "critic_sees_payload": True}
    settings = from_data({**SETTINGS["ppo"], "network": network})
    return request(**{"settings": settings, "options": VARIOUS, **changes})


def trained_model(directory: Path) -> Any:
    from stable_baselines3 import PPO

    checkpoint = load_run(directory).checkpoint
    assert checkpoint is not None
    return PPO.load(directory / checkpoint["model"]["file"], device="cpu")


def test_the_true_payload_is_appended_to_observations() -> None:
    config = environment_config(ENV_ID, VARIOUS)
    plain, inner = (
        StaggeredStart(make_sb3_vec(ENV_ID, n_envs=5, config=config, monitor=False), 20)
        for _ in range(2)
    )
    env = PrivilegedObservations(inner)
    size = plain.observation_space.shape[0]
    assert env.observation_space.shape == (size + len(PRIVILEGED),)

    def truth(contexts: list[dict[str, float]]) -> Any:
        rows = [[each[key] / scale for key, scale in PRIVILEGED.items()] for each in contexts]
        return np.array(rows, dtype=np.float32)

    for each in (plain, env):
        each.seed(3)
    expected, observations = plain.reset(), env.reset()
    ended = 0
    for _ in range(40):
        np.testing.assert_array_equal(observations[:, :size], expected)
        present = truth(plain.get_attr("context"))
        np.testing.assert_array_equal(observations[:, size:], present)
        assert len({tuple(row) for row in present.tolist()}) == 5
        actions = np.zeros((5, 2), np.float32)
        expected, rewards, dones, infos = plain.step(actions)
        observations, own_rewards, own_dones, own_infos = env.step(actions)
        np.testing.assert_array_equal(own_rewards, rewards)
        np.testing.assert_array_equal(own_dones, dones)
        for index in np.flatnonzero(dones):
            last = own_infos[index]["terminal_observation"]
            np.testing.assert_array_equal(last[:size], infos[index]["terminal_observation"])
            np.testing.assert_array_equal(last[size:], present[index])
            assert last.dtype == np.float32
            ended += 1
    assert ended == 10
    for each in (plain, env):
        each.env_method("reset", seed=9, indices=[2])
    np.testing.assert_array_equal(env.step(actions)[0][:, size:], truth(plain.get_attr("context")))
    plain.close()
    env.close()


def test_the_actor_does_not_see_what_the_critic_does(tmp_path: Path) -> None:
    import torch

    directory = tmp_path / "run"
    assert train(directory, asymmetric()).status == "finished"
    model, policy = trained_model(directory), load_policy(directory)
    size = policy.network.inputs
    assert size == len(policy.description["observation_layout"])
    assert model.observation_space.shape == (size + len(PRIVILEGED),)
    generator = np.random.default_rng(0)
    observations = 0.5 * generator.normal(size=(64, size + len(PRIVILEGED)))
    observations = observations.astype(np.float32)
    other = observations.copy()
    other[:, size:] += 0.5
    expected, _ = model.predict(observations, deterministic=True)
    np.testing.assert_allclose(policy.predict(observations[:, :size])[0], expected, atol=2e-6)
    assert np.abs(expected).max() < 1.0, "clipped actions would agree whatever the network"
    np.testing.assert_array_equal(model.predict(other, deterministic=True)[0], expected)
    with torch.no_grad():
        one, two = (
            model.policy.predict_values(torch.from_numpy(each)) for each in (observations, other)
        )
    assert (one - two).abs().min() > 0.0


def test_a_run_with_an_asymmetric_critic_goes_on(tmp_path: Path) -> None:
    directory = tmp_path / "run"
    record = train(directory, asymmetric(steps=512), watcher=_Interrupter())
    assert record.status == "interrupted"
    stopped = load_policy(directory).description["weights_sha256"]
    assert resume(directory).steps >= 512
    assert load_policy(directory).description["weights_sha256"] != stopped
    assert load_run(directory).hyperparameters["network"]["critic_sees_payload"] is True
    begun = train(tmp_path / "on", asymmetric(start=directory, steps=64))
    assert begun.status == "finished"
    plain = train(tmp_path / "plain", request(start=directory, options=VARIOUS, steps=64))
    assert "critic_sees_payload" not in plain.hyperparameters["network"]


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_packaged_hyperparameters_are_complete(algorithm: str) -> None:
    settings = load_hyperparameters(algorithm)
    assert from_data(json.loads(json.dumps(settings.to_dict()))) == settings


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n_envs": 0}, "n_envs must be a positive integer, got 0"),
        ({"learning_rat": 1.0}, "learning_rat"),
        ({"learning_rate": "fast"}, "learning_rate must be a number"),
        ({"algorithm": "dqn"}, "algorithm must be one of"),
        ({"network": {"layers": []}}, "network.layers"),
        ({"network": {"depth": 2}}, "network.depth"),
        ({"network": {"activation": "elu"}}, "network.activation"),
        (
            {"network": {"critic_sees_payload": 1}},
            "network.critic_sees_payload must be true or false, got 1",
        ),
        (
            {"algorithm": "sac", "network": {"critic_sees_payload": True}},
            "network.critic_sees_payload must be false for sac, got True",
        ),
    ],
)
def test_bad_hyperparameters_are_named(changes: Mapping[str, Any], message: str) -> None:
    with pytest.raises(BaselineError, match=message):
        from_data({**SETTINGS["ppo"], **changes})


def test_hyperparameters_that_sb3_refuses_are_a_clear_error(tmp_path: Path) -> None:
    settings = from_data({**SETTINGS["ppo"], "model": {"gama": 0.9}})
    with pytest.raises(RunError, match="gama"):
        train(tmp_path / "run", request(settings=settings))
