"""The search for a manoeuvre: candidates are flown and made slower until they keep their limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_env._manoeuvres import law_json
from drm_env.errors import ConfigError, InfeasibleError
from drm_env.kinematics import lengths
from drm_env.profiles import slew_acceleration
from drm_env.rigid_demands import Manoeuvre, demands_of
from drm_env.rollouts import rollout
from drm_env.simulation import LawLike
from drm_env.slew_limits import LIMITED, SlewLimits

Progress = Callable[[str, int, int], object]
"""Called with what is being done, how much is done and how much there is."""

MEASURED = {
    "motor_torque": "motor_torque_peak",
    "motor_rate": "motor_speed_peak",
    "deployment_force": "deployment_force_peak",
    "root_wheel_momentum": "root_wheel_momentum_peak",
    "tip_wheel_momentum": "tip_wheel_momentum_peak",
    "deflection": "peak_deflection",
    "residual": "residual_peak",
    "root_bending_moment": "root_bending_moment_link1_peak",
    "root_shear": "root_shear_link1_peak",
    "link2_bending_moment": "root_bending_moment_link2_peak",
    "link2_shear": "root_shear_link2_peak",
    "motor_power": "motor_power_peak",
    "energy": "slew_energy",
    "vibration": "residual_rms",
}
"""Metrics of what a flight needs. The motor's rate is the reference's unless it is limited."""

_ROUNDS = 25
"""Most times that a candidate is made slower; each time it is slower by what it lacks."""
_PATIENCE = 4
"""Times that slowness may not help before a candidate is given up."""
_LONGEST = 3600.0
"""Longest slew that is thought of, s."""
_MARGIN = 1e-4
"""Part by which candidates are slower than the rigid arm allows: peaks lie between places."""
_CHUNK = 256
"""Flights of one call: their signals take some tens of megabytes."""
_GENTLE = 0.1
"""Acceleration of the tip in the flight from which a first time is guessed, m/s^2."""
_HURRY = 0.5
"""Part of a guessed time from which candidates are made slower."""
_NOTHING = 1e-9
"""Part of a limit that is none of it."""


@dataclass(frozen=True, kw_only=True)
class SlewCandidate:
    """One manoeuvre that was flown.

    Attributes
    ----------
    profile, smoothing
        its shape.
    final_time
        of the whole manoeuvre, s.
    max_accel
        of the slew, rad/s^2.
    values
        what it needs, the largest over all mass errors flown: the names of `LIMITED`, and
        ``motor_power`` (electrical power of the slew motor, W), ``energy`` (its integral, J),
        ``vibration`` (RMS deflection of the tip after the slew, m) and ``momentum`` (the larger of
        both wheels', N m s). NaN where it diverged.
    worst
        the limit that it uses most of, and the part used; ``None`` without limits.
    """

    profile: str
    smoothing: float
    final_time: float
    max_accel: float
    values: Mapping[str, float]
    worst: tuple[str, float] | None

    @property
    def feasible(self) -> bool:
        """Whether it flew without passing a limit."""
        flew = not math.isnan(self.values["vibration"])
        return flew and (self.worst is None or self.worst[1] <= 1.0 + 1e-9)

    def value(self, name: str) -> float:
        """The final time or one of the values."""
        return self.final_time if name == "final_time" else self.values[name]

    def to_dict(self) -> dict[str, Any]:
        """Plain data: shape, time, values, feasibility and the limit that is used most."""
        return {
            "profile": self.profile,
            "smoothing": self.smoothing,
            "final_time": self.final_time,
            "max_accel": self.max_accel,
            **self.values,
            "feasible": self.feasible,
            "tightest_limit": None if self.worst is None else self.worst[0],
            "part_used": None if self.worst is None else self.worst[1],
        }


class SlewSearch:
    """Candidates of one manoeuvre, flown as they are asked for."""

    def __init__(
        self,
        job: Manoeuvre,
        limits: SlewLimits,
        law: LawLike,
        shapes: Sequence[tuple[str, float]],
        watch: float,
        num_threads: int | None,
        progress: Progress | None,
    ) -> None:
        self.job = job
        self.limits = limits.given()
        self.law = law
        self.idle_wheels = law_json(law) in ('"none"', '{"name": "none"}')
        self.shapes = shapes
        self.watch = watch
        self.num_threads = num_threads
        self.progress = progress
        self.demands = {shape: demands_of(job, *shape) for shape in shapes}
        if self.idle_wheels:
            for demands in self.demands.values():
                demands["root_wheel_torque"] = demands["root_wheel_momentum"] = 0.0
        self.flown: list[SlewCandidate] = []

    def shortest(self, shape: tuple[str, float]) -> float:
        """Shortest time of a shape by what the rigid arm needs, s."""
        demands = self.demands[shape]
        times = [0.0]
        for name, limit in self.limits.items():
            if demands.get(name, 0.0) > 0.0:
                time = (demands[name] / limit) ** (1.0 / LIMITED[name].power)
                times.append(time if name == "acceleration" else time * (1.0 + _MARGIN))
        return max(times)

    def scenario(
        self, shape: tuple[str, float], time: float, error: float, *, limited: bool = False
    ) -> dict[str, Any]:
        """What is flown. The wheels' momentum is limited in the plan alone: here it is measured."""
        job = self.job
        profile, smoothing = shape
        scenario = dict(job.scenario)
        if error:
            scenario["mass_error"] = error
        accel = slew_acceleration(job.angle or 1.0, time, profile, smoothing)
        scenario["slew"] = {
            "angle": job.angle,
            "max_accel": accel,
            "profile": profile,
            "smoothing": smoothing,
        }
        deployment: dict[str, Any] = {"start": job.start.extension, "end": job.goal.extension}
        if job.travel == 0.0:
            deployment |= {"mode": "none"}
        elif job.angle == 0.0:
            # the duration of a deployment alone follows from its force and the reported mass
            mass = job.moving_mass + error * job.payload_mass
            force = 4.0 * abs(job.travel) * mass / time**2
            deployment |= {"mode": "force_limited", "force": force}
        else:
            deployment |= {"mode": "coincident"}
        scenario["deployment"] = {**scenario["deployment"], **deployment}
        period = scenario["sample_period"]
        scenario["horizon"] = math.ceil((time + self.watch) / period) * period
        for wheel in ("root_wheel", "tip_wheel"):
            rating = self.limits.get(f"{wheel}_torque")
            part = {} if rating is None else {"torque_limit": rating}
            momentum = self.limits.get(f"{wheel}_momentum") if limited else None
            scenario[wheel] = {**scenario[wheel], "momentum_limit": momentum, **part}
        return scenario

    def fly(
        self, wanted: Sequence[tuple[tuple[str, float], float]], what: str
    ) -> list[SlewCandidate]:
        """Flies shapes at final times, with every mass error."""
        errors = self.job.errors
        scenarios = [
            self.scenario(shape, time, error) for shape, time in wanted for error in errors
        ]
        values: dict[str, list[NDArray[np.float64]]] = {}
        for first in range(0, len(scenarios), _CHUNK):
            part = scenarios[first : first + _CHUNK]

            def tell(done: int, _: int, first: int = first) -> None:
                if self.progress is not None:
                    self.progress(what, first + done, len(scenarios))

            for name, column in self._needs(part, tell).items():
                values.setdefault(name, []).append(column)
        table = {
            name: np.concatenate(columns).reshape(len(wanted), len(errors)).max(axis=1)
            for name, columns in values.items()
        }
        found = []
        for row, (shape, time) in enumerate(wanted):
            needs = {name: float(column[row]) for name, column in table.items()}
            demands = self.demands[shape]
            for name in demands.keys() - needs.keys():
                needs[name] = demands[name] / time ** LIMITED[name].power
            found.append(self._candidate(shape, time, needs))
        self.flown += found
        return found

    def _candidate(
        self, shape: tuple[str, float], time: float, needs: dict[str, float]
    ) -> SlewCandidate:
        used = {name: needs[name] / limit for name, limit in self.limits.items()}
        # one that diverged needs more than anybody can give
        worst = max(
            used.items(),
            key=lambda item: math.inf if math.isnan(item[1]) else item[1],
            default=None,
        )
        return SlewCandidate(
            profile=shape[0],
            smoothing=shape[1],
            final_time=time,
            max_accel=slew_acceleration(self.job.angle, time, *shape),
            values=needs,
            worst=worst,
        )

    def _needs(
        self, scenarios: list[dict[str, Any]], tell: Callable[[int, int], object]
    ) -> dict[str, NDArray[np.float64]]:
        """Peaks of each flight, shape (flights,)."""
        # the shoulder's rate is that of the motor; the loads have the reference's
        signals = ["slew_rate"] if "motor_rate" in self.limits else None
        flown = rollout(
            scenarios,
            law=self.law,
            loads=True,
            signals=signals,
            num_threads=self.num_threads,
            progress=tell,
        )
        needs = {name: flown[metric] for name, metric in MEASURED.items()}
        if signals is not None:
            rates = np.nanmax(np.abs(flown.trajectories["slew_rate"]), axis=1)
            needs["motor_rate"] = np.where(flown["diverged"] > 0.0, np.nan, rates)
        needs["momentum"] = np.maximum(needs["root_wheel_momentum"], needs["tip_wheel_momentum"])
        return needs

    # --- the ways to search

    def _first_times(self) -> dict[tuple[str, float], float]:
        """Times from which candidates are made slower, s.

        By what the rigid arm needs; where no limit bounds that, half of what a gentle flight tells
        by the powers with which things fall.

        Raises
        ------
        ConfigError
            no limit bounds anything of this manoeuvre.
        """
        times = {shape: self.shortest(shape) for shape in self.shapes}
        if any(time > 0.0 for time in times.values()):
            return times
        name = f" ({', '.join(self.limits)} alone)" if self.limits else ""
        if not self.limits:
            raise ConfigError(
                "limits bound no slew: give one of them, or final_time, for without any there is "
                "no fastest manoeuvre"
            )
        job = self.job
        reach = lengths(job.scenario["arm"])[0] + max(job.start.extension, job.goal.extension)
        distance = max(reach * abs(job.angle), abs(job.travel))
        gentle = math.sqrt(4.0 * distance / _GENTLE)
        for candidate in self.fly([(shape, gentle) for shape in self.shapes], "a first look"):
            parts = {name: candidate.values[name] / limit for name, limit in self.limits.items()}
            # what diverges at such a pace says nothing
            guesses = [
                gentle * part ** (1.0 / LIMITED[name].power)
                for name, part in parts.items()
                if part > _NOTHING
            ]
            times[(candidate.profile, candidate.smoothing)] = _HURRY * max(guesses, default=0.0)
        if all(time <= 0.0 for time in times.values()):
            raise ConfigError(f"limits bound no slew{name}: this manoeuvre needs none of them")
        return {shape: time for shape, time in times.items() if time > 0.0}

    def fastest(self) -> SlewCandidate:
        """The fastest candidate within the limits, however long it takes.

        Raises
        ------
        ConfigError
            no limit bounds anything of this manoeuvre.
        InfeasibleError
            nothing within an hour.
        """
        waiting = self._first_times()
        too_fast: dict[tuple[str, float], SlewCandidate] = {}
        stalled = dict.fromkeys(self.shapes, 0)
        best: SlewCandidate | None = None
        closest: SlewCandidate | None = None
        for turn in range(_ROUNDS):
            wanted = [
                (shape, time)
                for shape, time in waiting.items()
                if (best is None or time < best.final_time) and time <= _LONGEST
            ]
            if not wanted:
                break
            for candidate in self.fly(wanted, f"round {turn + 1}"):
                shape = (candidate.profile, candidate.smoothing)
                time = waiting[shape]
                if candidate.feasible:
                    del waiting[shape]
                    if best is None or time < best.final_time:
                        best = candidate
                    continue
                if _passes_less(closest, candidate):
                    closest = candidate
                before = too_fast.get(shape)
                if before is not None and not _helped(before, candidate):
                    stalled[shape] += 1
                too_fast[shape] = candidate
                waiting[shape] = time * self._slower(candidate)
                if stalled[shape] == _PATIENCE:
                    # a law that shakes the arm is not helped by slowness
                    del waiting[shape]
        if best is None:
            raise self._refusal(closest)
        slower_than = too_fast.get((best.profile, best.smoothing))
        return self._refined(best, None if slower_than is None else slower_than.final_time)

    def _slower(self, candidate: SlewCandidate) -> float:
        """Factor by which a candidate has to be slower, by the powers of the rigid arm."""
        factor = 1.0
        for name, limit in self.limits.items():
            part = candidate.values[name] / limit
            # one that diverged has no values
            part = 4.0 if math.isnan(part) else part
            factor = max(factor, part ** (1.0 / LIMITED[name].power))
        return 1.005 * min(factor, 4.0)

    def _refined(self, best: SlewCandidate, too_fast: float | None) -> SlewCandidate:
        """The fastest of some times between one that is too fast and one that is not."""
        if too_fast is None:
            return best
        shape = (best.profile, best.smoothing)
        times = np.geomspace(too_fast, best.final_time, 9)[1:-1]
        flown = self.fly([(shape, float(time)) for time in times], "refinement")
        return min((best, *(each for each in flown if each.feasible)), key=lambda c: c.final_time)

    def _refusal(self, closest: SlewCandidate | None) -> InfeasibleError:
        if closest is None or closest.worst is None:
            time = min(self.shortest(shape) for shape in self.shapes)
            return InfeasibleError(
                f"no slew within the limits: it would take {time:,.4g} s, longer than an hour",
                limit="final_time", needed=time, allowed=_LONGEST,
            )  # fmt: skip
        return self._passed(closest, f"even in {closest.final_time:,.4g} s")

    def _passed(self, candidate: SlewCandidate, when: str) -> InfeasibleError:
        """The refusal of a candidate that passes a limit."""
        assert candidate.worst is not None
        name, part = candidate.worst
        limit, unit = self.limits[name], LIMITED[name].unit
        needed = candidate.values[name]
        if math.isnan(needed):
            return InfeasibleError(
                f"limits.{name}: {when} the arm leaves what the equations describe",
                limit=name, needed=math.inf, allowed=limit,
            )  # fmt: skip
        return InfeasibleError(
            f"limits.{name}: {when} the least demanding profile ({candidate.profile}, smoothing "
            f"{candidate.smoothing:g}) needs {needed:,.4g} {unit}, {needed - limit:,.4g} {unit} "
            f"({100.0 * (part - 1.0):.1f} %) more than the {limit:,.4g} {unit} allowed",
            limit=name, needed=needed, allowed=limit,
        )  # fmt: skip

    def binding(self, candidate: SlewCandidate) -> str:
        """What keeps the fastest candidate from being faster, in words."""
        if candidate.worst is None:
            return "nothing"
        name = candidate.worst[0]
        return f"{name} ({self.limits[name]:,.4g} {LIMITED[name].unit})"

    def at(self, time: float) -> list[SlewCandidate]:
        """All shapes that keep within the limits at one final time.

        Raises
        ------
        InfeasibleError
            none does.
        """
        flown = self.fly([(shape, time) for shape in self.shapes], f"{time:g} s")
        if found := [candidate for candidate in flown if candidate.feasible]:
            return found
        least = min(flown, key=_part)
        if least.worst is None:
            raise InfeasibleError(
                f"final_time: in {time:g} s the arm leaves what the equations describe",
                limit="final_time", needed=math.inf, allowed=time,
            )  # fmt: skip
        raise self._passed(least, f"in {time:g} s")


def _part(candidate: SlewCandidate) -> float:
    """How much of the tightest limit a candidate uses; infinite where it diverged."""
    part = math.nan if candidate.worst is None else candidate.worst[1]
    return math.inf if math.isnan(part) else part


def _passes_less(one: SlewCandidate | None, other: SlewCandidate) -> bool:
    """Whether the other candidate passes its limits by less."""
    return one is None or _part(other) < _part(one)


def _helped(before: SlewCandidate, after: SlewCandidate) -> bool:
    """Whether slowness took away a third of what it takes away on the rigid arm."""
    slower = math.log(after.final_time / before.final_time)
    return _part(after) < _part(before) * math.exp(-slower / 3.0)
