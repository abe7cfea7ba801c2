"""Pictures: no global state of matplotlib is touched, and a policy looks the same everywhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import drm_env
from drm_baselines.benchmark import competitors as competing
from drm_baselines.benchmark.records import Record, SuiteResult
from drm_baselines.benchmark.report import plots as benchmark_plots
from drm_baselines.benchmark.report import tables
from drm_baselines.evaluation import plots
from drm_baselines.evaluation.records import Episodes
from drm_baselines.evaluation.statistics import Estimate
from drm_baselines.policies import gains, registry
from drm_baselines.policies.names import POLICIES, styles, title_of
from drm_baselines.support import figures
from drm_baselines.support.palette import OKABE_ITO


def test_no_module_of_the_package_switches_the_backend() -> None:
    """In a fresh process with a backend of its own, as a notebook has one."""
    code = (
        "import pkgutil, importlib, matplotlib\n"
        "matplotlib.use('svg')\n"
        "import drm_baselines\n"
        "skipped = ('torch', 'stable_baselines3', 'numba', 'psutil', 'optuna', 'clarabel',\n"
        "           'piqp')\n"
        "for found in pkgutil.walk_packages(drm_baselines.__path__, 'drm_baselines.'):\n"
        "    try:\n"
        "        importlib.import_module(found.name)\n"
        "    except ImportError as error:\n"
        "        assert error.name and error.name.split('.')[0] in skipped, error\n"
        "    assert matplotlib.get_backend() == 'svg', found.name\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env=dict(os.environ))


def test_no_module_of_the_package_uses_pyplot() -> None:
    """Pyplot keeps every figure until it is closed, and chooses a backend when it makes one."""
    root = Path(figures.__file__).parents[1]
    users = [
        path.name
        for path in root.rglob("*.py")
        if re.search(r"pyplot as|import pyplot|mpl\.use\(|matplotlib\.use\(", path.read_text())
    ]
    assert users == []


def test_drawing_leaves_backend_settings_and_open_figures_alone(tmp_path: Path) -> None:
    import matplotlib.pyplot as plt

    before, settings = mpl.get_backend(), dict(mpl.rcParams)
    time = np.linspace(0.0, 1.0, 5)
    flight = dict.fromkeys(
        (
            "time", "slew_angle", "reference_angle", "tip_deflection", "root_torque", "tip_torque",
            "extension",
        ),
        time,
    )  # fmt: skip
    plots.plot_manoeuvres({"linear": flight}, tmp_path / "a.png", title="")
    assert (mpl.get_backend(), dict(mpl.rcParams), plt.get_fignums()) == (before, settings, [])


def test_pictures_are_drawn_into_axes_that_somebody_gave() -> None:
    figure = Figure()
    five = figure.subplots(5, 1)
    flight = drm_env.simulate({"horizon": 2.0}, decimation=10)
    assert plots.plot_manoeuvres({"none": flight}, title="all", ax=five) is figure
    labels = [axis.get_ylabel() for axis in five]
    assert labels == [
        "slew angle (deg)", "tip error r e + y (mm)", "tip deflection y (mm)",
        "root wheel torque (N m)", "tip wheel torque (N m)",
    ]  # fmt: skip
    assert five[0].get_title() == "all"
    with pytest.raises(ValueError, match="ax must be 5 axes, got 1"):
        plots.plot_manoeuvres({"none": flight}, title="", ax=[five[0]])
    single = Figure().subplots()
    flights = [episodes("linear law", 1.0)]
    assert plots.plot_distribution(flights, title="", ax=single) is single.get_figure()
    result = SuiteResult(suite="robust", title="", records=[record("linear", "law", [[1.0] * 4])])
    for draw in (benchmark_plots.plot_suite, benchmark_plots.plot_profiles):
        assert draw(result, ax=single) is single.get_figure()
    # nothing is written without a path
    assert isinstance(plots.plot_comparison(flights, title=""), Figure)


def test_what_cannot_be_told_apart_is_drawn_as_a_band_between_its_peaks() -> None:
    """One oscillation in 200 of its periods, another in 4."""
    time = np.linspace(0.0, 20.0, 10_001)
    figure = Figure()
    fast, slow = figure.subplots(2, 1)
    style = {"color": "#000000", "linestyle": "-"}
    plots._draw_signal(fast, time, np.sin(2.0 * np.pi * 10.0 * time), style)
    plots._draw_signal(slow, time, np.sin(2.0 * np.pi * 0.2 * time), style)
    (band,) = fast.collections
    heights = np.asarray(band.get_paths()[0].vertices)[:, 1]
    assert heights.max() == pytest.approx(1.0, abs=0.01)
    assert heights.min() == pytest.approx(-1.0, abs=0.01)
    curve = fast.lines[-1]
    assert np.isfinite(np.asarray(curve.get_ydata())).mean() < 0.05
    assert all(not collection.get_paths() for collection in slow.collections)
    assert np.isfinite(np.asarray(slow.lines[-1].get_ydata())).all()


# --- one look a policy ----------------------------------------------------------------------------


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Every figure that is saved, instead of a file."""
    kept: list[Figure] = []

    def keep(figure: Figure, path: Path, *, overwrite: bool) -> Path:
        figure.draw_without_rendering()
        kept.append(figure)
        return path

    monkeypatch.setattr(plots, "save_figure", keep)
    monkeypatch.setattr(benchmark_plots, "save_figure", keep)
    return kept


