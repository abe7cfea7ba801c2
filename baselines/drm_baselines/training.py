"""Training PPO and SAC with Stable-Baselines3 on the native batch of environments.

A run is one directory (see :mod:`drm_baselines.runs`). It can be interrupted at any time and
resumed; the policy beside the record is always the newest one, exported as plain arrays. The
learning curve is measured by flying the deterministic policy over fixed episodes, judged by the
engine's metrics, on seeds that training never draws.
"""

from __future__ import annotations

import csv
import importlib.util
import io
import os
import shlex
import shutil
import threading
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

import drm_env
from drm_baselines import hyperparameters, memory, storage
from drm_baselines.asymmetric import AsymmetricPolicy, PrivilegedObservations
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.evaluation import (
    TRAINING_SEED,
    config_data,
    environment_config,
    episode_seeds,
    fly_policy,
)
from drm_baselines.export import perceptron_of
from drm_baselines.interruption import stop_on_signal
from drm_baselines.network import (
    DESCRIPTION_FILE,
    WEIGHTS_FILE,
    NetworkPolicy,
    load_policy,
    save_policy,
)
from drm_baselines.records import Episodes
from drm_baselines.runs import EVALUATIONS_FILE, RUN_FILE, RunRecord, checkpoint_file, load_run
from drm_baselines.staggering import StaggeredStart

CURVE_SEED = 900_000_000
"""First seed of the episodes behind learning curves: apart from training and from evaluations."""

_SEEDS_A_RUN = 1_000_000
_SEEDS_A_SEGMENT = 10_000
_ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC}
_ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU}
_CURVE_METRICS = (
    "episode_return", "tip_error_rms", "residual_rms", "settled", "settling_time",
    "final_slew_error", "wheel_effort",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TrainingRequest:
    """What to train.

    Attributes
    ----------
    algorithm, env_id, options
        ``"ppo"`` or ``"sac"``, the environment's id and its keyword options.
    steps
        Environment steps of the whole run, over all environments and segments.
    seed
        Of the networks, the action noise and the episodes.
    settings
        Hyperparameters; ``n_envs`` among them.
    evaluations, evaluation_episodes
        Number of points of the learning curve, and episodes behind each.
    start
        Directory of a policy whose weights PPO begins with; none: random weights.
    """

    algorithm: str
    env_id: str
    options: Mapping[str, Any]
    steps: int
    seed: int
    settings: hyperparameters.Hyperparameters
    evaluations: int = 10
    evaluation_episodes: int = 100
    start: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Point:
    """One point of a learning curve."""

    steps: int
    wall_time: float
    episodes: Episodes


class Watcher(Protocol):
    """Whoever shows the progress of a run."""

    def advanced(self, steps: int, recent: Mapping[str, float]) -> None:
        """Called now and then with the steps so far and averages over recent episodes."""

    def evaluated(self, point: Point) -> None:
        """Called after each point of the learning curve."""


@dataclass
class SilentWatcher:
    """Shows nothing, keeps the points."""

    points: list[Point] = field(default_factory=list)

    def advanced(self, steps: int, recent: Mapping[str, float]) -> None:
        """Take note of nothing."""

    def evaluated(self, point: Point) -> None:
        """Keep the point."""
        self.points.append(point)


class _Monitor(BaseCallback):
    """Watches a run: progress, averages of finished episodes, learning curve, checkpoints."""

    def __init__(self, run: _Run, watcher: Watcher, stop: threading.Event) -> None:
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
        ended = [infos[index] for index in np.flatnonzero(dones)]
        for name in _CURVE_METRICS:
            values = [info.get(f"metrics/{name}", np.nan) for info in ended]
            known = [value for value in values if np.isfinite(value)]
            if not known:
                continue
            mean = float(np.mean(known))
            old = self._recent.get(name, mean)
            # Weighted as if the last hundred episodes or so were averaged.
            share = min(1.0, len(known) / 100.0)
            self._recent[name] = old + share * (mean - old)
            self.logger.record(f"rollout/{name}", self._recent[name])


class _Run:
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
        return points

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
                "wall_time": self.wall_time,
                "hyperparameters": record.hyperparameters,
                **storage.provenance(),
            },
        }

    def evaluate(self, watcher: Watcher) -> None:
        """Add a point to the learning curve."""
        begun = time.monotonic()
        wall_time = self.wall_time
        policy = NetworkPolicy(perceptron_of(self.model), self.describe_policy())
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
        path = folder / f"model_{steps}.zip"
        # in memory first: torch's own writer has no clear error for a disk that is full
        packed = io.BytesIO()
        self.model.save(packed)
        with storage.atomic_path(path, overwrite=True) as temporary:
            temporary.write_bytes(packed.getbuffer())
        files = {"model": path}
        if isinstance(self.model, OffPolicyAlgorithm) and status != "running":
            buffer = folder / f"replay_buffer_{steps}.pkl"
            with storage.atomic_path(buffer, overwrite=True) as temporary:
                self.model.save_replay_buffer(temporary)
            files["replay_buffer"] = buffer
        save_policy(self.directory, perceptron_of(self.model), self.describe_policy())
        record = self.record
        record.steps, record.wall_time, record.status = steps, self.wall_time, status
        record.checkpoint = {
            kind: {
                "file": file.relative_to(self.directory).as_posix(),
                "sha256": storage.sha256_of(file),
            }
            for kind, file in files.items()
        }
        record.segments[-1].update(end_steps=steps, wall_time=self.wall_time - self._before)
        record.save(self.directory)
        for old in folder.iterdir():
            if old not in files.values():
                old.unlink()


