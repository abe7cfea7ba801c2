"""What Jupyter shows of trajectories, rollouts, configurations and environments."""

from __future__ import annotations

from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_env import _html
from drm_env.constants import SIGNAL_NAMES


class Shown(HTMLParser):
    """Checks that elements nest, and keeps tags and texts."""

    def __init__(self, value: Any) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.text = ""
        self.feed(value._repr_html_())
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, _: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, _: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.text += data + "\n"


def test_a_trajectory_shows_metrics_and_a_curve_of_every_signal() -> None:
    flight = drm_env.simulate(law="linear", decimation=10)
    shown = Shown(flight)
    assert "1001 samples, 20 s" in shown.text
    assert f"{flight.metrics['tip_error_rms']:.4g}" in shown.text
    for name in SIGNAL_NAMES:
        assert name in shown.text
    assert shown.tags.count("svg") == len(SIGNAL_NAMES) - 1
    assert f"{flight['tip_deflection'].max():.4g}" in shown.text


def test_every_signal_has_its_unit() -> None:
    expected = {
        "time": "s", "slew_angle": "rad", "slew_rate": "rad/s", "reference_angle": "rad",
        "reference_rate": "rad/s", "reference_accel": "rad/s²", "alpha": "m", "beta": "m",
        "alpha_rate": "m/s", "beta_rate": "m/s", "tip_deflection": "m",
        "link2_tip_deflection": "m", "extension": "m", "extension_rate": "m/s",
        "slew_torque": "N m", "root_torque": "N m", "tip_torque": "N m",
        "root_momentum": "N m s", "tip_momentum": "N m s", "motor_power": "W",
    }  # fmt: skip
    assert {name: _html.unit_of(name) for name in SIGNAL_NAMES} == expected
    assert _html.unit_of("something else") == ""


def test_names_are_escaped_and_numbers_may_be_none() -> None:
    evil = "<script>alert(1)</script>"
    flight = drm_env.Trajectory(
        {evil: np.array([np.nan, np.inf, 1.0]), "empty": np.array([])}, {evil: np.nan}
    )
    shown = Shown(flight)
    assert "script" not in shown.tags
    assert shown.text.count(evil) == 2 and "nan" in shown.text


@pytest.mark.parametrize("values", [[1e300, -1e300, 1e300], [2.0, 2.0], [1.0]])
def test_a_curve_of_any_numbers_can_be_drawn(values: list[float]) -> None:
    text = _html.curve(np.array(values))
    assert "nan" not in text and "inf" not in text


def test_a_curve_keeps_its_peaks() -> None:
    values = np.zeros(10_000)
    values[7_123] = 1.0
    heights = [float(pair.split(",")[1]) for pair in _html.curve(values).split('"')[7].split()]
    assert min(heights) == 2.0 and heights.count(2.0) == 1 and max(heights) == 22.0


def test_a_rollout_shows_the_distribution_of_its_metrics() -> None:
    scenarios = drm_env.sample_scenarios(n=5)
    flown = drm_env.rollout(scenarios, law="linear", signals=["time"], decimation=100)
    shown = Shown(flown)
    assert "5 manoeuvres; signals time" in shown.text
    for value in np.quantile(flown["tip_error_rms"], (0.0, 0.5, 1.0)):
        assert f"{value:.4g}" in shown.text


def test_a_configuration_and_environments_say_what_they_are() -> None:
    config = drm_env.resolve(payload_mass=(100.0, 200.0), horizon=10.0)
    shown = Shown(config)
    assert "1000 steps of 0.01 s" in shown.text
    assert "payload_mass.uniform" in shown.text and "payload.mass" in shown.text
    env = drm_env.DrmEnv(config=config)
    assert "DrmEnv" in Shown(env).text and "1000 steps of 0.01 s" in Shown(env).text
    vector = drm_env.DrmVectorEnv(num_envs=3, config=config)
    assert "sub-environments\n3\n" in Shown(vector).text
    vector.close()
    env.close()
    # a closed environment still shows what it was
    assert "1000 steps" in Shown(env).text
