"""Whole closed-loop manoeuvres flown in Rust, without Python in the loop."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env import _engine
from drm_env._common import seed_bytes
from drm_env.configuration import (
    ConfigLike,
    check_names,
    is_sequence,
    known_options,
    resolve_options,
    to_data,
)
from drm_env.errors import ConfigError
from drm_env.network import Network
from drm_env.resolved import ResolvedConfig

if TYPE_CHECKING:
    from typing import Unpack

    from drm_env._config import Scenario
    from drm_env._options import Options

__all__ = [
    "LawLike",
    "Rollout",
    "ScenarioLike",
    "Trajectory",
    "rollout",
    "sample_scenarios",
    "simulate",
]

_SCENARIO_BYTES = 12_000
"""What a scenario takes as a mapping, with its text."""

ScenarioLike = "Scenario | Mapping[str, Any]"
LawLike = str | Mapping[str, Any] | Any


class Trajectory(dict[str, NDArray[np.float64]]):
    """Signals of one manoeuvre by name, each of shape (samples,), SI and radians.

    It is a dictionary, ``time`` first, so that ``pandas.DataFrame(trajectory)`` has a column for
    each signal and a row for each sample.

    Attributes
    ----------
    metrics
        the metrics of the whole manoeuvre by name, floats; see `episode_metrics` for what they are.
    """

    def __init__(
        self, signals: Mapping[str, NDArray[np.float64]], metrics: dict[str, float]
    ) -> None:
        """Holds what the engine returned."""
        super().__init__(signals)
        self.metrics = metrics

    def __missing__(self, name: str) -> NDArray[np.float64]:
        """Refuses a name that no signal has.

        Raises
        ------
        KeyError
            always; the message lists the signals.
        """
        raise KeyError(f"no signal {name!r}; there are {', '.join(self)}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles hold signals and metrics."""
        return type(self), (dict(self), self.metrics)

    def __repr__(self) -> str:
        """Names, duration and number of samples."""
        samples = len(next(iter(self.values()), ()))
        until = f", {self['time'][-1]:g} s" if samples and "time" in self else ""
        return f"Trajectory({samples} samples{until}: {', '.join(self)})"


def scenario_json(scenario: Any, name: str = "scenario") -> str:
    """JSON text of a scenario given as a dict or dataclass (parts left out have their defaults).

    Raises
    ------
    ConfigError
        not a mapping, a value without a JSON form, or a configuration that draws its manoeuvres.
    """
    if isinstance(scenario, ResolvedConfig):
        if scenario.drawn:
            raise ConfigError(
                f"{name} must be one manoeuvre, got a configuration that draws "
                f"{', '.join(scenario.drawn)}; see drm_env.sample_scenarios"
            )
        return json.dumps(scenario.to_dict()["scenario"])
    data = to_data({} if scenario is None else scenario)
    if not isinstance(data, dict):
        raise ConfigError(f"{name} must be a mapping or a Scenario, got {type(scenario).__name__}")
    return json.dumps(data)


def law_json(law: Any) -> str:
    """JSON text of a law given as a name, a dict or a dataclass; ``None`` is the law ``"none"``.

    Raises
    ------
    ConfigError
        anything else.
    """
    data = to_data("none" if law is None else law, "law")
    if not isinstance(data, (str, dict)):
        raise ConfigError(f"law must be a name or a mapping, got {law!r}")
    return json.dumps(data)


def _seeds(seed: Any, n: int) -> list[bytes]:
    """``seed``, ``seed + 1``, ... as bytes, or those of a sequence of ``n`` seeds.

    Raises
    ------
    ConfigError
        Not a non-negative integer, or a sequence of another length.
    """
    if is_sequence(seed):
        if len(seed) != n:
            raise ConfigError(f"seed must be a number or have {n} entries, got {len(seed)}")
        return [one for each in seed for one in _seeds(each, 1)]
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ConfigError(f"seed must be a non-negative integer, got {seed!r}")
    return [seed_bytes(int(seed) + index) for index in range(n)]


