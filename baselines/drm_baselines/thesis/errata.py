"""Where the thesis' equations, listings or prints are wrong, each with numbers that show it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.thesis import arm
from drm_baselines.thesis.figures_profiles import disturbance_torque
from drm_baselines.thesis.manoeuvres import Manoeuvre, after, largest_angle_deg, peak, rms
from drm_baselines.thesis.published import statements, tables
from drm_baselines.thesis.results import Entry, Outcome, Row, judged, ours_only
from drm_baselines.thesis.tables import appendix_e, assumed, correct, exact

_Array = NDArray[np.float64]
_OPEN_LOOP = Manoeuvre(mass_error=0.15)


def _payload_terms() -> Outcome:
    table = tables()["table-2-4"].groups[0]
    rows = []
    for payload, a in (("P1", 4), ("P2", 4), ("P3", 4), ("P1", 8), ("P3", 8)):
        place = f"{arm.PAYLOAD_TITLES[payload]}, a = {a} m"
        full, dropped = correct(payload, a), exact(payload, a)
        for index in (0, 1):
            key = f"{payload} a={a} f{index + 1}"
            published = float(table.values[key])
            rows += [
                table.row(key, "Hz", dropped[index], label=f"{place}, f{index + 1}, terms dropped"),
                ours_only(f"{place}, f{index + 1}, all terms", "Hz", full[index]),
                ours_only(
                    f"{place}, f{index + 1}, printed value off by",
                    "%",
                    100.0 * (published / full[index] - 1.0),
                ),
            ]
    for payload in ("P0", "P1", "P2", "P3"):
        errors = [
            assumed(payload, a, 0, 2, "b8", "full")[0] / correct(payload, a)[0] - 1.0
            for a in map(float, range(1, 9))
        ]
        title = arm.PAYLOAD_TITLES[payload]
        rows.append(
            ours_only(
                f"{title}, a = 1 to 8 m, f1, two functions (B.8) above all terms by at most",
                "%",
                100.0 * max(errors),
            )
        )
    note = (
        "The shear condition at the tip is EI2 y''' = -w² (Mp Y + (Mp Lp/2) S) with displacement Y "
        "and slope S of the tip; the thesis leaves out the term of S, and again in the equation of "
        "angular momentum. Its conclusion that assumed modes fail for larger payloads follows from "
        "comparing them with these frequencies."
    )
    return Outcome(tuple(rows), note)


def _slender() -> Outcome:
    statement = statements()["overshoot_open_loop_plus15_deg"]
    table = tables()["table-2-9"].groups[0]
    rows = [
        replace(
            statement.row(largest_angle_deg(replace(_OPEN_LOOP, inertia=inertia).flight())),
            quantity=f"largest angle, mass reported +15 %, {inertia} inertia",
            reason="",
        )
        for inertia in ("slender", "full")
    ]
    for inertia in ("slender", "full"):
        for index in (0, 1):
            value = assumed("P1", 2.0, 1, 1, "b8", inertia)[index]
            label = f"table 2-9, Payload 1, a = 2 m, f{index + 1}, {inertia} inertia"
            rows.append(table.row(f"P1 a=2 f{index + 1}", "Hz", value, label=label))
    note = (
        "The text gives the payload about its point of attachment the inertia "
        "J = Mp (4 Lp² + Sp²)/12; its numbers are those of Sp = 0, a slender payload."
    )
    return Outcome(tuple(rows), note)


def _slope_coupling() -> Outcome:
    rows = []
    for a in (2.0, 4.0, 6.0, 8.0):
        thesis = assumed("P1", a, 1, 1, "b8", "full")
        element = arm.frequencies("P1", a, plant="finite_element")
        for index in (0, 1):
            place = f"Payload 1, a = {a:g} m, f{index + 1}"
            rows += [
                ours_only(f"{place}, thesis model", "Hz", thesis[index]),
                ours_only(f"{place}, finite elements", "Hz", float(element[index])),
                ours_only(
                    f"{place}, thesis above finite elements by",
                    "%",
                    100.0 * (thesis[index] / float(element[index]) - 1.0),
                ),
            ]
        consistent = float(arm.frequencies("P1", a, plant="consistent", modes=(4, 4))[0])
        rows.append(
            ours_only(
                f"Payload 1, a = {a:g} m, f1, consistent plant, 4 + 4 modes", "Hz", consistent
            )
        )
    for plant in ("thesis", "consistent"):
        flight = Manoeuvre(inertia="full", profile="min_energy", plant=plant).flight()
        for metric, words in (("peak_deflection", "in all"), ("residual_peak", "after the slew")):
            rows.append(
                ours_only(
                    f"Payload 1, minimum energy, largest deflection of the tip {words}, {plant} "
                    "plant",
                    "mm",
                    1e3 * float(flight.metrics[metric]),
                )
            )
    note = (
        "The end of link 1 moves link 2 by y1(L1) but does not turn it by y1'(L1). Beyond x = L1 "
        "the displacement should be y1(L1) + (x - L1) y1'(L1) + y2. The consistent plant has that."
    )
    return Outcome(tuple(rows), note)


def _coriolis() -> Outcome:
    rows = []
    for payload in ("P0", "P1", "P3"):
        for follow in (False, True):
            flight = Manoeuvre(payload=payload, particle_following=follow, inertia="full").flight()
            name = "particles followed" if follow else "as in the thesis"
            rows.append(
                ours_only(
                    f"{arm.PAYLOAD_TITLES[payload]}, largest deflection of link 2 after the "
                    f"slew, {name}",
                    "mm",
                    1e3 * peak(after(flight)),
                )
            )
        flight = Manoeuvre(payload=payload, plant="consistent", inertia="full").flight()
        rows.append(
            ours_only(
                f"{arm.PAYLOAD_TITLES[payload]}, largest deflection of link 2 after the slew, "
                "consistent plant",
                "mm",
                1e3 * peak(after(flight)),
            )
        )
    mass, rate = 200.0, 0.5
    for follow in (False, True):
        model = drm_env.Model(
            dict(arm.payload("P1")), dynamics={"particle_following": follow, "axial_load": False}
        )
        light = drm_env.Model(
            {"mass": 0.0, "length": 0.0, "width": 0.0},
            dynamics={"particle_following": follow, "axial_load": False},
        )
        # Row of link 1's deflection, column of the slew rate: 2 Mp a' belongs to each unit of the
        # tip's displacement, and alpha moves the tip by two.
        load = (model.matrices(4.0, rate).C - light.matrices(4.0, rate).C)[1, 0]
        name = "particles followed" if follow else "as in the thesis"
        rows.append(
            ours_only(f"Coriolis force on the payload over Mp a' θ', {name}", "",
                      float(load) / (2.0 * mass * rate))
        )  # fmt: skip
    note = (
        "A particle of link 2 moves out at a', so its transverse velocity has y' + a' ∂y/∂x and "
        "its axial one a' - y θ'. Without the second, the payload feels Mp a' θ' in place of the "
        "Coriolis force 2 Mp a' θ'. The consistent plant follows the particles and turns link 2 "
        "with link 1, too."
    )
    return Outcome(tuple(rows), note)


def _finite_elements() -> Outcome:
    table = tables()["table-2-11"].groups[0]
    rows = []
    for case, (payload, a) in enumerate(
        (("P0", 6.0), ("P0", 8.0), ("P1", 6.0), ("P1", 8.0)), start=1
    ):
        recovered, inertia = appendix_e(case)
        stated = arm.frequencies(payload, a, plant="finite_element")
        place = f"{arm.PAYLOAD_TITLES[payload]}, a = {a:g} m"
        for index in (0, 1):
            key = f"case {case} f{index + 1}"
            rows += [
                table.row(key, "Hz", recovered[index], label=f"{place}, f{index + 1}, recovered"),
                ours_only(f"{place}, f{index + 1}, stated arm", "Hz", float(stated[index])),
            ]
        printed = (14771.3, 23121.2, 34617.0, 59167.0)[case - 1]
        rows.append(
            judged(
                f"{place}, rigid inertia from the printed rotation, recovered model",
                "kg m²",
                printed,
                inertia,
                met=abs(inertia / printed - 1.0) < 0.005,
                status="inferred",
                reason="the payload's own inertia in that mode is not recovered"
                if payload == "P1"
                else "",
            )
        )
    note = (
        "The finite-element model of appendix E is not the arm of table 2-2: its a = 6 m is a beam "
        "of 3 + 4 + 4 m, EI is 2.6 G I of the tubes (2.135, 4.039 and 2.537e6 N m²), the overlap "
        "weighs 46.92 kg/m where 23.66 is right, and every payload sits 0.5 m beyond the tip with "
        "the inertia Mp Lp²/3 about its centre."
    )
    return Outcome(tuple(rows), note)


def _motor() -> Outcome:
    rows = []
    for profile, key in (
        ("min_time", "slew_energy_min_time"),
        ("min_energy", "slew_energy_min_energy"),
    ):
        for motor in ("printed", "fitted"):
            flight = Manoeuvre(profile=profile, motor=motor).flight()
            name = f"{key}_printed_J" if motor == "printed" else f"{key}_J"
            words = profile.replace("min_", "minimum ")
            rows.append(
                replace(
                    statements()[name].row(float(flight.metrics["slew_energy"])),
                    quantity=f"energy in {words}, {motor} motor",
                )
            )
    note = (
        "i = (S/Ng + cv Ng θ' + Im Ng θ'')/kt and E = ∫ Ra i² dt with the reference motion. The "
        "printed inertia Im = 2.67e-4 kg m² gives neither energy; 2.67e-3 with cv = 1.65e-4 N m s "
        "gives both: the exponent is probably a misprint. The fit has as many parameters as data."
    )
    return Outcome(tuple(rows), note)


def cosine_integrals(i: int, j: int, s: float) -> tuple[float, float]:
    """Return the integral of cos(i pi u) cos(j pi u) from s to 1: as listed, and right."""
    listed = -math.cos(j * math.pi * s) * math.sin(i * math.pi * s) / ((i + j) * math.pi)

    def primitive(u: float) -> float:
        plus = math.sin((i + j) * math.pi * u) / ((i + j) * math.pi)
        minus = u if i == j else math.sin((i - j) * math.pi * u) / ((i - j) * math.pi)
        return 0.5 * (plus + minus)

    return listed, primitive(1.0) - primitive(s)


def _cosine_integral() -> Outcome:
    rows = []
    s = (4.0 - 1.0) / 7.0
    for i, j in ((1, 2), (2, 1), (1, 3), (2, 3)):
        listed, right = cosine_integrals(i, j, s)
        rows += [
            ours_only(f"i = {i}, j = {j}, s = 3/7, as listed", "", listed),
            ours_only(f"i = {i}, j = {j}, s = 3/7, integral", "", right),
        ]
    group = tables()["table-2-10"].group("B9")
    for key in ("B9 a=4 n=m=5 f2", "B9 a=4 n=m=10 f2"):
        n = 10 if "=10" in key else 5
        value = assumed("P1", 4.0, n, n, "b9", "slender")[1]
        rows.append(group.row(key, "Hz", value, label=f"table 2-10, (B.9), a = 4 m, n = {n}, f2"))
        lower = assumed("P1", 4.0, 10, 10, "b8", "slender")[1]
    rows.append(ours_only("the same with (B.8), n = 10", "Hz", lower))
    note = (
        "The listing flexasm.m integrates cos(iπu) cos(jπu) over the overlap as "
        "-cos(jπs) sin(iπs)/((i + j)π) also for i ≠ j, where that formula does not hold (it is "
        "not even symmetric). The stiffness of link 1 is wrong whenever link 2 is partly inside."
    )
    return Outcome(tuple(rows), note)


def _exchanged_rows() -> Outcome:
    table = tables()["table-2-8"]
    rows = []
    for a in (1, 6, 7):
        key = f"P0 a={a} f1"
        found = {"exact": exact("P0", a)[0], "assumed modes": assumed("P0", a, 0, 2, "b8",
                                                                       "slender")[0]}  # fmt: skip
        for printed in found:
            value = float(table.group(printed).values[key])
            nearest = min(found, key=lambda name: abs(found[name] - value))
            rows += [
                judged(
                    f"a = {a} m, f1, printed as {printed}, computed by {computed}",
                    "Hz",
                    value,
                    found[computed],
                    met=computed == nearest,
                    status="inferred",
                    reason="" if computed != nearest else "the nearer of the two",
                )
                for computed in found
            ]
    note = (
        "In table 2-8 the first frequencies at a = 1, 6 and 7 m stand in each other's row: only "
        "exchanged do they follow from the methods of the rows."
    )
    return Outcome(tuple(rows), note)


def tip_law_gain(payload: str, a: float, law: str, inertia: str = "full") -> float:
    """Return the gain of a tip law on beta' at a length, N s."""
    if law == "linear":
        return 500.0
    mass, _, _ = arm.PAYLOADS[payload]
    L1, rho2 = arm.LINK1.length, arm.LINK2.mass_per_length
    J = arm.inertia_about_tip(payload, inertia)
    return rho2 * (0.75 * L1 * a + 0.55 * a**2) + 3.0 * J / a + 2.0 * mass * (L1 + a)


