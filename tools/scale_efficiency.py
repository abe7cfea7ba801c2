"""How much faster a sweep is on a Ray cluster of two workers than on one of one (docs/scale.md).

    python tools/scale_efficiency.py                    # nothing else should run meanwhile
    python tools/scale_efficiency.py --episodes 10000   # a quick look

Starts a cluster of this machine alone with one worker of one core, then with two, and in turn
again; each flies the same sweep of the linear law once its workers have been started and warmed up.
Prints a table: seconds, episodes a second, and the efficiency, which is the speed over that of one
worker and the number of workers.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path

import ray

from drm_baselines.support.places import Place
from drm_baselines.sweep.request import SweepRequest
from drm_baselines.sweep.runner import sweep

LAW = "linear"


def seconds_of(workers: int, episodes: int) -> float:
    """Fly a sweep on a new cluster of so many workers, and return how long it took."""
    ray.init(
        address="local",
        num_cpus=workers,
        include_dashboard=False,
        log_to_driver=False,
        configure_logging=False,
        object_store_memory=128 << 20,
    )
    try:
        with tempfile.TemporaryDirectory() as folder:

            def fly(name: str, count: int) -> float:
                begun = time.monotonic()
                request = SweepRequest(policies=(LAW,), options={}, episodes=count)
                sweep(Path(folder) / name, request, place=Place(ray="auto"))
                return time.monotonic() - begun

            fly("warm", 4 * 5000)
            return fly("measured", episodes)
    finally:
        ray.shutdown()


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=80_000, help="of each sweep")
    parser.add_argument("--repeats", type=int, default=3, help="of each number of workers")
    arguments = parser.parse_args()
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    found: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(arguments.repeats):
        for workers, seconds in found.items():
            seconds.append(seconds_of(workers, arguments.episodes))
    alone = statistics.median(found[1])
    print("| workers | seconds | episodes a second | efficiency |")
    print("| --: | --: | --: | --: |")
    for workers, seconds in found.items():
        middle = statistics.median(seconds)
        span = f"{middle:.1f} [{min(seconds):.1f}, {max(seconds):.1f}]"
        speed = arguments.episodes / middle
        print(f"| {workers} | {span} | {speed:,.0f} | {100 * alone / (workers * middle):.0f} % |")


if __name__ == "__main__":
    main()