def _check_decimation(decimation: Any) -> None:
    if isinstance(decimation, bool) or not isinstance(decimation, int) or decimation < 1:
        raise ConfigError(f"decimation must be a positive integer, got {decimation!r}")


def simulate(
    scenario: Scenario | ResolvedConfig | Mapping[str, Any] | None = None,
    law: LawLike = "none",
    *,
    decimation: int = 1,
    seed: int = 0,
) -> Trajectory:
    """Flies one manoeuvre in closed loop.

    Parameters
    ----------
    scenario
        any part of a scenario; what is left out has its default (the thesis' standard
        manoeuvre). ``None`` is all of it. A `ResolvedConfig` that draws nothing stands for the
        manoeuvre in it.
    law
        a name (``"none"``, ``"linear"``, ``"lyapunov"``) or a mapping of its parameters.
    decimation
        keep every so many samples of the sample period, the first and the last included.
    seed
        of the sensors' noise, if the scenario has any.

    Returns
    -------
    trajectory
        The signals ``time, slew_angle, slew_rate, reference_angle, reference_rate,
        reference_accel, alpha, beta, alpha_rate, beta_rate, tip_deflection,
        link2_tip_deflection, extension, extension_rate, slew_torque, root_torque, tip_torque,
        root_momentum, tip_momentum, motor_power`` and the metrics. A manoeuvre that diverges (a tip
        deflection beyond a quarter of the reach, a slew error beyond one turn, numbers that
        are not finite) ends there: ``metrics["diverged"]`` is 1, and all other metrics but
        ``settled`` (0), ``slew_end_time``, ``duration`` and ``episode_return`` are NaN.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value, with its path and the value.

    Examples
    --------
    >>> import math
    >>> import drm_env
    >>> flight = drm_env.simulate({"mass_error": 0.15, "payload": {"inertia": "slender"}})
    >>> flight["time"].shape == flight["tip_deflection"].shape
    True
    >>> f"{math.degrees(flight.metrics['peak_slew_angle']):.1f}"  # the thesis has 56.21 deg
    '56.2'
    """
    _check_decimation(decimation)
    (first,) = _seeds(seed, 1)
    signals, metrics = _engine.simulate(scenario_json(scenario), law_json(law), decimation, first)
    return Trajectory(dict(signals), dict(metrics))


