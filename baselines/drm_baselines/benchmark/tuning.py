"""Tuning: the gains of the control laws, and the settings of learning, searched with Optuna.

A law flies manoeuvres drawn like those of a suite, but from seeds of training, never the suite's
own, and is judged by the interquartile mean of the tip error. A search lives in one directory:

    settings.json   what is searched; a directory goes on only with the same
    journal.log     Optuna's record of the trials
    trials.csv      the trials as a table
    gains.json      the best law (searches of gains)
    best.toml       the best settings, for ``drm train --hyperparameters`` (searches of settings)
    trial_NNN/      the training runs of a search of settings

The draws of trial n depend on the seed, on n and on the trials before it alone, so that a search
that was interrupted ends with the same digits as one that was not.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import json
import math
import shlex
import shutil
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import drm_env
from drm_baselines import hyperparameters, storage
from drm_baselines.benchmark import regulator, suites
from drm_baselines.errors import BaselineError, ExistingResultError, missing_extra
from drm_baselines.evaluation import TRAINING_SEED, environment_config
from drm_baselines.hyperparameters import Hyperparameters
from drm_baselines.interruption import stop_on_signal
from drm_baselines.metrics import describe
from drm_baselines.reading import read_table, shown
from drm_baselines.statistics import interquartile_mean

if TYPE_CHECKING:
    from optuna.study import Study
    from optuna.trial import FrozenTrial

FORMAT = "drm-gains"
FORMAT_VERSION = 1
SETTINGS_FORMAT = "drm-tuning"

GAINS_FILE = "gains.json"
BEST_FILE = "best.toml"
TRIALS_FILE = "trials.csv"
SETTINGS_FILE = "settings.json"
JOURNAL_FILE = "journal.log"
_LOCK_FILE = "lock"

TUNING_SEED = TRAINING_SEED + 500_000_000
"""First seed of the manoeuvres that gains are tuned on, the same for every seed of the search."""

LOST = 10.0
"""Tip error (m) that a diverged manoeuvre counts with."""

ENV_ID = "drm_env/SlewResidual-v0"
"""Environment that settings of learning are searched in, if no other is named."""

LEARNER_SUFFIXES = {ENV_ID: "", "drm_env/Slew-v0": "_direct"}
"""What the benchmark's learners are called after their algorithm, by environment: residuals and
policies end to end."""

CURVE_EPISODES = 100
"""Episodes behind the tip error of a trained policy."""

_METRIC = describe("tip_error_rms")
_EDGE = 0.02


@dataclass(frozen=True, kw_only=True)
class Dimension:
    """One number that is searched.

    Attributes
    ----------
    name
        Place in the law's data or name of the setting.
    unit, reason
        For readers; the reason is why the range is what it is.
    low, high
        Range, both ends included.
    log
        Whether orders of magnitude are equally likely, or values.
    integer
        Whether only integers count.
    choices
        The values, where they are no range.
    start
        Value of the first trial, if it is known beforehand.
    """

    name: str
    unit: str
    reason: str
    low: float = math.nan
    high: float = math.nan
    log: bool = True
    integer: bool = False
    choices: tuple[int, ...] = ()
    start: float | None = None

    def holds(self, value: float) -> bool:
        """Tell whether ``value`` can be drawn."""
        return value in self.choices if self.choices else self.low <= value <= self.high

    def at_edge(self, value: float) -> bool:
        """Tell whether ``value`` lies at an end of its range: a wider one may hold a better."""
        if self.choices:
            return False
        low, high, here = self.low, self.high, value
        if self.log:
            low, high, here = math.log(low), math.log(high), math.log(value)
        return not _EDGE <= (here - low) / (high - low) <= 1.0 - _EDGE

    def to_dict(self) -> dict[str, Any]:
        """Return what decides which values are drawn, as plain data."""
        data: dict[str, Any] = {"name": self.name, "unit": self.unit}
        if self.choices:
            return {**data, "choices": list(self.choices), "start": self.start}
        return {**data, "low": self.low, "high": self.high, "log": self.log,
                "integer": self.integer, "start": self.start}  # fmt: skip


GAINS: dict[str, tuple[Dimension, ...]] = {
    "linear": (
        Dimension(
            name="root.rate_gain",
            unit="N m s/rad",
            low=1e3,
            high=3e5,
            start=8e4,
            reason="full torque at 0.1 rad/s, down to 0.3 mrad/s, where the wheel only switches",
        ),
        Dimension(
            name="root.angle_gain",
            unit="N m/rad",
            low=1e3,
            high=1e6,
            start=8e3,
            reason="full torque at 0.1 rad, down to 0.1 mrad (1.5 mm at the tip)",
        ),
        Dimension(
            name="tip.rate_gain",
            unit="N s",
            low=1.0,
            high=5e4,
            start=500.0,
            reason="from no damping to full torque at beta' of 0.2 mm/s",
        ),
    ),
    "lyapunov": (
        Dimension(
            name="root.rate_gain",
            unit="N m s/rad",
            low=1e3,
            high=3e5,
            start=3e4,
            reason="as for linear",
        ),
        Dimension(
            name="root.angle_gain",
            unit="N m/rad",
            low=1e3,
            high=1e6,
            start=3e3,
            reason="as for linear",
        ),
        Dimension(
            name="root.acceleration_gain",
            unit="1",
            low=1e-6,
            high=1.0,
            start=2e-4,
            reason="from nothing of the inertial moment to all of it",
        ),
        Dimension(
            name="tip.gain",
            unit="1/s",
            low=1e-3,
            high=1e2,
            start=1.0,
            reason="times Jtb, 850 to 16,000 kg m: the range of linear's gain and more",
        ),
    ),
    "lqr": (
        Dimension(
            name="root_effort",
            unit="mm",
            low=0.1,
            high=1e3,
            reason="full torque is worth 0.1 mm of tip error (the wheel switches) to 1 m (rests)",
        ),
        Dimension(
            name="tip_effort",
            unit="mm",
            low=1e-2,
            high=1e3,
            reason="as for the root, the tip wheel being ten times weaker",
        ),
        Dimension(
            name="rate",
            unit="s",
            low=1e-2,
            high=1e2,
            reason="the error's rate counts from not at all to alone: manoeuvres last 30 s",
        ),
        Dimension(
            name="vibration",
            unit="s",
            low=1e-3,
            high=1e2,
            reason="as the rate; vibration is faster, at 1 to 10 rad/s",
        ),
    ),
}
"""What is searched for each law: gains of ``linear`` and ``lyapunov``, where the first trial is the
thesis' own choice, and weights of ``lqr`` (:func:`drm_baselines.benchmark.regulator.gains_at`)."""

