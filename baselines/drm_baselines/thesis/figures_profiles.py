"""Figures of chapter 3: profiles, rigid torques, deployment and the disturbance torque."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.thesis.drawing import curves, panels
from drm_baselines.thesis.manoeuvres import Manoeuvre, peak, rms, slew_end
from drm_baselines.thesis.published import statements
from drm_baselines.thesis.results import Entry, Outcome, ours_only

_Array = NDArray[np.float64]
_INFERRED = "The payload of the figure is lost; Payload 1 is carried."


def _until_end(flight: drm_env.Trajectory) -> dict[str, _Array]:
    keep = flight["time"] <= slew_end(flight) + 1.0
    return {name: flight[name][keep] for name in flight}


def _profile(manoeuvre: Manoeuvre, statement: str | None) -> Outcome:
    flight = manoeuvre.flight()
    shown = _until_end(flight)
    figure, axes = panels(3, title=f"Slew profile: {manoeuvre.title}")
    for axis, (label, signal, scale) in zip(
        axes,
        (
            ("acceleration (rad/s²)", "reference_accel", 1.0),
            ("rate (rad/s)", "reference_rate", 1.0),
            ("angle (deg)", "reference_angle", 180.0 / np.pi),
        ),
        strict=True,
    ):
        curves(axis, shown["time"], {label: shown[signal] * scale}, ylabel=label)
    end = slew_end(flight)
    rows = [
        statements()[statement].row(end) if statement else ours_only("final time", "s", end),
        ours_only("largest rate", "rad/s", peak(flight["reference_rate"])),
        ours_only("final angle", "deg", float(np.degrees(flight["reference_angle"][-1]))),
    ]
    return Outcome(tuple(rows), "The reference that the slew follows.", figure)


def _torque(manoeuvre: Manoeuvre) -> Outcome:
    flight = manoeuvre.flight()
    shown = _until_end(flight)
    figure, (axis,) = panels(1, title=f"Rigid slew torque: {manoeuvre.title}", height=3.2)
    curves(axis, shown["time"], {"S": shown["slew_torque"]}, ylabel="slew torque (N m)")
    rows = (
        ours_only("largest torque", "N m", float(flight["slew_torque"].max())),
        ours_only("smallest torque", "N m", float(flight["slew_torque"].min())),
    )
    return Outcome(rows, f"Inverse dynamics of the rigid arm. {_INFERRED}", figure)


def _deployment() -> Outcome:
    flight = Manoeuvre().flight()
    shown = _until_end(flight)
    figure, axes = panels(3, title="Deployment from 1 m to 8 m, coincident with the slew")
    accel = np.gradient(shown["extension_rate"], shown["time"])
    for axis, (label, values) in zip(
        axes,
        (
            ("acceleration (m/s²)", accel),
            ("rate (m/s)", shown["extension_rate"]),
            ("length a (m)", shown["extension"]),
        ),
        strict=True,
    ):
        curves(axis, shown["time"], {label: values}, ylabel=label)
    end = slew_end(flight)
    rows = (
        ours_only("largest rate", "m/s", peak(flight["extension_rate"])),
        ours_only("acceleration", "m/s²", 4.0 * 7.0 / end**2),
        ours_only("final length", "m", float(flight["extension"][-1])),
    )
    return Outcome(rows, "Bang-bang acceleration that switches with the slew.", figure)


def disturbance_torque(manoeuvre: Manoeuvre) -> tuple[_Array, _Array]:
    """Return times (s) and the torque on the slew that comes from the elastic coordinates (N m).

    It is the slew equation of the elastic arm less that of the rigid one: inertia, velocity and
    stiffness terms of both deflections, without the axial load.
    """
    flight = manoeuvre.flight()
    time = flight["time"]
    keep = np.nonzero(time <= slew_end(flight))[0][::2]
    scenario = manoeuvre.scenario()
    model = drm_env.Model(scenario["payload"])
    acceleration = 4.0 * (manoeuvre.end - manoeuvre.start) / slew_end(flight) ** 2
    found = []
    for i in keep:
        accel = acceleration if time[i] < slew_end(flight) / 2.0 else -acceleration
        a, rate = float(flight["extension"][i]), float(flight["extension_rate"][i])
        q = np.array([flight[name][i] for name in ("slew_angle", "alpha", "beta")])
        v = np.array([flight[name][i] for name in ("slew_rate", "alpha_rate", "beta_rate")])
        torque = float(flight["slew_torque"][i])
        w = model.acceleration(q, v, a, rate=rate, accel=accel, slew_torque=torque)
        M, C, K = model.matrices(a, rate, accel)
        found.append(M[0, 1:] @ w[1:] + C[0, 1:] @ v[1:] + K[0, 1:] @ q[1:])
    return time[keep], np.array(found)


def _disturbance() -> Outcome:
    manoeuvre = Manoeuvre(payload="P0")
    time, torque = disturbance_torque(manoeuvre)
    figure, (axis,) = panels(1, title=f"Disturbance torque: {manoeuvre.title}", height=3.2)
    curves(axis, time, {"D": torque}, ylabel="torque (N m)")
    half = time < time[-1] / 2.0
    statement = statements()["disturbance_torque_fig_3_13_Nm"]
    rows = (
        statement.row(rms(torque)),
        ours_only("largest in the first half", "N m", peak(torque[half])),
        ours_only("largest in the second half", "N m", peak(torque[~half])),
    )
    return Outcome(rows, "Terms of the deflections in the slew equation.", figure)


def profile_entries() -> list[Entry]:
    """Return the entries of chapter 3."""
    found = []
    for number, profile, smoothing, statement in (
        (2, "min_time", 0.0, "final_time_min_time_s"),
        (5, "min_time", 0.1, None),
        (7, "min_energy", 0.0, "final_time_min_energy_s"),
        (9, "min_energy", 0.1, None),
    ):
        manoeuvre = Manoeuvre(profile=profile, smoothing=smoothing, inertia="full")
        words = profile.replace("min_", "minimum ") + (" smoothed by 0.1" if smoothing else "")
        section = {2: "3.2.2", 5: "3.2.3", 7: "3.2.4", 9: "3.2.5"}[number]
        found.append(
            Entry(
                f"figure-3.{number}",
                f"Slew profile: {words}",
                section,
                functools.partial(_profile, manoeuvre, statement),
            )
        )
        found.append(
            Entry(
                f"figure-3.{number + 1}",
                f"Rigid slew torque: {words}",
                section,
                functools.partial(_torque, manoeuvre),
            )
        )
    deployment = Entry("figure-3.4", "Deployment of link 2", "3.2.2", _deployment)
    # The deployment stands between the torques of minimum time and the smoothed profile.
    found.insert(2, deployment)
    found.append(Entry("figure-3.13", "Disturbance torque of the deflections", "3.3", _disturbance))
    return found
