"""Many environments stepped as one batch, as Gymnasium's vector environments."""

from __future__ import annotations

import operator
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from drm_env import _engine, _html
from drm_env._arguments import (
    OptionsAreNoAttributes,
    convert_action,
    count,
    reset_mask,
    sub_env_options,
)
from drm_env._closed_engine import ClosedEngine
from drm_env._contexts import Contexts
from drm_env._infos import (
    CONTEXT_KEYS,
    EPISODE_KEYS,
    REWARD_KEYS,
    Buffers,
    Info,
    Observations,
    episode_rows,
    final_infos,
    masked_info,
    shared_info,
)
from drm_env._seeding import seed_bytes, seed_list
from drm_env._spaces import ObservationEntry, batch_box
from drm_env._spec import json_spec, own_metadata, step_limit
from drm_env.configuration import ConfigLike, flat_options, resolve_options
from drm_env.errors import ConfigError, ResetNeededError
from drm_env.missions import mission_keys
from drm_env.pictures import Look, Pictures
from drm_env.resolved import ResolvedConfig
from drm_env.sub_env import SubEnv

if TYPE_CHECKING:
    from typing import Unpack

    from drm_env._config import EnvConfig
    from drm_env._options import Options, Parameters
    from drm_env.rendering import Viewer

__all__ = ["DrmVectorEnv"]

_FLOAT32, _FLOAT64, _BOOL = np.dtype(np.float32), np.dtype(np.float64), np.dtype(np.bool_)
_MODES = {
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
    AutoresetMode.DISABLED: "disabled",
}

_RENDER_MODES = ["human", "rgb_array", "ansi"]
_RESIDUAL_ENERGY = _engine.metric_names().index("residual_energy")


def _constant(value: float | bool, num_envs: int) -> NDArray[Any]:
    """A read-only array of shape (num_envs,) with the same number everywhere."""
    array = np.full(num_envs, value)
    array.flags.writeable = False
    return array


