"""The discrete linear model of a whole manoeuvre, for control design and optimisation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drm_env import _engine
from drm_env._manoeuvres import engine_scenario
from drm_env.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drm_env._config import Scenario
    from drm_env.resolved import ResolvedConfig

__all__ = ["Transitions", "transitions"]


class Transitions(NamedTuple):
    """x(k+1) = A x(k) + B u(k) + c, with the error of the tip at every sample in between.

    x is the deviation from the undeflected arm at the reference: the coordinates (slew angle, then
    the elastic ones), then their rates. u are the torques of root and tip wheel in N m, held from
    one instant to the next and not limited. The matrices are measured on the equations that are
    flown; wheels and sensors are ideal. What they leave out: terms of third order in the size of
    the manoeuvre, and on the consistent plant the memory of the implicit integrator. With N
    intervals of h samples and n entries of x:

    Attributes
    ----------
    start
        x at t = 0, shape (n,).
    transition, input, offset
        A, B and c, shapes (N, n, n), (N, n, 2) and (N, n).
    error_state, error_input, error_offset
        the tip's error r e + y (m) at the samples after each instant is C x + D u + d: shapes
        (N, h, n), (N, h, 2) and (N, h).
    """

    start: NDArray[np.float64]
    transition: NDArray[np.float64]
    input: NDArray[np.float64]
    offset: NDArray[np.float64]
    error_state: NDArray[np.float64]
    error_input: NDArray[np.float64]
    error_offset: NDArray[np.float64]


def transitions(
    scenario: Scenario | ResolvedConfig | Mapping[str, Any] | None = None, *, hold: int = 10
) -> Transitions:
    """Linearises a manoeuvre about its reference, from one instant to the next.

    Parameters
    ----------
    scenario
        as for `simulate`; lag, dead time and momentum limit of its wheels and errors of its sensors
        are left out.
    hold
        samples between two instants: 10 are 20 ms by default.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value, a hold that does not divide the samples.
    SimulationError
        an arm that leaves what the equations describe within ``hold`` samples; see `simulate`.

    Examples
    --------
    >>> import drm_env
    >>> linear = drm_env.transitions({"horizon": 20.0}, hold=10)
    >>> linear.transition.shape, linear.input.shape  # 1000 intervals of 20 ms, both wheels
    ((1000, 6, 6), (1000, 6, 2))
    """
    if isinstance(hold, bool) or not isinstance(hold, int) or hold < 1:
        raise ConfigError(f"hold must be a positive integer, got {hold!r}")
    size, count, arrays = _engine.transitions(engine_scenario(scenario), hold)
    shapes = (
        (size,), (count, size, size), (count, size, 2), (count, size),
        (count, hold, size), (count, hold, 2), (count, hold),
    )  # fmt: skip
    return Transitions(*(a.reshape(shape) for a, shape in zip(arrays, shapes, strict=True)))
