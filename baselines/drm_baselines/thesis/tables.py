"""The thesis' tables of natural frequencies, and of the data it starts from."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Callable

import numpy as np

import drm_env
from drm_baselines.thesis import arm, beams, characteristic
from drm_baselines.thesis.manoeuvres import Manoeuvre, slew_end
from drm_baselines.thesis.published import Group, Table, tables
from drm_baselines.thesis.results import Entry, Outcome, Row, ours_only
from drm_env.model import SpatialModes

_Value = Callable[[str, str], float]
"""Our value of (group, key)."""

_WORDS = arm.PAYLOAD_TITLES
_FUNCTIONS = {"B7": 7, "B8": 8, "B9": 9}

SHEAR_LINK1, SHEAR_LINK2, SHEAR_OVERLAP = 30.4e9, 50.4e9, 33.5e9
"""Shear moduli of the finite-element model of appendix E, Pa."""
EI_LINK1, EI_LINK2 = 2.135e6, 2.537e6
"""Bending stiffnesses that follow from its tubes, N m^2."""
_TUBE_LINK1, _TUBE_LINK2 = (0.20, 0.18, SHEAR_LINK1), (0.18, 0.16, SHEAR_LINK2)
"""Outer and inner diameter (m) and shear modulus (Pa) of its links."""


def label(key: str) -> str:
    """Return the key of a value in words: ``P1 a=2 f1`` is ``Payload 1, a = 2 m, f1``."""
    if " (" in key:
        return _WORDS.get(key[:2], key[:2]) + key[2:] if key[:2] in _WORDS else key
    words = []
    for word in re.split(r" (?=[anfwr]|B\d|offset)", key):
        if word in _WORDS:
            words.append(_WORDS[word])
        elif word.startswith("a="):
            words.append(re.sub(r"a=(\d)", r"a = \1 m", word))
        elif word in _FUNCTIONS:
            words.append(f"functions (B.{word[1]})")
        else:
            words.append(word)
    return ", ".join(words)


def number(key: str, name: str) -> int:
    """Return the whole number that follows ``name`` in a key, such as 2 after ``a=``."""
    found = re.search(rf"(?:^| ){name}(\d+)", key)
    if found is None:
        raise ValueError(f"no {name} in {key!r}")
    return int(found[1])


def _place(key: str) -> tuple[str, float, int]:
    """Payload, length (m) and index of the frequency of a key."""
    return key.split(" ")[0], float(number(key, "a=")), number(key, "f") - 1


@functools.cache
def exact(payload: str, a: float, count: int = 3) -> list[float]:
    """Return frequencies with a rigid link 1 by the thesis' characteristic equation, Hz."""
    return [float(value) for value in characteristic.frequencies(payload, a, count)]


@functools.cache
def correct(payload: str, a: float, count: int = 3) -> list[float]:
    """Return exact frequencies with a rigid link 1 and all payload terms, Hz."""
    found = arm.frequencies(payload, a, plant="exact_rigid_link1")
    return [float(value) for value in found[:count]]


@functools.cache
def assumed(payload: str, a: float, n: int, m: int, shapes: str, inertia: str) -> list[float]:
    """Return frequencies of the thesis' plant with n and m functions, Hz; n = 0: link 1 rigid."""
    found = arm.frequencies(payload, a, inertia, modes=(n, m), shapes=shapes)
    return [float(value) for value in found]


def _functions_of_table_2_5(payload: str, a: float) -> int:
    return {1.0: 7, 2.0: 7, 3.0: 7, 4.0: 8, 7.0: 7}.get(a, 3) if payload == "P1" else 3


def _table_2_4(_: str, key: str) -> float:
    payload, a, index = _place(key)
    return exact(payload, a)[index]


def _table_2_5(_: str, key: str) -> float:
    payload, a, index = _place(key)
    return assumed(payload, a, 0, _functions_of_table_2_5(payload, a), "b8", "slender")[index]


def _table_2_6(_: str, key: str) -> float:
    return 100.0 * (_table_2_5("", key) / _table_2_4("", key) - 1.0)


def _table_2_8(group: str, key: str) -> float:
    payload, a, index = _place(key)
    exchanged = tables()["table-2-8"].group(group).exchanged(key)
    if (group == "exact") != exchanged:
        return exact(payload, a)[index]
    return assumed(payload, a, 0, 2, "b8", "slender")[index]


def _table_2_9(_: str, key: str) -> float:
    payload, a, index = _place(key)
    return assumed(payload, a, 1, 1, "b8", "slender")[index]


def _table_2_10(group: str, key: str) -> float:
    n = number(key, "n=m=")
    a = float(number(key, "a="))
    return assumed("P1", a, n, n, group.lower(), "slender")[number(key, "f") - 1]