def looks(axis: Axes) -> dict[str, tuple[str, str]]:
    """Colour and line of everything in an axis that has a label."""
    return {
        str(line.get_label()): (to_hex(str(line.get_color())).upper(), str(line.get_linestyle()))
        for line in axis.lines
        if not str(line.get_label()).startswith("_")
    }


def record(policy: str, kind: str, tip: Any, episodes: Any = None) -> Record:
    values = np.atleast_2d(np.asarray(tip, dtype=np.float64))
    places = np.arange(values.shape[1]) if episodes is None else np.asarray(episodes)
    return Record(
        policy=policy, title=title_of(policy), kind=kind, knows="reported",
        control_period=0.002, seeds=[0], episodes=places.astype(np.int64),
        strata=["a"] * values.shape[1], metrics={"tip_error_rms": values},
    )  # fmt: skip


def episodes(label: str, level: float) -> Episodes:
    values = np.linspace(level, 2.0 * level, 8)
    return Episodes(
        label=label, control_period=0.002, seeds=range(8), metrics={"tip_error_rms": values}
    )


def curve() -> Mapping[str, Any]:
    values = np.array([0.5, 0.1, 0.01])
    return {
        "steps": np.array([0.0, 1e5, 1e6]), "wall_time": np.array([0.0, 6.0, 60.0]),
        "tip_error_rms": values, "tip_error_rms_low": values / 2, "tip_error_rms_high": 2 * values,
    }  # fmt: skip


def test_a_policy_has_one_colour_and_line_in_every_picture(drawn: list[Figure]) -> None:
    time = np.linspace(0.0, 1.0, 5)
    signals = (
        "time", "slew_angle", "reference_angle", "tip_deflection", "root_torque", "tip_torque",
        "extension",
    )  # fmt: skip
    flight = dict.fromkeys(signals, time)
    nowhere = Path("nowhere.png")
    linear, lyapunov = "linear law", "Lyapunov law"
    # the order differs from picture to picture
    plots.plot_manoeuvres({"lyapunov": flight, "linear": flight}, nowhere, title="")
    plots.plot_distribution([episodes(linear, 1.0), episodes(lyapunov, 2.0)], nowhere, title="")
    bands = {
        name: Estimate(value=0.02, low=0.01, high=0.03, count=8) for name in (lyapunov, linear)
    }
    plots.plot_learning_curve(curve(), bands, nowhere, title="")
    result = SuiteResult(
        suite="robust", title="", records=[
            record("none", "open loop", [[5.0] * 4]), record("lyapunov", "law", [[2.0] * 4]),
            record("linear", "law", [[1.0] * 4]),
        ],
    )  # fmt: skip
    benchmark_plots.plot_profiles(result, nowhere)
    found = tables.estimate_of(result.records[1], "tip_error_rms")
    benchmark_plots.plot_curves({}, {lyapunov: found, linear: found}, nowhere)
    assert len(drawn) == 5
    for figure in drawn:
        shown = looks(figure.axes[0])
        assert shown[linear] == (POLICIES["linear"].colour, "-")
        assert shown[lyapunov] == (POLICIES["lyapunov"].colour, "-")


def test_no_two_policies_look_alike() -> None:
    kept = [(entry.colour, str(entry.line)) for entry in POLICIES.values()]
    assert len(set(kept)) == len(kept)
    markers = [entry.marker for entry in POLICIES.values()]
    assert len(set(markers)) == len(markers)
    titles = [entry.title for entry in POLICIES.values()]
    assert len(set(titles)) == len(titles)
    known = set(OKABE_ITO.values())
    assert {entry.colour for entry in POLICIES.values()} <= known


