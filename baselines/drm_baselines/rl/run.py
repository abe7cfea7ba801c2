"""A run in its directory: learning curve, checkpoints, record."""

from __future__ import annotations

import csv
import hashlib
import io
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

import drm_env
from drm_baselines.errors import RunError
from drm_baselines.evaluation.episodes import fly_policy
from drm_baselines.policies.policy_file import (
    save_policy,
)
from drm_baselines.rl.export import network_of, policy_of
from drm_baselines.rl.request import Point, TrainingRequest, Watcher
from drm_baselines.rl.run_record import (
    EVALUATIONS_FILE,
    RunRecord,
)
from drm_baselines.support import provenance, storage
from drm_baselines.support.extras import needing
from drm_baselines.support.seeds import CURVE_SEED
from drm_baselines.support.trust import seal

with needing("training", "learn"):
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
    from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

_CURVE_METRICS = (
    "episode_return", "tip_error_rms", "residual_rms", "settled", "settling_time",
    "final_slew_error", "wheel_effort",
)  # fmt: skip


class Monitor(BaseCallback):
    """Watches a run: progress, averages of finished episodes, learning curve, checkpoints."""

    def __init__(self, run: Run, watcher: Watcher, stop: threading.Event) -> None:
        super().__init__()
        self._run = run
        self._watcher = watcher
        self._stop = stop
        self._recent: dict[str, float] = {}
        self._shown = 0.0

    def _on_step(self) -> bool:
        dones = self.locals["dones"]
        if dones.any():
            self._take(self.locals["infos"], dones)
        now = time.monotonic()
        if now - self._shown > 0.25:
            self._shown = now
            self._watcher.advanced(self.num_timesteps, self._recent)
        # The last point belongs to the finished policy, after the update that follows this step.
        if self._run.request.steps > self._run.next_evaluation <= self.num_timesteps:
            self._run.evaluate(self._watcher)
            self._run.save("running")
        return not self._stop.is_set()

    def _take(self, infos: list[dict[str, Any]], dones: Any) -> None:
        ended = [drm_env.info_metrics(infos[index]) for index in np.flatnonzero(dones)]
        for name in _CURVE_METRICS:
            values = [metrics[name] for metrics in ended]
            known = [value for value in values if np.isfinite(value)]
            if not known:
                continue
            mean = float(np.mean(known))
            old = self._recent.get(name, mean)
            # Weighted as if the last hundred episodes or so were averaged.
            share = min(1.0, len(known) / 100.0)
            self._recent[name] = old + share * (mean - old)
            self.logger.record(f"rollout/{name}", self._recent[name])


