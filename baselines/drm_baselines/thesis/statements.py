"""Our value of each statement of the text about a flight."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

import drm_env
from drm_baselines.thesis import arm
from drm_baselines.thesis.flights import FLIGHTS
from drm_baselines.thesis.manoeuvres import (
    Manoeuvre,
    after,
    during,
    energies,
    final_angle_deg,
    largest_angle_deg,
    peak,
    rms,
    settling_time,
    slew_end,
)

_Value = Callable[[], float]


def flown(number: str) -> drm_env.Trajectory:
    """Return the flight of a figure."""
    return FLIGHTS[number].manoeuvre.flight()


def _residual_ratio(number: str) -> _Value:
    return lambda: peak(after(flown(number))) / peak(during(flown(number)))


def _difference_mm(one: str, other: Manoeuvre) -> _Value:
    def value() -> float:
        signal = "link2_tip_deflection"
        return 1e3 * float(np.abs(flown(one)[signal] - other.flight()[signal]).max())

    return value


def _residual_mm(number: str) -> float:
    return 1e3 * peak(after(flown(number)))


def _settling_ratio(one: str, other: str) -> _Value:
    return lambda: settling_time(flown(one)) / settling_time(flown(other))


def _rms_ratio(one: str, other: str) -> _Value:
    return lambda: rms(after(flown(one))) / rms(after(flown(other)))


def _energy(number: str, motor: str) -> _Value:
    manoeuvre = replace(FLIGHTS[number].manoeuvre, motor=motor)
    return lambda: float(manoeuvre.flight().metrics["slew_energy"])


def _final(number: str) -> _Value:
    return lambda: final_angle_deg(flown(number))


def _largest(number: str) -> _Value:
    return lambda: largest_angle_deg(flown(number))


def _drift() -> float:
    total = energies(FLIGHTS["4.1"].manoeuvre)[1]["total"]
    return float(np.abs(total / total[0] - 1.0).max())


def _correlation() -> float:
    lines = energies(FLIGHTS["4.2"].manoeuvre)[1]
    return float(np.corrcoef(lines["kinetic"], lines["strain"])[0, 1])


def _after_30_s() -> float:
    flight = flown("4.42")
    return 1e3 * peak(flight["link2_tip_deflection"][flight["time"] > 30.0])


def _saturated() -> float:
    flight = flown("4.43")
    torque = np.abs(during(flight, "root_torque"))
    return float(np.mean(torque >= 0.999 * torque.max()))


def _deployment_share() -> float:
    flight = flown("4.35")
    length = flight["extension"]
    over = flight["time"][np.nonzero(np.abs(length - length[-1]) < 1e-9)[0][0]]
    return float(over) / slew_end(flight)


def _swing(flight: drm_env.Trajectory, signal: str, low: float, high: float) -> float:
    """RMS of a signal about its slow motion in a window of time, which is a cubic."""
    part = flight[signal][(flight["time"] >= low) & (flight["time"] < high)]
    trend = np.polynomial.Polynomial.fit(np.arange(part.size), part, 3)
    return rms(part - trend(np.arange(part.size)))


def _last_over_first(number: str, signal: str = "link2_tip_deflection") -> _Value:
    """Vibration of the last over that of the first 2 s of a slew."""

    def value() -> float:
        flight = flown(number)
        end = slew_end(flight)
        return _swing(flight, signal, end - 2.0, end) / _swing(flight, signal, 0.0, 2.0)

    return value


def _length_half_way() -> float:
    flight = flown("4.14")
    return float(np.interp(slew_end(flight) / 2.0, flight["time"], flight["extension"]))


def _time_after_slew(manoeuvre: Manoeuvre) -> float:
    """Time from the end of the slew until link 2 stays below 1 mm, s; NaN if it diverges."""
    try:
        flight = manoeuvre.flight()
    except drm_env.SimulationError:
        return math.nan
    return settling_time(flight, 1e-3) - slew_end(flight)


def _first_frequency(a: float) -> _Value:
    return lambda: float(arm.frequencies("P1", a, "slender")[0])


VALUES: dict[str, _Value] = {
    "energy_drift_20_s": _drift,
    "energies_correlation": _correlation,
    "release_deflection_mm": lambda: 1e3 * peak(flown("4.3")["link2_tip_deflection"]),
    "residual_ratio_no_payload": _residual_ratio("4.7"),
    "residual_ratio_payload_0": _residual_ratio("4.8"),
    "residual_ratio_payload_1": _residual_ratio("4.9"),
    "length_half_way_m": _length_half_way,
    "unsmoothed_minimum_time_mm": _difference_mm("4.15", Manoeuvre(smoothing=1e-12)),
    "unsmoothed_minimum_energy_mm": _difference_mm(
        "4.25", Manoeuvre(profile="min_energy", smoothing=1e-12)
    ),
    "smoothing_0_005_ratio": lambda: _residual_mm("4.17") / _residual_mm("4.16"),
    "residual_phi_0_01_mm": lambda: _residual_mm("4.18"),
    "residual_phi_0_05_mm": lambda: _residual_mm("4.19"),
    "final_angle_phi_0_05_deg": _final("4.20"),
    "final_angle_energy_phi_0_05_deg": _final("4.29"),
    "min_energy_vibration_mm": lambda: _residual_mm("4.21") / _residual_mm("4.9"),
    "min_energy_falls_no_payload_ratio": _last_over_first("4.22", "tip_deflection"),
    "min_energy_falls_payload_0_ratio": _last_over_first("4.23", "tip_deflection"),
    "min_energy_falls_payload_0_link_2_ratio": _last_over_first("4.23"),
    "min_energy_falls_payload_1_ratio": _last_over_first("4.24", "tip_deflection"),
    "residual_energy_phi_0_005_mm": lambda: _residual_mm("4.26"),
    "residual_energy_phi_0_01_mm": lambda: _residual_mm("4.27"),
    "residual_energy_phi_0_05_mm": lambda: _residual_mm("4.28"),
    "slew_energy_min_time_J": _energy("4.33", "fitted"),
    "slew_energy_min_energy_J": _energy("4.34", "fitted"),
    "slew_energy_min_time_printed_J": _energy("4.33", "printed"),
    "slew_energy_min_energy_printed_J": _energy("4.34", "printed"),
    "deployment_time_share": _deployment_share,
    "retraction_first_frequency_start_Hz": _first_frequency(8.0),
    "retraction_first_frequency_end_Hz": _first_frequency(2.0),
    "retraction_vibration_ratio": _last_over_first("4.37"),
    "overshoot_open_loop_plus15_deg": _largest("4.38"),
    "largest_angle_open_loop_minus15_deg": _largest("4.39"),
    "settled_linear_root_s": lambda: settling_time(flown("4.40")),
    "high_gain_vibration_mm": _after_30_s,
    "high_gain_saturation": _saturated,
    "settled_tip_payload_0_ratio": _settling_ratio("4.46", "4.44"),
    "settled_linear_both_ratio": _settling_ratio("4.47", "4.40"),
    "largest_angle_linear_plus15_deg": _largest("4.49"),
    "final_angle_linear_plus15_deg": _final("4.49"),
    "largest_angle_payload_3_plus15_deg": _largest("4.50"),
    "final_angle_payload_3_plus15_deg": _final("4.50"),
    "final_angle_payload_3_minus15_deg": _final("4.51"),
    "settled_lyapunov_root_ratio": _settling_ratio("4.52", "4.40"),
    "settled_lyapunov_tip_ratio": _settling_ratio("4.58", "4.44"),
    "settled_lyapunov_tip_payload_0_ratio": _settling_ratio("4.59", "4.58"),
    "settled_lyapunov_both_s": lambda: settling_time(flown("4.47")) - settling_time(flown("4.63")),
    "largest_angle_lyapunov_plus15_deg": _largest("4.66"),
    "largest_angle_lyapunov_plus15_tip_only_deg": lambda: largest_angle_deg(
        replace(FLIGHTS["4.66"].manoeuvre, tip_torque="tip_only").flight()
    ),
    "final_angle_lyapunov_plus15_deg": _final("4.66"),
    "final_angle_lyapunov_payload_3_deg": _final("4.67"),
    "smoothed_lyapunov_time_ratio": _rms_ratio("4.69", "4.17"),
    "smoothed_lyapunov_energy_ratio": _rms_ratio("4.70", "4.26"),
    "unbounded_lyapunov_ratio": lambda: (
        _time_after_slew(FLIGHTS["5.1"].manoeuvre) / _time_after_slew(FLIGHTS["5.2"].manoeuvre)
    ),
    "unbounded_lyapunov_sampled_s": lambda: _time_after_slew(
        replace(FLIGHTS["5.1"].manoeuvre, sample_period=2e-3)
    ),
}
"""By the name of the statement in ``published.json``; chapter 3 and the claims have their own."""
