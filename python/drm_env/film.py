"""Pictures of a flight that has been flown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drm_env import _engine
from drm_env._manoeuvres import engine_scenario
from drm_env.errors import ConfigError
from drm_env.pictures import Look

if TYPE_CHECKING:
    from drm_env._config import Scenario
    from drm_env.resolved import ResolvedConfig

__all__ = ["Film"]

_SIGNALS = tuple(_engine.film_signals())


class Film:
    """Pictures of one flight at any of its instants, as `DrmEnv.render` draws them.

    Parameters
    ----------
    scenario
        The manoeuvre, as `simulate` takes it.
    trajectory
        Its signals by name, each of shape (samples,), as `simulate` and `Rollout.trajectory`
        return them. One that diverged is drawn up to there; then the last picture is held, and
        says so.
    width, height
        Size of the pictures, px.
    magnification
        Factor by which deflections are drawn larger than they are; by default one that follows
        from the manoeuvre, so that all flights of it have the same.
    title, colour
        What stands above, and the colour (``"#RRGGBB"``) of link 2, curves and trail.

    Raises
    ------
    ConfigError
        An impossible value, with its name; a trajectory without a signal that is needed.

    Examples
    --------
    >>> import drm_env
    >>> scenario = {"mass_error": 0.15}
    >>> flight = drm_env.simulate(scenario, law="lyapunov", decimation=10)
    >>> film = drm_env.Film(scenario, flight, title="Lyapunov law", width=640, height=480)
    >>> film.frame(12.0).shape
    (480, 640, 3)
    >>> sum(1 for _ in film.frames(fps=5, speed=2.0))
    51
    """

    def __init__(
        self,
        scenario: Scenario | ResolvedConfig | Mapping[str, Any] | None,
        trajectory: Mapping[str, NDArray[np.float64]],
        *,
        width: int = Look.width,
        height: int = Look.height,
        magnification: float | None = None,
        title: str = Look.title,
        colour: str = Look.colour,
    ) -> None:
        self._look = Look(width, height, magnification, title, colour, prefix="")
        missing = [name for name in _SIGNALS if name not in trajectory]
        if missing:
            raise ConfigError(f"trajectory must have the signals {', '.join(missing)}")
        columns = [np.asarray(trajectory[name], dtype=np.float64) for name in _SIGNALS]
        shapes = {column.shape for column in columns}
        if len(shapes) != 1 or columns[0].ndim != 1 or columns[0].size == 0:
            raise ConfigError(
                f"signals of the trajectory must have one shape (samples,), got {sorted(shapes)}"
            )
        times = columns[0]
        if not np.all(np.diff(times) >= 0.0):
            raise ConfigError("time of the trajectory must not go back")
        self._duration = float(times[-1])
        factor = self._look.magnification
        self._engine = _engine.Film(
            engine_scenario(scenario),
            np.column_stack(columns),
            bool(getattr(trajectory, "metrics", {}).get("diverged", False)),
            None if factor is None else float(factor),
        )

    @property
    def duration(self) -> float:
        """Time of the last instant, s."""
        return self._duration

    @property
    def magnification(self) -> float:
        """Factor by which deflections are drawn larger than they are."""
        return self._engine.magnification

    def share_axes(self, *others: Film) -> None:
        """Gives this film and others the same axes and the same camera."""
        films = (self, *others)
        ranges = [film._engine.ranges() for film in films]
        for film in films:
            for other in ranges:
                film._engine.widen(other)

    def frame(self, time: float) -> NDArray[np.uint8]:
        """The picture at a time, of the last sample that is not later.

        Parameters
        ----------
        time
            s, of the manoeuvre. Before the first sample and after the last there are these.

        Returns
        -------
        frame
            uint8 of shape (height, width, 3).
        """
        look = self._look
        return self._engine.frame(float(time), look.size, look.title, look.rgb)

    def frames(
        self, fps: float = 25.0, *, speed: float = 1.0, duration: float | None = None
    ) -> Iterator[NDArray[np.uint8]]:
        """The pictures of a film that plays at ``fps`` pictures a second, the last one included.

        Parameters
        ----------
        fps
            Pictures for each second of the film.
        speed
            Seconds of the manoeuvre for each second of the film.
        duration
            Seconds of the manoeuvre that are shown; by default all.
        """
        for time in frame_times(fps, speed, self.duration if duration is None else duration):
            yield self.frame(time)


def frame_times(fps: float, speed: float, duration: float) -> list[float]:
    """Times of the manoeuvre (s) at which the pictures of a film are taken.

    Raises
    ------
    ConfigError
        Not positive, or more pictures than anybody has room for.
    """
    for name, value in (("fps", fps), ("speed", speed)):
        if isinstance(value, bool) or not (math.isfinite(value) and value > 0.0):
            raise ConfigError(f"{name} must be a positive number, got {value!r}")
    if not (math.isfinite(duration) and duration >= 0.0):
        raise ConfigError(f"duration must be a number that is not negative, got {duration!r}")
    period = speed / fps
    count = math.ceil(duration / period - 1e-9)
    if count > 1_000_000:
        raise ConfigError(f"fps must give at most 1e6 pictures, got {count} with {fps!r}")
    return [index * period for index in range(count)] + [duration]
