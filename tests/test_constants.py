"""What Python says of the engine is what the engine flies with, and stands nowhere else."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import drm_env
from drm_env import _engine, constants, distributions

ROOT = Path(__file__).parents[1]
SOURCES = [
    path
    for folder in ("python/drm_env", "baselines/drm_baselines")
    for path in sorted((ROOT / folder).rglob("*.py"))
    # the step written once more, to time the engine against, shares nothing with it; the others are
    # generated of the engine and compared in `make lint`
    if "reference" not in path.parts and path.name not in ("_config.py", "_options.py")
]


def test_fine_entries_are_compressed_by_their_scales() -> None:
    config = drm_env.resolve(payload_mass=200.0, deflection_noise=0.01, angle_noise=0.01)
    env = drm_env.DrmEnv(config=config)
    observation, _ = env.reset(seed=0)
    layout = config.observation_layout
    entries = {
        entry.name: float(value) * entry.scale
        for entry, value in zip(layout, observation, strict=True)
    }
    fine = {name.removesuffix("_fine") for name in entries if name.endswith("_fine")}
    assert fine == set(constants.FINE_SCALES)
    for name in ("slew_error", "link2_deflection"):
        assert abs(entries[name]) > 0.0
        expected = math.asinh(entries[name] / constants.FINE_SCALES[name])
        assert entries[f"{name}_fine"] == pytest.approx(expected, rel=1e-5)


def test_the_identified_error_is_zero_below_and_limited_above() -> None:
    layout = drm_env.observation_layout(observe_identified=True)
    place = [entry.name for entry in layout].index("identified_mass_error")

    def seen(rate: float, reported: float) -> float:
        env = drm_env.DrmEnv(
            observe_identified=True,
            payload_mass=200.0,
            reported_payload_mass=reported,
            initial_slew_rate=rate,
        )
        return float(env.reset(seed=0)[0][place]) * layout[place].scale

    slow = constants.SLOWEST_IDENTIFICATION
    assert seen(0.99 * slow, 200.0) == 0.0
    assert abs(seen(1.01 * slow, 200.0)) == pytest.approx(constants.LARGEST_IDENTIFIED_ERROR)


def test_the_end_of_a_link_is_deflected_by_its_shape() -> None:
    # the assumed shape of appendix B: y = 3 u^2 - u^3 of the link's coordinate
    assert constants.LINK_END_DEFLECTION == 3.0 * 1.0**2 - 1.0**3
    flown = drm_env.simulate({"horizon": 0.5})
    deflection = constants.LINK_END_DEFLECTION * flown["beta"]
    assert np.abs(deflection).max() > 0.0
    np.testing.assert_array_equal(flown["link2_tip_deflection"], deflection)
    tip = deflection + constants.LINK_END_DEFLECTION * flown["alpha"]
    np.testing.assert_allclose(flown["tip_deflection"], tip, rtol=1e-14, atol=1e-18)


def test_sizes_and_periods_are_those_of_what_flies() -> None:
    batch = drm_env.DrmVectorEnv(2)
    batch.reset(seed=0)
    assert batch.coordinates.shape == (2, constants.COORDINATES)
    assert drm_env.Scenario().sample_period == constants.LAW_PERIOD
    law = drm_env.ControlLaw("linear", task="slew_thesis")
    assert law.control_period == constants.LAW_PERIOD
    state = law.initial_state(1)
    measured = np.zeros((1, len(law.MEASUREMENTS)))
    assert law.torques(measured, state, [True])[1].shape == state.shape
    assert tuple(drm_env.simulate({"horizon": 0.1})) == constants.SIGNAL_NAMES


def test_the_scheduled_law_divides_by_its_scales() -> None:
    def torque(mass: float, extension: float, i: int, j: int) -> float:
        gain = np.zeros((3, 4))
        gain[i, j] = 1.0
        law = drm_env.ControlLaw({"name": "scheduled", "root": {"angle_gain": gain.tolist()}})
        told = dict.fromkeys(law.MEASUREMENTS, 0.0) | {
            "slew_error": 1.0,
            "payload_mass": mass,
            "extension": extension,
        }
        measured = [[told[name] for name in law.MEASUREMENTS]]
        return float(law.torques(measured, law.initial_state(1), [True])[0][0, 0])

    mass, extension = constants.SCHEDULED_MASS_SCALE, constants.SCHEDULED_EXTENSION_SCALE
    assert torque(mass, extension, 2, 3) == torque(mass, extension, 0, 0) == -1.0
    assert torque(mass / 2.0, extension, 1, 0) == -0.5
    assert torque(mass, extension / 2.0, 0, 1) == -0.5


def test_table_2_7_is_the_published_one_and_what_environments_take() -> None:
    # no payload, then Payloads 0 to 3 as the thesis prints them: kg, m, m
    published = (
        (0.0, 0.0, 0.0), (50.0, 0.1, 0.1), (200.0, 1.0, 0.5), (350.0, 1.5, 0.75), (500.0, 2.0, 1.0),
    )  # fmt: skip
    assert published == constants.TABLE_2_7
    for mass, length, width in constants.TABLE_2_7:
        context = drm_env.resolve("slew_thesis", payload_mass=mass).context
        assert (context["payload_length"], context["payload_width"]) == (length, width)


def test_names_are_those_that_the_engine_takes() -> None:
    for name in constants.LAW_NAMES:
        drm_env.simulate({"horizon": 0.1}, name)
    with pytest.raises(drm_env.ConfigError, match="one of " + ", ".join(constants.LAW_NAMES)):
        drm_env.simulate({"horizon": 0.1}, "none of them")
    for place, name in enumerate(constants.PAYLOAD_INERTIAS):
        assert drm_env.resolve(payload_inertia=name).context["payload_inertia"] == place
    assert set(distributions._FIELDS) == set(_engine.distribution_names())
    tasks = {
        spec.kwargs["task"] for name, spec in gym.registry.items() if name.startswith("drm_env/")
    }
    assert tasks == set(_engine.task_names())


# -- Copies ----------------------------------------------------------------------------------


def literals(path: Path) -> Iterator[tuple[int, Any]]:
    """Every value in a module that is written out in full, with its line."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, (ast.Tuple, ast.List, ast.Dict, ast.Set)):
            try:
                yield node.lineno, ast.literal_eval(node)
            except ValueError:
                continue


