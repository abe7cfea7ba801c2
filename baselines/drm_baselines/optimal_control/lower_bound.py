"""What is possible: the least tip error of a manoeuvre, with the true payload known.

The convex programme of :mod:`drm_baselines.optimal_control.quadratic_program` is solved without
smoothing, its torques are flown through the engine with ideal wheels (limits only), and the part of
the error that the linear model misses (second order in the deflection) is put back into the
programme until model and flight agree. What is reported is what was flown.

Torques are held for 20 ms, so that the programme is small. A finer grid lowers the figures of
manoeuvres that are possible within micrometres anyhow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.optimal_control.quadratic_program import (
    Programme,
    propagate,
    rms,
    torque_limits,
)
from drm_baselines.policies.pilots import refuse_missions
from drm_baselines.support import cores
from drm_env.constants import LAW_PERIOD, SIGNAL_NAMES

HOLD = 10
"""Samples that the torques are held for."""

AGREEMENT = 0.01
"""Relative difference of predicted and flown tip error at which a bound is accepted."""

_ROUNDS = 3
_FLOOR = 1e-6  # m; below a micrometre a relative difference says nothing

# Units of the tip error and scales of the states in the order in which they are tried: the first is
# exact where the bound is micrometres, the others are solved where the wheels saturate throughout.
_SCALINGS = ((1e-2, 1e-3), (0.3, 1e-4), (1.0, 1e-3))

_Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Bound:
    """The best torques of one manoeuvre.

    Attributes
    ----------
    torques
        Of root and tip wheel, N m, shape (intervals, 2), each held for :data:`HOLD` samples.
    predicted
        RMS of the tip error by the programme, m.
    flown
        The same as the engine flew it, m.
    solved
        Whether the solver reached its tolerance.
    metrics
        All metrics of the flight by name.
    """

    torques: _Array
    predicted: float
    flown: float
    solved: bool
    metrics: Mapping[str, float]


def ideal(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scenario whose wheels follow at once and store any momentum, as the bound's do."""
    plain = {key: value for key, value in scenario.items() if key != "sensors"}
    for wheel in ("root_wheel", "tip_wheel"):
        if wheel in plain:
            limit = {"torque_limit"} & set(plain[wheel])
            plain[wheel] = {key: plain[wheel][key] for key in limit}
    return plain


def fly(scenario: Mapping[str, Any], torques: _Array) -> tuple[_Array, dict[str, float]]:
    """Return the tip error r e + y (m) after each sample under held torques, and the metrics."""
    names = ["slew_angle", "reference_angle", "tip_deflection", "extension"]
    flown = drm_env.rollout(
        [scenario], torques=torques[None], hold=HOLD, signals=names, num_threads=1
    )
    angle, reference, deflection, extension = (flown.trajectories[name][0, 1:] for name in names)
    default = drm_env.default_config().scenario.arm.link1.length
    link1 = float(scenario.get("arm", {}).get("link1", {}).get("length", default))
    metrics = {name: float(values[0]) for name, values in flown.items()}
    return (link1 + extension) * (angle - reference) + deflection, metrics


def _refined(
    scenario: Mapping[str, Any],
    model: drm_env.Transitions,
    limits: _Array,
    unit: float,
    scale: float,
) -> Bound:
    """Solve, fly, and put what the model missed back into the programme until the two agree."""
    programme = Programme(model, limits, unit=unit, scale=scale)
    offset = model.error_offset
    best: Bound | None = None
    for _ in range(_ROUNDS):
        held, _, solved = programme.solve(offset)
        torques = np.clip(held, -limits, limits)
        _, predicted = propagate(model._replace(error_offset=offset), torques)
        errors, metrics = fly(scenario, torques)
        found = Bound(
            torques=torques,
            predicted=rms(predicted),
            flown=rms(errors),
            solved=solved,
            metrics=metrics,
        )
        if best is None or found.flown < best.flown:
            best = found
        agreed = abs(found.flown - found.predicted) <= AGREEMENT * found.flown + _FLOOR
        if agreed or not solved:
            break
        offset = offset + errors.reshape(offset.shape) - predicted
    assert best is not None, "there is at least one round"
    return best


