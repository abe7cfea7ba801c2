"""Figures of chapter 2: the characteristic function and mode shapes with a rigid link 1."""

from __future__ import annotations

import functools

import numpy as np

from drm_baselines.thesis import characteristic
from drm_baselines.thesis.arm import PAYLOAD_TITLES
from drm_baselines.thesis.drawing import curves, mark, panels
from drm_baselines.thesis.published import tables
from drm_baselines.thesis.results import Entry, Outcome, Row, ours_only

_LENGTH = 4.0
"""Length of link 2 in figures 2.4 to 2.9, m."""


def _zero_rows(payload: str, count: int) -> tuple[Row, ...]:
    table = tables()["table-2-4"]
    found = characteristic.frequencies(payload, _LENGTH, count)
    keys = [f"{payload} a=4 f{index + 1}" for index in range(count)]
    return tuple(
        table.groups[0].row(key, "Hz", float(value), label=f"frequency of zero {index + 1}")
        for index, (key, value) in enumerate(zip(keys, found, strict=True))
    )


def _crossings(payload: str, *, logarithm: bool) -> Outcome:
    count = 3 if logarithm else 2
    zeros = characteristic.wave_numbers(payload, _LENGTH, count)
    k = np.linspace(0.02, float(zeros[-1]) * 1.08, 1500)
    values = characteristic.function(k, payload, _LENGTH)
    title = f"Characteristic function, rigid link 1, {PAYLOAD_TITLES[payload]}, a = 4 m"
    figure, (axis,) = panels(1, title=title, xlabel="k (1/m)", height=3.6)
    if logarithm:
        curves(axis, k, {"f": np.log(1.0 + np.abs(values))}, ylabel="log(1 + |f(k)|)")
    else:
        # The function spans many decades; its sign and zeros are what the picture is about.
        shown = np.sign(values) * np.log10(1.0 + np.abs(values))
        curves(axis, k, {"f": shown}, ylabel="sign(f) log10(1 + |f(k)|)")
        axis.axhline(0.0, color="black", linewidth=0.8)
    mark(axis, [float(zero) for zero in zeros], "zero")
    axis.legend(fontsize="x-small")
    note = "The determinant of the boundary conditions as published; its scale is arbitrary."
    return Outcome(_zero_rows(payload, count), note, figure)


def _mode_shapes(payload: str, lengths: tuple[float, ...], note: str) -> Outcome:
    title = f"Mode shapes of link 2, rigid link 1, {PAYLOAD_TITLES[payload]}"
    figure, axes = panels(len(lengths), title=title, xlabel="x from the end of link 1 (m)")
    rows: list[Row] = []
    for axis, a in zip(axes, lengths, strict=True):
        x = np.linspace(0.0, a, 400)
        found = characteristic.shapes(payload, a, 4, x)
        lines = {f"mode {index + 1}": shape for index, shape in enumerate(found)}
        curves(axis, x, lines, ylabel=f"a = {a:g} m")
        axis.set_xlim(0.0, max(lengths))
        rows += [
            ours_only(f"deflection at the tip over the largest, mode {i + 1}, a = {a:g} m", "",
                      abs(float(shape[-1])))
            for i, shape in enumerate(found)
        ]  # fmt: skip
    return Outcome(tuple(rows), note, figure)


def modal_entries() -> list[Entry]:
    """Return the entries of figures 2.4 to 2.11."""
    found = []
    for index, payload in enumerate(("P1", "P2", "P3")):
        for first, logarithm in ((4, False), (7, True)):
            what = "First three zeros, logarithmic" if logarithm else "First two zeros"
            found.append(
                Entry(
                    f"figure-2.{first + index}",
                    f"{what} of the characteristic function, {PAYLOAD_TITLES[payload]}",
                    "2.3.3",
                    functools.partial(_crossings, payload, logarithm=logarithm),
                )
            )
    lost = "The two lengths are lost; 4 m and 8 m are shown, in elastic displacement."
    found.append(
        Entry("figure-2.10", "Mode shapes of link 2 with Payload 1 at two lengths", "2.3.3",
              functools.partial(_mode_shapes, "P1", (4.0, 8.0), lost))
    )  # fmt: skip
    found.append(
        Entry("figure-2.11", "Mode shapes of link 2 without payload, a = 8 m", "2.3.3",
              functools.partial(_mode_shapes, "PNone", (8.0,), "Elastic displacement."))
    )  # fmt: skip
    return found
