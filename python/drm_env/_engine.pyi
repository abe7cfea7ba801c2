"""
The engine of drm_env: everything that computes.
"""

from typing import Any, Final, SupportsFloat, SupportsIndex, final

from _typeshed import SupportsGetItem, SupportsLenAndGetItem
from numpy import bool_, float32, float64, uint8
from numpy.typing import NDArray

__all__ = [
    "COORDINATES",
    "LARGEST_IDENTIFIED_ERROR",
    "LAW_MEMORY",
    "LAW_PERIOD",
    "LINK_END_DEFLECTION",
    "SCHEDULED_EXTENSION_SCALE",
    "SCHEDULED_MASS_SCALE",
    "SLOWEST_IDENTIFICATION",
    "Batch",
    "Config",
    "Env",
    "Film",
    "Law",
    "Model",
    "Network",
    "Painter",
    "__version__",
    "batch_benchmark",
    "check_memory",
    "context_names",
    "distribution_names",
    "env_benchmark",
    "film_signals",
    "fine_scales",
    "instructions",
    "kernel_benchmark",
    "law_names",
    "load",
    "load_names",
    "measured_names",
    "measurement_names",
    "metric_names",
    "option_names_json",
    "palette",
    "panic_after_parts",
    "payload_inertias",
    "prescribed",
    "reward_names",
    "rollout",
    "rollout_asked",
    "sample_scenarios",
    "schema_json",
    "signal_names",
    "simulate",
    "table_2_7",
    "task_names",
    "transitions",
]

COORDINATES: Final[int]
"""
Columns of the coordinates of a batch.
"""

LARGEST_IDENTIFIED_ERROR: Final[float]
"""
Largest mass error that is taken for one.
"""

LAW_MEMORY: Final[int]
"""
Numbers that a law remembers.
"""

LAW_PERIOD: Final[float]
"""
Sampling period that the thesis' gains were chosen for, s.
"""

LINK_END_DEFLECTION: Final[float]
"""
Deflection of a link's end per unit of its coordinate.
"""

SCHEDULED_EXTENSION_SCALE: Final[float]
"""
Extension that the scheduled law divides by, m.
"""

SCHEDULED_MASS_SCALE: Final[float]
"""
Mass that the scheduled law divides by, kg.
"""

SLOWEST_IDENTIFICATION: Final[float]
"""
Slew rate below which a payload is not identified, rad/s.
"""

__version__: Final[str]

