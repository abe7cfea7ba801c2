"""Name, kind, title, colour, line and marker of every policy: the one place that says them.

Commands take the names, list them in their help and say them where somebody gives another one;
tables and pictures show the titles, and a policy has the same colour, line and marker in every
picture. Colours are those of Okabe and Ito, which stay apart for the
colour-blind; policies of one family share a colour and differ in line and marker.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from drm_baselines.errors import PolicyError

_DOTS = (0, (1, 1.5))
_LONG = (0, (9, 2))
_SHORT = (0, (3, 2))
_DASH_DOTS = (0, (6, 1, 1, 1, 1, 1))


_DASHES: dict[str, tuple[float, ...]] = {"-": (), "--": (7, 3), "-.": (8, 3, 2, 3), ":": (2, 2)}


def dash_of(line: Any) -> tuple[float, ...]:
    """Return a line style of matplotlib as lengths of strokes and gaps, CSS px."""
    return _DASHES[line] if isinstance(line, str) else tuple(2.6 * part for part in line[1])


def _hex(hue: str) -> str:
    # the palette is the engine's, which takes its time to import
    from drm_baselines.support.palette import OKABE_ITO

    return OKABE_ITO[hue]


@dataclass(frozen=True, kw_only=True)
class PolicyName:
    """How a policy is called and drawn.

    Attributes
    ----------
    name
        In commands and files.
    kind
        What it is: ``"bound"`` (what no policy can be better than), ``"open loop"``, ``"law"``,
        ``"tuned law"`` (gains of ``drm tune``), ``"controller"`` (plans ahead), ``"learned"``.
    title
        In tables and pictures.
    hue, line, marker
        In pictures: a colour of the palette by name, the others as matplotlib takes them.
    """

    name: str
    kind: str
    title: str
    hue: str
    line: Any = "-"
    marker: str = "o"

    @property
    def colour(self) -> str:
        """Its colour, ``"#RRGGBB"``."""
        return _hex(self.hue)

    @property
    def knows(self) -> str:
        """What it is told of the payload: ``"true"`` or ``"reported"``."""
        return "true" if self.kind == "bound" else "reported"

    @property
    def dash(self) -> tuple[float, ...]:
        """Lengths of the strokes and gaps of its line, CSS px; nothing: an unbroken line."""
        return dash_of(self.line)

    @property
    def style(self) -> dict[str, Any]:
        """Colour, line style and marker as matplotlib's keywords."""
        return {"color": self.colour, "linestyle": self.line, "marker": self.marker}


def _all(*rows: tuple[str, str, str, str, Any, str]) -> dict[str, PolicyName]:
    return {
        name: PolicyName(name=name, kind=kind, title=title, hue=hue, line=line, marker=marker)
        for name, kind, title, hue, line, marker in rows
    }


POLICIES = _all(
    ("bound", "bound", "bound", "black", "-", "8"),
    ("none", "open loop", "open loop", "grey", "-", "X"),
    ("linear", "law", "linear law", "blue", "-", "o"),
    ("lyapunov", "law", "Lyapunov law", "orange", "-", "^"),
    ("servo", "law", "servo with modal damping", "green", "--", "H"),
    ("linear_tuned", "tuned law", "linear law, retuned", "blue", "--", "s"),
    ("lyapunov_tuned", "tuned law", "Lyapunov law, retuned", "orange", "--", "v"),
    ("lqr", "tuned law", "LQR, scheduled and tuned", "blue", _DOTS, "D"),
    ("linear_filtered", "tuned law", "linear law, filtered", "blue", "-.", "1"),
    ("lyapunov_filtered", "tuned law", "Lyapunov law, filtered", "orange", "-.", "2"),
    ("linear_collocated", "tuned law", "linear law, filtered, collocated tip", "blue", ":", "3"),
    ("collocated", "tuned law", "collocated, scheduled", "green", _DOTS, "4"),
    ("servo_zv", "shaped law", "servo, slew shaped by ZV", "green", ":", "+"),
    ("servo_zvd", "shaped law", "servo, slew shaped by ZVD", "green", _LONG, "x"),
    ("servo_lean_zvd", "shaped law", "servo that leans out, shaped by ZVD", "green", _SHORT, "."),
    ("lqg", "controller", "LQG, scheduled", "purple", _DOTS, "d"),
    ("receding", "controller", "adaptive receding horizon", "green", "-", "P"),
    ("dagger", "learned", "imitation and gradient, residual", "vermilion", "-", "*"),
    ("ppo", "learned", "PPO, residual", "purple", "-", "<"),
    ("sac", "learned", "SAC, residual on the linear law", "sky blue", "-", ">"),
    ("ppo_direct", "learned", "PPO end to end", "purple", "--", "p"),
    ("ppo_robust", "learned", "PPO end to end, drawn hardware", "purple", ":", "|"),
    ("ppo_flexible", "learned", "PPO, residual on the servo, flexible arm", "purple", _LONG, "_"),
    ("sac_direct", "learned", "SAC end to end", "sky blue", "--", "h"),
)
"""Every policy by name, in the order of tables."""