LEARNING: dict[str, tuple[Dimension, ...]] = {
    "ppo": (
        Dimension(
            name="learning_rate",
            unit="1",
            low=1e-4,
            high=1e-2,
            reason="Adam's default 1e-3 and an order of magnitude to both sides",
        ),
        Dimension(
            name="forgetting",
            unit="1",
            low=3e-3,
            high=0.1,
            reason="1 - gamma a decision: 1 to 30 s at 10 Hz, a manoeuvre lasts 20 s",
        ),
        Dimension(
            name="gae_lambda",
            unit="1",
            low=0.8,
            high=1.0,
            log=False,
            reason="from mostly the critic's word to none of it",
        ),
        Dimension(
            name="clip_range",
            unit="1",
            low=0.05,
            high=0.4,
            reason="the usual 0.2, halved twice and doubled",
        ),
        Dimension(
            name="log_std_init",
            unit="1",
            low=-3.0,
            high=0.0,
            log=False,
            reason="exploration starts at 5 to 100 % of the torque limits",
        ),
        Dimension(
            name="width",
            unit="1",
            choices=(16, 32, 64, 128, 256),
            reason="units of each hidden layer; the laws need a handful",
        ),
        Dimension(
            name="n_epochs",
            unit="1",
            low=2,
            high=20,
            integer=True,
            reason="the usual 10, doubled and divided by five",
        ),
        Dimension(
            name="minibatches",
            unit="1",
            choices=(5, 10, 20, 40),
            reason="parts that an update's samples are divided into; they divide all of them",
        ),
    ),
    "sac": (
        Dimension(
            name="learning_rate",
            unit="1",
            low=5e-5,
            high=5e-3,
            reason="the usual 3e-4 and an order of magnitude to both sides",
        ),
        Dimension(
            name="forgetting",
            unit="1",
            low=1e-3,
            high=0.1,
            reason="1 - gamma a decision: 1 to 100 s at 10 Hz, a manoeuvre lasts 20 s",
        ),
        Dimension(
            name="tau",
            unit="1",
            low=1e-3,
            high=5e-2,
            reason="the target follows the critic within 20 to 1000 updates",
        ),
        Dimension(
            name="log_std_init",
            unit="1",
            low=-4.0,
            high=-1.0,
            log=False,
            reason="exploration starts at 2 to 40 % of the torque limits",
        ),
        Dimension(
            name="width",
            unit="1",
            choices=(32, 64, 128, 256),
            reason="units of each hidden layer; wider ones are too slow for a search",
        ),
        Dimension(
            name="batch_size",
            unit="1",
            choices=(128, 256, 512, 1024),
            reason="the usual 256 and two doublings",
        ),
        Dimension(
            name="gradient_steps",
            unit="1",
            low=2,
            high=64,
            integer=True,
            reason="updates of the networks every train_freq steps of all environments",
        ),
        Dimension(
            name="target_entropy",
            unit="1",
            low=-12.0,
            high=-2.0,
            log=False,
            reason="the usual -2, minus the number of actions, is noise that shakes the arm",
        ),
    ),
}
"""What is searched for each learning algorithm, around the packaged settings; these are the first
trial."""