@functools.cache
def appendix_e(case: int) -> tuple[list[float], float]:
    """Return frequencies (Hz) and rigid inertia (kg m^2) of the recovered model of appendix E.

    Cases 1 and 2 carry Payload 0 at what the appendix calls 6 and 8 m, 3 and 4 Payload 1. Cases 5
    and 7 are 2 and 4 with the payload off centre (`appendix_e_off_centre`), in the plane alone.
    """
    if case in (5, 7):
        modes = appendix_e_off_centre(case)
        bending = [k for k, kind in enumerate(modes.kinds) if kind == "in-plane bending"]
        return [float(f) for f in modes.frequencies[bending[:4]]], math.nan
    link1, link2 = arm.LINK1.mass_per_length, arm.LINK2.mass_per_length
    if case in (1, 3):
        segments = [(3.0, link1, EI_LINK1), (4.0, 46.92, 4.039e6), (4.0, link2, EI_LINK2)]
    else:
        segments = [(7.0, link1, EI_LINK1), (8.0, link2, EI_LINK2)]
    mass, length, _ = arm.PAYLOADS["P0" if case <= 2 else "P1"]
    found, inertia = beams.stepped_beam(segments, (mass, mass * length**2 / 3.0, 0.5))
    return [float(value) for value in found[:4]], inertia


@functools.cache
def appendix_e_off_centre(case: int) -> SpatialModes:
    """Return the modes in three dimensions of the recovered model, cases 5 and 7 of appendix E.

    Payload 0 has its centre 0.2 m out of the plane. Payload 1 is turned, its long side out of the
    plane, and has its centre a fifth of its width off in the plane. Moments of inertia are formed
    as for the payloads on the axis: M l^2 / 3, M w^2 / 3 across and M w^2 / 6 along a side.
    """
    mass, length, width = arm.PAYLOADS["P0" if case == 5 else "P1"]
    if case == 5:
        centre = [0.5, 0.0, -0.2]
        inertia = [mass * width**2 / 6.0, mass * length**2 / 3.0, mass * length**2 / 3.0]
    else:
        centre = [0.5, -0.2 * width, 0.0]
        inertia = [mass * length**2 / 3.0, mass * width**2 / 6.0, mass * width**2 / 3.0]
    model = drm_env.Model(
        {"mass": mass, "length": length, "width": width},
        arm={
            "link1": dataclasses.replace(arm.LINK1, bending_stiffness=EI_LINK1),
            "link2": dataclasses.replace(arm.LINK2, bending_stiffness=EI_LINK2),
        },
        plant="spatial",
        grapple={"centre": centre, "inertia": [*inertia, 0.0, 0.0, 0.0]},
        torsional_stiffness=[
            beams.torsional_stiffness(*tube) for tube in (_TUBE_LINK1, _TUBE_LINK2)
        ],
    )
    return model.spatial_modes(8.0, 12)


def _table_2_11(group: str, key: str) -> float:
    case, index = number(key, "case "), number(key, "f") - 1
    value = appendix_e(case)[0][index]
    if group.startswith("finite elements"):
        return value
    payload, a = ("P0" if case <= 2 else "P1"), (6.0 if case in (1, 3) else 8.0)
    stated = assumed(payload, a, 1, 1, "b8", "slender")[index]
    return 100.0 * (stated - value) / stated


def _table_2_12(_: str, key: str) -> float:
    mass, length, width = arm.PAYLOADS["P1"]
    neutral = mass * width**2 / 6.0
    inertia = {
        "a=8 rotated and offset": mass * length**2 / 3.0,
        "a=8 offset": neutral + mass * 0.2**2,
    }
    link1, link2 = _TUBE_LINK1, _TUBE_LINK2
    if key == "a=6":
        parts = [(3.0, *link1), (4.0, 0.20, 0.16, SHEAR_OVERLAP), (4.0, *link2)]
    else:
        parts = [(7.0, *link1), (8.0, *link2)]
    return beams.shaft(parts, inertia.get(key, neutral))


def _cantilever(tip_mass: float) -> _Value:
    @functools.cache
    def all_of(group: str, n: int) -> list[float]:
        if group == "exact":
            return [float(w) for w in beams.cantilever_exact(n, tip_mass)]
        return [float(w) for w in beams.cantilever_ritz(group, n, tip_mass)]

    def value(group: str, key: str) -> float:
        count = 5 if group == "exact" else number(key, "n=")
        return all_of(group, count)[number(key, "w") - 1]

    return value


def _cantilever_errors(tip_mass: float) -> _Value:
    frequency = _cantilever(tip_mass)

    def value(_: str, key: str) -> float:
        correct = frequency("exact", f"w{number(key, 'w')}")
        return 100.0 * (frequency(key.split(" ")[0], key) / correct - 1.0)

    return value


def _data(_: str, key: str) -> float:
    """A default of the configuration."""
    scenario = drm_env.Scenario()
    links = {"link 1": scenario.arm.link1, "link 2": scenario.arm.link2}
    if key[:6] in links:
        link = links[key[:6]]
        if "EI" in key:
            return link.bending_stiffness
        return link.length * (link.mass_per_length if "mass" in key else 1.0)
    if "limit" in key:
        wheel = scenario.root_wheel if key.startswith("root") else scenario.tip_wheel
        return wheel.torque_limit
    payload = _payload_of_mass(arm.PAYLOADS[key[:2]][0])
    return payload[("mass", "length", "width").index(key.split(" ")[1])]