ALIASES = {"learned": "dagger"}
"""Other names of policies."""

_SEED = re.compile(r", seed \d+\Z")
"""What a learned policy's title may be followed by."""

_BY_TITLE = {entry.title: entry for entry in POLICIES.values()}

# For policies that have no name: runs of one's own. None of them is drawn as a policy above.
_OTHERS = tuple(
    (hue, line, marker)
    for line, marker in ((_DASH_DOTS, "d"), ("-.", "H"))
    for hue in ("vermilion", "green", "purple", "sky blue")
)


def names_of(*kinds: str) -> tuple[str, ...]:
    """Return the names of the policies of some kinds, or of all, in the order of tables."""
    return tuple(name for name, entry in POLICIES.items() if not kinds or entry.kind in kinds)


def listed() -> str:
    """Return all names in one line, for help and errors."""
    others = (f"{other} (another name of {name})" for other, name in ALIASES.items())
    return ", ".join((*names_of(), *others))


def is_name(text: str) -> bool:
    """Return whether a policy has this name."""
    return text in POLICIES or text in ALIASES


def find(name: str) -> PolicyName:
    """Return the policy of a name.

    Raises
    ------
    PolicyError
        There is none; the message lists what there is.
    """
    entry = POLICIES.get(ALIASES.get(name, name))
    if entry is None:
        raise PolicyError(f"no policy {name!r}; there are {listed()}")
    return entry


def title_of(name: str) -> str:
    """Return the title of a policy, or ``name`` itself where it has none."""
    entry = POLICIES.get(name)
    return name if entry is None else entry.title


def styles(labels: Sequence[str]) -> list[dict[str, Any]]:
    """Return colour, line style and marker for each of the labels of a picture.

    Parameters
    ----------
    labels
        Names or titles of policies, also with the seed of a training behind (``"..., seed 0"``;
        the first of a policy looks like it). Anything else, such as a run, gets a style that no
        policy has: by its label, so that it is the same in every picture, unless another label of
        this picture has that already.

    Returns
    -------
    list of dict
        Keywords of matplotlib: ``color``, ``linestyle``, ``marker``.
    """
    found = []
    met = {label for label in labels if label in POLICIES}
    met |= {_BY_TITLE[label].name for label in labels if label in _BY_TITLE}
    free = list(range(len(_OTHERS)))
    for label in labels:
        entry = POLICIES.get(label) or _BY_TITLE.get(_SEED.sub("", label))
        if entry is not None and (label in POLICIES or label in _BY_TITLE or entry.name not in met):
            met.add(entry.name)
            found.append(entry.style)
            continue
        place = zlib.crc32(label.encode()) % len(_OTHERS)
        if free and place not in free:
            place = free[0]
        if place in free:
            free.remove(place)
        hue, line, marker = _OTHERS[place]
        found.append({"color": _hex(hue), "linestyle": line, "marker": marker})
    return found
