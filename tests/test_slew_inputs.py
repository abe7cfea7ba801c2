"""Slews by their final time (thesis section 3.2.4) and by a table of accelerations."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import drm_env

FAMILIES = [("min_time", 0.0), ("min_time", 0.1), ("min_energy", 0.0), ("min_energy", 0.2)]


def slew(profile: str, smoothing: float, **more: Any) -> dict[str, Any]:
    """A manoeuvre with this profile."""
    return {"slew": {"profile": profile, "smoothing": smoothing, **more}, "horizon": 20.0}


@pytest.mark.parametrize(("profile", "smoothing"), FAMILIES)
@pytest.mark.parametrize("angle", [0.9, -0.4])
def test_final_time_is_met(profile: str, smoothing: float, angle: float) -> None:
    """The reference is at its target, at rest, at the time; the deployment ends with it."""
    time = 12.5
    flown = drm_env.simulate(slew(profile, smoothing, angle=angle, final_time=time))
    assert flown.metrics["slew_end_time"] == time
    end = np.searchsorted(flown["time"], time)
    assert flown["time"][end] == pytest.approx(time, abs=1e-12)
    assert flown["reference_angle"][end] == angle
    assert flown["extension"][end] == 8.0
    # by its own integral up to there, not by the piece behind the end
    before = end - 1
    assert flown["reference_angle"][before] == pytest.approx(angle, abs=1e-5)
    assert abs(flown["reference_rate"][before]) < 1e-3
    assert flown["extension"][before] < 8.0


@pytest.mark.parametrize(("profile", "smoothing"), FAMILIES)
def test_final_time_and_acceleration_say_the_same(profile: str, smoothing: float) -> None:
    """The final time of an acceleration gives that acceleration back, to rounding."""
    by_accel = drm_env.simulate(slew(profile, smoothing, angle=0.7, max_accel=0.013))
    time = by_accel.metrics["slew_end_time"]
    by_time = drm_env.simulate(slew(profile, smoothing, angle=0.7, final_time=time))
    for name in ("reference_angle", "reference_rate", "reference_accel", "extension"):
        np.testing.assert_allclose(by_time[name], by_accel[name], rtol=1e-11, atol=1e-13)


def test_closed_forms_of_the_thesis() -> None:
    """tf = sqrt(4 theta / a) and sqrt(6 theta / a) (section 3.2)."""
    for profile, factor in (("min_time", 4.0), ("min_energy", 6.0)):
        flown = drm_env.simulate(slew(profile, 0.0, angle=0.6, final_time=10.0))
        assert flown["reference_accel"][0] == pytest.approx(factor * 0.6 / 100.0, rel=1e-14)


@pytest.mark.parametrize("deploys", [False, True])
def test_a_switch_on_a_sample_is_flown_alike_at_every_door(deploys: bool) -> None:
    """The motor's torque changes its sign there, with the acceleration, and not a step later."""
    scenario = slew("min_time", 0.0, angle=0.6, final_time=4.0)
    scenario |= {"horizon": 4.9, "deployment": {"mode": "coincident" if deploys else "none"}}
    alone = drm_env.simulate(scenario, "linear")
    beside = drm_env.rollout([scenario] * 3, "linear", signals=list(alone))
    asked = drm_env.simulate(scenario, lambda seen: np.zeros((len(seen), 2)), law_period=0.014)
    open_loop = drm_env.simulate(scenario)
    for name, values in alone.items():
        assert beside.trajectories[name][1].tobytes() == values.tobytes(), name
        assert asked[name].tobytes() == open_loop[name].tobytes(), name
    env = drm_env.DrmEnv(
        task="slew_thesis",
        config={"scenario": scenario, "task": {"inner_law": "linear", "control_period": 0.014}},
    )
    env.reset(seed=0)
    truncated = False
    while not truncated:
        *_, truncated, _ = env.step([0.0, 0.0])
    for name in ("slew_angle", "tip_deflection", "root_momentum"):
        assert env.signals()[name] == alone[name][-1], name
    if not deploys:
        torque = beside.trajectories["slew_torque"][1]
        assert torque[999] == torque[0] > 0.0 > torque[1000] == -torque[0]
        assert torque[2000] == 0.0


def test_a_deployment_alone_takes_the_time() -> None:
    """A slew of no angle has a duration now."""
    flown = drm_env.simulate(slew("min_time", 0.0, angle=0.0, final_time=8.0))
    assert not flown["reference_rate"].any()
    assert flown["extension"][-1] == 8.0
    assert flown["extension"][np.searchsorted(flown["time"], 4.0)] == pytest.approx(4.5)


@pytest.mark.parametrize("time", [0.0, -1.0, 1e30, 1e-30])
def test_impossible_final_times_are_refused(time: float) -> None:
    """By name."""
    with pytest.raises(drm_env.ConfigError, match=r"slew\.final_time"):
        drm_env.simulate(slew("min_time", 0.0, final_time=time))


TIMES = np.array([0.5, 2.5, 2.5, 4.5])
ACCELERATIONS = np.array([0.02, 0.02, -0.02, -0.02])


def table(times: Any = TIMES, accelerations: Any = ACCELERATIONS, **more: Any) -> dict[str, Any]:
    """A manoeuvre by a table."""
    profile = {"profile": "table", "times": times, "accelerations": accelerations}
    return {"slew": profile | more, "horizon": 8.0}