class Run:
    """One run in its directory: model, record, curve."""

    def __init__(
        self,
        directory: Path,
        record: RunRecord,
        model: BaseAlgorithm,
        config: drm_env.EnvConfig,
        request: TrainingRequest,
    ) -> None:
        self.directory = directory
        self.record = record
        self.model = model
        self.config = config
        self.request = request
        self._spacing = max(1, -(-request.steps // max(1, request.evaluations)))
        self._started = time.monotonic()
        self._before = record.wall_time
        self._begun = model.num_timesteps
        self._overhead = 0.0
        self._points: list[dict[str, float]] = self._read_points()
        self.next_evaluation = (model.num_timesteps // self._spacing + 1) * self._spacing

    @property
    def wall_time(self) -> float:
        """Seconds spent on training so far, in all segments, without the evaluations."""
        return self._before + time.monotonic() - self._started - self._overhead

    @property
    def last_point(self) -> int:
        """Steps at the newest point of the learning curve."""
        return int(self._points[-1]["steps"]) if self._points else -1

    def _read_points(self) -> list[dict[str, float]]:
        path = self.directory / EVALUATIONS_FILE
        if not path.is_file():
            return []
        try:
            with path.open(newline="", encoding="utf-8") as stream:
                points = [
                    {name: float(value or "nan") for name, value in row.items()}
                    for row in csv.DictReader(stream, strict=True)
                ]
            for point in points:
                int(point["steps"])
        except (KeyError, TypeError, ValueError, OverflowError, csv.Error) as error:
            raise RunError(f"{path} is damaged: {error}") from error
        # A run that was killed may have measured what its newest checkpoint does not know of.
        return [point for point in points if point["steps"] <= self._begun]

    def describe_policy(self) -> dict[str, Any]:
        """Return what travels with the weights."""
        record = self.record
        return {
            "env_id": record.env_id,
            "config": record.config,
            "control_period": record.control_period,
            "observation_layout": [
                list(entry) for entry in drm_env.observation_layout(config=self.config)
            ],
            "training": {
                "algorithm": record.algorithm,
                "seed": record.seed,
                "steps": int(self.model.num_timesteps),
                "updates": self._updates(),
                "wall_time": self.wall_time,
                "hyperparameters": record.hyperparameters,
                **provenance.provenance(),
            },
        }

    def _updates(self) -> int:
        """How often the policy has changed, see :class:`drm_baselines.policies.budgets.Budget`."""
        model: Any = self.model
        if isinstance(model, OnPolicyAlgorithm):
            return int(model.num_timesteps) // (model.n_steps * model.n_envs)
        return int(model._n_updates)

    def evaluate(self, watcher: Watcher) -> None:
        """Add a point to the learning curve."""
        begun = time.monotonic()
        wall_time = self.wall_time
        policy = policy_of(self.model, self.describe_policy())
        episodes = fly_policy(
            policy,
            self.record.env_id,
            self.config,
            seed=CURVE_SEED,
            episodes=self.request.evaluation_episodes,
            label="learned",
        )
        point = {"steps": float(self.model.num_timesteps), "wall_time": wall_time}
        for name in _CURVE_METRICS:
            if name in episodes.metrics:
                estimate = episodes.estimate(name)
                point[name] = estimate.value
                point[f"{name}_low"], point[f"{name}_high"] = estimate.low, estimate.high
                self.model.logger.record(f"evaluation/{name}", estimate.value)
        self.model.logger.dump(self.model.num_timesteps)
        self._points = [old for old in self._points if old["steps"] < point["steps"]] + [point]
        with (
            storage.atomic_path(self.directory / EVALUATIONS_FILE, overwrite=True) as temporary,
            temporary.open("w", newline="", encoding="utf-8") as stream,
        ):
            writer = csv.DictWriter(
                stream, list(point), restval="", lineterminator="\n", extrasaction="ignore"
            )
            writer.writeheader()
            for row in self._points:
                writer.writerow({**row, "steps": int(row["steps"])})
        while self.next_evaluation <= self.model.num_timesteps:
            self.next_evaluation += self._spacing
        self._overhead += time.monotonic() - begun
        watcher.evaluated(Point(steps=int(point["steps"]), wall_time=wall_time, episodes=episodes))

    def save(self, status: str) -> None:
        """Write checkpoint, exported policy and record; older checkpoints go last."""
        steps = int(self.model.num_timesteps)
        folder = self.directory / "checkpoints"
        folder.mkdir(exist_ok=True)
        # In memory first: torch's own writer has no clear error for a disk that is full. The name
        # holds the digest: the file that the record names stays until there is a newer record.
        packed = io.BytesIO()
        self.model.save(packed)
        digests = {"model": hashlib.sha256(packed.getbuffer()).hexdigest()}
        files = {"model": folder / f"model_{steps}_{digests['model'][:12]}.zip"}
        with storage.atomic_path(files["model"], overwrite=True) as temporary:
            temporary.write_bytes(packed.getbuffer())
        if isinstance(self.model, OffPolicyAlgorithm) and status != "running":
            unnamed = folder / "replay_buffer.pkl"
            with storage.atomic_path(unnamed, overwrite=True) as temporary:
                self.model.save_replay_buffer(temporary)
            digests["replay_buffer"] = digest = storage.sha256_of(unnamed)
            files["replay_buffer"] = folder / f"replay_buffer_{steps}_{digest[:12]}.pkl"
            unnamed.replace(files["replay_buffer"])
        save_policy(self.directory, network_of(self.model), self.describe_policy())
        record = self.record
        record.steps, record.wall_time, record.status = steps, self.wall_time, status
        record.checkpoint = {
            kind: {
                "file": file.relative_to(self.directory).as_posix(),
                "sha256": digests[kind],
                "seal": seal(digests[kind]),
            }
            for kind, file in files.items()
        }
        record.segments[-1].update(end_steps=steps, wall_time=self.wall_time - self._before)
        record.save(self.directory)
        for old in folder.iterdir():
            if old not in files.values():
                old.unlink()
