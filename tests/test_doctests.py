"""Examples in docstrings say what happens; the most used names have one."""

from __future__ import annotations

import doctest
import importlib
import inspect
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import pytest

import drm_baselines
import drm_env

FACES = (
    "drm_env", "drm_env.sb3", "drm_baselines", "drm_baselines.policies",
    "drm_baselines.evaluation", "drm_baselines.evaluation.statistics", "drm_baselines.suites",
)  # fmt: skip

SHOWN = {
    *(f"drm_env.{name}" for name in (
        "Choices", "ControlLaw", "DrmEnv", "DrmVectorEnv", "LogUniform", "Model", "Network",
        "Normal", "Uniform", "default_config", "episode_metrics", "info_metrics",
        "observation_layout", "option_names", "rollout", "sample_scenarios", "simulate",
        "transitions",
    )),
    "drm_env.sb3.make_sb3_vec",
    "drm_baselines.load_policy", "drm_baselines.LawPolicy",
    "drm_baselines.evaluation.environment_config", "drm_baselines.evaluation.fly_law",
    "drm_baselines.evaluation.fly_policy", "drm_baselines.suites.load",
}  # fmt: skip
"""Names that must have an example."""


def public(module: ModuleType) -> Iterator[str]:
    for name in getattr(module, "__all__", vars(module)):
        if not name.startswith("_"):
            yield name


def examples() -> dict[str, tuple[Any, doctest.DocTest]]:
    """Every docstring of a public name that holds examples, by the address users know it by."""
    finder, parser = doctest.DocTestFinder(recurse=True), doctest.DocTestParser()
    found: dict[str, tuple[Any, doctest.DocTest]] = {}
    seen: set[int] = set()
    for face in FACES:
        module = importlib.import_module(face)
        text = parser.get_doctest(module.__doc__ or "", {}, face, face, 0)
        if text.examples:
            found[face] = (module, text)
        for name in public(module):
            value = inspect.unwrap(getattr(module, name))
            own = (inspect.getmodule(value) or module).__name__
            if not (inspect.isclass(value) or inspect.isfunction(value)) or id(value) in seen:
                continue
            if not own.startswith(("drm_env", "drm_baselines")):
                continue
            seen.add(id(value))
            for test in finder.find(value, f"{face}.{name}", module=False, globs={}):
                if test.examples:
                    found[test.name] = (value, test)
    return found


EXAMPLES = examples()


def test_the_most_used_names_have_an_example() -> None:
    assert set(EXAMPLES) >= SHOWN
    assert {"drm_env", "drm_baselines"} <= set(EXAMPLES)
    assert drm_env.__all__ and drm_baselines.__all__


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_says_what_happens(name: str) -> None:
    said: list[str] = []
    runner = doctest.DocTestRunner(verbose=False)
    runner.run(EXAMPLES[name][1], out=said.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(said)
