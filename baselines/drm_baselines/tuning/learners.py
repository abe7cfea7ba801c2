"""Searching the settings of a learning algorithm, by short trainings."""

from __future__ import annotations

import importlib
import math
import shlex
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.evaluation.environments import environment_config
from drm_baselines.rl import hyperparameters
from drm_baselines.rl.hyperparameters import Hyperparameters
from drm_baselines.rl.request import SilentWatcher, TrainingRequest
from drm_baselines.support import storage
from drm_baselines.support.executors import Tell
from drm_baselines.support.extras import needing
from drm_baselines.support.places import Place

if TYPE_CHECKING:
    pass
from drm_baselines.rl.hyperparameters.toml import toml_of
from drm_baselines.tuning.search import BEST_FILE, TRIALS_FILE, Search, origin
from drm_baselines.tuning.space import LEARNING, check_target
from drm_baselines.tuning.trials import (
    LOST,
    METRIC,
    Outcome,
    Progress,
    StoppedError,
    UnfitError,
    Verdict,
    best_of,
    budget_of,
    silent,
    summary_of,
)

ENV_ID = "drm_env/SlewResidual-v0"
"""Environment that settings of learning are searched in, if no other is named."""

LEARNER_SUFFIXES = {
    ENV_ID: "",
    "drm_env/SlewResidual-v1": "",
    "drm_env/Slew-v0": "_direct",
    "drm_env/Slew-v1": "_direct",
}
"""What the benchmark's learners are called after their algorithm, by environment: residuals and
policies end to end."""

CURVE_EPISODES = 100
"""Episodes behind the tip error of a trained policy."""


@dataclass(frozen=True, kw_only=True)
class LearningRequest:
    """Which algorithm's settings to search, with how many trials of how many steps."""

    algorithm: str
    steps: int = 400_000
    trials: int = 20
    seed: int = 0
    base: Path | None = None
    """Settings that the search begins with and keeps elsewhere; none: the packaged ones."""
    env_id: str = ENV_ID
    at_once: int = 1

    @property
    def command(self) -> str:
        """The command that makes the search anew."""
        environment = "" if self.env_id == ENV_ID else f" --env {shlex.quote(self.env_id)}"
        base = "" if self.base is None else f" --hyperparameters {shlex.quote(str(self.base))}"
        return (
            f"drm tune {self.algorithm}{environment} --steps {self.steps} --trials {self.trials} "
            f"--seed {self.seed}{base}{'' if self.at_once == 1 else f' --at-once {self.at_once}'}"
        )

    @property
    def learner(self) -> str:
        """Name of what is searched: the algorithm, with what its environment adds."""
        other = f"_{self.env_id.rpartition('/')[2]}"
        return self.algorithm + LEARNER_SUFFIXES.get(self.env_id, other)


def learning_parameters(settings: Hyperparameters) -> dict[str, float]:
    """Return what is searched of learning, as complete settings have it."""
    model, network = settings.model, settings.network
    values: dict[str, Any] = {
        **model,
        "learning_rate": settings.learning_rate,
        "log_std_init": network.log_std_init,
        "width": network.layers[0],
        "lstm_units": network.lstm_units,
    }
    if "gamma" in model:
        values["forgetting"] = 1.0 - model["gamma"]
    if {"n_steps", "batch_size"} <= set(model):
        values["minibatches"] = settings.n_envs * model["n_steps"] // model["batch_size"]
    return {
        dimension.name: values[dimension.name]
        for dimension in LEARNING[settings.algorithm]
        if dimension.name in values
    }


def learning_settings(base: Hyperparameters, parameters: Mapping[str, Any]) -> Hyperparameters:
    """Return complete settings: ``base`` with the parameters that are searched.

    Raises
    ------
    BaselineError
        Impossible settings.
    """
    data = base.to_dict()
    model, network = data["model"], data["network"]
    for name, value in parameters.items():
        if name == "learning_rate":
            data["learning_rate"] = value
        elif name == "forgetting":
            model["gamma"] = 1.0 - value
        elif name == "minibatches":
            model["batch_size"] = base.n_envs * model["n_steps"] // value
        elif name == "log_std_init":
            network["log_std_init"] = value
        elif name == "width":
            network["layers"] = [value] * len(base.network.layers)
        elif name == "lstm_units":
            network["lstm_units"] = value
        else:
            model[name] = value
    return hyperparameters.from_data(data, "searched settings")


class _Watcher(SilentWatcher):
    """Tells the steps of a training."""

    def __init__(self, tell: Tell, total: int) -> None:
        super().__init__()
        self._tell, self._total = tell, total

    def advanced(self, steps: int, recent: Mapping[str, float]) -> None:  # noqa: ARG002
        """Tell."""
        self._tell(steps, self._total)


