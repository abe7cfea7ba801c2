"""Reports as a reader has them: opened in Chromium, by mouse and finger, dark and light."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_baselines.benchmark.records import Record, SuiteResult
from drm_baselines.benchmark.report import page as benchmark_page
from drm_baselines.evaluation import comparison, reports
from drm_baselines.evaluation.contestants import Arena, contestant_of_law, fly_all
from drm_baselines.pages.flights import tip_error
from drm_baselines.pages.writer import write_page
from drm_baselines.thesis import writing
from drm_baselines.thesis.results import Entry, Outcome, Verdict, judged, ours_only

EVIL = "<img src=x onerror=\"document.title='taken'\">"
LAWS = ("none", "linear", "lyapunov")
SCENARIO = {"mass_error": 0.15}


class Reader:
    """Somebody with a page open, who hears what it complains of and what it asks for."""

    def __init__(self, browser: Any, path: Path, **options: Any) -> None:
        self.complaints: list[str] = []
        self.asked: list[str] = []
        self.page = browser.new_context(**options).new_page()
        self.page.on("console", lambda said: self.complaints.append(said.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(path.as_uri())

    def wait_until(self, expression: str, seconds: float = 10.0) -> None:
        """Ask from outside until it is true.

        Playwright's own wait evaluates the text inside the page, which the page's
        content security policy forbids.
        """
        end = time.monotonic() + seconds
        while not self.page.evaluate(expression):
            assert time.monotonic() < end, f"not true after {seconds} s: {expression}"
            self.page.wait_for_timeout(20)

    def leave(self) -> None:
        """Nothing was complained of, and nothing but the page was asked for."""
        assert self.complaints == []
        outside = [url for url in self.asked if not url.startswith(("file:", "data:"))]
        assert outside == []
        assert len([url for url in self.asked if url.startswith("file:")]) == 1
        self.page.context.close()


@pytest.fixture(scope="module")
def flights() -> Mapping[str, drm_env.Trajectory]:
    return {law: drm_env.simulate(SCENARIO, law=law, decimation=5) for law in LAWS}


@pytest.fixture(scope="module")
def pages(
    tmp_path_factory: pytest.TempPathFactory, flights: Mapping[str, drm_env.Trajectory]
) -> dict[str, Path]:
    """One page of each kind, of little."""
    folder = tmp_path_factory.mktemp("pages")
    simulation = reports.simulation_page(SCENARIO, flights, {law: {} for law in LAWS})
    arena = Arena(env_id="drm_env/Slew-v0", episodes=4)
    contestants = [contestant_of_law(law) for law in ("none", "linear")]
    flown = fly_all(contestants, arena)
    report = comparison.report_of(flown, arena)
    compared = reports.comparison_page(contestants, flown, report, arena)
    suite = SuiteResult(
        suite="robust", title="a suite", records=[record("linear", 2e-3), record("ppo", 1e-3)]
    )
    found = {
        "simulation": write_page(simulation, folder / "simulation.html"),
        "comparison": write_page(compared, folder / "comparison.html"),
        "benchmark": benchmark_page.write_page([suite], folder / "benchmark.html", {}),
        "reproduction": folder / "reproduction.html",
    }
    found["reproduction"].write_text(writing.page_text(entries(), {}), encoding="utf-8")
    return found


def record(policy: str, level: float) -> Record:
    metrics = {
        name: np.linspace(level, 3.0 * level, 6).reshape(1, 6)
        for name in ("tip_error_rms", "residual_rms", "settled", "settling_time")
    }
    return Record(
        policy=policy, title=policy, kind="learned" if policy == "ppo" else "law",
        knows="reported", control_period=0.02, seeds=[0], episodes=np.arange(6),
        strata=["a"] * 6, metrics=metrics,
    )  # fmt: skip


def entries() -> list[tuple[Entry, Outcome]]:
    rows = (
        judged("mode 1 (rad/s)", "rad/s", 2.0, 2.01, met=True),
        judged("mode 2 (rad/s)", "rad/s", 3.0, 4.0, met=False, reason="a misprint"),
        ours_only("mode 3 (rad/s)", "rad/s", 5.0),
    )
    good = (judged("peak (deg)", "deg", 56.21, 56.2, met=True),)

    def unbuilt() -> Outcome:
        raise NotImplementedError

    return [
        (Entry("table-2-9", "Frequencies", "2.3", unbuilt), Outcome(rows=rows)),
        (Entry("figure-4.1", "Slew", "4.1", unbuilt), Outcome(rows=good)),
    ]


KINDS = ("simulation", "comparison", "benchmark", "reproduction")


@pytest.mark.parametrize("scheme", ["dark", "light"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_phone_shows_every_page_without_scrolling_sideways(
    browser: Any, pages: dict[str, Path], kind: str, scheme: str
) -> None:
    reader = Reader(
        browser, pages[kind], viewport={"width": 360, "height": 740}, has_touch=True,
        color_scheme=scheme,
    )  # fmt: skip
    page = reader.page
    assert page.locator("html").get_attribute("data-theme") == scheme
    for details in page.locator("main details").all():
        details.evaluate("element => { element.open = true; }")
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    page.locator("#theme").click()
    assert page.locator("html").get_attribute("data-theme") != scheme
    reader.leave()


def test_the_slider_moves_the_arm_and_says_the_values_of_the_flight(
    browser: Any, pages: dict[str, Path], flights: Mapping[str, drm_env.Trajectory]
) -> None:
    reader = Reader(browser, pages["simulation"], viewport={"width": 1280, "height": 900})
    page = reader.page
    stage = page.locator(".stage")
    start = stage.screenshot()
    page.locator(".transport input").fill("9")
    assert page.locator(".transport output").inner_text() == "9.00 s"
    assert stage.screenshot() != start
    # side by side, each with its tip error at this instant
    captions = page.locator(".stage small").all_inner_texts()
    expected = [tip_error(flight, 7.0)[900] * 1e3 for flight in flights.values()]
    found = [float(text.split()[2].replace("−", "-")) for text in captions]
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=5e-3)
    page.wait_for_timeout(100)
    values = page.locator(".chart .now").first.locator("span").all_inner_texts()
    np.testing.assert_allclose(
        [float(text.replace("−", "-")) for text in values], expected, rtol=1e-3, atol=5e-3
    )
    reader.leave()


def test_playing_moves_time_and_keys_step(browser: Any, pages: dict[str, Path]) -> None:
    reader = Reader(browser, pages["simulation"])
    page, clock = reader.page, reader.page.locator(".transport output")
    page.locator("[data-act=play]").click()
    reader.wait_until("drm.flights[0].time > 0.05")
    page.locator("[data-act=play]").click()
    stopped = clock.inner_text()
    page.locator(".drawn").first.focus()
    page.keyboard.press("Home")
    page.keyboard.press("Shift+ArrowRight")
    assert clock.inner_text() == "1.00 s" and stopped != "0.00 s"
    reader.leave()


def test_a_series_can_be_switched_off_everywhere(browser: Any, pages: dict[str, Path]) -> None:
    reader = Reader(browser, pages["simulation"], viewport={"width": 1280, "height": 900})
    page = reader.page
    shown = (
        "drm.flights[0].charts.map(({chart}) => chart.series.slice(1)"
        ".filter((s) => s.label !== 'reference' && s.show).map((s) => s.label).sort())"
    )
    everybody = ["Lyapunov law", "linear law", "open loop"]
    assert page.evaluate(shown) == [everybody] * 10
    assert page.locator(".stage figure").count() == 3
    chart = page.locator("[data-signal=tip_error]")
    before = chart.screenshot()
    chip = page.locator("[data-policy='open loop']")
    chip.click()
    assert chip.get_attribute("aria-pressed") == "false"
    page.wait_for_timeout(100)
    assert page.evaluate(shown) == [everybody[:2]] * 10
    assert page.locator(".stage figure").count() == 2
    assert chart.screenshot() != before
    # the scale fits what is left
    largest = page.evaluate("drm.flights[0].charts[0].chart.scales.y.max")
    assert largest < 1000.0
    chip.click()
    page.wait_for_timeout(100)
    assert page.evaluate(shown) == [everybody] * 10
    reader.leave()


def test_zoom_and_cursor_are_one_for_all_charts(browser: Any, pages: dict[str, Path]) -> None:
    reader = Reader(browser, pages["simulation"], viewport={"width": 1280, "height": 900})
    page = reader.page
    ranges = (
        "drm.flights[0].charts.map(({chart}) => [chart.scales.x.min, chart.scales.x.max].join())"
    )
    whole = page.evaluate(ranges)
    assert set(whole) == {"0,20"}
    over = page.locator("[data-signal=tip_deflection] .u-over")
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    assert box is not None
    at = [box["x"] + share * box["width"] for share in (0.25, 0.5)]
    middle = box["y"] + box["height"] / 2
    page.mouse.move(at[0], middle)
    page.mouse.down()
    page.mouse.move(at[1], middle, steps=4)
    page.mouse.up()
    page.wait_for_timeout(200)
    (zoomed,) = set(page.evaluate(ranges))
    low, high = map(float, zoomed.split(","))
    assert low == pytest.approx(5.0, abs=0.2) and high == pytest.approx(10.0, abs=0.2)
    # the cursor of one is that of all
    page.mouse.move((at[0] + at[1]) / 2, middle)
    page.wait_for_timeout(100)
    indices = set(page.evaluate("drm.flights[0].charts.map(({chart}) => chart.cursor.idx)"))
    assert len(indices) == 1 and None not in indices
    # a click is an instant, and no zoom
    page.mouse.click(at[0], middle)
    assert page.evaluate("drm.flights[0].time") == pytest.approx(6.25, abs=0.2)
    assert set(page.evaluate(ranges)) == {zoomed}
    page.locator("[data-range=after]").click()
    page.wait_for_timeout(200)
    (after,) = set(page.evaluate(ranges))
    assert float(after.split(",")[0]) == pytest.approx(13.21, abs=0.01)
    page.locator("[data-range=whole]").click()
    page.wait_for_timeout(200)
    assert page.evaluate(ranges) == whole
    reader.leave()


def test_a_comparison_shows_its_episodes_over_what_was_drawn(
    browser: Any, pages: dict[str, Path]
) -> None:
    reader = Reader(browser, pages["comparison"], viewport={"width": 1280, "height": 900})
    page = reader.page
    names = page.locator("[data-act=episode] option").all_inner_texts()
    assert [name.split(":")[0] for name in names] == ["easiest", "median", "hardest"]
    before = page.evaluate("drm.flights[0].value('tip_error', 'open loop', 15)")
    page.locator("[data-act=episode]").select_option("2")
    assert page.evaluate("drm.flights[0].value('tip_error', 'open loop', 15)") != before
    over = page.locator("[data-act=over]")
    labels = over.locator("option").all_inner_texts()
    assert "payload mass (kg)" in labels
    over.select_option(label="payload mass (kg)")
    (masses,) = page.evaluate("drm.episodes.map(({chart}) => Array.from(chart.data[0]))")
    scenarios = drm_env.sample_scenarios(n=4)
    expected = sorted(scenario["payload"]["mass"] for scenario in scenarios)
    np.testing.assert_allclose(masses, expected, rtol=1e-5)
    page.locator("[data-script=episodes] .chip").first.click()
    assert page.evaluate("drm.episodes[0].chart.series.map((s) => s.show)") == [True, False, True]
    reader.leave()


def test_the_filter_shows_what_is_not_reproduced(browser: Any, pages: dict[str, Path]) -> None:
    reader = Reader(browser, pages["reproduction"], viewport={"width": 1280, "height": 900})
    page = reader.page

    def rows() -> list[str]:
        found = page.locator("tr[data-tag]:visible td:first-child").all_inner_texts()
        return [text.split("\n")[0] for text in found]

    everything = ["mode 1 (rad/s)", "mode 2 (rad/s)", "mode 3 (rad/s)", "peak (deg)"]
    assert rows() == everything
    assert page.locator("#index li:visible").count() == 3
    choice = page.locator("[data-choice=not-reproduced]")
    assert choice.inner_text().split() == ["not", "reproduced", "1"]
    choice.click()
    assert rows() == ["mode 2 (rad/s)"]
    assert page.locator("#index li:visible").all_inner_texts() == ["Frequencies"]
    assert page.locator("#found").inner_text() == "1 of 4 rows"
    choice.click()
    assert rows() == everything
    page.locator("#search").fill("MISPRINT")
    assert rows() == ["mode 2 (rad/s)"]
    page.locator("#search").fill("slew")
    assert rows() == ["peak (deg)"]
    reader.leave()


def test_a_click_on_a_heading_sorts(browser: Any, pages: dict[str, Path]) -> None:
    reader = Reader(browser, pages["benchmark"], viewport={"width": 1280, "height": 900})
    page = reader.page
    first = page.locator("table.sortable tbody td:first-child")
    head = page.locator("table.sortable th", has_text="tip error RMS").first
    head.click()
    assert first.all_inner_texts() == ["ppo", "linear"]
    head.click()
    assert first.all_inner_texts() == ["linear", "ppo"]
    reader.leave()


def test_the_name_of_a_policy_is_text_and_nothing_else(browser: Any, tmp_path: Path) -> None:
    flight = drm_env.simulate({"horizon": 2.0}, decimation=20)
    page = reports.simulation_page({"horizon": 2.0}, {EVIL: flight}, {EVIL: {EVIL: EVIL}})
    reader = Reader(browser, write_page(page, tmp_path / "page.html"))
    reader.page.wait_for_timeout(200)
    assert reader.page.title() == "Manoeuvre"
    assert reader.page.locator("img").count() == 0
    assert EVIL in reader.page.locator(".chip").inner_text()
    reader.leave()


def test_a_flight_that_diverged_is_held_and_says_so(browser: Any, tmp_path: Path) -> None:
    scenario = {"horizon": 4.0}
    flight = drm_env.simulate(scenario, decimation=5)
    cut = {name: values[: values.size // 2 + 1] for name, values in flight.items()}
    lost = drm_env.Trajectory(cut, {**flight.metrics, "diverged": 1.0})
    page = reports.simulation_page(scenario, {"linear": lost, "none": flight}, {})
    reader = Reader(browser, write_page(page, tmp_path / "page.html"))
    assert "diverged at 2.00 s" in reader.page.locator("[data-policy='linear law']").inner_text()
    reader.page.locator(".transport input").fill("3")
    assert "diverged at 2.00 s" in reader.page.locator(".stage").inner_text()
    reader.leave()


def test_the_verdicts_of_the_reproduction_have_tags() -> None:
    assert {writing._tag(verdict) for verdict in Verdict} == {
        "reproduced", "inferred", "not-reproduced", "no-published-value",
    }  # fmt: skip