TARGETS = (*GAINS, *LEARNING)
"""Everything that can be tuned."""

Progress = Callable[[str, int, int, str], None]
"""Called with (label, done, total, note) while trials and trainings go on."""


class UnfitError(Exception):
    """A trial whose parameters make nothing that could fly; the search goes on without it."""


class StoppedError(Exception):
    """A trial that was interrupted and does not count."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a trial was worth: the objective in mm, and figures that are summed into the budget."""

    value: float
    cost: Mapping[str, float] = field(default_factory=dict)


Judge = Callable[[int, Mapping[str, Any]], Verdict]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One trial of a search.

    ``number`` counts from 0, ``value`` is in mm and none for a trial that was ``"pruned"`` for
    ``reason``; ``seconds`` is wall time.
    """

    number: int
    value: float | None
    state: str
    parameters: Mapping[str, Any]
    seconds: float
    cost: Mapping[str, float]
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Where a search stands.

    Attributes
    ----------
    content
        What ``gains.json`` holds, or the same about settings of learning.
    found
        Trials that were there before.
    interrupted
        Whether trials are missing.
    files
        What was written.
    """

    content: dict[str, Any]
    found: int
    interrupted: bool
    files: tuple[Path, ...]


@dataclass(frozen=True, kw_only=True)
class LawRequest:
    """Which law to tune, on how many manoeuvres like those of which suite, with how many trials."""

    law: str
    suite: str = "robust"
    scenarios: int = 400
    trials: int = 200
    seed: int = 0

    @property
    def command(self) -> str:
        """The command that makes the search anew."""
        return (
            f"drm tune {self.law} --suite {self.suite} --scenarios {self.scenarios} "
            f"--trials {self.trials} --seed {self.seed}"
        )


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

    @property
    def command(self) -> str:
        """The command that makes the search anew."""
        environment = "" if self.env_id == ENV_ID else f" --env {shlex.quote(self.env_id)}"
        base = "" if self.base is None else f" --hyperparameters {shlex.quote(str(self.base))}"
        return (
            f"drm tune {self.algorithm}{environment} --steps {self.steps} --trials {self.trials} "
            f"--seed {self.seed}{base}"
        )

    @property
    def learner(self) -> str:
        """Name of what is searched: the algorithm, with what its environment adds."""
        other = f"_{self.env_id.rpartition('/')[2]}"
        return self.algorithm + LEARNER_SUFFIXES.get(self.env_id, other)


@dataclass(frozen=True, kw_only=True)
class Draw:
    """Manoeuvres of training: scenarios, their strata with first seed and number, and a digest."""

    scenarios: Sequence[Mapping[str, Any]]
    strata: Sequence[Mapping[str, Any]]
    digest: str


def check_target(name: str, known: Sequence[str] = TARGETS) -> str:
    """Return ``name`` if it can be tuned.

    Raises
    ------
    BaselineError
        It cannot; the message lists what can.
    """
    if name not in known:
        raise BaselineError(f"{name!r} cannot be tuned; there are {', '.join(known)}")
    return name


