"""Whole closed-loop manoeuvres flown in Rust, without Python in the loop."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

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
    resolve_options,
)
from drm_env.errors import ConfigError
from drm_env.loads import metric_items
from drm_env.missions import LegRecord, leg_records
from drm_env.resolved import ResolvedConfig

if TYPE_CHECKING:
    from typing import Unpack

    from drm_env._config import Scenario
    from drm_env._options import Options

__all__ = [
    "LawLike",
    "ScenarioLike",
    "Trajectory",
    "sample_scenarios",
    "simulate",
]

_SCENARIO_BYTES = 12_000
"""What a scenario takes as a mapping, with its text."""

ScenarioLike = "Scenario | Mapping[str, Any]"
LawLike = str | Mapping[str, Any] | Callable[[NDArray[np.float64]], Any] | Any


class Trajectory(dict[str, NDArray[np.float64]]):
    """Signals of one manoeuvre by name, each of shape (samples,), SI and radians.

    It is a dictionary, ``time`` first. `to_frame` makes it a frame of pandas, `to_mat` a file for
    MATLAB.

    Attributes
    ----------
    metrics
        the metrics of the whole manoeuvre by name, floats; see `episode_metrics` for what they are.
    legs
        of a mission, a `LegRecord` each; empty of a manoeuvre.
    """

    def __init__(
        self,
        signals: Mapping[str, NDArray[np.float64]],
        metrics: dict[str, float],
        legs: tuple[LegRecord, ...] = (),
    ) -> None:
        """Holds what the engine returned."""
        super().__init__(signals)
        self.metrics = metrics
        self.legs = legs

    def __missing__(self, name: str) -> NDArray[np.float64]:
        """Refuses a name that no signal has.

        Raises
        ------
        KeyError
            always; the message lists the signals.
        """
        raise KeyError(f"no signal {name!r}; there are {', '.join(self)}")

    def to_frame(self) -> Any:
        """A `pandas.DataFrame` with a column for each signal and a row for each sample.

        Raises
        ------
        ImportError
            there is no pandas.
        """
        return frame(self, "sample")

    def to_mat(self, path: str | PathLike[str]) -> None:
        """Writes a MATLAB file: a column of each signal, and the structure ``metrics``.

        Raises
        ------
        ImportError
            there is no SciPy.
        OSError
            the file cannot be written.
        """
        write_mat(path, {**self, "metrics": self.metrics})

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles hold signals, metrics and legs."""
        return type(self), (dict(self), self.metrics, self.legs)

    def __repr__(self) -> str:
        """Names, duration and number of samples."""
        samples = len(next(iter(self.values()), ()))
        until = f", {self['time'][-1]:g} s" if samples and "time" in self else ""
        return f"Trajectory({samples} samples{until}: {', '.join(self)})"

    def _repr_html_(self) -> str:
        """What Jupyter shows: metrics, and the signals with their curves."""
        return _html.trajectory(self, self.metrics)


def metrics_of(
    rows: NDArray[np.float64],
    measured: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
) -> dict[str, NDArray[np.float64]]:
    """Metrics of many manoeuvres by name, from what the engine returns."""
    metrics = dict(zip(_engine.metric_names(), np.ascontiguousarray(rows.T), strict=True))
    if measured is not None:
        metrics |= dict(metric_items(*measured))
    return metrics


def trajectory_of(
    index: int,
    metrics: Mapping[str, NDArray[np.float64]],
    signals: Mapping[str, NDArray[np.float64]],
    legs: tuple[LegRecord, ...] = (),
) -> Trajectory:
    """One manoeuvre of many, up to its end."""
    rows = {name: values[index] for name, values in signals.items()}
    flown = [~np.isnan(row) for row in rows.values()]
    samples = max((int(np.flatnonzero(row)[-1]) + 1 for row in flown if row.any()), default=0)
    return Trajectory(
        {name: row[:samples] for name, row in rows.items()},
        {name: float(values[index]) for name, values in metrics.items()},
        legs,
    )


