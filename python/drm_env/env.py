"""The environment as Gymnasium wants it."""

from __future__ import annotations

import copy
import json
import operator
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from drm_env import _engine, _html
from drm_env._arguments import OptionsAreNoAttributes, convert_action, refuse_option
from drm_env._closed_engine import ClosedEngine
from drm_env._infos import CONTEXT_KEYS, REPORT_KEYS, context_info
from drm_env._seeding import seed_bytes
from drm_env._spaces import ObservationEntry
from drm_env._spec import METADATA, json_spec, own_metadata
from drm_env.configuration import ConfigLike, flat_options, resolve_options
from drm_env.errors import ConfigError
from drm_env.missions import LegRecord, leg_records, mission_keys
from drm_env.pictures import Look, Pictures
from drm_env.resolved import ResolvedConfig

if TYPE_CHECKING:
    from typing import Unpack

    from drm_env._config import EnvConfig
    from drm_env._options import Options, Parameters
    from drm_env.rendering import Viewer

__all__ = ["DrmEnv"]

_FLOAT32 = np.dtype(np.float32)


class DrmEnv(OptionsAreNoAttributes, gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A slewing, extending, flexible arm with two small reaction wheels, in closed loop.

    Link 1 turns about a shoulder while link 2 slides out of it (or in) along a prescribed
    profile; both bend, and a payload is fixed to the tip. An open-loop torque of the slew motor,
    computed for the payload *as reported*, moves the rigid arm along the reference exactly if the
    report is true. The agent drives the reaction wheels at the shoulder and at the tip (in some
    tasks the slew motor too) against what is left: vibration, and a slew error that grows with the
    error of the reported mass.

    Units are SI and radians throughout.

    Action space
    ------------
    ``Box(-1, 1, (k,), float32)``, held for one control period. Values beyond the box are clipped,
    since the exploration noise of many libraries exceeds it.

    ===  ==============  ===========================================  =====================
    no.  actuator        action 1 is                                  in task
    ===  ==============  ===========================================  =====================
    0    ``root_wheel``  +100 N m (``root_torque_limit``)             all
    1    ``tip_wheel``   +10 N m (``tip_torque_limit``)               all
    2    ``slew_motor``  +5000 N m (``slew_motor_torque_limit``)      ``"slew_direct"``
    ===  ==============  ===========================================  =====================

    With an inner law (``"slew_residual"``) the wheels' torques are added to the law's, before
    saturation.

    Observation space
    -----------------
    ``Box(-100, 100, (n,), float32)``: each entry is its value divided by the scale below, of order
    one in normal operation and clipped at 100. `observation_layout` lists the entries of an
    environment in order. A *fine* entry is asinh(x / x0), which resolves errors over four decades;
    x0 is 1e-5 (rad, rad/s, m) and 1e-4 m/s.

    =====================================================  =========  ============
    entry                                                  unit       scale
    =====================================================  =========  ============
    ``slew_error`` (from the reference), ``.._fine``       rad        0.1, 9.9
    ``slew_error_rate``, ``.._fine``                       rad/s      0.02, 8.3
    ``slew_angle``, ``slew_rate``                          rad, ./s   1, 0.2
    ``link2_deflection`` (of link 2's tip), ``.._fine``    m          0.05, 9.2
    ``link2_deflection_rate``, ``.._fine``                 m/s        0.5, 9.2
    ``reference_angle``, ``.._rate``, ``.._accel``         rad, ...   1, 0.2, 0.02
    ``extension``, ``.._rate``, ``.._accel``               m, ...     8, 1, 0.2
    ``time_left`` (in the slew)                            s          20
    ``payload_mass``, ``.._length``, ``.._width``          kg, m, m   500, 2, 1
    ``slew_torque``, ``root_torque``, ``tip_torque``       N m        2000, 100, 10
    ``root_momentum``, ``tip_momentum`` (stored)           N m s      500, 50
    ``identified_mass_error`` (``observe_identified``)     1          0.1
    ``tip_error``, ``.._fine`` (``observe_tip_error``)     m          0.05, 2
    ``still_tip_error``, ``.._fine`` (``.._still_..``)     m          0.01, 3
    ``estimated_mass_error`` (``.._payload_estimate``)     1          0.1
    ``mean_tip_rate``, ``.._fine``, (with it)              m/s        0.05, 2
    ``missing_torque`` (with it)                           N m        100
    ``reference_accel+0.1s``, ``extension+0.1s``, ...      rad/s^2,m  0.02, 8
    ``link1_moment``, ``link2_moment`` (strain gauges)     N m        2000, 1000
    ``tip_acceleration`` (across link 2, accelerometer)    m/s^2      1
    ``tip_turn_rate`` (gyro at the tip wheel)              rad/s      0.2
    =====================================================  =========  ============

    The first four rows are measured, with the sensors' noise, bias, resolution and delay; the rest
    is known, but for the last three rows, which instruments measure with errors of their own
    (docs/plants.md): ``observe_sensors`` names them, ``"link1_gauge"``, ``"link2_gauge"``,
    ``"tip_accelerometer"`` and ``"tip_gyro"``, and they come in its order. The payload is the
    reported one unless ``observe_payload`` says otherwise. The row before them previews each of
    ``preview_times``. ``estimated_mass_error`` is a running estimate that vibration does not
    disturb. By it ``mean_tip_rate`` is the rate of the error at the tip as the arm's angular
    momentum has it, and ``missing_torque`` what the payload takes beyond what the motor was told to
    give; it is previewed like the reference. ``tip_error`` is the slew error times the reach (x0 of
    the fine entries is 10 mm and 10 mm/s). ``still_tip_error`` (``observe_still_tip_error``; x0 is
    0.5 mm) adds to it what the reference's acceleration bends of the arm that is believed, with the
    payload of the running estimate: where the tip is but for the vibration. With ``observation_history`` = h > 1 the last h frames
    are stacked, older ones first, their names ending in ``@-1``, ``@-2``, ...

    Reward
    ------
    The sum of three terms, each at most zero and named in the info: ``reward/tip_vibration``,
    ``reward/slew_error`` and ``reward/effort``. The first two grow with the logarithm of the
    errors at the tip, ln(1 + x / 0.1 mm), where x is the amplitude of the tip's vibration and the
    slew error with its rate, each taken to the tip in metres; the third with the squared torque
    fractions. Weights and scales are the option ``reward``. Version 1 of the tasks adds the error
    itself, ``linear`` times x: a logarithm alone pays for a policy that is perfect in half of the
    episodes and twice as bad in the others.

    Start of an episode
    -------------------
    A manoeuvre is drawn: by default (``"slew"``) 50 deg at 0.02 rad/s^2 in minimum time while link
    2 deploys from 1 m to 8 m, with a payload of 50 to 500 kg, reported wrong by up to 15 %. The
    arm starts at rest. ``reset(options={"payload_mass": 320.0})`` fixes parameters for one episode,
    `set_context` until changed; what does not go together is drawn again.

    End of an episode
    -----------------
    *Termination*: the slew error or the tip deflection exceeds ``limits``, or the state leaves what
    the equations describe (a tip deflection of a quarter of the reach, a slew error of one turn,
    finite numbers; the last observation within is then kept, and there are no metrics); the rest of
    the horizon is charged as if the limit were held, so that ending early never pays.
    *Truncation*: the horizon (20 s) is over. Reaching the target does not end the episode.

    With a ``mission`` in the configuration (task ``"mission"``) an episode is a mission: its legs
    are flown one after the other, and the last one ends the episode, which is then *terminated*
    without having diverged. ``slew_angle`` and ``reference_angle`` count from the beginning of
    each leg.

    A step limit (``max_episode_steps`` of ``gym.make``, ``gym.make_vec``, ``gym.register`` or
    `make_sb3_vec`, or a ``TimeLimit`` around the environment) only cuts: it truncates episodes and
    changes nothing else, the charge for ending early included, which stays that of the horizon. A
    limit longer than the horizon does nothing; the specification then has the horizon's steps, with
    a warning. To fly another manoeuvre, give the option ``horizon``.

    Infos
    -----
    The infos of ``reset`` and ``step`` have the same keys, with a finite float64 each (flags are 0
    or 1):

    - ``context/...``: the true parameters of the episode, SI (a name is its position among the
      alternatives).
    - ``reward/...``: the three terms of the reward of this step, 0 at reset.
    - ``metrics/...``: metrics of the episode so far, see `drm_env.episode_metrics`; in the last
      info those of the whole episode. ``metrics/residual_energy`` exists in the last info of an
      episode that was not cut by a step limit.
    - ``diverged``: whether the episode was terminated. ``is_success``: whether the arm has settled,
      tip deflection <= 1 mm and slew error at the tip <= 10 mm in magnitude until now, after the
      slew.

    - of missions alone, ``mission/leg``: the place of the leg under way in the list of legs, and
      ``leg/I/...``: the sums of the reward's terms over leg I. Metrics are those of all legs: means
      over the time, largest values, sums, and the end as that of the last leg.

    Where a number does not exist (a limit that is not set, the settling time of an arm that has not
    settled, the residual vibration before the end of the slew) stands `drm_env.NO_VALUE`, the
    largest float64; `drm_env.info_metrics` makes NaN of it.

    Parameters
    ----------
    task : str
        The defaults: ``"slew"``, ``"slew_residual"``, ``"slew_thesis"`` or ``"slew_direct"``, the
        tasks behind ``drm_env/Slew-v0``, ``SlewResidual-v0``, ``SlewThesis-v0``, ``SlewDirect-v0``;
        ``"slew_v1"`` and ``"slew_residual_v1"`` behind ``drm_env/Slew-v1``, ``SlewResidual-v1``;
        ``"slew_flexible"`` behind ``drm_env/SlewFlexible-v0``; ``"mission"`` behind
        ``drm_env/Mission-v0``.
    config : EnvConfig, ResolvedConfig, mapping or path, optional
        What replaces defaults; a path to a JSON or TOML file.
    render_mode : str, optional
        ``"rgb_array"``, ``"ansi"``, or ``"human"``: a window if pygame is installed, else text in
        the terminal.
    render_width, render_height : int
        Size of pictures, px.
    render_magnification : float, optional
        Factor by which deflections are drawn larger than they are; by default one that follows from
        the manoeuvre and stays through the episode.
    render_title, render_colour : str
        What stands above the arm, and the colour (``"#RRGGBB"``) of link 2, curves and trail.
    **options
        Any of `drm_env.option_names`. Parameters of the manoeuvre take a number (or name), which
        fixes them; a tuple ``(low, high)``, drawn uniformly for each episode; a list of choices;
        or a distribution of `drm_env.distributions`.

    Raises
    ------
    ConfigError
        An unknown name or an impossible value, with its path and the value.

    Notes
    -----
    Version history: v0, the first; v1 of ``Slew`` and ``SlewResidual``: the same manoeuvres with
    reward, observation, action and rate from which plain reinforcement learning makes steady
    progress. v0 stays as it is.

    Examples
    --------
    >>> import drm_env
    >>> env = drm_env.DrmEnv(payload_mass=(50.0, 500.0))
    >>> observation, info = env.reset(seed=1, options={"payload_mass": 320.0})
    >>> float(info["context/payload_mass"])
    320.0
    >>> observation, reward, terminated, truncated, info = env.step([0.5, -0.5])
    >>> reward <= 0.0, terminated, truncated
    (True, False, False)
    """

    metadata = METADATA

    def __init__(
        self,
        *,
        task: str = "slew",
        config: ConfigLike = None,
        render_mode: str | None = None,
        render_width: int = Look.width,
        render_height: int = Look.height,
        render_magnification: float | None = None,
        render_title: str = Look.title,
        render_colour: str = Look.colour,
        **options: Unpack[Options],
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ConfigError(
                f"render_mode must be one of {self.metadata['render_modes']} or None, "
                f"got {render_mode!r}"
            )
        look = Look(render_width, render_height, render_magnification, render_title, render_colour)
        self._resolved = resolve_options(task, config, options)
        self._engine = _engine.Env(self._resolved.held)
        self.render_mode = render_mode
        self._pictures = Pictures(look) if render_mode in ("rgb_array", "human") else None
        self.metadata = own_metadata(self.control_period)
        self.observation_space = self._resolved.observation_space
        self.action_space = self._resolved.action_space
        self._action_shape = (self._engine.action_size,)
        self._horizon_steps = self._engine.horizon_steps
        self._mission_keys = mission_keys(self._resolved.held.mission_legs)
        self._spec: EnvSpec | None = None
        self._seeded = False
        self._info: dict[str, Any] = {}
        self._window: Viewer | None = None

    # -- Gymnasium ---------------------------------------------------------------------------

    @property
    def spec(self) -> EnvSpec | None:
        """The specification this environment was made from, ``None`` if not through ``gym.make``.

        ``max_episode_steps`` is the number of steps in the horizon, or the step limit around the
        environment if that is shorter.
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
            the stream comes from the entropy of the operating system, and ``np_random_seed``
            is its seed.
        options
            parameters of the scenario for this episode alone, by their keyword names,
            such as ``{"payload_mass": 320.0}``; values as for `set_context`.

        Returns
        -------
        observation, info
            The observation, float32 of shape (n,), and the info, with the keys of every step.

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
            # -1 is that of a generator that was put in the place of the environment's own
            drawn = self.np_random_seed
            seed = int(self.np_random.integers(2**63)) if drawn == -1 else drawn
        observation = self._engine.reset(None if seed is None else seed_bytes(seed), text)
        self._seeded = True
        self._take_context()
        if self._pictures is not None:
            self._pictures.follow(self._engine, restart=True)
            if self.render_mode == "human":
                self._viewer().start(self._frame, self._engine.render_ansi)
        return observation, self._info.copy()

    def _take_context(self) -> None:
        """Keeps the info of the beginning, which has a place for every key of the steps' infos."""
        self._info = {
            **context_info(self._engine.context()),
            **dict(zip(REPORT_KEYS, self._engine.report(), strict=True)),
            **dict(zip(self._mission_keys, self._engine.mission_report(), strict=True)),
        }

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
            or not action.flags.c_contiguous
        ):
            action = convert_action(action, self._action_shape)
        observation, reward, terminated, truncated, report = self._engine.step(action)
        info = self._info.copy()
        info.update(zip(REPORT_KEYS, report, strict=True))
        if self._mission_keys:
            info.update(zip(self._mission_keys, self._engine.mission_report(), strict=True))
        if self._pictures is not None:
            self._pictures.follow(self._engine)
            if self.render_mode == "human":
                period = self.control_period
                self._viewer().advance(self._frame, self._engine.render_ansi, period)
        return observation, reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | str | None:
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
            return self._frame()
        if self.render_mode == "ansi":
            return self._engine.render_ansi()
        self._viewer().show(self._frame, self._engine.render_ansi)
        return None

    def _frame(self) -> NDArray[np.uint8]:
        assert self._pictures is not None, "pictures are drawn in their render modes"
        return self._pictures.frame(self._engine)

    def _viewer(self) -> Viewer:
        if self._window is None:
            from drm_env.rendering import Viewer

            self._window = Viewer()
        return self._window

    def set_wrapper_attr(self, name: str, value: Any, *, force: bool = True) -> bool:
        """Sets an attribute, as ``gymnasium.Env`` does; wrappers come here first.

        Raises
        ------
        ConfigError
            an option's name: see `set_context`.
        """
        refuse_option(name)
        return super().set_wrapper_attr(name, value, force=force)

    def close(self) -> None:
        """Lets go of the engine. May be called more than once; any other use is then refused."""
        if self._window is not None:
            self._window.close()
            self._window = None
        self._engine = ClosedEngine()  # type: ignore[assignment]

    # -- What the environment is -------------------------------------------------------------

    def _repr_html_(self) -> str:
        """What Jupyter shows: episode, spaces, what is drawn, and every value."""
        return _html.environment(type(self).__name__, self._resolved)

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

    # -- The episode -------------------------------------------------------------------------

    def set_context(self, **context: Unpack[Parameters]) -> None:
        """Sets parameters of the scenario from the next episode on, until changed.

        Parameters
        ----------
        **context
            values by their keyword names, such as ``payload_mass=320.0``; what an option takes to
            be drawn for each episode (``payload_mass=(50.0, 500.0)``, choices, a distribution), so
            that a curriculum can widen its ranges. They replace those of an earlier call; none at
            all brings back the environment's own.

        Raises
        ------
        ConfigError
            an unknown name or an impossible value or range; the context stays as it was.
        """
        self._engine.set_context(flat_options(context))

    @property
    def context(self) -> dict[str, float]:
        """The true context of the present episode, by the keys of the info; empty without one."""
        return {key: self._info[key] for key in CONTEXT_KEYS} if self._info else {}

    def signals(self) -> dict[str, float]:
        """The present true values by name, SI: the names of `drm_env.simulate`'s arrays.

        Raises
        ------
        ResetNeededError
            before the first ``reset``.
        """
        return dict(self._engine.signals())

    def scenario(self) -> dict[str, Any]:
        """The manoeuvre or mission flown in this episode, as `drm_env.simulate` takes it.

        Raises
        ------
        ResetNeededError
            before the first ``reset``.
        """
        scenario: dict[str, Any] = json.loads(self._engine.scenario_json())
        return scenario

    @property
    def legs(self) -> tuple[LegRecord, ...]:
        """Legs of the mission flown in this episode, and the one under way; none of a manoeuvre.

        Raises
        ------
        ResetNeededError
            before the first ``reset``.
        """
        return leg_records(self._engine.legs())

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
        if self._seeded:
            self._take_context()
            if self._pictures is not None:
                # of what was before the snapshot nothing is known
                self._pictures.follow(self._engine, restart=True)

    def clone(self) -> DrmEnv:
        """An independent environment in the same state."""
        return copy.deepcopy(self)

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the engine, and the engine's state as bytes."""
        state = self.__dict__.copy()
        engine = state.pop("_engine")
        state["_window"] = None
        state["_info"] = {}
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
        engine = ClosedEngine() if snapshot is None else _engine.Env(state["_resolved"].held)
        if snapshot is not None:
            engine.set_state(snapshot)
        self.__dict__.update(state)
        self._engine = engine  # type: ignore[assignment]
        if snapshot is not None:
            self._after_restore()