def tip_law_poles(payload: str, a: float, law: str, feedback: str = "beta_rate") -> _Array:
    """Return the poles of the arm at a frozen length under a tip law alone, 1/s.

    Parameters
    ----------
    payload, a
        Payload and length of link 2 outside link 1, m.
    law
        ``"linear"`` or ``"lyapunov"``, without torque limit or sampling.
    feedback
        ``"beta_rate"`` as in the thesis, or ``"tip_rate"``: the turning rate theta' + 3 beta'/a of
        the place where the wheel sits, scaled to the same gain.
    """
    linear = arm.model(payload).linearize(a)
    gain = tip_law_gain(payload, a, law)
    measured = np.zeros(6)
    measured[5] = 1.0
    if feedback == "tip_rate":
        measured[3] = a / 3.0
    return np.asarray(np.linalg.eigvals(linear.A - gain * np.outer(linear.B[:, 2], measured)))


def _tip_law() -> Outcome:
    rows: list[Row] = []
    for payload, a in (("P0", 1.0), ("P0", 2.0), ("P1", 1.0), ("P1", 8.0)):
        place = f"{arm.PAYLOAD_TITLES[payload]}, a = {a:g} m"
        for law in ("linear", "lyapunov"):
            poles = tip_law_poles(payload, a, law)
            # The rotation has two poles at zero.
            elastic = poles[np.abs(poles) > 1.0]
            worst = elastic[np.argmax(elastic.real)]
            rows.append(ours_only(f"{place}, {law}, largest real part", "1/s", float(worst.real)))
            if worst.real > 0.0:
                frequency = abs(float(worst.imag)) / (2.0 * math.pi)
                rows.append(ours_only(f"{place}, {law}, its frequency", "Hz", frequency))
    for law in ("linear", "lyapunov"):
        poles = tip_law_poles("P0", 1.0, law, "tip_rate")
        elastic = poles[np.abs(poles) > 1.0]
        rows.append(
            ours_only(f"Payload 0, a = 1 m, {law} on θ' + 3β'/a, largest real part", "1/s",
                      float(elastic.real.max()))
        )  # fmt: skip
    for law in ("linear tip", "Lyapunov tip", "linear"):
        flight = Manoeuvre(
            payload="P0", start=8.0, end=1.0, law=law, inertia="full", horizon=60.0
        ).flight()
        for low in (15.0, 55.0):
            time = flight["time"]
            part = flight["tip_deflection"][(time >= low) & (time < low + 5.0)]
            rows.append(
                ours_only(
                    f"Payload 0 retracted from 8 to 1 m, {law} law, largest deflection of the tip "
                    f"from {low:g} to {low + 5.0:g} s",
                    "mm",
                    1e3 * peak(part),
                )
            )
    note = (
        "T2 does work on θ + 3β/a, the angle of the tip, but the laws feed back β' alone. Sensor "
        "and actuator are not collocated, and with a light payload on a short arm the mode of "
        "link 1 grows. Feeding back θ' + 3β'/a would take energy out in every mode."
    )
    return Outcome(tuple(rows), note)


