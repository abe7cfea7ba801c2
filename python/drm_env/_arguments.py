"""Arguments of environments and batches, checked before anything changes."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_env._infos import Mask
from drm_env.configuration import (
    flat_options,
    is_sequence,
    known_options,
    randomizable,
)
from drm_env.errors import ActionError, ActionTypeError, ConfigError

_FLOAT32 = np.dtype(np.float32)


def convert_action(action: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """An action as a contiguous float32 array within [-1, 1].

    Raises
    ------
    ActionTypeError
        not made of real numbers.
    ActionError
        wrong shape, NaN or infinite.
    """
    try:
        array = np.asarray(action)
    except (TypeError, ValueError) as error:
        raise ActionTypeError(f"action must be an array of numbers: {error}") from None
    if array.dtype.kind not in "fiu":
        raise ActionTypeError(
            f"action must be an array of real numbers, got dtype {array.dtype} ({action!r})"
        )
    if array.shape != shape:
        raise ActionError(f"action must have shape {shape}, got {array.shape}")
    if array.dtype != _FLOAT32:
        finite = np.isfinite(array)
        if not finite.all():
            index = np.unravel_index(int(np.argmin(finite)), shape)
            place = ", ".join(str(int(i)) for i in index)
            raise ActionError(f"action[{place}] must be finite, got {array[index]}")
        # Clipped before the conversion, in which a large double would become infinite.
        array = np.clip(array, -1.0, 1.0).astype(np.float32)
    return np.ascontiguousarray(array)


def refuse_option(name: str) -> None:
    """Refuses to set an attribute that has the name of an option: it would change nothing.

    Raises
    ------
    ConfigError
        an option's name.
    """
    if name not in known_options():
        return
    way = (
        f"use set_context({name}=...)"
        if name in randomizable()
        else f"make a new environment with {name}=..."
    )
    raise ConfigError(f"{name} is an option, not an attribute that can be set; {way}")


class OptionsAreNoAttributes:
    """Refuses attributes with the names of options, which would be kept and change nothing."""

    def __setattr__(self, name: str, value: Any) -> None:
        """Sets an attribute.

        Raises
        ------
        ConfigError
            an option's name.
        """
        refuse_option(name)
        super().__setattr__(name, value)


def count(name: str, value: Any) -> int:
    """A positive integer argument.

    Raises
    ------
    ConfigError
        anything else.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = 0
    if number < 1 or isinstance(value, bool):
        raise ConfigError(f"{name} must be a positive integer, got {value!r}")
    return number


def reset_mask(mask: Any, num_envs: int) -> Mask:
    """A copy of a checked ``reset_mask``.

    Raises
    ------
    TypeError, ValueError
        As Gymnasium's own vector environments.
    """
    if not isinstance(mask, np.ndarray):
        raise TypeError(f"options['reset_mask'] must be a numpy array, got {type(mask)}")
    if mask.shape != (num_envs,):
        raise ValueError(f"options['reset_mask'] must have shape ({num_envs},), got {mask.shape}")
    if mask.dtype != np.bool_:
        raise TypeError(f"options['reset_mask'] must have dtype bool, got {mask.dtype}")
    if not mask.any():
        raise ValueError("options['reset_mask'] must be true somewhere")
    return mask.copy()


def sub_env_options(
    options: Mapping[str, Any] | Sequence[Mapping[str, Any] | None] | None, num_envs: int
) -> list[str | None]:
    """JSON text of flat parameters for each sub-environment.

    ``options`` are those of all, with an array of shape (num_envs,) where each has its own value,
    or a sequence with the options (or ``None``) of each.

    Raises
    ------
    ConfigError
        An array of another shape, a sequence of another length, an unknown name or a value without
        a JSON form.
    """
    if options is None:
        return [None] * num_envs
    if not isinstance(options, Mapping):
        if not is_sequence(options):
            raise ConfigError(
                f"options must be a mapping, or a sequence of {num_envs} mappings, "
                f"got {type(options).__name__}"
            )
        if len(options) != num_envs:
            raise ConfigError(f"options must have {num_envs} entries, got {len(options)}")
        return [flat_options(item) for item in options]
    arrays = {}
    for name, value in options.items():
        if isinstance(value, np.ndarray) and value.ndim > 0:
            if value.shape != (num_envs,):
                raise ConfigError(
                    f"{name} must be one value or an array of shape ({num_envs},), "
                    f"got shape {value.shape}"
                )
            arrays[name] = value
    if not arrays:
        return [flat_options(options)] * num_envs
    return [
        flat_options({**options, **{name: array[index] for name, array in arrays.items()}})
        for index in range(num_envs)
    ]
