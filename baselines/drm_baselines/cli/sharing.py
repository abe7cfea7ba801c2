"""Options of commands whose work can be shared out, ``--ray [ADDRESS]`` among them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

if TYPE_CHECKING:
    from drm_baselines.support.places import Place

_ADDRESS = re.compile(r"auto|local|(?:ray://)?[^/\s]+:\d+")

RayOption = Annotated[
    str | None,
    typer.Option(
        "--ray",
        metavar="[ADDRESS]",
        help="Spread the work over a Ray cluster (docs/scale.md): HOST:PORT or ray://HOST:PORT; "
        "without an address the one that this machine belongs to or RAY_ADDRESS names, and where "
        "there is none (or with 'local') one of this machine alone. The results are the same to "
        "the bit.",
        show_default=False,
    ),
]
"""Where work goes if not to this machine."""

ProcessesOption = Annotated[
    int,
    typer.Option(
        min=1,
        max=1024,
        help="Processes of this machine that share the work, if no Ray cluster does.",
    ),
]


class WithRay(TyperCommand):
    """A command whose ``--ray`` may stand without an address."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Give ``--ray`` the address that it may have left out."""
        given: list[str] = []
        for place, argument in enumerate(args):
            given.append(argument)
            following = args[place + 1] if place + 1 < len(args) else ""
            if argument == "--ray" and not _ADDRESS.fullmatch(following):
                given.append("auto")
        return super().parse_args(ctx, given)


def place_of(ray: str | None, processes: int = 1) -> Place:
    """Return where the work goes, after asking for what it needs there.

    Raises
    ------
    MissingPackageError
        Ray is asked for and not installed.
    """
    from drm_baselines.support.extras import require
    from drm_baselines.support.places import Place

    if ray is not None:
        require("work on a Ray cluster", "scale", "ray")
    return Place(ray=ray, processes=processes)
