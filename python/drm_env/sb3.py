"""The batch as a vector environment of Stable-Baselines3 (which this module alone imports)."""

from __future__ import annotations

import copy
import operator
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from drm_env._arguments import OptionsAreNoAttributes
from drm_env._infos import EPISODE_KEYS, REWARD_KEYS, episode_rows
from drm_env._spec import OF_BATCH
from drm_env.errors import ConfigError
from drm_env.missions import mission_keys
from drm_env.resolution import spec_of
from drm_env.sub_env import SubEnv
from drm_env.vector import DrmVectorEnv

try:
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"drm_env.sb3 needs Stable-Baselines3, and there is no module {error.name!r}. Install it "
        "with: python -m pip install stable-baselines3",
        name=error.name,
    ) from error

__all__ = ["DrmSB3VecEnv", "make_sb3_vec", "native_batch"]

if TYPE_CHECKING:
    from typing import Unpack

    from drm_env._options import Options
    from drm_env.configuration import ConfigLike

    class BatchArguments(Options, total=False):
        """What `DrmVectorEnv` takes besides the number of sub-environments."""

        task: str
        config: ConfigLike
        render_mode: str | None
        render_width: int
        render_height: int
        render_magnification: float | None
        render_title: str
        render_colour: str
        max_episode_steps: int | None
        num_threads: int | None


Indices = int | Iterable[int] | None

_TIP_VIBRATION, _SLEW_ERROR, _EFFORT = REWARD_KEYS
_UNPAID: dict[str, Any] = dict.fromkeys(REWARD_KEYS, 0.0)


