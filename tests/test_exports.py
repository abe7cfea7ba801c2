"""Flights and linear models in the hands of other packages."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drm_env

SCENARIO = {"horizon": 0.4, "mass_error": 0.1}


def test_trajectories_become_frames() -> None:
    """A column a signal, a row a sample, the same numbers."""
    pandas = pytest.importorskip("pandas")
    flown = drm_env.simulate(SCENARIO, "linear", decimation=5)
    made = flown.to_frame()
    assert isinstance(made, pandas.DataFrame)
    assert list(made.columns) == list(flown)
    assert made.index.name == "sample"
    np.testing.assert_array_equal(made.to_numpy(), np.stack(list(flown.values()), axis=1))


def test_rollouts_become_frames() -> None:
    """A row a manoeuvre; and each manoeuvre's signals."""
    pytest.importorskip("pandas")
    flown = drm_env.rollout([SCENARIO, {"horizon": 0.2}], signals=["time", "alpha"])
    made = flown.to_frame()
    assert made.shape == (2, len(flown))
    assert made.loc[1, "duration"] == pytest.approx(0.2)
    assert flown.trajectory(1).to_frame()["time"].iloc[-1] == pytest.approx(0.2)


def test_files_for_matlab_hold_the_same_numbers(tmp_path: Path) -> None:
    """As SciPy reads them: columns and structures."""
    scipy_io = pytest.importorskip("scipy.io")
    flown = drm_env.simulate(SCENARIO, "linear", decimation=5)
    flown.to_mat(tmp_path / "flight.mat")
    read = scipy_io.loadmat(tmp_path / "flight.mat")
    for name, values in flown.items():
        np.testing.assert_array_equal(read[name], values[:, None])
    metrics = read["metrics"][0, 0]
    for name, value in flown.metrics.items():
        np.testing.assert_array_equal(metrics[name][0, 0], value)
    many = drm_env.rollout([SCENARIO, SCENARIO], signals=["time"], decimation=10)
    many.to_mat(tmp_path / "rollout.mat")
    read = scipy_io.loadmat(tmp_path / "rollout.mat")
    np.testing.assert_array_equal(read["peak_deflection"][:, 0], many["peak_deflection"])
    np.testing.assert_array_equal(read["trajectories"][0, 0]["time"], many.trajectories["time"])


def test_linear_models_are_taken_by_scipy() -> None:
    """With one call: the transfer at a frequency is C (jw - A)^-1 B."""
    signal = pytest.importorskip("scipy.signal")
    lin = drm_env.Model(payload={"mass": 200.0}).linearize(4.0)
    system = signal.StateSpace(*lin.system)
    np.testing.assert_array_equal(system.A, lin.A)
    np.testing.assert_array_equal(system.D, np.zeros((len(lin.outputs), 3)))


def test_linear_models_are_taken_by_python_control() -> None:
    """With the names, none lost; by its own constructor as well."""
    control = pytest.importorskip("control")
    lin = drm_env.Model(payload={"mass": 200.0}, plant="consistent").linearize(4.0, rate=0.3)
    system = lin.to_statespace()
    assert tuple(system.state_labels) == lin.states
    assert tuple(system.input_labels) == lin.inputs
    assert tuple(system.output_labels) == lin.outputs
    np.testing.assert_array_equal(system.A, lin.A)
    other = control.ss(*lin.system)
    s = 3.0j
    expected = lin.C @ np.linalg.solve(s * np.eye(len(lin.A)) - lin.A, lin.B)
    for made in (system, other):
        np.testing.assert_allclose(made(s), expected, rtol=1e-6, atol=1e-9 * abs(expected).max())


@pytest.mark.parametrize(
    ("package", "call"),
    [
        ("pandas", lambda flown, _: flown.to_frame()),
        ("scipy", lambda flown, path: flown.to_mat(path)),
        ("control", lambda *_: drm_env.Model().linearize(4.0).to_statespace()),
    ],
)
def test_what_is_missing_is_named(
    package: str, call: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """And how it is installed."""
    flown = drm_env.simulate({"horizon": 0.1})
    for name in [name for name in sys.modules if name.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=f"needs {package}: pip install {package}"):
        call(flown, tmp_path / "x.mat")
