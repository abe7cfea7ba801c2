"""Addresses that modules had before they got rooms of their own.

Programs may import them, and checkpoints of Stable-Baselines3, which are pickles, name classes by
them. They work until the next minor version, with a warning that names the new place. A module
that is imported by an old name is made here, and looks its names up in the modules that have them.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from types import ModuleType
from typing import Any

MOVED: dict[str, tuple[str, ...]] = {
    "asymmetric": ("rl.asymmetric",),
    "benchmark.bound": ("optimal_control.lower_bound",),
    "benchmark.feedback": ("optimal_control.tvlqr",),
    "benchmark.field": ("benchmark.competitors", "policies.pilots"),
    "benchmark.observer": ("optimal_control.kalman_filter",),
    "benchmark.programme": ("optimal_control.quadratic_program",),
    "benchmark.receding": ("optimal_control.mpc",),
    "benchmark.regulator": ("optimal_control.scheduled_lqr",),
    "benchmark.results": ("benchmark.records",),
    "benchmark.run": ("benchmark.runner", "benchmark.report.documents"),
    "benchmark.suites": ("suites",),
    "benchmark.tuning": (
        "tuning.laws", "tuning.learners", "tuning.packaging", "tuning.search", "tuning.space",
        "tuning.trials", "policies.gains", "rl.hyperparameters.toml",
    ),
    "comparison": ("evaluation.comparison", "evaluation.contestants"),
    "compatibility": ("policies.compatibility",),
    "export": ("rl.export",),
    "figures": ("support.figures",),
    "hyperparameters": ("rl.hyperparameters",),
    "imitation.flights": ("imitation.teacher_rollout",),
    "imitation.refining": ("imitation.analytic_gradient",),
    "imitation.sensing": ("imitation.observation_jacobian",),
    "imitation.sensitivity": ("imitation.plant_jacobian",),
    "metrics": ("evaluation.metrics",),
    "network": ("policies.perceptron", "policies.policy_file"),
    "plots": ("evaluation.plots",),
    "policy_names": ("policies.names", "support.palette"),
    "records": ("evaluation.records",),
    "runs": ("rl.run_record",),
    "staggering": ("rl.staggered_resets",),
    "statistics": ("evaluation.statistics",),
    "storage": ("support.storage", "support.provenance"),
    "tables": ("evaluation.tables",),
    "training": ("rl.training", "rl.request", "rl.run"),
}  # fmt: skip
"""Old address and the modules that have its names now, both without the package."""

_PACKAGE = __name__.rpartition(".")[0]


class _Forwarding(Loader):
    """Makes a module that has the names of others."""

    def __init__(self, homes: Sequence[str]) -> None:
        self._homes = [f"{_PACKAGE}.{home}" for home in homes]

    def exec_module(self, module: ModuleType) -> None:
        """Warn, and let the module look its names up elsewhere."""
        name, homes = module.__name__, self._homes
        warnings.warn(f"{name} is now {' and '.join(homes)}", DeprecationWarning, stacklevel=2)

        def getattribute(attribute: str) -> Any:
            if not attribute.startswith("__"):
                for home in homes:
                    found = importlib.import_module(home)
                    if hasattr(found, attribute):
                        return getattr(found, attribute)
            raise AttributeError(f"module {name!r} has no attribute {attribute!r}")

        vars(module).update(__doc__=f"Now {', '.join(homes)}.", __getattr__=getattribute)


class _Finder(MetaPathFinder):
    """Finds the old addresses; asked first: empty folders of old would pass for packages."""

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,  # noqa: ARG002
        target: ModuleType | None = None,  # noqa: ARG002
    ) -> ModuleSpec | None:
        """Return how a module of an old address is made; none for every other name."""
        package, _, name = fullname.partition(".")
        if package != _PACKAGE or name not in MOVED:
            return None
        return spec_from_loader(fullname, _Forwarding(MOVED[name]))


def install() -> None:
    """Make the old addresses importable; once a process."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
