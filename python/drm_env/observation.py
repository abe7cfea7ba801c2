"""What the entries of an observation are, so that a law can recover SI values from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drm_env._spaces import ObservationEntry
from drm_env.configuration import ConfigLike, resolve_options

if TYPE_CHECKING:
    from typing import Unpack

    from drm_env._options import Options

__all__ = ["ObservationEntry", "observation_layout"]


def observation_layout(
    task: str = "slew", *, config: ConfigLike = None, **options: Unpack[Options]
) -> tuple[ObservationEntry, ...]:
    """The entries of the observation that an environment with these arguments returns, in order.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value.
    """
    return resolve_options(task, config, options).observation_layout
