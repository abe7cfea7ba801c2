"""The training lines of docs/training.md as they stand: what they train beats the inner law."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from drm_baselines.evaluation.environments import environment_config
from drm_baselines.evaluation.episodes import fly_law, fly_policy
from drm_baselines.evaluation.statistics import compare_paired
from drm_baselines.support.seeds import CURVE_SEED

PAGE = Path(__file__).parents[3] / "docs" / "training.md"
EPISODES = 256


def training_lines() -> str:
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (block,) = [block for block in blocks if ".learn(" in block]
    return str(block)


@pytest.mark.slow
def test_training_lines_beat_the_inner_law() -> None:
    """On fresh episodes, paired: smaller tip error, more arms settled, both beyond chance."""
    names: dict[str, Any] = {}
    exec(training_lines(), names)
    (env_id,) = re.findall(r'make_sb3_vec\("([^"]+)"', training_lines())
    config = environment_config(env_id, {})
    law = {"name": str(config.task.inner_law.name)}
    episodes = {"seed": CURVE_SEED + 5_000, "episodes": EPISODES}
    agent = fly_policy(names["model"], env_id, config, label="agent", **episodes)
    inner = fly_law(law, config, env_id=env_id, **episodes)
    error = compare_paired(agent.judged("tip_error_rms"), inner.judged("tip_error_rms"))
    assert error.better, error
    assert error.improvement.low > 0.5, error
    settled = compare_paired(
        agent.judged("settled"), inner.judged("settled"), higher_is_better=True, trimmed=False
    )
    assert settled.better, settled
    for flown in (agent, inner):
        print(flown.label, flown.estimate("tip_error_rms"), np.mean(flown.judged("settled")))
    print("paired", error, settled)
    assert np.isfinite(agent.judged("tip_error_rms")).all()
