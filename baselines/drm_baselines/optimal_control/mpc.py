"""The adaptive receding-horizon controller: the bound's programme, solved while flying.

It knows what any policy knows: measured outputs, the reference, the reported payload and the
momentum of the wheels. It starts with the plan for the reported payload, finds the true one from
the balance of angular momentum (:mod:`drm_baselines.optimal_control.kalman_filter`), and solves the
convex programme again for that payload from where the arm is: when the payload turns out to be
another one than planned for, and again and again while a wheel saturates ahead. Between two
plans it flies the linear-quadratic feedback around the last one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.optimal_control.kalman_filter import Observer, late, measurement_noise
from drm_baselines.optimal_control.payload_models import MassModels, merged, prolonged, rest_of
from drm_baselines.optimal_control.quadratic_program import torque_limits
from drm_baselines.optimal_control.staged import feedback, plan, stages_of
from drm_baselines.optimal_control.tvlqr import saturation
from drm_baselines.policies.gains import load_settings
from drm_baselines.policies.pilots import refuse_missions
from drm_baselines.support import cores
from drm_baselines.support.processes import process_pool
from drm_env.constants import LAW_PERIOD

_Array = NDArray[np.float64]

_LOST = 1e3  # rad, m and their rates: nothing that an arm could do

# Entries of the observation that are looked at.
_OBSERVED = (
    "slew_error", "link2_deflection", "slew_error_rate", "link2_deflection_rate",
    "reference_rate", "reference_accel", "root_momentum", "tip_momentum",
)  # fmt: skip


_SEARCHED: Mapping[str, float] = load_settings("receding")["settings"]
"""What ``drm tune receding`` found, by setting."""


@dataclass(frozen=True, kw_only=True)
class Receding:
    """Settings of the controller; eight of them by default as ``drm tune receding`` found them.

    Attributes
    ----------
    hold
        Samples between two decisions.
    smoothing
        Tip error (m) that a change of a wheel's torque by its limit is worth in a plan.
    authority
        Share of the torque limits that a plan uses.
    effort
        Tip error (m) that a deviation from a plan's torque by the whole limit is worth: sets the
        stiffness of the feedback around it.
    sway
        Tip error (m) that a rate of the tip's deflection of 1 m/s is worth in a plan, s: the slew
        angle can hide a vibration from the tip, and should not.
    doubt
        Standard deviation of the reported mass's error, as a fraction.
    disturbance
        Torques that the model does not know, as a fraction of the wheels' limits, for the observer.
    look
        Decisions from one time to the next at which a new plan is considered.
    tolerance
        Relative change of the mass since the last plan at which there is a new one.
    settling, known
        The mass is taken for known after this time, s, once its standard deviation is below this
        fraction.
    period
        Least time to the next plan while a wheel saturates ahead, s.
    drift
        Deviation of the tip from a plan at which there is a new one, m.
    range
        Largest relative error of the reported mass that is believed.
    """

    hold: int = 10
    smoothing: float = _SEARCHED["smoothing"]
    authority: float = _SEARCHED["authority"]
    effort: float = _SEARCHED["effort"]
    sway: float = _SEARCHED["sway"]
    doubt: float = 0.1
    disturbance: float = _SEARCHED["disturbance"]
    look: int = 2
    tolerance: float = _SEARCHED["tolerance"]
    settling: float = 1.0
    known: float = 1.0e-4
    period: float = _SEARCHED["period"]
    drift: float = _SEARCHED["drift"]
    range: float = 0.25

    def config(self, scenario: Mapping[str, Any]) -> dict[str, Any]:
        """Return the configuration of the environment in which a scenario is flown."""
        period = drm_env.default_config().scenario.sample_period
        return {
            "scenario": dict(scenario),
            "randomize": {"payload_mass": None, "mass_error": None},
            "task": {
                "control_period": self.hold * float(scenario.get("sample_period", period)),
                "observe_payload": "reported",
                "preview_times": [],
            },
        }


def told(scenario: Mapping[str, Any], payload: Sequence[float]) -> dict[str, Any]:
    """Return what is known of a manoeuvre beforehand, for the thesis plant at rest.

    Parameters
    ----------
    scenario
        Complete. Its true payload, mass error, initial state and plant are not looked at, only
        whether the dimensions of the payload follow from its mass.
    payload
        Reported mass (kg), length and width (m).
    """
    kept = (
        "arm", "slew", "deployment", "slew_motor", "dynamics", "integrator_step", "sample_period",
        "horizon", "root_wheel", "tip_wheel",
    )  # fmt: skip
    known = {name: scenario[name] for name in kept}
    # a ratio is a damping of the consistent plant alone
    known["dynamics"] = {**known["dynamics"], "damping_ratio": 0.0}
    mass, length, width = (float(value) for value in payload)
    return {
        **known,
        "reported_payload": {"mass": mass, "length": length, "width": width},
        "payload": {
            "inertia": scenario["payload"]["inertia"],
            "mass": mass,
            **{
                name: value
                for name, value in (("length", length), ("width", width))
                if scenario["payload"][name] is not None
            },
        },
    }


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """From instant ``first`` on: torques and gains (fractions), states, saturation, tip errors.

    The tip errors are mean squares of the intervals, m^2.
    """

    first: int
    torques: _Array
    states: _Array
    gains: _Array
    saturated: NDArray[np.int8]
    errors: _Array


class Controller:
    """One flight of the controller.

    Parameters
    ----------
    known
        From :func:`told`.
    sensors
        The sensors' data sheet, as in a scenario.
    settings
        See :class:`Receding`.

    Attributes
    ----------
    plans
        Plans made so far.
    mass
        Mass that the last was made for, kg.
    """

    def __init__(
        self, known: Mapping[str, Any], sensors: Mapping[str, Any], settings: Receding
    ) -> None:
        self._known, self._settings = known, settings
        self._sample = float(known["sample_period"])
        delay = round(float(sensors.get("delay", 0.0)) / self._sample)
        if delay > settings.hold:
            raise BaselineError(
                f"sensors.delay must be at most {settings.hold * self._sample:g} s, the time "
                f"between two decisions, got {sensors['delay']!r}"
            )
        self._delay, self._noise = delay, measurement_noise(sensors)
        # intervals of what is measured: the equations are not quite linear within longer ones
        self._part = math.gcd(settings.hold, delay, 2)
        self._rest = self._intervals = 0
        self._limits = torque_limits(known)
        layout = drm_env.observation_layout(config=settings.config({}))
        scales = {entry.name: (at, entry.scale) for at, entry in enumerate(layout)}
        self._places = [scales[name][0] for name in _OBSERVED]
        self._scales = np.array([scales[name][1] for name in _OBSERVED])
        self._instant = 0
        self._seen: list[tuple[_Array, _Array]] = []
        self._momentum = np.zeros(2)
        self._plan: _Plan | None = None
        self._settled = False
        # An observer whose model does not hold may come to anything: then there is no torque.
        self._lost = False
        self.plans = 0
        self._reported = float(known["reported_payload"]["mass"])
        self._models = MassModels(self._measure)
        self._take(self._reported)

    def _measure(self, mass: float) -> tuple[drm_env.Transitions, ...]:
        """Return the model for a mass (kg), and a finer one where measurements are late."""
        scenario = {**self._known, "payload": {**self._known["payload"], "mass": mass}}
        each = self._settings.hold // self._part
        if self._intervals:
            # whatever the mass, the reference comes to rest at the same time
            last = (self._rest + 1) * self._settings.hold * self._sample
            scenario["horizon"] = min(last, self._known["horizon"])
        fine = drm_env.transitions(scenario, hold=self._part)
        model = merged(fine, each)
        if not self._intervals:
            self._rest, self._intervals = rest_of(model), len(model.offset)
        model = prolonged(model, self._intervals)
        return (model, prolonged(fine, each * self._intervals)) if self._delay else (model,)

    def _take(self, mass: float) -> None:
        """Model the arm with a payload of this mass (kg) and look at the whole flight anew."""
        settings = self._settings
        (self._model, *finer), (slope, *_) = self._models.at(mass)
        self.mass = mass
        self._stages = stages_of(self._model, self._limits, settings.sway)
        self.observer = Observer(
            self._model,
            slope,
            noise=self._noise,
            past=late(finer[0], settings.hold // self._part, self._delay // self._part)
            if finer
            else None,
            unknown=settings.disturbance * self._limits,
            error=self._reported / mass - 1.0 if mass > 0.0 else 0.0,
            doubt=settings.doubt,
        )
        with np.errstate(over="ignore", invalid="ignore"):
            for measured, torque in self._seen:
                self.observer.look(measured, torque)

    def identified(self) -> float:
        """Return the present estimate of the mass, kg."""
        low, high = ((1.0 + s * self._settings.range) * self._reported for s in (-1.0, 1.0))
        return min(max(self.mass * (1.0 + self.observer.error), low), high)

    def _replan(self) -> None:
        """Solve the programme from here; an unsolved one leaves the last plan in force."""
        settings, k = self._settings, self._instant
        stages = self._stages.after(k)
        expected = 0.0
        if self._plan is not None:
            expected = math.sqrt(max(self._plan.errors[k - self._plan.first :].mean(), 0.0))
        found = plan(
            stages,
            self.observer.state,
            smoothing=settings.smoothing,
            authority=settings.authority,
            error=expected,
        )
        if found is None:
            return
        states, torques = found[:, :6], found[:, 6:]
        saturated = saturation(torques, states, np.zeros((2, 6)), np.ones(2), settings.authority)
        self._plan = _Plan(
            first=k,
            torques=torques,
            states=states,
            gains=feedback(stages, saturated, settings.effort),
            saturated=saturated,
            errors=stages.errors(found),
        )
        self.plans += 1

    def _due(self) -> bool:
        """Whether to plan anew now; a mass that has moved is taken."""
        settings, k = self._settings, self._instant
        if self._plan is None or k % settings.look:
            return k == 0
        if not self._settled:
            mass, doubt = self.identified(), self.observer.doubt
            time = k * settings.hold * self._sample
            self._settled = time > settings.settling and doubt < settings.known
            least = 0.1 * settings.tolerance if self._settled else max(settings.tolerance, doubt)
            moved = abs(mass - self.mass) > least * self.mass
            if moved:
                self._take(mass)
                if not np.isfinite(self.observer.state).all():
                    self._lost = True
                    return False
            if self._settled:
                self.observer.settle()
            if moved:
                return True
        at = k - self._plan.first
        if at * settings.hold * self._sample < settings.period - 1e-9:
            return False
        ahead = bool(self._plan.saturated[at:].any())
        astray = self._model.error_state[k, 0] @ (self.observer.state - self._plan.states[at])
        return ahead and abs(float(astray)) > settings.drift

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the action for an observation: torques as fractions of the limits, shape (2,)."""
        settings = self._settings
        values = observation[self._places] * self._scales
        angle, deflection, rate, deflection_rate, reference_rate, accel, *momenta = values.tolist()
        momentum = np.array(momenta)
        torque = (self._momentum - momentum) / (settings.hold * self._sample)
        self._momentum = momentum
        # what is measured is late, the reference that it is held against is not
        late_by = self._delay * self._sample if self._instant else 0.0
        measured = np.array(
            [
                (reference_rate - 0.5 * accel * late_by) * late_by + angle,
                0.5 * deflection,
                accel * late_by + rate,
                0.5 * deflection_rate,
            ]
        )
        if self._lost:
            return np.zeros(2, dtype=np.float32)
        self._seen.append((measured, torque))
        with np.errstate(over="ignore", invalid="ignore"):
            state = self.observer.look(measured, torque)
        if not (np.abs(state) < _LOST).all():
            self._lost = True
            return np.zeros(2, dtype=np.float32)
        if self._due():
            self._replan()
            state = self.observer.state
        fractions = np.zeros(2)
        if self._plan is not None:
            at = self._instant - self._plan.first
            fractions = self._plan.torques[at] + self._plan.gains[at] @ (
                state - self._plan.states[at]
            )
        self._instant += 1
        return np.clip(fractions, -1.0, 1.0).astype(np.float32)


