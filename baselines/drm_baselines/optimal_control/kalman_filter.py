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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import drm_env

_Array = NDArray[np.float64]

MEASURED = (0, 2, 3, 5)
"""Entries of the state that are measured: slew angle, beta and their rates."""
_SEEN = list(MEASURED)

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


class Late(NamedTuple):
    """What the state was some samples before each instant: ``state @ x - torque @ u - offset``.

    Shapes (N, 6, 6), (N, 6, 2) and (N, 6) for the instants 1 to N, u being the torques of the
    interval before.
    """

    state: _Array
    torque: _Array
    offset: _Array


def late(fine: drm_env.Transitions, hold: int, delay: int) -> Late:
    """Look back from each instant.

    Parameters
    ----------
    fine
        Model of the thesis plant whose intervals ``hold`` and ``delay`` count.
    hold
        Intervals from one instant to the next.
    delay
        Intervals to look back, at most ``hold``.
    """
    count = len(fine.offset) // hold
    state = np.broadcast_to(np.eye(6), (count, 6, 6))
    torque, offset = np.zeros((count, 6, 2)), np.zeros((count, 6))
    for back in range(1, delay + 1):
        step, given, drift = (
            part[hold - back :: hold] for part in (fine.transition, fine.input, fine.offset)
        )
        inverse = np.linalg.inv(step)
        state = inverse @ state
        torque = inverse @ (torque + given)
        offset = (inverse @ (offset + drift)[:, :, None])[:, :, 0]
    return Late(state, torque, offset)


class Observer:
    """Kalman filter of state and payload of a manoeuvre, instant by instant.

    Parameters
    ----------
    model
        Model of the thesis plant from instant to instant, for some mass.
    slope
        Its derivative with respect to the relative change of the mass.
    noise
        Standard deviations of the measurements, shape (4,).
    past
        Where the measurements are late: from :func:`late`.
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
        model: drm_env.Transitions,
        slope: drm_env.Transitions,
        *,
        noise: _Array,
        past: Late | None,
        unknown: _Array,
        error: float,
        doubt: float,
    ) -> None:
        self._model, self._slope, self._past = model, slope, past
        self._variance, self._noise = np.square(noise), np.diag(np.square(noise))
        self._unknown = np.square(unknown)
        self._rows = np.eye(7)[_SEEN]
        self._motion = np.eye(7)
        self.state, self.error = np.array(model.start), error
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
            The entries :data:`MEASURED` of x, late as they are, shape (4,).
        torque
            Mean torques of the wheels since the last instant by their momentum, N m, shape (2,).
        """
        k = self._instant
        if k > 0:
            self._move(k - 1, torque)
        self._instant = k + 1
        rows, expected = self._rows, self.state
        # at the start nothing has happened before
        if k > 0 and self._past is not None:
            seen, given, offset = (part[k - 1] for part in self._past)
            expected = seen @ self.state - given @ torque - offset
            rows = np.zeros((4, 7))
            rows[:, :6] = seen[_SEEN]
        spread = rows @ self._covariance
        gain = np.linalg.solve(spread @ rows.T + self._noise, spread).T
        correction = gain @ (measured - expected[_SEEN])
        self.state = self.state + correction[:6]
        self.error += float(correction[6])
        # (1 - gain rows) covariance (1 - gain rows)' + gain noise gain'
        kept = self._covariance - gain @ spread
        self._covariance = kept + (gain * self._variance - kept @ rows.T) @ gain.T
        return self.state

    def _move(self, k: int, torque: _Array) -> None:
        """From instant k to the next."""
        model, slope, motion = self._model, self._slope, self._motion
        step, given = model.transition[k], model.input[k]
        by_mass = slope.transition[k] @ self.state + slope.input[k] @ torque + slope.offset[k]
        motion[:6, :6] = step
        motion[:6, 6] = by_mass
        self.state = step @ self.state + given @ torque + model.offset[k] + by_mass * self.error
        self._covariance = motion @ self._covariance @ motion.T
        self._covariance[:6, :6] += (given * self._unknown) @ given.T
