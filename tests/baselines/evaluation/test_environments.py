"""Configurations are resolved; no environment is made to be asked what it would be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_baselines import BaselineError, load_policy, make_policy
from drm_baselines.cli.info import described_options
from drm_baselines.evaluation import fly_law
from drm_baselines.evaluation.contestants import Arena
from drm_baselines.evaluation.environments import (
    config_data,
    environment_config,
    known_ids,
    resolved_config,
    scenarios_of,
)
from drm_baselines.imitation.observation_jacobian import Sensing
from drm_baselines.imitation.teacher import Teaching
from drm_baselines.policies.pilots import shipped_run, task_in
from drm_baselines.thesis.tables import table_entries

ID = "drm_env/SlewResidual-v0"
OPTIONS: dict[str, Any] = {"horizon": 0.4, "payload_mass": (60.0, 90.0)}


@pytest.fixture
def _no_environments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any environment that is made fails the test."""

    def never(self: Any, *_: Any, **__: Any) -> None:
        raise AssertionError(f"made a {type(self).__name__}")

    monkeypatch.setattr(drm_env.DrmEnv, "__init__", never)
    monkeypatch.setattr(drm_env.DrmVectorEnv, "__init__", never)


def learned() -> Any:
    return load_policy(shipped_run("dagger"))


def thesis_table(name: str) -> Any:
    return next(entry for entry in table_entries() if entry.name == name).build()


ASKING: dict[str, Callable[[], Any]] = {
    "configuration": lambda: environment_config(ID, OPTIONS),
    "data": lambda: config_data(environment_config(ID, OPTIONS)),
    "arena": lambda: Arena(env_id=ID, options=OPTIONS).config,
    "scenarios": lambda: scenarios_of(ID, resolved_config(ID, OPTIONS), 3, 2),
    "law": lambda: make_policy("linear", config={"task": {"control_period": 0.002}}),
    "network": lambda: make_policy("learned", config=learned().config),
    "trained task": lambda: learned().check_task(drm_env.resolve(config=learned().config).config),
    "task of scenarios": lambda: task_in(learned(), [{"horizon": 30.0}]),
    "sensing": lambda: Sensing(learned().config),
    "student": lambda: drm_env.resolve(config=Teaching().config(0)),
    "table of payloads": lambda: thesis_table("table-2-7"),
    "options": lambda: described_options(resolved_config(ID, {}).to_dict()),
}


@pytest.mark.usefixtures("_no_environments")
@pytest.mark.parametrize("question", ASKING)
def test_no_environment_is_made_to_be_asked(question: str) -> None:
    ASKING[question]()


def test_what_is_resolved_is_what_the_environment_has() -> None:
    env = drm_env.DrmEnv(task="slew_residual", **OPTIONS)
    assert resolved_config(ID, OPTIONS) == env.resolved_config
    assert environment_config(ID, OPTIONS) == env.config
    assert config_data(env.config) == config_data(env.resolved_config)
    assert Arena(env_id=ID, options=OPTIONS).resolved == env.resolved_config
    env.reset(seed=3)
    assert scenarios_of(ID, env.resolved_config, 3, 1) == [env.scenario()]


def test_other_environments_are_refused() -> None:
    with pytest.raises(BaselineError, match="there are " + ", ".join(known_ids())):
        resolved_config("CartPole-v1", {})


def test_an_episode_of_a_law_has_the_noise_of_its_seed() -> None:
    config = environment_config("drm_env/Slew-v0", {"rate_noise": 1e-3, "horizon": 2.0})
    law = {"name": "linear"}
    of_three = fly_law(law, config, env_id="drm_env/Slew-v0", seed=4, episodes=3)
    alone = fly_law(law, config, env_id="drm_env/Slew-v0", seed=6, episodes=1)
    np.testing.assert_array_equal(
        of_three.metrics["peak_deflection"][2:], alone.metrics["peak_deflection"]
    )
