"""The missions that an arm is sized for: a payload, an error of its mass, a set of manoeuvres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.support.seeds import episode_seeds
from drm_env.constants import TABLE_2_7


@dataclass(frozen=True, kw_only=True)
class Missions:
    """What is drawn, all else as in the thesis' standard manoeuvre.

    Attributes
    ----------
    payload
        Mass of the payload, kg, or the lowest and the highest that are drawn.
    mass_error
        Largest error of the reported mass, as a part of the true one; drawn evenly up and down.
    options
        Options of an environment, as for ``drm_env.sample_scenarios``: fixed or drawn.
    """

    payload: float | tuple[float, float]
    mass_error: float = 0.15
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what is given twice, or no error.

        Raises
        ------
        BaselineError
            A payload or mass error among the options, or an error that no mass has.
        """
        for name in ("payload_mass", "mass_error", "reported_payload_mass"):
            if name in self.options:
                raise BaselineError(f"{name} is given by --payload and --mass-error, not by --set")
        if not 0.0 <= self.mass_error < 1.0:
            raise BaselineError(
                f"--mass-error must be at least 0 and below 1, got {self.mass_error:g}"
            )

    def draw(self, seed: int, count: int) -> list[dict[str, Any]]:
        """Return missions ``seed .. seed + count - 1``."""
        episode_seeds(seed, count)
        error = self.mass_error
        drawn: dict[str, Any] = {
            **self.options,
            "payload_mass": self.payload,
            "mass_error": (-error, error) if error > 0.0 else 0.0,
        }
        return drm_env.sample_scenarios("slew_thesis", seed=seed, n=count, **drawn)


def payload_of_class(number: int) -> float:
    """Return the mass of one of the thesis' payloads, Table 2-7, kg.

    Raises
    ------
    BaselineError
        No such payload.
    """
    masses = [mass for mass, _, _ in TABLE_2_7 if mass > 0.0]
    if not 0 <= number < len(masses):
        raise BaselineError(
            f"--payload-class must be 0 to {len(masses) - 1}, Table 2-7 has no other; got {number}"
        )
    return float(masses[number])


@dataclass(frozen=True, kw_only=True)
class Corner:
    """A mission with the mass wrong by all that it can be.

    Attributes
    ----------
    payload, mass_error
        kg, and a part of it.
    root_momentum
        That the root wheel stores at most when it is flown, N m s.
    by_hand
        max |(I_reported - I) theta'|: what a wheel with torque enough would store, N m s.
    """

    payload: float
    mass_error: float
    root_momentum: float
    by_hand: float


def corners(missions: Missions, law: Mapping[str, Any], seed: int) -> list[Corner]:
    """Return the lightest and the heaviest payload, reported too small and too large.

    All else is as in the mission of ``seed``.
    """
    (base,) = missions.draw(seed, 1)
    slew = base["slew"]
    final_time = drm_env.slew_final_time(
        slew["angle"], slew["max_accel"], slew["profile"], slew["smoothing"]
    )
    masses = np.unique(np.atleast_1d(missions.payload))
    cases = [(float(mass), sign * missions.mass_error) for mass in masses for sign in (-1.0, 1.0)]
    scenarios = [
        {
            **base,
            "payload": {"mass": mass, "inertia": base["payload"]["inertia"]},
            "reported_payload": {},
            "mass_error": error,
        }
        for mass, error in cases
    ]
    flown = drm_env.rollout(scenarios, law=dict(law), signals=["root_momentum"])
    found = []
    for index, (mass, error) in enumerate(cases):
        by_hand = drm_env.slew_demands(
            {
                "arm": base["arm"],
                "payload": scenarios[index]["payload"],
                "slew": {"angle": slew["angle"]},
                "deployment": base["deployment"],
            },
            final_time=final_time,
            profile=slew["profile"],
            smoothing=slew["smoothing"],
            mass_error=abs(error),
        )["root_wheel_momentum"]
        peak = float(np.nanmax(np.abs(flown.trajectories["root_momentum"][index])))
        found.append(Corner(payload=mass, mass_error=error, root_momentum=peak, by_hand=by_hand))
    return found
