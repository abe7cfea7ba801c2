"""Pages: everything is escaped, nothing is asked for, and no peak of a curve is lost."""

from __future__ import annotations

import json
import math
import re
from html.parser import HTMLParser
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drm_env
from drm_baselines.errors import ExistingResultError
from drm_baselines.evaluation import reports
from drm_baselines.pages import flights, writer
from drm_baselines.pages.blocks import (
    Cell,
    Choice,
    Data,
    Folded,
    Interval,
    Intervals,
    Page,
    Picture,
    Section,
    Table,
    Text,
    Verdicts,
)
from drm_baselines.support.palette import OKABE_ITO, on_dark

EVIL = """</script><img src=x onerror="alert('1')"><b>&amp;'"--><!--"""


class Reader(HTMLParser):
    """Tags, attributes and texts of a page; the content of its scripts by their type."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.texts: list[str] = []
        self.data: list[Any] = []
        self._in: str | None = None
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        self._in = dict(attrs).get("type") if tag == "script" else None

    def handle_endtag(self, _: str) -> None:
        self._in = None

    def handle_data(self, data: str) -> None:
        if self._in == "application/json":
            self.data.append(json.loads(data))
        self.texts.append(data)


def evil_page() -> Page:
    cell = Cell(text=EVIL, detail=EVIL, colour="#0072B2", dash=(3.0, 2.0))
    return Page(
        title=EVIL,
        subtitle=EVIL,
        facts=[(EVIL, EVIL)],
        choices=[Choice(tag="bad", label=EVIL, tone="bad", count=1)],
        sections=[
            Section(
                name="one",
                title=EVIL,
                subtitle=EVIL,
                brief=EVIL,
                group=EVIL,
                blocks=[
                    Text(lines=[EVIL]),
                    Text(lines=[EVIL], listed=True),
                    Table(headings=[cell], rows=[[cell], [EVIL]], note=EVIL, tags=["bad", "bad"]),
                    Verdicts(rows=[(EVIL, EVIL, "bad")]),
                    Picture(data=b"\x89PNG", title=EVIL),
                    Folded(title=EVIL, text=EVIL),
                    Intervals(
                        axis=EVIL,
                        rows=[
                            Interval(label=EVIL, colour="#000000", value=2.0, low=1.0, high=3.0),
                            Interval(
                                label=EVIL,
                                colour="#000000",
                                value=math.inf,
                                low=math.nan,
                                high=math.inf,
                            ),
                        ],
                    ),
                    Data(script="episodes", content={"label": EVIL}, note=EVIL),
                ],
            )
        ],
    )


def test_every_text_is_shown_as_it_is_and_can_do_nothing() -> None:
    text = writer.page_text(evil_page())
    read = Reader(text)
    # two pictures would be one too many
    assert read.tags.count("img") == 1 and "b" not in read.tags
    assert not [name for name, _ in read.attributes if name.startswith("on")]
    assert ("alt", EVIL) in read.attributes
    shown = "".join(read.texts)
    assert shown.count("""<img src=x onerror="alert('1')"><b>&amp;'\"""") >= 15
    assert {"label": EVIL} in read.data


def test_a_page_asks_for_nothing_and_forbids_the_browser_to_ask() -> None:
    read = Reader(writer.page_text(evil_page()))
    addresses = [value for name, value in read.attributes if name in ("src", "href")]
    assert addresses and all(value.startswith(("data:", "#")) for value in addresses)
    policies = [value for name, value in read.attributes if name == "content"]
    assert any(value.startswith("default-src 'none';") for value in policies)
    assert "connect-src" not in "".join(policies)


def test_the_library_of_charts_comes_with_its_licence_and_only_where_there_are_charts() -> None:
    licence = resources.files("drm_baselines.pages").joinpath("assets/uPlot-LICENSE.txt")
    notice = licence.read_text(encoding="utf-8")
    assert notice.startswith("The MIT License (MIT)") and "Leon Sorokin" in notice
    text = writer.page_text(evil_page())
    assert "var uPlot=" in text and "Copyright (c) 2022 Leon Sorokin" in text
    plain = writer.page_text(
        Page(title="", sections=[Section(name="a", title="", blocks=[Text(lines=["x"])])])
    )
    assert "uPlot" not in plain and len(plain) < 40_000


def test_a_page_is_not_replaced_unless_asked(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    writer.write_page(evil_page(), path)
    with pytest.raises(ExistingResultError):
        writer.write_page(evil_page(), path)
    writer.write_page(evil_page(), path, overwrite=True)


def test_numbers_that_are_none_become_null() -> None:
    found = json.loads(writer.embedded({"a": [1.0, math.nan, math.inf]}))
    assert found == {"a": [1.0, None, None]}


def test_colours_on_dark_can_be_seen_and_told_apart() -> None:
    """Contrast as WCAG 2 defines it, computed here from its own formula."""

    def luminance(colour: str) -> float:
        parts = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))

    style = resources.files("drm_baselines.pages").joinpath("assets/page.css")
    dark = style.read_text(encoding="utf-8").split('data-theme="dark"')[1]
    card = re.search(r"--card: (#\w{6})", dark)
    assert card is not None
    found = [on_dark(colour) for colour in OKABE_ITO.values()]
    for colour in found:
        assert (luminance(colour) + 0.05) / (luminance(card[1]) + 0.05) > 4.9
    assert len(set(found)) == len(found)


