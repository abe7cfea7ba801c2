"""PPO with the gradient written out, held against Stable-Baselines3's own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3 import PPO
from torch import nn

from drm_baselines.errors import BaselineError
from drm_baselines.rl import fast_ppo
from drm_baselines.rl.fast_ppo import FastPPO, is_plain
from drm_baselines.rl.hyperparameters import from_data, load_hyperparameters
from drm_baselines.rl.request import TrainingRequest
from drm_baselines.rl.training import resume, train
from drm_env.sb3 import make_sb3_vec

pytestmark = pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")


def learned(kind: type[PPO], optimizer: Any = None, updates: int = 2, **arguments: Any) -> PPO:
    """A model after some updates; 8 x 32 samples each, the last minibatch smaller."""
    env = make_sb3_vec("drm_env/SlewResidual-v1", n_envs=8, seed=0, horizon=3.0)
    whole = {"n_steps": 32, "batch_size": 48, "n_epochs": 3, "seed": 0, "device": "cpu"}
    model = kind("MlpPolicy", env, **{**whole, **arguments})
    if optimizer is not None:
        model.policy.optimizer = optimizer(model.policy.parameters())
    np.random.seed(1)  # noqa: NPY002
    torch.manual_seed(1)
    model.learn(updates * 256)
    env.close()
    return model


def apart(first: PPO, second: PPO) -> float:
    """Largest difference of two models' parameters, in units of the largest of each array."""
    pairs = zip(first.policy.parameters(), second.policy.parameters(), strict=True)
    return max(float(((a - b).abs().max() / a.abs().max()).detach()) for a, b in pairs)


@pytest.mark.parametrize(
    "arguments",
    [
        {"ent_coef": 0.01, "clip_range_vf": 0.05, "learning_rate": 0.3},
        {"normalize_advantage": False, "learning_rate": 0.1, "vf_coef": 0.2},
        {"target_kl": 0.02, "learning_rate": 0.5, "max_grad_norm": 0.1},
        {"policy_kwargs": {"activation_fn": nn.ReLU, "net_arch": {"pi": [9, 8, 7], "vf": [5]}},
         "learning_rate": 0.3, "clip_range": 0.02},
    ],
)  # fmt: skip
def test_the_gradient_is_that_of_automatic_differentiation(
    monkeypatch: pytest.MonkeyPatch, arguments: dict[str, Any]
) -> None:
    """Under plain descent two runs stay together; what is logged is the same as well."""

    class Descent:
        def __init__(self, optimizer: Any) -> None:
            self._optimizer = optimizer
            (group,) = optimizer.param_groups
            for parameter in group["params"]:
                parameter.grad = torch.zeros_like(parameter)
            self.gradients = {one: one.grad for one in group["params"]}
            self._parameters = group["params"]

        @staticmethod
        def fits(_: Any) -> bool:
            return True

        def step(self, largest: float) -> None:
            nn.utils.clip_grad_norm_(self._parameters, largest)
            self._optimizer.step()

        def finish(self) -> None:
            pass

    def descent(parameters: Any) -> Any:
        return torch.optim.SGD(parameters, lr=1.0)

    theirs = learned(PPO, descent, **arguments)
    monkeypatch.setattr(fast_ppo, "_FlatAdam", Descent)
    ours = learned(FastPPO, descent, **arguments)
    assert apart(theirs, ours) < 1e-4
    assert ours._n_updates == theirs._n_updates
    logged = {k: v for k, v in theirs.logger.name_to_value.items() if k.startswith("train/")}
    assert len(logged) >= 10
    for name, value in logged.items():
        assert ours.logger.name_to_value[name] == pytest.approx(value, rel=1e-3, abs=1e-5), name
    assert float(logged["train/clip_fraction"]) > 0.0


def test_adam_is_pytorch_s_but_for_rounding() -> None:
    rng = torch.Generator().manual_seed(0)
    theirs = [nn.Parameter(torch.randn(shape, generator=rng)) for shape in ((7, 5), (3,), (1,))]
    ours = [nn.Parameter(one.detach().clone()) for one in theirs]
    first = torch.optim.Adam(theirs, lr=1e-3, eps=1e-5)
    second = torch.optim.Adam(ours, lr=1e-3, eps=1e-5)
    for stretch in range(2):  # the second begins with moments that are there
        adam = fast_ppo._FlatAdam(second)
        for _ in range(5):
            for one, other in zip(theirs, ours, strict=True):
                one.grad = torch.randn(one.shape, generator=rng)
                adam.gradients[other].copy_(one.grad)
            nn.utils.clip_grad_norm_(theirs, 0.5)
            first.step()
            with torch.no_grad():
                adam.step(0.5)
        adam.finish()
        for one, other in zip(theirs, ours, strict=True):
            torch.testing.assert_close(one, other, rtol=1e-6, atol=1e-7)
            for name in ("exp_avg", "exp_avg_sq", "step"):
                mine, its = second.state[other][name], first.state[one][name]
                torch.testing.assert_close(mine, its, rtol=1e-5, atol=1e-8)
        assert second.state_dict()["state"][0]["step"] == 5 * (stretch + 1)


def test_actions_of_a_rollout_are_the_same() -> None:
    theirs, ours = (learned(kind, updates=1, n_epochs=1) for kind in (PPO, FastPPO))
    for name in ("observations", "actions", "rewards", "values", "log_probs", "advantages"):
        mine, its = (getattr(model.rollout_buffer, name) for model in (ours, theirs))
        # single precision: some ten roundings of 6e-8 a layer, and sums over an episode
        np.testing.assert_allclose(mine, its, rtol=1e-5, atol=3e-6, err_msg=name)
    observation = ours.rollout_buffer.observations[:4].reshape(4, -1)
    assert "forward" not in vars(ours.policy)
    assert ours.predict(observation, deterministic=True)[0].shape == (4, 2)


def test_other_policies_are_left_to_the_library() -> None:
    assert is_plain(learned(FastPPO, updates=1).policy)
    theirs, ours = (learned(kind, updates=1, use_sde=True) for kind in (PPO, FastPPO))
    assert not is_plain(ours.policy)
    assert apart(theirs, ours) == 0.0
    weighted = learned(
        FastPPO, lambda parameters: torch.optim.AdamW(parameters, lr=1e-3), updates=1
    )
    assert not fast_ppo._FlatAdam.fits(weighted.policy.optimizer)


def test_it_is_trained_saved_and_resumed(tmp_path: Path) -> None:
    data = {
        "algorithm": "ppo", "n_envs": 4, "learning_rate": 1e-3, "fast_updates": True,
        "model": {"n_steps": 16, "batch_size": 32, "n_epochs": 2}, "network": {"layers": [8]},
    }  # fmt: skip
    request = TrainingRequest(
        algorithm="ppo",
        env_id="drm_env/SlewResidual-v1",
        options={"horizon": 0.5},
        steps=128,
        seed=1,
        settings=from_data(data),
        evaluations=1,
        evaluation_episodes=2,
    )
    record = train(tmp_path, request)
    assert record.hyperparameters["fast_updates"] is True
    assert resume(tmp_path, steps=192).steps == 192
    assert load_hyperparameters("ppo").fast_updates
    assert "fast_updates" not in from_data({**data, "fast_updates": False}).to_dict()
    with pytest.raises(BaselineError, match="fast_updates must be false for sac"):
        from_data({**data, "algorithm": "sac"})
    with pytest.raises(BaselineError, match="fast_updates must be true or false"):
        from_data({**data, "fast_updates": 1})
