"""One episode of each sub-environment of a batch, whoever acts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env


def first_episodes(
    env: Any,
    observations: NDArray[np.float32],
    act: Callable[[Any, Any, NDArray[np.bool_]], tuple[Any, Any]],
) -> dict[str, NDArray[np.float64]]:
    """Fly each sub-environment to its end; return metrics by name, each of shape (n,).

    Parameters
    ----------
    env
        A vector environment that has been reset and resets sub-environments by itself.
    observations
        What the reset returned.
    act
        Called with observations, the state that it returned before (none at first) and where an
        episode begins, shape (n,); returns actions and the next state.
    """
    count = len(observations)
    starts = np.ones(count, dtype=np.bool_)
    finished = np.zeros(count, dtype=np.bool_)
    metrics: dict[str, NDArray[np.float64]] = {}
    state: Any = None
    while not finished.all():
        actions, state = act(observations, state, starts)
        observations, _, terminated, truncated, info = env.step(actions)
        starts = terminated | truncated
        # Sub-environments that ended early are reset and fly on; only their first episode
        # counts, or short episodes would weigh more.
        ended = starts & ~finished
        if ended.any():
            for name, values in drm_env.info_metrics(info).items():
                column = metrics.setdefault(name, np.full(count, np.nan))
                column[ended] = values[ended]
            finished |= ended
    return metrics