def _make_model(request: TrainingRequest, env: VecEnv) -> BaseAlgorithm:
    settings = request.settings
    arguments = dict(settings.model)
    _check_memory(request, env)
    network: dict[str, Any] = {
        "net_arch": list(settings.network.layers),
        "activation_fn": _ACTIVATIONS[settings.network.activation],
        "log_std_init": settings.network.log_std_init,
    }
    if request.algorithm == "sac" and arguments.get("use_sde"):
        # By default the mean is clipped before it is squashed: one more kind of layer for nothing.
        network["clip_mean"] = 0.0
    try:
        return _ALGORITHMS[request.algorithm](
            AsymmetricPolicy if settings.network.critic_sees_payload else "MlpPolicy",
            env,
            learning_rate=LinearSchedule(settings.learning_rate, settings.learning_rate_end, 1.0),
            policy_kwargs=network,
            seed=request.seed,
            device="cpu",
            verbose=0,
            **arguments,
        )
    except (TypeError, ValueError, AssertionError, OverflowError, MemoryError) as error:
        raise RunError(f"Stable-Baselines3 refuses the hyperparameters in [model]: {error}") from (
            error
        )


def _check_memory(request: TrainingRequest, env: VecEnv) -> None:
    """Refuse buffers that do not fit; whatever is no whole number Stable-Baselines3 refuses.

    Raises
    ------
    BaselineError
        The message says how much they would take.
    """
    model, shape = request.settings.model, env.observation_space.shape
    name = "buffer_size" if request.algorithm == "sac" else "n_steps"
    size = model.get(name, 1_000_000 if name == "buffer_size" else 2048)
    if type(size) is not int or shape is None:
        return
    # of float32: an observation (of SAC also the next one), an action and some single numbers
    values = (2 if name == "buffer_size" else 1) * shape[0] + 12
    rows = size if name == "buffer_size" else size * env.num_envs
    memory.require(4 * rows * values, f"[model] {name} = {size}")


def _set_threads(settings: hyperparameters.Hyperparameters) -> None:
    most = os.cpu_count() or 1
    if settings.torch_threads > most:
        warnings.warn(
            f"torch_threads = {settings.torch_threads} is more than the {most} processors of this "
            f"machine: {most} are used, and the run may differ in its last digits",
            stacklevel=3,
        )
    torch.set_num_threads(min(settings.torch_threads, most))


