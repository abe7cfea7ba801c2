"""Packages that import what they export when it is first used."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def exports(package: str, homes: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package that exports names of its modules.

    Importing such a package costs nothing, which keeps ``drm --help`` fast.

    Parameters
    ----------
    package
        Full name of the package.
    homes
        Names to export by the module that defines them, as ``importlib.import_module`` takes it.
    """
    home_of = {name: home for home, names in homes.items() for name in names}

    def getattribute(name: str) -> Any:
        home = home_of.get(name)
        if home is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(home, package), name)
        vars(importlib.import_module(package))[name] = value
        return value

    return getattribute