def copies(path: Path) -> list[str]:
    """What a module writes down of what the engine says."""
    rows = [list(row) for row in constants.TABLE_2_7 if any(row)]
    names = {
        frozenset(found): what
        for what, found in {
            "the laws": constants.LAW_NAMES,
            "the signals": constants.SIGNAL_NAMES,
            "the metrics": _engine.metric_names(),
            "the tasks": _engine.task_names(),
            "the parameters": _engine.context_names(),
        }.items()
    }
    found = []
    for line, value in literals(path):
        if isinstance(value, (tuple, list)) and value and list(value) in rows:
            found.append(f"{path.name}:{line} a row of Table 2-7")
        elif isinstance(value, dict) and value == constants.FINE_SCALES:
            found.append(f"{path.name}:{line} the scales of fine entries")
        elif all(isinstance(item, str) for item in value) and frozenset(value) in names:
            found.append(f"{path.name}:{line} the names of {names[frozenset(value)]}")
    text = path.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and isinstance(node.value, ast.Constant):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in targets:
                name = target.id.lstrip("_") if isinstance(target, ast.Name) else ""
                if name in constants.__all__:
                    found.append(f"{path.name}:{node.lineno} {name}")
    return found


def test_nothing_of_the_engine_is_written_down_again() -> None:
    assert [copy for path in SOURCES for copy in copies(path)] == []


def test_copies_are_found(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text(
        "P1 = (200.0, 1.0, 0.5)\n_LAW_PERIOD = 2e-3\nLAWS = ('none', 'linear', 'lyapunov', "
        "'scheduled', 'servo', 'collocated')\nFINE = {'slew_error': 1e-5, 'slew_error_rate': 1e-5, "
        "'link2_deflection': 1e-5, 'link2_deflection_rate': 1e-4}\n"
    )
    assert len(copies(module)) == 4
