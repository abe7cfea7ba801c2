"""Many whole manoeuvres flown side by side in Rust, without Python in the loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env import _engine, _html
from drm_env._exports import frame, write_mat
from drm_env._manoeuvres import (
    AskedLaw,
    check_decimation,
    check_flag,
    check_period,
    engine_scenario,
    is_callable,
    law_json,
)
from drm_env._seeding import seeds_of
from drm_env.configuration import (
    ConfigLike,
    check_names,
    known_options,
    resolve_options,
)
from drm_env.errors import ConfigError
from drm_env.missions import LegRecord, leg_records
from drm_env.network import Network
from drm_env.resolved import ResolvedConfig
from drm_env.simulation import LawLike, Trajectory, metrics_of, trajectory_of

if TYPE_CHECKING:
    from typing import Unpack

    from drm_env._config import Scenario
    from drm_env._options import Options

__all__ = ["Rollout", "rollout"]


class Rollout(dict[str, NDArray[np.float64]]):
    """Metrics of many manoeuvres by name, each of shape (n,), in the order of the scenarios.

    It is a dictionary. `to_frame` makes it a frame of pandas, `to_mat` a file for MATLAB, and so do
    those of ``rollout.trajectory(i)``, the signals of one manoeuvre.

    Attributes
    ----------
    trajectories
        the signals that were asked for by name, each of shape (n, samples), SI and radians. Rows
        are ``decimation`` sample periods apart and end with the last sample of the manoeuvre; NaN
        follows where one ends before the longest. Empty without ``signals``.
    legs
        of each mission its legs, a `LegRecord` each; empty of manoeuvres.
    """

    def __init__(
        self,
        metrics: dict[str, NDArray[np.float64]],
        trajectories: dict[str, NDArray[np.float64]],
        legs: tuple[tuple[LegRecord, ...], ...] = (),
    ) -> None:
        """Holds what the engine returned."""
        super().__init__(metrics)
        self.trajectories = trajectories
        self.legs = legs

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
        legs = self.legs[index] if self.legs else ()
        return trajectory_of(index, self, self.trajectories, legs)

    def to_frame(self) -> Any:
        """A `pandas.DataFrame` with a column for each metric and a row for each manoeuvre.

        The signals of one manoeuvre are ``rollout.trajectory(i).to_frame()``.

        Raises
        ------
        ImportError
            there is no pandas.
        """
        return frame(self, "manoeuvre")

    def to_mat(self, path: str | PathLike[str]) -> None:
        """Writes a MATLAB file: a column of each metric, and kept signals in ``trajectories``.

        ``trajectories`` is a structure with a matrix for each signal, a row a manoeuvre. It is
        there if signals were kept.

        Raises
        ------
        ImportError
            there is no SciPy.
        OSError
            the file cannot be written.
        """
        kept = {"trajectories": self.trajectories} if self.trajectories else {}
        write_mat(path, {**self, **kept})

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles hold metrics, trajectories and legs."""
        return type(self), (dict(self), self.trajectories, self.legs)

    def __repr__(self) -> str:
        """Number of manoeuvres, and the names of metrics and signals."""
        count = len(next(iter(self.values()), ()))
        signals = f"; signals {', '.join(self.trajectories)}" if self.trajectories else ""
        return f"Rollout({count} manoeuvres: {', '.join(self)}{signals})"

    def _repr_html_(self) -> str:
        """What Jupyter shows: the distribution of every metric."""
        return _html.rollout(self, self.trajectories)


_NAMELESS = {"name": "none"}
"""Stands for a callable where it is checked what goes together."""


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
    loads: bool = False,
    law_period: float | None = None,
    **options: Unpack[Options],
) -> Rollout:
    """Flies many manoeuvres in parallel under a law, by a network or under given torques.

    Parameters
    ----------
    scenarios
        as for `simulate`; see also `sample_scenarios`. Either all are missions or none is; the
        samples of a mission's ``period`` are then a multiple of ``decimation``.
    law
        as for `simulate`; without it and without a policy, ``"none"``. A callable is given one row
        for each scenario, in their order, from the beginning to the end of the longest (of one that
        has ended, the row it was last given), and returns as many; it is called on this thread.
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
        names of signals to keep of each manoeuvre, see `simulate`, `load_signals` and
        `drm_env.constants.MEASURED_NAMES`; ``None``: no trajectories.
    decimation
        keep every so many samples of the sample period, the first and the last included.
    loads
        state ``<name>_peak``, the largest magnitude, and ``<name>_rms``, the root mean square, of
        each load of `load_signals` over all samples. That takes time; nothing else moves.
    law_period
        time between two calls of a law that is a callable, s, see `simulate`.

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
    check_decimation(decimation)
    check_flag("loads", loads)
    if signals is None and decimation != 1:
        raise ConfigError(f"decimation needs signals to keep, got {decimation!r} without signals")
    if signals is not None:
        if isinstance(signals, (str, bytes)) or not all(isinstance(item, str) for item in signals):
            raise ConfigError(f"signals must be a sequence of names, got {signals!r}")
        signals = list(signals)
    if torques is None and hold != 1:
        raise ConfigError(f"hold belongs to torques, got {hold!r} without torques")
    schedule = None if torques is None else _schedule(torques, hold, len(scenarios))
    period = check_period(law, law_period)
    asked = AskedLaw(law, len(scenarios)) if is_callable(law) else None
    pilot = _pilot(law if asked is None else _NAMELESS, policy, schedule, task, config, options)
    given = [engine_scenario(item, f"scenarios[{index}]") for index, item in enumerate(scenarios)]
    seeds = seeds_of(seed, len(given))
    if asked is not None:
        (rows, kept, measured), legs = _engine.rollout_asked(
            given, asked, period, seeds, progress, signals, decimation, loads
        )
    else:
        (rows, kept, measured), legs = _engine.rollout(
            given, pilot, seeds, num_threads, progress, signals, decimation, loads
        )
    return Rollout(
        metrics_of(rows, measured), dict(kept), tuple(leg_records(flown) for flown in legs)
    )
