"""One list of policies: every door knows the names, lists them, and says them in its errors."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import drm_env
from drm_baselines import PolicyError, PolicyWarning, make_policy, suites
from drm_baselines.benchmark.competitors import Competitor, chosen, competitors
from drm_baselines.benchmark.report.ranking import KINDS
from drm_baselines.benchmark.runner import fingerprint
from drm_baselines.cli.application import app
from drm_baselines.errors import BaselineError
from drm_baselines.evaluation.contestants import Arena, contestant_named, contestant_of_pilot
from drm_baselines.evaluation.environments import environment_config, scenarios_of
from drm_baselines.evaluation.episodes import fly_pilot
from drm_baselines.optimal_control.mpc import Receding, RecedingPilot, fly_one
from drm_baselines.policies.gains import TUNED
from drm_baselines.policies.names import (
    ALIASES,
    POLICIES,
    PolicyName,
    find,
    listed,
    names_of,
    styles,
    title_of,
)
from drm_baselines.policies.pilots import (
    ENTRY_POINTS,
    NetworkPilot,
    Pilot,
    law_data,
    pilot_named,
    shipped_run,
)
from drm_baselines.support import storage

SHORT = {"horizon": 0.4}
ARENA = Arena(env_id="drm_env/Slew-v0", options=SHORT, episodes=2)
NAMES = (*POLICIES, *ALIASES)


def flat(text: str) -> str:
    """A text without the frames, colours and line breaks of a terminal."""
    return " ".join(text.replace("│", " ").split())


def run(*arguments: object) -> Any:
    return CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1"}).invoke(app, list(map(str, arguments)))


def test_the_list_is_whole() -> None:
    assert tuple(TUNED) == names_of("tuned law")
    assert {entry.kind for entry in POLICIES.values()} == set(KINDS) == set(ENTRY_POINTS)
    assert [one.policy for one in competitors()] == list(POLICIES)
    assert all(one.title == title_of(one.policy) for one in competitors())
    assert find("learned") is POLICIES["dagger"]
    assert isinstance(find("ppo"), PolicyName) and styles(["ppo"]) == [find("ppo").style]


@pytest.mark.parametrize("command", ["compare", "evaluate", "simulate", "benchmark"])
def test_help_lists_every_name(command: str) -> None:
    shown = run(command, "--help")
    assert shown.exit_code == 0
    words = flat(shown.output).replace(",", " ").replace("(", " ").split()
    assert set(NAMES) <= set(words)


def benchmark(name: str) -> None:
    chosen(competitors(), [name])


DOORS: dict[str, Callable[[str], Any]] = {
    "make_policy": make_policy,
    "pilot_named": pilot_named,
    "compare": lambda name: contestant_named(ARENA, name),
    "benchmark": benchmark,
    "law_data": law_data,
}


@pytest.mark.parametrize("door", DOORS)
def test_an_unknown_name_is_refused_with_all_that_there_are(door: str) -> None:
    with pytest.raises(PolicyError, match=r"no policy 'pid'") as refused:
        DOORS[door]("pid")
    assert listed() in str(refused.value)


@pytest.mark.parametrize(
    "arguments",
    [
        ("compare", "pid", "none"),
        ("evaluate", "--policy", "pid"),
        ("simulate", "--law", "pid"),
        ("benchmark", "--policy", "pid"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_commands_refuse_an_unknown_name_with_all_that_there_are(
    arguments: tuple[str, ...], tmp_path: Path
) -> None:
    refused = run(*arguments, *(("--out", tmp_path) if arguments[0] == "benchmark" else ()))
    assert refused.exit_code == 2
    said = flat(refused.output + refused.stderr)
    assert "no policy 'pid'" in said and listed() in said


@pytest.mark.parametrize("name", NAMES)
def test_every_door_knows_every_name(name: str) -> None:
    assert contestant_named(ARENA, name).label.startswith(find(name).title)
    assert [one.policy for one in chosen(competitors(), [name])] == [find(name).name]
    if find(name).kind in ("controller", "bound"):
        with pytest.raises(PolicyError, match="does not act on observations"):
            make_policy(name)
    elif find(name).kind == "shaped law" or name in ("linear_collocated", "collocated"):
        with pytest.raises(PolicyError, match=r"is a law and a manoeuvre|gyro at the tip wheel"):
            make_policy(name, config={"task": {"control_period": 0.002}})
    elif find(name).kind == "learned":
        assert make_policy(name).control_period == pilot_named(name).control_period
    else:
        assert make_policy(name, config={"task": {"control_period": 0.002}}).name


@pytest.mark.parametrize("name", POLICIES)
def test_whoever_has_a_name_flies(name: str) -> None:
    pilot: Pilot = pilot_named(name)
    assert pilot.name == name and pilot.control_period > 0.0
    scenarios = drm_env.sample_scenarios(n=2, seed=3, **SHORT)
    flown = pilot.fly(scenarios, seed=3)
    assert all(values.shape == (2,) for values in flown.values())
    assert np.isfinite(flown["tip_error_rms"]).all()
    signals = pilot.trajectory(scenarios[0], seed=3)
    assert signals.metrics["tip_error_rms"] == pytest.approx(flown["tip_error_rms"][0], rel=1e-12)
    assert signals["time"][-1] == pytest.approx(0.4)
    episodes = contestant_named(ARENA, name).fly(ARENA)
    assert episodes.metrics["tip_error_rms"].shape == (2,)


def test_simulate_flies_laws_and_policies_alike(tmp_path: Path) -> None:
    names = ("lqr", "ppo", "receding", "bound")
    laws = [item for name in names for item in ("--law", name)]
    done = run("simulate", *laws, "--horizon", 0.4, "--json", "--out", tmp_path / "flight")
    assert done.exit_code == 0, done.output
    content = json.loads(done.stdout)
    assert list(content["metrics"]) == list(names)
    assert content["laws"]["lqr"]["name"] == "scheduled"
    assert content["laws"]["ppo"]["weights_sha256"]
    assert all((tmp_path / "flight" / f"{name}.csv").is_file() for name in names)


def test_the_controller_flies_by_its_own_settings_and_seeds() -> None:
    scenario = drm_env.sample_scenarios(n=1, seed=3, angle_noise=1e-4, **SHORT)[0]
    settings = Receding(effort=1e-2)
    pilot = RecedingPilot(settings=settings)
    alone = fly_one(scenario, 9, settings)
    assert pilot.fly([scenario], seed=[9])["tip_error_rms"][0] == alone["tip_error_rms"]
    assert contestant_of_pilot(pilot).label == title_of("receding")


def test_a_name_wins_over_a_directory_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ppo").symlink_to(shipped_run("sac"))
    monkeypatch.chdir(tmp_path)
    with pytest.warns(PolicyWarning, match=r"directory of that name is \./ppo"):
        named = contestant_named(ARENA, "ppo")
    there = contestant_named(ARENA, "./ppo")
    assert named.details["training"]["algorithm"] == "ppo"
    assert there.details["training"]["algorithm"] == "sac"


def test_a_network_keeps_its_own_task() -> None:
    pilot = pilot_named("sac")
    assert isinstance(pilot, NetworkPilot)
    assert pilot.details["training"]["algorithm"] == "sac"
    with pytest.raises(drm_env.ConfigError, match="sample_period must be"):
        pilot.fly([{"horizon": 0.4, "sample_period": 1e-3}])


def test_a_method_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(BaselineError, match=r"'ppo' is not here; there are bound, none"):
        chosen(competitors(tmp_path), ["ppo"])


@pytest.mark.parametrize("name", POLICIES)
def test_the_keys_of_the_records_that_there_are_stay(name: str) -> None:
    """The digest of the format that the shipped records were stamped with, written out."""
    competitor: Competitor = next(one for one in competitors() if one.policy == name)
    for suite in suites.SUITES:
        manoeuvres = suites.load(suite)
        flown = len(competitor.episodes(manoeuvres))
        kind = find(name).kind
        content: dict[str, Any] = {
            "suite": manoeuvres.digest,
            "base": dict(manoeuvres.suite.base),
            "kind": kind,
            "law": law_data(name) if kind in ("open loop", "law", "tuned law") else None,
            "runs": {
                str(seed): storage.sha256_of(path / "policy.json")
                for seed, path in competitor.runs.items()
            },
            "engine": drm_env.__version__,
        }
        if kind == "controller":
            content |= pilot_named(name).details
        if kind == "shaped law":
            leans = {"lean": 0.95} if "lean" in name else {}
            shaper = name.rpartition("_")[2]
            content |= {"law": {"name": "servo", **leans}, "slew_shaper": shaper}
        if flown != len(manoeuvres):
            content["episodes"] = flown
        text = json.dumps(content, sort_keys=True, default=str)
        assert fingerprint(competitor, manoeuvres) == hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("name", names_of("shaped law"))
def test_a_shaped_law_flies_its_shaped_slew_in_comparisons_too(name: str) -> None:
    """Not the law alone: its slews end later, by the shaper, whoever asks for its flights."""
    config = environment_config("drm_env/SlewFlexible-v0", {"horizon": 18.0})
    options = {"env_id": "drm_env/SlewFlexible-v0", "seed": 5, "episodes": 2}
    pilot = pilot_named(name)
    compared = fly_pilot(pilot, config, label=name, **options)
    alone = fly_pilot(pilot_named("servo"), config, label="servo", **options)
    assert (compared.metrics["slew_end_time"] > alone.metrics["slew_end_time"] + 0.05).all()
    direct = pilot.fly(scenarios_of("drm_env/SlewFlexible-v0", config, 5, 2), seed=5)
    np.testing.assert_array_equal(compared.metrics["tip_error_rms"], direct["tip_error_rms"])
    mission = {"mission": {"legs": [{"kind": "slew", "angle": 0.5}]}}
    ends = [pilot_named(each).fly([mission])["slew_end_time"][0] for each in (name, "servo")]
    assert ends[0] > ends[1]


@pytest.mark.parametrize("name", names_of("controller", "bound"))
def test_who_is_made_for_single_manoeuvres_refuses_missions(name: str) -> None:
    """Before anything is planned, and by its own name."""
    mission = {"mission": {"legs": [{"kind": "slew", "angle": 0.5}]}}
    pilot = pilot_named(name)
    message = f"'{name}' is made for single manoeuvres and flies no missions"
    with pytest.raises(PolicyError, match=message):
        pilot.fly([{}, mission])
    with pytest.raises(PolicyError, match=message):
        pilot.trajectory(mission)
