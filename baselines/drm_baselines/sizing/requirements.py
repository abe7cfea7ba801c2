"""What a part of all missions needs at most, from the order statistics of drawn ones.

Of n independent missions the k-th smallest need is above the p-quantile of all missions with the
probability that fewer than k of n draws fall below it, a binomial sum. So the smallest k with at
least the asked confidence gives a bound that assumes nothing of the distribution
(``scipy.stats.quantile_test``). Fresh missions, flown with wheels of that size, check it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import drm_env
from drm_baselines.errors import BaselineError
from drm_env.constants import LOAD_NAMES

Needs = dict[str, NDArray[np.float64]]


class Need(NamedTuple):
    """Something that a mission needs, and that an arm has to give.

    Attributes
    ----------
    label, unit
        In tables and pictures; SI.
    signal
        Whose largest magnitude it is.
    """

    label: str
    unit: str
    signal: str


NEEDS: dict[str, Need] = {
    "root_wheel_momentum": Need("root wheel, momentum", "N m s", "root_momentum"),
    "root_wheel_torque": Need("root wheel, torque", "N m", "root_torque"),
    "tip_wheel_momentum": Need("tip wheel, momentum", "N m s", "tip_momentum"),
    "tip_wheel_torque": Need("tip wheel, torque", "N m", "tip_torque"),
    "motor_torque": Need("slew motor, torque", "N m", "slew_torque"),
    "motor_power": Need("slew motor, power", "W", "motor_power"),
    "deployment_force": Need("deployment, force", "N", "deployment_force"),
    "link1_bending_moment": Need("link 1, bending moment", "N m", "root_bending_moment_link1"),
    "link1_shear": Need("link 1, shear", "N", "root_shear_link1"),
    "link2_bending_moment": Need("link 2, bending moment", "N m", "root_bending_moment_link2"),
    "link2_shear": Need("link 2, shear", "N", "root_shear_link2"),
    "deflection": Need("tip, deflection", "m", "tip_deflection"),
}
"""What is sized; moments and shears of a link at its root. A wheel with a torque limit shows what a
law asks of it only up to that."""

_CHUNK = 200
"""Flights of one call: their torques take some tens of megabytes."""

_SLACK = 1e-9


@dataclass(frozen=True, kw_only=True)
class Requirement:
    """What a part of the missions needs at most.

    Attributes
    ----------
    name
        One of `NEEDS`.
    quantile
        Of the missions flown.
    low, high
        Two-sided interval of the quantile of all missions, at the confidence asked for; where
        there are too few for an upper end, it is infinite.
    size
        One-sided upper bound: enough for the part asked for, with that confidence.
    largest
        Of all missions flown.
    """

    name: str
    quantile: float
    low: float
    high: float
    size: float
    largest: float


def fewest_missions(fraction: float, confidence: float) -> int:
    """Return how many missions it takes before their largest need is a bound.

    All n below the quantile have the probability fraction^n, which is to be at most 1 - confidence.
    """
    return math.ceil(math.log(1.0 - confidence) / math.log(fraction))


def fly_needs(
    scenarios: Sequence[Mapping[str, Any]],
    law: Mapping[str, Any],
    *,
    seed: int = 0,
    progress: Callable[[int, int], object] | None = None,
) -> Needs:
    """Fly missions; return what each needs, by the names of `NEEDS`, each of shape (missions,).

    Raises
    ------
    BaselineError
        A mission that diverges, whose needs say nothing.
    """
    found: dict[str, list[NDArray[np.float64]]] = {name: [] for name in NEEDS}
    for first in range(0, len(scenarios), _CHUNK):
        part = scenarios[first : first + _CHUNK]

        def tell(done: int, _: int, first: int = first) -> None:
            if progress is not None:
                progress(first + done, len(scenarios))

        flown = drm_env.rollout(
            part,
            law=dict(law),
            loads=True,
            signals=[need.signal for need in NEEDS.values() if need.signal not in LOAD_NAMES],
            seed=seed + first,
            progress=tell,
        )
        if lost := int((flown["diverged"] > 0.0).sum()):
            raise BaselineError(
                f"{lost} of the first {first + len(part)} missions diverge under the law "
                f"{law.get('name')!r}: no arm can be sized for them"
            )
        for name, need in NEEDS.items():
            signal = flown.trajectories.get(need.signal)
            peaks = (
                flown[f"{need.signal}_peak"]
                if signal is None
                else np.nanmax(np.abs(signal), axis=1)
            )
            found[name].append(np.asarray(peaks))
    return {name: np.concatenate(columns) for name, columns in found.items()}


def requirements(needs: Needs, fraction: float, confidence: float) -> list[Requirement]:
    """Return what ``fraction`` of all missions need at most, with ``confidence``.

    Raises
    ------
    BaselineError
        Parts that are none, or too few missions: the message says how many it takes.
    """
    for name, value in (("--fraction", fraction), ("--confidence", confidence)):
        if not 0.0 < value < 1.0:
            raise BaselineError(f"{name} must be between 0 and 1, got {value:g}")
    count = len(next(iter(needs.values())))
    fewest = fewest_missions(fraction, confidence)
    if count < fewest:
        raise BaselineError(
            f"{count} missions are too few to bound what {fraction:.6g} of all need with a "
            f"confidence of {confidence:.6g}: it takes at least {fewest}"
        )
    found = []
    for name, values in needs.items():
        both = stats.quantile_test(values, p=fraction, alternative="two-sided")
        above = stats.quantile_test(values, p=fraction, alternative="less")
        interval: Any = both.confidence_interval(confidence)
        bound: Any = above.confidence_interval(confidence)
        found.append(
            Requirement(
                name=name,
                quantile=float(np.quantile(values, fraction, method="inverted_cdf")),
                low=float(interval.low),
                high=float(interval.high),
                size=float(bound.high),
                largest=float(values.max()),
            )
        )
    return found


@dataclass(frozen=True, kw_only=True)
class Check:
    """How many fresh missions a size is enough for.

    Attributes
    ----------
    name
        One of `NEEDS`.
    size
        That is checked.
    within, missions
        How many needed no more, of how many.
    low, high
        Exact two-sided interval (Clopper-Pearson) of the part of all missions.
    """

    name: str
    size: float
    within: int
    missions: int
    low: float
    high: float

    @property
    def part(self) -> float:
        """Part of the fresh missions that needed no more."""
        return self.within / self.missions


def limited(
    scenario: Mapping[str, Any], *, root: Mapping[str, float], tip: Mapping[str, float]
) -> dict[str, Any]:
    """Return a scenario whose wheels have these limits in place of their own."""
    return {
        **scenario,
        "root_wheel": {**scenario["root_wheel"], **root},
        "tip_wheel": {**scenario["tip_wheel"], **tip},
    }


def check(
    scenarios: Sequence[Mapping[str, Any]],
    law: Mapping[str, Any],
    sizes: Mapping[str, float],
    *,
    seed: int = 0,
    confidence: float = 0.95,
    progress: Callable[[int, int], object] | None = None,
) -> list[Check]:
    """Fly fresh missions with wheels that store no more than their sizes; count who needed less.

    A wheel that fills up was too small: it counts against its size, as does every load above its.
    """
    bounded = [
        limited(
            scenario,
            root=_momentum(sizes["root_wheel_momentum"]),
            tip=_momentum(sizes["tip_wheel_momentum"]),
        )
        for scenario in scenarios
    ]
    needs = fly_needs(bounded, law, seed=seed, progress=progress)
    found = []
    for name, values in needs.items():
        size = sizes[name]
        # a wheel that is full stores exactly its size
        full = name.endswith("_momentum") and name.split("_")[1] == "wheel"
        most = size * (1.0 - _SLACK) if full and size > 0.0 else size * (1.0 + _SLACK)
        within = int((values <= most).sum())
        interval = stats.binomtest(within, len(values)).proportion_ci(confidence)
        found.append(
            Check(
                name=name,
                size=size,
                within=within,
                missions=len(values),
                low=float(interval.low),
                high=float(interval.high),
            )
        )
    return found


def _momentum(limit: float) -> dict[str, float]:
    # a wheel that was never used has no limit
    return {"momentum_limit": limit} if limit > 0.0 else {}
