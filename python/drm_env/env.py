"""The environment as Gymnasium wants it."""

from __future__ import annotations

import copy
import json
import operator
from functools import cached_property
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from drm_env import _engine
from drm_env._common import (
    RENDER_SIZE,
    REWARD_KEYS,
    ClosedEngine,
    action_box,
    context_info,
    convert_action,
    end_info,
    json_spec,
    seed_bytes,
)
from drm_env.configuration import ConfigLike, config_from_json, flat_options, resolve
from drm_env.errors import ConfigError
from drm_env.observation import ObservationEntry, bounds, layout_of

if TYPE_CHECKING:
    from drm_env._config import EnvConfig
    from drm_env.rendering import Viewer

__all__ = ["DrmEnv"]

_FLOAT32 = np.dtype(np.float32)
_TIP_VIBRATION, _SLEW_ERROR, _EFFORT = REWARD_KEYS


class DrmEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """DOCSTRING_PLACEHOLDER."""

    metadata = {"render_modes": ["human", "rgb_array", "ansi"], "render_fps": 25}  # noqa: RUF012

    def __init__(
        self,
        *,
        task: str = "slew",
        config: ConfigLike = None,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """Makes the environment; see the class for the arguments.

        Raises
        ------
        ConfigError
            an unknown name or an impossible value, with its path and the value.
        """
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ConfigError(
                f"render_mode must be one of {self.metadata['render_modes']} or None, "
                f"got {render_mode!r}"
            )
        self._config_json = resolve(task, config, options)
        self._engine = _engine.Env(self._config_json)
        self.render_mode = render_mode
        low, high = bounds(self.observation_layout)
        self.observation_space = gym.spaces.Box(low, high, dtype=np.float32)
        self.action_space = action_box(self._engine.action_size)
        self._action_shape = (self._engine.action_size,)
        self._horizon_steps = self._engine.horizon_steps
        self._spec: EnvSpec | None = None
        self._seeded = False
        self._context: dict[str, Any] = {}
        self._window: Viewer | None = None

    # -- Gymnasium ---------------------------------------------------------------------------

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """The specification this environment was made from, ``None`` if not through ``gym.make``.

        ``max_episode_steps`` is the number of steps in the horizon.
        """
        return self._spec

    @spec.setter
    def spec(self, value: EnvSpec | None) -> None:
        self._spec = json_spec(value, self._horizon_steps)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts an episode.

        Parameters
        ----------
        seed
            a non-negative integer of any size: the episodes from here on are those of that
            seed. Without one the next episode of the same stream starts; without any ever,
            the stream comes from the entropy of the operating system.
        options
            parameters of the scenario for this episode alone, by their keyword names,
            such as ``{"payload_mass": 320.0}``.

        Returns
        -------
        observation, info
            The observation, float32 of shape (n,), and the true context as ``context/...``.

        Raises
        ------
        ConfigError
            an unknown or impossible option. The running episode goes on.
        """
        if seed is not None:
            seed = operator.index(seed)
        super().reset(seed=seed)
        text = flat_options(options)
        if seed is None and not self._seeded:
            seed = int(self.np_random.integers(2**63))
        observation = self._engine.reset(None if seed is None else seed_bytes(seed), text)
        self._seeded = True
        self._context = context_info(self._engine.context())
        if self.render_mode == "human":
            self._viewer().start(self._engine)
        return observation, self._context.copy()

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Holds an action for one control period.

        Parameters
        ----------
        action
            shape (k,), fractions of the torque limits. Values beyond [-1, 1] are clipped;
            other real dtypes are converted.

        Returns
        -------
        observation, reward, terminated, truncated, info
            Observation, reward, terminated, truncated and info, new objects each time.

        Raises
        ------
        ActionError
            wrong shape, NaN or infinite; `ActionTypeError` if not made of numbers.
        ResetNeededError
            before the first ``reset`` or after the end of an episode.
        EnvironmentClosedError
            after ``close``. In each case nothing has been stepped.
        """
        if (
            type(action) is not np.ndarray
            or action.dtype is not _FLOAT32
            or action.shape != self._action_shape
        ):
            action = convert_action(action, self._action_shape)
        observation, reward, terminated, truncated, terms = self._engine.step(action)
        info = self._context.copy()
        info[_TIP_VIBRATION], info[_SLEW_ERROR], info[_EFFORT] = terms
        if terminated or truncated:
            engine = self._engine
            info.update(end_info(engine.metrics(), engine.diverged(), engine.is_success()))
        if self.render_mode == "human":
            self._viewer().advance(self._engine, self.control_period)
        return observation, reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | str | None:  # type: ignore[override]
        """The present state as a picture.

        Returns
        -------
        frame
            ``"rgb_array"``: uint8 of shape (height, width, 3); ``"ansi"``: text; ``"human"``:
            ``None``, having shown it; without a render mode ``None``, with a warning.

        Raises
        ------
        ResetNeededError
            before the first ``reset``.
        """
        if self.render_mode is None:
            gym.logger.warn(
                "render() needs a render mode; give one when making the environment, such as "
                'gym.make("drm_env/Slew-v0", render_mode="rgb_array")'
            )
            return None
        if self.render_mode == "rgb_array":
            return self._engine.render_rgb(*RENDER_SIZE)
        if self.render_mode == "ansi":
            return self._engine.render_ansi()
        self._viewer().show(self._engine)
        return None

    def _viewer(self) -> Viewer:
        if self._window is None:
            from drm_env.rendering import Viewer

            self._window = Viewer()
        return self._window

    def close(self) -> None:
        """Lets go of the engine. May be called more than once; any other use is then refused."""
        if self._window is not None:
            self._window.close()
            self._window = None
        self._engine = ClosedEngine()  # type: ignore[assignment]

    # -- What the environment is -------------------------------------------------------------

    @cached_property
    def config(self) -> EnvConfig:
        """The complete configuration. Changing a copy of it does not change the environment."""
        return config_from_json(self._config_json)

    @property
    def config_json(self) -> str:
        """The complete configuration as JSON text."""
        return self._config_json

    @cached_property
    def control_period(self) -> float:
        """Duration of one step, s."""
        return float(json.loads(self._config_json)["task"]["control_period"])

    @cached_property
    def observation_layout(self) -> tuple[ObservationEntry, ...]:
        """Name, unit, scale and bounds of each entry of the observation, in order."""
        return layout_of(self._config_json)

    # -- The episode -------------------------------------------------------------------------

    def set_context(self, **context: Any) -> None:
        """Fixes parameters of the scenario from the next episode on, until changed.

        Parameters
        ----------
        **context
            values by their keyword names, such as ``payload_mass=320.0``. They replace
            those of an earlier call; none at all brings back the environment's own.

        Raises
        ------
        ConfigError
            an unknown name or an impossible value; the context stays as it was.
        """
        self._engine.set_context(flat_options(context))

    def signals(self) -> dict[str, float]:
        """The present true values by name, SI: the names of `drm_env.simulate`'s arrays.

        Raises
        ------
        ResetNeededError
            before the first ``reset``.
        """
        return dict(self._engine.signals())

    def scenario(self) -> dict[str, Any]:
        """The manoeuvre flown in this episode, as `drm_env.simulate` takes it.

        Raises
        ------
        ResetNeededError
            before the first ``reset``.
        """
        scenario: dict[str, Any] = json.loads(self._engine.scenario_json())
        return scenario

    # -- Snapshots ---------------------------------------------------------------------------

    def get_state(self) -> bytes:
        """The exact state: physics, random stream, delay lines, filters, context, metrics.

        Continuing from it gives the same bits as continuing the environment itself.
        """
        return self._engine.get_state()

    def set_state(self, state: bytes) -> None:
        """Restores what `get_state` of an environment with the same configuration returned.

        Raises
        ------
        SnapshotError
            damaged, of another format version, or of another configuration;
            nothing has changed.
        """
        self._engine.set_state(state)
        self._after_restore()

    def _after_restore(self) -> None:
        self._seeded = self._engine.has_reset()
        self._context = context_info(self._engine.context()) if self._seeded else {}

    def clone(self) -> DrmEnv:
        """An independent environment in the same state."""
        return copy.deepcopy(self)

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the engine, and the engine's state as bytes."""
        state = self.__dict__.copy()
        engine = state.pop("_engine")
        state["_window"] = None
        state["_snapshot"] = None if isinstance(engine, ClosedEngine) else engine.get_state()
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Rebuilds the engine and restores its state.

        Raises
        ------
        SnapshotError
            the state was written by an incompatible version.
        """
        state = state.copy()
        snapshot = state.pop("_snapshot")
        if snapshot is None:
            engine = ClosedEngine()
        else:
            engine = _engine.Env(state["_config_json"])
            engine.set_state(snapshot)
        self.__dict__.update(state)
        self._engine = engine