def bound_of(scenario: Mapping[str, Any]) -> Bound:
    """Return the best torques of one manoeuvre, for its true payload and with ideal wheels.

    Raises
    ------
    drm_env.ConfigError
        A scenario that cannot be flown, or whose samples :data:`HOLD` does not divide.
    """
    plain = ideal(scenario)
    model, limits = drm_env.transitions(plain, hold=HOLD), torque_limits(plain)
    best: Bound | None = None
    for unit, scale in _SCALINGS:
        found = _refined(plain, model, limits, unit, scale)
        if best is None or (found.solved, -found.flown) > (best.solved, -best.flown):
            best = found
        if best.solved:
            break
    assert best is not None, "there is at least one scaling"
    return best


class BoundPilot:
    """The bound as who flies: the best torques of each manoeuvre, solved for its true payload.

    Parameters
    ----------
    name
        In commands and files.
    """

    control_period = HOLD * LAW_PERIOD

    def __init__(self, name: str = "bound") -> None:
        self.name = name

    @property
    def details(self) -> Mapping[str, Any]:
        """Nothing: there is one bound."""
        return {}

    def fly(
        self,
        scenarios: Sequence[Mapping[str, Any]],
        *,
        seed: int | Sequence[int] = 0,  # noqa: ARG002
        progress: Callable[[int, int], None] | None = None,
    ) -> dict[str, _Array]:
        """See :class:`drm_baselines.policies.pilots.Pilot`; nothing is measured, so no noise is.

        Besides the engine's metrics ``bound_predicted``, the RMS of the tip error by the programme
        (m), and ``bound_solved``, whether the solver reached its tolerance.

        Raises
        ------
        BaselineError
            A flight that diverged, with the scenario's place; a mission.
        """
        refuse_missions(self.name, scenarios)
        bounds = bounds_of(scenarios, progress=progress)
        found = {
            name: np.array([bound.metrics[name] for bound in bounds])
            for name in bounds[0].metrics
            if name != "episode_return"
        }
        found["bound_predicted"] = np.array([bound.predicted for bound in bounds])
        found["bound_solved"] = np.array([float(bound.solved) for bound in bounds])
        return found

    def trajectory(
        self,
        scenario: Mapping[str, Any],
        *,
        seed: int = 0,  # noqa: ARG002
        decimation: int = 1,
    ) -> drm_env.Trajectory:
        """See :class:`drm_baselines.policies.pilots.Pilot`; missions are refused."""
        refuse_missions(self.name, [scenario])
        torques = bound_of(scenario).torques
        return drm_env.rollout(
            [ideal(scenario)],
            torques=torques[None],
            hold=HOLD,
            signals=SIGNAL_NAMES,
            decimation=decimation,
        ).trajectory(0)


def bounds_of(
    scenarios: Sequence[Mapping[str, Any]],
    *,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Bound]:
    """Return the bounds of many manoeuvres, solved side by side.

    Parameters
    ----------
    scenarios
        As for ``drm_env.rollout``.
    threads
        How many at a time; by default one a processor.
    progress
        Called with (done, total).

    Raises
    ------
    BaselineError
        A flight that diverged, with the scenario's place.
    """
    found: list[Bound] = []
    with ThreadPoolExecutor(max_workers=threads or cores.count()) as pool:
        for index, bound in enumerate(pool.map(bound_of, scenarios)):
            if not np.isfinite(bound.flown):
                raise BaselineError(f"scenarios[{index}]: the flight of the bound diverged")
            found.append(bound)
            if progress is not None:
                progress(index + 1, len(scenarios))
    return found
