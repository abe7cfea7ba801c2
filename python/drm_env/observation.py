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

    Examples
    --------
    >>> import drm_env
    >>> layout = drm_env.observation_layout("slew", preview_times=[0.5])
    >>> layout[0].name, layout[0].unit, layout[0].scale
    ('slew_error', 'rad', 0.1)
    >>> [entry.name for entry in layout[-2:]]
    ['reference_accel+0.5s', 'extension+0.5s']
    """
    return resolve_options(task, config, options).observation_layout
