"""Flights that leave what the equations describe say so at every door, and leave no result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from typer.testing import CliRunner

import drm_env
from drm_baselines.cli import app
from drm_baselines.evaluation.plots import plot_manoeuvres

CONSISTENT: dict[str, Any] = {
    "plant": "consistent",
    "payload": {"mass": 30_000.0},
    "slew": {"max_accel": 0.04},
    "horizon": 20.0,
}
"""Thirty tonnes bend the arm by more than a quarter of its reach."""

DIVERGING: list[dict[str, Any]] = [
    CONSISTENT,
    {
        "plant": "consistent",
        "payload": {"mass": 30_000.0},
        "slew": {"max_accel": 0.03},
        "deployment": {"start": 8.0, "mode": "none"},
    },
    {
        "payload": {"mass": 3000.0},
        "slew": {"max_accel": 0.04},
        "deployment": {"start": 8.0, "mode": "none"},
    },
]

KEPT = {"settled", "slew_end_time", "duration", "diverged", "episode_return"}
"""Metrics that a diverged flight has."""

REACH = 15.0


def check_metrics(metrics: dict[str, Any]) -> None:
    assert metrics["diverged"] == 1.0 and metrics["settled"] == 0.0
    assert {name for name, value in metrics.items() if np.isfinite(value)} == KEPT


@pytest.mark.parametrize("scenario", DIVERGING)
def test_simulate_ends_with_the_last_state_that_means_something(scenario: dict[str, Any]) -> None:
    flight = drm_env.simulate(scenario)
    check_metrics(flight.metrics)
    assert flight.metrics["duration"] == pytest.approx(flight["time"][-1])
    assert flight["time"][-1] < 20.0
    assert np.abs(flight["tip_deflection"]).max() <= 0.25 * REACH
    assert all(np.isfinite(signal).all() for signal in flight.values())


def test_rollouts_end_the_same_flights_at_the_same_instants() -> None:
    alone = [drm_env.simulate(scenario) for scenario in [*DIVERGING, {}]]
    torques = np.zeros((4, 1, 2))
    for pilot in ({"law": "none"}, {"torques": torques}):
        flown = drm_env.rollout([*DIVERGING, {}], signals=["time", "tip_deflection"], **pilot)
        assert flown["diverged"].tolist() == [1.0, 1.0, 1.0, 0.0]
        for index, flight in enumerate(alone):
            row = flown.trajectories["tip_deflection"][index]
            count = flight["time"].size
            np.testing.assert_array_equal(row[:count], flight["tip_deflection"])
            assert np.isnan(row[count:]).all()
            for name, value in flight.metrics.items():
                np.testing.assert_array_equal(flown[name][index], value)


def options() -> dict[str, Any]:
    """An environment whose own limits let the arm fly to pieces."""
    return {
        "task": "slew_thesis",
        "control_period": 0.02,
        "limits": {"slew_error": 1e20, "tip_deflection": 1e20},
        "plant": "consistent",
        "payload_mass": 30_000.0,
        "slew_max_accel": 0.04,
    }


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_environments_end_whatever_their_limits(mode: AutoresetMode) -> None:
    env = drm_env.DrmEnv(**options())
    env.reset(seed=0)
    batch = drm_env.DrmVectorEnv(3, autoreset_mode=mode, **options())
    batch.reset(seed=0)
    action, over = np.zeros(2, np.float32), False
    while not over:
        observation, reward, terminated, truncated, info = env.step(action)
        rows, rewards, ended, _, infos = batch.step(np.zeros((3, 2), np.float32))
        over = terminated or truncated
    assert terminated and info["diverged"]
    assert np.isfinite(reward) and np.isfinite(observation).all()
    assert env.observation_space.contains(observation)
    assert ended.all()
    np.testing.assert_array_equal(rewards, np.full(3, reward))
    if mode == AutoresetMode.SAME_STEP:
        rows, infos = np.stack(infos["final_obs"]), infos["final_info"]
    np.testing.assert_array_equal(rows, np.tile(observation, (3, 1)))
    assert infos["diverged"].all()


HEAVY: list[dict[str, Any]] = [
    {"plant": "consistent", "payload_mass": 30_000.0, "slew_max_accel": 0.04},
    {"plant": "thesis", "payload_mass": 3000.0, "slew_max_accel": 0.04, "deployment_start": 8.0,
     "deployment_mode": "none"},
]  # fmt: skip


@pytest.mark.parametrize("heavy", HEAVY)
@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("where", [[0], [4, 5], [1, 7, 10]], ids=str)
def test_the_other_environments_of_a_batch_do_not_notice(
    heavy: dict[str, Any], mode: AutoresetMode, where: list[int]
) -> None:
    """Some environments of a batch diverge.

    Those beside them have the bits that they have in a batch where nothing happens.
    """
    settings = {**options(), **heavy, "payload_mass": (100.0, 200.0)}
    batches = [drm_env.DrmVectorEnv(11, autoreset_mode=mode, **settings) for _ in range(2)]
    mass = {"payload_mass": heavy["payload_mass"]}
    once = [mass if index in where else {} for index in range(11)]
    rough, calm = batches[0].reset(seed=3, options=once)[0], batches[1].reset(seed=3)[0]
    others = [index for index in range(11) if index not in where]
    rng = np.random.default_rng(0)
    over, after = np.zeros(11, bool), 0
    for _ in range(1000):
        assert rough[others].tobytes() == calm[others].tobytes()
        assert np.isfinite(rough).all()
        actions = 0.02 * rng.uniform(-1.0, 1.0, (11, 2)).astype(np.float32)
        rough, rewards, terminated, truncated, infos = batches[0].step(actions)
        calm, expected, *_ = batches[1].step(actions)
        assert rewards[others].tobytes() == expected[others].tobytes()
        assert not terminated[others].any() and not truncated.any()
        assert np.isfinite(rewards).all() and (rewards <= 0.0).all()
        for index in np.flatnonzero(terminated):
            last = rough[index]
            if mode == AutoresetMode.SAME_STEP:
                last = infos["final_obs"][index]
                assert infos["final_info"]["diverged"][index]
            else:
                assert infos["diverged"][index]
            assert last in batches[0].single_observation_space
        over |= terminated
        if mode == AutoresetMode.DISABLED and terminated.any():
            again = {"reset_mask": terminated}
            rough = batches[0].reset(options=again)[0]
        after += int(over[where].all())
        if after > 20:
            break
    assert over[where].all() and not over[others].any()
    rows = [batches[0].envs[index].get_state() for index in others]
    assert rows == [batches[1].envs[index].get_state() for index in others]


def test_the_command_says_so_and_the_picture_shows_the_flight_up_to_there(tmp_path: Path) -> None:
    path = tmp_path / "heavy.json"
    path.write_text(json.dumps(CONSISTENT))
    arguments = ["simulate", str(path), "--law", "none", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "diverged: open loop after " in result.output
    report = json.loads((tmp_path / "out" / "simulation.json").read_text())
    assert report["metrics"]["none"]["diverged"] == 1.0
    assert report["metrics"]["none"]["peak_deflection"] is None


def test_pictures_label_what_has_diverged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flights = {"heavy": drm_env.simulate(CONSISTENT), "calm": drm_env.simulate({})}
    seen: list[str] = []

    def look(figure: Any, path: Path, **_: Any) -> Path:
        seen.extend(text.get_text() for text in figure.axes[0].get_legend().get_texts())
        return path

    monkeypatch.setattr("drm_baselines.evaluation.plots.save_figure", look)
    plot_manoeuvres(flights, tmp_path / "picture.png", title="two")
    assert seen == ["heavy (diverged)", "calm", "reference"]


def test_linear_models_of_what_diverges_are_refused() -> None:
    with pytest.raises(drm_env.SimulationError, match="diverged at t = "):
        drm_env.transitions(
            {"horizon": 0.2, "root_wheel": {"torque_limit": 1e12}},
            hold=100,
        )


@pytest.mark.parametrize("order", [("min_energy", "min_time"), ("min_time", "min_energy")])
def test_draws_that_do_not_go_together_do_not_end_a_run(order: tuple[str, str]) -> None:
    settings: dict[str, Any] = {
        "slew_profile": list(order),
        "slew_smoothing": (0.0, 0.27),
        "horizon": 0.1,
    }
    batch = drm_env.DrmVectorEnv(16, **settings)
    batch.reset(seed=0)
    for _ in range(300):
        batch.step(np.zeros((16, 2), np.float32))
    smoothing = [s["slew"] for s in drm_env.sample_scenarios(n=200, **settings)]
    assert all(s["profile"] == "min_energy" for s in smoothing if s["smoothing"] >= 0.25)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"root_torque_limit": 5e-324}, r"root_wheel.torque_limit must be within .* got 5e-324"),
        ({"reward": {"slew_error": 1e308}}, r"reward.slew_error must be at most .* got 1e308"),
        ({"reward": {"resolution": 1e-308}}, r"reward.resolution must be within .* got 1e-308"),
        ({"structural_damping": 0.02, "payload_mass": 50.0}, r"integrator_step must be below"),
    ],
)
def test_numbers_that_cannot_be_computed_with_are_refused(
    settings: dict[str, Any], message: str
) -> None:
    for make in (lambda: drm_env.DrmEnv(**settings), lambda: drm_env.DrmVectorEnv(2, **settings)):
        with pytest.raises(drm_env.ConfigError, match=message):
            make()
    with pytest.raises(drm_env.ConfigError, match=message):
        gym.make("drm_env/Slew-v0", **settings)
