"""Results of searches that come with the package."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from drm_baselines.errors import BaselineError
from drm_baselines.support import storage

if TYPE_CHECKING:
    pass
from drm_baselines.policies.gains import FORMAT
from drm_baselines.tuning.learners import LEARNER_SUFFIXES, LearningRequest
from drm_baselines.tuning.trials import Outcome

JUDGED = ("ppo", "sac")
"""Algorithms whose policies the benchmark flies."""


def package(outcome: Outcome) -> Path:
    """Copy the result of a finished search into the package; return the file.

    Gains go to ``gains``; settings of learning become those of the benchmark's learner, or, of an
    algorithm that has none there, the packaged ones of ``drm train``, with the record of the search
    beside them (``<name>.search.json``).

    Raises
    ------
    BaselineError
        The search was interrupted.
    """
    content = dict(outcome.content)
    if outcome.interrupted:
        raise BaselineError("the search was interrupted; only a finished one is packaged")
    name = content["name"]
    if content.get("format") == FORMAT:
        return storage.write_json(_package() / "gains" / f"{name}.json", content, overwrite=True)
    text = content.pop("settings file")
    file = learner_file(name)
    storage.write_json(file.with_suffix(".search.json"), content, overwrite=True)
    return storage.write_text(file, text, overwrite=True)


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
    """Return the file of a learner of the benchmark, which :func:`package` writes.

    An algorithm that the benchmark trains nobody with has its packaged settings alone, the same
    ones for every environment.
    """
    algorithm = name.removesuffix("_direct")
    if not name.startswith(JUDGED):
        return _package() / "rl" / "hyperparameters" / f"{algorithm}.toml"
    return _package() / "benchmark" / "learners" / f"{name}.toml"


def _package() -> Path:
    return Path(str(resources.files("drm_baselines")))
