"""The suites: lists of manoeuvres that every policy flies, frozen as data.

A suite is drawn once, stratum by stratum, from distributions of the environment and written to
a CSV file in ``data/``; flights read the file, so that no change of the engine's random numbers
moves a suite. :func:`generate` makes the file's rows again, and a test compares the two. The
seeds of the suites are their own (:data:`drm_baselines.support.seeds.RANGES`).
"""

from __future__ import annotations

import copy
import csv
import hashlib
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import drm_env
from drm_baselines.errors import BaselineError
from drm_baselines.support import storage
from drm_baselines.support.seeds import SUITE_SEED
from drm_env.constants import TABLE_2_7

HORIZON = 30.0
"""Duration of every manoeuvre, s: the longest slew (90 deg in minimum energy) takes 21.7 s."""

_DEGREE = math.pi / 180.0
_SHORT, _LONG = {"uniform": [1.0, 3.0]}, {"uniform": [6.0, 8.0]}

STRATA = tuple(
    (f"{direction}, {profile}", direction, profile)
    for direction in ("extending", "retracting")
    for profile in ("min_time", "min_energy")
)
"""Strata of the random suites: name, direction of the deployment, slew profile."""

# Flat parameters that may differ between the episodes of a suite, as columns of its file.
_COLUMNS = {
    "payload_mass": ("payload", "mass"),
    "payload_length": ("payload", "length"),
    "payload_width": ("payload", "width"),
    "mass_error": ("mass_error",),
    "reported_payload_length": ("reported_payload", "length"),
    "reported_payload_width": ("reported_payload", "width"),
    "slew_angle": ("slew", "angle"),
    "slew_profile": ("slew", "profile"),
    "slew_smoothing": ("slew", "smoothing"),
    "deployment_start": ("deployment", "start"),
    "deployment_end": ("deployment", "end"),
    "deployment_mode": ("deployment", "mode"),
    "initial_alpha": ("initial", "alpha"),
    "initial_beta": ("initial", "beta"),
}  # fmt: skip


# Those that only suites of the flexible arm draw.
_FLEXIBLE_COLUMNS = {
    "payload_offset": ("payload", "offset"),
    "link1_bending_stiffness": ("arm", "link1", "bending_stiffness"),
    "link2_bending_stiffness": ("arm", "link2", "bending_stiffness"),
    "damping_ratio": ("dynamics", "damping_ratio"),
}


@dataclass(frozen=True, kw_only=True)
class Suite:
    """Manoeuvres that belong together.

    Attributes
    ----------
    name, title
        For commands and for tables.
    base
        The part of every scenario that is the same: plant, horizon, sensors, wheels.
    payload_mass
        Range of the true mass, kg; none for a suite that lists its manoeuvres.
    initial
        Largest initial deflection alpha and beta, m; 0 starts at rest.
    drawn
        What else is drawn for each episode, by the flat names of the scenario's parameters.
    episodes
        Manoeuvres of all strata together.
    """

    name: str
    title: str
    base: Mapping[str, Any]
    payload_mass: tuple[float, float] | None = None
    initial: float = 0.0
    drawn: Mapping[str, Any] = field(default_factory=dict)
    episodes: int = 1000

    @property
    def columns(self) -> dict[str, tuple[str, ...]]:
        """Columns of the suite's file, and where in a scenario they belong."""
        drawn = {name: path for name, path in _FLEXIBLE_COLUMNS.items() if name in self.drawn}
        return {**_COLUMNS, **drawn}

    def stratum_config(self, stratum: int) -> dict[str, Any]:
        """Return the environment configuration that one stratum of the suite is drawn from.

        Raises
        ------
        BaselineError
            The suite lists its manoeuvres.
        """
        if self.payload_mass is None:
            raise BaselineError(f"the suite {self.name!r} lists its manoeuvres, it draws none")
        _, direction, profile = STRATA[stratum]
        start, end = (_SHORT, _LONG) if direction == "extending" else (_LONG, _SHORT)
        randomize: dict[str, Any] = {
            "payload_mass": {"uniform": list(self.payload_mass)},
            "mass_error": {"uniform": [-0.15, 0.15]},
            "slew_angle": {"uniform": [20.0 * _DEGREE, 90.0 * _DEGREE]},
            "deployment_start": start,
            "deployment_end": end,
        }
        if self.initial > 0.0:
            for name in ("initial_alpha", "initial_beta"):
                randomize[name] = {"uniform": [-self.initial, self.initial]}
        randomize.update(copy.deepcopy(dict(self.drawn)))
        scenario = copy.deepcopy(dict(self.base))
        scenario["slew"] = {**scenario.get("slew", {}), "profile": profile}
        return {"scenario": scenario, "randomize": randomize}