@final
class Batch:
    """
    Many environments; see `DrmVectorEnv` in the Python package.
    """
    def __new__(
        cls,
        /,
        config: Config,
        num_envs: SupportsIndex,
        autoreset: str,
        num_threads: SupportsIndex | None,
        max_steps: SupportsIndex | None,
    ) -> Batch: ...
    @property
    def action_size(self, /) -> int:
        """
        Entries of one action.
        """
    def began_contexts(self, /) -> tuple[list[int], NDArray[float64]]:
        """
        Environments that began an episode in the last call, and their true contexts in columns.
        """
    def contexts(self, /, out: NDArray[float64]) -> None:
        """
        Writes every true context into columns, one an environment, in the order of `context_names`.
        """
    def coordinates(self, /, out: NDArray[float64]) -> None:
        """
        Writes the true coordinates and rates, a row an environment.
        """
    def diverged(self, /) -> NDArray[bool_]:
        """
        Whether the episodes that ended in the last step diverged.
        """
    def env_state(self, /, index: SupportsIndex) -> bytes:
        """
        The state of one environment, as `Env.get_state` returns it.
        """
    def final_obs(self, /) -> NDArray[float32]:
        """
        Last observation of the episodes that ended in the last step; zeros elsewhere.
        """
    def get_state(self, /) -> bytes:
        """
        Everything that changes, as bytes.
        """
    def has_reset(self, /) -> bool:
        """
        Whether every environment has had an episode.
        """
    @property
    def horizon_steps(self, /) -> int:
        """
        Actions in an episode that is not cut short.
        """
    def legs(self, /) -> NDArray[float64]:
        """
        Place of the mission's leg under way in each environment; zeros where episodes are manoeuvres.
        """
    def metrics(self, /) -> NDArray[float64]:
        """
        Metrics of the episodes that ended in the last step; zeros elsewhere.
        """
    def mission_reports(self, /, size: SupportsIndex) -> NDArray[float64]:
        """
        `Env.mission_report` of the episodes that ended in the last step, a row an environment of so many
        entries; zeros elsewhere.
        """
    @property
    def observation_size(self, /) -> int:
        """
        Entries of one observation.
        """
    def observations(self, /, out: NDArray[float32]) -> None:
        """
        Writes every present observation.
        """
    def render_ansi(self, /, index: SupportsIndex) -> str:
        """
        A picture of one environment as text.
        """
    def reset(
        self,
        /,
        seeds: SupportsGetItem[int, bytes | bytearray | None],
        options: SupportsGetItem[int, str | None],
        mask: NDArray[bool_] | None,
        observations: NDArray[float32],
    ) -> None:
        """
        Begins episodes everywhere or where the mask holds, with seeds as little-endian bytes and
        flat parameters as JSON text; writes every observation.
        """
    def reset_happened(self, /) -> NDArray[bool_]:
        """
        Whether each environment began an episode in the last call.
        """
    def set_context(self, /, options: SupportsGetItem[int, str | None]) -> None:
        """
        Flat scenario parameters of every later episode, as JSON text each, until called again.
        """
    def set_env_context(self, /, index: SupportsIndex, options: str | None) -> None:
        """
        The same for one environment.
        """
    def set_env_state(self, /, index: SupportsIndex, state: bytes) -> None:
        """
        Restores one environment.
        """
    def set_state(self, /, state: bytes) -> None:
        """
        Restores what `get_state` returned.
        """
    def signals(self, /, index: SupportsIndex) -> list[tuple[str, float]]:
        """
        Names and present values of the signals of one environment.
        """
    def step(
        self,
        /,
        actions: NDArray[float32],
        observations: NDArray[float32],
        rewards: NDArray[float64],
        terminated: NDArray[bool_],
        truncated: NDArray[bool_],
        terms: NDArray[float64],
    ) -> tuple[bool, bool]:
        """
        One control period everywhere, written into the arrays; whether any environment has begun
        an episode and whether any has ended one.
        """
    def success(self, /) -> NDArray[bool_]:
        """
        Whether the arm settled in the episodes that ended in the last step.
        """

@final
class Config:
    """
    A complete configuration that has been checked; it never changes.
    """
    def __new__(cls, /, task: str, config: str | None, options: str | None) -> Config:
        """
        A task's defaults, overlaid with parts of a configuration and then with flat options, both as
        JSON text.
        """
    @property
    def action_size(self, /) -> int:
        """
        Entries of an action.
        """
    def context(self, /) -> list[float]:
        """
        Parameters of the manoeuvre as far as it is not drawn, in the order of `context_names`.
        """
    @property
    def control_period(self, /) -> float:
        """
        Time between two actions, s.
        """
    @property
    def drawn(self, /) -> list[str]:
        """
        Flat names of the parameters that are drawn for each episode.
        """
    @property
    def horizon(self, /) -> float:
        """
        Duration of an episode that is not cut short, s.
        """
    @property
    def horizon_steps(self, /) -> int:
        """
        Actions in an episode that is not cut short.
        """
    def identification_slopes(self, /, seen: NDArray[float64]) -> NDArray[float64]:
        """
        Derivatives of the identified mass error by slew rate and by the momentum of either wheel, a row an
        observation; `seen` has the columns error, slew rate, extension, payload mass, length and width.
        """
    @property
    def mission_legs(self, /) -> list[int]:
        """
        Places in the mission's list of the legs that take time; none where episodes are manoeuvres.
        """
    def observation_layout(self, /) -> list[tuple[str, str, float, float, float]]:
        """
        Name, unit, scale, lower and upper bound of each entry of the observation, in order.
        """
    @property
    def sample_period(self, /) -> float:
        """
        Period of laws, sensors and metrics, s.
        """
    def to_json(self, /) -> str:
        """
        JSON text with every field.
        """

