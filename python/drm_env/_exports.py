"""What was flown for other packages, which are imported when asked for: pandas, SciPy."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from os import PathLike
from typing import Any


def needed(module: str, package: str, what: str) -> Any:
    """A module of an optional package.

    Raises
    ------
    ImportError
        it is not installed; the message says what it is needed for and how it is installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(f"{what} needs {package}: pip install {package}") from error


def frame(columns: Mapping[str, Any], index: str) -> Any:
    """A frame with a column for each entry; its index counts what a row is."""
    pandas = needed("pandas", "pandas", "to_frame()")
    made = pandas.DataFrame(dict(columns))
    made.index.name = index
    return made


def write_mat(path: str | PathLike[str], content: Mapping[str, Any]) -> None:
    """A MATLAB file (version 5): arrays, columns where they have one dimension, structures."""
    io = needed("scipy.io", "scipy", "to_mat()")
    io.savemat(path, dict(content), appendmat=False, long_field_names=True, oned_as="column")
