"""Section ``learn``: frames per second of PPO, beside PPO on environments that do nothing."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from drm_baselines.speed.measure import Spread, paired_ratio, seconds_per_call
from drm_baselines.speed.results import Bench, Row, Section

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

ENV_IDS = ("drm_env/SlewResidual-v0", "drm_env/Slew-v0")
SIZES = (64, 256)
_STEPS = 64
"""Steps of every environment an update: SB3's 2048 would take a minute each."""
_TORCH_THREADS = 1
"""As in this project's own training: the network is too small for more to pay."""
_TITLE = "Learning with PPO"


def idle_environment(like: VecEnv) -> VecEnv:
    """Return a vector environment of the same spaces and size whose steps do nothing.

    It hands out the same zeros at every step, and a new dictionary for each environment, as
    Stable-Baselines3 asks for.
    """
    import numpy as np
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor

    class Idle(VecEnv):
        """Constant observations, no rewards, no ends."""

        render_mode = None

        def __init__(self) -> None:
            super().__init__(like.num_envs, like.observation_space, like.action_space)
            self._observations = np.zeros(
                (self.num_envs, *(self.observation_space.shape or ())), np.float32
            )
            self._rewards = np.zeros(self.num_envs, np.float32)
            self._dones = np.zeros(self.num_envs, np.bool_)

        def reset(self) -> Any:
            return self._observations

        def step_async(self, actions: Any) -> None:
            pass

        def step_wait(self) -> Any:
            infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
            return self._observations, self._rewards, self._dones, infos

        def close(self) -> None:
            pass

        def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
            return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

        def set_attr(
            self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None
        ) -> None:
            raise NotImplementedError("an idle environment has nothing to set")

        def env_method(
            self,
            method_name: str,
            *method_args: Any,
            indices: int | Iterable[int] | None = None,
            **method_kwargs: Any,
        ) -> list[Any]:
            raise NotImplementedError("an idle environment has no methods")

        def env_is_wrapped(
            self,
            wrapper_class: Any,  # noqa: ARG002
            indices: int | Iterable[int] | None = None,
        ) -> list[bool]:
            return [False] * len(list(self._get_indices(indices)))

        def get_images(self) -> Sequence[Any]:
            return [None] * self.num_envs

    return VecMonitor(Idle())


def _frames(venv: VecEnv, seconds: float) -> Callable[[], float]:
    """Return a measurement of rollouts and updates over some seconds: frames per second."""
    from stable_baselines3 import PPO

    frames = _STEPS * venv.num_envs
    model = PPO(
        "MlpPolicy",
        venv,
        n_steps=_STEPS,
        device="cpu",
        seed=0,
        verbose=0,
    )

    def learn() -> None:
        model.learn(frames, reset_num_timesteps=False, log_interval=1_000_000)

    learn()
    return lambda: frames / seconds_per_call(learn, seconds)


def run(bench: Bench) -> Section:
    """Learn a little, in turn on the environments and on idle ones."""
    if importlib.util.find_spec("stable_baselines3") is None:
        note = "left out: stable-baselines3 is not installed (the extra 'learn' has it)"
        return Section("learn", _TITLE, [], [note])
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(_TORCH_THREADS)
    try:
        return _measured(bench)
    finally:
        torch.set_num_threads(before)


def _measured(bench: Bench) -> Section:
    from drm_env.sb3 import make_sb3_vec

    rows: list[Row] = []
    headline: dict[str, float | None] = {}
    for num_envs in SIZES:
        for env_id in ENV_IDS:
            short = env_id.removeprefix("drm_env/")
            venv = make_sb3_vec(env_id, n_envs=num_envs, seed=0)
            idle = idle_environment(venv)
            try:
                measured = bench.interleave(
                    f"learn: {short}, {num_envs}",
                    {
                        name: _frames(env, 2.0 * bench.seconds)
                        for name, env in (("ours", venv), ("idle", idle))
                    },
                )
            finally:
                venv.close()
            ratio = paired_ratio(measured["ours"], measured["idle"])
            name = f"PPO on {short}, {num_envs} environments"
            partner = "the same PPO on idle environments"
            rows.append(Row(name, Spread.of(measured["ours"]), "frames/s", ratio, partner))
            rows.append(
                Row(f"idle, spaces of {short}, {num_envs}", Spread.of(measured["idle"]), "frames/s")
            )
            headline[f"learn_{short}_{num_envs}_over_idle"] = ratio.median
    notes = [
        "Stable-Baselines3's PPO with its own defaults (minibatches of 64, 10 epochs) but for "
        f"{_STEPS} steps of every environment an update; {_TORCH_THREADS} torch thread. An idle "
        "environment returns the same arrays at every step and an empty dictionary for each "
        "environment; both have Stable-Baselines3's VecMonitor."
    ]
    return Section("learn", _TITLE, rows, notes, headline)
