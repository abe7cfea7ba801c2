"""Missions under several laws: what came of the legs, as rows and as a picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.policies.names import styles, title_of

LINK1_LENGTH = drm_env.Scenario().arm.link1.length


def mission_document(content: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Return the mission of a file as ``drm_env.simulate`` takes it.

    Parameters
    ----------
    content
        ``mission`` and ``scenario``; or a whole configuration of an environment, whose first
        mission with this seed is drawn.
    seed
        Of what is drawn.

    Raises
    ------
    BaselineError
        There is no mission in it.
    """
    if "mission" not in content:
        raise BaselineError(
            "the file holds no mission: it must have a table 'mission' with 'legs' "
            "(see examples/mission.toml)"
        )
    if content.keys() <= {"mission", "scenario"}:
        return dict(content)
    (drawn,) = drm_env.sample_scenarios("slew_thesis", seed=seed, n=1, config=dict(content))
    return drawn


def replanned(document: Mapping[str, Any], replan: bool) -> dict[str, Any]:
    """Return the mission with its legs planned for the identified mass, or for the reported one."""
    return {**document, "mission": {**document["mission"], "replan": replan}}


def link1_length(document: Mapping[str, Any]) -> float:
    """Length of link 1 of a mission's arm, m."""
    arm = document.get("scenario", {}).get("arm", {})
    return float(arm.get("link1", {}).get("length", LINK1_LENGTH))


