"""Training with Stable-Baselines3 and its contributions on the native batch of environments.

A run is one directory (see :mod:`drm_baselines.rl.run_record`). It can be interrupted at any time
and resumed; the policy beside the record is always the newest one, exported as plain arrays. The
learning curve is measured by flying the deterministic policy over fixed episodes, judged by the
engine's metrics, on seeds that training never draws.
"""

from __future__ import annotations

import contextlib
import importlib.util
import shlex
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import drm_env
from drm_baselines.errors import BaselineError, RunError
from drm_baselines.evaluation.environments import config_data, environment_config
from drm_baselines.policies.policy_file import (
    load_policy,
    remove_policy,
)
from drm_baselines.rl import hyperparameters
from drm_baselines.rl.algorithms import ALGORITHMS
from drm_baselines.rl.model import begin_with, make_envs, make_model, set_threads, type_of
from drm_baselines.rl.request import SilentWatcher, TrainingRequest, Watcher
from drm_baselines.rl.run import Monitor, Run
from drm_baselines.rl.run_record import (
    EVALUATIONS_FILE,
    RUN_FILE,
    RunRecord,
    load_run,
    open_checkpoint,
)
from drm_baselines.support import provenance, storage, workplace
from drm_baselines.support.extras import needing
from drm_baselines.support.interruption import stop_on_signal
from drm_baselines.support.seeds import CURVE_SEED, episode_seeds

with needing("training", "learn"):
    from stable_baselines3.common.logger import configure
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm


WORK = workplace.Work("drm train")
"""What is noted in the directory of a run while it is trained."""


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


def asked(request: TrainingRequest) -> dict[str, Any]:
    """Return what the record of a run says of the request that it was started with."""
    config = environment_config(request.env_id, {**request.settings.env, **request.options})
    record = _new_record(request, config)
    names = (
        "algorithm", "env_id", "options", "config", "hyperparameters", "seed", "target_steps",
        "evaluations", "evaluation_episodes", "start",
    )  # fmt: skip
    plain = storage.plain({name: getattr(record, name) for name in names})
    return dict(plain)


def check(request: TrainingRequest) -> None:
    """Refuse, before any work, what cannot be trained, as far as it is seen without a model.

    Raises
    ------
    drm_env.ConfigError, BaselineError
        Impossible environment options or numbers of episodes.
    """
    environment_config(request.env_id, {**request.settings.env, **request.options})
    episode_seeds(CURVE_SEED, request.evaluation_episodes)


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
    _check_place(directory, force)
    set_threads(request.settings)
    env, first_seed = make_envs(request, config, 0)
    try:
        model = make_model(request, env)
        if request.start is not None:
            begin_with(model, request.start, config)
        # Not before everything is known to be possible: what is there may be an older run.
        storage.claim_directory(directory, force=True)
        with workplace.noting(directory, WORK, before=lambda: _check_place(directory, force)):
            # With force: an interruption before the first save must not leave the old run's policy.
            for name in (RUN_FILE, EVALUATIONS_FILE):
                (directory / name).unlink(missing_ok=True)
            remove_policy(directory)
            for name in ("checkpoints", "tensorboard"):
                shutil.rmtree(directory / name, ignore_errors=True)
            # The model has seeded the environments with its own seed, which evaluations may use.
            env.seed(first_seed)
            run = Run(directory, _new_record(request, config), model, config, request)
            return _fly(run, request, first_seed, watcher or SilentWatcher())
    finally:
        env.close()


