"""Learned policies fly missions: in rollouts, environments and batches, with the same bits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from typer.testing import CliRunner

import drm_env
from drm_baselines import make_policy
from drm_baselines.cli import app
from drm_baselines.errors import BaselineError
from drm_baselines.policies.pilots import pilot_named, shipped_run
from drm_baselines.policies.policy_file import load_policy

LEGS: list[dict[str, Any]] = [
    {"kind": "slew", "angle": 0.2, "max_accel": 0.1, "extension": 3.0},
    {"kind": "grapple"},
    {"kind": "slew", "angle": -0.3, "max_accel": 0.1, "smoothing": 0.1},
    {"kind": "desaturate", "most": 2.0},
    {"kind": "wait_for_rest", "most": 2.0},
    {"kind": "release"},
    {"kind": "hold", "duration": 0.5},
]
HORIZON = 30.0


def missions(plant: str, masses: tuple[float, ...]) -> list[dict[str, Any]]:
    return [
        {
            "mission": {"legs": LEGS},
            "scenario": {
                "plant": plant,
                "modes": (2, 2),
                "payload": {"mass": mass},
                "mass_error": 0.1,
                "deployment": {"start": 2.0},
                "horizon": HORIZON,
            },
        }
        for mass in masses
    ]


def config_of(policy: Any, content: dict[str, Any]) -> dict[str, Any]:
    """The task that a policy was trained in, with one mission for its episodes."""
    return {"task": policy.config["task"], **content}


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_the_shipped_policy_flies_missions_at_every_door(plant: str) -> None:
    policy = load_policy(shipped_run("learned"))
    network = policy.network.engine()
    contents = missions(plant, (100.0, 250.0, 400.0))
    flown = drm_env.rollout(
        contents,
        policy=network,
        task="slew_thesis",
        config=config_of(policy, contents[0]),
        signals=["time", "slew_angle", "root_momentum"],
        decimation=10,
        seed=[5, 6, 7],
    )
    assert not flown["diverged"].any()
    for index, content in enumerate(contents):
        config = config_of(policy, content)
        env = drm_env.DrmEnv(task="slew_thesis", config=config)
        acting = make_policy("learned", env=env)
        observation, _ = env.reset(seed=5 + index)
        done, near = False, 0.0
        while not done:
            action = network(observation[np.newaxis])[0]
            own, _ = acting.predict(observation)
            near = max(near, float(np.abs(action - own).max()))
            observation, _, done, truncated, info = env.step(action)
            assert not truncated
        # NumPy's network is the engine's to rounding of float32
        assert near < 1e-5
        assert info["metrics/episode_return"] == flown["episode_return"][index]
        for name in ("tip_error_rms", "wheel_effort", "duration"):
            assert info[f"metrics/{name}"] == flown[name][index], name
        last = env.signals()
        found = flown.trajectory(index)
        for name in ("time", "slew_angle", "root_momentum"):
            assert found[name][-1] == last[name], name
        assert repr(flown.legs[index]) == repr(env.legs)
    batch = drm_env.DrmVectorEnv(
        2,
        task="slew_thesis",
        config=config_of(policy, contents[0]),
        autoreset_mode=AutoresetMode.DISABLED,
    )
    observations, _ = batch.reset(seed=5)
    done = np.zeros(2, dtype=bool)
    while not done.any():
        observations, _, done, _, infos = batch.step(network(observations))
    assert infos["metrics/tip_error_rms"][0] == flown["tip_error_rms"][0]


def test_pilots_of_networks_fly_missions() -> None:
    pilot = pilot_named("learned")
    (content,) = missions("thesis", (300.0,))
    metrics = pilot.fly([content, content], seed=0)
    flight = pilot.trajectory(content, seed=0, decimation=10)
    assert flight.metrics["tip_error_rms"] == metrics["tip_error_rms"][0]
    kinds = [leg.kind for leg in flight.legs]
    assert kinds == ["slew", "slew", "desaturate", "wait_for_rest", "hold"]
    # a mission that states no horizon lasts as long as its legs do
    del content["scenario"]["horizon"]
    assert pilot.fly([content])["duration"][0] == metrics["duration"][0]
    # it does better than nobody
    idle = drm_env.simulate(content)
    assert flight.metrics["tip_error_rms"] < idle.metrics["tip_error_rms"]


def test_the_command_flies_a_learned_policy(tmp_path: Path) -> None:
    path = tmp_path / "mission.toml"
    path.write_text(
        "[scenario]\ndeployment = { start = 2.0 }\n"
        '[mission]\nlegs = [{ kind = "slew", angle = 0.1 }, { kind = "hold" }]\n',
        encoding="utf-8",
    )
    result = CliRunner().invoke(app, ["mission", str(path), "--law", "learned"])
    assert result.exit_code == 0, result.output + result.stderr
    assert "hold" in result.stdout
    for arguments, words in (
        (["--law", "receding"], "is made for single manoeuvres and flies no missions"),
        (["--law", "learned", "--replan"], "is no law"),
    ):
        refused = CliRunner().invoke(app, ["mission", str(path), *arguments])
        assert refused.exit_code == 2
        assert words in " ".join(refused.stderr.split())


def test_other_missions_than_the_tasks_are_refused() -> None:
    pilot = pilot_named("learned")
    one, other = missions("thesis", (300.0, 300.0))
    other["mission"] = {"legs": LEGS[:1]}
    with pytest.raises((drm_env.ConfigError, BaselineError), match="mission"):
        pilot.fly([one, other])