@final
class Env:
    """
    One environment; see the class of the same name in the Python package.
    """
    def __new__(cls, /, config: Config) -> Env: ...
    @property
    def action_size(self, /) -> int:
        """
        Entries of an action.
        """
    def context(self, /) -> NDArray[float64]:
        """
        The true context of the episode, in the order of `context_names`.
        """
    def get_state(self, /) -> bytes:
        """
        Everything that changes, as bytes.
        """
    def has_reset(self, /) -> bool:
        """
        Whether there has been an episode at all.
        """
    @property
    def horizon_steps(self, /) -> int:
        """
        Actions in an episode that is not cut short.
        """
    def legs(
        self, /
    ) -> list[tuple[int, str, float, float, float, tuple[float, float], list[float], list[float]]]:
        """
        Legs of the mission flown in this episode, and the one under way.
        """
    def mission_report(self, /) -> NDArray[float64]:
        """
        Place of the mission's leg under way, and three sums of the reward's terms of every leg that takes
        time; empty where episodes are manoeuvres.
        """
    @property
    def observation_size(self, /) -> int:
        """
        Entries of an observation.
        """
    def render_ansi(self, /) -> str:
        """
        A picture as text.
        """
    def report(self, /) -> NDArray[float64]:
        """
        The last reward's terms, the metrics of the episode so far, whether it diverged and whether
        the arm has settled; the largest double where a number does not exist.
        """
    def reset(self, /, seed: bytes | None, options: str | None) -> NDArray[float32]:
        """
        Begins an episode: the first of a seed (little-endian bytes), or the next one.
        """
    def scenario_json(self, /) -> str:
        """
        The manoeuvre of this episode as JSON text.
        """
    def set_context(self, /, options: str | None) -> None:
        """
        Flat scenario parameters of every later episode, until called again.
        """
    def set_state(self, /, state: bytes) -> None:
        """
        Restores what `get_state` returned.
        """
    def signals(self, /) -> list[tuple[str, float]]:
        """
        Names and present values of the signals.
        """
    def step(
        self, /, action: NDArray[float32]
    ) -> tuple[NDArray[float32], float, bool, bool, NDArray[float64]]:
        """
        One control period: observation, reward, terminated, truncated and the report.
        """
    def steps(self, /) -> int:
        """
        Actions taken in this episode.
        """

@final
class Film:
    """
    A flight that has been flown, to be drawn at any instant.
    """
    def __new__(
        cls,
        /,
        scenario: str | Config,
        signals: NDArray[float64],
        diverged: bool,
        factor: SupportsFloat | SupportsIndex | None,
    ) -> Film:
        """
        Of a manoeuvre and the signals of its flight, an instant a row, in the order of
        `film_signals`.
        """
    def frame(
        self,
        /,
        time: SupportsFloat | SupportsIndex,
        size: tuple[SupportsIndex, SupportsIndex],
        title: str,
        colour: SupportsLenAndGetItem[SupportsIndex],
    ) -> NDArray[uint8]:
        """
        The picture at a time (s), (height, width, 3).
        """
    @property
    def magnification(self, /) -> float:
        """
        Factor by which deflections are drawn larger.
        """
    def ranges(self, /) -> list[list[float]]:
        """
        Smallest and largest tip error (m), tip deflection (m) and slew angle (rad) of the flight.
        """
    def widen(
        self, /, ranges: SupportsLenAndGetItem[SupportsLenAndGetItem[SupportsFloat | SupportsIndex]]
    ) -> None:
        """
        Lets curves and camera hold the ranges of another flight too.
        """

@final
class Law:
    """
    A control law flown once a control period.
    """
    def __new__(cls, /, law: str, config: Config) -> Law: ...
    @property
    def control_period(self, /) -> float:
        """
        Time between two calls, s.
        """
    @property
    def needs_tip_rate(self, /) -> bool:
        """
        Whether it feeds back what the gyro at the tip wheel measures, which no observation holds.
        """
    @property
    def torque_limits(self, /) -> tuple[float, float]:
        """
        Torque limits of root and tip wheel, N m.
        """
    def torques(
        self, /, measurements: NDArray[float64], state: NDArray[float64], start: NDArray[bool_]
    ) -> tuple[NDArray[float64], NDArray[float64]]:
        """
        Torques of root and tip wheel, N m, and the new memory, a row for each of the laws.
        """

