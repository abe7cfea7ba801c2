"""A linear-quadratic-Gaussian law for the flexible arm, scheduled over length and identified mass.

For each extension and mass of a grid the undeflected arm (:class:`drm_env.Model`, the consistent
plant) is written in its modes, of which the lowest are kept. The regulator weighs the error of the
tip, its rate, the vibration and the torques, with the wheels' lag in the model; the observer of the
modes is the stationary Kalman filter for torques that are not known and for rates that are measured
with errors. These are larger than the sensors': they stand for the modes that are left out. Between
the nodes of the grid everything is interpolated.

The state is public, a row of numbers for each manoeuvre (:data:`STATE`): error of the angle of the
arm as a whole, error of the reported mass, their covariance, the modes, the wheels' torques. The
first two are those of a Kalman filter on the balance of angular momentum, as in the engine's
``servo``: what the motor gives for the reported arm and what the wheels have stored is the true
arm's inertia times its rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.optimal_control.quadratic_program import torque_limits
from drm_baselines.policies.pilots import refuse_missions

_Array = NDArray[np.float64]

MODES = 2
"""Modes that are observed and regulated: the lowest."""

EXTENSIONS = tuple(float(a) for a in np.linspace(1.0, 8.0, 15))
"""Extensions of the grid, m."""
MASSES = tuple(float(m) for m in np.geomspace(35.0, 650.0, 8))
"""Masses of the grid, kg: those of 50 to 500 kg that are misreported by a quarter."""

STATE = (
    "angle_error",
    "mass_error",
    "variance_angle",
    "covariance",
    "variance_mass",
    *(f"mode_{k}{rate}" for k in range(1, MODES + 1) for rate in ("", "_rate")),
    "root_torque",
    "tip_torque",
    "root_momentum",
    "tip_momentum",
    "started",
)
"""What the law remembers of a manoeuvre: rad, a part of the reported mass, their covariance (in
units of ``angle_deviation`` and ``mass_deviation``), turns of the shoulder's tangent by the modes
(rad, rad/s), torques (N m) and momenta (N m s) of the wheels."""

_LARGEST_MASS_ERROR = 0.25


@dataclass(frozen=True, kw_only=True)
class Lqg:
    """What decides the law.

    Attributes
    ----------
    root_effort, tip_effort
        What full torque of a wheel is weighed as, mm of tip error.
    rate
        What the rate of the tip's error is weighed with, s.
    vibration
        What the rate of the tip's vibration is weighed with, s.
    torque_noise
        Torques at the shoulder and at the tip that the observer does not know, N m.
    rate_noise
        Error of the measured slew rate, rad/s, as the observer of the modes believes it: sensors
        and modes that are left out.
    deflection_rate_noise
        Of the measured rate of link 2's deflection, m/s, likewise.
    angle_deviation, angle_drift, mass_deviation
        Of the filter of the arm as a whole: rad, rad/s^(1/2), part of the reported mass.
    period
        Time between two decisions, s.
    lag, delay
        Of wheels and sensors as the law believes them, s.
    damping_ratio
        Of the modes as the law believes it.
    """

    root_effort: float = 30.0
    tip_effort: float = 100.0
    rate: float = 1.0
    vibration: float = 0.3
    torque_noise: tuple[float, float] = (30.0, 3.0)
    rate_noise: float = 5e-3
    deflection_rate_noise: float = 5e-2
    angle_deviation: float = 1e-4
    angle_drift: float = 2e-6
    mass_deviation: float = 0.1
    period: float = 0.004
    lag: float = 0.005
    delay: float = 0.002
    damping_ratio: float = 0.005


class LqgLaw:
    """The law for manoeuvres on the thesis' arm, called like `drm_env.ControlLaw`.

    Parameters
    ----------
    settings
        By default those of the benchmark.

    Examples
    --------
    >>> import numpy as np
    >>> law = LqgLaw()
    >>> seen = np.zeros((1, len(law.MEASUREMENTS)))
    >>> seen[0, law.MEASUREMENTS.index("extension")] = 4.0
    >>> seen[0, law.MEASUREMENTS.index("payload_mass")] = 200.0
    >>> torques, state = law.torques(seen, law.initial_state(1), [True])
    >>> torques.shape, len(STATE) == state.shape[1]
    ((1, 2), True)
    """

    MEASUREMENTS = drm_env.ControlLaw.MEASUREMENTS

    def __init__(self, settings: Lqg | None = None) -> None:
        self.settings = Lqg() if settings is None else settings
        self.limits = torque_limits({})

    @property
    def control_period(self) -> float:
        """Time between two calls, s."""
        return self.settings.period

    def initial_state(self, n: int) -> _Array:
        """Return the state of ``n`` manoeuvres before their first call, shape (n, len(STATE))."""
        return np.zeros((n, len(STATE)))

    @cached_property
    def _table(self) -> tuple[_Array, dict[str, tuple[slice, tuple[int, ...]]]]:
        """Everything on the grid, shape (masses, extensions, numbers), and where it stands."""
        nodes = [
            [_node(a, mass, self.settings, self.limits) for a in EXTENSIONS] for mass in MASSES
        ]
        places: dict[str, tuple[slice, tuple[int, ...]]] = {}
        at = 0
        for name, value in nodes[0][0].items():
            places[name] = (slice(at, at + value.size), value.shape)
            at += value.size
        rows = [
            [np.concatenate([value.ravel() for value in node.values()]) for node in row]
            for row in nodes
        ]
        return np.array(rows), places

    def _at(self, extension: _Array, mass: _Array) -> dict[str, _Array]:
        """The design at extensions (m) and masses (kg), an entry a manoeuvre."""
        table, places = self._table
        along = np.clip(
            (extension - EXTENSIONS[0]) / (EXTENSIONS[1] - EXTENSIONS[0]), 0.0, len(EXTENSIONS) - 1
        )
        ratio = np.log(MASSES[1] / MASSES[0])
        heavy = np.clip(np.log(np.maximum(mass, 1.0) / MASSES[0]) / ratio, 0.0, len(MASSES) - 1)
        i = np.minimum(heavy.astype(np.int64), len(MASSES) - 2)
        j = np.minimum(along.astype(np.int64), len(EXTENSIONS) - 2)
        p, q = (heavy - i)[:, None], (along - j)[:, None]
        found = (1.0 - p) * ((1.0 - q) * table[i, j] + q * table[i, j + 1]) + p * (
            (1.0 - q) * table[i + 1, j] + q * table[i + 1, j + 1]
        )
        return {
            name: found[:, place].reshape(-1, *shape) for name, (place, shape) in places.items()
        }

    def torques(
        self, measurements: ArrayLike, state: ArrayLike, start: ArrayLike
    ) -> tuple[_Array, _Array]:
        """Return the torques of root and tip wheel and the new state, a row a manoeuvre.

        Parameters
        ----------
        measurements
            Shape (n, len(MEASUREMENTS)), SI.
        state
            Shape (n, len(STATE)), what the call before returned.
        start
            Shape (n,), true where a manoeuvre begins.
        """
        seen = np.asarray(measurements, dtype=np.float64)
        told = {name: seen[:, i] for i, name in enumerate(self.MEASUREMENTS)}
        memory = np.array(state, dtype=np.float64)
        memory[np.asarray(start, dtype=np.bool_)] = 0.0
        s = self.settings
        begun = memory[:, -1]
        h = s.period * begun
        extension, reported = told["extension"], told["payload_mass"]
        arm, payload, arm_slope, payload_slope = _inertia(
            extension, reported, told["payload_length"], told["payload_width"]
        )
        del arm_slope
        whole_reported = arm + payload
        rate, accel = told["reference_rate"], told["reference_accel"]
        momentum = whole_reported * rate - told["root_momentum"] - told["tip_momentum"]
        design = self._at(extension, reported * (1.0 + memory[:, 1]))

        # the arm as a whole: angle error and mass
        units = np.array(
            [s.angle_deviation**2, s.angle_deviation * s.mass_deviation, s.mass_deviation**2]
        )
        error, mass = memory[:, :2].T
        p, q, r = (memory[:, 2:5] * units).T
        p = np.where(begun > 0.0, p, 1e-10)
        r = np.where(begun > 0.0, r, s.mass_deviation**2)
        believed = whole_reported + payload * mass
        whole = momentum / believed
        error = error + (whole - rate) * h
        of_mass = -whole * payload / believed * h
        p = p + 2.0 * of_mass * q + of_mass**2 * r + h * s.angle_drift**2
        q = q + of_mass * r
        surprise = told["slew_error"] - design["tilt"] * accel * whole_reported / believed - error
        total = p + s.angle_deviation**2
        gain, mass_gain = p / total, q / total
        error = error + gain * surprise
        mass = np.clip(mass + mass_gain * surprise, -_LARGEST_MASS_ERROR, _LARGEST_MASS_ERROR)
        p, q, r = p - gain * p, q - gain * q, r - mass_gain * q
        inertia = whole_reported + payload * mass
        whole = momentum / inertia

        # the modes
        modes = memory[:, 5 : 5 + 2 * MODES].reshape(-1, MODES, 2)
        root_torque = -(told["root_momentum"] - memory[:, -3]) / s.period * begun
        tip_torque = -(told["tip_momentum"] - memory[:, -2]) / s.period * begun
        shoulder = told["slew_torque"] * begun + root_torque
        w = design["frequency"]
        cos, sin = np.cos(w * h[:, None]), np.sin(w * h[:, None])
        decay = np.exp(-s.damping_ratio * w * h[:, None])
        rest = (
            design["input"][:, :, 0] * shoulder[:, None]
            + design["input"][:, :, 1] * tip_torque[:, None]
        ) / w**2
        away, speed = modes[:, :, 0] - rest, modes[:, :, 1]
        position = rest + decay * (away * cos + speed / w * sin)
        speed = decay * (speed * cos - away * w * sin)
        position, speed = position * begun[:, None], speed * begun[:, None]
        # what the sensors show is as old as their delay
        back_cos, back_sin = np.cos(w * s.delay), np.sin(w * s.delay)
        then = speed * back_cos + (position - rest) * w * back_sin
        surprises = np.stack(
            [
                told["slew_error_rate"] + rate - whole - then.sum(axis=1),
                told["link2_deflection_rate"] - (design["link2"] * then).sum(axis=1),
            ],
            axis=1,
        )
        surprises *= begun[:, None]
        step = np.einsum("nij,nj->ni", design["observer"], surprises).reshape(-1, MODES, 2)
        position, speed = position + step[:, :, 0], speed + step[:, :, 1]

        # the regulator, about where the arm would be at rest in its frame
        reach = _LINK1 + extension
        still = design["input"][:, :, 0] * (inertia * accel)[:, None] / w**2
        applied = memory[:, 5 + 2 * MODES : 7 + 2 * MODES]
        x = np.concatenate(
            [
                (error + design["tip_way"] * accel / reach)[:, None],
                (whole - rate)[:, None],
                np.stack([position - still, speed], axis=2).reshape(-1, 2 * MODES),
                applied,
            ],
            axis=1,
        )
        asked = -np.einsum("nij,nj->ni", design["gain"], x)
        lack = (payload * accel + payload_slope * told["extension_rate"] * rate) * mass
        asked[:, 0] += lack
        given = np.clip(asked, -self.limits, self.limits)
        # beyond the root wheel's limit the tip wheel helps
        given[:, 1] = np.clip(
            given[:, 1] + (asked[:, 0] - given[:, 0]), -self.limits[1], self.limits[1]
        )
        kept = np.exp(-s.period / s.lag) if s.lag > 0.0 else 0.0
        after = np.concatenate(
            [
                np.stack([error, mass], axis=1),
                np.stack([p, q, r], axis=1) / units,
                np.stack([position, speed], axis=2).reshape(-1, 2 * MODES),
                kept * applied + (1.0 - kept) * given,
                told["root_momentum"][:, None],
                told["tip_momentum"][:, None],
                np.ones((len(seen), 1)),
            ],
            axis=1,
        )
        return given, after


_ARM = drm_env.default_config().scenario.arm
_LINK1 = _ARM.link1.length


def _inertia(
    extension: _Array, mass: _Array, length: _Array, width: _Array
) -> tuple[_Array, _Array, _Array, _Array]:
    """Moments of inertia of the arm and of the payload about the shoulder, and their slopes."""
    l1, l2 = _ARM.link1.length, _ARM.link2.length
    reach = l1 + extension
    inner = reach - l2
    density = _ARM.link2.mass_per_length
    arm = _ARM.link1.mass_per_length * l1**3 / 3.0 + density * (reach**3 - inner**3) / 3.0
    own = mass * (length**2 + width**2) / 12.0 + mass * length**2 / 4.0
    payload = own + mass * reach * (reach + length)
    return arm, payload, density * (reach**2 - inner**2), mass * (2.0 * reach + length)


def _node(extension: float, mass: float, s: Lqg, limits: _Array) -> dict[str, _Array]:
    """Design at one extension (m) and mass (kg)."""
    model = drm_env.Model({"mass": mass}, plant="consistent", modes=(4, 4))
    linear = model.linearize(extension)
    size = len(linear.A) // 2
    # M^-1 K and M^-1 F
    values, shapes = np.linalg.eig(-linear.A[size:, :size])
    order = np.argsort(values.real)
    values, shapes = values.real[order], shapes.real[:, order]
    wheels = [linear.inputs.index(name) for name in ("root_torque", "tip_torque")]
    # of each mode so much that the shoulder's tangent turns by 1 rad
    shapes = shapes / shapes[0]
    inputs = np.linalg.solve(shapes, linear.B[size:, wheels])
    w = np.sqrt(np.maximum(values, 0.0))
    link2 = linear.C[linear.outputs.index("link2_deflection"), :size] @ shapes
    tip = linear.C[linear.outputs.index("tip_deflection"), :size] @ shapes
    reach = _LINK1 + extension
    # tip_deflection is told from the turning axis; in the inertial frame a mode turns that, too
    tip = tip + reach
    inertia = 1.0 / inputs[0, 0]
    static = inputs[1:, 0] * inertia / values[1:]
    kept = slice(1, 1 + MODES)
    w, modal, link2_kept, tip_kept = w[kept], inputs[kept], link2[kept], tip[kept]

    a = np.zeros((4 + 2 * MODES, 4 + 2 * MODES))
    a[0, 1] = 1.0
    torque = slice(2 + 2 * MODES, 4 + 2 * MODES)
    a[1, torque] = inputs[0]
    for k in range(MODES):
        at = 2 + 2 * k
        a[at, at + 1] = 1.0
        a[at + 1, at], a[at + 1, at + 1] = -(w[k] ** 2), -2.0 * s.damping_ratio * w[k]
        a[at + 1, torque] = modal[k]
    lag = max(s.lag, 1e-4)
    a[torque, torque] = -np.eye(2) / lag
    b = np.zeros((len(a), 2))
    b[torque] = np.eye(2) / lag * limits
    ad, bd = _held(a, b, s.period)
    rows = np.zeros((3, len(a)))
    rows[0, 0], rows[1, 1] = reach, s.rate * reach
    for k in range(MODES):
        at = 2 + 2 * k
        rows[0, at], rows[1, at + 1] = tip_kept[k], s.rate * tip_kept[k]
        rows[2, at + 1] = s.vibration * tip_kept[k]
    rows *= 1e3
    effort = np.diag([s.root_effort**2, s.tip_effort**2])
    try:
        cost = linalg.solve_discrete_are(ad, bd, rows.T @ rows + 1e-9 * np.eye(len(a)), effort)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise BaselineError(f"no regulator for {mass:g} kg at {extension:g} m: {error}") from error
    gain = limits[:, None] * np.linalg.solve(effort + bd.T @ cost @ bd, bd.T @ cost @ ad)

    # the observer of the modes
    modes = slice(2, 2 + 2 * MODES)
    am, bm = _held(a[modes, modes], a[modes, torque], s.period)
    rates = np.zeros((2, 2 * MODES))
    rates[0, 1::2], rates[1, 1::2] = 1.0, link2_kept
    rates = rates @ linalg.expm(-a[modes, modes] * s.delay)
    noise = np.diag([s.rate_noise**2, s.deflection_rate_noise**2])
    unknown = bm @ np.diag(np.square(s.torque_noise)) @ bm.T
    try:
        spread = linalg.solve_discrete_are(
            am.T, rates.T, unknown + 1e-18 * np.eye(2 * MODES), noise
        )
    except (np.linalg.LinAlgError, ValueError) as error:
        raise BaselineError(f"no observer for {mass:g} kg at {extension:g} m: {error}") from error
    observer = np.linalg.solve(rates @ spread @ rates.T + noise, rates @ spread).T
    return {
        "frequency": w,
        "input": modal,
        "link2": link2_kept,
        "tilt": np.array(static.sum()),
        "tip_way": np.array((tip[1:] * static).sum()),
        "gain": gain,
        "observer": observer,
    }


def _held(a: _Array, b: _Array, period: float) -> tuple[_Array, _Array]:
    """A and B over a period in which the input is held."""
    states, inputs = b.shape
    block = np.zeros((states + inputs, states + inputs))
    block[:states, :states], block[:states, states:] = a, b
    over = linalg.expm(block * period)
    return over[:states, :states], over[:states, states:]


class LqgPilot:
    """The law as who flies; it is asked by Python, once a period for all manoeuvres.

    Parameters
    ----------
    name
        In commands and files.
    settings
        By default those of the benchmark.
    """

    def __init__(self, name: str = "lqg", settings: Lqg | None = None) -> None:
        self.name = name
        self.law = LqgLaw(settings)

    @property
    def control_period(self) -> float:
        """Time between two decisions, s."""
        return self.law.control_period

    @property
    def details(self) -> Mapping[str, Any]:
        """The settings."""
        return {"lqg": asdict(self.law.settings)}

    def _asked(self, count: int) -> Any:
        state, start = self.law.initial_state(count), np.ones(count, dtype=np.bool_)

        def ask(seen: _Array) -> _Array:
            nonlocal state, start
            torques, state = self.law.torques(seen, state, start)
            start = np.zeros(count, dtype=np.bool_)
            return torques

        return ask

    def fly(
        self,
        scenarios: Sequence[Mapping[str, Any]],
        *,
        seed: int | Sequence[int] = 0,
        progress: Any = None,
    ) -> dict[str, _Array]:
        """See :class:`drm_baselines.policies.pilots.Pilot`; missions are refused."""
        refuse_missions(self.name, scenarios)
        flown = drm_env.rollout(
            scenarios,
            law=self._asked(len(scenarios)),
            law_period=self.control_period,
            seed=seed,
            progress=progress,
        )
        return {name: values for name, values in flown.items() if name != "episode_return"}

    def trajectory(
        self, scenario: Mapping[str, Any], *, seed: int = 0, decimation: int = 1
    ) -> drm_env.Trajectory:
        """See :class:`drm_baselines.policies.pilots.Pilot`; missions are refused."""
        refuse_missions(self.name, [scenario])
        return drm_env.simulate(
            scenario,
            law=self._asked(1),
            law_period=self.control_period,
            decimation=decimation,
            seed=seed,
        )