def law_of(name: str, parameters: Mapping[str, float]) -> dict[str, Any]:
    """Return a law as data for the engine from the parameters that are searched.

    Raises
    ------
    BaselineError
        No such law, or weights that no regulator solves.
    """
    check_target(name, tuple(GAINS))
    if name == "lqr":
        # An ill-conditioned design is judged by how it flies.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            return regulator.scheduled_law(parameters)
    law: dict[str, Any] = {"name": name}
    for path, value in parameters.items():
        wheel, _, gain = path.partition(".")
        law.setdefault(wheel, {})[gain] = value
    return law


def training_scenarios(suite: str, count: int) -> Draw:
    """Draw manoeuvres from the distributions of a suite, on seeds of training.

    Raises
    ------
    BaselineError
        No such suite, one that lists its manoeuvres, or a number that its strata cannot share.
    """
    strata = suites.STRATA
    if count < len(strata) or count % len(strata):
        raise BaselineError(
            f"scenarios must be a positive multiple of {len(strata)} (the strata), got {count}"
        )
    chosen, each = suites.suite_named(suite), count // len(strata)
    scenarios: list[dict[str, Any]] = []
    rows = []
    for stratum, (title, _, _) in enumerate(strata):
        first = TUNING_SEED + stratum * each
        config = chosen.stratum_config(stratum)
        scenarios += drm_env.sample_scenarios(config=config, seed=first, n=each)
        rows.append({"name": title, "first_seed": first, "count": each})
    text = json.dumps(storage.plain(scenarios), sort_keys=True, allow_nan=False)
    return Draw(
        scenarios=scenarios, strata=rows, digest=hashlib.sha256(text.encode()).hexdigest()
    )  # fmt: skip


def fly(law: Mapping[str, Any], scenarios: Sequence[Mapping[str, Any]]) -> Verdict:
    """Fly a law and return the interquartile mean of its tip error in mm, and what that cost.

    Raises
    ------
    drm_env.ConfigError
        Impossible gains.
    """
    metrics = drm_env.rollout(scenarios, law=dict(law), seed=TUNING_SEED)
    error = np.asarray(metrics[_METRIC.name], dtype=np.float64)
    lost = ~np.isfinite(error) | (np.asarray(metrics["diverged"]) > 0.0)
    duration = np.asarray(metrics["duration"], dtype=np.float64)
    steps = 0
    for scenario, seconds in zip(scenarios, duration, strict=True):
        period = scenario["sample_period"]
        substeps = math.ceil(period / scenario["integrator_step"] - 1e-9)
        steps += round(seconds / period) * max(1, substeps)
    return Verdict(
        value=interquartile_mean(np.where(lost, LOST, error)) * _METRIC.scale,
        cost={
            "episodes": len(scenarios),
            "diverged": int(lost.sum()),
            "simulated_seconds": float(duration.sum()),
            "integrator_steps": steps,
        },
    )


