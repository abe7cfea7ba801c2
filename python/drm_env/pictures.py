"""How pictures look, and what is remembered for them outside the engine's state."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_env import _engine
from drm_env.errors import ConfigError

__all__ = ["Look", "Pictures"]

SMALLEST, LARGEST = 16, 4096
"""Sides of a picture, px."""

_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")


@dataclass(frozen=True)
class Look:
    """Size, magnification of deflections, title and colour of pictures, checked.

    Parameters
    ----------
    width, height
        Size in pixels, 16 to 4096: the largest picture takes less than a second.
    magnification
        Factor by which deflections are drawn larger than they are; ``None`` takes one that follows
        from the manoeuvre and stays through the episode.
    title
        What stands above.
    colour
        Colour of link 2, curves and trail, ``"#RRGGBB"``.
    prefix
        What errors put before the names of the parameters.

    Raises
    ------
    ConfigError
        An impossible value, with its name.
    """

    width: int = 800
    height: int = 450
    magnification: float | None = None
    title: str = ""
    colour: str = "#0072B2"
    prefix: str = "render_"

    def __post_init__(self) -> None:
        """Checks everything."""
        for name in ("width", "height"):
            value = getattr(self, name)
            whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
            if not whole or not SMALLEST <= value <= LARGEST:
                raise ConfigError(
                    f"{self.prefix}{name} must be an integer from {SMALLEST} to {LARGEST} (px), "
                    f"got {value!r}"
                )
        factor = self.magnification
        if factor is not None and (
            isinstance(factor, bool)
            or not isinstance(factor, (int, float, np.number))
            or not (math.isfinite(factor) and 0.0 <= factor <= 1e6)
        ):
            raise ConfigError(
                f"{self.prefix}magnification must be None or a number from 0 to 1e6, got {factor!r}"
            )
        if not isinstance(self.title, str):
            raise ConfigError(f"{self.prefix}title must be a text, got {self.title!r}")
        if not isinstance(self.colour, str) or not _COLOUR.fullmatch(self.colour):
            raise ConfigError(f'{self.prefix}colour must be "#RRGGBB", got {self.colour!r}')

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return int(self.width), int(self.height)

    @property
    def rgb(self) -> tuple[int, int, int]:
        """Red, green and blue of the colour, 0 to 255."""
        red, green, blue = bytes.fromhex(self.colour[1:])
        return red, green, blue

    def painter(self, count: int) -> _engine.Painter:
        """Who follows and draws ``count`` environments."""
        factor = None if self.magnification is None else float(self.magnification)
        return _engine.Painter(count, factor, self.title, self.rgb)


class Pictures:
    """Follows one environment, or those of a batch, and draws what has been seen of them.

    Nothing of it is part of the environment's state: steps have the same bits with and without it,
    and after a restored snapshot the curves and the trail begin at the restored time. Copies and
    pickles hold the look alone.
    """

    def __init__(self, look: Look, count: int = 1) -> None:
        """Has seen nothing yet."""
        self.look = look
        self._count = count
        self._painter = look.painter(count)

    def __reduce__(self) -> tuple[Any, ...]:
        """The look alone."""
        return type(self), (self.look, self._count)

    def follow(self, engine: _engine.Env | _engine.Batch, *, restart: bool = False) -> None:
        """Takes the present instant; ``restart`` forgets what was before."""
        if isinstance(engine, _engine.Env):
            self._painter.follow(engine, restart)
        else:
            self._painter.follow_batch(engine, restart)

    def frame(self, engine: _engine.Env | _engine.Batch, index: int = 0) -> NDArray[np.uint8]:
        """The present state of one environment, (height, width, 3)."""
        if isinstance(engine, _engine.Env):
            return self._painter.frame(engine, *self.look.size)
        return self._painter.frame_of(engine, index, *self.look.size)

    def grid(self, engine: _engine.Batch, count: int) -> NDArray[np.uint8]:
        """The present states of the first ``count`` environments, (height, width, 3)."""
        return self._painter.grid(engine, count, *self.look.size)
