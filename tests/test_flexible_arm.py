"""The arm one could build: its options at every door, its law's memory in snapshots, its spread."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import drm_env

ID = "drm_env/SlewFlexible-v0"

DOORS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "DrmEnv": lambda scenario: drm_env.DrmEnv(config={"scenario": scenario}),
    "DrmVectorEnv": lambda scenario: drm_env.DrmVectorEnv(2, config={"scenario": scenario}),
    "resolve": lambda scenario: drm_env.resolve(config={"scenario": scenario}),
    "simulate": lambda scenario: drm_env.simulate(scenario),
    "rollout": lambda scenario: drm_env.rollout([scenario]),
}


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize(
    ("part", "name", "value"),
    [("payload", "offset", 0.05), ("dynamics", "damping_ratio", 0.005)],
)
def test_the_thesis_plant_refuses_what_it_does_not_know(
    door: str, part: str, name: str, value: float
) -> None:
    with pytest.raises(drm_env.ConfigError, match=rf"{part}\.{name} must be 0 .*{value}"):
        DOORS[door]({part: {name: value}})


@pytest.mark.parametrize("value", [-0.1, 1.0, float("nan")])
def test_a_damping_ratio_is_one_of_a_vibration(value: float) -> None:
    with pytest.raises(drm_env.ConfigError, match="damping_ratio"):
        drm_env.DrmEnv(task="slew_flexible", damping_ratio=value)


def test_episodes_differ_in_what_is_not_known() -> None:
    env = drm_env.DrmVectorEnv(64, task="slew_flexible")
    _, info = env.reset(seed=0)
    for name, low, high in (
        ("payload_offset", -0.05, 0.05),
        ("damping_ratio", 0.0025, 0.0075),
        ("link1_bending_stiffness", 0.9 * 2.5e6, 1.1 * 2.5e6),
        ("link2_bending_stiffness", 0.9 * 3.0e6, 1.1 * 3.0e6),
        ("payload_mass", 50.0, 500.0),
        ("mass_error", -0.15, 0.15),
    ):
        drawn = info[f"context/{name}"]
        assert low <= drawn.min() < drawn.max() <= high
        assert np.unique(drawn).size == 64


def test_a_snapshot_holds_what_the_servo_remembers() -> None:
    options: dict[str, Any] = {"task": "slew_flexible", "inner_law": "servo", "horizon": 3.0}
    env = drm_env.DrmEnv(**options)
    env.reset(seed=7)
    still = np.zeros(2, np.float32)
    for _ in range(60):
        env.step(still)
    state = env.get_state()
    first = [env.step(still)[0].tobytes() for _ in range(60)]
    other = drm_env.DrmEnv(**options)
    other.set_state(state)
    assert [other.step(still)[0].tobytes() for _ in range(60)] == first


def test_a_damped_arm_loses_its_vibration_and_keeps_its_momentum() -> None:
    """Free flight with a damping ratio z: the lowest mode, w, decays as exp(-z w t)."""
    ratio, length = 0.02, 8.0
    scenario: dict[str, Any] = {
        "plant": "consistent",
        "slew": {"angle": 0.0},
        "deployment": {"start": length, "end": length, "mode": "none"},
        "initial": {"alpha": 1e-4, "beta": 1e-4},
        "dynamics": {"damping_ratio": ratio, "spectral_radius": 1.0},
        "horizon": 12.0,
    }
    flight = drm_env.simulate(scenario)
    model = drm_env.Model({"mass": 200.0}, plant="consistent")
    angular = 2.0 * np.pi * model.natural_frequencies(length)[0]
    # by then the faster modes are gone
    time, tip = flight["time"], np.abs(flight["tip_deflection"])
    early = tip[(time > 4.0) & (time < 5.0)].max()
    late = tip[(time > 10.0) & (time < 11.0)].max()
    assert np.log(early / late) == pytest.approx(ratio * angular * 6.0, rel=0.03)
    assert flight["slew_angle"][-1] == pytest.approx(
        np.mean(flight["slew_angle"][time > 8.0]), abs=1e-5
    )


def test_deploying_a_payload_off_the_axis_turns_the_arm() -> None:
    """Momentum stays zero: J theta' = m h a', so it turns by the integral of m h / J over a."""
    mass, offset, start, end = 500.0, 0.05, 2.0, 4.0
    payload = {"mass": mass, "offset": offset}
    scenario: dict[str, Any] = {
        "plant": "consistent",
        "slew": {"angle": 0.0},
        "deployment": {"start": start, "end": end, "mode": "force_limited", "force": 400.0},
        "payload": payload,
        "dynamics": {"damping_ratio": 0.1},
        "horizon": 6.0,
    }
    flight = drm_env.simulate(scenario)
    assert flight["extension"][-1] == end
    model = drm_env.Model(payload, plant="consistent")
    lengths = np.linspace(start, end, 201)
    inertia = np.array([model.matrices(a).M[0, 0] for a in lengths])
    turned = np.trapezoid(mass * offset / inertia, lengths)
    assert flight["slew_angle"][-1] == pytest.approx(turned, rel=1e-3)
    # speeding up pushes the payload back, which bends the tip to the payload's side; slowing down
    # bends it to the other
    tip, time = flight["tip_deflection"], flight["time"]
    assert tip[(time > 0.3) & (time < 1.5)].mean() > 1e-5
    assert tip[(time > 1.9) & (time < 3.0)].mean() < -1e-5
    mirrored = drm_env.simulate({**scenario, "payload": {"mass": mass, "offset": -offset}})
    np.testing.assert_allclose(mirrored["tip_deflection"], -tip, rtol=0.0, atol=1e-12)


def test_configuration_survives_json() -> None:
    env = drm_env.DrmEnv(task="slew_flexible", payload_offset=0.03)
    again = drm_env.DrmEnv(config=json.loads(env.config_json))
    assert again.config_json == env.config_json
    assert again.config.scenario.payload.offset == 0.03


def test_servo_flies_an_arm_whose_link_2_could_be_drawn_in_whole() -> None:
    """Link 2 no longer than link 1: at no extension is a length that no model has."""
    arm = drm_env.resolve().to_dict()["scenario"]["arm"]
    arm["link2"]["length"] = arm["link1"]["length"]
    scenario = {
        "plant": "consistent",
        "arm": arm,
        "deployment": {"start": 1.0, "end": 6.0},
        "mass_error": 0.1,
        "horizon": 1.0,
    }
    assert np.abs(drm_env.simulate(scenario, law="servo")["root_torque"]).max() > 1.0
