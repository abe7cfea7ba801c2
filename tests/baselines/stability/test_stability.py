"""Poles of sampled loops against the arm's own, and against small motions that are flown."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_baselines.policies.pilots import law_data
from drm_baselines.stability import STABLE, Loop, closed_loop, growth_rate, stability_map

LINK1, LENGTH, MASS = 7.0, 8.0, 200.0

Law = str | dict[str, Any]


def data_of(law: Law) -> dict[str, Any]:
    return law_data(law) if isinstance(law, str) else law


def released(law: Law, loop: Loop, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and slew rate of an arm at rest that is let go from a tiny deflection."""
    scenario: dict[str, Any] = {
        "plant": "consistent",
        "modes": list(loop.modes),
        "slew": {"angle": 0.0},
        "deployment": {"start": LENGTH, "end": LENGTH, "mode": "none"},
        "payload": {"mass": MASS},
        "initial": {"beta": 1e-60},
        "dynamics": {"damping_ratio": loop.damping_ratio, "spectral_radius": 1.0},
        "root_wheel": {"lag": loop.lag},
        "tip_wheel": {"lag": loop.lag},
        "sensors": {"delay": loop.delay},
        "integrator_step": 1e-4,
        "sample_period": loop.period,
        "horizon": seconds,
    }
    flight = drm_env.simulate(scenario, law=data_of(law))
    return flight["time"], flight["slew_rate"]


def test_without_a_law_the_poles_are_those_of_the_damped_arm() -> None:
    loop = Loop(damping_ratio=0.01)
    model = drm_env.Model({"mass": MASS}, plant="consistent")
    slowest = 2.0 * math.pi * model.natural_frequencies(LENGTH)[0]
    found = growth_rate(closed_loop({"name": "none"}, LENGTH, MASS, loop=loop), loop.period)
    assert found == pytest.approx(-0.01 * slowest, rel=1e-3)


@pytest.mark.parametrize(
    ("law", "loop"),
    [
        ("linear", Loop()),
        ("lyapunov", Loop()),
        ("linear", Loop(lag=0.0, delay=0.0)),
        ("linear", Loop(lag=0.02, delay=0.004, modes=(2, 2))),
        ({"name": "linear", "root": None, "tip": {"rate_gain": 0.0, "turn_gain": 2e4}}, Loop()),
    ],
    ids=["linear", "Lyapunov", "ideal wheels", "slow wheels", "gyro"],
)
def test_a_flight_grows_at_the_rate_of_the_worst_pole(law: Law, loop: Loop) -> None:
    rate = growth_rate(closed_loop(data_of(law), LENGTH, MASS, loop=loop), loop.period)
    assert rate > 1.0
    # from 1e-60 m by fifty orders: far from any limit, and in the end the worst is alone
    time, motion = released(law, loop, 120.0 / rate)
    envelope = np.maximum.accumulate(np.abs(motion))
    grown = envelope > envelope[-1] * 1e-15
    slope = np.polyfit(time[grown], np.log(envelope[grown]), 1)[0]
    assert slope == pytest.approx(rate, rel=0.05)


@pytest.mark.parametrize("stiffness", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("mass_error", [-0.15, 0.15])
def test_servo_is_stable_where_the_environment_draws(stiffness: float, mass_error: float) -> None:
    loop = Loop(stiffness=stiffness, damping_ratio=0.0025)
    found = stability_map(
        "servo", {"name": "servo"}, [1.0, 2.5, 4.0, 6.0, 8.0], [50.0, 500.0],
        mass_error=mass_error, loop=loop,
    )  # fmt: skip
    assert found.stable, found.rates


@pytest.mark.parametrize(
    "name", ["linear_filtered", "lyapunov_filtered", "linear_collocated", "collocated"]
)
def test_laws_with_filters_are_stable_on_a_flexible_arm(name: str) -> None:
    found = stability_map(name, law_data(name), [1.0, 3.0, 5.0, 8.0], [50.0, 200.0, 500.0])
    assert found.stable, found.rates
    # what makes them so
    bare = law_data(name)
    for wheel in ("root", "tip"):
        bare[wheel] = {**bare[wheel], "filter": None}
    assert not stability_map(name, bare, [1.0, 8.0], [50.0, 500.0]).stable


def test_laws_of_the_thesis_are_unstable_on_a_flexible_arm() -> None:
    """Undamped or not: what docs/plants.md says of them."""
    for law in ("linear", "lyapunov"):
        found = stability_map(law, law_data(law), [1.0, 8.0], [200.0], loop=Loop())
        assert (found.rates > STABLE).all()