def tip_path(
    flight: Mapping[str, NDArray[np.float64]], link1: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates x and y of the tip in the plane, m: deflected, the shoulder at the origin."""
    reach, angle = link1 + flight["extension"], flight["slew_angle"]
    deflection = flight["tip_deflection"]
    return (
        reach * np.cos(angle) - deflection * np.sin(angle),
        reach * np.sin(angle) + deflection * np.cos(angle),
    )


def ends(flight: drm_env.Trajectory) -> list[float]:
    """Ends of the legs of a flight, s."""
    return [leg.start + leg.metrics["duration"] for leg in flight.legs]


def leg_rows(flight: drm_env.Trajectory) -> list[dict[str, float | str]]:
    """What came of each leg, by name with units."""
    return [
        {
            "leg": leg.leg,
            "kind": leg.kind,
            "start (s)": leg.start,
            "duration (s)": leg.metrics["duration"],
            "planned for (kg)": leg.planned_mass,
            "tip error rms (mm)": 1e3 * leg.metrics["tip_error_rms"],
            "peak deflection (mm)": 1e3 * leg.metrics["peak_deflection"],
            "slew error at end (mrad)": 1e3 * leg.metrics["final_slew_error"],
            "wheel effort (s)": leg.metrics["wheel_effort"],
        }
        for leg in flight.legs
    ]


def worth_of_replanning(
    document: Mapping[str, Any], law: Mapping[str, Any], errors: Sequence[float], *, seed: int
) -> list[dict[str, float | str]]:
    """Fly a mission with several mass errors, planned for the reported and the identified mass.

    Returns
    -------
    rows
        For each error one row planned for the reported mass and one planned for the identified one:
        the mass that the last leg with a payload was planned for, and what came of the mission.
    """
    missions, labels = [], []
    for error in errors:
        scenario = {**document.get("scenario", {}), "mass_error": error}
        scenario.pop("reported_payload", None)
        for replan in (False, True):
            missions.append(replanned({**document, "scenario": scenario}, replan))
            labels.append((error, "identified" if replan else "reported"))
    signals = ["root_momentum", "tip_momentum"]
    flown = drm_env.rollout(missions, law=dict(law), seed=[seed] * len(missions), signals=signals)
    rows: list[dict[str, float | str]] = []
    for index, (error, planned) in enumerate(labels):
        legs = flown.legs[index]
        carrying = [leg for leg in legs if leg.kind == "slew" and leg.planned_mass > 0.0]
        stored = [float(np.nanmax(np.abs(flown.trajectories[name][index]))) for name in signals]
        rows.append(
            {
                "mass error (%)": 100.0 * error,
                "planned for": planned,
                "last planned mass (kg)": carrying[-1].planned_mass if carrying else 0.0,
                "duration (s)": float(flown["duration"][index]),
                "tip error rms (mm)": 1e3 * float(flown["tip_error_rms"][index]),
                "wheel effort (s)": float(flown["wheel_effort"][index]),
                "root momentum (N m s)": stored[0],
                "motor energy (J)": float(flown["slew_energy"][index]),
            }
        )
    return rows


def plot_mission(
    flights: Mapping[str, drm_env.Trajectory],
    path: Path,
    *,
    document: Mapping[str, Any],
    title: str,
    overwrite: bool = False,
) -> Path:
    """Draw the tip's path in the plane, and angle, length, deflection, torques, momentum over time.

    Legs are those of the first flight; where waiting ends at rest, others have other lengths.
    """
    from drm_baselines.support.figures import save_figure, subplots

    degrees = 180.0 / np.pi
    rows: tuple[tuple[str, Callable[[Any], NDArray[np.float64]]], ...] = (
        ("slew angle\n(deg)", lambda f: f["slew_angle"] * degrees),
        ("extension\n(m)", lambda f: f["extension"]),
        ("tip deflection\n(mm)", lambda f: f["tip_deflection"] * 1e3),
        ("slew torque\n(N m)", lambda f: f["slew_torque"]),
        ("wheel torque\nroot (N m)", lambda f: f["root_torque"]),
        ("momentum\nroot (N m s)", lambda f: f["root_momentum"]),
        ("momentum\ntip (N m s)", lambda f: f["tip_momentum"]),
    )
    figure, grid = subplots(
        len(rows), 2, size=(15.0, 11.0), gridspec_kw={"width_ratios": (1.0, 1.4)}
    )
    place = grid[0, 0].get_gridspec()
    for axis in grid[:, 0]:
        axis.remove()
    plane = figure.add_subplot(place[:, 0])
    drawn = styles(list(flights))
    link1 = link1_length(document)
    for (name, flight), style in zip(flights.items(), drawn, strict=True):
        line = {key: value for key, value in style.items() if key != "marker"}
        plane.plot(*tip_path(flight, link1), label=title_of(name), linewidth=1.1, **line)
        for axis, (label, signal) in zip(grid[:, 1], rows, strict=True):
            axis.plot(flight["time"], signal(flight), linewidth=1.0, **line)
            axis.set_ylabel(label)
            axis.grid(alpha=0.3)
    first = next(iter(flights.values()))
    _mark_legs(grid[:, 1], plane, first, document["mission"].get("legs", []), link1)
    plane.plot(0.0, 0.0, "k^", markersize=9)
    plane.annotate("shoulder", (0.0, 0.0), xytext=(6, -12), textcoords="offset points")
    plane.set_aspect("equal")
    plane.set_xlabel("x of the tip (m)")
    plane.set_ylabel("y of the tip (m)")
    plane.grid(alpha=0.3)
    plane.legend(fontsize="small")
    grid[-1, 1].set_xlabel("time (s)")
    figure.suptitle(title)
    return save_figure(figure, path, overwrite=overwrite)


def _mark_legs(
    axes: Any,
    plane: Any,
    flight: drm_env.Trajectory,
    legs: Sequence[Mapping[str, Any]],
    link1: float,
) -> None:
    """Shade every other leg, name them, and mark where payloads come and go."""
    bounds = [leg.start for leg in flight.legs] + ends(flight)[-1:]
    for axis in axes:
        axis.set_xlim(0.0, bounds[-1])
        for index, (start, end) in enumerate(pairwise(bounds)):
            if index % 2:
                axis.axvspan(start, end, color="0.93", zorder=0)
    x, y = tip_path(flight, link1)
    for index, leg in enumerate(flight.legs):
        middle = 0.5 * (bounds[index] + bounds[index + 1])
        axes[0].annotate(
            f"{leg.leg} {leg.kind.replace('_', ' ')}", (middle, 1.02), ha="center",
            xycoords=("data", "axes fraction"), fontsize="x-small", rotation=25,
        )  # fmt: skip
        row = min(int(np.searchsorted(flight["time"], leg.start - 1e-9)), x.size - 1)
        before = legs[leg.leg - 1].get("kind") if 0 < leg.leg <= len(legs) else None
        if before in ("grapple", "release"):
            plane.plot(x[row], y[row], "ks" if before == "grapple" else "kD", markersize=6)
            plane.annotate(before, (x[row], y[row]), xytext=(7, 5), textcoords="offset points")
            for axis in axes:
                axis.axvline(leg.start, color="0.35", linewidth=0.8, linestyle="--")
