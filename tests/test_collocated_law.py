"""Filters and the gyro at the tip wheel: what laws are told, and what they make of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import drm_env

COLUMNS = drm_env.ControlLaw.MEASUREMENTS


def asked(law: dict[str, Any], **told: float) -> np.ndarray:
    """Torques at the first sample."""
    control = drm_env.ControlLaw(law, control_period=0.002)
    seen = np.zeros((1, len(COLUMNS)))
    for name, value in {"extension": 4.0, "payload_mass": 250.0, **told}.items():
        seen[0, COLUMNS.index(name)] = value
    torques, _ = control.torques(seen, control.initial_state(1), [True])
    return torques[0]


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_the_gyro_turns_with_what_the_tip_wheel_works_on(plant: str) -> None:
    """The output is the torque's own direction, F^T q', and a flight tells what it says."""
    model = drm_env.Model({"mass": 200.0}, plant=plant)
    linear, mass = model.linearize(5.0), model.matrices(5.0).M
    size, tip = len(mass), linear.inputs.index("tip_torque")
    row = linear.C[linear.outputs.index("tip_turn_rate")]
    force = mass @ linear.B[size:, tip]
    assert np.allclose(row[size:], force, rtol=1e-9, atol=1e-9 * np.abs(force).max())
    assert np.all(row[:size] == 0.0)
    told: list[np.ndarray] = []

    def law(seen: np.ndarray) -> np.ndarray:
        told.append(seen[0].copy())
        return np.array([[0.0, 1.5]])

    scenario = {
        "plant": plant,
        "payload": {"mass": 200.0},
        "slew": {"angle": 0.0},
        "deployment": {"start": 5.0, "end": 5.0, "mode": "none"},
        "dynamics": {"spectral_radius": 1.0, "axial_load": False},
        "integrator_step": 2e-5,
        "horizon": 0.1,
    }
    drm_env.simulate(scenario, law)
    rate = np.array(told)[:, COLUMNS.index("tip_turn_rate")]
    block = np.zeros((2 * size + 1, 2 * size + 1))
    block[:-1, :-1], block[:-1, -1] = linear.A, linear.B[:, tip] * 1.5
    over, state = expm(0.002 * block), np.zeros(2 * size + 1)
    state[-1] = 1.0
    expected = []
    for _ in rate:
        expected.append(row @ state[:-1])
        state = over @ state
    assert np.abs(rate - expected).max() < 0.01 * np.abs(expected).max()


def test_the_collocated_law_is_scheduled_over_inertia_length_and_mass() -> None:
    law = {
        "name": "collocated",
        "root": {"frequency": 0.5, "damping": 0.7, "filter": None},
        "tip": {"turn_gain": [[10.0, 20.0], [30.0, 40.0]], "filter": None},
    }
    torques = asked(law, slew_error=1e-3, slew_error_rate=2e-3, tip_turn_rate=0.03,
                    reference_rate=0.01)  # fmt: skip
    arm = drm_env.default_config().scenario.arm
    l1, l2 = arm.link1.length, arm.link2.length
    reach = l1 + 4.0
    inertia = (
        arm.link1.mass_per_length * l1**3 / 3.0
        + arm.link2.mass_per_length * (reach**3 - (reach - l2) ** 3) / 3.0
        + 250.0 * reach**2
    )
    # the payload, told without dimensions, is a particle
    assert torques[0] == pytest.approx(-inertia * (0.25e-3 + 0.7 * 2e-3), rel=1e-9)
    gain = 10.0 + 20.0 * 0.5 + (30.0 + 40.0 * 0.5) * 0.5
    assert torques[1] == pytest.approx(-gain * 0.02, rel=1e-9)


def test_the_linear_tip_can_be_collocated() -> None:
    law = {"name": "linear", "root": None, "tip": {"rate_gain": 0.0, "turn_gain": 400.0}}
    assert asked(law, tip_turn_rate=0.02, reference_rate=0.005)[1] == pytest.approx(-6.0)
    assert asked(law, link2_deflection_rate=1.0)[1] == 0.0


@pytest.mark.parametrize("name", ["linear", "lyapunov"])
@pytest.mark.parametrize("order", [1, 2])
def test_a_filtered_law_follows_slowly(name: str, order: int) -> None:
    """After a step of the rate the torque of a first-order filter is that of 1 - e^(-w t)."""
    plain = {"name": name, "tip": None}
    if name == "lyapunov":
        plain["root"] = {"acceleration_gain": 0.0}
    filtered = {
        **plain,
        "root": {**plain.get("root", {}), "filter": {"cutoff": 5.0, "order": order}},
    }
    control = drm_env.ControlLaw(filtered, control_period=0.002)
    seen = np.zeros((1, len(COLUMNS)))
    seen[0, COLUMNS.index("extension")] = 4.0
    _, state = control.torques(seen, control.initial_state(1), [True])
    seen[0, COLUMNS.index("slew_error_rate")] = 1e-3
    for _ in range(100):
        torques, state = control.torques(seen, state, [False])
    whole = drm_env.ControlLaw(plain, control_period=0.002)
    expected, _ = whole.torques(seen, whole.initial_state(1), [True])
    # 0.2 s: a phase of 1
    y = 1.0 / np.sqrt(2.0)
    part = 1.0 - (np.exp(-1.0) if order == 1 else np.exp(-y) * (np.cos(y) + np.sin(y)))
    assert torques[0, 0] == pytest.approx(part * expected[0, 0], rel=1e-9)


@pytest.mark.parametrize(
    ("law", "named"),
    [
        ({"name": "linear", "tip": {"filter": {"cutoff": 0.0}}}, r"tip\.filter\.cutoff .*0"),
        ({"name": "linear", "root": {"filter": {"order": 3}}}, r"root\.filter\.order .*3"),
        ({"name": "lyapunov", "tip": {"filter": {"cutoff": -1.0}}}, r"tip\.filter\.cutoff .*-1"),
        ({"name": "collocated", "root": {"frequency": float("inf")}}, r"root\.frequency"),
    ],
)
def test_filters_that_there_are_not_are_refused(law: dict[str, Any], named: str) -> None:
    with pytest.raises(drm_env.ConfigError, match=named):
        drm_env.simulate({"horizon": 0.1}, law)


def test_the_gyro_has_noise_of_its_own() -> None:
    """It moves no other noise."""

    def told(**sensors: float) -> np.ndarray:
        rows: list[np.ndarray] = []

        def law(seen: np.ndarray) -> np.ndarray:
            rows.append(seen[0].copy())
            return np.zeros((1, 2))

        drm_env.simulate({"sensors": {"rate_noise": 1e-4, **sensors}, "horizon": 1.0}, law)
        return np.array(rows)

    without, with_noise = told(), told(tip_rate_noise=1e-3)
    tip = COLUMNS.index("tip_turn_rate")
    others = [i for i in range(len(COLUMNS)) if i != tip]
    assert np.array_equal(without[:, others], with_noise[:, others])
    noise = with_noise[:, tip] - without[:, tip]
    assert noise.std() == pytest.approx(1e-3, rel=0.15)
    assert abs(np.corrcoef(noise[:-1], noise[1:])[0, 1]) < 0.15


@pytest.mark.parametrize(
    "law",
    [
        {"name": "collocated"},
        {"name": "linear", "root": {"filter": {"cutoff": 5.0}}, "tip": {"turn_gain": 100.0}},
        {"name": "lyapunov", "root": {"filter": {"cutoff": 5.0, "order": 1}}},
    ],
    ids=["collocated", "linear", "lyapunov"],
)
def test_a_snapshot_holds_filters_and_gyro(law: dict[str, Any]) -> None:
    options: dict[str, Any] = {"task": "slew_flexible", "inner_law": law, "horizon": 3.0}
    env = drm_env.DrmEnv(**options)
    env.reset(seed=1)
    still = np.zeros(env.action_space.shape, dtype=np.float32)
    for _ in range(30):
        env.step(still)
    saved = env.get_state()
    first = [env.step(still)[0] for _ in range(30)]
    other = drm_env.DrmEnv(**options)
    other.reset(seed=2)
    other.set_state(saved)
    second = [other.step(still)[0] for _ in range(30)]
    assert np.array_equal(first, second)


def test_batches_fly_it_as_one_alone() -> None:
    scenarios = drm_env.sample_scenarios("slew_flexible", seed=0, n=5, horizon=2.0)
    law = {"name": "collocated"}
    together = drm_env.rollout(scenarios, law, seed=7)["tip_error_rms"]
    alone = [
        drm_env.simulate(scenario, law, seed=7 + i).metrics["tip_error_rms"]
        for i, scenario in enumerate(scenarios)
    ]
    assert together.tolist() == alone