@functools.cache
def current_gains(motor: str) -> tuple[float, float, float]:
    """Return the root of the electrical power per slew torque, rate and acceleration.

    They are in sqrt(W)/(N m), sqrt(W) s/rad and sqrt(W) s^2/rad, from the power of a slew in
    minimum energy up to its middle, where all three are positive.
    """
    flight = Manoeuvre(profile="min_energy", motor=motor).flight()
    part = flight["time"] < 0.45 * slew_end(flight)
    names = ("slew_torque", "reference_rate", "reference_accel")
    parts = np.column_stack([flight[name][part] for name in names])
    gains = np.linalg.lstsq(parts, np.sqrt(flight["motor_power"][part]))[0]
    torque, rate, accel = (float(gain) for gain in gains)
    return torque, rate, accel


def _table_4_1(_: str, key: str) -> float:
    printed = tables()["table-4-1"].group("data").values
    inertia, resistance, ratio, constant, emf = (
        "motor inertia (kg m^2)", "armature resistance (ohm)", "gear ratio (1)",
        "torque constant (N m/A)", "back-EMF constant (V s/rad)",
    )  # fmt: skip
    torque, rate, accel = current_gains("printed")
    Ra, Ng, kt = printed[resistance], printed[ratio], printed[constant]
    return {
        # sqrt(P) = sqrt(Ra) i with i = (S/Ng + cv Ng θ' + Im Ng θ'')/kt and cv = 0.02 kb kt/Ra
        resistance: (torque * Ng * kt) ** 2,
        ratio: math.sqrt(Ra) / (torque * kt),
        constant: math.sqrt(Ra) / (torque * Ng),
        inertia: accel / torque / Ng**2,
        emf: rate / torque / Ng**2 * Ra / (0.02 * kt),
    }[key]


@functools.cache
def _payload_of_mass(mass: float) -> tuple[float, float, float]:
    """Mass, length and width that an environment gives a payload of that mass."""
    context = drm_env.resolve("drm_env/SlewThesis-v0", payload_mass=mass).context
    return mass, context["payload_length"], context["payload_width"]


_VALUES: dict[str, _Value] = {
    "table-2-2": _data,
    "table-2-3": _data,
    "table-2-4": _table_2_4,
    "table-2-5": _table_2_5,
    "table-2-6": _table_2_6,
    "table-2-7": _data,
    "table-2-8": _table_2_8,
    "table-2-9": _table_2_9,
    "table-2-10": _table_2_10,
    "table-2-11": _table_2_11,
    "table-2-12": _table_2_12,
    "table-3-1": _data,
    "table-4-1": _table_4_1,
    "table-B-1": _cantilever_errors(0.0),
    "table-B-2": _cantilever_errors(100.0),
    "table-B-3": _cantilever(0.0),
    "table-B-4": _cantilever(100.0),
}


def _rows(table: Table, group: Group, value: _Value) -> list[Row]:
    def words(key: str) -> str:
        several = len(table.groups) > 1 and not key.startswith(group.name)
        return (f"{group.name}: " if several else "") + label(key)

    return [
        group.row(key, table.unit, value(group.name, key), label=words(key)) for key in group.values
    ]


def _heavier_at_1_m() -> list[Row]:
    """How table 2-4 at a = 1 m is met with more mass than the payloads have."""
    published = tables()["table-2-4"].group("exact").values
    rows = []
    for more in (0.0, 0.08):
        worst = max(
            abs(value / float(published[f"{payload} a=1 f{index}"]) - 1.0)
            for payload in ("P1", "P2", "P3")
            for index, value in enumerate(
                characteristic.frequencies(payload, 1.0, 3, mass_factor=1.0 + more), start=1
            )
        )
        words = f"Payloads 1 to 3, a = 1 m, f1 to f3, {100.0 * more:g} % more mass, off by at most"
        rows.append(ours_only(words, "%", 100.0 * worst))
    return rows


_MORE: dict[str, Callable[[], list[Row]]] = {"table-2-4": _heavier_at_1_m}
"""Rows that are not the table's own."""


def _build(table: Table) -> Outcome:
    rows = [row for group in table.groups for row in _rows(table, group, _VALUES[table.name])]
    rows += _MORE.get(table.name, list)()
    recipes = [
        (f"{group.name}: " if len(table.groups) > 1 else "") + group.recipe
        for group in table.groups
    ]
    return Outcome(rows=tuple(rows), note="; ".join(recipes) + ".")


def table_entries() -> list[Entry]:
    """Return an entry for each published table."""
    return [
        Entry(table.name, table.title, table.section, functools.partial(_build, table))
        for table in tables().values()
    ]


def worst(rows: tuple[Row, ...]) -> float:
    """Return the largest difference in percent among rows with a published number."""
    found = [abs(row.difference_percent) for row in rows if row.difference_percent is not None]
    return max(found, default=math.nan)