class DrmVectorEnv(
    OptionsAreNoAttributes, VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]
):
    """A batch of `DrmEnv`, stepped in Rust with the lanes spread over threads.

    Sub-environment i is the single environment with seed + i, bit for bit, for any batch size and
    any number of threads. Autoreset, observations, rewards, flags and infos are those of
    `gymnasium.vector.SyncVectorEnv` around the single environments, but for one thing: what the
    infos say of the episode as a whole (``metrics/...``, ``diverged``, ``is_success``) holds where
    an episode has ended alone. Elsewhere the masks are false, as masks of Gymnasium are where there
    is nothing; the keys are the same in every info.

    Parameters
    ----------
    num_envs
        number of sub-environments.
    max_episode_steps
        step limit, as ``gymnasium.wrappers.TimeLimit`` around each sub-environment: episodes that
        have so many steps are truncated, and nothing else changes. ``None`` and -1: no limit but
        the horizon. One longer than the horizon does nothing but warn.
    render_mode
        ``"rgb_array"`` or ``"ansi"``; ``render`` returns one frame a sub-environment. ``"human"``
        shows them in one window, beside and below each other.
    render_width, render_height, render_magnification, render_title, render_colour
        as for `DrmEnv`; in the mode ``"human"`` and of `render_grid` the size is that of the whole.
    autoreset_mode
        an `AutoresetMode` or its value, ``"NextStep"`` (default), ``"SameStep"`` or
        ``"Disabled"``.
    copy
        with ``False`` the observations, rewards and flags are written into the same arrays
        at every call, which saves their allocation and breaks whatever keeps them (replay
        buffers, ``final`` comparisons, asynchronous consumers) unless it makes its own copy.
    num_threads
        threads of the batch; ``None``: as many as pay off for its size. More than there are
        processors are not made, with a warning.
    task, config, **options
        as for `DrmEnv`.

    The ``context/...`` arrays in the infos and the masks that are true everywhere are read-only
    and shared between calls; they are replaced, not changed, when a sub-environment is reset.

    Examples
    --------
    >>> import numpy as np
    >>> import drm_env
    >>> errors = drm_env.Choices((-0.15, 0.15))
    >>> envs = drm_env.DrmVectorEnv(4, task="slew_residual", mass_error=errors)
    >>> observations, infos = envs.reset(seed=0)
    >>> observations.shape == (4, *envs.single_observation_space.shape)
    True
    >>> observations, rewards, terminated, truncated, infos = envs.step(np.zeros((4, 2)))
    >>> rewards.shape, set(abs(infos["context/mass_error"])) == {0.15}
    ((4,), True)
    """

    metadata: dict[str, Any]

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        render_width: int = Look.width,
        render_height: int = Look.height,
        render_magnification: float | None = None,
        render_title: str = Look.title,
        render_colour: str = Look.colour,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        num_threads: int | None = None,
        task: str = "slew",
        config: ConfigLike = None,
        **options: Unpack[Options],
    ) -> None:
        num_envs = count("num_envs", num_envs)
        if max_episode_steps is not None and max_episode_steps != -1:
            max_episode_steps = count("max_episode_steps", max_episode_steps)
        if num_threads is not None:
            num_threads = count("num_threads", num_threads)
        if render_mode is not None and render_mode not in _RENDER_MODES:
            raise ConfigError(
                f"render_mode of a batch must be one of {_RENDER_MODES} or None, "
                f"got {render_mode!r}"
            )
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            raise ConfigError(
                f"autoreset_mode must be one of {[mode.value for mode in AutoresetMode]}, "
                f"got {autoreset_mode!r}"
            ) from None
        look = Look(render_width, render_height, render_magnification, render_title, render_colour)
        self.num_envs = num_envs
        self.render_mode = render_mode
        drawn = render_mode in ("rgb_array", "human")
        self._pictures = Pictures(look, num_envs) if drawn else None
        self._window: Viewer | None = None
        self.copy = bool(copy)
        self._resolved = resolve_options(task, config, options)
        self.metadata = {
            **own_metadata(self.control_period),
            "render_modes": _RENDER_MODES,
            "autoreset_mode": self.autoreset_mode,
        }
        limit = None if max_episode_steps == -1 else max_episode_steps
        self._arguments = (num_envs, _MODES[self.autoreset_mode], num_threads, limit)
        self._engine = _engine.Batch(self._resolved.held, *self._arguments)
        self._episode_steps = step_limit(limit, self._engine.horizon_steps)
        self._cut = self._episode_steps < self._engine.horizon_steps
        self._observation_size = self._engine.observation_size

        self.single_observation_space = self._resolved.observation_space
        self.single_action_space = self._resolved.action_space
        self.observation_space = batch_box(self.single_observation_space, num_envs)
        self.action_space = batch_box(self.single_action_space, num_envs)
        self._action_shape = (num_envs, self._engine.action_size)
        self._spec: EnvSpec | None = None
        self._seeded = False
        self._buffers = None if self.copy else self._allocate()
        self._episode_seeds: list[int] | None = None
        self._make_templates()

    def _make_templates(self) -> None:
        """What is derived from the rest, and not kept in a pickle."""
        self._everywhere = _constant(True, self.num_envs)
        self._mission_keys = mission_keys(self._resolved.held.mission_legs)
        self._contexts = Contexts(self.num_envs)
        self._ended_contexts = self._contexts
        self._info: Info = {}
        # whether a call of the engine has not come back, which may have changed the contexts
        self._unread = False
        self._envs: list[SubEnv] = []

    def _allocate(self) -> Buffers:
        n = self.num_envs
        return Buffers(
            np.empty((n, self._observation_size), _FLOAT32),
            np.empty(n, _FLOAT64),
            np.empty(n, _BOOL),
            np.empty(n, _BOOL),
            np.empty((n, len(REWARD_KEYS)), _FLOAT64),
        )

    # -- Gymnasium ---------------------------------------------------------------------------

    @property
    def spec(self) -> EnvSpec | None:
        """The specification that ``gym.make_vec`` made this environment from, else ``None``."""
        return self._spec

    @spec.setter
    def spec(self, value: EnvSpec | None) -> None:
        self._spec = json_spec(value, self._episode_steps)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | Sequence[dict[str, Any] | None] | None = None,
    ) -> tuple[Observations, Info]:
        """Starts an episode in each sub-environment, or in those of a mask.

        Parameters
        ----------
        seed
            an integer s, for s + i in sub-environment i, or one seed (or ``None``) each.
        options
            parameters of the scenario for this episode alone, by their keyword names; an
            array of shape (num_envs,) gives each sub-environment its own. The entry
            ``"reset_mask"``, a boolean array of shape (num_envs,), resets only where it holds.
            Or a sequence of num_envs such dictionaries, without masks.

        Returns
        -------
        observations, info
            Observations of all, float32 of shape (num_envs, n), and the infos of those reset.

        Raises
        ------
        ConfigError
            an unknown or impossible option; nothing has been reset.
        ResetNeededError
            a mask before the first full reset.
        """
        seeds = seed_list(seed, self.num_envs)
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=operator.index(seed))
        mask = None
        if isinstance(options, Mapping) and "reset_mask" in options:
            mask = reset_mask(options["reset_mask"], self.num_envs)
            options = {name: value for name, value in options.items() if name != "reset_mask"}
        observations = self._reset(seeds, sub_env_options(options, self.num_envs), mask)
        info = self._info.copy()
        if mask is not None:
            info.update(masked_info(CONTEXT_KEYS, self._contexts.shown, mask))
            for key in REWARD_KEYS:
                info[f"_{key}"] = mask.copy()
        return observations, info

    def reset_envs(
        self, seeds: Sequence[int | None], options: Sequence[Mapping[str, Any]]
    ) -> Observations:
        """`reset` with a seed (or ``None``) and options for each sub-environment, without infos."""
        if len(options) != self.num_envs:
            raise ConfigError(f"options must have {self.num_envs} entries, got {len(options)}")
        return self._reset(
            seed_list(seeds, self.num_envs), [flat_options(item) for item in options], None
        )

    def reset_lanes(
        self, seeds: Sequence[int | None], options: Sequence[Mapping[str, Any]]
    ) -> Observations:
        """The old name of `reset_envs`."""
        warnings.warn("reset_lanes is reset_envs now", DeprecationWarning, stacklevel=2)
        return self.reset_envs(seeds, options)

    def _reset(
        self, seeds: list[int | None], texts: list[str | None], mask: NDArray[np.bool_] | None
    ) -> Observations:
        if mask is not None and not self._seeded:
            raise ResetNeededError("reset_mask needs a reset of every sub-environment before")
        if not self._seeded and None in seeds:
            # -1 is that of a generator that was put in the place of the environment's own
            first = super().np_random_seed
            if first is None or first == -1:
                first = int(self.np_random.integers(2**63))
            seeds = [first + i if value is None else value for i, value in enumerate(seeds)]
        encoded = [None if value is None else seed_bytes(value) for value in seeds]
        buffers = self._buffers or self._allocate()
        unread, self._unread = self._unread, True
        self._engine.reset(encoded, texts, mask, buffers.observations)
        self._seeded = True
        last = self._episode_seeds or [-1] * self.num_envs
        self._episode_seeds = [
            old if new is None or (mask is not None and not mask[index]) else new
            for index, (old, new) in enumerate(zip(last, seeds, strict=True))
        ]
        self._read_context(everywhere=unread or mask is None)
        self._follow(0.0)
        return buffers.observations

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observations, NDArray[Any], NDArray[Any], NDArray[Any], Info]:
        """Holds one action in each sub-environment for one control period.

        Parameters
        ----------
        actions
            shape (num_envs, k), fractions of the torque limits. Values beyond [-1, 1] are
            clipped; other real dtypes are converted.

        Returns
        -------
        observations, rewards, terminated, truncated, info
            Observations (num_envs, n) float32, rewards float64, terminated and truncated bool, each
            of shape (num_envs,), and the infos.

        Raises
        ------
        ActionError
            wrong shape, NaN or infinite; `ActionTypeError` if not made of numbers.
        ResetNeededError
            before the first ``reset``, or without autoreset while an episode is
            over. In each case nothing has been stepped.
        """
        buffers, any_reset, any_done = self.advance(actions)
        if any_reset or any_done:
            info = self._eventful_info(buffers)
        else:
            info = self._info.copy()
            info.update(zip(REWARD_KEYS, buffers.terms.T, strict=True))
        if self._mission_keys:
            info["mission/leg"] = self._engine.legs()
        return (*buffers[:4], info)

    def advance(self, actions: NDArray[np.float32]) -> tuple[Buffers, bool, bool]:
        """`step` without infos, for adapters to other libraries.

        Returns
        -------
        buffers, any_reset, any_done
            Observations, rewards, terminated and truncated; whether any sub-environment has been
            reset, and whether any has ended.
        """
        if (
            type(actions) is not np.ndarray
            or actions.dtype is not _FLOAT32
            or actions.shape != self._action_shape
            or not actions.flags.c_contiguous
        ):
            actions = convert_action(actions, self._action_shape)
        buffers = self._buffers or self._allocate()
        # past __setattr__, which looks every name up among the options
        own = self.__dict__
        unread, own["_unread"] = own["_unread"], True
        any_reset, any_done = self._engine.step(actions, *buffers)
        if unread or any_reset:
            self._read_context(everywhere=unread)
        own["_unread"] = False
        if self._pictures is not None:
            self._follow(self.control_period)
        return buffers, any_reset, any_done

    @property
    def context(self) -> NDArray[np.float64]:
        """The true contexts of the present episodes, shape (parameters, num_envs), read-only."""
        return self._contexts.matrix()

    @property
    def contexts(self) -> Contexts:
        """The true contexts of the present episodes, a row a parameter."""
        return self._contexts

    @property
    def coordinates(self) -> NDArray[np.float64]:
        """The true state of every arm, whatever its sensors say: shape (num_envs, 6).

        Columns are the slew angle (rad), half the deflections of the ends of links 1 and 2 (m), and
        their rates: the coordinates of the thesis plant; of the consistent plant the same
        deflections. For teachers, critics and estimators that may know more than a policy does.
        """
        rows = np.empty((self.num_envs, _engine.COORDINATES))
        self._engine.coordinates(rows)
        return rows

    def ended(
        self,
    ) -> tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
        """Of the sub-environments that ended in the last step, whose rows alone are meaningful.

        Returns
        -------
        observations, metrics, diverged, settled
            Last observations (num_envs, n) in the mode ``"SameStep"``, metrics (num_envs, m),
            whether it diverged and whether it settled (num_envs,).
        """
        engine = self._engine
        metrics = engine.metrics()
        if self._cut:
            # a manoeuvre that was not flown to its end has no energy left at its end
            metrics[~engine.diverged(), _RESIDUAL_ENERGY] = np.nan
        return engine.final_obs(), metrics, engine.diverged(), engine.success()

    def ended_missions(self) -> NDArray[np.float64]:
        """What infos say of the missions that ended in the last step: shape (num_envs, keys).

        Columns are the place of the leg under way and the sums of the reward's terms of each leg
        that takes time; there are none where episodes are manoeuvres.
        """
        return self._engine.mission_reports(len(self._mission_keys))

    def render(self) -> tuple[Any, ...] | None:
        """One frame of each sub-environment, as `DrmEnv.render` returns it.

        In the mode ``"human"`` all are shown in one window, and nothing is returned.
        """
        if self.render_mode is None:
            gym.logger.warn("render() needs a render mode; give one when making the environment")
            return None
        if self.render_mode == "human":
            self._viewer().show(self.render_grid, self._texts)
            return None
        return tuple(env.render() for env in self.envs)

    def render_grid(self, most: int = 16) -> NDArray[np.uint8]:
        """The first sub-environments beside and below each other in one picture.

        Parameters
        ----------
        most
            sub-environments that are shown, at most.

        Returns
        -------
        frame
            uint8 of shape (render_height, render_width, 3).

        Raises
        ------
        ConfigError
            neither the mode ``"rgb_array"`` nor ``"human"``, or no positive number.
        ResetNeededError
            before the first ``reset``.
        """
        most = count("most", most)
        if self._pictures is None:
            raise ConfigError(
                f"render_grid needs render_mode='rgb_array' or 'human', it is {self.render_mode!r}"
            )
        return self._pictures.grid(self._engine, min(most, self.num_envs))

    def frame_of(self, index: int) -> NDArray[np.uint8]:
        """The picture of one sub-environment, for `SubEnv`."""
        assert self._pictures is not None, "pictures are drawn in their render modes"
        return self._pictures.frame(self._engine, index)

    def _texts(self) -> str:
        """The first sub-environment, for terminals."""
        return self._engine.render_ansi(0)

    def _viewer(self) -> Viewer:
        if self._window is None:
            from drm_env.rendering import Viewer

            self._window = Viewer()
        return self._window

    def _follow(self, period: float, *, restart: bool = False) -> None:
        """Lets pictures know of the present instant, ``period`` seconds (0: anew) later."""
        if self._pictures is None:
            return
        self._pictures.follow(self._engine, restart=restart)
        if self.render_mode == "human":
            if period == 0.0:
                self._viewer().start(self.render_grid, self._texts)
            else:
                self._viewer().advance(self.render_grid, self._texts, period)

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002
        """Lets go of the engine. Any further use is refused."""
        if self._window is not None:
            self._window.close()
            self._window = None
        self._engine = ClosedEngine()  # type: ignore[assignment]

    # -- Infos -------------------------------------------------------------------------------

    def _read_context(self, *, everywhere: bool) -> None:
        """Caches the contexts, which change at resets alone, in arrays never written again."""
        self._ended_contexts = self._contexts
        if everywhere:
            self._contexts = self._contexts.read(self._engine)
        else:
            self._contexts = self._contexts.after_resets(self._engine)
        # with a place for every key, so that a step only puts in what is its own
        zeros, nowhere = _constant(0.0, self.num_envs), _constant(False, self.num_envs)
        self._info = {
            **shared_info(CONTEXT_KEYS, self._contexts.shown, self._everywhere),
            **shared_info(REWARD_KEYS, (zeros,) * len(REWARD_KEYS), self._everywhere),
            **shared_info(EPISODE_KEYS, (zeros,) * len(EPISODE_KEYS), nowhere),
        }
        if keys := self._mission_keys:
            self._info |= shared_info(keys[:1], (zeros,), self._everywhere)
            self._info |= shared_info(keys[1:], (zeros,) * (len(keys) - 1), nowhere)
        self._unread = False

    def _eventful_info(self, buffers: Buffers) -> Info:
        """The infos of a step in which episodes ended or began."""
        done = buffers.terminated | buffers.truncated
        info = self._info.copy()
        terms = buffers.terms.T
        if done.any():
            last, metrics, diverged, settled = self.ended()
            ended = masked_info(EPISODE_KEYS, episode_rows(metrics, diverged, settled), done)
            if self._mission_keys:
                ended.update(masked_info(self._mission_keys[1:], self.ended_missions().T[1:], done))
            if self.autoreset_mode is AutoresetMode.SAME_STEP:
                ended.update(masked_info(CONTEXT_KEYS, self._ended_contexts.shown, done))
                ended.update(masked_info(REWARD_KEYS, terms, done))
                info.update(final_infos(last, ended, done))
                # what has begun anew has not been paid yet
                terms = np.where(done, 0.0, terms)
            else:
                info.update(ended)
        info.update(zip(REWARD_KEYS, terms, strict=True))
        return info

    # -- What the environment is -------------------------------------------------------------

    def _repr_html_(self) -> str:
        """What Jupyter shows: episode, spaces, what is drawn, and every value."""
        return _html.environment(
            type(self).__name__, self._resolved, ("sub-environments", str(self.num_envs))
        )

    @property
    def config(self) -> EnvConfig:
        """The complete configuration. Changing a copy of it does not change the environment."""
        return self._resolved.config

    @property
    def config_json(self) -> str:
        """The complete configuration as JSON text."""
        return self._resolved.to_json()

    @property
    def resolved_config(self) -> ResolvedConfig:
        """The complete configuration as a value that others take as ``config=`` unchecked."""
        return self._resolved

    @property
    def control_period(self) -> float:
        """Duration of one step, s."""
        return self._resolved.control_period

    @property
    def observation_layout(self) -> tuple[ObservationEntry, ...]:
        """Name, unit, scale and bounds of each entry of the observation, in order."""
        return self._resolved.observation_layout

    @property
    # a tuple as SyncVectorEnv's, where the base class says int
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each sub-environment's stream of episodes, as of ``SyncVectorEnv``.

        ``reset(seed=...)`` with it begins the streams again, also those that were not seeded by
        the user. -1 where only a snapshot knows.
        """
        if self._episode_seeds is None:
            first = super().np_random_seed
            if first is None or first == -1:
                return (-1,) * self.num_envs
            return tuple(first + index for index in range(self.num_envs))
        return tuple(self._episode_seeds)

    # -- Sub-environments --------------------------------------------------------------------

    @property
    def envs(self) -> list[SubEnv]:
        """Each sub-environment seen alone: snapshot, context, rendering."""
        if not self._envs:
            self._envs = [SubEnv(self, index) for index in range(self.num_envs)]
        return self._envs

    @property
    def lanes(self) -> list[SubEnv]:
        """The old name of `envs`."""
        warnings.warn("lanes is envs now", DeprecationWarning, stacklevel=2)
        return self.envs

    def set_context(self, **context: Unpack[Parameters]) -> None:
        """Sets parameters of the scenario from the next episodes on, until changed.

        Parameters
        ----------
        **context
            values by their keyword names, one for all or an array of shape (num_envs,); ranges,
            choices and distributions as for `DrmEnv.set_context`, drawn by each sub-environment.
            They replace those of an earlier call; none at all brings back the environment's own.
            For a single sub-environment see ``envs[i].set_context``.

        Raises
        ------
        ConfigError
            an unknown name or an impossible value; every context stays as it was.
        """
        self._engine.set_context(sub_env_options(context, self.num_envs))

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """The results of a method (or the values of an attribute) of each sub-environment."""
        found = [getattr(env, name) for env in self.envs]
        return tuple(item(*args, **kwargs) if callable(item) else item for item in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """The values of an attribute of each sub-environment."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Sets an attribute of each sub-environment; a list or tuple gives each its own.

        Raises
        ------
        ValueError
            a list or tuple whose length is not ``num_envs``.
        ConfigError
            an option's name (see `set_context`), or what is the same for the whole batch; nothing
            has been set.
        """
        if not isinstance(values, (list, tuple)):
            values = [values] * self.num_envs
        if len(values) != self.num_envs:
            raise ValueError(f"values must have length {self.num_envs}, got {len(values)}")
        for lane, value in zip(self.envs, values, strict=True):
            setattr(lane, name, value)

    # -- Snapshots ---------------------------------------------------------------------------

    def get_state(self) -> bytes:
        """The exact state of every sub-environment."""
        return self._engine.get_state()

    def set_state(self, state: bytes) -> None:
        """Restores what `get_state` of a batch of the same size and configuration returned.

        Raises
        ------
        SnapshotError
            damaged or foreign; nothing has changed.
        """
        self._engine.set_state(state)
        self._after_restore()

    def _after_restore(self) -> None:
        self._seeded = self._engine.has_reset()
        if self._seeded:
            self._read_context(everywhere=True)
        if self._buffers is not None:
            self._engine.observations(self._buffers.observations)
        if self._seeded and self._pictures is not None:
            # of what was before the snapshot nothing is known
            self._pictures.follow(self._engine, restart=True)

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the engine, and the engine's state as bytes."""
        state = self.__dict__.copy()
        engine = state.pop("_engine")
        state["_window"] = None
        state["_snapshot"] = None if isinstance(engine, ClosedEngine) else engine.get_state()
        for name in ("_envs", "_contexts", "_ended_contexts", "_info", "_everywhere"):
            state.pop(name)
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
        self.__dict__.update(state)
        self._make_templates()
        if snapshot is None:
            self._engine = ClosedEngine()  # type: ignore[assignment]
        else:
            self._engine = _engine.Batch(self._resolved.held, *self._arguments)
            self.set_state(snapshot)