@final
class Model:
    """
    The arm with one payload.
    """
    def __new__(cls, /, spec: str) -> Model: ...
    def acceleration(
        self,
        /,
        q: NDArray[float64],
        q_rate: NDArray[float64],
        at: tuple[
            SupportsFloat | SupportsIndex,
            SupportsFloat | SupportsIndex,
            SupportsFloat | SupportsIndex,
        ],
        torques: tuple[
            SupportsFloat | SupportsIndex,
            SupportsFloat | SupportsIndex,
            SupportsFloat | SupportsIndex,
        ],
    ) -> NDArray[float64]:
        """
        q'' at an extension (length, rate, acceleration) under (slew, root, tip) torques.
        """
    def angular_momentum(
        self,
        /,
        q: NDArray[float64],
        q_rate: NDArray[float64],
        length: SupportsFloat | SupportsIndex,
        rate: SupportsFloat | SupportsIndex,
    ) -> float:
        """
        Angular momentum about the shoulder.
        """
    def energy(
        self,
        /,
        q: NDArray[float64],
        q_rate: NDArray[float64],
        length: SupportsFloat | SupportsIndex,
        rate: SupportsFloat | SupportsIndex,
    ) -> tuple[float, float, float]:
        """
        Kinetic, potential and total energy.
        """
    def linearize(
        self,
        /,
        length: SupportsFloat | SupportsIndex,
        rate: SupportsFloat | SupportsIndex,
        accel: SupportsFloat | SupportsIndex,
        slew_rate: SupportsFloat | SupportsIndex,
    ) -> tuple[
        tuple[NDArray[float64], NDArray[float64], NDArray[float64]],
        tuple[list[str], list[str], list[str]],
    ]:
        """
        A, B and C about the undeflected arm; names of states, inputs and outputs.
        """
    def matrices(
        self,
        /,
        length: SupportsFloat | SupportsIndex,
        rate: SupportsFloat | SupportsIndex,
        accel: SupportsFloat | SupportsIndex,
        slew_rate: SupportsFloat | SupportsIndex,
    ) -> tuple[NDArray[float64], NDArray[float64], NDArray[float64]]:
        """
        M, C and K at an extension, its rate and acceleration, and a slew rate.
        """
    def mode_shapes(
        self, /, length: SupportsFloat | SupportsIndex, count: SupportsIndex | None
    ) -> tuple[NDArray[float64], NDArray[float64], NDArray[float64]]:
        """
        Distances from the shoulder, displacements (a mode a row), angular frequencies (rad/s).
        """
    def natural_frequencies(
        self, /, length: SupportsFloat | SupportsIndex, count: SupportsIndex | None
    ) -> NDArray[float64]:
        """
        Elastic angular frequencies, rising, rad/s.
        """
    def spatial_modes(
        self, /, length: SupportsFloat | SupportsIndex, count: SupportsIndex | None
    ) -> tuple[
        NDArray[float64],
        list[str],
        NDArray[float64],
        NDArray[float64],
        tuple[NDArray[float64], NDArray[float64], NDArray[float64]],
    ]:
        """
        Angular frequencies, kinds, energy shares of bending in the plane, out of it and torsion,
        positions, and displacements in the plane, out of it and twists, a mode a row.
        """

@final
class Network:
    """
    A multilayer perceptron; see the class of the same name in the Python package.
    """
    def __new__(
        cls,
        /,
        layers: SupportsGetItem[int, tuple[NDArray[float32], NDArray[float32]]],
        activation: str,
        output: str,
    ) -> Network:
        """
        Layers as weights (outputs, inputs) and biases (outputs,).
        """
    def act(self, /, observations: NDArray[float32]) -> NDArray[float32]:
        """
        Actions of observations, a row each: those of a rollout to the bit.
        """
    @property
    def inputs(self, /) -> int:
        """
        Entries of an observation.
        """
    @property
    def outputs(self, /) -> int:
        """
        Entries of an action.
        """