def tune_law(
    directory: Path,
    request: LawRequest,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Search the gains of a law, or go on with a search, and write the best law found.

    Parameters
    ----------
    directory
        Of the search; one that holds the same search goes on with the missing trials.
    request
        What is searched.
    force
        Whether to start anew in a directory that is not empty.
    progress
        Called after each trial.

    Raises
    ------
    BaselineError
        Unknown names, a directory of another search, or no trial that could be flown.
    ExistingResultError
        The directory holds something else.
    """
    space = GAINS[check_target(request.law, tuple(GAINS))]
    draw = training_scenarios(request.suite, request.scenarios)

    def judge(_: int, parameters: Mapping[str, Any]) -> Verdict:
        try:
            return fly(law_of(request.law, parameters), draw.scenarios)
        except (BaselineError, drm_env.DrmError) as error:
            raise UnfitError(str(error)) from error

    search = _Search(
        directory=directory,
        settings={
            "law": request.law,
            "suite": request.suite,
            "scenarios": request.scenarios,
            "seed": request.seed,
            "space": [dimension.to_dict() for dimension in space],
            "drawn scenarios": draw.digest,
        },
        space=space,
        start=_start_of(space),
        seed=request.seed,
        label=request.law,
    )
    trials, found, interrupted = search.run(
        request.trials, judge, force=force, progress=progress or _silent
    )
    best = _best(trials, request.law)
    content = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "name": request.law,
        "law": law_of(request.law, best.parameters),
        **_summary(trials, space, search.start),
        "budget": _budget(trials),
        "scenarios": {
            "suite": request.suite,
            "count": request.scenarios,
            "strata": list(draw.strata),
            "sha256": draw.digest,
        },
        **_origin(request.command, request.seed, space),
    }
    path = directory / GAINS_FILE
    content = _kept(path, content)
    storage.write_json(path, content, overwrite=True)
    return Outcome(
        content=content,
        found=found,
        interrupted=interrupted,
        files=(path, directory / TRIALS_FILE),
    )


def learning_parameters(settings: Hyperparameters) -> dict[str, float]:
    """Return what is searched of learning, as complete settings have it."""
    model, network = settings.model, settings.network
    values: dict[str, Any] = {
        **model,
        "learning_rate": settings.learning_rate,
        "log_std_init": network.log_std_init,
        "width": network.layers[0],
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
        else:
            model[name] = value
    return hyperparameters.from_data(data, "searched settings")


def toml_of(settings: Hyperparameters, comment: str = "") -> str:
    """Return settings as the text of a file that ``drm train --hyperparameters`` reads."""
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    data = settings.to_dict()
    tables = {name: data.pop(name) for name in ("env", "model", "network")}
    lines += [f"{_toml_key(name)} = {_toml_value(value)}" for name, value in data.items()]
    for name, table in tables.items():
        if table:
            lines += ["", f"[{name}]"]
            lines += [f"{_toml_key(key)} = {_toml_value(value)}" for key, value in table.items()]
    return "\n".join(lines) + "\n"


def tune_learning(
    directory: Path,
    request: LearningRequest,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Search the settings of a learning algorithm by short trainings, and write the best.

    Parameters and errors are those of :func:`tune_law`; the extra ``learn`` is needed, and an
    environment that drm-env does not have is a :class:`BaselineError` too.
    """
    space = LEARNING[check_target(request.algorithm, tuple(LEARNING))]
    try:
        from drm_baselines import training
    except ImportError as error:
        raise missing_extra("training", "learn", error) from error
    base = hyperparameters.load_hyperparameters(request.algorithm, request.base)
    environment_config(request.env_id, base.env)
    show = progress or _silent

    class Watcher(training.SilentWatcher):
        """Shows the steps of one training."""

        def advanced(self, steps: int, recent: Mapping[str, float]) -> None:  # noqa: ARG002
            show("training", steps, request.steps, "steps")

    def judge(number: int, parameters: Mapping[str, Any]) -> Verdict:
        folder = directory / f"trial_{number:03d}"
        try:
            settings = learning_settings(base, parameters)
            asked = training.TrainingRequest(
                algorithm=request.algorithm,
                env_id=request.env_id,
                options={},
                steps=request.steps,
                seed=request.seed,
                settings=settings,
                evaluations=1,
                evaluation_episodes=CURVE_EPISODES,
            )
            watcher = Watcher()
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
        value = episodes.estimate(_METRIC.name).value
        return Verdict(
            value=(value if math.isfinite(value) else LOST) * _METRIC.scale,
            cost={"environment_steps": record.steps, "training_seconds": record.wall_time},
        )

    known = learning_parameters(base)
    search = _Search(
        directory=directory,
        settings={
            "algorithm": request.algorithm,
            "environment": request.env_id,
            "steps": request.steps,
            "seed": request.seed,
            "episodes": CURVE_EPISODES,
            "space": [dimension.to_dict() for dimension in space],
            "packaged settings": base.to_dict(),
        },
        space=space,
        start={
            dimension.name: known[dimension.name]
            for dimension in space
            if dimension.name in known and dimension.holds(known[dimension.name])
        },
        seed=request.seed,
        label=request.learner,
    )
    trials, found, interrupted = search.run(request.trials, judge, force=force, progress=show)
    best = _best(trials, request.learner)
    settings = learning_settings(base, best.parameters)
    content = {
        "name": request.learner,
        "settings": settings.to_dict(),
        **_summary(trials, space, search.start),
        "budget": _budget(trials),
        **_origin(request.command, request.seed, space),
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


def package(outcome: Outcome) -> Path:
    """Copy the result of a finished search into the package; return the file.

    Gains go to ``gains``; settings of learning become those of the benchmark's learner, with the
    record of the search beside them (``<name>.search.json``).

    Raises
    ------
    BaselineError
        The search was interrupted.
    """
    content = dict(outcome.content)
    if outcome.interrupted:
        raise BaselineError("the search was interrupted; only a finished one is packaged")
    name, here = content["name"], Path(__file__).parent
    if content.get("format") == FORMAT:
        return storage.write_json(here / "gains" / f"{name}.json", content, overwrite=True)
    text = content.pop("settings file")
    storage.write_json(here / "learners" / f"{name}.search.json", content, overwrite=True)
    return storage.write_text(learner_file(name), text, overwrite=True)


def check_package(request: LearningRequest) -> None:
    """Refuse a search whose result :func:`package` has no place for.

    Raises
    ------
    BaselineError
        An environment that the benchmark trains nobody in, or settings to begin with that the
        result would overwrite.
    """
    if request.env_id not in LEARNER_SUFFIXES:
        raise BaselineError(
            f"--package has learners for {', '.join(LEARNER_SUFFIXES)}, got --env {request.env_id}"
        )
    base = request.base
    if base is not None and base.resolve() == learner_file(request.learner).resolve():
        raise BaselineError(
            f"--hyperparameters must not be the file that --package overwrites, got "
            f"{base}: the search could not be made again"
        )


def learner_file(name: str) -> Path:
    """Return the file of a learner of the benchmark, which :func:`package` writes."""
    return Path(__file__).parent / "learners" / f"{name}.toml"


def load_gains(law: str) -> dict[str, Any]:
    """Return the packaged result of tuning a law: its ``"law"`` flies, the rest says whence.

    Raises
    ------
    BaselineError
        No such law, or no packaged result of this version.
    """
    check_target(law, tuple(GAINS))
    file = resources.files(__package__) / "gains" / f"{law}.json"
    try:
        content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BaselineError(
            f"no tuned gains of {law!r} are packaged; drm tune {law} --package makes them"
        ) from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BaselineError(f"the packaged gains of {law!r} cannot be read: {error}") from error
    if not isinstance(content, dict) or (content.get("format"), content.get("format_version")) != (
        FORMAT, FORMAT_VERSION,
    ):  # fmt: skip
        raise BaselineError(
            f"the packaged gains of {law!r} are not of format {FORMAT!r} {FORMAT_VERSION}"
        )
    return content


@dataclass(frozen=True, kw_only=True)
class _Search:
    """A search in its directory."""

    directory: Path
    settings: Mapping[str, Any]
    space: Sequence[Dimension]
    start: Mapping[str, Any]
    seed: int
    label: str

    def run(
        self, total: int, judge: Judge, *, force: bool, progress: Progress
    ) -> tuple[list[Trial], int, bool]:
        """Run the missing trials; return all, how many were there, and whether some are missing."""
        optuna = _optuna()
        begun = (self.directory / SETTINGS_FILE).is_file() and not force
        if not begun:
            storage.claim_directory(self.directory, force=force)
        with _alone(self.directory), _quiet(optuna), stop_on_signal() as stop:
            if begun:
                self._check_settings()
            else:
                self._clear()
                storage.write_json(
                    self.directory / SETTINGS_FILE,
                    {"format": SETTINGS_FORMAT, "format_version": FORMAT_VERSION, **self.settings},
                    overwrite=True,
                )
            study = _open_study(optuna, self.directory / JOURNAL_FILE)
            trials = _trials_of(study)
            found = len(trials)
            progress(self.label, found, total, _note(trials))
            try:
                while len(trials) < total and not stop.is_set():
                    self._one(optuna, study, len(trials), judge)
                    trials = _trials_of(study)
                    progress(self.label, len(trials), total, _note(trials))
            except (StoppedError, KeyboardInterrupt):
                trials = _trials_of(study)
            write_trials(self.directory / TRIALS_FILE, trials, self.space)
        return trials, found, len(trials) < total

    def _one(self, optuna: Any, study: Study, number: int, judge: Judge) -> None:
        # A sampler of its own for each trial: what it draws does not depend on which process, after
        # which interruption, draws it.
        stream = np.random.SeedSequence([self.seed, number]).generate_state(1)
        study.sampler = optuna.samplers.TPESampler(seed=int(stream[0]), multivariate=True)
        if number == 0 and self.start:
            study.enqueue_trial(dict(self.start), skip_if_exists=False)
        trial = study.ask({each.name: _distribution(optuna, each) for each in self.space})
        began = time.monotonic()
        state = optuna.trial.TrialState
        try:
            verdict = judge(number, trial.params)
        except UnfitError as error:
            trial.set_user_attr("seconds", time.monotonic() - began)
            trial.set_user_attr("reason", str(error))
            study.tell(trial, state=state.PRUNED)
        except BaseException:
            study.tell(trial, state=state.FAIL)
            raise
        else:
            trial.set_user_attr("seconds", time.monotonic() - began)
            trial.set_user_attr("cost", dict(verdict.cost))
            study.tell(trial, verdict.value)

    def _check_settings(self) -> None:
        path = self.directory / SETTINGS_FILE
        stored = read_table(path, "record of a search")
        if stored.pop("format", None) != SETTINGS_FORMAT:
            raise ExistingResultError(f"{path} is not the record of a search; take another --out")
        version = stored.pop("format_version", None)
        if version != FORMAT_VERSION:
            raise BaselineError(f"{path} has format version {shown(version)}, not {FORMAT_VERSION}")
        wanted = storage.plain(dict(self.settings))
        for name in [*wanted, *(name for name in stored if name not in wanted)]:
            old, new = stored.get(name), wanted.get(name)
            if old == new:
                continue
            short = all(isinstance(each, (str, int, type(None))) for each in (old, new))
            digest = name == "drawn scenarios"
            change = (
                f"was begun with {name} {old!r}, not {new!r}"
                if short and not digest
                else f"differs from this one in its {name}"
            )
            raise BaselineError(
                f"the search in {self.directory} {change}; give another --out, or --force to "
                "start anew"
            )

    def _clear(self) -> None:
        """Remove what an older search left, and nothing else."""
        for name in (SETTINGS_FILE, JOURNAL_FILE, TRIALS_FILE, GAINS_FILE, BEST_FILE):
            (self.directory / name).unlink(missing_ok=True)
        for folder in self.directory.glob("trial_[0-9][0-9][0-9]"):
            shutil.rmtree(folder)


def write_trials(path: Path, trials: Sequence[Trial], space: Sequence[Dimension]) -> Path:
    """Write the record of a search as CSV; values are in mm, numbers to the last bit."""
    names = [dimension.name for dimension in space]
    with (
        storage.atomic_path(path, overwrite=True) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["number", "value", "state", *names, "seconds", "reason"])
        for trial in trials:
            writer.writerow(
                [
                    trial.number,
                    "" if trial.value is None else trial.value,
                    trial.state,
                    *(trial.parameters[name] for name in names),
                    f"{trial.seconds:.3f}",
                    trial.reason,
                ]
            )
    return path


def _kept(path: Path, content: dict[str, Any]) -> dict[str, Any]:
    """Return the result in ``path`` if it is the same, for it knows when it was made."""
    try:
        stored = read_table(path, "result of a search")
    except BaselineError:
        return content
    same = {**stored, "provenance": None} == {**storage.plain(content), "provenance": None}
    return stored if same else content


def _silent(label: str, done: int, total: int, note: str) -> None:
    """Show nothing."""


def _optuna() -> Any:
    try:
        import optuna
    except ImportError as error:
        raise missing_extra("tuning", "tune", error) from error
    return optuna


@contextlib.contextmanager
def _quiet(optuna: Any) -> Iterator[None]:
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)


@contextlib.contextmanager
def _alone(directory: Path) -> Iterator[None]:
    """Refuse a second search in the same directory while one runs, where the system can tell."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with (directory / _LOCK_FILE).open("w") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise BaselineError(f"another search runs in {directory}") from None
        yield


def _open_study(optuna: Any, path: Path) -> Study:
    if path.is_file():
        # A process that was killed while it wrote leaves half a line, which Optuna refuses.
        content = path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            storage.write_text(path, content[:whole].decode("utf-8"), overwrite=True)
    journal = optuna.storages.JournalStorage(optuna.storages.journal.JournalFileBackend(str(path)))
    study: Study = optuna.create_study(
        storage=journal, study_name="tune", direction="minimize", load_if_exists=True
    )
    # Trials that a killed process left unfinished do not count.
    states = optuna.trial.TrialState
    for _ in study.get_trials(deepcopy=False, states=(states.WAITING,)):
        study.ask()
    for trial in study.get_trials(deepcopy=False, states=(states.RUNNING,)):
        study.tell(trial.number, state=states.FAIL)
    return study


def _trials_of(study: Study) -> list[Trial]:
    """Return the trials that count, numbered without those that were interrupted."""
    counted = [
        trial
        for trial in study.get_trials(deepcopy=False)
        if trial.state.name in ("COMPLETE", "PRUNED")
    ]
    return [_trial_of(number, trial) for number, trial in enumerate(counted)]


def _trial_of(number: int, trial: FrozenTrial) -> Trial:
    return Trial(
        number=number,
        value=trial.value if trial.state.name == "COMPLETE" else None,
        state=trial.state.name.lower(),
        parameters=dict(trial.params),
        seconds=float(trial.user_attrs.get("seconds", 0.0)),
        cost=dict(trial.user_attrs.get("cost", {})),
        reason=str(trial.user_attrs.get("reason", "")),
    )


def _distribution(optuna: Any, dimension: Dimension) -> Any:
    kinds = optuna.distributions
    if dimension.choices:
        return kinds.CategoricalDistribution(dimension.choices)
    if dimension.integer:
        return kinds.IntDistribution(int(dimension.low), int(dimension.high), log=dimension.log)
    return kinds.FloatDistribution(dimension.low, dimension.high, log=dimension.log)


def _start_of(space: Sequence[Dimension]) -> dict[str, float]:
    return {each.name: each.start for each in space if each.start is not None}


def _note(trials: Sequence[Trial]) -> str:
    values = [trial.value for trial in trials if trial.value is not None]
    return f"best {min(values):.4g} mm" if values else "trials"


def _best(trials: Sequence[Trial], name: str) -> Trial:
    flown = [trial for trial in trials if trial.value is not None]
    if not flown:
        why = f": {trials[-1].reason}" if trials else ", it was interrupted before"
        raise BaselineError(f"the search of {name} has no trial that flew{why}")
    return min(flown, key=lambda trial: (trial.value, trial.number))


def _summary(
    trials: Sequence[Trial], space: Sequence[Dimension], start: Mapping[str, Any]
) -> dict[str, Any]:
    best = _best(trials, "")
    return {
        "parameters": dict(best.parameters),
        "objective": {
            "metric": _METRIC.name,
            "aggregate": "interquartile mean",
            "unit": _METRIC.unit,
            "value": best.value,
            # the thesis' gains or the packaged settings
            "first": trials[0].value if start else None,
        },
        "at_edge": [each.name for each in space if each.at_edge(float(best.parameters[each.name]))],
        "trials": {
            "count": len(trials),
            "pruned": sum(trial.value is None for trial in trials),
            "best": best.number,
        },
    }


def _budget(trials: Sequence[Trial]) -> dict[str, float]:
    total: dict[str, float] = {}
    for trial in trials:
        for name, cost in trial.cost.items():
            total[name] = total.get(name, 0) + cost
    return {**total, "wall_seconds": round(sum(trial.seconds for trial in trials), 3)}


def _origin(command: str, seed: int, space: Sequence[Dimension]) -> dict[str, Any]:
    return {
        "search": {
            "sampler": "TPE, multivariate",
            "optuna": _optuna().__version__,
            "seed": seed,
            "space": [
                {**each.to_dict(), "reason": each.reason} for each in space
            ],
        },
        "command": command,
        "provenance": storage.provenance(),
    }  # fmt: skip


def _toml_key(name: str) -> str:
    return name if name.replace("_", "a").isalnum() and name.isascii() else json.dumps(name)


def _toml_value(value: Any) -> str:
    if isinstance(value, Mapping):
        pairs = (f"{_toml_key(str(key))} = {_toml_value(item)}" for key, item in value.items())
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)
