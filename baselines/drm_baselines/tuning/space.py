"""What is searched: numbers with their ranges, and why these."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drm_baselines.errors import BaselineError

if TYPE_CHECKING:
    pass

_EDGE = 0.02


@dataclass(frozen=True, kw_only=True)
class Dimension:
    """One number that is searched.

    Attributes
    ----------
    name
        Place in the law's data or name of the setting.
    unit, reason
        For readers; the reason is why the range is what it is.
    low, high
        Range, both ends included.
    log
        Whether orders of magnitude are equally likely, or values.
    integer
        Whether only integers count.
    choices
        The values, where they are no range.
    start
        Value of the first trial, if it is known beforehand.
    """

    name: str
    unit: str
    reason: str
    low: float = math.nan
    high: float = math.nan
    log: bool = True
    integer: bool = False
    choices: tuple[int, ...] = ()
    start: float | None = None

    def holds(self, value: float) -> bool:
        """Tell whether ``value`` can be drawn."""
        return value in self.choices if self.choices else self.low <= value <= self.high

    def at_edge(self, value: float) -> bool:
        """Tell whether ``value`` lies at an end of its range: a wider one may hold a better."""
        if self.choices:
            return False
        low, high, here = self.low, self.high, value
        if self.log:
            low, high, here = math.log(low), math.log(high), math.log(value)
        return not _EDGE <= (here - low) / (high - low) <= 1.0 - _EDGE

    def to_dict(self) -> dict[str, Any]:
        """Return what decides which values are drawn, as plain data."""
        data: dict[str, Any] = {"name": self.name, "unit": self.unit}
        if self.choices:
            return {**data, "choices": list(self.choices), "start": self.start}
        return {**data, "low": self.low, "high": self.high, "log": self.log,
                "integer": self.integer, "start": self.start}  # fmt: skip


def _cutoff(wheel: str, start: float) -> Dimension:
    return Dimension(
        name=f"{wheel}.filter.cutoff",
        unit="rad/s",
        low=0.3,
        high=1e3,
        start=start,
        reason="from below the slowest mode (19 rad/s at 8 m with 500 kg) to nothing at 2 ms",
    )


_FILTERED_RATE = Dimension(
    name="root.rate_gain", unit="N m s/rad", low=1e3, high=3e5, start=1e4, reason="as for linear",
)  # fmt: skip
_FILTERED_ANGLE = Dimension(
    name="root.angle_gain", unit="N m/rad", low=1e2, high=1e6, start=1e3,
    reason="as for linear, and less where the rate may be fed back only a little",
)  # fmt: skip

GAINS: dict[str, tuple[Dimension, ...]] = {
    "linear": (
        Dimension(
            name="root.rate_gain",
            unit="N m s/rad",
            low=1e3,
            high=3e5,
            start=8e4,
            reason="full torque at 0.1 rad/s, down to 0.3 mrad/s, where the wheel only switches",
        ),
        Dimension(
            name="root.angle_gain",
            unit="N m/rad",
            low=1e3,
            high=1e6,
            start=8e3,
            reason="full torque at 0.1 rad, down to 0.1 mrad (1.5 mm at the tip)",
        ),
        Dimension(
            name="tip.rate_gain",
            unit="N s",
            low=1.0,
            high=5e4,
            start=500.0,
            reason="from no damping to full torque at beta' of 0.2 mm/s",
        ),
    ),
    "lyapunov": (
        Dimension(
            name="root.rate_gain",
            unit="N m s/rad",
            low=1e3,
            high=3e5,
            start=3e4,
            reason="as for linear",
        ),
        Dimension(
            name="root.angle_gain",
            unit="N m/rad",
            low=1e3,
            high=1e6,
            start=3e3,
            reason="as for linear",
        ),
        Dimension(
            name="root.acceleration_gain",
            unit="1",
            low=1e-6,
            high=1.0,
            start=2e-4,
            reason="from nothing of the inertial moment to all of it",
        ),
        Dimension(
            name="tip.gain",
            unit="1/s",
            low=1e-3,
            high=1e2,
            start=1.0,
            reason="times Jtb, 850 to 16,000 kg m: the range of linear's gain and more",
        ),
    ),
    "lqr": (
        Dimension(
            name="root_effort",
            unit="mm",
            low=0.1,
            high=1e3,
            reason="full torque is worth 0.1 mm of tip error (the wheel switches) to 1 m (rests)",
        ),
        Dimension(
            name="tip_effort",
            unit="mm",
            low=1e-2,
            high=1e3,
            reason="as for the root, the tip wheel being ten times weaker",
        ),
        Dimension(
            name="rate",
            unit="s",
            low=1e-2,
            high=1e2,
            reason="the error's rate counts from not at all to alone: manoeuvres last 30 s",
        ),
        Dimension(
            name="vibration",
            unit="s",
            low=1e-3,
            high=1e2,
            reason="as the rate; vibration is faster, at 1 to 10 rad/s",
        ),
    ),
    "linear_filtered": (
        _FILTERED_RATE,
        _FILTERED_ANGLE,
        _cutoff("root", 3.0),
        Dimension(
            name="tip.rate_gain", unit="N s", low=1.0, high=5e4, start=50.0, reason="as for linear",
        ),
        _cutoff("tip", 10.0),
    ),
    "lyapunov_filtered": (
        _FILTERED_RATE,
        _FILTERED_ANGLE,
        Dimension(
            name="root.acceleration_gain", unit="1", low=1e-6, high=1.0, start=2e-4,
            reason="as for lyapunov",
        ),
        _cutoff("root", 3.0),
        Dimension(
            name="tip.gain", unit="1/s", low=1e-4, high=1e2, start=1e-2, reason="as for lyapunov",
        ),
        _cutoff("tip", 10.0),
    ),
    "linear_collocated": (
        _FILTERED_RATE,
        _FILTERED_ANGLE,
        _cutoff("root", 3.0),
        Dimension(
            name="tip.turn_gain", unit="N m s/rad", low=1.0, high=1e5, start=300.0,
            reason="full torque at 10 rad/s, down to 0.1 mrad/s, the gyro's noise",
        ),
        _cutoff("tip", 30.0),
    ),
    "collocated": (
        Dimension(
            name="root.frequency", unit="rad/s", low=0.02, high=2.0, start=0.1,
            reason="slower than a flight, up to nearly the slowest mode",
        ),
        Dimension(
            name="root.damping", unit="1", low=0.3, high=10.0, start=0.5,
            reason="from an overshoot to a slow return",
        ),
        _cutoff("root", 3.0),
        Dimension(
            name="tip.turn_gain.0.0", unit="N m s/rad", low=1.0, high=1e5, start=100.0,
            reason="as for linear_collocated",
        ),
        Dimension(
            name="tip.turn_gain.0.1", unit="N m s/rad", low=1.0, high=1e5, start=10.0,
            reason="as above, for the length",
        ),
        Dimension(
            name="tip.turn_gain.1.0", unit="N m s/rad", low=1.0, high=1e5, start=10.0,
            reason="as above, for the mass",
        ),
        Dimension(
            name="tip.turn_gain.1.1", unit="N m s/rad", low=1.0, high=1e5, start=10.0,
            reason="as above, for both",
        ),
        _cutoff("tip", 30.0),
    ),
}  # fmt: skip
"""What is searched for each law: gains of ``linear`` and ``lyapunov``, where the first trial is the
thesis' own choice, and weights of ``lqr``
(:func:`drm_baselines.optimal_control.scheduled_lqr.gains_at`)."""

SETTINGS: dict[str, tuple[Dimension, ...]] = {
    "receding": (
        Dimension(
            name="smoothing", unit="m", low=1e-6, high=1e-2, start=1e-4,
            reason="a change of a torque by its limit is worth less than the best manoeuvres' "
            "error, or more than that of saturated ones",
        ),
        Dimension(
            name="authority", unit="1", low=0.95, high=0.999, log=False, start=0.998,
            reason="what is left for the feedback: next to nothing to a twentieth; what is within "
            "0.001 of it counts as saturated",
        ),
        Dimension(
            name="effort", unit="m", low=1e-5, high=1e-1, start=1e-3,
            reason="full torque is worth 0.01 mm (the feedback follows the noise) to 10 cm (rests)",
        ),
        Dimension(
            name="sway", unit="s", low=1e-5, high=1e-2, start=3e-4,
            reason="from nothing to ten times what leaves the tip error as it is",
        ),
        Dimension(
            name="disturbance", unit="1", low=1e-3, high=0.3, start=0.02,
            reason="unknown torques of 0.1 % of the limits (the model is exact) to a third",
        ),
        Dimension(
            name="tolerance", unit="1", low=5e-4, high=2e-2, start=2e-3,
            reason="the mass is known to 1e-4 after a second; a reported one is 5 % wrong",
        ),
        Dimension(
            name="period", unit="s", low=0.5, high=4.0, start=1.0,
            reason="a plan takes a tenth of a second, so not more often than twice a second",
        ),
        Dimension(
            name="drift", unit="m", low=5e-6, high=1e-3, start=5e-5,
            reason="from the error of the best manoeuvres to that of saturated ones",
        ),
    ),
}  # fmt: skip
"""What is searched for each controller, beginning with the settings that were chosen by hand."""

_PPO = (
    Dimension(
        name="learning_rate",
        unit="1",
        low=1e-4,
        high=1e-2,
        reason="Adam's default 1e-3 and an order of magnitude to both sides",
    ),
    Dimension(
        name="forgetting",
        unit="1",
        low=3e-3,
        high=0.1,
        reason="1 - gamma a decision: 1 to 30 s at 10 Hz, a manoeuvre lasts 20 s",
    ),
    Dimension(
        name="gae_lambda",
        unit="1",
        low=0.5,
        high=1.0,
        log=False,
        reason="from mostly the critic's word to none of it",
    ),
    Dimension(
        name="clip_range",
        unit="1",
        low=0.05,
        high=0.4,
        reason="the usual 0.2, halved twice and doubled",
    ),
    Dimension(
        name="log_std_init",
        unit="1",
        low=-3.0,
        high=0.0,
        log=False,
        reason="exploration starts at 5 to 100 % of the torque limits",
    ),
    Dimension(
        name="width",
        unit="1",
        choices=(16, 32, 64, 128, 256),
        reason="units of each hidden layer; the laws need a handful",
    ),
    Dimension(
        name="n_epochs",
        unit="1",
        low=2,
        high=15,
        integer=True,
        reason="the usual 10, half as much again and divided by five",
    ),
    Dimension(
        name="minibatches",
        unit="1",
        choices=(5, 10, 20, 40),
        reason="parts that an update's samples are divided into; they divide all of them",
    ),
)

_SAC = (
    Dimension(
        name="learning_rate",
        unit="1",
        low=5e-5,
        high=5e-3,
        reason="the usual 3e-4 and an order of magnitude to both sides",
    ),
    Dimension(
        name="forgetting",
        unit="1",
        low=1e-3,
        high=0.1,
        reason="1 - gamma a decision: 1 to 100 s at 10 Hz, a manoeuvre lasts 20 s",
    ),
    Dimension(
        name="tau",
        unit="1",
        low=1e-3,
        high=5e-2,
        reason="the target follows the critic within 20 to 1000 updates",
    ),
    Dimension(
        name="log_std_init",
        unit="1",
        low=-4.0,
        high=-1.0,
        log=False,
        reason="exploration starts at 2 to 40 % of the torque limits",
    ),
    Dimension(
        name="width",
        unit="1",
        choices=(32, 64, 128, 256),
        reason="units of each hidden layer; wider ones are too slow for a search",
    ),
    Dimension(
        name="batch_size",
        unit="1",
        choices=(128, 256, 512, 1024),
        reason="the usual 256 and two doublings",
    ),
    Dimension(
        name="gradient_steps",
        unit="1",
        low=2,
        high=64,
        integer=True,
        reason="updates of the networks every train_freq steps of all environments",
    ),
    Dimension(
        name="target_entropy",
        unit="1",
        low=-12.0,
        high=-2.0,
        log=False,
        reason="the usual -2, minus the number of actions, is noise that shakes the arm",
    ),
)


def _of(space: tuple[Dimension, ...], *names: str) -> tuple[Dimension, ...]:
    return tuple(dimension for dimension in space if dimension.name in names)


def _without(space: tuple[Dimension, ...], *names: str) -> tuple[Dimension, ...]:
    return tuple(dimension for dimension in space if dimension.name not in names)


LEARNING: dict[str, tuple[Dimension, ...]] = {
    "ppo": _PPO,
    "sac": _SAC,
    "td3": (
        *_without(_SAC, "log_std_init", "target_entropy"),
        Dimension(
            name="action_noise",
            unit="1",
            low=0.02,
            high=0.5,
            reason="exploration at 2 to 50 % of the torque limits, at every decision anew",
        ),
        Dimension(
            name="target_policy_noise",
            unit="1",
            low=0.01,
            high=0.3,
            reason="the usual 0.2 and less: what smooths the critic over actions",
        ),
    ),
    "tqc": (
        *_SAC,
        Dimension(
            name="top_quantiles_to_drop_per_net",
            unit="1",
            choices=(0, 1, 2, 5),
            reason="of 25 quantiles: the usual 2, fewer, and 5",
        ),
    ),
    # it has no target networks that could follow
    "crossq": _without(_SAC, "tau"),
    "recurrent_ppo": (
        *_without(_PPO, "width", "n_epochs", "minibatches"),
        Dimension(
            name="lstm_units",
            unit="1",
            choices=(32, 64, 128),
            reason="what is remembered: more takes as much longer",
        ),
        *_of(_PPO, "width"),
        Dimension(
            name="n_epochs",
            unit="1",
            low=2,
            high=10,
            integer=True,
            reason="as for PPO; an epoch through the memory is slow",
        ),
        *_of(_PPO, "minibatches"),
    ),
}
"""What is searched for each learning algorithm, around the packaged settings; these are the first
trial."""

TARGETS = (*GAINS, *SETTINGS, *LEARNING)
"""Everything that can be tuned."""


def check_target(name: str, known: Sequence[str] = TARGETS) -> str:
    """Return ``name`` if it can be tuned.

    Raises
    ------
    BaselineError
        It cannot; the message lists what can.
    """
    if name not in known:
        raise BaselineError(f"{name!r} cannot be tuned; there are {', '.join(known)}")
    return name
