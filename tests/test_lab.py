"""The lab: a page that flies the engine in a browser, opened as a visitor would."""

from __future__ import annotations

import functools
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_baselines.policies.names import POLICIES
from drm_baselines.policies.pilots import pilot_named

ROOT = Path(__file__).parents[1]
SMALLEST_FACTOR = 20
"""Times real time that a flight has to be."""
LARGEST_PAGE = 3_000_000


@functools.cache
def has_target() -> bool:
    """Whether Rust has a standard library for WebAssembly here."""
    if shutil.which("rustc") is None:
        return False
    command = ["rustc", "--print", "target-libdir", "--target", "wasm32-unknown-unknown"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode == 0 and any(Path(done.stdout.strip()).glob("libstd-*.rlib"))


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not has_target(), reason="needs 'rustup target add wasm32-unknown-unknown'"),
]


@pytest.fixture(scope="module")
def lab() -> Path:
    """The page as ``make lab`` writes it."""
    page = ROOT / "site" / "lab" / "index.html"
    command = [sys.executable, "tools/lab.py", str(page)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return page


class Visitor:
    """Somebody with the page open, who hears what it complains of."""

    def __init__(self, browser: Any, page: Path, address: str = "t=0", **options: Any) -> None:
        self.complaints: list[str] = []
        self.asked: list[str] = []
        self.page = browser.new_context(**options).new_page()
        self.page.on("console", lambda said: self.complaints.append(said.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(f"{page.as_uri()}#{address}")
        self.wait()

    def wait(self, state: str = "flown") -> None:
        self.page.wait_for_selector(f"html[data-state={state}]", state="attached", timeout=120_000)

    def turn(self, name: str, value: float) -> None:
        """Moves a slider, and waits until what it asks for has been flown."""
        self.page.locator(f"#option-{name}").fill(str(value))
        self.wait()

    def flights(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = self.page.evaluate(
            "drmLab.flights.map((f) => ({policy: f.policy, milliseconds: f.milliseconds, "
            "metrics: f.metrics, signals: Object.fromEntries(Object.entries(f.signals)"
            ".map(([name, values]) => [name, Array.from(values)]))}))"
        )
        return found

    def leave(self) -> None:
        """Nothing was complained of, and nothing but the page was asked for."""
        assert not self.complaints
        assert [url for url in self.asked if not url.startswith(("file:", "data:", "blob:"))] == []
        self.page.context.close()


def check_flight(flight: dict[str, Any], scenario: dict[str, Any]) -> None:
    """A flight of the page has the bits of Python's: the engine fuses and rounds alike on both."""
    name = flight["policy"]
    if POLICIES[name].kind in ("open loop", "law"):
        expected = drm_env.simulate(scenario, law=name, decimation=5)
    else:
        expected = pilot_named(name).trajectory(scenario, decimation=5)
    for metric, value in expected.metrics.items():
        found = np.float64(flight["metrics"][metric])
        assert found.tobytes() == np.float64(value).tobytes() or (found != found and value != value)
    assert set(expected) <= set(flight["signals"])
    for signal, values in expected.items():
        found = np.array(flight["signals"][signal])
        assert found.tobytes() == values.tobytes(), signal


def test_the_page_is_one_small_file_without_addresses(lab: Path) -> None:
    text = lab.read_text(encoding="utf-8")
    assert len(text.encode()) < LARGEST_PAGE
    assert list(lab.parent.iterdir()) == [lab]
    outside = re.findall(r"""(?:src|href)=["'](?!data:|#)[^"']*""", text)
    assert outside == []
    assert str(ROOT) not in text and str(Path.home()) not in text


@pytest.mark.parametrize("engine", ["relaxed", "portable"])
def test_a_turned_slider_flies_the_bits_of_simulate(browser: Any, lab: Path, engine: str) -> None:
    visitor = Visitor(browser, lab, "t=0" if engine == "relaxed" else f"t=0&engine={engine}")
    found = visitor.page.locator("html").get_attribute("data-engine")
    if engine == "relaxed" and found == "portable":
        pytest.skip("this processor has no fused multiply-add for the fast module")
    assert found == engine
    visitor.turn("mass", 345)
    flights = visitor.flights()
    assert [flight["policy"] for flight in flights] == ["dagger", "linear"]
    scenario = visitor.page.evaluate("drmLab.scenario")
    assert scenario == {"payload": {"mass": 345}, "mass_error": 0.1}
    for flight in flights:
        check_flight(flight, scenario)
    visitor.leave()


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_every_policy_flies_on_both_plants(browser: Any, lab: Path, plant: str) -> None:
    address = f"t=0&plant={plant}&mass=120&error=-20&profile=min_energy&noise=0.1&delay=4"
    visitor = Visitor(browser, lab, address)
    scenario = visitor.page.evaluate("drmLab.scenario")
    assert scenario["plant" if plant == "consistent" else "mass_error"] in (plant, -0.2)
    for first, second in (("none", "lyapunov"), ("servo", "dagger"), ("lqr", "ppo")):
        visitor.page.select_option("#pilot-a", first)
        visitor.page.select_option("#pilot-b", second)
        visitor.wait()
        flights = visitor.flights()
        assert [flight["policy"] for flight in flights] == [first, second]
        for flight in flights:
            check_flight(flight, scenario)
    visitor.leave()


@pytest.mark.parametrize("plant", ["thesis", "consistent"])
def test_a_flight_is_far_faster_than_real_time(browser: Any, lab: Path, plant: str) -> None:
    """On one core: one policy flies, in one worker; the best of some: the machine may be busy."""
    visitor = Visitor(browser, lab, f"t=0&a=lyapunov&b=nobody&plant={plant}")
    factors = []
    for mass in (210, 220, 230, 240, 250):
        visitor.turn("mass", mass)
        (flight,) = visitor.flights()
        factors.append(1e3 * flight["metrics"]["duration"] / flight["milliseconds"])
        if factors[-1] >= SMALLEST_FACTOR:
            break
    assert max(factors) >= SMALLEST_FACTOR
    visitor.leave()


def test_scrubbing_and_playing_move_the_arm(browser: Any, lab: Path) -> None:
    visitor = Visitor(browser, lab, "t=0&a=linear&b=none", viewport={"width": 1280, "height": 800})
    page = visitor.page
    picture = page.locator("#arm").screenshot
    start = picture()
    page.locator("#time").fill("9")
    assert page.locator("#clock").inner_text() == "9.00 s"
    assert picture() != start
    # the card says what the flight was at this instant
    flight = visitor.flights()[0]
    error = 1e3 * flight["signals"]["tip_error"][900]
    reach = 7.0 + flight["signals"]["extension"][900]
    slew = flight["signals"]["slew_angle"][900] - flight["signals"]["reference_angle"][900]
    y = flight["signals"]["tip_deflection"][900]
    assert error == pytest.approx(1e3 * (reach * slew + y), abs=1e-9)
    assert page.locator(".card b").first.inner_text().replace("−", "-") == f"{error:.2f}"
    page.keyboard.press("ArrowRight")
    assert page.locator("#clock").inner_text() == "9.05 s"
    page.keyboard.press("Shift+ArrowLeft")
    assert page.locator("#clock").inner_text() == "8.05 s"
    page.keyboard.press("Home")
    page.locator("h1").click()
    page.keyboard.press("Space")
    page.wait_for_timeout(400)
    page.keyboard.press("Space")
    assert float(page.locator("#clock").inner_text().split()[0]) > 0.1
    # a chart's place is an instant
    chart = page.locator(".chart .plot").first
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    page.mouse.click(box["x"] + 0.6 * box["width"], box["y"] + 40)
    assert 9.0 < float(page.locator("#clock").inner_text().split()[0]) < 13.0
    visitor.leave()


def test_a_link_brings_the_same_flight_back(browser: Any, lab: Path) -> None:
    visitor = Visitor(browser, lab)
    visitor.turn("angle", 77)
    visitor.turn("smoothing", 0.1)
    visitor.page.select_option("#pilot-b", "nobody")
    visitor.wait()
    visitor.page.locator("#time").fill("3.5")
    visitor.page.wait_for_timeout(400)
    address = visitor.page.evaluate("location.hash")
    metrics = visitor.flights()[0]["metrics"]
    again = Visitor(browser, lab, address.lstrip("#"))
    assert again.page.locator("#clock").inner_text() == "3.50 s"
    assert [flight["metrics"] for flight in again.flights()] == [metrics]
    visitor.leave()
    again.leave()


def test_the_python_lines_make_the_same_flight(browser: Any, lab: Path) -> None:
    visitor = Visitor(
        browser, lab, "t=0&a=none&b=lqr&mass=410&mode=force_limited&accel=0.015&tip=5"
    )
    visitor.page.locator("#python").click()
    lines = visitor.page.locator("#code").inner_text()
    done = subprocess.run(
        [sys.executable, "-c", lines], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    printed = [line.split() for line in done.stdout.splitlines()]
    flights = visitor.flights()
    assert [name for name, *_ in printed] == ["open_loop", "lqr"]
    for (_, value, unit), flight in zip(printed, flights, strict=True):
        assert (float(value), unit) == (flight["metrics"]["tip_error_rms"], "m")
    visitor.leave()


def test_what_cannot_be_flown_is_said_in_the_engine_s_words(browser: Any, lab: Path) -> None:
    visitor = Visitor(browser, lab, "t=0")
    page = visitor.page
    for address, scenario in (
        ("mass=-5", {"payload": {"mass": -5}, "mass_error": 0.1}),
        ("smoothing=0.3", {"slew": {"smoothing": 0.3}, "mass_error": 0.1}),
        ("plant=wooden", {"plant": "wooden", "mass_error": 0.1}),
    ):
        with pytest.raises(drm_env.ConfigError) as refused:
            drm_env.simulate(scenario)
        page.evaluate(f"location.hash = 't=0&{address}'")
        # the answer to the address before may still stand there
        page.get_by_text(str(refused.value), exact=True).wait_for(timeout=60_000)
        assert page.locator("html").get_attribute("data-state") == "refused"
    page.locator("#reset").click()
    visitor.wait()
    assert page.locator("#refused").is_hidden()
    visitor.leave()


def test_an_address_that_is_typed_is_not_overwritten(browser: Any, lab: Path) -> None:
    visitor = Visitor(browser, lab, "t=0")
    page = visitor.page
    # an address is about to be written when another is typed, whose event comes late
    page.evaluate(
        """() => {
            location.hash = "t=0&mass=88";
            return new Promise((done) => addEventListener("hashchange", () => {
                history.replaceState(null, "", "#t=0&mass=77");
                setTimeout(() => {
                    dispatchEvent(new HashChangeEvent("hashchange"));
                    done();
                }, 500);
            }, { once: true }));
        }"""
    )
    page.wait_for_timeout(1000)
    visitor.wait()
    assert "mass=77" in page.evaluate("location.hash")
    visitor.leave()


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_a_phone_shows_everything_without_scrolling_sideways(
    browser: Any, lab: Path, scheme: str
) -> None:
    visitor = Visitor(
        browser, lab, viewport={"width": 360, "height": 740}, has_touch=True, color_scheme=scheme
    )
    page = visitor.page
    assert page.locator("html").get_attribute("data-theme") == scheme
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    # the arm stays in sight while somebody turns
    page.locator("#option-to").scroll_into_view_if_needed()
    box = page.locator("#arm").bounding_box()
    assert box["y"] >= 0 and box["y"] + box["height"] < 740
    page.locator("#play").tap()
    page.wait_for_timeout(300)
    assert page.locator("#clock").inner_text() != "0.00 s"
    visitor.leave()