@final
class Painter:
    """
    Follows environments and draws them; what it remembers is no part of their state.
    """
    def __new__(
        cls,
        /,
        count: SupportsIndex,
        magnification: SupportsFloat | SupportsIndex | None,
        title: str,
        colour: SupportsLenAndGetItem[SupportsIndex],
    ) -> Painter:
        """
        For `count` environments.
        """
    def follow(self, /, env: Env, restart: bool) -> None:
        """
        Takes the present instant of an environment; `restart` forgets what was before.
        """
    def follow_batch(self, /, batch: Batch, restart: bool) -> None:
        """
        The same of every environment of a batch.
        """
    def frame(self, /, env: Env, width: SupportsIndex, height: SupportsIndex) -> NDArray[uint8]:
        """
        A picture of an environment, (height, width, 3).
        """
    def frame_of(
        self, /, batch: Batch, index: SupportsIndex, width: SupportsIndex, height: SupportsIndex
    ) -> NDArray[uint8]:
        """
        A picture of one environment of a batch, (height, width, 3).
        """
    def grid(
        self, /, batch: Batch, count: SupportsIndex, width: SupportsIndex, height: SupportsIndex
    ) -> NDArray[uint8]:
        """
        A picture of the first `count` environments of a batch beside and below each other,
        (height, width, 3).
        """

def batch_benchmark(
    config: Config, num_envs: SupportsIndex, steps: SupportsIndex, num_threads: SupportsIndex | None
) -> float:
    """
    Seconds that a batch takes for `steps` control periods, automatic resets included.
    """

def check_memory(name: str, count: SupportsIndex, each: SupportsIndex, less: str) -> None:
    """
    Refuses a number of things, `each` so many bytes, that does not fit into memory; `less` is what takes
    less.
    """

def context_names() -> list[str]:
    """
    Flat names of the scenario's parameters, in the order of every context.
    """

def distribution_names() -> list[str]:
    """
    Names of the distributions in their data form.
    """

def env_benchmark(config: Config, steps: SupportsIndex) -> float:
    """
    Seconds that a single environment takes for `steps` control periods, resets included.
    """

def film_signals() -> list[str]:
    """
    Names of the signals that a film needs, in order.
    """

def fine_scales() -> list[tuple[str, float]]:
    """
    x0 of the compressed entries `..._fine` of an observation, asinh(x / x0), by the name of x, in its
    unit.
    """

def instructions() -> tuple[str, list[int]]:
    """
    The instructions that the engine has found on this processor, and the widths of its packs.
    """

def kernel_benchmark(lanes: SupportsIndex, steps: SupportsIndex) -> tuple[float, int]:
    """
    Nanoseconds per Runge-Kutta step of 0.5 ms and environment of the thesis plant along the thesis
    manoeuvre on the calling thread, over at least `steps` steps, and the lanes that were side by side:
    1 is the way of a single environment, 0 the widest that the processor has.
    """

def law_names() -> list[str]:
    """
    Names of the control laws.
    """

def load() -> None:
    """
    Loads what is needed of Python. The package calls it when it is imported: when something is first used,
    a signal may come between, and there is nobody there to raise what its handler raises.
    """

def load_names() -> list[str]:
    """
    Names of the loads, in the engine's order.
    """

def measured_names() -> list[str]:
    """
    Names of what is measured, in the engine's order.
    """

def measurement_names() -> list[str]:
    """
    Names of what a law is told, as in the observation.
    """

def metric_names() -> list[str]:
    """
    Names of the metrics, in the order of every list of them.
    """

def option_names_json() -> str:
    """
    Every flat option as JSON text: name -> path, unit, randomizable, description.
    """

def palette() -> list[tuple[str, bytes]]:
    """
    Red, green and blue of the colours of all pictures, by name.
    """

def panic_after_parts(parts: SupportsIndex) -> None:
    """
    Lets a part of a later call of any batch panic, after so many others; for tests of what is left then.
    """

def payload_inertias() -> list[str]:
    """
    Names of the moments of inertia of a payload; a context holds the position.
    """