# --- what is drawn of flights ---------------------------------------------------------------------


def test_the_tip_error_is_what_the_engine_judges() -> None:
    """Its RMS over the samples after the first is the engine's own metric."""
    flight = drm_env.simulate({"mass_error": 0.15}, law="linear")
    found = flights.tip_error(flight, 7.0)
    rms = math.sqrt(float(np.mean(found[1:] ** 2)))
    assert rms == pytest.approx(flight.metrics["tip_error_rms"], rel=1e-9)


def test_of_many_samples_the_smallest_and_largest_of_each_interval_are_kept() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(10_001) * 0.002
    values = rng.normal(size=time.size).cumsum()
    found = flights.on_grid(time, values, 20.0, 250)
    assert found.shape == (501,)
    for place in range(250):
        inside = values[(time >= place * 0.08 - 1e-9) & (time < (place + 1) * 0.08 - 1e-9)]
        pair = sorted(found[2 * place : 2 * place + 2])
        assert pair == [inside.min(), inside.max()]
    assert found[-1] == values[-1]


def test_of_few_samples_none_is_moved_and_what_is_between_lies_on_the_line() -> None:
    time = np.arange(101) * 0.2
    values = np.sin(time)
    found = flights.on_grid(time, values, 20.0, 100)
    np.testing.assert_allclose(found[::2], values, atol=1e-12)
    np.testing.assert_allclose(found[1::2], (values[1:] + values[:-1]) / 2.0, atol=1e-12)


def test_after_its_last_sample_a_flight_is_not_drawn() -> None:
    time = np.arange(51) * 0.1
    found = flights.on_grid(time, np.ones(51), 20.0, 200)
    grid = np.linspace(0.0, 20.0, 401)
    np.testing.assert_array_equal(np.isnan(found), grid > 5.0 + 1e-6)


def test_a_page_of_many_flights_stays_small() -> None:
    flight = drm_env.simulate(law="lyapunov")
    names = [f"policy {number}" for number in range(14)]
    manoeuvres = [
        reports.manoeuvre_of(f"episode {number}", {}, dict.fromkeys(names, flight))
        for number in range(3)
    ]
    block = flights.flights_block(manoeuvres)
    assert len(writer.embedded(block.content)) < 3_500_000
    assert "no peak is lost" in block.note
    few = flights.flights_block([reports.manoeuvre_of("", {}, {"lyapunov": flight})])
    assert few.content["manoeuvres"][0]["intervals"] == flights.MOST_INTERVALS


def test_no_flights_are_refused() -> None:
    with pytest.raises(ValueError, match="a flight in every manoeuvre"):
        flights.flights_block([])


def test_the_mass_that_is_drawn_is_the_reported_one() -> None:
    flight = drm_env.simulate({"mass_error": 0.5, "horizon": 2.0})
    drawn = reports.manoeuvre_of("", {"mass_error": 0.5}, {"none": flight})
    assert drawn.masses == (200.0, 300.0)
    told = reports.manoeuvre_of("", {"reported_payload": {"mass": 210.0}}, {"none": flight})
    assert told.masses == (200.0, 210.0)


# --- reports --------------------------------------------------------------------------------------


def test_the_metrics_of_a_report_are_those_of_the_flight() -> None:
    scenario = {"mass_error": 0.1}
    flown = {law: drm_env.simulate(scenario, law=law, decimation=20) for law in ("none", "linear")}
    page = reports.simulation_page(scenario, flown, {law: {} for law in flown})
    sections = {section.name: section for section in page.sections}
    table = sections["metrics"].blocks[0]
    assert isinstance(table, Table)
    row = next(row for row in table.rows if getattr(row[0], "text", "") == "tip error RMS (mm)")
    texts = [cell.text for cell in row if isinstance(cell, Cell)]
    assert texts[1:] == [f"{1e3 * f.metrics['tip_error_rms']:.2f}" for f in flown.values()]
    tones = [cell.tone for cell in row if isinstance(cell, Cell)]
    assert tones == ["", "", "best"]
    settings = sections["configuration"].blocks[0]
    assert isinstance(settings, Table)
    (changed,) = settings.rows
    assert isinstance(changed[0], Cell) and changed[0].text == "scenario.mass_error"
    assert isinstance(changed[1], Cell) and changed[1].text == "0.1"


def test_episodes_are_chosen_by_the_geometric_mean() -> None:
    class Fixed:
        def __init__(self, values: list[float]) -> None:
            self.values = np.array(values)

        def judged(self, name: str) -> Any:
            assert name == "tip_error_rms"
            return self.values

    everybody: Any = [Fixed([4.0, 1.0, 9.0, 3.0, 2.0]), Fixed([1.0, 1.0, 9.0, 3.0, math.inf])]
    assert reports.chosen_episodes(everybody) == {"easiest": 1, "median": 3, "hardest": 4}
    assert reports.chosen_episodes(everybody[:1]) == {"easiest": 1, "median": 3, "hardest": 2}
    alone: Any = [Fixed([1.0])]
    assert reports.chosen_episodes(alone) == {"easiest": 0}