def axial_stiffness(payload: str, a: float, *, from_shoulder: bool) -> float:
    """Return the coefficient of theta'^2 in the axial stiffness of link 2's coordinate, kg.

    Parameters
    ----------
    payload, a
        Payload and length of link 2 outside link 1, m.
    from_shoulder
        Count distances from the shoulder, with the payload at its centre; the thesis counts them
        from the end of link 1, with the payload at its far end.
    """
    mass, length, _ = arm.PAYLOADS[payload]
    rho2 = arm.LINK2.mass_per_length
    nodes, weights = np.polynomial.legendre.leggauss(20)
    x = a * (nodes + 1.0) / 2.0
    root = arm.LINK1.length if from_shoulder else 0.0
    place = root + a + (length / 2.0 if from_shoulder else length)
    tension = rho2 * ((root + a) ** 2 - (root + x) ** 2) / 2.0 + mass * place
    slope = (6.0 * x / a - 3.0 * (x / a) ** 2) / a
    return float(np.sum(tension * slope**2 * weights) * a / 2.0)


def _axial_origin() -> Outcome:
    rows = []
    rate = 0.02 * 13.211091 / 2.0
    for payload, a in (("P1", 4.0), ("P3", 4.0), ("P1", 8.0), ("P3", 8.0)):
        thesis = axial_stiffness(payload, a, from_shoulder=False)
        right = axial_stiffness(payload, a, from_shoulder=True)
        bending = float(arm.model(payload).matrices(a).K[2, 2])
        place = f"{arm.PAYLOAD_TITLES[payload]}, a = {a:g} m"
        rows += [
            ours_only(f"{place}, as in the thesis", "kg", thesis),
            ours_only(f"{place}, from the shoulder", "kg", right),
            ours_only(
                f"{place}, difference over the bending stiffness at {rate:.3f} rad/s",
                "%",
                100.0 * (right - thesis) * rate**2 / bending,
            ),
        ]
    note = (
        "The axial force in link 2 integrates ρ2 η θ'² with η from the end of link 1, which leaves "
        "out L1, and puts the payload at a + Lp. The centripetal acceleration is that of the "
        "distance from the shoulder. The effect on the stiffness is small."
    )
    return Outcome(tuple(rows), note)


