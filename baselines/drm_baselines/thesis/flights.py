"""Which manoeuvre each figure of chapters 4 and 5 shows, and which signals of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from drm_baselines.thesis.manoeuvres import Manoeuvre


@dataclass(frozen=True)
class Shown:
    """A figure of flights.

    Attributes
    ----------
    title, section
        One line, and where in the thesis.
    manoeuvre
        What flies.
    signals
        Panels, by the names of `drm_baselines.thesis.figures_flights.PANELS`.
    note
        What had to be inferred because the caption is lost.
    """

    title: str
    section: str
    manoeuvre: Manoeuvre
    signals: tuple[str, ...]
    note: str = ""


_STANDARD = Manoeuvre()
_FIXED = replace(_STANDARD, start=4.0, end=4.0)
_ENERGY = replace(_STANDARD, profile="min_energy")
_FASTER = replace(_STANDARD, start=4.0, end=8.0, max_accel=0.04)
_RELEASE = replace(_STANDARD, start=8.0, end=8.0, angle_deg=0.0, initial_beta=0.01)
_RETRACTING = replace(_ENERGY, start=8.0, end=1.0)
_HIGH = replace(_STANDARD, law="linear root, high gain", horizon=40.0)
_LONG = 60.0
_HEAVY = "Payload 3 is beyond what one function a link can represent, as the thesis says."
_LOST = "The caption is lost; the manoeuvre follows from the text."

_VIBRATION = ("tip",)
_ROOT = ("root",)
_TIP = ("wheel",)
_SLEW = ("angle", "slew")


def _only(manoeuvre: Manoeuvre, law: str, horizon: float = 30.0) -> Manoeuvre:
    return replace(manoeuvre, law=law, horizon=horizon)


def _payload(manoeuvre: Manoeuvre, payload: str) -> Manoeuvre:
    return replace(manoeuvre, payload=payload)


def _smoothed(manoeuvre: Manoeuvre, smoothing: float) -> Manoeuvre:
    return replace(manoeuvre, smoothing=smoothing)


def _wrong(manoeuvre: Manoeuvre, error: float) -> Manoeuvre:
    return replace(manoeuvre, mass_error=error)


_BOTH_LINEAR = _only(_STANDARD, "linear", 40.0)
_BOTH_LYAPUNOV = _only(_STANDARD, "Lyapunov", 40.0)
_UNBOUNDED = replace(_STANDARD, payload="3000 kg", unbounded=True, horizon=30.0, sample_period=5e-4)

FLIGHTS: dict[str, Shown] = {
    "4.1": Shown("Total energy after a release", "4.1.1", _RELEASE, ("total energy",)),
    "4.2": Shown("Kinetic and strain energy after a release", "4.1.1", _RELEASE, ("energies",)),
    "4.3": Shown("Deflection after a release", "4.1.1", _RELEASE, _VIBRATION, _LOST),
    "4.6": Shown(
        "Slew at a fixed length without payload", "4.2.1", _payload(_FIXED, "PNone"), _SLEW
    ),
    "4.7": Shown("Fixed length, no payload", "4.2.1", _payload(_FIXED, "PNone"), _VIBRATION, _LOST),
    "4.8": Shown("Fixed length, Payload 0", "4.2.1", _payload(_FIXED, "P0"), _VIBRATION, _LOST),
    "4.9": Shown("Fixed length, Payload 1", "4.2.1", _FIXED, _VIBRATION, _LOST),
    "4.10": Shown(
        "Slew while deploying without payload", "4.2.1", _payload(_STANDARD, "PNone"), _SLEW, _LOST
    ),
    "4.11": Shown(
        "Slew torque and deployment that switch together",
        "4.2.1",
        _STANDARD,
        ("slew", "force"),
        f"{_LOST} The force is mass times acceleration, without the centrifugal pull "
        "(claim-deployment-force).",
    ),
    "4.12": Shown("Deploying, no payload", "4.2.1", _payload(_STANDARD, "PNone"), _VIBRATION),
    "4.13": Shown("Deploying, Payload 0", "4.2.1", _payload(_STANDARD, "P0"), _VIBRATION, _LOST),
    "4.14": Shown("Deploying, Payload 1", "4.2.1", _STANDARD, _VIBRATION, _LOST),
    "4.15": Shown("Smoothing 0", "4.2.2", _STANDARD, _VIBRATION),
    "4.16": Shown("4 to 8 m at 0.04 rad/s²", "4.2.2", _FASTER, _VIBRATION, _LOST),
    "4.17": Shown("Smoothing 0.005", "4.2.2", _smoothed(_FASTER, 0.005), _VIBRATION),
    "4.18": Shown("Smoothing 0.01", "4.2.2", _smoothed(_FASTER, 0.01), _VIBRATION),
    "4.19": Shown(
        "Smoothing 0.05", "4.2.2", _smoothed(_FASTER, 0.05), ("tip", "tip afterwards"), _LOST
    ),
    "4.20": Shown("Slew, smoothing 0.05", "4.2.2", _smoothed(_FASTER, 0.05), _SLEW, _LOST),
    "4.21": Shown(
        "Minimum energy at a fixed length",
        "4.2.3",
        replace(_FIXED, profile="min_energy"),
        ("tip", "slew", "angle"),
        "The payload is lost; the text compares with figure 4.9, so Payload 1 is carried.",
    ),
    "4.22": Shown(
        "Minimum energy, no payload", "4.2.3", _payload(_ENERGY, "PNone"), _VIBRATION, _LOST
    ),
    "4.23": Shown("Minimum energy, Payload 0", "4.2.3", _payload(_ENERGY, "P0"), _VIBRATION, _LOST),
    "4.24": Shown("Minimum energy, Payload 1", "4.2.3", _ENERGY, _VIBRATION, _LOST),
    "4.25": Shown("Minimum energy, smoothing 0", "4.2.4", _ENERGY, _VIBRATION),
    "4.26": Shown(
        "Minimum energy, smoothing 0.005", "4.2.4", _smoothed(_ENERGY, 0.005), _VIBRATION
    ),
    "4.27": Shown("Minimum energy, smoothing 0.01", "4.2.4", _smoothed(_ENERGY, 0.01), _VIBRATION),
    "4.28": Shown(
        "Minimum energy, smoothing 0.05", "4.2.4", _smoothed(_ENERGY, 0.05), _VIBRATION, _LOST
    ),
    "4.29": Shown(
        "Slew in minimum energy, smoothing 0.05", "4.2.4", _smoothed(_ENERGY, 0.05), _SLEW
    ),
    "4.31": Shown("Acceleration and torque, minimum time", "4.3", _STANDARD, ("accel", "slew")),
    "4.32": Shown(
        "Acceleration and torque, minimum energy", "4.3", _ENERGY, ("accel", "slew"), _LOST
    ),
    "4.33": Shown("Power, minimum time", "4.3", _STANDARD, ("power",), _LOST),
    "4.34": Shown("Power, minimum energy", "4.3", _ENERGY, ("power",)),
    "4.35": Shown(
        "Slew torque with a deployment by 200 N",
        "4.4",
        replace(_STANDARD, deployment="force_limited"),
        ("slew", "length"),
        _LOST,
    ),
    "4.36": Shown(
        "Vibration with a deployment by 200 N",
        "4.4",
        replace(_STANDARD, deployment="force_limited"),
        _VIBRATION,
        _LOST,
    ),
    "4.37": Shown(
        "Vibration while retracting",
        "4.4",
        replace(_STANDARD, start=8.0, end=1.0),
        _VIBRATION,
        _LOST,
    ),
    "4.38": Shown(
        "Mass reported 15 % too large, open loop", "4.5", _wrong(_STANDARD, 0.15), ("angle",)
    ),
    "4.39": Shown(
        "Mass reported 15 % too small, open loop",
        "4.5",
        _wrong(_STANDARD, -0.15),
        ("angle",),
        _LOST,
    ),
    "4.40": Shown("Linear root law", "4.6.1.1", _only(_STANDARD, "linear root"), _VIBRATION, _LOST),
    "4.41": Shown("Linear root law, torque", "4.6.1.1", _only(_STANDARD, "linear root"), _ROOT),
    "4.42": Shown("Linear root law with high gains", "4.6.1.1", _HIGH, _VIBRATION, _LOST),
    "4.43": Shown(
        "Linear root law with high gains, torque",
        "4.6.1.1",
        _HIGH,
        _ROOT,
        "The text calls this figure 4.44, which is the tip law's; the caption is lost.",
    ),
    "4.44": Shown("Linear tip law", "4.6.1.2", _only(_STANDARD, "linear tip"), _VIBRATION, _LOST),
    "4.45": Shown("Linear tip law, torque", "4.6.1.2", _only(_STANDARD, "linear tip"), _TIP, _LOST),
    "4.46": Shown(
        "Linear tip law, Payload 0",
        "4.6.1.2",
        _only(_payload(_STANDARD, "P0"), "linear tip"),
        _VIBRATION,
        _LOST,
    ),
    "4.47": Shown("Linear law", "4.6.1.3", _BOTH_LINEAR, ("tip", "root", "wheel")),
    "4.48": Shown(
        "Linear law, mass reported 15 % too large",
        "4.6.1.3",
        _wrong(_BOTH_LINEAR, 0.15),
        ("tip", "root", "wheel"),
        _LOST,
    ),
    "4.49": Shown(
        "Linear law, mass reported 15 % too large, angle",
        "4.6.1.3",
        _wrong(_BOTH_LINEAR, 0.15),
        ("angle",),
        _LOST,
    ),
    "4.50": Shown(
        "Linear law, Payload 3 reported 15 % too heavy",
        "4.6.1.3",
        _wrong(_only(_payload(_STANDARD, "P3"), "linear", _LONG), 0.15),
        ("tip", "angle"),
        _HEAVY,
    ),
    "4.51": Shown(
        "Linear law, Payload 3 reported 15 % too light",
        "4.6.1.3",
        _wrong(_only(_payload(_STANDARD, "P3"), "linear", _LONG), -0.15),
        ("tip", "angle"),
        _HEAVY,
    ),
    "4.52": Shown("Lyapunov root law", "4.6.2.1", _only(_STANDARD, "Lyapunov root"), _VIBRATION),
    "4.53": Shown("Lyapunov root law, torque", "4.6.2.1", _only(_STANDARD, "Lyapunov root"), _ROOT),
    "4.54": Shown(
        "Lyapunov root law, minimum energy",
        "4.6.2.1",
        _only(_ENERGY, "Lyapunov root"),
        _VIBRATION,
    ),
    "4.55": Shown("Retracting in minimum energy, open loop", "4.6.2.1", _RETRACTING, _VIBRATION),
    "4.56": Shown(
        "Retracting in minimum energy, Lyapunov root law",
        "4.6.2.1",
        _only(_RETRACTING, "Lyapunov root"),
        _VIBRATION,
        _LOST,
    ),
    "4.57": Shown(
        "Retracting in minimum energy, Lyapunov root law, torque",
        "4.6.2.1",
        _only(_RETRACTING, "Lyapunov root"),
        _ROOT,
    ),
    "4.58": Shown("Lyapunov tip law", "4.6.2.2", _only(_STANDARD, "Lyapunov tip"), _VIBRATION),
    "4.59": Shown(
        "Lyapunov tip law, Payload 0",
        "4.6.2.2",
        _only(_payload(_STANDARD, "P0"), "Lyapunov tip"),
        _VIBRATION,
        _LOST,
    ),
    "4.60": Shown(
        "Lyapunov tip law, minimum energy", "4.6.2.2", _only(_ENERGY, "Lyapunov tip"), _VIBRATION
    ),
    "4.61": Shown(
        "Lyapunov tip law, minimum energy, torque",
        "4.6.2.2",
        _only(_ENERGY, "Lyapunov tip"),
        _TIP,
    ),
    "4.62": Shown("Lyapunov law, Payload 0", "4.6.2.3", _payload(_BOTH_LYAPUNOV, "P0"), _VIBRATION),
    "4.63": Shown("Lyapunov law, Payload 1", "4.6.2.3", _BOTH_LYAPUNOV, _VIBRATION),
    "4.64": Shown(
        "Lyapunov law, Payload 3",
        "4.6.2.3",
        _payload(_BOTH_LYAPUNOV, "P3"),
        _VIBRATION,
        _HEAVY,
    ),
    "4.65": Shown("Lyapunov law, torques", "4.6.2.3", _BOTH_LYAPUNOV, ("slew", "root", "wheel")),
    "4.66": Shown(
        "Lyapunov law, mass reported 15 % too large",
        "4.6.2.3",
        _wrong(_BOTH_LYAPUNOV, 0.15),
        ("tip", "angle"),
        _LOST,
    ),
    "4.67": Shown(
        "Lyapunov law, Payload 3 reported 15 % too light, minimum energy",
        "4.6.2.3",
        _wrong(_only(_payload(_ENERGY, "P3"), "Lyapunov", _LONG), -0.15),
        ("tip", "angle"),
        _HEAVY,
    ),
    "4.68": Shown(
        "Lyapunov law, mass reported 15 % too large, torques",
        "4.6.2.3",
        _wrong(_BOTH_LYAPUNOV, 0.15),
        ("slew", "root", "wheel"),
    ),
    "4.69": Shown(
        "Lyapunov law, smoothing 0.005, minimum time",
        "4.6.2.3",
        _only(_smoothed(_FASTER, 0.005), "Lyapunov"),
        _VIBRATION,
        "The caption is lost; the text compares with figure 4.17, whose manoeuvre is flown.",
    ),
    "4.70": Shown(
        "Lyapunov law, smoothing 0.005, minimum energy",
        "4.6.2.3",
        _only(_smoothed(_ENERGY, 0.005), "Lyapunov"),
        _VIBRATION,
        "The caption is lost; the text compares with figure 4.26, whose manoeuvre is flown.",
    ),
    "5.1": Shown(
        "Lyapunov law without torque limits, 3000 kg",
        "5",
        replace(_UNBOUNDED, law="Lyapunov"),
        _VIBRATION,
        "The caption is lost. The payload has the dimensions of Payload 3, and the law is sampled "
        "every 0.5 ms: every 2 ms, without torque limits, it is unstable.",
    ),
    "5.2": Shown(
        "Linear law without torque limits, 3000 kg",
        "5",
        replace(_UNBOUNDED, law="linear"),
        _VIBRATION,
        "The payload has the dimensions of Payload 3; sampled every 0.5 ms as figure 5.1.",
    ),
}
"""By number of the figure. Figures 4.4, 4.5 (another arm, from a paper) and 4.30 (a circuit) are
not flights of this arm."""
