"""Reports in HTML: of one manoeuvre, and of a comparison over episodes."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import drm_env
from drm_baselines.evaluation.contestants import Arena, Contestant
from drm_baselines.evaluation.environments import complete_scenario, scenarios_of
from drm_baselines.evaluation.metrics import METRICS, Metric, describe
from drm_baselines.evaluation.records import Episodes, headline
from drm_baselines.evaluation.statistics import Estimate
from drm_baselines.evaluation.tables import number
from drm_baselines.pages.blocks import (
    Block,
    Cell,
    Data,
    Folded,
    Interval,
    Intervals,
    Page,
    Section,
    Table,
    Text,
)
from drm_baselines.pages.flights import Flight, Manoeuvre, flights_block
from drm_baselines.policies.names import dash_of, styles, title_of
from drm_baselines.support import provenance, storage

JUDGE = "tip_error_rms"
"""The metric by which episodes are chosen, and that is drawn first."""

Signals = Mapping[str, NDArray[np.float64]]


# --- what both kinds have -------------------------------------------------------------------------


def _leaves(node: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names and values of a configuration."""
    if isinstance(node, Mapping):
        for name, item in node.items():
            yield from _leaves(item, f"{path}.{name}" if path else str(name))
    else:
        yield path, node


def _written(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return json.dumps(storage.plain(value))


def settings_table(
    config: Mapping[str, Any], usual: Mapping[str, Any], *, changed: bool
) -> Table | None:
    """Return values of a configuration with unit and meaning.

    Parameters
    ----------
    config, usual
        A configuration and what it is held against, both as nested mappings with ``scenario`` at
        the top.
    changed
        Whether only what differs is shown; nothing: ``None``.
    """
    known = {entry["path"]: (name, entry) for name, entry in drm_env.option_names().items()}
    before = dict(_leaves(usual))
    rows = []
    for path, value in _leaves(config):
        differs = path not in before or before[path] != value
        if changed and not differs:
            continue
        name, entry = known.get(path, ("", {"unit": "", "description": ""}))
        unit = entry["unit"] if entry["unit"] not in ("", "-") else ""
        was = f"usually {_written(before[path])}" if differs and path in before else ""
        rows.append(
            [
                Cell(text=path, detail=name if name and name != path else ""),
                Cell(text=f"{_written(value)} {unit}".strip(), detail=was),
                Cell(text=str(entry["description"])),
            ]
        )
    if not rows:
        return None
    headings = [
        Cell(text="setting", detail="as an option"),
        Cell(text="value"),
        Cell(text="what it is"),
    ]
    return Table(headings=headings, rows=rows, left=3)


def _as_text(content: Any) -> str:
    return json.dumps(storage.plain(content), indent=2)


def _made(details: Mapping[str, Any]) -> Section:
    """How a report was made: who flew, versions and machine."""
    blocks: list[Block] = [
        Folded(title=label, text=_as_text(detail)) for label, detail in details.items()
    ]
    blocks.append(Folded(title="Versions and machine", text=_as_text(provenance.provenance())))
    return Section(name="made", title="Who flew, and with what", brief="Who flew", blocks=blocks)


def _meanings(names: Sequence[str]) -> Table:
    rows = [
        [
            Cell(text=describe(entry.name).label),
            Cell(text=entry.description, detail=entry.formula),
        ]
        for entry in drm_env.episode_metrics()
        if entry.name in names
    ]
    symbols = "; ".join(f"{symbol}: {what}" for symbol, what in drm_env.METRIC_SYMBOLS.items())
    return Table(
        headings=[Cell(text="metric"), Cell(text="what it is, and its formula")],
        rows=rows,
        left=2,
        note=f"In the formulas {symbols}.",
    )


def _named(metric: Metric) -> str:
    return f"{metric.label} ({metric.unit})" if metric.unit else metric.label


def flight_of(label: str, signals: Signals, style: Mapping[str, Any]) -> Flight:
    """Return a flight as a page draws it, in the look of its policy."""
    return Flight(
        label=label,
        colour=style["color"],
        dash=dash_of(style["linestyle"]),
        signals=signals,
        diverged=bool(getattr(signals, "metrics", {}).get("diverged", False)),
    )


def manoeuvre_of(
    title: str, scenario: Mapping[str, Any], flights: Mapping[str, Signals]
) -> Manoeuvre:
    """Return flights of one manoeuvre as a page draws them.

    Parameters
    ----------
    title
        What distinguishes the manoeuvre.
    scenario
        Any part of it.
    flights
        Signals by label or name of the policy, SI.
    """
    whole = complete_scenario(scenario)
    mass = float(whole["payload"]["mass"])
    reported = whole["reported_payload"]["mass"]
    if reported is None:
        reported = mass * (1.0 + float(whole["mass_error"]))
    drawn = zip(flights.items(), styles(list(flights)), strict=True)
    first = next(iter(flights.values()))
    return Manoeuvre(
        title=title,
        flights=[flight_of(title_of(name), signals, style) for (name, signals), style in drawn],
        links=(float(whole["arm"]["link1"]["length"]), float(whole["arm"]["link2"]["length"])),
        masses=(mass, float(reported)),
        target=float(whole["initial"]["slew_angle"]) + float(whole["slew"]["angle"]),
        slew_end=max(_slew_end(signals) for signals in flights.values()),
        limits=(
            float(whole["root_wheel"]["torque_limit"]),
            float(whole["tip_wheel"]["torque_limit"]),
        ),
        magnification=drm_env.Film(dict(scenario), first).magnification,
    )


def _slew_end(signals: Signals) -> float:
    """When the reference has come to rest, s."""
    moving = np.flatnonzero(np.abs(signals["reference_rate"]) > 1e-12)
    last = min(int(moving[-1]) + 1, signals["time"].size - 1) if moving.size else 0
    return float(signals["time"][last])


# --- one manoeuvre --------------------------------------------------------------------------------


def _flown(value: float, metric: Metric) -> str:
    if metric.name == "settling_time" and math.isnan(value):
        return "never"
    return number(value * metric.scale, metric.digits)


def metrics_of_flights(rows: Mapping[str, Mapping[str, float]]) -> Table:
    """Return a table with a row a metric and a column a flight; the best values are marked.

    ``rows`` are metrics by name or label of the policy.
    """
    looks = styles(list(rows))
    told = {entry.name: entry for entry in drm_env.episode_metrics()}
    lines = []
    for name, metric in METRICS.items():
        if not all(name in row for row in rows.values()):
            continue
        if name == "episode_return" and any(row[name] == 0.0 for row in rows.values()):
            continue  # a flight without a task pays nothing
        values = [float(row[name]) for row in rows.values()]
        sizes = [abs(value) if metric.magnitude else value for value in values]
        finite = [value for value in sizes if math.isfinite(value)]
        prefers = {"lower": min, "higher": max}.get(metric.better)
        best = prefers(finite) if prefers and len(set(sizes)) > 1 and finite else None
        lines.append(
            [
                Cell(text=_named(metric), detail=told[name].description),
                *(
                    Cell(text=_flown(value, metric), tone="best" if size == best else "")
                    for value, size in zip(values, sizes, strict=True)
                ),
            ]
        )
    heads = [
        Cell(text=title_of(label), colour=look["color"], dash=dash_of(look["linestyle"]))
        for label, look in zip(rows, looks, strict=True)
    ]
    return Table(
        headings=[Cell(text="metric"), *heads],
        rows=lines,
        note="★: the best. Settling time: never, where the arm does not settle to the end.",
    )


def payload_told(scenario: Mapping[str, Any]) -> str:
    """Return the mass of a payload, and the reported one where it differs."""
    whole = complete_scenario(scenario)
    mass, reported = float(whole["payload"]["mass"]), whole["reported_payload"]["mass"]
    if reported is None:
        reported = mass * (1.0 + float(whole["mass_error"]))
    told = f"{mass:.4g} kg"
    if not math.isclose(float(reported), mass):
        told += f", reported as {float(reported):.4g} kg"
    return told


def _manoeuvre_facts(scenario: Mapping[str, Any]) -> list[tuple[str, str]]:
    whole = complete_scenario(scenario)
    slew, deployment = whole["slew"], whole["deployment"]
    return [
        ("payload", payload_told(scenario)),
        ("slew", f"{math.degrees(float(slew['angle'])):.4g}°, {slew['profile']}"),
        (
            "link 2",
            f"from {float(deployment['start']):.3g} m to {float(deployment['end']):.3g} m",
        ),
        ("plant", str(whole["plant"])),
        ("time", f"{float(whole['horizon']):.4g} s"),
    ]


def simulation_page(
    scenario: Mapping[str, Any],
    flights: Mapping[str, drm_env.Trajectory],
    details: Mapping[str, Any],
) -> Page:
    """Return the report of one manoeuvre under one or more policies.

    Parameters
    ----------
    scenario
        Any part of a scenario.
    flights
        Who flew it, by name.
    details
        What identifies them, by name.
    """
    whole = {"scenario": complete_scenario(scenario)}
    usual = {"scenario": complete_scenario({})}
    differing = settings_table(whole, usual, changed=True)
    settings: list[Block] = [
        differing if differing is not None else Text(lines=["The thesis' standard manoeuvre."])
    ]
    every = settings_table(whole, usual, changed=False)
    settings += [
        Folded(title="All settings", table=every),
        Folded(
            title="As JSON, for drm simulate FILE and drm_env.simulate", text=_as_text(scenario)
        ),
    ]
    labels = ", ".join(title_of(name) for name in flights)
    return Page(
        title="Manoeuvre",
        subtitle=labels,
        facts=_manoeuvre_facts(scenario),
        sections=[
            Section(
                name="flights",
                title="The flight",
                blocks=[flights_block([manoeuvre_of("manoeuvre", scenario, flights)])],
            ),
            Section(
                name="metrics",
                title="Metrics",
                subtitle="Of the whole flight, each with its unit and what it is.",
                blocks=[
                    metrics_of_flights({name: flight.metrics for name, flight in flights.items()}),
                    Folded(title="Formulas", table=_meanings(list(METRICS))),
                ],
            ),
            Section(
                name="configuration",
                title="Configuration",
                subtitle="What differs from the standard manoeuvre; SI units and radians.",
                blocks=settings,
            ),
            _made({title_of(name): detail for name, detail in details.items()}),
        ],
    )


# --- a comparison ---------------------------------------------------------------------------------


def _estimate_cell(estimate: Estimate, metric: Metric, *, best: bool) -> Cell:
    shown = estimate.scaled(metric.scale)
    digits = metric.digits
    return Cell(
        text=number(shown.value, digits),
        detail=f"{number(shown.low, digits)} to {number(shown.high, digits)}",
        tone="best" if best else "",
        order=shown.value if math.isfinite(shown.value) else 1e300,
    )


def _policy_cell(label: str, style: Mapping[str, Any], detail: str = "") -> Cell:
    return Cell(text=label, colour=style["color"], dash=dash_of(style["linestyle"]), detail=detail)


def _best_of(flights: Sequence[Episodes], name: str) -> float:
    values = [flight.estimate(name).value for flight in flights]
    finite = [value for value in values if math.isfinite(value)]
    if not finite or describe(name).better == "none":
        return math.nan
    return max(finite) if describe(name).better == "higher" else min(finite)


def estimates_table(flights: Sequence[Episodes], names: Sequence[str]) -> Table:
    """Return a row a policy: interquartile means with their 95 % intervals below."""
    looks = styles([flight.label for flight in flights])
    best = {name: _best_of(flights, name) for name in names}
    rows = []
    for flight, look in zip(flights, looks, strict=True):
        estimates = {name: flight.estimate(name) for name in names}
        rows.append(
            [
                _policy_cell(
                    flight.label, look, f"decides every {flight.control_period * 1e3:g} ms"
                ),
                *(
                    _estimate_cell(
                        estimates[name],
                        describe(name),
                        best=len(flights) > 1 and estimates[name].value == best[name],
                    )
                    for name in names
                ),
            ]
        )
    return Table(
        headings=[
            Cell(text="policy"),
            *(Cell(text=describe(name).label, detail=describe(name).unit) for name in names),
        ],
        rows=rows,
        sortable=True,
        note=(
            f"Interquartile mean over {len(flights[0])} episodes, below it its 95 % bootstrap "
            "interval; settled: mean. An episode that never settles counts with the whole time "
            "after the slew, a diverged one as infinitely bad. ★: the best. A click on a heading "
            "sorts."
        ),
    )


def estimates_picture(flights: Sequence[Episodes], name: str = JUDGE) -> Intervals:
    """Return the estimates of one metric as points with intervals."""
    metric = describe(name)
    rows = []
    for flight, look in zip(flights, styles([one.label for one in flights]), strict=True):
        shown = flight.estimate(name).scaled(metric.scale)
        rows.append(
            Interval(
                label=flight.label,
                colour=look["color"],
                value=shown.value,
                low=shown.low,
                high=shown.high,
            )
        )
    return Intervals(axis=f"{_named(metric)}: interquartile mean, 95 % interval", rows=rows)


_COLUMNS = {
    "payload.mass": ("payload mass", "kg", 1.0),
    "mass_error": ("error of the reported mass", "%", 100.0),
    "slew.angle": ("slew angle", "deg", 180.0 / math.pi),
}


def _columns(flights: Sequence[Episodes]) -> list[dict[str, Any]]:
    """What episodes can be drawn over: their order, and what was drawn for them."""
    columns: list[dict[str, Any]] = [
        {"label": "share of the episodes, each policy's in order", "unit": "%", "values": None}
    ]
    context = flights[0].context
    for name, values in context.items():
        array = np.asarray(values, dtype=np.float64)
        if not np.isfinite(array).all() or np.all(array == array[0]):
            continue
        label, unit, scale = _COLUMNS.get(name, (name.replace("_", " "), "", 1.0))
        columns.append(
            {"label": label, "unit": unit, "values": [float(f"{v:.6g}") for v in array * scale]}
        )
    return columns


def episodes_block(flights: Sequence[Episodes]) -> Data:
    """Return every episode of every policy, for a chart of any metric."""
    names = [
        name
        for name in METRICS
        if name != "settled"
        and all(name in flight.metrics for flight in flights)
        and any(np.isfinite(flight.judged(name)).any() for flight in flights)
    ]
    metrics = []
    for name in names:
        metric = describe(name)
        values = [
            [
                float(f"{value:.5g}") if math.isfinite(value) else None
                for value in (flight.judged(name) * metric.scale).tolist()
            ]
            for flight in flights
        ]
        metrics.append({"label": metric.label, "unit": metric.unit, "values": values})
    looks = styles([flight.label for flight in flights])
    return Data(
        script="episodes",
        content={
            "metrics": metrics,
            "columns": _columns(flights),
            "seeds": [int(seed) for seed in flights[0].seeds],
            "policies": [
                {
                    "label": flight.label,
                    "colour": look["color"],
                    "dash": list(dash_of(look["linestyle"])),
                }
                for flight, look in zip(flights, looks, strict=True)
            ],
        },
        note="Every episode is drawn. Episodes that diverged have no value and are not drawn.",
    )


def chosen_episodes(flights: Sequence[Episodes], metric: str = JUDGE) -> dict[str, int]:
    """Return the episodes whose flights are shown: index by how they were chosen.

    Those in which the geometric mean of all policies is smallest, in the middle and largest; an
    episode that somebody diverged in counts as largest.
    """
    with np.errstate(divide="ignore"):
        logs = np.log([flight.judged(metric) for flight in flights])
    order = np.argsort(np.nan_to_num(logs.mean(axis=0), nan=np.inf), kind="stable")
    places = {"easiest": 0, "median": len(order) // 2, "hardest": len(order) - 1}
    found: dict[str, int] = {}
    for word, place in places.items():
        if int(order[place]) not in found.values():
            found[word] = int(order[place])
    return found


def comparison_page(
    contestants: Sequence[Contestant],
    flights: Sequence[Episodes],
    report: Mapping[str, Any],
    arena: Arena,
    *,
    told: Callable[[int, int], None] | None = None,
) -> Page:
    """Return the report of a comparison; the flights that it shows are flown for it.

    Parameters
    ----------
    contestants, flights
        Who flew, and their episodes, in one order.
    report
        What :func:`drm_baselines.evaluation.comparison.report_of` returned.
    arena
        Which episodes.
    told
        Called with (done, total) flights.
    """
    chosen = chosen_episodes(flights)
    manoeuvres = []
    for number_, (word, index) in enumerate(chosen.items()):
        scenario = scenarios_of(arena.env_id, arena.resolved, arena.seed + index, 1)[0]
        flown = {}
        for place, contestant in enumerate(contestants):
            flown[contestant.label] = contestant.trajectory(arena, index)
            if told is not None:
                told(number_ * len(contestants) + place + 1, len(chosen) * len(contestants))
        title = f"{word}: seed {arena.seed + index}, payload {payload_told(scenario)}"
        manoeuvres.append(manoeuvre_of(title, scenario, flown))
    names = headline(flights)
    every = [
        name
        for name in METRICS
        if name not in names and all(name in flight.metrics for flight in flights)
    ]
    config = report["environment"]["config"]
    usual = drm_env.resolve(arena.env_id).to_dict()
    drawn = settings_table(
        {"randomize": {k: v for k, v in config["randomize"].items() if v is not None}},
        {},
        changed=False,
    )
    differing = settings_table(config, usual, changed=True)
    settings: list[Block] = []
    if differing is None:
        settings.append(Text(lines=[f"Everything as {arena.env_id} has it."]))
    else:
        settings.append(differing)
    if drawn is not None:
        settings.append(Folded(title="What is drawn for each episode", table=drawn))
    settings += [
        Folded(title="All settings", table=settings_table(config, usual, changed=False)),
        Folded(title="As JSON, for config=", text=_as_text(config)),
    ]
    return Page(
        title="Comparison",
        subtitle=", ".join(flight.label for flight in flights),
        facts=[
            ("environment", arena.env_id),
            ("episodes", f"{arena.episodes}, the same for everybody"),
            ("seeds", f"{arena.seed} to {arena.seed + arena.episodes - 1}"),
            ("policies", str(len(flights))),
        ],
        sections=[
            Section(
                name="result",
                title="Result",
                blocks=[
                    estimates_picture(flights),
                    estimates_table(flights, names),
                    Folded(title="Other metrics", table=estimates_table(flights, every)),
                    Folded(title="What the metrics are", table=_meanings(list(METRICS))),
                ],
            ),
            Section(
                name="episodes",
                title="Episode by episode",
                brief="Episodes",
                blocks=[episodes_block(flights)],
            ),
            Section(
                name="flights",
                title="Flights",
                subtitle=(
                    "Of the episodes in which the geometric mean of the policies' tip error RMS is "
                    "smallest, in the middle and largest."
                ),
                blocks=[flights_block(manoeuvres)],
            ),
            *_paired(report, flights),
            Section(
                name="configuration",
                title="Configuration",
                subtitle=f"What differs from {arena.env_id} as it is made; SI units and radians.",
                blocks=settings,
            ),
            _made({flight.label: flight.details for flight in flights}),
        ],
    )


_TONES = {"better": "good", "worse": "bad"}


def _paired(report: Mapping[str, Any], flights: Sequence[Episodes]) -> list[Section]:
    """Differences of every policy to the reference, episode by episode."""
    candidates = report["paired"]["candidates"]
    if not candidates:
        return []
    labels = [flight.label for flight in flights]
    looks = dict(zip(labels, styles(labels), strict=True))
    names = list(dict.fromkeys(name for entries in candidates.values() for name in entries))
    rows = []
    for label, entries in candidates.items():
        cells = [_policy_cell(label, looks[label])]
        for name in names:
            if name not in entries:
                cells.append(Cell(text="-"))
                continue
            entry, metric = entries[name], describe(name)
            difference = Estimate(**entry["difference"]).scaled(metric.scale)
            chance = Estimate(**entry["probability_of_improvement"]).value
            low, high = (number(edge, metric.digits) for edge in (difference.low, difference.high))
            sign = "+" if difference.value > 0.0 else ""
            cells.append(
                Cell(
                    text=f"{sign}{number(difference.value, metric.digits)}",
                    detail=f"{low} to {high}\nbetter in {100.0 * chance:.0f} %",
                    tone=_TONES.get(str(entry["verdict"]), "plain"),
                )
            )
        rows.append(cells)
    reference = report["paired"]["reference"]
    return [
        Section(
            name="paired",
            title=f"Paired differences to {reference}",
            brief="Paired differences",
            subtitle=(
                f"Policy minus {reference} over the same episodes, below it the 95 % interval and "
                "in how many episodes the policy is better (ties count half). Green: better, red: "
                "worse, grey: undecided."
            ),
            blocks=[
                Table(
                    headings=[
                        Cell(text="policy"),
                        *(
                            Cell(text=describe(name).label, detail=describe(name).unit)
                            for name in names
                        ),
                    ],
                    rows=rows,
                )
            ],
        )
    ]