def _begin_with(model: BaseAlgorithm, directory: Path, config: drm_env.EnvConfig) -> None:
    """Give PPO's actor the weights of a saved policy.

    Raises
    ------
    RunError
        Not PPO, or a policy of another shape, activation or observation.
    """
    policy = load_policy(directory)
    layout = [list(entry) for entry in drm_env.observation_layout(config=config)]
    if [list(entry) for entry in policy.description["observation_layout"]] != layout:
        raise RunError(f"{directory}: the policy sees another observation than this task's")
    if not isinstance(model, PPO) or policy.network.output != "clip":
        raise RunError(f"{directory}: only PPO can go on from a policy, with a clipped output")
    own = [
        layer
        for layer in [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
        if isinstance(layer, nn.Linear)
    ]
    shapes = [list(layer.weight.shape) for layer in own]
    given = [list(weight.shape) for weight in policy.network.weights]
    if shapes != given or perceptron_of(model).activation != policy.network.activation:
        raise RunError(f"{directory}: the policy has layers {given}, the hyperparameters {shapes}")
    with torch.no_grad():
        for layer, weight, bias in zip(
            own, policy.network.weights, policy.network.biases, strict=True
        ):
            layer.weight.copy_(torch.from_numpy(np.array(weight)))
            layer.bias.copy_(torch.from_numpy(np.array(bias)))


def _make_envs(
    request: TrainingRequest, config: drm_env.EnvConfig, segment: int
) -> tuple[VecEnv, int]:
    from drm_env.sb3 import make_sb3_vec

    first = TRAINING_SEED + request.seed * _SEEDS_A_RUN + segment * _SEEDS_A_SEGMENT
    # The metrics in the last info say more than a monitor's, and infos are kept small.
    env = make_sb3_vec(
        request.env_id,
        n_envs=request.settings.n_envs,
        monitor=False,
        step_context=False,
        config=config,
    )
    horizon = round(config.scenario.horizon / config.task.control_period)
    env = StaggeredStart(env, horizon)
    if request.settings.network.critic_sees_payload:
        env = PrivilegedObservations(env)
    return env, first


def _new_record(request: TrainingRequest, config: drm_env.EnvConfig) -> RunRecord:
    return RunRecord(
        algorithm=request.algorithm,
        env_id=request.env_id,
        # JSON knows no tuples: a range is written the way configuration files write it.
        options={
            name: {"uniform": list(value)} if isinstance(value, tuple) else value
            for name, value in request.options.items()
        },
        config=config_data(config),
        control_period=float(config.task.control_period),
        hyperparameters=request.settings.to_dict(),
        seed=request.seed,
        target_steps=request.steps,
        evaluations=request.evaluations,
        evaluation_episodes=request.evaluation_episodes,
        start=None if request.start is None else _start_of(request.start),
    )


def _start_of(directory: Path) -> dict[str, Any]:
    digest = load_policy(directory).description["weights_sha256"]
    return {"directory": str(directory), "weights_sha256": digest}


def train(
    directory: Path,
    request: TrainingRequest,
    *,
    watcher: Watcher | None = None,
    force: bool = False,
) -> RunRecord:
    """Train a policy from the start and save everything in ``directory``.

    Raises
    ------
    ExistingResultError
        The directory is not empty and ``force`` is false.
    drm_env.ConfigError
        Impossible environment options.
    RunError
        Hyperparameters that the algorithm refuses.
    """
    options = {**request.settings.env, **request.options}
    config = environment_config(request.env_id, options)
    episode_seeds(CURVE_SEED, request.evaluation_episodes)
    storage.check_directory(directory, force=force)
    _set_threads(request.settings)
    env, first_seed = _make_envs(request, config, 0)
    try:
        model = _make_model(request, env)
        if request.start is not None:
            _begin_with(model, request.start, config)
        # Not before everything is known to be possible: what is there may be an older run.
        storage.claim_directory(directory, force=force)
        # With force: an interruption before the first save must not leave the old run's policy.
        for name in (RUN_FILE, EVALUATIONS_FILE, WEIGHTS_FILE, DESCRIPTION_FILE):
            (directory / name).unlink(missing_ok=True)
        for name in ("checkpoints", "tensorboard"):
            shutil.rmtree(directory / name, ignore_errors=True)
        # The model has seeded the environments with its own seed, which evaluations may use.
        env.seed(first_seed)
        run = _Run(directory, _new_record(request, config), model, config, request)
        return _fly(run, request, first_seed, watcher or SilentWatcher())
    finally:
        env.close()


def request_of(record: RunRecord, *, steps: int | None = None) -> TrainingRequest:
    """Return the request that a run was started with, with another number of steps if given.

    Raises
    ------
    BaselineError
        Hyperparameters in the record that are none, or another algorithm's.
    """
    settings = hyperparameters.from_data(record.hyperparameters, RUN_FILE)
    if settings.algorithm != record.algorithm:
        raise RunError(
            f"{RUN_FILE} is damaged: algorithm is {record.algorithm}, but the hyperparameters are "
            f"those of {settings.algorithm}"
        )
    return TrainingRequest(
        algorithm=record.algorithm,
        env_id=record.env_id,
        options=record.options,
        steps=steps if steps is not None else record.target_steps,
        seed=record.seed,
        settings=settings,
        evaluations=record.evaluations,
        evaluation_episodes=record.evaluation_episodes,
    )


def resume(
    directory: Path, *, steps: int | None = None, watcher: Watcher | None = None
) -> RunRecord:
    """Go on with an interrupted run, or extend a finished one to ``steps`` steps.

    Everything else is as the run began with, also how its learning curve is measured.
    The episodes after resuming are drawn from seeds of their own, so that a resumed run is as
    good as an uninterrupted one but not bit for bit the same.

    Raises
    ------
    RunError
        No run there, a checkpoint that is missing or not the run's own, or nothing left to do.
    """
    record = load_run(directory)
    request = request_of(record, steps=steps)
    if record.checkpoint is None:
        raise RunError(f"{directory} was interrupted before its first checkpoint: train it anew")
    if record.steps >= request.steps:
        raise RunError(
            f"{directory} has all of its {record.steps} steps; give a larger --steps to go on"
        )
    path = checkpoint_file(directory, record)
    config = environment_config(record.env_id, {"config": record.config})
    _set_threads(request.settings)
    env, first_seed = _make_envs(request, config, len(record.segments))
    try:
        model = _ALGORITHMS[record.algorithm].load(path, env=env, device="cpu")
        model.set_random_seed(request.seed + len(record.segments))
        if isinstance(model, OffPolicyAlgorithm):
            if record.checkpoint.get("replay_buffer"):
                model.load_replay_buffer(checkpoint_file(directory, record, "replay_buffer"))
            else:
                # Killed before it could save its buffer: fill it anew before learning from it.
                model.learning_starts += model.num_timesteps
        env.seed(first_seed)
        record.target_steps, record.status = request.steps, "running"
        run = _Run(directory, record, model, config, request)
        return _fly(run, request, first_seed, watcher or SilentWatcher())
    finally:
        env.close()


def _fly(run: _Run, request: TrainingRequest, first_seed: int, watcher: Watcher) -> RunRecord:
    record, model = run.record, run.model
    record.segments.append(
        {
            "begin_steps": int(model.num_timesteps),
            "first_seed": first_seed,
            "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            **storage.provenance(),
        }
    )
    record.save(run.directory)
    model.set_logger(configure(str(run.directory / "tensorboard"), _log_formats()))
    if model.num_timesteps == 0:
        run.evaluate(watcher)
    failure: Exception | None = None
    with stop_on_signal() as stop:
        try:
            model.learn(
                request.steps - model.num_timesteps,
                callback=_Monitor(run, watcher, stop),
                log_interval=_log_interval(request),
                reset_num_timesteps=model.num_timesteps == 0,
            )
        except KeyboardInterrupt:
            stop.set()
        except Exception as error:
            # what has been learned is worth keeping, whatever has happened
            failure = error
        finished = failure is None and model.num_timesteps >= request.steps
        try:
            if finished and run.last_point < model.num_timesteps:
                run.evaluate(watcher)
            run.save("finished" if finished else "interrupted")
        except Exception as error:
            failure = failure or error
    if failure is not None:
        if isinstance(failure, (BaselineError, drm_env.DrmError, OSError)):
            raise RunError(f"{failure}; {_fate_of(run.directory)}") from failure
        raise failure
    return record


def _fate_of(directory: Path) -> str:
    """What is left of a run that failed, in words."""
    try:
        record = load_run(directory)
    except RunError:
        return f"nothing of the run is saved in {directory}"
    if record.checkpoint is None:
        return f"the run has not saved a checkpoint in {directory}"
    return (
        f"{record.steps:,} steps are saved: go on with drm train --resume --out "
        f"{shlex.quote(str(directory))}"
    )


def _log_interval(request: TrainingRequest) -> int:
    # PPO counts updates, SAC counts episodes, of which a batch ends many at a time.
    return 5 if request.algorithm == "ppo" else 4 * request.settings.n_envs


def _log_formats() -> list[str]:
    return ["tensorboard" if importlib.util.find_spec("tensorboard") else "csv"]
