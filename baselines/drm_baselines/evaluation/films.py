"""Films of policies side by side on the same episode, as MP4 or GIF."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.policies.names import styles
from drm_baselines.support import storage
from drm_baselines.support.extras import needing
from drm_baselines.support.palette import OKABE_ITO
from drm_env.film import frame_times

with needing("a film", "render"):
    import imageio.v2 as imageio

    # imageio cannot be installed without it
    from PIL import Image, ImageColor

ENDINGS = (".mp4", ".gif")
"""What a film's file may end in."""

GAP = 2
"""Pixels between pictures beside each other."""

GIF_COLOURS = 56
"""Colours of a GIF: anti-aliased lines in few hues need no more."""


@dataclass(frozen=True, kw_only=True)
class Cut:
    """How a film is made of flights.

    Attributes
    ----------
    fps
        Pictures for each second of the film.
    speed
        Seconds of the manoeuvre for each second of the film.
    width, height
        Size of the whole, px; MP4 needs even numbers, and gets them.
    columns
        Pictures beside each other; all by default.
    duration
        Seconds of the manoeuvre that are shown; by default all.
    """

    fps: float = 25.0
    speed: float = 1.0
    width: int = 1280
    height: int = 480
    columns: int | None = None
    duration: float | None = None


def check_ending(path: Path) -> str:
    """Return how a film's file ends, in small letters.

    Raises
    ------
    BaselineError
        Neither in ``.mp4`` nor in ``.gif``.
    """
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise BaselineError(f"a film's file must end in {' or '.join(ENDINGS)}, got {str(path)!r}")
    return ending


def side_by_side(
    scenario: Mapping[str, Any],
    flights: Mapping[str, Mapping[str, NDArray[np.float64]]],
    cut: Cut,
    *,
    colours: Sequence[str] | None = None,
    magnification: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[NDArray[np.uint8]]:
    """Yield the pictures of flights of one manoeuvre beside each other, on the same axes.

    Parameters
    ----------
    scenario
        The manoeuvre.
    flights
        Signals of its flights by label of the policy.
    cut
        How the film is made.
    colours
        One each, ``"#RRGGBB"``; by default those that the labels have in all pictures.
    magnification
        Factor of the deflections; by default one that follows from the manoeuvre.
    progress
        Called with (done, total) pictures.

    Yields
    ------
    frame
        uint8 of shape (cut.height, cut.width, 3).

    Raises
    ------
    drm_env.ConfigError
        Impossible sizes, speeds or factors.
    """
    if colours is None:
        colours = [style["color"] for style in styles(list(flights))]
    columns = min(cut.columns or len(flights), len(flights))
    rows = -(-len(flights) // columns)
    width = (cut.width - GAP * (columns - 1)) // columns
    height = (cut.height - GAP * (rows - 1)) // rows
    films = [
        drm_env.Film(
            scenario,
            flight,
            width=width,
            height=height,
            magnification=magnification,
            title=label,
            colour=colour,
        )
        for (label, flight), colour in zip(flights.items(), colours, strict=True)
    ]
    films[0].share_axes(*films[1:])
    last = max(film.duration for film in films)
    times = frame_times(cut.fps, cut.speed, last if cut.duration is None else cut.duration)
    whole = np.full((cut.height, cut.width, 3), 219, dtype=np.uint8)
    for done, time in enumerate(times, start=1):
        for index, film in enumerate(films):
            top = (index // columns) * (height + GAP)
            left = (index % columns) * (width + GAP)
            whole[top : top + height, left : left + width] = film.frame(time)
        yield whole.copy()
        if progress is not None:
            progress(done, len(times))


def write_film(
    path: Path, frames: Iterator[NDArray[np.uint8]], *, fps: float, overwrite: bool = False
) -> Path:
    """Write pictures as a film under a temporary name and rename it; return ``path``.

    Parameters
    ----------
    path
        Its ending says what it is: ``.mp4`` (H.264) or ``.gif``, which repeats for ever and holds
        its last picture for two seconds.
    frames
        uint8 of shape (height, width, 3) each.
    fps
        Pictures a second; a GIF counts in hundredths of a second.
    overwrite
        Whether an existing file is replaced.

    Raises
    ------
    BaselineError
        Another ending.
    ExistingResultError, WriteError
        See :func:`drm_baselines.support.storage.atomic_path`.
    """
    ending = check_ending(path)
    with storage.atomic_path(path, overwrite=overwrite) as temporary:
        if ending == ".mp4":
            _write_mp4(temporary, frames, fps)
        else:
            _write_gif(temporary, frames, fps)
    return path


def _write_mp4(path: Path, frames: Iterator[NDArray[np.uint8]], fps: float) -> None:
    """H.264 in the colour format that every player knows, which halves sides: they become even."""
    writer: Any = imageio.get_writer(
        path,
        format="FFMPEG",
        fps=fps,
        codec="libx264",
        macro_block_size=2,
        quality=8,
        output_params=["-movflags", "+faststart"],
    )
    with writer:
        for frame in frames:
            writer.append_data(_even(frame))


def _even(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height, width, _ = frame.shape
    if height % 2 == 0 and width % 2 == 0:
        return frame
    return np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")


def _write_gif(path: Path, frames: Iterator[NDArray[np.uint8]], fps: float) -> None:
    """One palette for all pictures, so that what stays the same takes no room."""
    kept = [Image.fromarray(frame) for frame in frames]
    sample = [kept[index] for index in {0, len(kept) // 3, 2 * len(kept) // 3, len(kept) - 1}]
    width, height = sample[0].size
    # so much of each colour of the policies that none is taken for another
    patch = max(8, height // 8)
    colours = list(OKABE_ITO.values())
    sheet = Image.new("RGB", (width, height * len(sample) + patch * len(colours)))
    for index, picture in enumerate(sample):
        sheet.paste(picture, (0, index * height))
    for index, colour in enumerate(colours):
        top = height * len(sample) + patch * index
        sheet.paste(ImageColor.getrgb(colour), (0, top, width, top + patch))
    palette = sheet.quantize(GIF_COLOURS, method=Image.Quantize.MEDIANCUT)
    drawn = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in kept]
    period = max(2, round(100.0 / fps)) * 10
    drawn[0].save(
        path,
        format="GIF",
        save_all=True,
        append_images=drawn[1:],
        duration=[period] * (len(drawn) - 1) + [2000],
        loop=0,
        optimize=False,
        disposal=1,
    )


def labels_of(names: Sequence[str]) -> list[str]:
    """Return labels that differ, with a number where a label comes again."""
    seen: dict[str, int] = {}
    labels = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        labels.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return labels
