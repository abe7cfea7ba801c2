"""The model and the environments of a training run."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import drm_env
from drm_baselines.errors import RunError
from drm_baselines.policies.perceptron import NetworkPolicy
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.rl import hyperparameters
from drm_baselines.rl.algorithms import ALGORITHMS
from drm_baselines.rl.asymmetric import AsymmetricPolicy, PrivilegedObservations
from drm_baselines.rl.export import actor_layers, perceptron_of
from drm_baselines.rl.request import TrainingRequest
from drm_baselines.rl.staggered_resets import StaggeredStart
from drm_baselines.support import cores, memory
from drm_baselines.support.extras import needing
from drm_baselines.support.seeds import training_seed

with needing("training", "learn"):
    import torch
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.utils import LinearSchedule
    from stable_baselines3.common.vec_env import VecEnv
    from torch import nn

_ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU}


def make_model(request: TrainingRequest, env: VecEnv) -> BaseAlgorithm:
    """Return an untrained model.

    Raises
    ------
    RunError
        Hyperparameters that Stable-Baselines3 refuses.
    """
    settings = request.settings
    arguments = dict(settings.model)
    algorithm = ALGORITHMS[request.algorithm]
    _check_memory(request, env)
    network: dict[str, Any] = {
        "net_arch": list(settings.network.layers),
        "activation_fn": _ACTIVATIONS[settings.network.activation],
    }
    if algorithm.draws:
        network["log_std_init"] = settings.network.log_std_init
    if algorithm.remembers:
        network["lstm_hidden_size"] = settings.network.lstm_units
        network["n_lstm_layers"] = settings.network.lstm_layers
        network["enable_critic_lstm"] = settings.network.lstm_critic
    if algorithm.replays:
        arguments["action_noise"] = _noise(arguments.get("action_noise"), env)
    if algorithm.draws and algorithm.replays and arguments.get("use_sde"):
        # By default the mean is clipped before it is squashed: one more kind of layer for nothing.
        network["clip_mean"] = 0.0
    try:
        return type_of(settings)(
            _policy_of(request),
            env,
            learning_rate=LinearSchedule(settings.learning_rate, settings.learning_rate_end, 1.0),
            policy_kwargs=network,
            seed=request.seed,
            device="cpu",
            verbose=0,
            **arguments,
        )
    except (TypeError, ValueError, AssertionError, OverflowError, MemoryError) as error:
        raise RunError(f"Stable-Baselines3 refuses the hyperparameters in [model]: {error}") from (
            error
        )


def type_of(settings: hyperparameters.Hyperparameters) -> type[BaseAlgorithm]:
    """Return the class of the model that settings ask for.

    Raises
    ------
    MissingPackageError
        Its package is not installed.
    """
    if settings.fast_updates:
        from drm_baselines.rl.fast_ppo import FastPPO

        return FastPPO
    return ALGORITHMS[settings.algorithm].load_type()


def _policy_of(request: TrainingRequest) -> Any:
    """The class of the policy, or its name."""
    if request.settings.network.critic_sees_payload:
        return AsymmetricPolicy
    return "MlpLstmPolicy" if ALGORITHMS[request.algorithm].remembers else "MlpPolicy"


def _noise(deviation: Any, env: VecEnv) -> NormalActionNoise | None:
    """Gaussian noise that is added to actions.

    Raises
    ------
    RunError
        A standard deviation that is none.
    """
    if deviation is None:
        return None
    if isinstance(deviation, bool) or not isinstance(deviation, (int, float)):
        raise RunError(f"[model] action_noise must be a number, got {deviation!r}")
    if not 0.0 <= deviation <= 1.0:
        raise RunError(f"[model] action_noise must be between 0 and 1, got {deviation}")
    entries = env.action_space.shape or ()
    return NormalActionNoise(np.zeros(entries), np.full(entries, float(deviation)))


def _check_memory(request: TrainingRequest, env: VecEnv) -> None:
    """Refuse buffers that do not fit; whatever is no whole number Stable-Baselines3 refuses.

    Raises
    ------
    BaselineError
        The message says how much they would take.
    """
    model, shape = request.settings.model, env.observation_space.shape
    name = "buffer_size" if ALGORITHMS[request.algorithm].replays else "n_steps"
    size = model.get(name, 1_000_000 if name == "buffer_size" else 2048)
    if type(size) is not int or shape is None:
        return
    # of float32: an observation (in a buffer also the next one), an action and some single numbers
    values = (2 if name == "buffer_size" else 1) * shape[0] + 12
    if ALGORITHMS[request.algorithm].remembers:
        # states of actor and critic, two each, beside every step
        values += 4 * request.settings.network.lstm_layers * request.settings.network.lstm_units
    rows = size if name == "buffer_size" else size * env.num_envs
    memory.require(4 * rows * values, f"[model] {name} = {size}")


def set_threads(settings: hyperparameters.Hyperparameters) -> None:
    """Let torch use the threads of the settings, as far as the machine has them."""
    most = os.cpu_count() or 1
    if settings.torch_threads > most:
        warnings.warn(
            f"torch_threads = {settings.torch_threads} is more than the {most} processors of this "
            f"machine: {most} are used, and the run may differ in its last digits",
            stacklevel=3,
        )
    torch.set_num_threads(min(settings.torch_threads, most))


def begin_with(model: BaseAlgorithm, directory: Path, config: drm_env.EnvConfig) -> None:
    """Give a model's actor the weights of a saved policy.

    PPO's actor then acts as the policy does. Those of SAC, TQC and TD3 squash their last layer by a
    hyperbolic tangent where a student is clipped: small actions are the same (0.2 becomes 0.197),
    large ones smaller.

    Raises
    ------
    RunError
        An algorithm that cannot go on from it, or a policy of another shape, activation or
        observation.
    """
    policy = load_policy(directory)
    layout = [list(entry) for entry in drm_env.observation_layout(config=config)]
    if [list(entry) for entry in policy.description["observation_layout"]] != layout:
        raise RunError(f"{directory}: the policy sees another observation than this task's")
    if type(policy) is not NetworkPolicy:
        raise RunError(f"{directory}: only a policy without a memory can be begun with")
    own, output = actor_layers(model)
    if not own:
        raise RunError(f"{directory}: {type(model).__name__} cannot go on from a policy")
    if output == "clip" and policy.network.output != "clip":
        raise RunError(
            f"{directory}: {type(model).__name__} can go on from a policy whose output is clipped, "
            f"this one's is {policy.network.output!r}"
        )
    shapes = [list(layer.weight.shape) for layer in own]
    given = [list(weight.shape) for weight in policy.network.weights]
    if shapes != given or perceptron_of(model).activation != policy.network.activation:
        raise RunError(f"{directory}: the policy has layers {given}, the hyperparameters {shapes}")
    with torch.no_grad():
        for layer, weight, bias in zip(
            own, policy.network.weights, policy.network.biases, strict=True
        ):
            layer.weight.copy_(torch.from_numpy(np.array(weight)))
            layer.bias.copy_(torch.from_numpy(np.array(bias)))


def make_envs(
    request: TrainingRequest, config: drm_env.EnvConfig, segment: int
) -> tuple[VecEnv, int]:
    """Return the environments of a segment of a run, and the first of their seeds."""
    from drm_env.sb3 import make_sb3_vec

    first = training_seed(request.seed, segment)
    # The metrics in the last info say more than a monitor's, and infos are kept small.
    env = make_sb3_vec(
        request.env_id,
        n_envs=request.settings.n_envs,
        monitor=False,
        step_context=False,
        config=config,
        num_threads=cores.given(),
    )
    horizon = round(config.scenario.horizon / config.task.control_period)
    env = StaggeredStart(env, horizon)
    if request.settings.network.critic_sees_payload:
        env = PrivilegedObservations(env)
    return env, first