def prescribed(
    scenario: str | Config, times: NDArray[float64]
) -> tuple[float, float, list[float], NDArray[float64]]:
    """
    What a manoeuvre prescribes: final time of the slew (s), its largest acceleration (rad/s^2), the
    instants at which an acceleration changes its formula (s), and for each of the times (s) a row with
    angle, rate and acceleration of the reference and length, rate and acceleration of the extension.
    """

def reward_names() -> list[str]:
    """
    Names of the reward's terms, as they stand in an info.
    """

def rollout(
    scenarios: SupportsGetItem[int, str | Config],
    pilot: tuple[
        str | None, tuple[Network, Config] | None, tuple[NDArray[float64], SupportsIndex] | None
    ],
    seeds: SupportsGetItem[int, bytes | bytearray],
    num_threads: SupportsIndex | None,
    progress: Any | None,
    signals: SupportsGetItem[int, str] | None,
    every: SupportsIndex,
    loads: bool = False,
) -> tuple[
    tuple[
        NDArray[float64],
        list[tuple[str, NDArray[float64]]],
        tuple[NDArray[float64], NDArray[float64]] | None,
    ],
    list[list[tuple[int, str, float, float, float, tuple[float, float], list[float], list[float]]]],
]:
    """
    Flies many manoeuvres under a law (as JSON text), by a network in the task of a configuration, or
    under torques (N m; each row, of root and tip wheel, is held for so many samples): metrics, a row a manoeuvre, for each signal its values, a row a manoeuvre, every
    `every`-th sample, with `loads` their peaks and root mean squares, a row a manoeuvre each, and the legs of each mission. `progress(flown, all)` is called now and then; what it raises ends the work
    and is raised here.
    """

def rollout_asked(
    scenarios: SupportsGetItem[int, str | Config],
    law: Any,
    period: SupportsFloat | SupportsIndex | None,
    seeds: SupportsGetItem[int, bytes | bytearray],
    progress: Any | None,
    signals: SupportsGetItem[int, str] | None,
    every: SupportsIndex,
    loads: bool,
) -> tuple[
    tuple[
        NDArray[float64],
        list[tuple[str, NDArray[float64]]],
        tuple[NDArray[float64], NDArray[float64]] | None,
    ],
    list[list[tuple[int, str, float, float, float, tuple[float, float], list[float], list[float]]]],
]:
    """
    Flies many manoeuvres or missions under a law that is called every `period` (s; without: every sample) with what it is
    told of all of them, a row a manoeuvre, and returns torques of root and tip wheel (N m), a row a manoeuvre.
    What it or `progress` raises ends the work and is raised here. The rest as `rollout`.
    """

def sample_scenarios(config: Config, seeds: SupportsGetItem[int, bytes | bytearray]) -> str:
    """
    The manoeuvres that environments fly in the first episode of each seed, as a JSON list.
    """

def schema_json() -> str:
    """
    The JSON schema of a configuration.
    """

def signal_names() -> list[str]:
    """
    Names of the signals of a trajectory.
    """

def simulate(
    scenario: str | Config,
    law: str,
    every: SupportsIndex,
    seed: bytes,
    loads: bool = False,
    sensors: bool = False,
) -> tuple[
    list[tuple[str, NDArray[float64]]],
    list[tuple[str, float]],
    tuple[NDArray[float64], NDArray[float64]] | None,
    list[tuple[int, str, float, float, float, tuple[float, float], list[float], list[float]]],
]:
    """
    Flies one manoeuvre under a law: the signals, every `every`-th sample, the metrics, with `loads` these
    among the signals and their peaks and root mean squares, with `sensors` what is measured.
    """

def table_2_7() -> list[tuple[float, float, float]]:
    """
    Mass (kg), length and width (m) of the payloads of Table 2-7, the lightest first, after none.
    """

def task_names() -> list[str]:
    """
    Names of the tasks that have defaults.
    """

def transitions(
    scenario: str | Config, hold: SupportsIndex
) -> tuple[int, int, list[NDArray[float64]]]:
    """
    The discrete linear model of a manoeuvre every `hold` samples: size of the state, number of
    intervals, and flat arrays in the order of the engine's `Transitions`.
    """