class Rollout(dict[str, NDArray[np.float64]]):
    """Metrics of many manoeuvres by name, each of shape (n,), in the order of the scenarios.

    It is a dictionary, so that ``pandas.DataFrame(rollout)`` has a column for each metric and a row
    for each manoeuvre; ``pandas.DataFrame(rollout.trajectory(i))`` holds the signals of one.

    Attributes
    ----------
    trajectories
        the signals that were asked for by name, each of shape (n, samples), SI and radians. Rows
        are ``decimation`` sample periods apart and end with the last sample of the manoeuvre; NaN
        follows where one ends before the longest. Empty without ``signals``.
    """

    def __init__(
        self,
        metrics: dict[str, NDArray[np.float64]],
        trajectories: dict[str, NDArray[np.float64]],
    ) -> None:
        """Holds what the engine returned."""
        super().__init__(metrics)
        self.trajectories = trajectories

    def __missing__(self, name: str) -> NDArray[np.float64]:
        """Refuses a name that no metric has.

        Raises
        ------
        KeyError
            always; the message lists the metrics.
        """
        raise KeyError(f"no metric {name!r}; there are {', '.join(self)}")

    def trajectory(self, index: int) -> Trajectory:
        """The kept signals of one manoeuvre, each of shape (samples,), with its metrics.

        Raises
        ------
        IndexError
            no such manoeuvre.
        """
        count = len(next(iter(self.values()), ()))
        if not -count <= index < count:
            raise IndexError(f"index must be below {count}, got {index}")
        rows = {name: values[index] for name, values in self.trajectories.items()}
        flown = [~np.isnan(row) for row in rows.values()]
        samples = max((int(np.flatnonzero(row)[-1]) + 1 for row in flown if row.any()), default=0)
        metrics = {name: float(values[index]) for name, values in self.items()}
        return Trajectory({name: row[:samples] for name, row in rows.items()}, metrics)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles hold metrics and trajectories."""
        return type(self), (dict(self), self.trajectories)

    def __repr__(self) -> str:
        """Number of manoeuvres, and the names of metrics and signals."""
        count = len(next(iter(self.values()), ()))
        signals = f"; signals {', '.join(self.trajectories)}" if self.trajectories else ""
        return f"Rollout({count} manoeuvres: {', '.join(self)}{signals})"


def _schedule(torques: Any, hold: Any, scenarios: int) -> tuple[NDArray[np.float64], int]:
    """Torques as the engine takes them.

    Raises
    ------
    ConfigError
        another shape, no numbers, or a hold that is no positive integer.
    """
    if isinstance(hold, bool) or not isinstance(hold, int) or hold < 1:
        raise ConfigError(f"hold must be a positive integer, got {hold!r}")
    try:
        array = np.ascontiguousarray(torques, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"torques must be an array of numbers: {error}") from error
    if array.ndim != 3 or array.shape[0] != scenarios or array.shape[2] != 2:
        raise ConfigError(f"torques must have shape ({scenarios}, rows, 2), got {array.shape}")
    return array, hold


def _pilot(
    law: LawLike | None,
    policy: Network | None,
    schedule: tuple[NDArray[np.float64], int] | None,
    task: str | None,
    config: ConfigLike,
    options: Mapping[str, Any],
) -> tuple[
    str | None,
    tuple[_engine.Network, _engine.Config] | None,
    tuple[NDArray[np.float64], int] | None,
]:
    """What the engine is told of who flies.

    Raises
    ------
    ConfigError
        more than one of law, policy and torques, a policy that is none, or a task for the others.
    """
    if schedule is not None and (law is not None or policy is not None):
        raise ConfigError("give one of law, policy and torques")
    check_names(options, known_options())
    if policy is None:
        given = {name for name, value in (("task", task), ("config", config)) if value is not None}
        if extra := sorted(given | set(options)):
            raise ConfigError(
                f"{extra[0]} belongs to the task of a policy: it cannot be given without policy"
            )
        if schedule is not None:
            return None, None, schedule
        return law_json(law), None, None
    if law is not None:
        raise ConfigError(f"give either law or policy, got the law {law!r} and a policy")
    if not isinstance(policy, Network):
        raise ConfigError(f"policy must be a drm_env.Network, got {type(policy).__name__}")
    resolved = resolve_options("slew" if task is None else task, config, options)
    return None, (policy._engine, resolved.held), None


def rollout(
    scenarios: Sequence[Scenario | ResolvedConfig | Mapping[str, Any]],
    law: LawLike | None = None,
    *,
    policy: Network | None = None,
    torques: ArrayLike | None = None,
    hold: int = 1,
    task: str | None = None,
    config: ConfigLike = None,
    seed: int | Sequence[int] = 0,
    num_threads: int | None = None,
    progress: Callable[[int, int], object] | None = None,
    signals: Sequence[str] | None = None,
    decimation: int = 1,
    **options: Unpack[Options],
) -> Rollout:
    """Flies many manoeuvres in parallel under a law, by a network or under given torques.

    Parameters
    ----------
    scenarios
        as for `simulate`; see also `sample_scenarios`.
    law
        as for `simulate`; without it and without a policy, ``"none"``.
    policy
        a network that acts in an environment, instead of a law. Its episodes are those of `DrmEnv`
        with each scenario in the place of the drawn one: they end at the horizon, by divergence or
        at a limit of the structure, and pay rewards.
    torques
        of root and tip wheel in N m, shape (len(scenarios), rows, 2), instead of a law: each row is
        commanded for ``hold`` samples, zero after the last. Wheels limit, lag and delay them.
    hold
        samples that a row of ``torques`` is held for.
    task, config, **options
        as for `DrmEnv`, with a policy only: what it sees, does and is paid for. Sample period,
        horizon and (if the policy drives the slew motor) the motor's torque limit of each scenario
        must be those of the task.
    seed
        of the sensors' noise: scenario i gets ``seed + i``, or entry i of a sequence.
    num_threads
        threads; ``None``: one a core. More than there are processors are not made, with a warning.
    progress
        called now and then with how many are done and how many there are.
    signals
        names of signals to keep of each manoeuvre, see `simulate`; ``None``: no trajectories.
    decimation
        keep every so many samples of the sample period, the first and the last included.

    Returns
    -------
    metrics
        Metrics by name (see `episode_metrics`), each of shape (len(scenarios),), in the order of
        ``scenarios``, with the kept signals in the attribute ``trajectories``. The numbers do not
        depend on the number of threads. The return of a law is 0: nothing is paid. A manoeuvre
        that diverges ends there, see `simulate`; one that a policy ends at a limit of its task is
        called diverged too, and has the metrics of the time up to there.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value in any of them, a policy that does not fit the task,
        trajectories of more than 16 GiB or than there is memory; nothing has been flown.
    SimulationError
        a policy whose actions are not finite.

    Examples
    --------
    >>> import drm_env
    >>> scenarios = drm_env.sample_scenarios("slew", seed=0, n=8)
    >>> flown = drm_env.rollout(scenarios, law="linear", signals=["time"], decimation=50)
    >>> flown["tip_error_rms"].shape, flown.trajectories["time"].shape  # 20 s, every 0.1 s
    ((8,), (8, 201))
    >>> open_loop = drm_env.rollout(scenarios)
    >>> bool((flown["tip_error_rms"] < open_loop["tip_error_rms"]).all())
    True
    """
    if isinstance(scenarios, (str, bytes, Mapping)):
        raise ConfigError(
            f"scenarios must be a sequence of scenarios, got {type(scenarios).__name__}"
        )
    if num_threads is not None and (isinstance(num_threads, bool) or num_threads < 1):
        raise ConfigError(f"num_threads must be a positive integer, got {num_threads!r}")
    _check_decimation(decimation)
    if signals is None and decimation != 1:
        raise ConfigError(f"decimation needs signals to keep, got {decimation!r} without signals")
    if signals is not None:
        if isinstance(signals, (str, bytes)) or not all(isinstance(item, str) for item in signals):
            raise ConfigError(f"signals must be a sequence of names, got {signals!r}")
        signals = list(signals)
    if torques is None and hold != 1:
        raise ConfigError(f"hold belongs to torques, got {hold!r} without torques")
    schedule = None if torques is None else _schedule(torques, hold, len(scenarios))
    pilot = _pilot(law, policy, schedule, task, config, options)
    texts = [scenario_json(item, f"scenarios[{index}]") for index, item in enumerate(scenarios)]
    seeds = _seeds(seed, len(texts))
    rows, kept = _engine.rollout(texts, pilot, seeds, num_threads, progress, signals, decimation)
    metrics = dict(zip(_engine.metric_names(), np.ascontiguousarray(rows.T), strict=True))
    return Rollout(metrics, dict(kept))


def sample_scenarios(
    task: str = "slew",
    *,
    seed: int = 0,
    n: int,
    config: ConfigLike = None,
    **options: Unpack[Options],
) -> list[dict[str, Any]]:
    """The manoeuvres that environments with these arguments fly in their first episodes.

    Parameters
    ----------
    task, config, **options
        as for `DrmEnv`.
    seed
        entry i is the first episode of an environment reset with ``seed + i``.
    n
        how many.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value.

    Examples
    --------
    >>> import drm_env
    >>> first, second = drm_env.sample_scenarios("slew", seed=3, n=2, payload_mass=(50.0, 500.0))
    >>> 50.0 <= first["payload"]["mass"] <= 500.0
    True
    >>> second == drm_env.sample_scenarios("slew", seed=4, n=1, payload_mass=(50.0, 500.0))[0]
    True
    """
    if isinstance(n, bool) or not isinstance(n, int) or n < 0:
        raise ConfigError(f"n must be a non-negative integer, got {n!r}")
    _engine.check_memory("n", n, _SCENARIO_BYTES, "a smaller number")
    resolved = resolve_options(task, config, options)
    text = _engine.sample_scenarios(resolved.held, _seeds(seed, n))
    scenarios: list[dict[str, Any]] = json.loads(text)
    return scenarios
