"""Training runs: recorded, exported, interrupted and resumed. Small enough to take seconds."""

from __future__ import annotations

import contextlib
import csv
import errno
import json
import os
import signal
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

import drm_env
from drm_baselines import load_policy
from drm_baselines.errors import BaselineError, ExistingResultError, RunError
from drm_baselines.evaluation.environments import environment_config
from drm_baselines.rl.algorithms import ALGORITHMS
from drm_baselines.rl.asymmetric import PRIVILEGED, PrivilegedObservations
from drm_baselines.rl.export import network_of
from drm_baselines.rl.hyperparameters import from_data, load_hyperparameters
from drm_baselines.rl.request import Point, SilentWatcher, TrainingRequest
from drm_baselines.rl.run_record import load_run
from drm_baselines.rl.staggered_resets import StaggeredStart
from drm_baselines.rl.training import (
    CURVE_SEED,
    request_of,
    resume,
    train,
)
from drm_baselines.support.seeds import TRAINING_SEED
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
    "td3": {
        "algorithm": "td3", "n_envs": 4, "learning_rate": 1e-3,
        "model": {"buffer_size": 1000, "learning_starts": 40, "batch_size": 16, "train_freq": 4,
                  "action_noise": 0.1},
        "network": {"layers": [8], "activation": "relu"},
    },
    "tqc": {
        "algorithm": "tqc", "n_envs": 4, "learning_rate": 1e-3,
        "model": {"buffer_size": 1000, "learning_starts": 40, "batch_size": 16, "train_freq": 4},
        "network": {"layers": [8], "activation": "relu"},
    },
    "crossq": {
        "algorithm": "crossq", "n_envs": 4, "learning_rate": 1e-3,
        "model": {"buffer_size": 1000, "learning_starts": 40, "batch_size": 16, "train_freq": 4,
                  "use_sde": True},
        "network": {"layers": [8, 7], "activation": "relu"},
    },
    "recurrent_ppo": {
        "algorithm": "recurrent_ppo", "n_envs": 4, "learning_rate": 1e-3,
        "model": {"n_steps": 16, "batch_size": 32, "n_epochs": 1},
        "network": {"layers": [8], "activation": "tanh", "lstm_units": 6, "lstm_layers": 2},
    },
}  # fmt: skip


def request(algorithm: str = "ppo", steps: int = 256, **changes: Any) -> TrainingRequest:
    arguments: dict[str, Any] = {
        "algorithm": algorithm, "env_id": ENV_ID, "options": {"horizon": 0.4}, "steps": steps,
        "seed": 1, "settings": from_data(SETTINGS[algorithm]), "evaluations": 2,
        "evaluation_episodes": 4,
    }  # fmt: skip
    return TrainingRequest(**{**arguments, **changes})


@pytest.mark.parametrize("algorithm", ALGORITHMS)
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


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_exported_policy_is_the_trained_one(tmp_path: Path, algorithm: str) -> None:
    directory = tmp_path / "run"
    record = train(directory, request(algorithm))
    assert record.checkpoint is not None
    path = directory / record.checkpoint["model"]["file"]
    model = ALGORITHMS[algorithm].load_type().load(path, device="cpu")
    policy = load_policy(directory)
    observations = np.random.default_rng(0).normal(size=(64, policy.network.inputs))
    observations = (0.5 * observations).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    np.testing.assert_allclose(policy.predict(observations)[0], expected, atol=2e-6)
    assert np.abs(expected).max() < 1.0, "clipped actions would agree whatever the network"
    untrained = network_of(model)
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
    """Sends this process a signal (Ctrl-C) after the first evaluation within training."""

    def __init__(self, number: int = signal.SIGINT) -> None:
        super().__init__()
        self.number = number

    def evaluated(self, point: Point) -> None:
        super().evaluated(point)
        if point.steps > 0:
            os.kill(os.getpid(), self.number)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
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


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_run_that_is_told_to_end_is_saved_and_resumed(tmp_path: Path, name: str) -> None:
    directory, number = tmp_path / "run", getattr(signal, name)
    before = signal.getsignal(number)
    record = train(directory, request(steps=512), watcher=_Interrupter(number))
    assert signal.getsignal(number) is before
    assert record.status == load_run(directory).status == "interrupted"
    assert 0 < record.steps < 512
    assert resume(directory).status == "finished"


