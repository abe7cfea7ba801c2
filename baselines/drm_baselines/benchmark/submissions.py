"""Strangers' policies: who may be submitted, how it is loaded, and what is written down of it.

    NAME=DIR               an exported policy (safetensors and JSON): numbers, nothing is executed
    NAME=module:attribute  an object with ``predict``, or a function that makes one: your own code

A directory is read as everywhere (:mod:`drm_baselines.policies.policy_file`): what is damaged, too
large, a link or more than numbers is refused. A module is imported, which runs it: it is for code
that you would run yourself.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import drm_env
from drm_baselines.benchmark.competitors import Competitor
from drm_baselines.benchmark.records import SUBMITTED
from drm_baselines.errors import BaselineError, PolicyError
from drm_baselines.evaluation.environments import known_ids, task_of
from drm_baselines.evaluation.predictors import PredictorPilot, pilot_of
from drm_baselines.policies.names import is_name
from drm_baselines.policies.pilots import Pilot
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.support.reading import shown

_NAME = re.compile(r"[a-z0-9][a-z0-9_.]{0,39}")
_REFERENCE = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")


@dataclass(frozen=True, kw_only=True)
class Submitted(Competitor):
    """A stranger's policy as a row of the benchmark."""

    def __post_init__(self) -> None:
        """Take the name as the title.

        Raises
        ------
        PolicyError
            Nobody flies.
        """
        if self.pilot is None:
            raise PolicyError(f"nobody flies under the name {self.policy!r}")
        object.__setattr__(self, "title", self.title or self.policy)

    @property
    def kind(self) -> str:
        """:data:`drm_baselines.benchmark.records.SUBMITTED`."""
        return SUBMITTED

    @property
    def knows(self) -> str:
        """What the observations of its task show: the payload as it is reported."""
        return "reported"


def submitted(texts: Sequence[str]) -> list[Submitted]:
    """Load what ``--submit`` names; nothing has been flown.

    Parameters
    ----------
    texts
        ``NAME=DIR``, ``NAME=module:attribute``, or either without a name: then it is the last part
        of the directory's path, or the attribute.

    Raises
    ------
    BaselineError
        A name that cannot be one or is taken, twice the same, or a policy that is refused; the
        message says which.
    """
    found: dict[str, Submitted] = {}
    for text in texts:
        name, place = _parts(text)
        if name in found:
            raise BaselineError(f"--submit {shown(text)}: two policies are called {name!r}")
        found[name] = Submitted(policy=name, pilot=_pilot(name, place))
    return list(found.values())


def _parts(text: str) -> tuple[str, str]:
    """Name and place of a submission.

    Raises
    ------
    BaselineError
        No place, or a name that is none or that the package has.
    """
    given, equals, place = text.partition("=")
    if not equals:
        given, place = "", text
    if not place:
        raise BaselineError(
            f"--submit {shown(text)}: expected NAME=DIRECTORY or NAME=module:attribute"
        )
    if not equals:
        last = place.rpartition(":")[2] if _is_reference(place) else Path(place).resolve().name
        last = last.rpartition(".")[2] if _is_reference(place) else last
        given = last.lower().replace("-", "_")
    if not _NAME.fullmatch(given):
        raise BaselineError(
            f"--submit {shown(text)}: a name has up to 40 of a-z, 0-9, '_' and '.', "
            f"got {shown(given)}"
        )
    if is_name(given):
        raise BaselineError(
            f"--submit {shown(text)}: {given!r} is a policy of the package; give another name, "
            f"such as my_{given}={place}"
        )
    return given, place


def _is_reference(place: str) -> bool:
    return _REFERENCE.fullmatch(place) is not None and not Path(place).exists()


def _pilot(name: str, place: str) -> Pilot:
    if _is_reference(place):
        return _of_module(name, place)
    policy = load_policy(Path(place))
    policy.check_task(drm_env.resolve(config=policy.config).config)
    return pilot_of(name, policy)


def _of_module(name: str, reference: str) -> PredictorPilot:
    """Import a module and take the policy out of it.

    Raises
    ------
    PolicyError
        It cannot be imported, has no such attribute, or what it has is no policy.
    drm_env.ConfigError
        Its ``config`` is impossible.
    """
    module_name, _, path = reference.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)  # as python -m does
    try:
        module = importlib.import_module(module_name)
        made: Any = module
        for part in path.split("."):
            made = getattr(made, part)
        if not hasattr(made, "predict") or inspect.isclass(made):
            made = made()
    except Exception as error:  # whatever a stranger's code may raise
        raise PolicyError(f"{reference} cannot be used: {type(error).__name__}: {error}") from error
    if not callable(getattr(made, "predict", None)):
        raise PolicyError(
            f"{reference} is {shown(type(made).__name__)} without predict(observation, state, "
            "episode_start, deterministic)"
        )
    env_id = getattr(made, "env_id", "drm_env/Slew-v0")
    if env_id not in known_ids():
        raise PolicyError(
            f"{reference}: env_id must be one of {', '.join(known_ids())}, got {shown(env_id)}"
        )
    config = drm_env.resolve(task_of(env_id), config=getattr(made, "config", None))
    source = getattr(module, "__file__", None)
    return PredictorPilot(
        name,
        made,
        config.to_dict(),
        {
            "source": reference,
            "env_id": env_id,
            "task": config.to_dict()["task"],
            "source_sha256": None
            if source is None
            else hashlib.sha256(Path(source).read_bytes()).hexdigest(),
        },
    )
