"""How values show themselves in Jupyter: small tables and curves in HTML, every text escaped."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_env.metrics import episode_metrics

_UNITS = {
    "time": "s",
    "angle": "rad",
    "accel": "rad/s²",
    "alpha": "m",
    "beta": "m",
    "deflection": "m",
    "extension": "m",
    "torque": "N m",
    "momentum": "N m s",
    "power": "W",
}
"""Units of signals by the last word of their names."""


def unit_of(signal: str) -> str:
    """Returns the unit of a signal of a trajectory, by its name; nothing where it has none."""
    *before, last = signal.split("_")
    if last == "rate":
        # of an angle unless it is the rate of a length
        return "m/s" if _UNITS.get(before[-1] if before else "") == "m" else "rad/s"
    return _UNITS.get(last, "")


_WIDTH, _HEIGHT, _POINTS = 150.0, 24.0, 150


def _text(value: Any) -> str:
    return html.escape(str(value))


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else str(float(value))


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Returns a table of cells that are HTML; the first column is aligned left.

    Its look is the notebook's own.
    """
    head = "".join(f"<th>{_text(name)}</th>" for name in headings)
    body = "".join(
        "<tr>"
        + "".join(
            f'<td style="text-align: {"left" if place == 0 else "right"}">{cell}</td>'
            for place, cell in enumerate(row)
        )
        + "</tr>"
        for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def folded(title: str, content: str, *, unfolded: bool = False) -> str:
    """Returns HTML that is shown when its title is clicked."""
    state = " open" if unfolded else ""
    return f"<details{state}><summary>{_text(title)}</summary>{content}</details>"


def curve(values: NDArray[np.float64]) -> str:
    """Returns a curve without axes as an inline picture; nothing where no value is finite.

    Of each of 150 pieces the smallest and the largest value are drawn.
    """
    finite = values[np.isfinite(values)]
    if finite.size < 2:
        return ""
    pieces = np.array_split(finite, min(_POINTS, finite.size))
    ends = np.array([(piece.min(), piece.max()) for piece in pieces])
    low, high = float(ends.min()), float(ends.max())
    # halves, for the difference of two huge numbers may not be a number
    span = high / 2.0 - low / 2.0
    level = (ends / 2.0 - low / 2.0) / span if span > 0.0 else np.full(ends.shape, 0.5)
    across = np.linspace(1.0, _WIDTH - 1.0, len(pieces))
    down = _HEIGHT - 2.0 - (_HEIGHT - 4.0) * level
    points = " ".join(
        f"{x:.1f},{y:.1f}" for x, pair in zip(across, down, strict=True) for y in pair
    )
    return (
        f'<svg width="{_WIDTH:g}" height="{_HEIGHT:g}" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}">'
        f'<polyline points="{points}" fill="none" stroke="#0072B2" stroke-width="1"/></svg>'
    )


def metrics_table(metrics: Mapping[str, float]) -> str:
    """Returns metrics with their units and what they are."""
    known = {entry.name: entry for entry in episode_metrics()}
    rows = []
    for name, value in metrics.items():
        entry = known.get(name)
        unit, what = (entry.unit, entry.description) if entry else ("", "")
        rows.append((_text(name), _number(value), _text("" if unit == "1" else unit), _text(what)))
    return table(("metric", "value", "unit", "what it is"), rows)


def trajectory(signals: Mapping[str, NDArray[np.float64]], metrics: Mapping[str, float]) -> str:
    """Returns a trajectory: its signals with their curves, and its metrics."""
    rows = []
    for name, values in signals.items():
        finite = values[np.isfinite(values)]
        ends = (
            (_number(float(finite.min())), _number(float(finite.max())))
            if finite.size
            else ("", "")
        )
        shape = "" if name == "time" else curve(values)
        rows.append((_text(name), _text(unit_of(name)), *ends, shape))
    samples = len(next(iter(signals.values()), ()))
    until = f", {signals['time'][-1]:g} s" if samples and "time" in signals else ""
    lost = " (diverged)" if metrics.get("diverged") else ""
    return (
        f"<p><b>Trajectory</b>{lost}: {samples} samples{until}</p>"
        + folded("metrics", metrics_table(metrics), unfolded=True)
        + folded("signals", table(("signal", "unit", "smallest", "largest", "over time"), rows))
    )


def rollout(
    metrics: Mapping[str, NDArray[np.float64]], trajectories: Mapping[str, NDArray[np.float64]]
) -> str:
    """Returns the distribution of every metric over many manoeuvres."""
    known = {entry.name: entry for entry in episode_metrics()}
    rows = []
    for name, values in metrics.items():
        finite = np.sort(values[np.isfinite(values)])
        unit = known[name].unit if name in known else ""
        shares = (
            tuple(_number(float(q)) for q in np.quantile(finite, (0.0, 0.25, 0.5, 0.75, 1.0)))
            if finite.size
            else ("",) * 5
        )
        missing = values.size - finite.size
        rows.append(
            (
                _text(name),
                _text("" if unit == "1" else unit),
                *shares,
                str(missing) if missing else "",
                curve(finite),
            )
        )
    count = len(next(iter(metrics.values()), ()))
    kept = ", ".join(trajectories)
    signals = f"; signals {_text(kept)}" if kept else ""
    headings = ("metric", "unit", "least", "25 %", "median", "75 %", "largest", "none", "in order")
    return f"<p><b>Rollout</b>: {count} manoeuvres{signals}</p>" + table(headings, rows)


def _leaves(node: Any, path: str = "") -> Iterable[tuple[str, Any]]:
    if isinstance(node, Mapping) and node:
        for name, item in node.items():
            yield from _leaves(item, f"{path}.{name}" if path else str(name))
    else:
        yield path, node


def configuration(data: Mapping[str, Any]) -> str:
    """Returns a configuration, a folded table for each part; what is not drawn is left out."""
    parts = []
    for name, part in data.items():
        rows = [
            (_text(path), _text(json.dumps(value)))
            for path, value in _leaves(part)
            if not (name == "randomize" and value is None)
        ]
        parts.append(folded(f"{name} ({len(rows)} values)", table(("setting", "value"), rows)))
    return "".join(parts)


def environment(title: str, config: Any, *first: tuple[str, str]) -> str:
    """Returns what an environment of a resolved configuration is, and every value of it.

    ``first`` are rows, name and value, above those that follow from the configuration.
    """
    rows = (
        *first,
        ("an episode", f"{config.horizon_steps} steps of {config.control_period:g} s"),
        ("observation", f"{len(config.observation_layout)} entries"),
        ("action", f"{config.action_size}: {', '.join(config.actuators)}"),
        ("drawn for each episode", ", ".join(config.drawn) or "nothing"),
    )
    body = ((_text(name), _text(value)) for name, value in rows)
    return f"<p><b>{_text(title)}</b></p>{table(('', ''), body)}{configuration(config.to_dict())}"
