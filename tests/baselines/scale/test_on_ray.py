"""The same work on a real Ray cluster of three nodes on this machine, one of which is killed."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ray", reason="Ray is not installed")
pytest.importorskip("pyarrow")

from drm_baselines.benchmark import competitors as competing
from drm_baselines.benchmark import runner as benchmark
from drm_baselines.errors import BaselineError
from drm_baselines.support import on_ray
from drm_baselines.support.executors import Tell
from drm_baselines.support.on_ray import ClusterError
from drm_baselines.support.places import Place, executor
from drm_baselines.sweep import request as requests
from drm_baselines.sweep import runner
from drm_baselines.sweep.parts import EPISODES
from drm_baselines.sweep.request import SweepRequest
from ray_cluster import small_cluster

pytestmark = pytest.mark.slow

REQUEST = SweepRequest(policies=("linear", "lqr"), options={"horizon": 6.0}, episodes=400)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with small_cluster(3) as found:
        yield found


@pytest.fixture(scope="module")
def place(cluster: Any) -> Place:
    return Place(ray=cluster.address)


def files_of(directory: Path) -> dict[str, bytes]:
    folder = directory / EPISODES
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*.parquet")
    }


def test_threads_are_kept_to_the_cores_given(place: Place) -> None:
    def surroundings(shared: Any, job: int, tell: Tell) -> tuple[str | None, int, int]:
        from pathlib import Path

        import numpy as np

        from drm_baselines.support import cores

        def threads() -> int:
            return len(list(Path("/proc/self/task").iterdir()))

        before = threads()
        square = np.ones((600, 600)) @ np.ones((600, 600))
        assert square[0, 0] == 600.0
        return os.environ.get("OMP_NUM_THREADS"), cores.count(), threads() - before

    with executor(place) as workers:
        assert workers.workers == 3
        found = [result for _, result in workers.run(surroundings, None, enumerate(range(4)))]
    # a product of matrices starts no thread
    assert found == [("1", 1, 0)] * 4


def test_what_a_job_raises_is_raised(place: Place) -> None:
    def refuse(shared: Any, job: int, tell: Tell) -> int:
        from drm_baselines.errors import BaselineError

        raise BaselineError(f"job must not be {job}")

    with executor(place) as workers, pytest.raises(BaselineError, match="job must not be 7"):
        list(workers.run(refuse, None, [("a", 7)]))


def test_a_node_that_would_differ_is_refused(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    own = on_ray.identity()
    monkeypatch.setattr(on_ray, "identity", lambda: {**own, "flight": "other bits"})
    with (
        executor(place) as workers,
        pytest.raises(ClusterError, match=r"would differ.*flight .* instead of other bits"),
    ):
        list(workers.run(runner.fly_block, None, [("a", None)]))


def test_a_benchmark_has_the_same_records(place: Place, tmp_path: Path) -> None:
    everybody = competing.chosen(competing.competitors(), ["linear", "dagger"])
    local = benchmark.fly_suite("thesis", everybody, tmp_path / "local")
    with executor(place) as workers:
        spread = benchmark.fly_suite("thesis", everybody, tmp_path / "ray", workers=workers)
    for one, two in zip(local.records, spread.records, strict=True):
        assert one.seeds == two.seeds and one.metrics.keys() == two.metrics.keys()
        for name, values in one.metrics.items():
            np.testing.assert_array_equal(values, two.metrics[name])


def test_a_node_is_killed_and_nothing_changes(
    cluster: Any, place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import ray

    monkeypatch.setattr(requests, "BLOCK", 20)
    runner.sweep(tmp_path / "local", REQUEST)
    killed: list[int] = []
    there: list[int] = []

    def alive() -> int:
        return sum(node["Alive"] for node in ray.nodes())

    def progress(label: str, done: int, total: int) -> None:
        if not killed:
            there.append(alive())
            node = next(iter(cluster.worker_nodes))
            cluster.remove_node(node, allow_graceful=False)
            killed.append(done)

    outcome = runner.sweep(tmp_path / "ray", REQUEST, place=place, progress=progress)
    assert killed[0] < 400 and outcome.flown == 40
    assert files_of(tmp_path / "ray") == files_of(tmp_path / "local")
    with executor(place):
        end = time.monotonic() + 60.0  # Ray notices a little later
        while alive() == there[0] and time.monotonic() < end:
            time.sleep(0.2)
        assert alive() == there[0] - 1


def test_no_cluster_at_an_address_is_one_line() -> None:
    with (
        pytest.raises(ClusterError, match=r"no Ray cluster at 127\.0\.0\.1:1: "),
        executor(Place(ray="127.0.0.1:1")),
    ):
        pass
