"""Input shaping: what is left of the lowest mode, against the oscillator's exact answer."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

import drm_env

LENGTH, MASS = 6.0, 350.0


def lowest(mass: float = MASS, length: float = LENGTH) -> float:
    """Angular frequency of the lowest mode of the consistent arm, rad/s."""
    model = drm_env.Model({"mass": mass}, plant="consistent", modes=(4, 4))
    return 2.0 * math.pi * float(model.natural_frequencies(length)[0])


def manoeuvre(kind: str, **shaper: Any) -> dict[str, Any]:
    """A short slew at a fixed length, undamped, after which the arm swings freely."""
    return {
        "plant": "consistent",
        "modes": [4, 4],
        "payload": {"mass": MASS},
        "deployment": {"start": LENGTH, "end": LENGTH, "mode": "none"},
        # the linear arm: what the oscillator's answer is of
        "slew": {"angle": 1e-3, "final_time": 1.21, "shaper": {"kind": kind, **shaper}},
        "dynamics": {"axial_load": False, "spectral_radius": 1.0},
        "integrator_step": 2e-4,
        "horizon": 3.2,
    }


def first_mode_left(scenario: dict[str, Any]) -> float:
    """Amplitude of the lowest mode after the slew, m at the tip, by its shape."""
    flight = drm_env.simulate(scenario)
    plant, length = scenario["plant"], float(flight["extension"][-1])
    model = drm_env.Model(scenario["payload"], plant=plant)
    after = flight["time"] >= flight.metrics["slew_end_time"]
    # least squares of the tip's deflection by the modes' sines: they do not decay
    time = flight["time"][after]
    frequencies = 2.0 * math.pi * model.natural_frequencies(length)[:5]
    columns = [f(w * time) for w in frequencies for f in (np.cos, np.sin)]
    found, *_ = np.linalg.lstsq(np.stack(columns, axis=1), flight["tip_deflection"][after])
    return float(np.hypot(found[0], found[1]))


def test_the_lowest_mode_is_left_at_rest() -> None:
    plain = first_mode_left(manoeuvre("none"))
    assert plain > 1e-5
    for kind in ("zv", "zvd"):
        assert first_mode_left(manoeuvre(kind)) < 1e-3 * plain


@pytest.mark.parametrize(("kind", "power"), [("zv", 1), ("zvd", 2)])
@pytest.mark.parametrize("part", [0.85, 0.95, 1.1])
def test_what_is_left_is_what_the_oscillator_says(kind: str, power: int, part: float) -> None:
    """|cos(pi/2 w/w0)| of an undamped mode w for impulses of w0, and its square for ZVD."""
    wrong = lowest() / part
    left = first_mode_left(manoeuvre(kind, frequency=wrong))
    plain = first_mode_left(manoeuvre("none"))
    expected = abs(math.cos(math.pi / 2.0 * part)) ** power
    assert left / plain == pytest.approx(expected, rel=0.02, abs=2e-4)


@pytest.mark.parametrize(("kind", "halves"), [("zv", 1), ("zvd", 2)])
@pytest.mark.parametrize("profile", ["min_time", "min_energy"])
@pytest.mark.parametrize("smoothing", [0.0, 0.1])
def test_angle_and_time_are_exact(kind: str, halves: int, profile: str, smoothing: float) -> None:
    slew = {"profile": profile, "smoothing": smoothing, "shaper": {"kind": kind}}
    scenario = {
        "plant": "consistent",
        "payload": {"mass": MASS},
        "slew": slew,
        "deployment": {"start": LENGTH, "end": LENGTH, "mode": "none"},
        "horizon": 25.0,
    }
    flight = drm_env.simulate(scenario)
    before = drm_env.simulate({**scenario, "slew": {**slew, "shaper": {"kind": "none"}}})
    longer = flight.metrics["slew_end_time"] - before.metrics["slew_end_time"]
    assert longer == pytest.approx(halves * math.pi / lowest(), rel=1e-9)
    assert flight["reference_angle"][-1] == math.radians(50.0)


@pytest.mark.parametrize("kind", ["zv", "zvd"])
@pytest.mark.parametrize(("start", "end"), [(1.0, 8.0), (8.0, 1.0)])
@pytest.mark.parametrize("plant", ["consistent", "thesis"])
def test_a_deploying_arm_ends_at_its_angle_with_less_vibration(
    kind: str, start: float, end: float, plant: str
) -> None:
    def scenario(shaper: str) -> dict[str, Any]:
        return {
            "plant": plant,
            "payload": {"mass": 200.0},
            "deployment": {"start": start, "end": end},
            "slew": {"shaper": {"kind": shaper}},
            "horizon": 20.0,
        }

    plain, shaped = (drm_env.simulate(scenario(each)) for each in ("none", kind))
    assert shaped["reference_angle"][-1] == math.radians(50.0)
    longer = shaped.metrics["slew_end_time"] - plain.metrics["slew_end_time"]
    assert 0.0 < longer < 1.0
    assert first_mode_left(scenario(kind)) < 0.1 * first_mode_left(scenario("none"))


def test_the_shaper_is_told_the_reported_mass() -> None:
    """Two payloads that are reported alike get the same reference."""

    def reference(mass: float, error: float) -> np.ndarray:
        scenario = {
            "plant": "consistent",
            "payload": {"mass": mass, "length": 1.0, "width": 0.5},
            "mass_error": error,
            "slew": {"shaper": {"kind": "zvd"}},
            "horizon": 15.0,
        }
        return drm_env.simulate(scenario)["reference_angle"]

    same = reference(200.0, 0.25)
    assert np.array_equal(same, reference(250.0, 0.0))
    assert not np.array_equal(same, reference(200.0, 0.0))


def test_environments_fly_it_with_every_law() -> None:
    for law in ("none", "linear", "servo", "collocated"):
        env = drm_env.DrmVectorEnv(
            2, task="slew_flexible", slew_shaper="zv", inner_law=law, horizon=1.0
        )
        env.reset(seed=0)
        observations, *_ = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
        assert np.isfinite(observations).all()
        env.close()
        assert env.config.scenario.slew.shaper.kind == "zv"


@pytest.mark.parametrize(
    ("shaper", "named"),
    [
        ({"kind": "zvdd"}, "zvdd"),
        ({"kind": "zv", "frequency": 0.0}, r"slew\.shaper\.frequency .*0"),
        ({"kind": "zv", "damping_ratio": 1.0}, r"slew\.shaper\.damping_ratio .*1"),
        ({"kind": "zv", "bending_stiffness": [0.0, 1.0]}, r"shaper\.bending_stiffness\[0\]"),
    ],
)
def test_shapers_that_there_are_not_are_refused(shaper: dict[str, Any], named: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=named):
        drm_env.simulate({"slew": {"shaper": shaper}})


def test_scenarios_with_a_shaper_survive_as_text() -> None:
    resolved = drm_env.resolve(slew_shaper="zvd", slew_shaper_damping_ratio=0.01)
    data = json.loads(json.dumps(resolved.to_dict()))
    assert data["scenario"]["slew"]["shaper"]["damping_ratio"] == 0.01
    assert drm_env.resolve(config=data).to_dict() == resolved.to_dict()
