"""One manoeuvre of a suite, flown for the page by everybody who plans nothing."""

from __future__ import annotations

from collections.abc import Sequence

from drm_baselines import suites
from drm_baselines.benchmark.competitors import Competitor
from drm_baselines.evaluation.reports import manoeuvre_of, payload_told
from drm_baselines.pages.blocks import Data
from drm_baselines.pages.flights import flights_block

_DECIMATION = 5


def example_flights(suite: str, everybody: Sequence[Competitor]) -> Data | None:
    """Return the first manoeuvre of a suite under everybody but the bound and controllers.

    These two plan, which takes seconds a flight. A learning method flies its first training seed;
    nobody left: ``None``.
    """
    scenario = suites.load(suite).scenarios[0]
    flown = {}
    for competitor in everybody:
        if competitor.kind not in ("bound", "controller"):
            _, pilot = next(competitor.pilots())
            flown[competitor.title] = pilot.trajectory(scenario, decimation=_DECIMATION)
    if not flown:
        return None
    title = f"{suite}, episode 0: payload {payload_told(scenario)}"
    return flights_block([manoeuvre_of(title, scenario, flown)])