def test_a_resumed_run_is_measured_as_it_began(tmp_path: Path) -> None:
    """Everything that a request says is in the record, and comes back from it."""
    begun = tmp_path / "begun"
    train(begun, request(steps=64))
    given = request(steps=512, evaluations=4, evaluation_episodes=3, start=begun)
    directory = tmp_path / "run"
    train(directory, given, watcher=_Interrupter())
    record = load_run(directory)
    again = request_of(record)
    for each in fields(TrainingRequest):
        if each.name not in ("options", "start"):
            assert getattr(again, each.name) == getattr(given, each.name), each.name
    assert record.start == {
        "directory": str(begun),
        "weights_sha256": load_policy(begun).description["weights_sha256"],
    }
    watcher = SilentWatcher()
    resume(directory, watcher=watcher)
    assert {len(point.episodes) for point in watcher.points} == {3}
    with (directory / "evaluations.csv").open(newline="") as stream:
        steps = [int(row["steps"]) for row in csv.DictReader(stream)]
    assert steps == [0, 128, 256, 384, 512]


def test_records_of_before_are_resumed_with_what_was_the_default(tmp_path: Path) -> None:
    directory = tmp_path / "run"
    train(directory, request(steps=64))
    content = json.loads((directory / "run.json").read_text())
    for name in ("evaluations", "evaluation_episodes", "start"):
        del content[name]
    (directory / "run.json").write_text(json.dumps(content))
    record = load_run(directory)
    assert (record.evaluations, record.evaluation_episodes, record.start) == (10, 100, None)


WRONG = {
    "algorithm": 3, "env_id": None, "options": [], "config": "slew", "control_period": "fast",
    "hyperparameters": [1], "seed": -1, "target_steps": 2.5, "evaluations": 0,
    "evaluation_episodes": True, "start": "here", "steps": "many", "wall_time": [0.0],
    "status": {}, "checkpoint": {"model": {"file": 3, "sha256": ""}}, "segments": {"a": 1},
}  # fmt: skip


def test_a_record_with_wrong_types_is_refused_by_name(tmp_path: Path) -> None:
    directory = tmp_path / "run"
    train(directory, request(steps=64))
    path = directory / "run.json"
    content = json.loads(path.read_text())
    assert WRONG.keys() == content.keys() - {"format", "format_version"}
    for name, value in WRONG.items():
        path.write_text(json.dumps({**content, name: value}))
        with pytest.raises(RunError, match=f"run.json is damaged: {name} must be"):
            load_run(directory)
    for changes in (
        {"algorithm": "dqn"}, {"algorithm": "sac"}, {"hyperparameters": {}}, {"more": 1},
        {"env_id": "drm_env/No-v0"}, {"config": {"scenario": 3}}, {"seed": 10**400},
    ):  # fmt: skip
        path.write_text(json.dumps({**content, **changes}))
        with pytest.raises((BaselineError, drm_env.ConfigError)) as caught:
            resume(directory, steps=128)
        assert len(str(caught.value)) < 500
    for name in content:
        path.write_text(json.dumps({key: item for key, item in content.items() if key != name}))
        with contextlib.suppress(BaselineError, drm_env.ConfigError):
            load_run(directory)


@pytest.mark.parametrize("text", ["", "steps\nmany\n", "a,b\n1,2\n", "steps\nnan\n", 'steps\n"1'])
def test_a_damaged_learning_curve_is_refused(tmp_path: Path, text: str) -> None:
    directory = tmp_path / "run"
    train(directory, request(steps=64))
    path = directory / "evaluations.csv"
    path.write_text(text)
    if not text:
        assert resume(directory, steps=128).status == "finished"
        return
    with pytest.raises(RunError, match=r"evaluations\.csv is damaged"):
        resume(directory, steps=128)


class _Failure(SilentWatcher):
    """Fails after the first evaluation within training."""

    def __init__(self, error: Exception) -> None:
        super().__init__()
        self.error = error

    def evaluated(self, point: Point) -> None:
        super().evaluated(point)
        if point.steps > 0:
            raise self.error


