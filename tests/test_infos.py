"""Infos have the same keys at every reset and step, and finite numbers that other tools can keep.

Minari keeps the infos of an episode as arrays a key (the keys must be the same), TorchRL reads the
``dtype`` of each value, and JSON knows neither NaN nor infinity.
"""

from __future__ import annotations

import json
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import drm_env

ID = "drm_env/Slew-v0"
OPTION_SETS: dict[str, dict[str, Any]] = {
    "truncated": {"horizon": 0.3},
    "terminated": {"horizon": 2.0, "limits": {"tip_deflection": 1e-4}},
    "limited wheel": {"horizon": 0.2, "tip_momentum_limit": 5.0},
    "after the slew": {"horizon": 1.0, "slew_angle": 0.001, "initial_beta": 1e-4},
    "consistent": {"horizon": 0.1, "plant": "consistent"},
}


def infos_of(env: gym.Env[Any, Any]) -> list[dict[str, Any]]:
    _, info = env.reset(seed=0)
    infos = [info]
    while True:
        *_, terminated, truncated, info = env.step(np.ones(2, np.float32))
        infos.append(info)
        if terminated or truncated:
            _, info = env.reset()
            return [*infos, info]


@pytest.mark.parametrize("name", OPTION_SETS)
def test_every_info_has_the_same_keys_and_finite_float64(name: str) -> None:
    infos = infos_of(gym.make(ID, **OPTION_SETS[name]))
    assert len(infos) >= 3
    for info in infos:
        assert list(info) == list(infos[0])
        for key, value in info.items():
            assert value.dtype == np.float64 and value.shape == (), key
            assert np.isfinite(value), key
        assert json.loads(json.dumps(info, allow_nan=False)) == info
    assert set(infos[0]) == set(infos_of(gym.make("drm_env/SlewThesis-v0", horizon=0.05))[0])


def test_metrics_are_those_of_the_episode_so_far() -> None:
    options = {"task": "slew_thesis", "slew_angle": 0.01, "payload_mass": 300.0}
    # options of several kinds in one mapping, which a type checker cannot take apart
    *infos, _ = infos_of(drm_env.DrmEnv(horizon=1.6, **options))  # type: ignore[arg-type]
    for steps in (300, 750):
        last = infos_of(drm_env.DrmEnv(horizon=steps * 0.002, **options))[-2]  # type: ignore[arg-type]
        for key in last:
            if key.startswith("metrics/") and key != "metrics/residual_energy":
                assert infos[steps][key] == last[key], key
    assert infos[300]["metrics/residual_rms"] == drm_env.NO_VALUE
    assert infos[-2]["metrics/residual_energy"] == drm_env.NO_VALUE
    assert 0.0 < infos[-1]["metrics/residual_energy"] < 1e6
    assert infos[800]["metrics/residual_rms"] < 1.0


def test_what_does_not_exist_is_no_value_and_nan_among_metrics() -> None:
    (first, *_, last, _) = infos_of(drm_env.DrmEnv(horizon=0.2))
    assert first["context/root_momentum_limit"] == drm_env.NO_VALUE
    assert first["metrics/tip_error_rms"] == drm_env.NO_VALUE
    assert last["metrics/settling_time"] == drm_env.NO_VALUE
    metrics = drm_env.info_metrics(last)
    assert np.isnan(metrics["settling_time"]) and metrics["settled"] == 0.0
    assert metrics["duration"] == last["metrics/duration"]
    batch = drm_env.DrmVectorEnv(2, horizon=0.2)
    batch.reset(seed=0)
    for _ in range(20):
        info = batch.step(np.ones((2, 2), np.float32))[-1]
    both = drm_env.info_metrics(info)
    assert both["duration"].tolist() == [metrics["duration"]] * 2
    assert np.isnan(both["settling_time"]).all()
    info = batch.step(np.ones((2, 2), np.float32))[-1]
    assert np.isnan(drm_env.info_metrics(info)["duration"]).all()


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_every_info_of_a_batch_has_the_same_keys(mode: AutoresetMode) -> None:
    env = drm_env.DrmVectorEnv(
        3,
        autoreset_mode=mode,
        horizon=0.3,
        initial_beta=(0.0, 0.02),
        limits={"tip_deflection": 0.03},
    )
    _, info = env.reset(seed=21)
    keys = set(info)
    assert keys == {
        f"{mark}{key}" for key in infos_of(drm_env.DrmEnv(horizon=0.05))[0] for mark in ("", "_")
    }
    ended = 0
    for _ in range(80):
        *_, terminated, truncated, info = env.step(np.ones((3, 2), np.float32))
        done = terminated | truncated
        extra = {"final_obs", "_final_obs", "final_info", "_final_info"}
        same_step = mode is AutoresetMode.SAME_STEP and done.any()
        assert set(info) == keys | (extra if same_step else set())
        if same_step:
            assert set(info["final_info"]) == keys
        for key, values in info.items():
            if key.startswith("_") or key in extra:
                continue
            assert values.dtype == np.float64 and np.isfinite(values).all(), key
        ended += int(done.sum())
        if mode is AutoresetMode.DISABLED and done.any():
            _, info = env.reset(options={"reset_mask": done})
            assert set(info) == keys
    assert ended > 6


def test_monitor_of_stable_baselines3_records_success() -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecMonitor

    from drm_env.sb3 import make_sb3_vec

    keywords = ("is_success", "diverged", "metrics/tip_error_rms")
    env = Monitor(gym.make(ID, max_episode_steps=5), info_keywords=keywords)
    env.reset(seed=0)
    for _ in range(5):
        info = env.step(np.ones(2, np.float32))[-1]
    assert info["episode"]["is_success"] == 0.0
    venv = VecMonitor(make_sb3_vec(ID, 1, 0, monitor=False, max_episode_steps=5), None, keywords)
    venv.reset()
    for _ in range(5):
        _, _, dones, infos = venv.step(np.ones((1, 2), np.float32))
    assert dones[0]
    for key in keywords:
        assert infos[0]["episode"][key] == info["episode"][key]