def _disturbance() -> Outcome:
    _, torque = disturbance_torque(Manoeuvre(payload="P0"))
    statement = statements()["disturbance_torque_fig_3_13_Nm"]
    half = torque.size // 2
    rows = (
        statement.row(rms(torque)),
        ours_only("largest in the first half", "N m", peak(torque[:half])),
        ours_only("largest in the second half", "N m", peak(torque[half:])),
    )
    note = (
        "D is the slew equation of the elastic arm less that of the rigid one. Evaluated in a "
        "flight it is far above the 100 N m by which the thesis sizes the root wheel."
    )
    return Outcome(rows, note)


def _functions() -> Outcome:
    group = tables()["table-2-5"].groups[0]
    rows = []
    for key in ("PNone a=4 f2", "P2 a=4 f2", "P1 a=2 f1"):
        payload, place, which = key.split(" ")
        index = int(which[1]) - 1
        for n in (2, 3, 7):
            value = assumed(payload, float(place[2:]), 0, n, "b8", "slender")[index]
            label = f"{arm.PAYLOAD_TITLES[payload]}, a = {place[2:]} m, {which}, {n} functions"
            rows.append(replace(group.row(key, "Hz", value, label=label), reason=""))
    note = (
        "Table 2-5 is said to use two functions. Its numbers are those of three, and for Payload 1 "
        "at short lengths of seven or eight."
    )
    return Outcome(tuple(rows), note)