def fly_one(
    scenario: Mapping[str, Any],
    seed: int = 0,
    settings: Receding | None = None,
    looked: Callable[[Mapping[str, float]], None] | None = None,
) -> dict[str, float]:
    """Fly one scenario; return the engine's metrics and ``plans``, the number of solved programmes.

    Parameters
    ----------
    scenario
        As for ``drm_env.rollout``.
    seed
        Of the sensors' noise.
    settings
        By default those of the benchmark.
    looked
        Called with the true signals by name, SI, at the beginning and after each decision.

    Raises
    ------
    drm_env.ConfigError
        A scenario that cannot be flown.
    BaselineError
        Measurements that are later than an interval.
    """
    settings = Receding() if settings is None else settings
    env = drm_env.DrmVectorEnv(1, config=settings.config(scenario), num_threads=1)
    try:
        observations, _ = env.reset(seed=[seed])
        whole = asdict(env.config.scenario)
        payload = [
            float(observations[0, place]) * entry.scale
            for place, entry in enumerate(env.observation_layout)
            if entry.name in ("payload_mass", "payload_length", "payload_width")
        ]
        controller = Controller(told(whole, payload), whole["sensors"], settings)
        if looked is not None:
            looked(env.envs[0].signals())
        while True:
            actions = controller.act(observations[0])[None]
            observations, _, terminated, truncated, info = env.step(actions)
            if looked is not None:
                looked(env.envs[0].signals())
            if terminated[0] or truncated[0]:
                break
    finally:
        env.close()
    metrics = {
        name: float(values[0])
        for name, values in drm_env.info_metrics(info).items()
        if name != "episode_return"
    }
    return {**metrics, "plans": float(controller.plans)}


