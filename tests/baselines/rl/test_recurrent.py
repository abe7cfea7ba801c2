"""Policies with a memory: exported without pickles, and flown as the library flies them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import torch
from sb3_contrib import RecurrentPPO

import drm_env
from drm_baselines import load_policy
from drm_baselines.benchmark.competitors import Competitor
from drm_baselines.errors import BaselineError, PolicyError, RunError
from drm_baselines.evaluation.environments import environment_config
from drm_baselines.evaluation.episodes import fly_policy
from drm_baselines.evaluation.predictors import PredictorPilot
from drm_baselines.policies.policy_file import save_policy
from drm_baselines.policies.recurrent import RecurrentPolicy
from drm_baselines.rl.export import network_of, policy_of
from drm_baselines.rl.hyperparameters import from_data, load_hyperparameters
from drm_baselines.rl.request import TrainingRequest
from drm_baselines.rl.training import train
from drm_baselines.suites import load
from drm_env.sb3 import make_sb3_vec

ENV_ID = "drm_env/SlewResidual-v1"

pytestmark = pytest.mark.filterwarnings("ignore:the observation given to the policy")


def model_of(layers: int = 1, **network: Any) -> RecurrentPPO:
    """An untrained model whose actions stay within their limits."""
    torch.manual_seed(5)
    env = make_sb3_vec(ENV_ID, n_envs=2, seed=0, horizon=1.0)
    model = RecurrentPPO(
        "MlpLstmPolicy",
        env,
        seed=3,
        device="cpu",
        policy_kwargs={"net_arch": [7], "lstm_hidden_size": 5, "n_lstm_layers": layers, **network},
    )
    with torch.no_grad():  # as initialised, actions would hardly depend on anything
        model.policy.action_net.weight.mul_(20.0)
    return model


def description() -> dict[str, Any]:
    config = drm_env.resolve(ENV_ID)
    return {
        "env_id": ENV_ID,
        "config": config.to_dict(),
        "control_period": config.control_period,
        "observation_layout": [list(entry) for entry in config.observation_layout],
    }


@pytest.mark.parametrize("layers", [1, 3])
def test_exported_policy_is_the_library_s_over_episodes(tmp_path: Path, layers: int) -> None:
    """The same actions and states, step by step, also where some episodes begin anew."""
    model = model_of(layers)
    save_policy(tmp_path, network_of(model), description())
    policy = load_policy(tmp_path)
    assert isinstance(policy, RecurrentPolicy)
    rng = np.random.default_rng(0)
    n, inputs = 6, policy.network.inputs
    theirs = ours = None
    starts = np.ones(n, dtype=bool)
    seen = []
    for step in range(40):
        observations = (0.3 * rng.normal(size=(n, inputs))).astype(np.float32)
        expected, theirs = model.predict(
            observations, state=theirs, episode_start=starts, deterministic=True
        )
        actions, ours = policy.predict(observations, state=ours, episode_start=starts)
        np.testing.assert_allclose(actions, expected, atol=3e-6)
        for mine, other in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(mine, other, atol=3e-6)
        seen.append(actions)
        starts = rng.random(n) < 0.2
        if step == 0:
            starts[:] = False
    assert np.abs(seen).max() < 1.0, "clipped actions would agree whatever the network"
    assert np.std(seen) > 0.01


def test_memory_matters_and_an_episode_s_start_empties_it() -> None:
    policy = policy_of(model_of(), description())
    one = np.full(policy.network.inputs, 0.2, dtype=np.float32)
    fresh, state = policy.predict(one)
    again, _ = policy.predict(one, state=state)
    begun, _ = policy.predict(one, state=state, episode_start=np.ones(1, dtype=bool))
    assert fresh.shape == (2,)
    assert np.abs(again - fresh).max() > 1e-5
    np.testing.assert_array_equal(begun, fresh)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"state": (np.zeros((1, 2, 5)),)}, "state must be two arrays"),
        ({"state": (np.zeros((1, 3, 5)),) * 2}, "state must be two arrays"),
        ({"state": (np.full((1, 2, 5), np.nan),) * 2}, "not finite"),
        (
            {"state": (np.zeros((1, 2, 5)),) * 2, "episode_start": np.ones(3, dtype=bool)},
            "episode_start must have shape",
        ),
        ({"deterministic": False}, "deterministic"),
    ],
)
def test_what_is_no_memory_is_refused(arguments: dict[str, Any], message: str) -> None:
    policy = policy_of(model_of(), description())
    with pytest.raises(PolicyError, match=message):
        policy.predict(np.zeros((2, policy.network.inputs), dtype=np.float32), **arguments)


def test_trained_exported_flown_and_in_the_benchmark(tmp_path: Path) -> None:
    request = TrainingRequest(
        algorithm="recurrent_ppo",
        env_id=ENV_ID,
        options={"horizon": 0.5},
        steps=128,
        seed=1,
        settings=from_data(
            {
                "algorithm": "recurrent_ppo", "n_envs": 4, "learning_rate": 1e-3,
                "model": {"n_steps": 16, "batch_size": 32, "n_epochs": 1},
                "network": {"layers": [8], "lstm_units": 4, "lstm_critic": False},
            }
        ),
        evaluations=1,
        evaluation_episodes=2,
    )  # fmt: skip
    directory = tmp_path / "seed_0"
    train(directory, request)
    policy = load_policy(directory)
    assert policy.description["training"]["updates"] == 2
    assert policy.description["recurrent"] == [[4, policy.network.inputs]]
    config = environment_config(ENV_ID, {"config": policy.config})
    flown = fly_policy(policy, ENV_ID, config, seed=0, episodes=3, label="mine")
    assert np.isfinite(flown.metrics["tip_error_rms"]).all()
    competitor = Competitor(policy="ppo", runs={0: directory})
    ((_, pilot),) = competitor.pilots()
    assert isinstance(pilot, PredictorPilot)
    metrics = pilot.fly(load("thesis").scenarios[:2], seed=[0, 1])
    assert np.isfinite(metrics["tip_error_rms"]).all()
    with pytest.raises(PolicyError, match="the engine flies no recurrent network"):
        policy.network.engine()


def test_a_policy_with_a_memory_is_nothing_to_begin_with(tmp_path: Path) -> None:
    save_policy(tmp_path / "begun", network_of(model_of()), description())
    request = TrainingRequest(
        algorithm="ppo",
        env_id=ENV_ID,
        options={},
        steps=64,
        seed=1,
        settings=from_data({"algorithm": "ppo", "n_envs": 4, "learning_rate": 1e-3}),
        start=tmp_path / "begun",
    )
    with pytest.raises(RunError, match="without a memory"):
        train(tmp_path / "run", request)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"recurrent": []}, "recurrent must be a list of 1 to 4 sizes"),
        ({"recurrent": [[5, 10**9]]}, "sizes from 1 to 4096"),
        ({"recurrent": [[True, 5]]}, "sizes from 1 to 1024"),
        ({"recurrent": [[5]]}, "hidden units and inputs"),
        ({"recurrent": [[6, 25]]}, "layers.0. takes 5 inputs, but recurrent gives 6"),
        ({"recurrent": [[5, 3]]}, "observation_layout has"),
        ({"recurrent": [[5, 25], [5, 6]]}, r"recurrent\[1\] must be \[5, 5\]"),
        ({"recurrent": None}, "recurrent must be a list"),
    ],
)
def test_strange_descriptions_are_refused(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    save_policy(tmp_path, network_of(model_of()), description())
    path = tmp_path / "policy.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
    with pytest.raises(RunError, match=message):
        load_policy(tmp_path)


def test_without_its_memory_the_file_is_refused(tmp_path: Path) -> None:
    """So does an older version, which knows no memory, refuse it."""
    save_policy(tmp_path, network_of(model_of()), description())
    path = tmp_path / "policy.json"
    content = json.loads(path.read_text())
    del content["recurrent"]
    path.write_text(json.dumps(content))
    with pytest.raises(RunError, match="observation_layout has"):
        load_policy(tmp_path)
    content["observation_layout"] = content["observation_layout"][:5]
    path.write_text(json.dumps(content))
    with pytest.raises(RunError, match="also holds the array"):
        load_policy(tmp_path)


def test_settings_of_the_memory_are_checked() -> None:
    settings = load_hyperparameters("recurrent_ppo")
    assert settings.network.lstm_units == 64
    assert from_data(settings.to_dict()) == settings
    plain = load_hyperparameters("ppo").to_dict()
    assert not any(name.startswith("lstm") for name in plain["network"])
    with pytest.raises(BaselineError, match=r"network\.lstm_units"):
        from_data({**plain, "network": {"lstm_units": 4}})
    for name, value in (("lstm_units", 0), ("lstm_layers", 9), ("lstm_critic", 1)):
        data = settings.to_dict()
        data["network"][name] = value
        with pytest.raises(BaselineError, match=rf"network\.{name} must be"):
            from_data(data)