class DrmSB3VecEnv(OptionsAreNoAttributes, VecEnv):
    """A `DrmVectorEnv` with the interface and the semantics of Stable-Baselines3's ``DummyVecEnv``.

    Sub-environments that end are reset in the same step; their last observation is
    ``info["terminal_observation"]`` and ``info["TimeLimit.truncated"]`` says whether time alone
    ended them. Arrays and infos are new at every step. Infos are those of `DrmEnv`, but the last of
    an episode alone holds ``metrics/...``, ``diverged`` and ``is_success``.

    Parameters
    ----------
    num_envs : int
        Number of sub-environments.
    step_context : bool
        Whether the infos of ordinary steps carry the true context too. Without it they hold the
        reward terms alone, which saves time with many sub-environments; the infos of resets and
        of last steps always hold everything.
    **arguments
        As for `DrmVectorEnv`, the autoreset mode excepted.

    Raises
    ------
    ConfigError
        An unknown name or an impossible value.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        step_context: bool = True,
        **arguments: Unpack[BatchArguments],
    ) -> None:
        for name in ("autoreset_mode", "copy"):
            if name in arguments:
                raise ConfigError(f"{name} is fixed by Stable-Baselines3's interface")
        self.batch = DrmVectorEnv(num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)
        self._step_context = bool(step_context)
        self._contexts: list[dict[str, Any]] = [{} for _ in range(num_envs)]
        self._templates: list[dict[str, Any]] = []
        self._actions: NDArray[np.float32] | None = None
        super().__init__(
            num_envs, self.batch.single_observation_space, self.batch.single_action_space
        )
        self.metadata = dict(self.batch.metadata)

    # -- Episodes ----------------------------------------------------------------------------

    def reset(self) -> NDArray[np.float32]:
        """Starts an episode everywhere, with the seeds and options set for this reset.

        Returns
        -------
        observations
            float32 of shape (num_envs, n).

        Raises
        ------
        ConfigError
            An unknown or impossible option; nothing has been reset.
        """
        observations = self.batch.reset_envs(self._seeds, self._options)
        self._take_contexts(self.batch.contexts.infos())
        self.reset_infos = [{**context, **_UNPAID} for context in self._contexts]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Takes the actions, shape (num_envs, k); `step_wait` applies them."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Holds the actions for one control period.

        Returns
        -------
        observations, rewards, dones, infos
            float32 (num_envs, n), float32 (num_envs,), bool (num_envs,), one dictionary each.

        Raises
        ------
        ActionError
            Wrong shape or not finite; `ActionTypeError` if not made of numbers.
        ResetNeededError
            Before the first ``reset``.
        """
        if self._actions is None:
            raise ConfigError("actions are missing: step_async comes before step_wait")
        actions, self._actions = self._actions, None
        buffers, _, any_done = self.batch.advance(actions)
        observations, rewards, terminated, truncated, terms = buffers
        # Copies of dictionaries that have all keys already are several times as fast as new ones.
        infos = [template.copy() for template in self._templates]
        for info, (vibration, slew, effort) in zip(infos, terms.tolist(), strict=False):
            info[_TIP_VIBRATION] = vibration
            info[_SLEW_ERROR] = slew
            info[_EFFORT] = effort
        if not any_done:
            return observations, rewards.astype(np.float32), terminated, infos
        dones = terminated | truncated
        self._end_episodes(dones, truncated & ~terminated, infos)
        return observations, rewards.astype(np.float32), dones, infos

    def _take_contexts(self, contexts: list[dict[str, Any]]) -> None:
        """Keeps the contexts of the present episodes and, to be filled in, their steps' infos."""
        self._contexts = contexts
        self._templates = [self._template(context) for context in contexts]

    def _template(self, context: dict[str, Any]) -> dict[str, Any]:
        terms = {**_UNPAID, "TimeLimit.truncated": False}
        return {**context, **terms} if self._step_context else terms

    def _end_episodes(
        self,
        dones: NDArray[np.bool_],
        timeouts: NDArray[np.bool_],
        infos: list[dict[str, Any]],
    ) -> None:
        """Completes the infos of the episodes that ended and takes over the new ones' contexts."""
        last, metrics, diverged, settled = self.batch.ended()
        rows = episode_rows(metrics, diverged, settled).T
        contexts = self.batch.contexts.infos()
        keys = mission_keys(self.batch.resolved_config.held.mission_legs)
        missions = self.batch.ended_missions()
        for index in np.flatnonzero(dones).tolist():
            info = infos[index]
            info.update(zip(keys, missions[index].tolist(), strict=True))
            info.update(self._contexts[index])
            info.update(zip(EPISODE_KEYS, rows[index].tolist(), strict=True))
            info["TimeLimit.truncated"] = bool(timeouts[index])
            info["terminal_observation"] = last[index].copy()
            self._contexts[index] = contexts[index]
            self._templates[index] = self._template(contexts[index])
            self.reset_infos[index] = {**contexts[index], **_UNPAID}

    def close(self) -> None:
        """Lets go of the engine."""
        self.batch.close()

    # -- Sub-environments --------------------------------------------------------------------

    def _lanes(self, indices: Indices) -> list[SubEnv]:
        if indices is None:
            return self.batch.envs
        if isinstance(indices, (int, np.integer)):
            indices = [operator.index(indices)]
        return [self.batch.envs[index] for index in indices]

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """The values of an attribute of some sub-environments."""
        return [getattr(lane, attr_name) for lane in self._lanes(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Sets an attribute of some sub-environments.

        Raises
        ------
        ConfigError
            An option's name (to change a parameter, ``env_method("set_context", ...)``), or what is
            the same for the whole batch; nothing has been set.
        """
        for lane in self._lanes(indices):
            setattr(lane, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Calls a method of some sub-environments, such as ``set_context`` or ``get_state``."""
        results = [
            getattr(lane, method_name)(*method_args, **method_kwargs)
            for lane in self._lanes(indices)
        ]
        if method_name in ("reset", "set_state"):
            self._take_contexts(self.batch.contexts.infos())
        return results

    def env_is_wrapped(
        self,
        wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]],  # noqa: ARG002
        indices: Indices = None,
    ) -> list[bool]:
        """Never: the sub-environments live in the engine."""
        return [False] * len(self._lanes(indices))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One frame of each sub-environment, uint8 of shape (height, width, 3)."""
        if self.render_mode != "rgb_array":
            warnings.warn(
                f"images need render_mode='rgb_array', it is {self.render_mode!r}", stacklevel=2
            )
            return [None] * self.num_envs
        # with rgb_array a lane renders an array, never text
        return [env.render() for env in self.batch.envs]  # type: ignore[misc]


def make_sb3_vec(
    env_id: str | EnvSpec,
    n_envs: int | None = None,
    seed: int | None = None,
    *,
    num_envs: int | None = None,
    monitor: bool = True,
    step_context: bool = True,
    **options: Unpack[BatchArguments],
) -> VecEnv:
    """A batch for Stable-Baselines3, from a registered environment.

    Parameters
    ----------
    env_id : str or EnvSpec
        ``"drm_env/Slew-v0"`` or one of the others, ``"module:id"`` for an id that importing the
        module registers, or a specification, such as that of an environment. A step limit that is
        registered or in the specification holds; see `DrmEnv` for what it means.
    n_envs, num_envs : int, optional
        Number of sub-environments, by the name of Stable-Baselines3 or of Gymnasium; by default
        that of the specification of a batch, else 1.
    seed : int, optional
        Sub-environment i gets ``seed + i`` at the first reset.
    monitor : bool
        Whether to add Stable-Baselines3's ``VecMonitor``, which records returns and lengths.
    step_context : bool
        See `DrmSB3VecEnv`.
    **options
        As for ``gym.make_vec``, ``max_episode_steps`` included.

    Raises
    ------
    ConfigError
        Not an environment of this package, wrappers (which cannot be put around the
        sub-environments of a batch), or an unknown or impossible option.

    Examples
    --------
    >>> from drm_env.sb3 import make_sb3_vec
    >>> venv = make_sb3_vec("drm_env/SlewResidual-v0", n_envs=4, seed=0)
    >>> venv.reset().shape == (4, *venv.observation_space.shape)
    True
    """
    spec = spec_of(env_id)
    arguments: Any = {**spec.kwargs, **options}
    own = arguments.pop("num_envs", None)
    if n_envs is not None and num_envs is not None:
        raise ConfigError(f"give one of n_envs and num_envs, got {n_envs!r} and {num_envs!r}")
    given = [number for number in (n_envs, num_envs, own) if number is not None]
    count = given[0] if given else 1
    mode = arguments.pop("vectorization_mode", None)
    if mode not in (None, "vector_entry_point"):
        raise ConfigError(f"vectorization_mode of this batch is its own, got {mode!r}")
    for name in ("vector_kwargs", "wrappers"):
        if value := arguments.pop(name, None):
            raise ConfigError(f"{name} cannot be used with a batch, got {value!r}")
    if spec.additional_wrappers:
        names = ", ".join(wrapper.name for wrapper in spec.additional_wrappers)
        raise ConfigError(
            f"additional_wrappers of {spec.id} cannot be put around the sub-environments of a "
            f"batch ({names}); use stable_baselines3's make_vec_env"
        )
    arguments.setdefault("max_episode_steps", spec.max_episode_steps)
    batch = DrmSB3VecEnv(count, step_context=step_context, **arguments)
    spec = copy.copy(spec)
    spec.kwargs = {name: value for name, value in arguments.items() if name not in OF_BATCH}
    batch.batch.spec = spec
    venv: VecEnv = batch
    if monitor:
        venv = VecMonitor(venv)
    if seed is not None:
        venv.seed(operator.index(seed))
        venv.action_space.seed(operator.index(seed))
    return venv


def native_batch(venv: VecEnv) -> VecEnv:
    """One native batch in the place of a ``VecEnv`` of single environments.

    For programs that make their environments one by one, such as RL Baselines3 Zoo: there, as
    ``vec_env_wrapper: drm_env.sb3.native_batch`` in a hyperparameter file. The batch has the ids,
    options, seeds and step limit of the environments that it replaces and flies the same episodes,
    to the bit. What ``Monitor`` was to record, a ``VecMonitor`` records in the first one's file.

    Parameters
    ----------
    venv : VecEnv
        Made of environments of this package that all have the same options, with no wrappers but
        those of ``gym.make`` and ``Monitor``. It is closed.

    Returns
    -------
    venv : VecEnv
        A `DrmSB3VecEnv` within a ``VecMonitor``.

    Raises
    ------
    ConfigError
        Other environments, different ones, or wrappers that a batch cannot have; ``venv`` is as it
        was.

    Examples
    --------
    >>> from stable_baselines3.common.env_util import make_vec_env
    >>> from drm_env.sb3 import native_batch
    >>> venv = native_batch(make_vec_env("drm_env/Slew-v0", n_envs=4, seed=0))
    >>> venv.reset().shape == (4, *venv.observation_space.shape)
    True
    """
    specs = [copy.deepcopy(spec) for spec in venv.get_attr("spec")]
    for spec in specs:
        if spec is not None:
            spec.additional_wrappers = tuple(
                wrapper for wrapper in spec.additional_wrappers if wrapper.name != "Monitor"
            )
    first = specs[0]
    for index, spec in enumerate(specs):
        if spec != first:
            raise ConfigError(
                f"environments of one batch have the same options; {index} has {spec}, "
                f"0 has {first}"
            )
    if first is None:
        raise ConfigError("the environments of venv have no specification: make them by gym.make")
    batch = make_sb3_vec(first, n_envs=venv.num_envs, monitor=False)
    batch._seeds, batch._options = list(venv._seeds), list(venv._options)
    files: list[Path] = []
    if any(venv.env_is_wrapped(Monitor)):
        files = [
            Path(writer.file_handler.name)
            for writer in venv.get_attr("results_writer")
            if writer is not None
        ]
    venv.close()
    for path in files[1:]:
        path.unlink()  # of the others, with a heading and nothing else
    return VecMonitor(batch, filename=str(files[0]) if files else None)
