"""Draw the block diagram and the geometry sketch of the documentation as SVG.

    tools/diagrams.py [DIRECTORY]        (docs/images by default)

Both stand on a panel of their own, and follow the reader's dark or light scheme.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[1]

STYLE = """
svg { color-scheme: light dark; }
.panel { fill: #f6f8fa; stroke: #d0d7de; }
text { font-family: system-ui, -apple-system, "Segoe UI", Roboto, Inter, sans-serif;
  font-size: 15px; fill: #1f2328; }
.small { font-size: 12.5px; fill: #59636e; }
.strong { font-weight: 600; }
.symbol { font-style: italic; font-family: Georgia, "Times New Roman", serif; font-size: 18px; }
.line { stroke: #424a53; stroke-width: 1.8; fill: none; }
.thin { stroke: #818b98; stroke-width: 1.2; fill: none; }
.dash { stroke-dasharray: 5 5; }
.head { fill: #424a53; }
.thinhead { fill: #818b98; }
.box { fill: #ffffff; stroke: #818b98; stroke-width: 1.4; }
.agent { fill: #dcecf7; stroke: #0072b2; stroke-width: 2; }
.plant { fill: #fdf0d8; stroke: #c98500; stroke-width: 1.8; }
.link1 { fill: none; stroke: #818b98; stroke-width: 13; stroke-linecap: round; }
.link2 { fill: none; stroke: #0072b2; stroke-width: 7; stroke-linecap: round; }
.payload { fill: #e69f00; stroke: #a87300; stroke-width: 1.4; }
.wheel { fill: #009e73; stroke: #ffffff; stroke-width: 2; }
.error { stroke: #d55e00; stroke-width: 2; fill: none; }
.errorhead { fill: #d55e00; }
.errortext { fill: #b34700; }
@media (prefers-color-scheme: dark) {
  .panel { fill: #161b22; stroke: #30363d; }
  text { fill: #e6edf3; }
  .small { fill: #9da7b3; }
  .line { stroke: #c9d1d9; }
  .thin { stroke: #7d8590; }
  .head { fill: #c9d1d9; }
  .thinhead { fill: #7d8590; }
  .box { fill: #21262d; stroke: #7d8590; }
  .agent { fill: #0c2d45; stroke: #56b4e9; }
  .plant { fill: #3a2c0d; stroke: #e69f00; }
  .link1 { stroke: #7d8590; }
  .link2 { stroke: #56b4e9; }
  .wheel { stroke: #161b22; }
  .error { stroke: #ff8a4c; }
  .errorhead { fill: #ff8a4c; }
  .errortext { fill: #ff9d66; }
}
"""


class Drawing:
    """An SVG that is written element by element."""

    def __init__(self, width: int, height: int, title: str) -> None:
        self.parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            f'width="{width}" height="{height}" role="img">',
            f"<title>{escape(title)}</title>",
            f"<style>{STYLE}</style>",
            f'<rect class="panel" x="0.5" y="0.5" width="{width - 1}" height="{height - 1}" '
            'rx="10"/>',
        ]

    def add(self, text: str) -> None:
        """An element as it is."""
        self.parts.append(text)

    def text(self, x: float, y: float, text: str, kind: str = "", anchor: str = "middle") -> None:
        """A line of text; ``x`` is its middle, or its start or end as ``anchor`` says."""
        self.add(
            f'<text x="{x:.1f}" y="{y:.1f}" class="{kind}" text-anchor="{anchor}">'
            f"{escape(text)}</text>"
        )

    def box(
        self,
        x: float,
        y: float,
        w: float,
        h: float,
        title: str,
        lines: list[str],
        kind: str = "box",
    ) -> None:
        """A box with its title and smaller lines below it."""
        self.add(f'<rect class="{kind}" x="{x}" y="{y}" width="{w}" height="{h}" rx="8"/>')
        top = y + h / 2 - 8.5 * len(lines) + 5
        self.text(x + w / 2, top, title, "strong")
        for place, line in enumerate(lines):
            self.text(x + w / 2, top + 18 + 17 * place, line, "small")

    def arrow(
        self, points: list[tuple[float, float]], kind: str = "line", head: str = "head"
    ) -> None:
        """A line through points with a head at its end."""
        (x0, y0), (x1, y1) = points[-2:]
        angle = math.atan2(y1 - y0, x1 - x0)
        end = (x1 - 8 * math.cos(angle), y1 - 8 * math.sin(angle))
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in [*points[:-1], end])
        self.add(f'<polyline class="{kind}" points="{path}"/>')
        corners = [(x1, y1)] + [
            (x1 - 11 * math.cos(angle + turn), y1 - 11 * math.sin(angle + turn))
            for turn in (0.42, -0.42)
        ]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        self.add(f'<polygon class="{head}" points="{path}"/>')

    def written(self) -> str:
        """The whole file."""
        return "\n".join([*self.parts, "</svg>", ""])


def loop() -> str:
    """The control loop as a block diagram."""
    d = Drawing(980, 400, "The control loop of the Deployable Robotic Manipulator")
    d.box(24, 44, 180, 84, "reference", ["slew angle and rate,", "extension, over time"])
    d.box(24, 262, 180, 84, "reported payload", ["its mass is wrong", "by up to 15 %"])
    d.box(290, 44, 200, 84, "slew motor", ["open loop: torque for", "the rigid reported arm"])
    d.box(
        290,
        204,
        200,
        96,
        "controller",
        ["law, network or yours,", "10 to 500 times a second"],
        "agent",
    )
    d.box(560, 210, 150, 84, "two wheels", ["root ±100 N m,", "tip ±10 N m"])
    d.box(780, 44, 176, 84, "deployment", ["link 2 slides along", "its profile"])
    d.box(
        780,
        186,
        176,
        132,
        "flexible arm",
        [
            "both links bend,",
            "true payload at the tip;",
            "reward and metrics",
            "from its true states",
        ],
        "plant",
    )
    # forward
    d.arrow([(204, 72), (290, 72)])
    d.arrow([(114, 128), (114, 200), (250, 200), (250, 236), (290, 236)])
    d.arrow([(204, 284), (290, 284)])
    d.arrow([(228, 284), (228, 104), (290, 104)])
    d.add('<circle class="head" cx="228" cy="284" r="3.5"/>')
    d.arrow([(490, 252), (560, 252)])
    d.arrow([(710, 252), (780, 252)])
    d.arrow([(490, 86), (745, 86), (745, 216), (780, 216)])
    d.arrow([(868, 128), (868, 186)])
    # back
    d.arrow([(868, 318), (868, 366), (390, 366), (390, 300)])
    d.arrow([(635, 294), (635, 334), (430, 334), (430, 300)], "thin", "thinhead")
    d.text(525, 242, "action", "small")
    d.text(745, 242, "torques", "small")
    d.text(615, 76, "torque of the motor", "small")
    d.text(660, 384, "measured: slew angle and rate, deflection of link 2 and its rate", "small")
    d.text(533, 328, "stored momentum", "small")
    d.text(176, 192, "reference", "small")
    return d.written()


def geometry() -> str:
    """The arm from above, with what the symbols mean."""
    d = Drawing(980, 500, "Geometry of the Deployable Robotic Manipulator, seen from above")
    ox, oy, length = 70.0, 430.0, 740.0
    rigid, reference = math.radians(21.0), math.radians(29.0)

    def at(along: float, bend: float, angle: float = rigid) -> tuple[float, float]:
        return (
            ox + along * math.cos(angle) - bend * math.sin(angle),
            oy - along * math.sin(angle) - bend * math.cos(angle),
        )

    def curve(kind: str, start: float, end: float, scale: float) -> None:
        points = []
        for step in range(41):
            s = start + (end - start) * step / 40
            points.append(at(s, scale * (s / length) ** 2 * (3.0 - s / length) / 2.0))
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        d.add(f'<polyline class="{kind}" points="{path}"/>')

    bend, split, inside = -74.0, 362.0, 230.0
    tip = at(length, bend)
    rigid_tip, goal = at(length, 0.0), at(length, 0.0, reference)
    # axes and the places where it should be
    d.arrow([(ox, oy), (ox + 840, oy)], "thin", "thinhead")
    d.add(
        f'<line class="thin dash" x1="{ox}" y1="{oy}" '
        f'x2="{rigid_tip[0]:.1f}" y2="{rigid_tip[1]:.1f}"/>'
    )
    d.add(f'<line class="thin dash" x1="{ox}" y1="{oy}" x2="{goal[0]:.1f}" y2="{goal[1]:.1f}"/>')
    curve("link1", 0.0, split, bend)
    curve("link2", inside, length, bend)
    # payload, wheels
    slope = math.degrees(rigid) + math.degrees(math.atan(1.5 * bend / length))
    d.add(
        f'<g transform="translate({tip[0]:.1f} {tip[1]:.1f}) rotate({-slope:.1f})">'
        '<rect class="payload" x="0" y="-17" width="62" height="34" rx="4"/></g>'
    )
    d.add(f'<circle class="wheel" cx="{ox}" cy="{oy}" r="17"/>')
    d.add(f'<circle class="wheel" cx="{tip[0]:.1f}" cy="{tip[1]:.1f}" r="11"/>')
    # angles
    for angle, radius, label, kind in (
        (rigid, 330.0, "θ", "symbol"),
        (reference, 450.0, "θ ref", "symbol"),
    ):
        x, y = ox + radius * math.cos(angle), oy - radius * math.sin(angle)
        d.add(
            f'<path class="thin" d="M {ox + radius:.1f} {oy} '
            f'A {radius} {radius} 0 0 0 {x:.1f} {y:.1f}"/>'
        )
        place = 0.25 * angle
        d.text(
            ox + (radius + 16) * math.cos(place),
            oy - (radius + 16) * math.sin(place),
            label,
            kind,
            "start",
        )
    # deflection and tip error
    d.arrow([rigid_tip, at(length, bend + 12)], "error", "errorhead")
    d.arrow([at(length + 8, 0.0, reference), at(length + 8, 4.0)], "thin", "thinhead")
    middle = at(length + 14, 0.6 * bend)
    d.text(middle[0] + 4, middle[1] - 8, "y", "symbol errortext", "start")
    d.text(goal[0] + 8, goal[1] - 8, "where the tip should be", "small", "start")
    beside = at(length + 20, 48.0)
    d.text(beside[0], beside[1] + 14, "r e", "symbol", "start")
    # lengths
    one = at(0.5 * split, 84.0)
    d.text(one[0] + 4, one[1] - 8, "link 1: 7 m", "strong", "end")
    two = at(0.8 * length, -92.0)
    d.text(two[0] - 12, two[1] + 22, "link 2 slides out: a = 1 to 8 m", "strong", "start")
    d.text(ox - 18, oy + 42, "shoulder: slew motor and root wheel", "small", "start")
    d.add(f'<circle class="head" cx="{ox}" cy="{oy}" r="3"/>')
    d.text(tip[0] + 60, tip[1] + 34, "payload: true and", "strong", "middle")
    d.text(tip[0] + 60, tip[1] + 52, "reported mass", "strong", "middle")
    d.text(tip[0] - 20, tip[1] - 14, "tip wheel", "small", "end")
    d.text(ox + 838, oy + 22, "start of the slew", "small", "end")
    d.text(24, 40, "Seen from above; bending enlarged", "small", "start")
    d.text(24, 64, "reach r = 7 m + a", "", "start")
    d.text(24, 86, "slew error e = θ - θ ref", "", "start")
    d.text(24, 108, "tip error = r e + y", "", "start")
    return d.written()


DRAWINGS = {"loop.svg": loop, "geometry.svg": geometry}


def main() -> int:
    """Write both files."""
    directory = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images"
    for name, draw in DRAWINGS.items():
        (directory / name).write_text(draw(), encoding="utf-8")
        print(directory / name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