def test_whatever_fails_in_a_run_what_it_has_learned_is_saved(tmp_path: Path) -> None:
    for number, error in enumerate((OSError(5, "Input/output error"), ZeroDivisionError("odd"))):
        directory = tmp_path / str(number)
        kind = RunError if isinstance(error, OSError) else ZeroDivisionError
        with pytest.raises(kind) as caught:
            train(directory, request(steps=512), watcher=_Failure(error))
        record = load_run(directory)
        assert record.status == "interrupted"
        assert 0 < record.steps < 512
        if kind is RunError:
            assert f"{record.steps} steps are saved: go on with drm train" in str(caught.value)
        assert resume(directory).status == "finished"


def test_a_full_disk_leaves_the_last_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that is full from the second point of the curve on."""
    write = Path.write_bytes

    class Filling(SilentWatcher):
        def evaluated(self, point: Point) -> None:
            super().evaluated(point)
            if len(self.points) == 3:
                monkeypatch.setattr(Path, "write_bytes", full)

    def full(path: Path, content: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    directory = tmp_path / "run"
    with pytest.raises(RunError, match="No space left on device; 128 steps are saved: go on with"):
        train(directory, request(steps=512, evaluations=4), watcher=Filling())
    monkeypatch.setattr(Path, "write_bytes", write)
    assert load_run(directory).steps == 128
    assert load_policy(directory).description["training"]["steps"] == 128
    hidden = [path.name for path in directory.rglob(".*")]
    assert hidden in ([], [".drm.lock"]), "temporary files are removed"
    assert resume(directory).status == "finished"


def test_a_request_that_cannot_be_trained_leaves_the_older_run(tmp_path: Path) -> None:
    directory = tmp_path / "run"
    train(directory, request(steps=64))
    before = {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()}
    impossible = {**SETTINGS["ppo"], "model": {"n_steps": 10**12}}
    for changes in (
        {"settings": from_data({**SETTINGS["ppo"], "model": {"gama": 0.9}})},
        {"settings": from_data(impossible)},
        {"start": tmp_path / "nowhere"},
        {"evaluation_episodes": 10**10},
    ):
        with pytest.raises(BaselineError):
            train(directory, request(**changes), force=True)
    assert {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_buffers_that_do_not_fit_are_refused(tmp_path: Path, algorithm: str) -> None:
    name = {"ppo": "n_steps", "sac": "buffer_size"}[algorithm]
    settings = from_data({**SETTINGS[algorithm], "model": {name: 10**12}})
    with pytest.raises(BaselineError, match=rf"{name} = 1000000000000 would take about .* memory"):
        train(tmp_path / "run", request(algorithm, settings=settings))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("noise", [-0.1, 1.5, "much", True])
def test_action_noise_that_is_none_is_refused(tmp_path: Path, noise: Any) -> None:
    settings = from_data({**SETTINGS["td3"], "model": {"action_noise": noise}})
    with pytest.raises(RunError, match=rf"action_noise must be .*, got {noise!r}"):
        train(tmp_path / "run", request("td3", settings=settings))


def test_no_more_threads_than_processors(tmp_path: Path) -> None:
    import torch

    settings = from_data({**SETTINGS["ppo"], "torch_threads": 1024})
    before = torch.get_num_threads()
    try:
        with pytest.warns(UserWarning, match="torch_threads = 1024 is more than"):
            train(tmp_path / "run", request(settings=settings, steps=64))
        assert torch.get_num_threads() <= (os.cpu_count() or 1)
    finally:
        torch.set_num_threads(before)


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
    with pytest.raises(drm_env.ConfigError, match=r"payload\.mass"):
        train(tmp_path / "run", request(options={"payload_mass": -1.0}))
    with pytest.raises(BaselineError, match="there are drm_env/"):
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


@pytest.mark.parametrize("algorithm", ALGORITHMS)
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
        ({"network": {"layers": [8] * 16}}, "network.layers must be a list of 1 to 15"),
        ({"network": {"layers": [100_000]}}, "network.layers must be at most 4096"),
        ({"n_envs": 10**9}, "n_envs must be at most 10000"),
        ({"torch_threads": 5000}, "torch_threads must be at most 1024"),
        ({"learning_rate": 10**400}, "learning_rate must be finite"),
        ({"learning_rate": float("nan")}, "learning_rate must be finite"),
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