def _check_place(directory: Path, force: bool) -> None:
    """Refuse a directory that holds anything but a run which ended before it saved anything.

    Raises
    ------
    ExistingResultError
        The message says what can be done.
    """
    if (directory / RUN_FILE).exists():
        nothing = False
        with contextlib.suppress(RunError):
            nothing = load_run(directory).checkpoint is None
    else:
        nothing = WORK.is_noted(directory)
    storage.check_directory(directory, force=force or nothing)


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
    directory: Path,
    *,
    steps: int | None = None,
    trust: bool = False,
    watcher: Watcher | None = None,
) -> RunRecord:
    """Go on with an interrupted run, or extend a finished one to ``steps`` steps.

    Everything else is as the run began with, also how its learning curve is measured.
    The episodes after resuming are drawn from seeds of their own, so that a resumed run is as
    good as an uninterrupted one but not bit for bit the same. A run that was killed before its
    first checkpoint begins anew.

    Parameters
    ----------
    directory
        Of the run.
    steps
        Environment steps of the whole run; those that it began with by default.
    trust
        Whether a checkpoint is loaded that this user has not written on this machine. Loading one
        runs whatever its maker wants.
    watcher
        Is told how it goes.

    Raises
    ------
    RunError
        No run there, a checkpoint that is missing, not the run's own or not this user's, or
        nothing left to do.
    BusyError
        Another process trains there.
    """
    record = load_run(directory)
    if record.checkpoint is None:
        return _begun_anew(
            directory, record, request_of(record, steps=steps), watcher or SilentWatcher()
        )
    with workplace.noting(directory, WORK):
        # what another process has written until it let the directory go counts
        return _resumed(directory, load_run(directory), steps, trust, watcher or SilentWatcher())


def _resumed(
    directory: Path, record: RunRecord, steps: int | None, trust: bool, watcher: Watcher
) -> RunRecord:
    request = request_of(record, steps=steps)
    if record.steps >= request.steps:
        raise RunError(
            f"{directory} has all of its {record.steps} steps; give a larger --steps to go on"
        )
    config = environment_config(record.env_id, {"config": record.config})
    with contextlib.ExitStack() as opened:
        kinds = ("model", *({"replay_buffer"} & (record.checkpoint or {}).keys()))
        files = {
            kind: opened.enter_context(open_checkpoint(directory, record, kind, trust=trust))
            for kind in kinds
        }
        set_threads(request.settings)
        env, first_seed = make_envs(request, config, len(record.segments))
        opened.callback(env.close)
        model = type_of(request.settings).load(files["model"], env=env, device="cpu")
        model.set_random_seed(request.seed + len(record.segments))
        if isinstance(model, OffPolicyAlgorithm):
            if "replay_buffer" in files:
                model.load_replay_buffer(files["replay_buffer"])
            else:
                # Killed before it could save its buffer: fill it anew before learning from it.
                model.learning_starts += model.num_timesteps
        env.seed(first_seed)
        record.target_steps, record.status = request.steps, "running"
        run = Run(directory, record, model, config, request)
        return _fly(run, request, first_seed, watcher)


def _begun_anew(
    directory: Path, record: RunRecord, request: TrainingRequest, watcher: Watcher
) -> RunRecord:
    """Train what a run was asked for that ended before it could save anything.

    Raises
    ------
    RunError
        The policy that it began with is not what it was.
    """
    if record.start is not None:
        start = Path(str(record.start.get("directory")))
        if _start_of(start) != record.start:
            raise RunError(f"{start}: the policy is not the one that the run began with")
        request = replace(request, start=start)
    return train(directory, request, watcher=watcher)


def _fly(run: Run, request: TrainingRequest, first_seed: int, watcher: Watcher) -> RunRecord:
    record, model = run.record, run.model
    record.segments.append(
        {
            "begin_steps": int(model.num_timesteps),
            "first_seed": first_seed,
            "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            **provenance.provenance(),
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
                callback=Monitor(run, watcher, stop),
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
    # On-policy algorithms count updates, the others episodes, of which a batch ends many at a time.
    return 4 * request.settings.n_envs if ALGORITHMS[request.algorithm].replays else 5


def _log_formats() -> list[str]:
    return ["tensorboard" if importlib.util.find_spec("tensorboard") else "csv"]
