"""Distributions that a parameter of a scenario can be drawn from at the start of each episode.

Anything that is randomizable takes a number (or a name), which fixes it, or one of these. A tuple
``(low, high)`` is short for `Uniform`, a list for `Choices`.

Each carries the read-only field ``distribution``, so that it survives `dataclasses.asdict` (which
is what Gymnasium makes of it in the JSON of an environment's specification).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drm_env.errors import ConfigError

__all__ = ["Choices", "Distribution", "LogUniform", "Normal", "Uniform"]


@dataclass(frozen=True)
class Uniform:
    """Uniform between ``low`` and ``high``, in the unit of the parameter.

    Examples
    --------
    >>> import drm_env
    >>> env = drm_env.DrmEnv(payload_mass=drm_env.Uniform(50.0, 500.0))  # or (50.0, 500.0)
    """

    low: float
    high: float
    distribution: str = field(default="uniform", init=False, repr=False)


@dataclass(frozen=True)
class LogUniform:
    """Uniform in the logarithm between ``low`` and ``high``, both positive.

    Examples
    --------
    >>> import drm_env
    >>> env = drm_env.DrmEnv(payload_mass=drm_env.LogUniform(10.0, 1000.0))
    """

    low: float
    high: float
    distribution: str = field(default="log_uniform", init=False, repr=False)


@dataclass(frozen=True)
class Normal:
    """Normal with ``mean`` and ``std``, redrawn while outside ``low`` and ``high``, if given.

    Examples
    --------
    >>> import drm_env
    >>> env = drm_env.DrmEnv(mass_error=drm_env.Normal(0.0, 0.05, low=-0.15, high=0.15))
    """

    mean: float
    std: float
    low: float | None = None
    high: float | None = None
    distribution: str = field(default="normal", init=False, repr=False)


@dataclass(frozen=True)
class Choices:
    """One of ``values`` (numbers, or names where the parameter is a name), all equally likely.

    Examples
    --------
    >>> import drm_env
    >>> env = drm_env.DrmEnv(slew_profile=drm_env.Choices(("min_time", "min_energy")))
    """

    values: tuple[Any, ...]
    distribution: str = field(default="choices", init=False, repr=False)

    def __post_init__(self) -> None:
        """Stores the values as a tuple, so that the object cannot change."""
        object.__setattr__(self, "values", tuple(self.values))


Distribution = Uniform | LogUniform | Normal | Choices
"""Any of the distributions."""

_FIELDS = {
    "uniform": ("low", "high"),
    "log_uniform": ("low", "high"),
    "normal": ("mean", "std", "low", "high"),
    "choices": ("values",),
}


def distribution_to_data(fields: Mapping[str, Any], path: str) -> dict[str, Any]:
    """The form that configuration files use, from the fields of one of the classes above.

    Parameters
    ----------
    fields
        the dataclass as a mapping, ``distribution`` included.
    path
        name of the option, for the error.

    Raises
    ------
    ConfigError
        unknown kind, or fields that do not belong to it.
    """
    kind = fields["distribution"]
    names = _FIELDS.get(kind)
    if names is None:
        raise ConfigError(f"{path}: distribution must be one of {sorted(_FIELDS)}, got {kind!r}")
    given = {name: value for name, value in fields.items() if name != "distribution"}
    unknown = sorted(set(given) - set(names))
    if unknown:
        raise ConfigError(f"{path}: a {kind} distribution has no field {unknown[0]!r}")
    if kind == "normal":
        return {"normal": {name: value for name, value in given.items() if value is not None}}
    missing = [name for name in names if name not in given]
    if missing:
        raise ConfigError(f"{path}: a {kind} distribution needs {missing[0]!r}")
    if kind == "choices":
        return {"choices": list(given["values"])}
    return {kind: [given["low"], given["high"]]}
