"""Packages that only extras of the distribution install, and the error that names the extra.

``drm-baselines`` itself needs what policies need to fly: ``drm_env``, Gymnasium, NumPy and
safetensors. Everything else comes with an extra. A command asks with :func:`require` before it
does anything; a module that cannot be imported without such a package imports it inside
:func:`needing`. Both raise :class:`~drm_baselines.errors.MissingPackageError`.
"""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Iterator

from drm_baselines.errors import MissingPackageError

_CLI = ("filelock", "platformdirs", "rich", "typer")
_EVALUATE = (*_CLI, "jinja2", "matplotlib", "scipy")
_PLAN = ("clarabel", "piqp", "scipy")

EXTRAS: dict[str, tuple[str, ...]] = {
    "cli": _CLI,
    "plot": ("matplotlib",),
    "evaluate": _EVALUATE,
    "plan": _PLAN,
    "render": (*_CLI, "imageio", "imageio_ffmpeg"),
    "report": (*_EVALUATE, "clarabel", "piqp", "pyarrow"),
    "learn": (
        *_EVALUATE,
        *("clarabel", "piqp", "sb3_contrib", "stable_baselines3", "tensorboard", "torch"),
    ),
    "tune": (*_EVALUATE, "clarabel", "optuna", "piqp"),
    "data": ("h5py", "minari"),
    "bench": (*_CLI, "matplotlib", "numba", "psutil"),
    "scale": (*_CLI, "ray"),
}
"""Packages of each extra as they are imported; those with fewer packages come first."""


def extra_of(module: str) -> str | None:
    """Return the smallest extra that installs the package of ``module``, if one does."""
    package = module.partition(".")[0]
    return next((extra for extra, packages in EXTRAS.items() if package in packages), None)


def is_installed(package: str) -> bool:
    """Return whether a package can be found, without importing it."""
    try:
        return importlib.util.find_spec(package) is not None
    except ImportError:
        return False


def require(purpose: str, extra: str, *packages: str) -> None:
    """Check that packages of an extra are installed, without importing them.

    Parameters
    ----------
    purpose
        What needs them, as the beginning of a sentence, such as ``"drm compare"``.
    extra
        Name of the extra that installs them.
    packages
        Names under which they are imported; all packages of the extra by default.

    Raises
    ------
    MissingPackageError
        One is not installed; the message names those that are missing and the extra.
    """
    missing = [name for name in packages or EXTRAS[extra] if not is_installed(name)]
    if missing:
        raise MissingPackageError(purpose, extra, missing)


@contextlib.contextmanager
def needing(purpose: str, extra: str | None = None) -> Iterator[None]:
    """Turn the error of an import inside the block into one that names the extra.

    Parameters
    ----------
    purpose
        What needs the import, as the beginning of a sentence.
    extra
        Name of the extra to recommend; by default the smallest that installs the package.

    Raises
    ------
    MissingPackageError
        A package of an extra is not installed or cannot be imported. Other errors pass.
    """
    try:
        yield
    except MissingPackageError:
        raise
    except ImportError as error:
        found = extra_of(error.name or "")
        if found is None:
            raise
        package = str(error.name).partition(".")[0]
        # a package that is there but cannot be loaded says why
        reason = "" if isinstance(error, ModuleNotFoundError) else str(error)
        raise MissingPackageError(purpose, extra or found, [package], reason) from error
