"""Section ``consistent``: what the consistent plant costs beside the thesis plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drm_env
from drm_baselines.speed.measure import Spread, paired_ratio, seconds_of
from drm_baselines.speed.results import (
    Bench,
    Row,
    Section,
    cores,
)

MODES = (4, 4)
_HORIZON = 20.0
_EPISODES = 32
_UNIT = "us/simulated second"


def _cost(
    plant: str, episodes: int, threads: int, damping_ratio: float = 0.0
) -> Callable[[], float]:
    scenario: dict[str, Any] = {"plant": plant, "horizon": _HORIZON}
    if plant == "consistent":
        scenario["modes"] = list(MODES)
        scenario["dynamics"] = {"damping_ratio": damping_ratio}
    scenarios = [scenario] * episodes
    return lambda: (
        1e6
        * seconds_of(lambda: drm_env.rollout(scenarios, "linear", num_threads=threads))
        / (episodes * _HORIZON)
    )


def run(bench: Bench) -> Section:
    """Fly the thesis manoeuvre with both plants, on one thread and on all."""
    available = cores()
    flexible = drm_env.resolve("drm_env/SlewFlexible-v0").config.scenario
    damping_ratio = flexible.dynamics.damping_ratio
    rows = []
    headline: dict[str, float | None] = {}
    for threads in sorted({1, available}):
        where = "1 thread" if threads == 1 else f"{threads} threads"
        names = (
            f"thesis plant, {where}",
            f"consistent plant {MODES}, {where}",
            f"the same, every mode damped, {where}",
        )
        count = _EPISODES * threads
        measured = bench.interleave(
            f"consistent: {where}",
            {
                names[0]: _cost("thesis", count, threads),
                names[1]: _cost("consistent", count, threads),
                names[2]: _cost("consistent", count, threads, damping_ratio),
            },
        )
        rows.append(Row(names[0], Spread.of(measured[names[0]]), _UNIT))
        for name in names[1:]:
            ratio = paired_ratio(measured[name], measured[names[0]])
            rows.append(Row(name, Spread.of(measured[name]), _UNIT, ratio, names[0]))
        ratio = paired_ratio(measured[names[1]], measured[names[0]])
        headline["consistent_over_thesis" + ("" if threads == 1 else "_all_cores")] = ratio.median
    notes = [
        f"drm_env.rollout of equal scenarios, {_HORIZON:g} s each under the linear law, "
        f"{_EPISODES} a thread; wall time over simulated time of all episodes. The consistent "
        "plant's tables, made for each episode, are included. Damped: by a ratio of "
        f"{damping_ratio:g}, as the arm of SlewFlexible-v0."
    ]
    return Section("consistent", "Cost of the consistent plant", rows, notes, headline)