def test_a_table_is_integrated_exactly() -> None:
    """Straight lines between the entries: parabolas and cubics in closed form."""
    times, accelerations = [0.0, 1.0, 3.0, 4.0], [0.0, 0.03, -0.03, 0.0]
    flown = drm_env.simulate(table(times, accelerations))
    t = flown["time"]
    np.testing.assert_allclose(
        flown["reference_accel"], np.interp(t, times, accelerations), atol=1e-15
    )
    # up to 1 s the acceleration is 0.03 t, up to 3 s it falls by 0.03 per second
    first, second = t <= 1.0, (t >= 1.0) & (t <= 3.0)
    np.testing.assert_allclose(
        flown["reference_angle"][first], 0.03 * t[first] ** 3 / 6, atol=1e-15
    )
    u = t[second] - 1.0
    rate = 0.015 + 0.03 * u - 0.015 * u**2
    angle = 0.005 + 0.015 * u + 0.015 * u**2 - 0.005 * u**3
    np.testing.assert_allclose(flown["reference_rate"][second], rate, atol=1e-15)
    np.testing.assert_allclose(flown["reference_angle"][second], angle, atol=1e-15)
    rest = t >= 4.0
    assert not flown["reference_rate"][rest].any()
    np.testing.assert_allclose(flown["reference_angle"][rest], 0.06, rtol=1e-14)
    assert flown.metrics["slew_end_time"] == 4.0


def test_a_bang_bang_table_is_the_minimum_time_slew() -> None:
    """The same flight, to rounding."""
    angle, accel = 0.5, 0.02
    half = math.sqrt(angle / accel)
    by_table = drm_env.simulate(
        table([0.0, half, half, 2 * half], [accel, accel, -accel, -accel]) | {"horizon": 12.0},
        "linear",
    )
    plain = drm_env.simulate(
        {"slew": {"angle": angle, "max_accel": accel}, "horizon": 12.0}, "linear"
    )
    for name, values in plain.items():
        np.testing.assert_allclose(by_table[name], values, rtol=1e-7, atol=1e-9 * abs(values).max())


def test_tables_turn_to_either_side() -> None:
    """The sign of the table is the direction, and its own angle the target."""
    left = drm_env.simulate(table())
    right = drm_env.simulate(table(accelerations=-ACCELERATIONS))
    np.testing.assert_array_equal(left["reference_angle"], -right["reference_angle"])
    assert left["reference_angle"][-1] == pytest.approx(0.08)
    for name in ("peak_slew_angle", "overshoot", "tip_error_rms"):
        assert left.metrics[name] == right.metrics[name]
    assert left.metrics["peak_slew_angle"] == pytest.approx(0.08, rel=0.05)


def test_every_door_flies_a_table() -> None:
    """The same bits from simulate, rollout on both plants and environments; snapshots hold it."""
    for plant in ("thesis", "consistent"):
        scenario = table() | {"plant": plant}
        alone = drm_env.simulate(scenario, "linear")
        flown = drm_env.rollout([scenario] * 3, "linear", signals=["slew_angle"])
        np.testing.assert_array_equal(flown.trajectories["slew_angle"][1], alone["slew_angle"])
    options: dict[str, Any] = {
        "slew_profile": "table",
        "slew_times": TIMES,
        "slew_accelerations": ACCELERATIONS,
        "payload_mass": 200.0,
        "mass_error": 0.0,
        "horizon": 8.0,
    }
    env = gym.make("drm_env/Slew-v0", **options)
    inner = env.unwrapped
    assert isinstance(inner, drm_env.DrmEnv)
    env.reset(seed=3)
    for _ in range(100):
        env.step(np.zeros(2, np.float32))
    state = inner.get_state()
    seen = env.step(np.ones(2, np.float32))[0]
    other = gym.make("drm_env/Slew-v0", **options)
    other.reset(seed=4)
    assert isinstance(other.unwrapped, drm_env.DrmEnv)
    other.unwrapped.set_state(state)
    np.testing.assert_array_equal(other.step(np.ones(2, np.float32))[0], seen)
    drawn = drm_env.sample_scenarios("slew", n=1, **options)[0]
    assert drawn["slew"]["times"] == TIMES.tolist()


@pytest.mark.parametrize(
    ("times", "accelerations", "message"),
    [
        ([0.0], [0.0], r"slew\.times must have at least 2 entries"),
        ([0.0, 1.0], [0.0], r"slew\.accelerations must have 2 entries"),
        ([0.0, 2.0, 1.0], [0.0, 0.0, 0.0], r"slew\.times\[2\] must not be before the 2 s"),
        ([-1.0, 2.0], [0.0, 0.0], r"slew\.times\[0\] must be finite and not negative"),
        ([0.0, 1.0, 1.0, 1.0], [0.0] * 4, r"slew\.times\[3\] must not be given more than twice"),
        ([0.0, 1.0], [0.01, 0.01], r"slew\.accelerations must bring the arm to rest"),
        ([0.0, 1.0], [1e30, -1e30], r"slew\.accelerations\[0\] must be at most"),
        (np.linspace(0, 1, 65), np.zeros(65), r"slew\.times.*at most 64 numbers"),
    ],
)
def test_impossible_tables_are_refused(times: Any, accelerations: Any, message: str) -> None:
    """By entry and value."""
    with pytest.raises(drm_env.ConfigError, match=message):
        drm_env.simulate(table(times, accelerations))


def test_what_belongs_to_another_profile_is_refused() -> None:
    """A table without its profile; a final time or smoothing of a table."""
    with pytest.raises(drm_env.ConfigError, match=r"slew\.times must be empty"):
        drm_env.simulate({"slew": {"times": [0.0, 1.0], "accelerations": [0.0, 0.0]}})
    with pytest.raises(drm_env.ConfigError, match=r"slew\.final_time must be null"):
        drm_env.simulate(table(final_time=3.0))
    with pytest.raises(drm_env.ConfigError, match=r"slew\.smoothing must be 0"):
        drm_env.simulate(table(smoothing=0.1))
