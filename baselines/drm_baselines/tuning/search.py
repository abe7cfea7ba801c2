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
that was interrupted ends with the same digits as one that was not. Where some trials are drawn at
once, to be run side by side, those before it are the ones of earlier groups: the digits depend on
how many, and not on where they are run.
"""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drm_baselines.errors import BaselineError, ExistingResultError
from drm_baselines.support import provenance, storage, workplace
from drm_baselines.support.executors import Executor, Tell
from drm_baselines.support.extras import needing
from drm_baselines.support.interruption import stop_on_signal
from drm_baselines.support.places import Place, executor
from drm_baselines.support.reading import read_table, shown

if TYPE_CHECKING:
    from optuna.study import Study
    from optuna.trial import FrozenTrial
from drm_baselines.policies.gains import FORMAT_VERSION
from drm_baselines.tuning.space import Dimension
from drm_baselines.tuning.trials import (
    Judge,
    Progress,
    StoppedError,
    Trial,
    UnfitError,
    Verdict,
    note_of,
    write_trials,
)

SETTINGS_FORMAT = "drm-tuning"

GAINS_FILE = "gains.json"
BEST_FILE = "best.toml"
TRIALS_FILE = "trials.csv"
SETTINGS_FILE = "settings.json"
JOURNAL_FILE = "journal.log"


@dataclass(frozen=True, kw_only=True)
class Search:
    """A search in its directory."""

    directory: Path
    settings: Mapping[str, Any]
    space: Sequence[Dimension]
    start: Mapping[str, Any]
    seed: int
    label: str
    at_once: int = 1
    """Trials that are drawn together and may be run side by side."""
    cores_each: int = 1
    """Cores that a trial may use where trials are shared out."""

    def run(
        self,
        total: int,
        judge: Judge,
        *,
        force: bool,
        progress: Progress,
        place: Place | None = None,
    ) -> tuple[list[Trial], int, bool]:
        """Run the missing trials; return all, how many were there, and whether some are missing."""
        if self.at_once == 1 and place not in (None, Place()):
            raise BaselineError("trials are shared out where some are drawn at once: at_once is 1")
        optuna = _optuna()
        if not (self.directory / SETTINGS_FILE).is_file():
            storage.claim_directory(self.directory, force=force)
        work = workplace.Work("drm tune")
        with workplace.noting(self.directory, work), _quiet(optuna), stop_on_signal() as stop:
            if (self.directory / SETTINGS_FILE).is_file() and not force:
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
            progress(self.label, found, total, note_of(trials))
            try:
                if self.at_once > 1:
                    with executor(place, cores_each=self.cores_each) as workers:
                        for trials in self._together(optuna, study, total, judge, workers):
                            progress(self.label, len(trials), total, note_of(trials))
                            if stop.is_set():
                                break
                while self.at_once == 1 and len(trials) < total and not stop.is_set():
                    self._one(optuna, study, len(trials), judge, progress)
                    trials = _trials_of(study)
                    progress(self.label, len(trials), total, note_of(trials))
            except (StoppedError, KeyboardInterrupt):
                trials = _trials_of(study)
            write_trials(self.directory / TRIALS_FILE, trials, self.space)
        return trials, found, len(trials) < total

    def _sampler(self, optuna: Any, number: int) -> Any:
        # A sampler of its own for each trial: what it draws does not depend on which process, after
        # which interruption, draws it.
        stream = np.random.SeedSequence([self.seed, number]).generate_state(1)
        return optuna.samplers.TPESampler(seed=int(stream[0]), multivariate=True)

    def _together(
        self, optuna: Any, study: Study, total: int, judge: Judge, workers: Executor
    ) -> Iterator[list[Trial]]:
        """Run the missing trials, ``at_once`` side by side; yield all after each that ends.

        Those that are drawn together know the trials of earlier groups alone, so that what is drawn
        does not depend on which of them ends first, or was there before an interruption.
        """
        states = optuna.trial.TrialState
        while len(there := _by_number(study)) < total:
            group = next(number for number in range(total) if number not in there) // self.at_once
            first = group * self.at_once
            earlier = [there[number] for number in range(first)]
            jobs = [
                (number, (number, self._drawn(optuna, earlier, number)))
                for number in range(first, min(first + self.at_once, total))
                if number not in there
            ]
            drawn = dict(jobs)
            for number, tried in workers.run(attempt, judge, jobs):
                # whole at once: a search that is killed has a trial or has it not
                study.add_trial(
                    optuna.trial.create_trial(
                        params=drawn[number][1],
                        distributions={
                            each.name: _distribution(optuna, each) for each in self.space
                        },
                        value=None if tried.verdict is None else tried.verdict.value,
                        state=states.PRUNED if tried.verdict is None else states.COMPLETE,
                        user_attrs={
                            "number": number,
                            "seconds": tried.seconds,
                            **(
                                {"reason": tried.reason}
                                if tried.verdict is None
                                else {"cost": dict(tried.verdict.cost)}
                            ),
                        },
                    )
                )
                yield _trials_of(study)

    def _drawn(self, optuna: Any, earlier: Sequence[FrozenTrial], number: int) -> dict[str, Any]:
        """Return the parameters of a trial that knows those of earlier groups."""
        study = optuna.create_study(direction="minimize", sampler=self._sampler(optuna, number))
        study.add_trials(earlier)
        if number == 0 and self.start:
            study.enqueue_trial(dict(self.start))
        trial = study.ask({each.name: _distribution(optuna, each) for each in self.space})
        return dict(trial.params)

    def _one(
        self, optuna: Any, study: Study, number: int, judge: Judge, progress: Progress
    ) -> None:
        study.sampler = self._sampler(optuna, number)
        if number == 0 and self.start:
            study.enqueue_trial(dict(self.start), skip_if_exists=False)
        trial = study.ask({each.name: _distribution(optuna, each) for each in self.space})
        began = time.monotonic()
        state = optuna.trial.TrialState

        def tell(done: int, steps: int) -> None:
            progress("training", done, steps, "steps")

        try:
            verdict = judge(number, trial.params, tell)
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
        for folder in self.directory.glob("trial_[0-9][0-9][0-9]"):
            shutil.rmtree(folder)
        # the settings last: a directory that has them is a search's, whatever else is gone
        for name in (JOURNAL_FILE, TRIALS_FILE, GAINS_FILE, BEST_FILE, SETTINGS_FILE):
            (self.directory / name).unlink(missing_ok=True)


@dataclass(frozen=True, kw_only=True)
class Tried:
    """What came of a trial: a verdict, or the reason why there is none; seconds of wall time."""

    verdict: Verdict | None
    reason: str
    seconds: float


def attempt(judge: Judge, job: tuple[int, Mapping[str, Any]], tell: Tell) -> Tried:
    """Run a trial of those that are shared out."""
    began = time.monotonic()
    verdict, reason = None, ""
    try:
        verdict = judge(*job, tell)
    except UnfitError as error:
        reason = str(error)
    return Tried(verdict=verdict, reason=reason, seconds=time.monotonic() - began)


def _optuna() -> Any:
    with needing("tuning", "tune"):
        import optuna
    return optuna


@contextlib.contextmanager
def _quiet(optuna: Any) -> Iterator[None]:
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)


def _open_study(optuna: Any, path: Path) -> Study:
    # This process holds the directory: whoever made these locks was killed while it had them, and
    # Optuna would wait 30 s in silence before it took them.
    for left in path.parent.glob(f"{path.name}.lock*"):
        left.unlink(missing_ok=True)
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
    found = [
        _trial_of(int(trial.user_attrs.get("number", number)), trial)
        for number, trial in enumerate(counted)
    ]
    return sorted(found, key=lambda trial: trial.number)


def _by_number(study: Study) -> dict[int, FrozenTrial]:
    """Return the trials of a search that runs some at once, by their numbers."""
    return {
        int(trial.user_attrs["number"]): trial
        for trial in study.get_trials(deepcopy=False)
        if "number" in trial.user_attrs
    }


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


def origin(command: str, seed: int, space: Sequence[Dimension]) -> dict[str, Any]:
    """Return how the search was made, where and with what."""
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
        "provenance": provenance.provenance(),
    }  # fmt: skip
