"""Ending a long computation at a point of its own choosing when somebody wants it to end.

Ctrl-C (SIGINT), SIGTERM and SIGHUP (the terminal is gone) mean the same: save what there is, and
end. A signal that whoever started the process has set to be ignored, as ``nohup`` does with SIGHUP,
stays ignored.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

SIGNALS: tuple[signal.Signals, ...] = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""What ends a computation."""

_Handler = Callable[[int, FrameType | None], object]


class Stopped(KeyboardInterrupt):
    """SIGTERM or SIGHUP, where Ctrl-C would be a ``KeyboardInterrupt``.

    Attributes
    ----------
    number
        The signal's number.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


@contextlib.contextmanager
def handled_by(handler: _Handler) -> Iterator[None]:
    """Have the signals that end a computation handled by a function meanwhile.

    Nothing happens in a thread other than the main one, which receives no signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = {
        number: old
        for number in SIGNALS
        if (old := signal.getsignal(number)) not in (signal.SIG_IGN, None)
    }
    try:
        for number in previous:
            signal.signal(number, handler)
        yield
    finally:
        for number, old in previous.items():
            signal.signal(number, old)


def interrupt(number: int, frame: FrameType | None = None) -> None:  # noqa: ARG001
    """Raise ``KeyboardInterrupt`` for Ctrl-C, :class:`Stopped` for the other signals."""
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise Stopped(number)


def leave(number: int, frame: FrameType | None = None) -> None:  # noqa: ARG001
    """End the process at once, with the exit code that shells give to the signal."""
    with contextlib.suppress(OSError):
        os.write(2, b"interrupted\n")
    os._exit(128 + number)


def leaving_at_once() -> contextlib.AbstractContextManager[None]:
    """Return a context in which a signal ends the process, for imports before any work.

    Extension modules that are interrupted while they load raise errors of many kinds, some of them
    at every later use.
    """
    return handled_by(leave)


_stopped_by: list[int] = []  # the signal that has stopped a computation last


def exit_code() -> int:
    """Return the exit code after a computation that a signal has stopped, as shells form it."""
    return 128 + (_stopped_by[-1] if _stopped_by else signal.SIGINT)


@contextlib.contextmanager
def stop_on_signal() -> Iterator[threading.Event]:
    """Yield an event that the first signal sets; a Ctrl-C after that interrupts at once.

    Stopping between two steps leaves networks and optimiser in a state worth saving. SIGTERM and
    SIGHUP often come more than once, which says nothing new.
    """
    stop = threading.Event()

    def request(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        if stop.is_set():
            if number == signal.SIGINT:
                raise KeyboardInterrupt
            return
        _stopped_by[:] = [number]
        stop.set()

    with handled_by(request):
        yield stop
