"""The thesis plant under the Lyapunov law, in formulas that serve floats and arrays alike.

NumPy applies them to arrays over episodes, numba compiles them for one episode. They follow the
thesis' equations (appendix C, sections 2.2.2 and 4.6.2), not the engine's arrangement of them. All
values are SI. The manoeuvre is the thesis' standard one: 50 deg in minimum time, 1 m to 8 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_baselines.errors import BaselineError

L1, L2 = 7.0, 8.0
RHO1, RHO2 = 100.0 / 7.0, 75.0 / 8.0
EI1, EI2 = 2.5e6, 3.0e6
ANGLE, MAX_ACCEL = math.radians(50.0), 0.02
START, END = 1.0, 8.0
SAMPLE, MAX_STEP = 2e-3, 5e-4
ROOT_LIMIT, TIP_LIMIT = 100.0, 10.0
RATE_GAIN, ANGLE_GAIN, ACCELERATION_GAIN = 3.0e4, 3.0e3, 2.0e-4

DURATION = math.sqrt(4.0 * ANGLE / MAX_ACCEL)
"""Time of the slew, s."""

_A2 = 4.0 * (END - START) / DURATION**2
_HALF = 0.5 * DURATION

PIECES = (
    (0.0, 0.0, 0.0, MAX_ACCEL, START, 0.0, _A2),
    (
        _HALF, 0.5 * ANGLE, MAX_ACCEL * _HALF, -MAX_ACCEL,
        0.5 * (START + END), _A2 * _HALF, -_A2,
    ),
    (DURATION, ANGLE, 0.0, 0.0, END, 0.0, 0.0),
)  # fmt: skip
"""Start, angle, rate, acceleration, extension, its rate and acceleration of each piece."""

Value = Any
"""A float or an array of floats, one an episode."""


@dataclass(frozen=True)
class Payloads:
    """The payload of each episode; every array has the shape (episodes,)."""

    mass: NDArray[np.float64]
    length: NDArray[np.float64]
    inertia: NDArray[np.float64]
    """About the attachment point, kg m^2."""
    reported_mass: NDArray[np.float64]
    reported_inertia: NDArray[np.float64]

    @classmethod
    def of(
        cls, mass: ArrayLike, length: ArrayLike, width: ArrayLike, mass_error: ArrayLike = 0.0
    ) -> Payloads:
        """Return payloads from their dimensions (kg, m) and the relative error of the mass.

        Raises
        ------
        BaselineError
            A mass that is not positive.
        """
        arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(item, dtype=np.float64))
                                       for item in (mass, length, width, mass_error)))  # fmt: skip
        true, along, across, error = (np.ascontiguousarray(item) for item in arrays)
        if not (true > 0.0).all():
            raise BaselineError(f"mass must be positive, got {true.min()}")
        radius = (4.0 * along**2 + across**2) / 12.0
        reported = true * (1.0 + error)
        return cls(true, along, true * radius, reported, reported * radius)

    def __len__(self) -> int:
        """Return the number of episodes."""
        return self.mass.size

    def columns(self) -> tuple[NDArray[np.float64], ...]:
        """Return mass, length, inertia, reported mass and reported inertia."""
        return self.mass, self.length, self.inertia, self.reported_mass, self.reported_inertia


@dataclass(frozen=True)
class Legs:
    """Equal steps within a sample and a piece, in order; every array has the shape (legs,)."""

    piece: NDArray[np.int64]
    begin: NDArray[np.float64]
    """Time since the piece began, s."""
    h: NDArray[np.float64]
    steps: NDArray[np.int64]
    first: NDArray[np.bool_]
    """Whether a sample begins here, at which the law decides."""


def legs(samples: int) -> Legs:
    """Return the steps of so many samples: no step straddles a switch of the manoeuvre."""
    rows: list[tuple[int, float, float, int, bool]] = []
    starts = [piece[0] for piece in PIECES]
    for sample in range(samples):
        time, end, first = sample * SAMPLE, (sample + 1) * SAMPLE, True
        while time < end:
            piece = max(i for i, start in enumerate(starts) if start <= time + 1e-9)
            later = [start for start in starts if start > time + 1e-9]
            until = min(end, *later) if later else end
            steps = max(1, math.ceil((until - time) / MAX_STEP - 1e-6))
            begin = max(0.0, time - starts[piece])
            rows.append((piece, begin, (until - time) / steps, steps, first))
            time, first = until, False
    piece_, begin_, h, steps_, first_ = zip(*rows, strict=True)
    return Legs(np.array(piece_), np.array(begin_), np.array(h), np.array(steps_), np.array(first_))


def coefficients(
    a: Value, ad: Value, add: Value, rate: Value, accel: Value,
    m: Value, lp: Value, j: Value, mr: Value, jr: Value,
) -> tuple[Value, ...]:  # fmt: skip
    """Return everything that depends on the instant alone.

    Parameters
    ----------
    a, ad, add
        Extension of link 2 with its rate and acceleration.
    rate, accel
        Of the slew reference.
    m, lp, j, mr, jr
        Payload: mass, length, inertia; reported mass and inertia.

    Returns
    -------
    coefficients
        Open-loop torque, 3/a, inverse elastic mass (3), its product with the coupling (2), the
        remaining pivot, velocity terms (8), stiffness (4), axial load (4).
    """
    ml = m * lp
    ia = 1.0 / a
    ia2 = ia * ia
    ad2 = ad * ad
    r = L1 + a
    c = a - (L2 - L1)
    s = c / L1
    s2 = s * s
    s3 = s2 * s
    s4 = s2 * s2
    s5 = s4 * s
    s6 = s3 * s3
    s7 = s4 * s3
    g = 3.0 * s2 - s3
    gs = 6.0 * s - 3.0 * s2
    rigid = RHO1 * L1**3 / 3.0 + RHO2 / 3.0 * (r * r * r - c * c * c)
    rigid_slope = RHO2 * (r * r - c * c)

    mtt = rigid + m * r * (r + lp) + j
    mta = (
        11.0 / 20.0 * RHO1 * L1**2
        + RHO2 * L1**2 * (11.0 / 20.0 - 0.75 * s4 + 0.2 * s5)
        + RHO2 * (r * r - L1**2)
        + (2.0 * r) * m + ml
    )  # fmt: skip
    mtb = (
        RHO2 * (0.75 * L1 * a + 0.55 * a * a)
        + (2.0 * r) * m + (2.5 + 1.5 * L1 * ia) * ml + (3.0 * ia) * j
    )  # fmt: skip
    maa = (
        33.0 / 35.0 * RHO1 * L1
        + RHO2 * L1 * (33.0 / 35.0 - 1.8 * s5 + s6 - s7 / 7.0)
        + 4.0 * RHO2 * a + 4.0 * m
    )  # fmt: skip
    mab = 1.5 * RHO2 * a + 4.0 * m + (3.0 * ia) * ml
    mbb = 33.0 / 35.0 * RHO2 * a + 4.0 * m + (6.0 * ia) * ml + (9.0 * ia2) * j

    determinant = maa * mbb - mab * mab
    eaa = mbb / determinant
    eab = -mab / determinant
    ebb = maa / determinant
    wa = eaa * mta + eab * mtb
    wb = eab * mta + ebb * mtb
    pivot = mtt - wa * mta - wb * mtb

    overhang = (3.0 * L1 * ia2) * ml + (6.0 * ia2) * j
    ctt = ad * (rigid_slope + (2.0 * r) * m + ml)
    cta = ad * (2.0 * RHO2 * r - RHO2 * L1 * s * g + 2.0 * m)
    ctb = ad * (RHO2 * (0.2 * a - 0.5 * L1) + 2.0 * m - (1.5 * ia) * ml - overhang)
    cbt = ad * (2.0 * RHO2 * r + 2.0 * m + (1.5 * ia) * ml)
    caa = ad * RHO2 * (4.0 - g * g)
    cab = -ad * (RHO2 + (6.0 * ia2) * ml)
    cba = 4.0 * RHO2 * ad
    cbb = ad * (33.0 / 35.0 * RHO2 - (6.0 * ia2) * ml - (18.0 * ia2 * ia) * j)

    ktb = ad2 * ((1.5 * ia2) * ml + ia * overhang - 0.9 * RHO2) - add * (
        RHO2 * (1.25 * L1 + 0.9 * a) + (1.5 * ia) * ml + 0.5 * overhang
    )
    kab = (6.0 * ad2 * ia2 * ia) * ml - add * (2.5 * RHO2 + (3.0 * ia2) * ml)
    bend = ad2 * ia * ((6.0 * ia2) * ml + (18.0 * ia2 * ia) * j - 87.0 / 35.0 * RHO2)
    lag = add * (107.0 / 70.0 * RHO2 + (3.0 * ia2) * ml + (9.0 * ia2 * ia) * j)

    g0 = 4.8 - (12.0 * s3 - 9.0 * s4 + 1.8 * s5)
    g1 = 3.3 - (9.0 * s4 - 7.2 * s5 + 1.5 * s6)
    g2 = 87.0 / 35.0 - (7.2 * s5 - 6.0 * s6 + 9.0 / 7.0 * s7)
    q = 0.5 * RHO2 * (L1**2 + a * a) + ml + a * m
    kaa = (
        12.0 * EI1 / L1**3
        + 12.0 * EI2 / L1**3 * (1.0 - s) * (1.0 - s) * (1.0 - s)
        - add / L1 * (g0 * (RHO2 * r + m) - RHO2 * L1 * g1)
    )
    kbb = 12.0 * EI2 * ia2 * ia + bend - lag - add * ((4.8 * ia) * m + 1.5 * RHO2)
    a2 = (g0 * q - 0.5 * RHO2 * L1**2 * g2) / L1
    a2_rate = ad / L1 * (
        g0 * (RHO2 * a + m) - (gs * gs / L1) * q + 0.5 * RHO2 * L1 * s2 * gs * gs
    )  # fmt: skip
    b2 = 4.8 * (m + ia * ml) + 81.0 / 70.0 * RHO2 * a
    b2_rate = ad * (81.0 / 70.0 * RHO2 - (4.8 * ia2) * ml)

    slew = (rigid + mr * r * (r + lp) + jr) * accel + (
        rigid_slope + (2.0 * r) * mr + mr * lp
    ) * (ad * rate)  # fmt: skip
    return (
        slew, 3.0 * ia, eaa, eab, ebb, wa, wb, pivot, ctt, cta, ctb, cbt, caa, cab, cba, cbb,
        ktb, kaa, kab, kbb, a2, a2_rate, b2, b2_rate,
    )  # fmt: skip


def slope(k: tuple[Value, ...], y: tuple[Value, ...], root: Value, tip: Value) -> tuple[Value, ...]:
    """Return the time derivative of (theta, alpha, beta and their rates)."""
    (
        slew, tip_slope, eaa, eab, ebb, wa, wb, pivot, ctt, cta, ctb, cbt, caa, cab, cba, cbb,
        ktb, kaa, kab, kbb, a2, a2_rate, b2, b2_rate,
    ) = k  # fmt: skip
    _, al, be, w, ar, br = y
    a2al, b2be = a2 * al, b2 * be
    ww = w * w
    ft = (
        slew + root + tip - ctt * w - cta * ar - ctb * br - ktb * be
        + w * (2.0 * (a2al * ar + b2be * br) + a2_rate * al * al + b2_rate * be * be)
    )  # fmt: skip
    fa = -(cta * w + caa * ar + cab * br + kaa * al + kab * be + a2al * ww)
    fb = tip_slope * tip - (cbt * w + cba * ar + cbb * br + kbb * be + b2be * ww)
    theta = (ft - wa * fa - wb * fb) / (pivot - a2al * al - b2be * be)
    return w, ar, br, theta, eaa * fa + eab * fb - wa * theta, eab * fa + ebb * fb - wb * theta


def advance(y: tuple[Value, ...], h: float, k: tuple[Value, ...]) -> tuple[Value, ...]:
    """Return the state ``y + h k``."""
    return (
        y[0] + h * k[0], y[1] + h * k[1], y[2] + h * k[2],
        y[3] + h * k[3], y[4] + h * k[4], y[5] + h * k[5],
    )  # fmt: skip


def law(
    y: tuple[Value, ...], angle: float, rate: float, a: float, mr: Value, jr: Value,
    before: tuple[Value, Value], started: float,
) -> tuple[Value, Value, Value, Value]:  # fmt: skip
    """Return the torques of the Lyapunov law before saturation, and the rates it remembers.

    ``before`` are rate error and beta rate of the last sample, ``started`` is 0 at the first
    sample and 1 later.
    """
    r = L1 + a
    jtt = RHO2 / 3.0 * (r**3 - L1**3) + jr + mr * (r * r)
    jtb = RHO2 * (0.75 * L1 * a + 0.55 * a * a) + jr * (3.0 / a) + mr * (2.0 * r)
    error, error_rate, beta_rate = y[0] - angle, y[3] - rate, y[5]
    per_sample = started / SAMPLE
    inertial = jtt * ((error_rate - before[0]) * per_sample) + jtb * (
        (beta_rate - before[1]) * per_sample
    )
    root = -RATE_GAIN * error_rate - ANGLE_GAIN * error - ACCELERATION_GAIN * inertial
    return root, -jtb * beta_rate, error_rate, beta_rate
