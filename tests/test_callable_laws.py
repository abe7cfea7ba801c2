"""Laws written in Python: the engine asks them, and everything else is as ever."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import drm_env
from drm_env.constants import LOAD_NAMES

Array = NDArray[np.float64]
SCENARIOS: list[dict[str, Any]] = [
    {"horizon": 3.0, "mass_error": 0.15},
    {"horizon": 2.0, "payload": {"mass": 50.0}, "plant": "consistent"},
    {"horizon": 2.5, "sensors": {"rate_noise": 1e-4, "delay": 0.004}},
]


class Same:
    """The engine's law by `ControlLaw`, called from Python."""

    def __init__(self, law: Any, n: int, period: float = 0.002) -> None:
        self.law = drm_env.ControlLaw(law, control_period=period)
        self.state, self.start = self.law.initial_state(n), np.ones(n, bool)

    def __call__(self, measurements: Array) -> Array:
        torques, self.state = self.law.torques(measurements, self.state, self.start)
        self.start[:] = False
        return torques


@pytest.mark.parametrize("name", ["linear", "lyapunov"])
def test_the_engines_law_called_from_python_has_the_engines_bits(name: str) -> None:
    """Simulate and rollout, both plants, sensors included, with loads."""
    engine = drm_env.simulate(SCENARIOS[0], name, decimation=7, loads=True)
    python = drm_env.simulate(SCENARIOS[0], Same(name, 1), decimation=7, loads=True)
    assert list(engine) == list(python)
    for signal_name, values in engine.items():
        np.testing.assert_array_equal(python[signal_name], values)
    np.testing.assert_equal(python.metrics, engine.metrics)
    kept = ["time", "root_torque", "base_force_x"]
    many = drm_env.rollout(SCENARIOS, name, signals=kept, loads=True, seed=5)
    asked = drm_env.rollout(SCENARIOS, Same(name, 3), signals=kept, loads=True, seed=5)
    for metric, values in many.items():
        np.testing.assert_array_equal(asked[metric], values)
    for signal_name in kept:
        np.testing.assert_array_equal(
            asked.trajectories[signal_name], many.trajectories[signal_name]
        )


def test_a_law_is_asked_at_its_period() -> None:
    """And its torques are held between."""
    calls: list[Array] = []

    def law(measurements: Array) -> Array:
        calls.append(measurements.copy())
        return np.full((1, 2), 0.1 * len(calls))

    flown = drm_env.simulate({"horizon": 0.1}, law, law_period=0.01)
    assert len(calls) == 10
    held = np.repeat(0.1 * np.arange(1, 11), 5)
    np.testing.assert_allclose(flown["root_torque"][:-1], held)
    columns = drm_env.ControlLaw.MEASUREMENTS
    assert calls[0].shape == (1, len(columns))
    assert calls[0][0, columns.index("payload_mass")] == 200.0
    extension = [call[0, columns.index("extension")] for call in calls]
    np.testing.assert_array_equal(extension, flown["extension"][:-1:5])
    once = drm_env.rollout([{"horizon": 0.1}], law, law_period=0.05, signals=["time"])
    assert once["duration"][0] == pytest.approx(0.1) and len(calls) == 12


def test_rows_stay_as_manoeuvres_end() -> None:
    """Those that have ended, or diverged, keep their row."""
    seen: list[Array] = []

    def law(measurements: Array) -> Array:
        seen.append(measurements)
        return np.zeros((3, 2))

    scenarios: list[dict[str, Any]] = [
        {"horizon": 0.02},
        {"initial": {"beta": 3.0}},
        {"horizon": 0.04},
    ]
    flown = drm_env.rollout(scenarios, law)
    assert len(seen) == 20
    assert all(call.shape == seen[0].shape for call in seen)
    np.testing.assert_array_equal(seen[-1][0], seen[11][0])
    assert flown["diverged"].tolist() == [0.0, 1.0, 0.0]


def test_what_a_law_raises_comes_out() -> None:
    """As it is, at once, from simulate and rollout; the next flight is as ever."""

    class OwnError(Exception):
        pass

    calls = 0

    def law(measurements: Array) -> Array:
        nonlocal calls
        calls += 1
        if calls == 4:
            raise OwnError("no more")
        return np.zeros((len(measurements), 2))

    for fly in (lambda: drm_env.simulate({}, law), lambda: drm_env.rollout([{}, {}], law)):
        calls = 0
        with pytest.raises(OwnError, match="no more"):
            fly()
        assert calls == 4
    with pytest.raises(OwnError):
        drm_env.rollout([{"horizon": 0.1}], lambda _: np.zeros((1, 2)), progress=_raise(OwnError()))
    assert drm_env.simulate({"horizon": 0.1}).metrics["duration"] == pytest.approx(0.1)


def _raise(error: Exception) -> Any:
    def progress(*_: Any) -> None:
        raise error

    return progress


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (np.zeros((2, 1)), r"shape \(1, 2\), got \(2, 1\)"),
        (None, r"numbers|shape \(1, 2\)"),
        ("no", "numbers"),
        (np.array([[np.nan, 0.0]]), r"root torque of scenarios\[0\] must be finite"),
    ],
)
def test_impossible_torques_are_refused(returned: Any, message: str) -> None:
    """With what was wrong."""
    with pytest.raises(drm_env.ConfigError, match=message):
        drm_env.simulate({"horizon": 0.1}, lambda _: returned)


def test_what_does_not_go_together_is_refused() -> None:
    """A period without a callable, one that is no multiple, a callable beside a policy."""
    law = Same("linear", 1)
    with pytest.raises(drm_env.ConfigError, match="law_period belongs to a callable"):
        drm_env.simulate({}, "linear", law_period=0.01)
    with pytest.raises(drm_env.ConfigError, match=r"law_period must be a multiple.*0\.003"):
        drm_env.simulate({}, law, law_period=0.003)
    with pytest.raises(drm_env.ConfigError, match="law_period must be positive"):
        drm_env.rollout([{}], law, law_period=-0.01)
    with pytest.raises(drm_env.ConfigError, match="torques"):
        drm_env.rollout([{}], law, torques=np.zeros((1, 1, 2)))
    with pytest.raises(drm_env.ConfigError, match=r"scenarios\[0\]"):
        drm_env.rollout([{"horizon": -1.0}], law)


def test_a_law_may_use_the_engine_meanwhile() -> None:
    """Another flight within a call."""
    inner: list[float] = []

    def law(measurements: Array) -> Array:
        inner.append(drm_env.simulate({"horizon": 0.02}).metrics["duration"])
        return np.zeros((1, 2))

    drm_env.simulate({"horizon": 0.1}, law, law_period=0.05)
    assert inner == pytest.approx([0.02, 0.02])


@pytest.mark.skipif(os.name != "posix", reason="sends a signal to a process")
def test_ctrl_c_ends_the_flight() -> None:
    """With a KeyboardInterrupt, in a law that hardly does anything."""
    program = textwrap.dedent(
        """
        import numpy as np, drm_env
        law = lambda rows: np.zeros((len(rows), 2))
        try:
            print("flying", flush=True)
            drm_env.rollout([{"horizon": 1e5}] * 4, law)
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        """
    )
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "flying\n"
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert out == "interrupted\n"
    assert process.returncode == 0


def test_loads_are_kept_of_one_that_is_asked() -> None:
    """Peaks of the signals."""
    flown = drm_env.simulate({"horizon": 0.5}, Same("linear", 1), loads=True)
    for name in LOAD_NAMES:
        assert flown.metrics[f"{name}_peak"] == np.abs(flown[name]).max()