_ROUGH = {
    # About what good encoders, gyroscopes and strain gauges give; the wheels follow with a lag of
    # 5 ms, the measurements come one sample late.
    "sensors": {
        "angle_noise": 1.0e-5,
        "rate_noise": 1.0e-4,
        "deflection_noise": 1.0e-4,
        "deflection_rate_noise": 1.0e-3,
        "delay": 0.002,
    },
    "root_wheel": {"lag": 0.005},
    "tip_wheel": {"lag": 0.005},
}


def _flexible() -> dict[str, Any]:
    """Hardware and draws of ``drm_env/SlewFlexible-v0``, which its suite takes as they are."""
    data = drm_env.resolve("slew_flexible").to_dict()
    scenario = data["scenario"]
    kept = ("arm", "plant", "modes", "dynamics", "root_wheel", "tip_wheel", "sensors")
    return {
        "base": {"horizon": HORIZON, **{name: scenario[name] for name in kept}},
        "drawn": {name: data["randomize"][name] for name in _FLEXIBLE_COLUMNS},
    }


SUITES: dict[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite(
            name="thesis",
            title="the manoeuvres of chapter 4",
            base={"horizon": HORIZON},
            episodes=108,
        ),
        Suite(
            name="robust",
            title="50 to 500 kg, reported mass wrong by up to 15 %",
            base={"horizon": HORIZON},
            payload_mass=(50.0, 500.0),
        ),
        Suite(
            name="heavy",
            title="500 to 3,000 kg, beyond what anybody was trained on",
            base={"horizon": HORIZON},
            payload_mass=(500.0, 3000.0),
        ),
        Suite(
            name="unmodelled",
            title="robust on the consistent plant with four modes a link",
            base={"horizon": HORIZON, "plant": "consistent", "modes": [4, 4]},
            payload_mass=(50.0, 500.0),
        ),
        Suite(
            name="rough",
            title="robust with noise, delay, lag and initial vibration",
            base={"horizon": HORIZON, **_ROUGH},
            payload_mass=(50.0, 500.0),
            initial=1.0e-3,
        ),
        Suite(
            name="flexible",
            title="a damped flexible arm: lagging wheels, real sensors, payloads off the axis",
            payload_mass=(50.0, 500.0),
            **_flexible(),
        ),
    )
}

# The suites that ask the same manoeuvres of another arm fly the draws of this one.
_DRAWN_AS = {"unmodelled": "robust"}


def suite_named(name: str) -> Suite:
    """Return a suite by its name.

    Raises
    ------
    BaselineError
        No such suite; the message lists them.
    """
    if name not in SUITES:
        raise BaselineError(f"no suite {name!r}; there are {', '.join(SUITES)}")
    return SUITES[name]


