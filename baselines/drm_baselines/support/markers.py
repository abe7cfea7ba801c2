"""Places in Markdown files that a command writes, from one comment to another."""

from __future__ import annotations

from drm_baselines.errors import BaselineError


def marked_range(text: str, begin: str, end: str, *, where: str) -> tuple[int, int] | None:
    """Return where a place begins and ends, its markers included, ``None`` if it has no markers.

    Parameters
    ----------
    text
        What the file holds.
    begin, end
        The markers.
    where
        What is at fault if the markers are, for the message.

    Raises
    ------
    BaselineError
        A marker without its partner, twice, or in the wrong order.
    """
    counts = text.count(begin), text.count(end)
    if counts == (0, 0):
        return None
    start, stop = text.find(begin), text.find(end)
    if counts != (1, 1) or stop < start:
        raise BaselineError(
            f"{where}: expected {begin!r} and then {end!r} once each, found {counts[0]} and "
            f"{counts[1]}" + (" in the wrong order" if counts == (1, 1) else "")
        )
    return start, stop + len(end)