def fly_all(
    scenarios: Sequence[Mapping[str, Any]],
    *,
    seeds: Sequence[int] | None = None,
    settings: Receding | None = None,
    processes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, _Array]:
    """Fly many scenarios side by side; the numbers do not depend on the number of processes.

    Parameters
    ----------
    scenarios, settings
        See :func:`fly_one`.
    seeds
        Of the sensors' noise, one a scenario; by default their places.
    processes
        How many at a time; by default one a processor. With more than one, scripts need the usual
        guard of their main module.
    progress
        Called with (done, total).

    Returns
    -------
    metrics
        The engine's metrics by name and ``plans``, the number of programmes that were solved, each
        of shape (len(scenarios),).

    Raises
    ------
    BaselineError
        No scenarios, seeds that do not fit, or a scenario that cannot be flown, with its place.
    """
    if not scenarios:
        raise BaselineError("scenarios: there is none to fly")
    seeds = range(len(scenarios)) if seeds is None else seeds
    if len(seeds) != len(scenarios):
        raise BaselineError(f"seeds: {len(seeds)} of them for {len(scenarios)} scenarios")
    if processes is not None and processes < 1:
        raise BaselineError(f"processes must be at least 1, got {processes!r}")
    count = min(processes or cores.count(), len(scenarios))
    jobs = [
        (dict(scenario), seed, settings) for scenario, seed in zip(scenarios, seeds, strict=True)
    ]
    rows: list[dict[str, float]] = []

    def keep(found: Iterator[dict[str, float]]) -> None:
        for index in range(len(jobs)):
            try:
                rows.append(next(found))
            except (BaselineError, drm_env.ConfigError) as error:
                raise BaselineError(f"scenarios[{index}]: {error}") from error
            if progress is not None:
                progress(index + 1, len(jobs))

    if count == 1:
        keep(map(_job, jobs))
    else:
        with process_pool(count) as pool:
            keep(pool.map(_job, jobs))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _job(job: tuple[Mapping[str, Any], int, Receding | None]) -> dict[str, float]:
    return fly_one(*job)


