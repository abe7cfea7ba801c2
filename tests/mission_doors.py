"""Legs of missions, and missions flown at every door."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import drm_env

PLANTS = ("thesis", "consistent")


def turn(angle: float, extension: float | None = None, **others: Any) -> dict[str, Any]:
    """Return a short, smooth slew."""
    leg = {"kind": "slew", "angle": angle, "max_accel": 0.2, "smoothing": 0.1, **others}
    return leg if extension is None else {**leg, "extension": extension}


def flown_at_every_door(
    missions: Sequence[dict[str, Any]],
) -> Iterator[tuple[drm_env.DrmEnv, dict[str, Any]]]:
    """Demand the same bits of `simulate`, `rollout` and an environment under the servo.

    Yields the environment and its last info of each mission, seed 0 and on.
    """
    alone = [
        drm_env.simulate(content, "servo", decimation=10, seed=seed)
        for seed, content in enumerate(missions)
    ]
    for threads in (1, 2):
        flown = drm_env.rollout(
            missions, "servo", signals=list(alone[0]), decimation=10, num_threads=threads
        )
        for index, flight in enumerate(alone):
            found = flown.trajectory(index)
            assert repr(found.metrics) == repr(flight.metrics)
            assert repr(found.legs) == repr(flight.legs)
            for name, values in flight.items():
                assert found[name].tobytes() == values.tobytes()
    task = {"inner_law": "servo", "control_period": 0.1}
    for index, content in enumerate(missions):
        env = drm_env.DrmEnv(task="slew_thesis", config={**content, "task": task})
        env.reset(seed=index)
        done = False
        while not done:
            _, _, done, truncated, info = env.step([0.0, 0.0])
            assert not truncated
        last = env.signals()
        for name in ("time", "slew_angle", "tip_deflection", "root_momentum", "extension"):
            assert last[name] == alone[index][name][-1], name
        assert not info["diverged"]
        yield env, info
