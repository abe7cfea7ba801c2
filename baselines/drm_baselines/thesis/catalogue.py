"""Every table, figure, claim, erratum and study by its name."""

from __future__ import annotations

import difflib
import functools
from collections.abc import Sequence

from drm_baselines.errors import BaselineError
from drm_baselines.thesis.claims import claim_entries
from drm_baselines.thesis.consistent import consistent_entries
from drm_baselines.thesis.errata import erratum_entries
from drm_baselines.thesis.figures_flights import flight_entries
from drm_baselines.thesis.figures_modal import modal_entries
from drm_baselines.thesis.figures_profiles import profile_entries
from drm_baselines.thesis.results import Entry
from drm_baselines.thesis.tables import table_entries


def _order(entry: Entry) -> tuple[int, str, int]:
    """Tables, then figures; within them as numbered."""
    kinds = ("table", "figure")
    _, _, number = entry.name.partition("-")
    chapter, _, place = number.replace(".", "-").partition("-")
    return kinds.index(entry.kind), chapter, int(place)


@functools.cache
def entries() -> dict[str, Entry]:
    """Return all entries by name: tables, figures, claims, errata, the consistent plant."""
    numbered = [*table_entries(), *modal_entries(), *profile_entries(), *flight_entries()]
    ordered = [
        *sorted(numbered, key=_order),
        *claim_entries(),
        *erratum_entries(),
        *consistent_entries(),
    ]
    return {entry.name: entry for entry in ordered}


def select(names: Sequence[str] | None) -> list[Entry]:
    """Return the entries of these names in the order of `entries`, all for none.

    Raises
    ------
    BaselineError
        An unknown name; the message lists close ones.
    """
    known = entries()
    if not names:
        return list(known.values())
    for name in names:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=5, cutoff=0.5)
            hint = f"; close: {', '.join(close)}" if close else ""
            raise BaselineError(
                f"no table, figure, claim, erratum or study {name!r}{hint} (--list shows all)"
            )
    return [entry for entry in known.values() if entry.name in set(names)]