def _thesis_rows() -> list[dict[str, Any]]:
    """Payloads 0, 1 and 3; out, in and fixed; four profiles; mass exact, +15 % and -15 %.

    As in the thesis, length and width are known whatever mass is reported.
    """
    rows = []
    for mass, length, width in (TABLE_2_7[number] for number in (1, 2, 4)):
        for direction, start, end in (("out", 1.0, 8.0), ("in", 8.0, 1.0), ("fixed", 4.0, 4.0)):
            for profile in ("min_time", "min_energy"):
                for smoothing in (0.0, 0.05):
                    for error in (0.0, 0.15, -0.15):
                        rows.append(
                            {
                                "stratum": f"{direction}, {profile}",
                                "payload_mass": mass,
                                "payload_length": length,
                                "payload_width": width,
                                "mass_error": error,
                                "reported_payload_length": "",
                                "reported_payload_width": "",
                                "slew_angle": 50.0 * _DEGREE,
                                "slew_profile": profile,
                                "slew_smoothing": smoothing,
                                "deployment_start": start,
                                "deployment_end": end,
                                "deployment_mode": "none" if direction == "fixed" else "coincident",
                                "initial_alpha": 0.0,
                                "initial_beta": 0.0,
                            }
                        )
    return rows


def generate(name: str) -> list[dict[str, Any]]:
    """Draw the rows of a suite's file from its distributions.

    Raises
    ------
    BaselineError
        No such suite.
    """
    suite = suite_named(_DRAWN_AS.get(name, name))
    suite_named(name)
    if suite.payload_mass is None:
        return _thesis_rows()
    each = suite.episodes // len(STRATA)
    first = SUITE_SEED + 1_000_000 * list(SUITES).index(suite.name)
    rows = []
    for stratum, (title, _, _) in enumerate(STRATA):
        scenarios = drm_env.sample_scenarios(
            config=suite.stratum_config(stratum), seed=first + stratum * each, n=each
        )
        for scenario in scenarios:
            row: dict[str, Any] = {"stratum": title}
            for column, path in suite.columns.items():
                value: Any = scenario
                for part in path:
                    value = value[part]
                # what follows from the mass is left to the engine
                row[column] = "" if value is None else value
            rows.append(row)
    return rows


def text_of(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a suite's rows as the text of its file; numbers are written to the last bit."""
    stream = io.StringIO()
    names = ["episode", *rows[0]]
    writer = csv.DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    for index, row in enumerate(rows):
        writer.writerow({"episode": index, **row})
    return stream.getvalue()


def write(name: str, directory: Path, *, overwrite: bool = False) -> Path:
    """Write a suite's file, drawn anew, into ``directory``."""
    text = text_of(generate(name))
    return storage.write_text(directory / f"{name}.csv", text, overwrite=overwrite)


@dataclass(frozen=True, kw_only=True)
class Manoeuvres:
    """The frozen manoeuvres of a suite.

    ``scenarios`` are complete enough for ``drm_env.rollout``; ``strata`` names the stratum of each;
    ``digest`` is the SHA-256 of the file that they come from.
    """

    suite: Suite
    scenarios: tuple[dict[str, Any], ...]
    strata: tuple[str, ...]
    digest: str

    def __len__(self) -> int:
        """Return the number of episodes."""
        return len(self.scenarios)


def _value(text: str) -> Any:
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        return text


@cache
def load(name: str) -> Manoeuvres:
    """Return the frozen manoeuvres of a suite.

    Raises
    ------
    BaselineError
        No such suite.

    Examples
    --------
    >>> from drm_baselines import suites
    >>> thesis = suites.load("thesis")
    >>> len(thesis), thesis.strata[0]
    (108, 'out, min_time')
    """
    suite = suite_named(name)
    file = resources.files(__package__) / "data" / f"{_DRAWN_AS.get(name, name)}.csv"
    text = file.read_text(encoding="utf-8")
    scenarios, strata = [], []
    for row in csv.DictReader(io.StringIO(text)):
        scenario: dict[str, Any] = copy.deepcopy(dict(suite.base))
        for column, path in suite.columns.items():
            node = scenario
            for part in path[:-1]:
                node = node.setdefault(part, {})
            node[path[-1]] = _value(row[column])
        scenarios.append(scenario)
        strata.append(row["stratum"])
    return Manoeuvres(
        suite=suite,
        scenarios=tuple(scenarios),
        strata=tuple(strata),
        digest=hashlib.sha256(text.encode()).hexdigest(),
    )