def test_runs_of_ones_own_look_like_no_policy_and_like_no_other_run() -> None:
    found = styles(["linear", "learned (a)", "learned (b)", "learned (c)", "linear law"])
    pairs = [(style["color"], str(style["linestyle"])) for style in found]
    assert pairs[0] == pairs[4]
    named = {(entry.colour, str(entry.line)) for entry in POLICIES.values()}
    assert len(set(pairs[1:4])) == 3 and not named & set(pairs[1:4])


def test_a_learned_policy_has_its_look_with_its_seed_behind_too() -> None:
    """As `drm compare` calls it."""
    title = POLICIES["dagger"].title
    first, second = styles([f"{title}, seed 0", f"{title}, seed 1"])
    assert first == POLICIES["dagger"].style
    assert second != first
    assert styles(["dagger", f"{title}, seed 0"])[1] != POLICIES["dagger"].style


def test_a_run_looks_the_same_beside_whatever_is_drawn() -> None:
    """The pictures of drm demo: with and without the inner law, and the learning curve."""
    laws, agent, inner = ["open loop", "linear law"], "inner law + PPO", "inner law alone (linear)"
    pictures = ([*laws, inner, agent], [*laws, agent], [agent, *laws])
    found = [styles(picture)[picture.index(agent)] for picture in pictures]
    assert found[0] == found[1] == found[2]


def test_commands_know_policies_by_the_names_of_the_pictures() -> None:
    from drm_baselines.evaluation.contestants import contestant_of_law

    for name in (*registry.LAWS, *gains.TUNED):
        assert contestant_of_law(name).label == POLICIES[name].title
    for competitor in competing.competitors():
        assert competitor.title == POLICIES[competitor.policy].title


def test_learning_curves_are_logarithmic_in_steps_time_and_error(drawn: list[Figure]) -> None:
    nowhere = Path("nowhere.png")
    plots.plot_learning_curve(curve(), {}, nowhere, title="")
    run = np.column_stack([[0.0, 1e5, 1e7], [0.0, 1.0, 600.0], [0.5, 0.1, 0.001]])
    benchmark_plots.plot_curves({"PPO end to end": [run]}, {}, nowhere)
    for figure in drawn:
        for axis in figure.axes:
            assert (axis.get_xscale(), axis.get_yscale()) == ("log", "log")
            assert all((np.asarray(line.get_xdata()) > 0.0).all() for line in axis.lines)


def test_no_lines_join_suites_that_have_no_order(drawn: list[Figure]) -> None:
    results = [
        SuiteResult(suite=name, title="", records=[record("linear", "law", [[1.0, 2.0]])])
        for name in ("robust", "heavy", "rough")
    ]
    benchmark_plots.plot_degradation(results, Path("nowhere.png"))
    lines = [line for line in drawn[0].axes[0].lines if len(np.atleast_1d(line.get_xdata())) == 3]
    assert lines
    assert {line.get_linestyle() for line in lines} == {"None"}


def test_a_policy_on_fewer_episodes_is_marked_and_held_against_the_bound_on_these(
    drawn: list[Figure],
) -> None:
    """The bound is 1 mm over all episodes, 0.1 mm on the two that the controller flew."""
    bound = record("bound", "bound", [[1e-4, 1e-3, 1e-3, 1e-3, 1e-4, 1e-3, 1e-3, 1e-3]])
    few = record("receding", "controller", [[2e-4, 2e-4]], episodes=[0, 4])
    law = record("linear", "law", [[1e-2] * 8])
    result = SuiteResult(suite="robust", title="", records=[bound, few, law])
    benchmark_plots.plot_suite(result, Path("nowhere.png"))
    benchmark_plots.plot_profiles(result, Path("nowhere.png"))
    benchmark_plots.plot_degradation([result], Path("nowhere.png"))
    axis = drawn[0].axes[0]
    names = [label.get_text() for label in axis.get_yticklabels()]
    assert [("2 of 8 episodes" in name) for name in names] == [False, False, True]
    strokes = [line for line in axis.lines if list(line.get_ydata()) == [2 - 0.32, 2 + 0.32]]
    assert len(strokes) == 1
    np.testing.assert_allclose(strokes[0].get_xdata(), 0.1)
    assert any("2 of 8 episodes" in label for label in looks(drawn[1].axes[0]))
    for figure, count in ((drawn[0], 1), (drawn[2], 1)):
        hollow = [
            line for line in figure.axes[0].lines
            if line.get_markerfacecolor() == "white" and len(np.atleast_1d(line.get_xdata()))
        ]  # fmt: skip
        assert len(hollow) == count
