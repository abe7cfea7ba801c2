"""The manoeuvres of chapters 3 to 5 and the flights that the figures show."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.thesis import arm

_Array = NDArray[np.float64]

SETTLED = 1e-4
"""Deflection of link 2 (m) below which the vibration counts as gone: 0.1 mm, inferred."""

_UNBOUNDED = 1e9

LAWS: dict[str, Any] = {
    "none": "none",
    "linear root": {"name": "linear", "tip": None},
    "linear tip": {"name": "linear", "root": None},
    "linear": "linear",
    "linear root, high gain": {
        "name": "linear",
        "tip": None,
        "root": {"rate_gain": 8e6, "angle_gain": 8e4},
    },
    "linear root, low gain": {
        "name": "linear",
        "tip": None,
        "root": {"rate_gain": 1e3, "angle_gain": 1e2},
    },
    "linear, gains exchanged": {
        "name": "linear",
        "root": {"rate_gain": 8e3, "angle_gain": 8e4},
    },
    "Lyapunov root": {"name": "lyapunov", "tip": None},
    "Lyapunov tip": {"name": "lyapunov", "root": None},
    "Lyapunov": "lyapunov",
    "Lyapunov, gains exchanged": {
        "name": "lyapunov",
        "root": {"rate_gain": 3e3, "angle_gain": 3e4},
    },
}
"""Control laws by the names used here."""


@dataclass(frozen=True)
class Manoeuvre:
    """A slew of 50 deg; the default is the thesis' standard one.

    Attributes
    ----------
    payload
        Name of the payload, or ``"3000 kg"``.
    law
        Name in `LAWS`.
    start, end
        Length of link 2 outside link 1, m.
    profile, smoothing, max_accel
        Of the slew; rad/s^2.
    mass_error
        Of the reported payload.
    inertia
        Of the payload, ``"slender"`` as in the thesis' numbers.
    deployment
        ``"coincident"`` or ``"force_limited"`` with 200 N.
    angle_deg
        Slew angle; 0 stays where it is.
    initial_beta
        Coordinate of link 2 at the beginning, m.
    tip_torque, particle_following, motor
        Switches of the plant and the motor.
    unbounded
        Wheels without torque limits.
    root_momentum_limit
        Largest momentum that the root wheel stores, N m s; None stores any amount.
    sample_period
        Between two samples of law and flight, s.
    integrator_step, horizon
        s.
    plant, modes, damping
        ``"thesis"``, or ``"consistent"`` with assumed modes of link 1 and link 2; time constant of
        the structural damping, s.
    """

    payload: str = "P1"
    law: str = "none"
    start: float = 1.0
    end: float = 8.0
    profile: str = "min_time"
    smoothing: float = 0.0
    max_accel: float = 0.02
    mass_error: float = 0.0
    inertia: str = "slender"
    deployment: str = "coincident"
    angle_deg: float = 50.0
    initial_beta: float = 0.0
    tip_torque: str = "slew_and_tip"
    particle_following: bool = False
    motor: str = "fitted"
    unbounded: bool = False
    root_momentum_limit: float | None = None
    sample_period: float = 2e-3
    integrator_step: float = 5e-4
    horizon: float = 20.0
    plant: str = "thesis"
    modes: tuple[int, int] = (4, 4)
    damping: float = 0.0

    def scenario(self) -> dict[str, Any]:
        """Return the manoeuvre as `drm_env.simulate` takes it."""
        heavy = self.payload == "3000 kg"
        load: dict[str, Any] = {**arm.payload("P3" if heavy else self.payload, self.inertia)}
        if heavy:
            load["mass"] = 3000.0
        wheels: dict[str, Any] = {}
        if self.unbounded:
            limit = {"torque_limit": _UNBOUNDED}
            wheels = {"root_wheel": limit, "tip_wheel": limit}
        if self.root_momentum_limit is not None:
            wheels["root_wheel"] = {
                **wheels.get("root_wheel", {}),
                "momentum_limit": self.root_momentum_limit,
            }
        return {
            "payload": load,
            "mass_error": self.mass_error,
            "slew": {
                "angle": math.radians(self.angle_deg),
                "max_accel": self.max_accel,
                "profile": self.profile,
                "smoothing": self.smoothing,
            },
            "deployment": {
                "start": self.start,
                "end": self.end,
                "mode": self.deployment if self.start != self.end else "none",
            },
            "initial": {"beta": self.initial_beta},
            "slew_motor": {"constants": self.motor},
            "dynamics": {
                "tip_torque": self.tip_torque,
                "particle_following": self.particle_following,
                "structural_damping": self.damping,
            },
            "plant": self.plant,
            "modes": self.modes,
            "horizon": self.horizon,
            "sample_period": self.sample_period,
            "integrator_step": self.integrator_step,
            **wheels,
        }

    def flight(self) -> drm_env.Trajectory:
        """Return the flight, one sample a period; it is flown once and remembered."""
        return _flight(self)

    @property
    def title(self) -> str:
        """The manoeuvre in a line."""
        load = arm.PAYLOAD_TITLES.get(self.payload, self.payload)
        if self.start == self.end:
            length = f"a = {self.end:g} m"
        else:
            length = f"a = {self.start:g} to {self.end:g} m"
        if not self.angle_deg:
            return f"{load}, {length}, released with link 2 bent by {2e3 * self.initial_beta:g} mm"
        words = [load, length, self.profile.replace("min_", "minimum ")]
        if self.smoothing:
            words.append(f"smoothing {self.smoothing:g}")
        if self.mass_error:
            words.append(f"mass reported {100.0 * self.mass_error:+.0f} %")
        words.append("open loop" if self.law == "none" else f"{self.law} law")
        return ", ".join(words)


@functools.lru_cache(maxsize=48)
def _flight(manoeuvre: Manoeuvre) -> drm_env.Trajectory:
    return drm_env.simulate(manoeuvre.scenario(), LAWS[manoeuvre.law])


@functools.lru_cache(maxsize=4)
def energies(manoeuvre: Manoeuvre) -> tuple[_Array, dict[str, _Array]]:
    """Return times (s) and the energies of a flight at a fixed length, J."""
    flight = manoeuvre.flight()
    model = drm_env.Model(manoeuvre.scenario()["payload"])
    states = [
        np.column_stack([flight[name] for name in names])
        for names in (("slew_angle", "alpha", "beta"), ("slew_rate", "alpha_rate", "beta_rate"))
    ]
    found = np.array([model.energy(q, v, manoeuvre.end) for q, v in zip(*states, strict=True)])
    lines = {"kinetic": found[:, 0], "strain": found[:, 1], "total": found[:, 2]}
    return flight["time"], lines


def slew_end(flight: drm_env.Trajectory) -> float:
    """Return the end of the slew, s."""
    return float(flight.metrics["slew_end_time"])


def during(flight: drm_env.Trajectory, signal: str = "link2_tip_deflection") -> _Array:
    """Return a signal during the slew."""
    return flight[signal][flight["time"] <= slew_end(flight)]


def after(flight: drm_env.Trajectory, signal: str = "link2_tip_deflection") -> _Array:
    """Return a signal after the slew."""
    return flight[signal][flight["time"] > slew_end(flight)]


def peak(values: _Array) -> float:
    """Return the largest magnitude."""
    return float(np.abs(values).max())


def rms(values: _Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def settling_time(flight: drm_env.Trajectory, threshold: float = SETTLED) -> float:
    """Return when the tip of link 2 stays below the threshold (m) for good; s, NaN if never."""
    above = np.nonzero(np.abs(flight["link2_tip_deflection"]) > threshold)[0]
    if above.size == 0:
        return 0.0
    if above[-1] + 1 >= flight["time"].size:
        return math.nan
    return float(flight["time"][above[-1]])


def largest_angle_deg(flight: drm_env.Trajectory) -> float:
    """Return the largest slew angle, deg."""
    return math.degrees(float(flight["slew_angle"].max()))


def final_angle_deg(flight: drm_env.Trajectory) -> float:
    """Return the slew angle at the end, averaged over the last second, deg."""
    time = flight["time"]
    return math.degrees(float(flight["slew_angle"][time >= time[-1] - 1.0].mean()))