@dataclass(frozen=True, kw_only=True)
class _Judge:
    """Trains with the settings of a trial; without a directory nothing of it is kept."""

    request: LearningRequest
    base: Hyperparameters
    directory: Path | None

    def __call__(self, number: int, parameters: Mapping[str, Any], tell: Tell) -> Verdict:
        """See :class:`drm_baselines.tuning.trials.Judge`."""
        name = f"trial_{number:03d}"
        if self.directory is not None:
            return self._trained(self.directory / name, parameters, tell)
        with tempfile.TemporaryDirectory(prefix="drm-tune-") as folder:
            return self._trained(Path(folder) / name, parameters, tell)

    def _trained(self, folder: Path, parameters: Mapping[str, Any], tell: Tell) -> Verdict:
        from drm_baselines.rl import training

        request = self.request
        try:
            settings = learning_settings(self.base, parameters)
            asked = TrainingRequest(
                algorithm=request.algorithm,
                env_id=request.env_id,
                options={},
                steps=request.steps,
                seed=request.seed,
                settings=settings,
                evaluations=1,
                evaluation_episodes=CURVE_EPISODES,
            )
            watcher = _Watcher(tell, request.steps)
            # What an interruption left there is trained anew, to the same digits.
            record = training.train(folder, asked, watcher=watcher, force=True)
        except (BaselineError, drm_env.DrmError, ValueError) as error:
            # SB3 raises ValueError where a policy has come to NaN.
            raise UnfitError(str(error)) from error
        if record.status != "finished":
            raise StoppedError
        for buffer in (folder / "checkpoints").glob("replay_buffer_*"):
            # Hundreds of megabytes that only going on with this one training would need.
            buffer.unlink()
        episodes = watcher.points[-1].episodes
        value = episodes.estimate(METRIC.name).value
        return Verdict(
            value=(value if math.isfinite(value) else LOST) * METRIC.scale,
            cost={"environment_steps": record.steps, "training_seconds": record.wall_time},
        )


def tune_learning(
    directory: Path,
    request: LearningRequest,
    *,
    force: bool = False,
    progress: Progress | None = None,
    place: Place | None = None,
) -> Outcome:
    """Search the settings of a learning algorithm by short trainings, and write the best.

    Parameters and errors are those of :func:`tune_law`; the extra ``learn`` is needed, and an
    environment that drm-env does not have is a :class:`BaselineError` too.
    """
    space = LEARNING[check_target(request.algorithm, tuple(LEARNING))]
    with needing("training", "learn"):
        importlib.import_module("drm_baselines.rl.training")
    base = hyperparameters.load_hyperparameters(request.algorithm, request.base)
    environment_config(request.env_id, base.env)
    judge = _Judge(
        request=request,
        base=base,
        # workers of a cluster train in directories of their own
        directory=None if place is not None and place.ray is not None else directory,
    )
    known = learning_parameters(base)
    search = Search(
        directory=directory,
        settings={
            "algorithm": request.algorithm,
            "environment": request.env_id,
            "steps": request.steps,
            "seed": request.seed,
            "episodes": CURVE_EPISODES,
            "space": [dimension.to_dict() for dimension in space],
            "packaged settings": base.to_dict(),
            **({} if request.at_once == 1 else {"at once": request.at_once}),
        },
        space=space,
        start={
            dimension.name: known[dimension.name]
            for dimension in space
            if dimension.name in known and dimension.holds(known[dimension.name])
        },
        seed=request.seed,
        label=request.learner,
        at_once=request.at_once,
        cores_each=base.torch_threads,
    )
    trials, found, interrupted = search.run(
        request.trials, judge, force=force, progress=progress or silent, place=place
    )
    best = best_of(trials, request.learner)
    settings = learning_settings(base, best.parameters)
    content = {
        "name": request.learner,
        "settings": settings.to_dict(),
        **summary_of(trials, space, search.start),
        "budget": budget_of(trials),
        **origin(request.command, request.seed, space),
    }
    note = (
        f"The best of {len(trials)} trials of {request.steps:,} steps each: trial {best.number},\n"
        f"tip error RMS {best.value:.4g} mm (interquartile mean of {CURVE_EPISODES} episodes of "
        f"the learning curve).\nMade by: {request.command}"
    )
    text = toml_of(settings, note)
    path = storage.write_text(directory / BEST_FILE, text, overwrite=True)
    content["settings file"] = text
    content["record"] = [
        {
            "trial": trial.number,
            "value": trial.value,
            "parameters": dict(trial.parameters),
            "seconds": trial.seconds,
            "reason": trial.reason,
        }
        for trial in trials
    ]
    return Outcome(
        content=content,
        found=found,
        interrupted=interrupted,
        files=(path, directory / TRIALS_FILE),
    )
