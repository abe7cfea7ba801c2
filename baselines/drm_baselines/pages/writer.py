"""Pages as HTML: one file that holds everything and needs no network."""

from __future__ import annotations

import base64
import functools
import itertools
import json
import math
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from drm_baselines.pages.blocks import Data, Intervals, Page, Section
from drm_baselines.support import storage
from drm_baselines.support.extras import needing
from drm_baselines.support.palette import OKABE_ITO, on_dark

with needing("a report in HTML", "evaluate"):
    import jinja2
    from markupsafe import Markup

_SIGNATURES = {b"\x89PNG": "image/png", b"RIFF": "image/webp"}


def _asset(name: str) -> str:
    return resources.files(__package__).joinpath("assets", name).read_text(encoding="utf-8")


@functools.cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_asset),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["data_uri"] = data_uri
    environment.filters["embedded"] = embedded
    environment.filters["intervals"] = drawn_intervals
    return environment


def data_uri(data: bytes) -> str:
    """Return a picture (PNG or WebP) as the address that is its content."""
    kind = _SIGNATURES.get(data[:4], "application/octet-stream")
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def embedded(content: Any) -> Markup:
    """Return data as JSON for a script element: no text in it can end the element."""
    text = json.dumps(storage.plain(content), allow_nan=False, separators=(",", ":"))
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)


def _groups(sections: Sequence[Section]) -> list[tuple[str, list[Section]]]:
    grouped = itertools.groupby(sections, key=lambda section: section.group)
    return [(group, list(members)) for group, members in grouped]


def page_text(page: Page) -> str:
    """Return a page as HTML that asks for nothing else.

    All texts of the page are escaped, whatever is in them.
    """
    blocks = [block for section in page.sections for block in section.blocks]
    scripts = {block.script for block in blocks if isinstance(block, Data)}
    files = ["page.js", *(f"{name}.js" for name in ("flights", "episodes") if name in scripts)]
    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            page=page,
            groups=_groups(page.sections),
            # what is in these files is ours
            style=Markup(_asset("page.css")),
            scripts=[Markup(_asset(name)) for name in files],
            charts=bool(scripts),
            dark={colour: on_dark(colour) for colour in OKABE_ITO.values()},
            licence=Markup(_asset("uPlot-LICENSE.txt")),
            library=Markup(_asset("uPlot.iife.min.js")) if scripts else "",
            library_style=Markup(_asset("uPlot.min.css")) if scripts else "",
        )
    )


def write_page(page: Page, path: Path, *, overwrite: bool = False) -> Path:
    """Write a page; return ``path``.

    Raises
    ------
    ExistingResultError
        ``path`` exists and ``overwrite`` is false.
    """
    return storage.write_text(path, page_text(page), overwrite=overwrite)


# --- points with intervals ------------------------------------------------------------------------

_LEFT, _WIDTH, _ROW, _TOP, _BOTTOM = 8.0, 560.0, 29.0, 4.0, 4.0


def _ticks(low: float, high: float) -> list[float]:
    """Plain numbers of a logarithmic axis."""
    decades = range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 1)
    factors = (1.0, 2.0, 5.0) if high < 300.0 * low else (1.0,)
    every = (factor * 10.0**decade for decade in decades for factor in factors)
    return [value for value in every if low <= value <= high]


def drawn_intervals(block: Intervals) -> dict[str, Any]:
    """Return where everything of a picture of points with intervals stands, px."""
    edges = [
        value
        for row in block.rows
        for value in (row.value, row.low, row.high)
        if math.isfinite(value) and value > 0.0
    ]
    low, high = (min(edges), max(edges)) if edges else (1.0, 10.0)
    low, high = low / 1.25, high * 1.25
    span = math.log(high / low)

    def place(value: float) -> float:
        inside = min(max(value, low), high)
        return round(_LEFT + (_WIDTH - 2 * _LEFT) * math.log(inside / low) / span, 1)

    height = _TOP + _ROW * len(block.rows) + _BOTTOM
    rows = []
    for number, row in enumerate(block.rows):
        flown = math.isfinite(row.value) and row.value > 0.0
        spread = flown and math.isfinite(row.low) and math.isfinite(row.high)
        rows.append(
            {
                "row": row,
                "y": _TOP + _ROW * (number + 0.5),
                "x": place(row.value) if flown else None,
                "from": place(row.low) if spread else None,
                "to": place(row.high) if spread else None,
            }
        )
    return {
        "width": _WIDTH,
        "height": height,
        "row_height": _ROW,
        "top": _TOP,
        "bottom": height - _BOTTOM,
        "rows": rows,
        "ticks": [(place(value), f"{value:g}") for value in _ticks(low, high)],
        "line": None if block.line is None else place(block.line),
        "axis": block.axis,
        "middle": _WIDTH / 2,
    }