class RecedingPilot:
    """The receding-horizon controller as who flies.

    Parameters
    ----------
    name
        In commands and files.
    settings
        By default those of the benchmark.
    """

    def __init__(self, name: str = "receding", settings: Receding | None = None) -> None:
        self.name = name
        self.settings = Receding() if settings is None else settings

    @property
    def control_period(self) -> float:
        """Time between two decisions, s, at the engine's usual sample period."""
        return self.settings.hold * LAW_PERIOD

    @property
    def details(self) -> Mapping[str, Any]:
        """The settings."""
        return {"receding": asdict(self.settings)}

    def fly(
        self,
        scenarios: Sequence[Mapping[str, Any]],
        *,
        seed: int | Sequence[int] = 0,
        progress: Callable[[int, int], None] | None = None,
    ) -> dict[str, _Array]:
        """See :class:`drm_baselines.policies.pilots.Pilot`, and :func:`fly_all` for errors.

        Raises
        ------
        PolicyError
            A mission among the scenarios.
        """
        refuse_missions(self.name, scenarios)
        seeds = range(seed, seed + len(scenarios)) if isinstance(seed, int) else seed
        return fly_all(scenarios, seeds=seeds, settings=self.settings, progress=progress)

    def trajectory(
        self,
        scenario: Mapping[str, Any],
        *,
        seed: int = 0,
        decimation: int = 1,  # noqa: ARG002
    ) -> drm_env.Trajectory:
        """See :class:`drm_baselines.policies.pilots.Pilot`; a row a decision. No missions."""
        refuse_missions(self.name, [scenario])
        rows: list[Mapping[str, float]] = []
        metrics = fly_one(scenario, seed, self.settings, rows.append)
        return drm_env.Trajectory(
            {name: np.array([row[name] for row in rows]) for name in rows[0]}, metrics
        )
