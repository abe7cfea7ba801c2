"""Poles of the loop of arm, wheels, sensors and a sampled law.

At a fixed length and small motions everything in the loop is linear: the arm
(``drm_env.Model.linearize``), the wheels with their lag, the delay of the sensors. The law is the
engine's own (``drm_env.ControlLaw``), differentiated about rest by central differences together
with its memory. Between two samples its torques are held, so that the loop is a matrix that takes
one sample to the next, and its eigenvalues tell whether motions die away.

A flight deploys while it slews: a length at a time, as here, is the usual way to judge a gain
schedule, right where the arm changes slowly against the motions judged. The saturation of the
wheels is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

import drm_env

STABLE = 1e-6
"""Growth rate, 1/s, up to which a loop counts as stable: rounding of the differences."""

_SETTLE = 20_000
"""Samples at rest after which the gains of a law's own filter have settled."""

_STEPS = {
    "slew_error": 1e-6,
    "slew_error_rate": 1e-6,
    "link2_deflection": 1e-6,
    "link2_deflection_rate": 1e-6,
    "tip_turn_rate": 1e-6,
    "slew_torque": 1e-3,
    "root_momentum": 1e-3,
    "tip_momentum": 1e-3,
}
"""Measurements that the loop has, and their steps in the differences, SI."""

_SENSED = (
    "slew_angle",
    "slew_rate",
    "link2_deflection",
    "link2_deflection_rate",
    "tip_turn_rate",
)
"""Outputs of the arm that sensors measure, in the order of the measurements above."""