_ERRATA: tuple[tuple[str, str, str, Callable[[], Outcome]], ...] = (
    ("payload-terms", "Payload terms missing from the exact equation", "2.3.3", _payload_terms),
    ("slender-inertia", "Numbers made with a slender payload", "2.6, 2.7, 4.5", _slender),
    ("slope-coupling", "Link 2 does not turn with the end of link 1", "2.2", _slope_coupling),
    ("coriolis", "Half of the payload's Coriolis load", "2.2, 2.5", _coriolis),
    ("axial-origin", "Origin of the axial load", "2.2.2", _axial_origin),
    ("finite-element", "The finite-element model is another arm", "2.8, appendix E",
     _finite_elements),
    ("motor-inertia", "Energies that do not follow from the motor's data", "4.3", _motor),
    ("cosine-integral", "Integral of cosines in a listing", "appendix D", _cosine_integral),
    ("exchanged-rows", "Rows exchanged in table 2-8", "2.6", _exchanged_rows),
    ("number-of-functions", "Number of functions behind table 2-5", "2.6", _functions),
    ("tip-law", "The tip laws are not collocated and can be unstable", "3.4, 3.5", _tip_law),
    ("disturbance-torque", "Size of the disturbance torque", "3.3", _disturbance),
)  # fmt: skip


def erratum_entries() -> list[Entry]:
    """Return the errata in the order of the documentation."""
    return [
        Entry(f"erratum-{name}", title, section, build) for name, title, section, build in _ERRATA
    ]
