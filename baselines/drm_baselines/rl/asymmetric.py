"""A critic that is told the true payload, of which the actor knows what is reported alone.

While PPO trains, what is privileged is appended to the observations; the actor drops it again, so
that its network is the one of the environment's own observation and flies without.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from drm_baselines.support.extras import needing

with needing("training", "learn"):
    import torch
    from stable_baselines3.common.policies import ActorCriticPolicy
    from stable_baselines3.common.torch_layers import MlpExtractor
    from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn
    from torch import nn

PRIVILEGED = {"context/mass_error": 0.1, "context/payload_mass": 500.0}
"""What the critic is told, by the keys of the info, and the scale that each is divided by: those of
the observations ``identified_mass_error`` and ``payload_mass``."""


class PrivilegedObservations(VecEnvWrapper):
    """Appends the true payload of the present episode to the observations.

    A last observation, ``info["terminal_observation"]``, has the payload of the episode that ended.

    Parameters
    ----------
    venv
        A :class:`drm_env.sb3.DrmSB3VecEnv`, with or without wrappers.
    """

    def __init__(self, venv: VecEnv) -> None:
        space = venv.observation_space
        assert isinstance(space, spaces.Box), "observations are arrays"
        limits = np.full(len(PRIVILEGED), np.inf, dtype=np.float32)
        super().__init__(
            venv,
            observation_space=spaces.Box(
                np.concatenate([space.low, -limits]), np.concatenate([space.high, limits])
            ),
        )
        self._privileged = np.zeros((self.num_envs, len(PRIVILEGED)), dtype=np.float32)

    def reset(self) -> NDArray[np.float32]:
        """Reset the environments."""
        observations = self.venv.reset()
        self._read(None)
        return self._extended(observations)

    def step_wait(self) -> VecEnvStepReturn:
        """Step the environments."""
        observations, rewards, dones, infos = self.venv.step_wait()
        ended = np.flatnonzero(dones).tolist()
        if ended:
            for index in ended:
                last = infos[index]["terminal_observation"]
                infos[index]["terminal_observation"] = np.concatenate(
                    [last, self._privileged[index]]
                )
            self._read(ended)
        return self._extended(observations), rewards, dones, infos

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: VecEnvIndices = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """Call a method of some environments, which may begin another episode there."""
        results = self.venv.env_method(method_name, *method_args, indices=indices, **method_kwargs)
        self._read(None)
        return results

    def _read(self, indices: Iterable[int] | None) -> None:
        contexts: list[Mapping[str, float]] = self.venv.get_attr("context", indices)
        self._privileged[slice(None) if indices is None else list(indices)] = [
            [context[key] / scale for key, scale in PRIVILEGED.items()] for context in contexts
        ]

    def _extended(self, observations: Any) -> NDArray[np.float32]:
        return np.concatenate([observations, self._privileged], axis=1)


class _Networks(MlpExtractor):
    """Hidden layers of the critic, and of an actor that drops what is privileged."""

    def __init__(self, inputs: int, layers: Any, activation: type[nn.Module], device: Any) -> None:
        super().__init__(inputs, layers, activation, device)
        self._own = inputs - len(PRIVILEGED)
        self.policy_net = MlpExtractor(self._own, layers, activation, device).policy_net

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Return the actor's last hidden layer."""
        return super().forward_actor(features[..., : self._own])


class AsymmetricPolicy(ActorCriticPolicy):
    """Actor and critic of PPO for :class:`PrivilegedObservations`."""

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _Networks(
            self.features_dim, self.net_arch, self.activation_fn, self.device
        )
