"""What a controller makes of the measurements: the state of the arm and the mass of its payload.

Measured are slew angle and deflection of link 2 with their rates, and the momentum that the
wheels have stored; link 1 is seen only by what it does to the others. A Kalman filter over the
linear model of the manoeuvre estimates the whole state, and with it the mass: what the slew motor
was told to give for the reported arm and what the wheels have given must be the change of the true
arm's angular momentum, rigid and elastic. This is the balance of angular momentum that
``identified_mass_error`` shows to agents, with the vibration in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env

_Array = NDArray[np.float64]

MEASURED = (0, 2, 3, 5)
"""Entries of the state that are measured: slew angle, beta and their rates."""

# Of exact sensors: what single precision and the course of the torques between two instants leave.
_FLOOR = np.array([1e-7, 1e-6, 1e-6, 1e-5])  # rad, m, rad/s, m/s
# At the beginning, in the order of the state: rad, m, m and their rates.
_START = np.array([1e-5, 1e-3, 1e-3, 1e-5, 1e-3, 1e-3])


def measurement_noise(sensors: Mapping[str, Any]) -> _Array:
    """Return standard deviations of the entries :data:`MEASURED` by the sensors' data sheet."""
    noise = np.zeros(4)
    # of a deflection is measured twice the coordinate
    names = (("angle", 1.0), ("deflection", 0.5), ("rate", 1.0), ("deflection_rate", 0.5))
    for row, (name, share) in enumerate(names):
        spread = float(sensors.get(f"{name}_noise", 0.0))
        quantum = float(sensors.get(f"{name}_resolution", 0.0))
        noise[row] = share * np.hypot(spread, quantum / np.sqrt(12.0))
    return np.asarray(np.hypot(noise, _FLOOR))


class Observer:
    """Kalman filter of state and payload of a manoeuvre, instant by instant.

    Parameters
    ----------
    fine
        Model of the thesis plant at every sample (``hold=1``), for some mass.
    coarse, heavier
        The same at the instants, and that for a mass greater by the fraction ``change``.
    change
        See there.
    noise
        Standard deviations of the measurements, shape (4,).
    delay
        Samples that they are late, at most those of an interval.
    unknown
        Standard deviations of the torques that the model does not know, N m, shape (2,).
    error, doubt
        Error of the mass and its standard deviation at the start, as fractions of it.

    Attributes
    ----------
    state
        Estimate of x at the present instant, shape (6,).
    error
        Estimate of the mass's error: what the mass is greater than that of the model, as a
        fraction.
    """

    def __init__(
        self,
        fine: drm_env.Transitions,
        coarse: drm_env.Transitions,
        heavier: drm_env.Transitions,
        change: float,
        *,
        noise: _Array,
        delay: int,
        unknown: _Array,
        error: float,
        doubt: float,
    ) -> None:
        self._fine, self._coarse, self._delay = fine, coarse, delay
        self._by_mass = tuple(
            (getattr(heavier, name) - getattr(coarse, name)) / change
            for name in ("transition", "input", "offset")
        )
        self._hold = len(fine.offset) // len(coarse.offset)
        self._noise = np.diag(np.square(noise))
        self._unknown = np.diag(np.square(unknown))
        self.state, self.error = np.array(fine.start), error
        self._covariance = np.diag(np.square(np.append(_START, doubt)))
        self._instant = 0

    @property
    def doubt(self) -> float:
        """Standard deviation of ``error``."""
        return float(np.sqrt(max(self._covariance[6, 6], 0.0)))

    def settle(self) -> None:
        """Take the mass for known from now on: what the model leaves out would move it later."""
        self._covariance[6, :] = 0.0
        self._covariance[:, 6] = 0.0

    def look(self, measured: _Array, torque: _Array) -> _Array:
        """Return the estimate of x at the next instant (the first time: at the start).

        Parameters
        ----------
        measured
            The entries :data:`MEASURED` of x, of ``delay`` samples ago, shape (4,).
        torque
            Mean torques of the wheels since the last instant by their momentum, N m, shape (2,).
        """
        k = self._instant
        if k > 0:
            self._move(k - 1, torque)
        self._instant = k + 1
        seen, expected = np.eye(6), self.state
        # at the start nothing has happened before
        if k > 0 and self._delay > 0:
            seen, expected = self._past(k, torque)
        rows = np.zeros((4, 7))
        rows[:, :6] = seen[list(MEASURED)]
        spread = rows @ self._covariance
        gain = np.linalg.solve(spread @ rows.T + self._noise, spread).T
        correction = gain @ (measured - expected[list(MEASURED)])
        self.state = self.state + correction[:6]
        self.error += float(correction[6])
        kept = np.eye(7) - gain @ rows
        self._covariance = kept @ self._covariance @ kept.T + gain @ self._noise @ gain.T
        return self.state

    def _move(self, k: int, torque: _Array) -> None:
        """From instant k to the next."""
        step, given, offset = (
            part[k] for part in (self._coarse.transition, self._coarse.input, self._coarse.offset)
        )
        motion = np.eye(7)
        motion[:6, :6] = step
        motion[:6, 6] = (
            self._by_mass[0][k] @ self.state + self._by_mass[1][k] @ torque + self._by_mass[2][k]
        )
        self.state = step @ self.state + given @ torque + offset + motion[:6, 6] * self.error
        self._covariance = motion @ self._covariance @ motion.T
        self._covariance[:6, :6] += given @ self._unknown @ given.T

    def _past(self, k: int, torque: _Array) -> tuple[_Array, _Array]:
        """What x of ``delay`` samples ago is of x now: its derivative (6, 6) and itself (6,)."""
        seen, then = np.eye(6), self.state
        last = k * self._hold - 1
        for sample in range(last, last - self._delay, -1):
            back = np.linalg.inv(self._fine.transition[sample])
            then = back @ (then - self._fine.input[sample] @ torque - self._fine.offset[sample])
            seen = back @ seen
        return seen, then
