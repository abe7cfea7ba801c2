"""The ``"human"`` render mode: frames shown in real time, in a window or in the terminal.

The picture itself is drawn by the engine on the CPU, without a display.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Viewer"]

FRAMES_PER_SECOND = 25
"""Frames for each second of simulated time."""

Frame = Callable[[], NDArray[np.uint8]]
"""Draws the present state, (height, width, 3)."""
Letters = Callable[[], str]
"""The present state as text."""


class Viewer:
    """Shows an environment in a pygame window if pygame is installed, else in the terminal."""

    def __init__(self) -> None:
        """Opens nothing yet; the first frame does."""
        self._window: Any = None
        self._pygame: Any = None
        self._simulated = 0.0
        self._next_frame = 0.0
        try:
            import pygame  # type: ignore[import-not-found,unused-ignore]
        except ImportError:
            return
        self._pygame = pygame

    def start(self, frame: Frame, letters: Letters) -> None:
        """Shows the beginning of an episode."""
        self._simulated = 0.0
        self.show(frame, letters)

    def advance(self, frame: Frame, letters: Letters, period: float) -> None:
        """Takes note of ``period`` seconds simulated and shows a frame when one is due."""
        self._simulated += period
        if self._simulated + 1e-9 < 1.0 / FRAMES_PER_SECOND:
            return
        self._simulated = 0.0
        time.sleep(max(0.0, self._next_frame - time.monotonic()))
        self.show(frame, letters)

    def show(self, frame: Frame, letters: Letters) -> None:
        """Shows the present state at once."""
        self._next_frame = time.monotonic() + 1.0 / FRAMES_PER_SECOND
        if self._pygame is None:
            # Home and clear, so that successive pictures replace one another.
            sys.stdout.write("\x1b[H\x1b[2J" + letters() + "\n")
            sys.stdout.flush()
            return
        pygame = self._pygame
        picture = frame()
        height, width, _ = picture.shape
        if self._window is None:
            pygame.display.init()
            self._window = pygame.display.set_mode((width, height))
            pygame.display.set_caption("Deployable robotic manipulator")
        self._window.blit(pygame.surfarray.make_surface(picture.swapaxes(0, 1)), (0, 0))
        pygame.event.pump()
        pygame.display.flip()

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            self._pygame.display.quit()
            self._window = None
