"""Several trainings that differ in their seed alone: one after another, side by side, or spread.

The run of a seed is that of ``drm train --seed`` to the bit, in a directory ``seed_N``. A training
that was interrupted or lost is begun anew and not resumed, for a resumed one has other episodes.
Workers that do not share files with this machine train in a directory of their own and send it:
policy, record, curve, events and checkpoint, without a replay buffer.
"""

from __future__ import annotations

import io
import re
import tarfile
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drm_baselines.errors import BaselineError, ExistingResultError, RunError
from drm_baselines.rl import training
from drm_baselines.rl.request import Point, TrainingRequest
from drm_baselines.rl.run_record import RUN_FILE, RunRecord, load_run
from drm_baselines.support import storage, workplace
from drm_baselines.support.executors import Executor, Tell
from drm_baselines.support.places import Place, executor
from drm_baselines.support.trust import seal

WORK = workplace.Work("drm train --seeds")

MOST_SEEDS = 1000
_SEEDS = re.compile(r"(\d{1,3})(?:-(\d{1,3}))?")

Progress = Callable[[int, int, int], None]
"""Called with (seed, steps done, steps in all)."""


def parse_seeds(text: str) -> list[int]:
    """Return the seeds that a text such as ``"0-9"`` or ``"0,2,5-7"`` stands for.

    Raises
    ------
    BaselineError
        Anything else, or a seed twice.
    """
    seeds: list[int] = []
    for part in text.split(","):
        match = _SEEDS.fullmatch(part.strip())
        if match is None:
            raise BaselineError(f"seeds must be like 0-9 or 0,2,5-7, got {text[:60]!r}")
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if last < first:
            raise BaselineError(f"seeds: {part.strip()} ends before it begins")
        seeds += range(first, last + 1)
    if twice := sorted({seed for seed in seeds if seeds.count(seed) > 1}):
        raise BaselineError(f"seeds: {twice[0]} is there twice")
    return seeds


def directory_of(out: Path, seed: int) -> Path:
    """Return the directory of a seed's run."""
    return out / f"seed_{seed}"


@dataclass(frozen=True, kw_only=True)
class _Task:
    """What all trainings have in common; ``out`` is none where workers do not see it."""

    request: TrainingRequest
    out: Path | None


class _Teller:
    """A watcher that tells how many steps are done."""

    def __init__(self, tell: Tell, total: int) -> None:
        self._tell, self._total = tell, total

    def advanced(self, steps: int, recent: Mapping[str, float]) -> None:  # noqa: ARG002
        """Tell."""
        self._tell(steps, self._total)

    def evaluated(self, point: Point) -> None:
        """Tell."""
        self._tell(point.steps, self._total)


def train_seed(task: _Task, seed: int, tell: Tell) -> bytes | None:
    """Train one seed; return its directory as an archive where files are not shared.

    Raises
    ------
    KeyboardInterrupt
        A signal has stopped the training, which has saved itself.
    """
    request = replace(task.request, seed=seed)
    watcher = _Teller(tell, request.steps)
    if task.out is not None:
        _train(directory_of(task.out, seed), request, watcher)
        return None
    with tempfile.TemporaryDirectory(prefix="drm-train-") as folder:
        directory = directory_of(Path(folder), seed)
        _train(directory, request, watcher)
        return _packed(directory)


def _train(directory: Path, request: TrainingRequest, watcher: _Teller) -> None:
    record = training.train(directory, request, watcher=watcher, force=True)
    if record.status != "finished":
        raise KeyboardInterrupt


def _packed(directory: Path) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        for path in sorted(directory.rglob("*")):
            hidden = path.name.startswith(".")  # locks and what is half written
            if path.is_file() and not hidden and not path.name.startswith("replay_buffer"):
                archive.add(path, path.relative_to(directory).as_posix())
    return stream.getvalue()


def _unpack(content: bytes, directory: Path) -> None:
    """Put a run that a worker has sent into its place, the record last.

    Raises
    ------
    RunError
        The archive holds something else than a run.
    """
    with tempfile.TemporaryDirectory(prefix=".drm-", dir=directory.parent) as folder:
        place = Path(folder) / directory.name
        try:
            with tarfile.open(fileobj=io.BytesIO(content)) as archive:
                archive.extractall(place, filter="data")
        except (tarfile.TarError, OSError) as error:
            raise RunError(f"{directory}: what a worker has sent is no run: {error}") from error
        record = load_run(place)
        _sealed_here(place, record)
        record.save(place)
        storage.remove_tree(directory)
        with storage.writing(directory):
            place.rename(directory)


def _sealed_here(directory: Path, record: RunRecord) -> None:
    """Seal the checkpoint as this user's own: it comes from the cluster that this user trusts."""
    if record.checkpoint is None:
        return
    record.checkpoint.pop("replay_buffer", None)
    for entry in record.checkpoint.values():
        if storage.sha256_of(directory / entry["file"]) != entry["sha256"]:
            raise RunError(f"{directory}: the checkpoint that a worker has sent is damaged")
        entry["seal"] = seal(entry["sha256"])


def train_seeds(
    out: Path,
    request: TrainingRequest,
    seeds: Sequence[int],
    *,
    place: Place | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> dict[int, RunRecord]:
    """Train a policy for each seed, and return the records of all.

    Parameters
    ----------
    out
        Gets a directory ``seed_N`` for each. Those that are finished, with the same request, are
        not trained again, so that the same command goes on where it was interrupted.
    request
        What is trained; its own seed does not matter.
    seeds
        Of the trainings.
    place
        Where; one after another in this process by default.
    force
        Whether everything is trained anew.
    progress
        Called now and then.

    Raises
    ------
    ExistingResultError
        A directory holds another run.
    BaselineError, drm_env.ConfigError
        As :func:`drm_baselines.rl.training.train`.
    """
    place = place or Place()
    if request.start is not None and place.ray is not None:
        raise BaselineError("start: workers of a cluster do not see the directory of a policy")
    training.check(request)
    with workplace.noting(out, WORK):
        missing = [
            seed
            for seed in seeds
            if force or not _is_finished(directory_of(out, seed), replace(request, seed=seed))
        ]
        if missing:
            with executor(place, cores_each=request.settings.torch_threads) as workers:
                _spread(out, request, missing, workers, progress)
    return {seed: load_run(directory_of(out, seed)) for seed in seeds}


def _spread(
    out: Path,
    request: TrainingRequest,
    seeds: Sequence[int],
    workers: Executor,
    progress: Progress | None,
) -> None:
    task = _Task(request=request, out=out if workers.shares_files else None)
    jobs = [(seed, seed) for seed in seeds]
    for seed, content in workers.run(train_seed, task, jobs, progress):
        if content is not None:
            _unpack(content, directory_of(out, seed))
        if progress is not None:
            progress(seed, request.steps, request.steps)


def _is_finished(directory: Path, request: TrainingRequest) -> bool:
    """Return whether a seed has been trained; refuse a directory of something else.

    Raises
    ------
    ExistingResultError
        The message says what differs.
    """
    if not (directory / RUN_FILE).is_file():
        if not training.WORK.is_noted(directory):
            storage.check_directory(directory)
        return False
    record = load_run(directory)
    for name, value in training.asked(request).items():
        found = getattr(record, name)
        if found != value:
            raise ExistingResultError(
                f"{directory} is a run with {name} {_short(found)}, not {_short(value)}; give "
                "--force to replace it, or another --out"
            )
    return record.status == "finished"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else "of other values"