class Stepped(Protocol):
    """A law that is no data: what `drm_env.ControlLaw` has, made for the loop's sampling period."""

    MEASUREMENTS: tuple[str, ...]

    def initial_state(self, n: int) -> NDArray[np.float64]:
        """Return the memory before the first call, shape (n, k)."""

    def torques(
        self, measurements: ArrayLike, state: ArrayLike, start: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return torques (n, 2), N m, and the new memory."""


@dataclass(frozen=True, kw_only=True)
class Loop:
    """What is in the loop besides arm, payload and law.

    Attributes
    ----------
    period
        Sampling period of the law, s.
    lag
        Time constant of both wheels, s.
    delay
        Delay of the sensors, s, in whole periods.
    damping_ratio
        Of every mode of the arm.
    stiffness
        Of the arm, as a part of what the law believes.
    modes
        Assumed modes of each link.
    """

    period: float = 0.002
    lag: float = 0.005
    delay: float = 0.002
    damping_ratio: float = 0.005
    stiffness: float = 1.0
    modes: tuple[int, int] = (4, 4)


def _plant(
    extension: float, mass: float, loop: Loop
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Arm and wheels: x' = A x + B (commands), y = C x; y holds what is measured.

    The states are those of the arm, the two wheels' torques and their momenta.
    """
    arm = drm_env.resolve().to_dict()["scenario"]["arm"]
    for link in arm.values():
        link["bending_stiffness"] *= loop.stiffness
    model = drm_env.Model(
        {"mass": mass},
        arm=arm,
        plant="consistent",
        modes=loop.modes,
        dynamics={"damping_ratio": loop.damping_ratio},
    )
    linear = model.linearize(extension)
    states = len(linear.A)
    whole = np.zeros((states + 4, states + 4))
    whole[:states, :states] = linear.A
    wheels = [linear.inputs.index(name) for name in ("root_torque", "tip_torque")]
    whole[:states, states : states + 2] = linear.B[:, wheels]
    drive = np.zeros((states + 4, 2))
    fast = max(loop.lag, 1e-6 * loop.period)
    for wheel in range(2):
        whole[states + wheel, states + wheel] = -1.0 / fast
        drive[states + wheel, wheel] = 1.0 / fast
        whole[states + 2 + wheel, states + wheel] = -1.0
    seen = np.zeros((len(_SENSED) + 2, states + 4))
    for row, name in enumerate(_SENSED):
        seen[row, :states] = linear.C[linear.outputs.index(name)]
    seen[-2, states + 2] = seen[-1, states + 3] = 1.0
    return whole, drive, seen


def _held(
    a: NDArray[np.float64], b: NDArray[np.float64], period: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A and B over a sampling period in which the input is held."""
    states, inputs = b.shape
    block = np.zeros((states + inputs, states + inputs))
    block[:states, :states], block[:states, states:] = a, b
    over = expm(block * period)
    return over[:states, :states], over[:states, states:]


@dataclass(frozen=True)
class _LinearLaw:
    """torques = P seen + Q memory, memory' = R seen + S memory, about rest."""

    p: NDArray[np.float64]
    q: NDArray[np.float64]
    r: NDArray[np.float64]
    s: NDArray[np.float64]


def _linear_law(
    law: Mapping[str, Any] | Stepped, extension: float, reported: float, period: float
) -> _LinearLaw:
    control: Stepped
    if isinstance(law, Mapping):
        control = drm_env.ControlLaw(
            dict(law), plant="consistent", control_period=period, sample_period=period
        )
    else:
        control = law
    names = control.MEASUREMENTS
    length, width = _dimensions(reported)
    rest = np.zeros((1, len(names)))
    for name, value in {
        "extension": extension,
        "payload_mass": reported,
        "payload_length": length,
        "payload_width": width,
    }.items():
        rest[0, names.index(name)] = value
    memory = control.initial_state(1)
    start = np.ones(1, dtype=bool)
    for _ in range(_SETTLE):
        before = memory
        _, memory = control.torques(rest, memory, start)
        start = np.zeros(1, dtype=bool)
        if np.allclose(before, memory, rtol=1e-9, atol=0.0):
            break
    used = [name for name in _STEPS if name != "slew_torque"]
    steps = [_STEPS[name] for name in used]
    # what is remembered is measured, or of its order
    sizes = np.maximum(np.abs(memory[0]) * 1e-4, 1e-9)
    rows = np.repeat(rest, 2 * (len(used) + memory.shape[1]), axis=0)
    memories = np.repeat(memory, len(rows), axis=0)
    for index, (name, step) in enumerate(zip(used, steps, strict=True)):
        rows[2 * index, names.index(name)] += step
        rows[2 * index + 1, names.index(name)] -= step
    for index, size in enumerate(sizes):
        at = 2 * (len(used) + index)
        memories[at, index] += size
        memories[at + 1, index] -= size
    torques, after = control.torques(rows, memories, np.zeros(len(rows), dtype=bool))
    scale = np.concatenate([steps, sizes])[:, np.newaxis]
    of_torque = ((torques[0::2] - torques[1::2]) / (2.0 * scale)).T
    of_memory = ((after[0::2] - after[1::2]) / (2.0 * scale)).T
    split = len(used)
    return _LinearLaw(
        of_torque[:, :split], of_torque[:, split:], of_memory[:, :split], of_memory[:, split:]
    )


def _dimensions(mass: float) -> tuple[float, float]:
    """Length and width (m) of a payload of Table 2-7, between its rows."""
    payload = drm_env.resolve(payload_mass=mass, mass_error=0.0).context
    return payload["payload_length"], payload["payload_width"]


def closed_loop(
    law: Mapping[str, Any] | Stepped,
    extension: float,
    mass: float,
    *,
    reported: float | None = None,
    loop: Loop | None = None,
) -> NDArray[np.float64]:
    """Return the matrix that takes the loop from one sample to the next.

    Parameters
    ----------
    law
        The law as data, or an object like `drm_env.ControlLaw` that is made for the loop's period.
    extension
        Of link 2, m.
    mass
        True mass of the payload, kg.
    reported
        The mass that the law is told, kg; by default the true one.
    loop
        Sampling, wheels, sensors and damping.
    """
    loop = loop or Loop()
    told = _linear_law(law, extension, mass if reported is None else reported, loop.period)
    a, b, c = _plant(extension, mass, loop)
    a, b = _held(a, b, loop.period)
    delay = round(loop.delay / loop.period)
    states, remembered = len(a), len(told.s)
    # the wheels' momenta are not delayed: they are read at the wheels
    sensed = len(_SENSED)
    lines = sensed * delay
    size = states + lines + remembered
    seen = np.zeros((len(c), size))
    seen[sensed:, :states] = c[sensed:]
    if delay:
        seen[:sensed, states + lines - sensed : states + lines] = np.eye(sensed)
    else:
        seen[:sensed, :states] = c[:sensed]
    memory = np.zeros((remembered, size))
    memory[:, states + lines :] = np.eye(remembered)
    torques = told.p @ seen + told.q @ memory
    whole = np.zeros((size, size))
    whole[:states, :states] = a
    whole[:states] += b @ torques
    if delay:
        whole[states : states + sensed, :states] = c[:sensed]
        for line in range(1, delay):
            at = states + sensed * line
            whole[at : at + sensed, at - sensed : at] = np.eye(sensed)
    whole[states + lines :] = told.r @ seen + told.s @ memory
    return whole


def growth_rate(matrix: NDArray[np.float64], period: float) -> float:
    """Return the rate, 1/s, at which the worst motion of a loop grows; negative where all die away.

    What stays as it is for ever is no motion: the momentum of arm and wheels together, which no
    torque between them changes, and what a law has learned.
    """
    values = np.linalg.eigvals(matrix)
    moving = values[np.abs(values - 1.0) > _STANDING]
    return float(np.log(np.abs(moving).max()) / period)


_STANDING = 1e-7
"""Distance from 1 of eigenvalues that belong to what is conserved."""


@dataclass(frozen=True, kw_only=True)
class StabilityMap:
    """Growth rates of a law over lengths and payloads.

    Attributes
    ----------
    title
        Of the law.
    extensions, masses
        m and kg.
    rates
        1/s, of shape (len(masses), len(extensions)); negative where the loop is stable.
    loop
        What else is in the loop.
    """

    title: str
    extensions: tuple[float, ...]
    masses: tuple[float, ...]
    rates: NDArray[np.float64]
    loop: Loop

    @property
    def stable(self) -> bool:
        """Whether no motion grows anywhere."""
        return bool((self.rates < STABLE).all())

    @staticmethod
    def stacked(maps: Sequence[StabilityMap]) -> StabilityMap:
        """Return one map with the payloads of several of the same law."""
        return StabilityMap(
            title=maps[0].title,
            extensions=maps[0].extensions,
            masses=tuple(mass for one in maps for mass in one.masses),
            rates=np.concatenate([one.rates for one in maps]),
            loop=maps[0].loop,
        )


def stability_map(
    title: str,
    law: Mapping[str, Any] | Stepped,
    extensions: Sequence[float],
    masses: Sequence[float],
    *,
    mass_error: float = 0.0,
    loop: Loop | None = None,
) -> StabilityMap:
    """Return the growth rates of a law; ``mass_error`` is that of the reported mass (a part)."""
    loop = loop or Loop()
    rates = np.array(
        [
            [
                growth_rate(
                    closed_loop(law, a, mass, reported=mass * (1.0 + mass_error), loop=loop),
                    loop.period,
                )
                for a in extensions
            ]
            for mass in masses
        ]
    )
    return StabilityMap(
        title=title,
        extensions=tuple(extensions),
        masses=tuple(masses),
        rates=rates,
        loop=loop,
    )
