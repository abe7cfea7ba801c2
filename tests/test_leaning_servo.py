"""The servo that leans out: what it is for, at every door, and where it cannot be.

That its plan is the best one is tested beside the engine (``drm_env/src/control/lean.rs``).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import drm_env

LEAN: dict[str, Any] = {"name": "servo", "lean": 0.95}
HARD: dict[str, Any] = {
    "payload": {"mass": 460.0}, "mass_error": -0.12, "horizon": 20.0,
    "slew": {"angle": 0.5, "smoothing": 0.0},
}  # fmt: skip


def test_where_wheels_saturate_an_arm_that_leans_out_is_less_far_off() -> None:
    """Over the worse half of what the flexible arm's environment draws, unsmoothed."""
    options: dict[str, Any] = {"slew_profile": "min_time", "slew_smoothing": 0.0}
    drawn = drm_env.sample_scenarios("slew_flexible", seed=7, n=60, **options)
    plain, leaning = (
        np.sort(drm_env.rollout(drawn, law, seed=7)["tip_error_rms"])[30:]
        for law in ({"name": "servo"}, LEAN)
    )
    assert np.mean(leaning) < 0.9 * np.mean(plain)


def test_a_payload_that_is_what_it_is_said_to_be_leaves_the_arm_upright() -> None:
    scenario = HARD | {"mass_error": 0.0}
    plain, leaning = (drm_env.simulate(scenario, law) for law in ({"name": "servo"}, LEAN))
    assert leaning.metrics["tip_error_rms"] < plain.metrics["tip_error_rms"] + 2e-4


def test_every_door_flies_the_same() -> None:
    alone = drm_env.simulate(HARD, LEAN).metrics["tip_error_rms"]
    easy = HARD | {"mass_error": 0.02}
    other = drm_env.simulate(easy, LEAN).metrics["tip_error_rms"]
    found = drm_env.rollout([HARD, easy, HARD, easy, HARD], LEAN)["tip_error_rms"]
    np.testing.assert_array_equal(found, [alone, other, alone, other, alone])
    config = {
        "scenario": HARD,
        "randomize": {"payload_mass": None, "mass_error": None},
        "task": {"inner_law": LEAN},
    }
    env = drm_env.DrmVectorEnv(3, config=config)
    env.reset(seed=0)
    infos: dict[str, Any] = {}
    ended = False
    while not ended:
        *_, truncated, infos = env.step(np.zeros((3, 2), np.float32))
        ended = bool(truncated.all())
    np.testing.assert_array_equal(infos["metrics/tip_error_rms"], [alone] * 3)


def test_a_snapshot_goes_on_with_the_same_plan() -> None:
    config = {"scenario": HARD, "task": {"inner_law": LEAN}}
    env = drm_env.DrmEnv(config=config)
    env.reset(seed=4)
    still = np.zeros(2, np.float32)
    for _ in range(100):
        env.step(still)
    kept = env.get_state()
    expected = [env.step(still)[0] for _ in range(20)][-1]
    other = drm_env.DrmEnv(config=config)
    other.reset(seed=5)
    other.set_state(kept)
    found = [other.step(still)[0] for _ in range(20)][-1]
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("share", [0.0, -0.1, 1.01, float("nan")])
def test_impossible_shares_are_refused(share: float) -> None:
    with pytest.raises(drm_env.ConfigError, match=r"lean"):
        drm_env.simulate(law={"name": "servo", "lean": share})


@pytest.mark.parametrize("share", [1e-3, 1.0])
def test_ends_of_the_range_fly(share: float) -> None:
    flown = drm_env.simulate(HARD, {"name": "servo", "lean": share})
    assert np.isfinite(flown.metrics["tip_error_rms"])


def test_who_does_not_know_the_manoeuvre_cannot_plan() -> None:
    with pytest.raises(drm_env.ConfigError, match=r"law\.lean must be null .*0\.95"):
        drm_env.ControlLaw(LEAN)


def test_long_manoeuvres_and_missions_are_planned_too() -> None:
    """A plan has at most 600 instants, whatever the horizon; each leg of a mission has its own."""
    slow = HARD | {"horizon": 400.0, "slew": {"angle": 0.5, "max_accel": 5e-5, "smoothing": 0.0}}
    assert np.isfinite(drm_env.simulate(slow, LEAN).metrics["tip_error_rms"])
    legs = [{"kind": "slew", "angle": 0.3}, {"kind": "slew", "angle": -0.3}]
    mission = {"scenario": {**HARD, "horizon": 60.0}, "mission": {"legs": legs}}
    assert drm_env.simulate(mission, LEAN).metrics["diverged"] == 0.0
