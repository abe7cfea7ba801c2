"""Commands that write reports in HTML."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import drm_env
from drm_baselines.cli import app


def data_of(page: Path) -> list[Any]:
    """What the scripts of a page draw."""
    text = page.read_text(encoding="utf-8")
    found = re.findall(r'<script type="application/json">(.*?)</script>', text, re.S)
    return [json.loads(one) for one in found]


def test_simulate_writes_the_flights_that_it_flew(tmp_path: Path) -> None:
    page = tmp_path / "deep" / "slew.html"
    arguments = ["simulate", "--law", "linear", "--payload-mass", "345", "--mass-error", "0.1"]
    result = CliRunner().invoke(app, [*arguments, "--html", str(page)])
    assert result.exit_code == 0, result.output
    assert "slew.html" in result.output
    (content,) = data_of(page)
    (manoeuvre,) = content["manoeuvres"]
    assert [flight["label"] for flight in manoeuvre["flights"]] == ["linear law"]
    assert manoeuvre["masses"] == [345.0, pytest.approx(379.5)]
    flight = drm_env.simulate(
        {"payload": {"mass": 345.0}, "mass_error": 0.1}, law="linear", decimation=5
    )
    film = drm_env.Film({"payload": {"mass": 345.0}, "mass_error": 0.1}, flight)
    assert manoeuvre["magnification"] == film.magnification
    assert f"{1e3 * flight.metrics['tip_error_rms']:.2f}" in page.read_text(encoding="utf-8")


def test_a_report_that_is_there_is_kept_and_nothing_is_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "slew.html"
    page.write_text("mine", encoding="utf-8")

    def fly(*_: object, **__: object) -> None:
        raise AssertionError("flown before the refusal")

    monkeypatch.setattr(drm_env, "simulate", fly)
    monkeypatch.setattr(drm_env, "rollout", fly)
    for command in (["simulate", "--law", "none"], ["compare", "none", "linear"]):
        result = CliRunner().invoke(app, [*command, "--html", str(page)])
        assert result.exit_code == 2 and "slew.html" in result.output, result.output
    assert page.read_text(encoding="utf-8") == "mine"


def test_compare_writes_every_episode_and_three_flights(tmp_path: Path) -> None:
    page = tmp_path / "comparison.html"
    arguments = ["compare", "none", "linear", "--episodes", "5", "--seed", "7", "--json"]
    result = CliRunner().invoke(app, [*arguments, "--html", str(page)])
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    episodes, flights = data_of(page)
    assert episodes["seeds"] == [7, 8, 9, 10, 11]
    assert [policy["label"] for policy in episodes["policies"]] == ["open loop", "linear law"]
    (tip,) = [one for one in episodes["metrics"] if one["label"] == "tip error RMS"]
    assert [len(row) for row in tip["values"]] == [5, 5]
    titles = [manoeuvre["title"] for manoeuvre in flights["manoeuvres"]]
    assert [title.split(":")[0] for title in titles] == ["easiest", "median", "hardest"]
    # the episode whose geometric mean is largest is the hardest
    products = [a * b for a, b in zip(*tip["values"], strict=True)]
    assert f"seed {7 + products.index(max(products))}," in titles[2]
    assert report["episodes"] == 5
    assert page.stat().st_size < 1_500_000
