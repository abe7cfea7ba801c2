"""Where the tip of the rigid arm is, and how the arm has to stand for it to be there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env._config import Arm, Scenario
from drm_env.configuration import to_data
from drm_env.errors import ConfigError, InfeasibleError

__all__ = ["ArmPosition", "Workspace", "inverse_kinematics", "tip_position", "workspace"]


class ArmPosition(NamedTuple):
    """How the arm stands.

    Attributes
    ----------
    angle
        from the x axis to the arm, -pi to pi, rad.
    extension
        length of link 2 outside link 1, m.
    """

    angle: float
    extension: float


class Workspace(NamedTuple):
    """The ring that the tip, the end of link 2, can reach.

    Attributes
    ----------
    hole
        inner radius, m: link 1 and the shortest extension, at which link 2 reaches back to the
        shoulder. Where link 2 is no longer than link 1 it is the length of link 1, and the edge
        itself is not part of the ring.
    edge
        outer radius, m: both links.
    """

    hole: float
    edge: float


def lengths(arm: Arm | Mapping[str, Any] | None) -> tuple[float, float]:
    """Lengths of both links, m.

    Raises
    ------
    ConfigError
        an arm without them.
    """
    usual = to_data(Scenario().arm)
    given = to_data({} if arm is None else arm)
    found = []
    for name in ("link1", "link2"):
        link = given.get(name, usual[name])
        length = link.get("length") if isinstance(link, Mapping) else None
        if isinstance(length, bool) or not isinstance(length, (int, float)) or not length > 0.0:
            raise ConfigError(f"arm.{name}.length must be a positive number, got {length!r}")
        found.append(float(length))
    return found[0], found[1]


def workspace(arm: Arm | Mapping[str, Any] | None = None) -> Workspace:
    """The ring that the tip can reach.

    Parameters
    ----------
    arm
        ``link1`` and ``link2`` as in a scenario; by default the thesis' arm.

    Raises
    ------
    ConfigError
        an arm without lengths.

    Examples
    --------
    >>> import drm_env
    >>> drm_env.workspace()
    Workspace(hole=8.0, edge=15.0)
    """
    link1, link2 = lengths(arm)
    return Workspace(link1 + max(link2 - link1, 0.0), link1 + link2)


def tip_position(
    angle: ArrayLike, extension: ArrayLike, arm: Arm | Mapping[str, Any] | None = None
) -> NDArray[np.float64]:
    """(x, y) of the tip of the rigid arm, m, of the arguments' shape with 2 at its end.

    Parameters
    ----------
    angle
        from the x axis to the arm, rad.
    extension
        length of link 2 outside link 1, m.
    arm
        ``link1`` and ``link2`` as in a scenario; by default the thesis' arm.

    Examples
    --------
    >>> import drm_env
    >>> drm_env.tip_position(0.0, 8.0)
    array([15.,  0.])
    """
    reach = lengths(arm)[0] + np.asarray(extension, dtype=np.float64)
    turn = np.asarray(angle, dtype=np.float64)
    return np.stack(np.broadcast_arrays(reach * np.cos(turn), reach * np.sin(turn)), axis=-1)


def inverse_kinematics(
    x: float, y: float, arm: Arm | Mapping[str, Any] | None = None, *, name: str = "point"
) -> ArmPosition:
    """How the arm has to stand for its tip to be at (x, y).

    Parameters
    ----------
    x, y
        of the tip, from the shoulder, m.
    arm
        ``link1`` and ``link2`` as in a scenario; by default the thesis' arm.
    name
        what the point is called in errors.

    Raises
    ------
    ConfigError
        coordinates that are not finite.
    InfeasibleError
        a point in the hole of the workspace or beyond its outer edge, with the distance that is
        missing.

    Examples
    --------
    >>> import drm_env
    >>> drm_env.inverse_kinematics(0.0, 12.0)
    ArmPosition(angle=1.5707963267948966, extension=5.0)
    """
    for axis, value in (("x", x), ("y", y)):
        if not math.isfinite(value):
            raise ConfigError(f"{name}: {axis} must be finite, got {value!r}")
    link1 = lengths(arm)[0]
    ring = workspace(arm)
    distance = math.hypot(x, y)
    # rounding of the distance must not take the edges away
    slack = 4.0 * np.spacing(ring.edge)
    if distance > ring.edge + slack:
        raise InfeasibleError(
            f"{name} ({x:g}, {y:g}) is {distance:.4g} m from the shoulder, "
            f"{distance - ring.edge:.4g} m beyond the outer edge of the workspace "
            f"({ring.edge:g} m)",
            limit="workspace edge", needed=distance, allowed=ring.edge,
        )  # fmt: skip
    low = ring.hole - slack
    if distance < low or distance - link1 <= 0.0:
        raise InfeasibleError(
            f"{name} ({x:g}, {y:g}) is {distance:.4g} m from the shoulder, "
            f"{ring.hole - distance:.4g} m inside the hole of the workspace ({ring.hole:g} m)",
            limit="workspace hole", needed=distance, allowed=ring.hole,
        )  # fmt: skip
    reach = min(max(distance, ring.hole), ring.edge)
    return ArmPosition(math.atan2(y, x), reach - link1)