def simulate(
    scenario: Scenario | ResolvedConfig | Mapping[str, Any] | None = None,
    law: LawLike = "none",
    *,
    decimation: int = 1,
    seed: int = 0,
    loads: bool = False,
    sensors: bool = False,
    law_period: float | None = None,
) -> Trajectory:
    """Flies one manoeuvre in closed loop.

    Parameters
    ----------
    scenario
        any part of a scenario; what is left out has its default (the thesis' standard
        manoeuvre). ``None`` is all of it. A `ResolvedConfig` that draws nothing stands for the
        manoeuvre in it. A mapping ``{"scenario": ..., "mission": {"legs": [...]}}`` is a mission,
        whose legs are flown one after the other; see docs/missions.md.
    law
        a name (``"none"``, ``"linear"``, ``"lyapunov"``, ``"servo"``), a mapping of its
        parameters, or a callable: it is given what is measured and known, shape (1, k) with the
        columns `ControlLaw.MEASUREMENTS`, and returns the torques of root and tip wheel, N m, shape
        (1, 2), which are held until it is called again. What it raises ends the flight and is
        raised here. In a mission the columns are told from the leg under way: errors and references
        from its beginning, the payload as it is reported there.
    decimation
        keep every so many samples of the sample period, the first and the last included.
    seed
        of the sensors' noise, if the scenario has any.
    loads
        add the loads (see `load_signals`) to the signals, and to the metrics ``<name>_peak``, the
        largest magnitude, and ``<name>_rms``, the root mean square, of each over all samples.
    sensors
        add what the sensors read at each sample, ``measured_slew_angle`` and the others of
        `drm_env.constants.MEASURED_NAMES`, to the signals: with their noise, bias, bandwidth,
        resolution and delay. Strain gauges and accelerometer are NaN unless they are fitted
        (``scenario["sensors"]``; see docs/plants.md).
    law_period
        time between two calls of a callable, s, a multiple of the sample period; ``None``: every
        sample. It is counted from the beginning, of a mission too, wherever its legs begin.

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
        an unknown name or an impossible value, with its path and the value; a callable whose
        torques have another shape or are not finite.

    Examples
    --------
    >>> import math
    >>> import drm_env
    >>> flight = drm_env.simulate({"mass_error": 0.15, "payload": {"inertia": "slender"}})
    >>> flight["time"].shape == flight["tip_deflection"].shape
    True
    >>> f"{math.degrees(flight.metrics['peak_slew_angle']):.1f}"  # the thesis has 56.21 deg
    '56.2'
    >>> flight = drm_env.simulate(loads=True)
    >>> bool(flight.metrics["deployment_force_peak"] > 90.0)  # N, with the centrifugal pull
    True
    """
    check_decimation(decimation)
    check_flag("loads", loads)
    check_flag("sensors", sensors)
    (first,) = seeds_of(seed, 1)
    period = check_period(law, law_period)
    if is_callable(law):
        names = [*_engine.signal_names(), *(_engine.load_names() if loads else ())]
        names += _engine.measured_names() if sensors else ()
        (rows, kept, measured), flown = _engine.rollout_asked(
            [engine_scenario(scenario)],
            AskedLaw(law, 1),
            period,
            [first],
            None,
            list(dict.fromkeys(names)),
            decimation,
            loads,
        )
        records = leg_records(flown[0]) if flown else ()
        return trajectory_of(0, metrics_of(rows, measured), dict(kept), records)
    signals, metrics, measured, legs = _engine.simulate(
        engine_scenario(scenario), law_json(law), decimation, first, loads, sensors
    )
    stated = dict(metrics)
    if measured is not None:
        stated |= {name: float(value) for name, value in metric_items(*measured)}
    return Trajectory(dict(signals), stated, leg_records(legs))


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
    text = _engine.sample_scenarios(resolved.held, seeds_of(seed, n))
    scenarios: list[dict[str, Any]] = json.loads(text)
    return scenarios
