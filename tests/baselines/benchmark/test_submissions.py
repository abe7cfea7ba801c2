"""``drm benchmark --submit``: a stranger's policy flies, and its row stands beside the others."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("jinja2")
pytest.importorskip("pyarrow")

import drm_env
from drm_baselines.benchmark import kept, runner
from drm_baselines.benchmark.records import SUBMITTED, read_record
from drm_baselines.benchmark.submissions import submitted
from drm_baselines.cli import app
from drm_baselines.errors import BaselineError, PolicyError, RunError
from drm_baselines.evaluation.predictors import BATCH, PredictorPilot, flat_manoeuvres
from drm_baselines.policies.pilots import LawPilot, NetworkPilot, law_data, shipped_run
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.suites import SUITES, load

RUN = shipped_run("ppo")

STRANGER = '''
import numpy as np

class Zero:
    """Zero action: the inner law alone."""
    env_id = "drm_env/SlewResidual-v0"

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.zeros((len(observation), 2)), None

class Rude(Zero):
    def predict(self, *_, **__):
        raise KeyError("no mood today")

class Wide(Zero):
    def predict(self, observation, **_):
        return np.zeros((len(observation), 3)), None

class Remembering(Zero):
    """Counts the decisions of each episode by the state that it is given back."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        count = np.zeros(len(observation)) if state is None else state
        count = np.where(episode_start, 0, count) + 1
        self.longest = count.max()
        return np.zeros((len(observation), 2)), count

class Elsewhere(Zero):
    env_id = "CartPole-v1"

def made():
    return Zero()

remembering = Remembering()
rude = Rude()
wide = Wide()
elsewhere = Elsewhere()
number = 7
'''


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A module with strangers' policies in the working directory."""
    (tmp_path / "stranger_s_code.py").write_text(STRANGER)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "stranger_s_code", raising=False)
    return "stranger_s_code"


# --- who flies ------------------------------------------------------------------------------------


@pytest.mark.parametrize("suite", SUITES)
def test_manoeuvres_are_the_same_by_flat_names(suite: str) -> None:
    """What a batch is told by its options is the suite's scenario, entry by entry."""
    scenarios = load(suite).scenarios[:: len(load(suite)) // 5]
    shared, own = flat_manoeuvres(scenarios)
    env = drm_env.DrmVectorEnv(len(own), config=drm_env.resolve(config={"scenario": shared}))
    try:
        env.reset(seed=0, options=[dict(each) for each in own])
        for scenario, lane in zip(scenarios, env.envs, strict=True):
            single = drm_env.DrmEnv(config=drm_env.resolve(config={"scenario": dict(scenario)}))
            single.reset(seed=0)
            assert lane.context == single.context
            single.close()
    finally:
        env.close()


def test_a_predictor_flies_what_the_engine_flies() -> None:
    """Zero action flies as the inner law does, and a network as in the engine, but for rounding."""
    scenarios = load("rough").scenarios[::250]
    seeds = list(range(len(scenarios)))

    class Zero:
        def predict(
            self, observation: Any, state: Any = None, episode_start: Any = None,
            deterministic: bool = True,
        ) -> tuple[Any, Any]:  # fmt: skip
            del episode_start, deterministic
            return np.zeros((len(observation), 2)), state

    config = drm_env.resolve("drm_env/SlewResidual-v0")
    pilot = PredictorPilot("zero", Zero(), config.to_dict())
    law = LawPilot("linear", law_data("linear")).fly(scenarios, seed=seeds)
    flown = pilot.fly(scenarios, seed=seeds)
    for name in ("tip_error_rms", "residual_rms", "wheel_effort"):
        np.testing.assert_array_equal(flown[name], law[name])
    policy = load_policy(RUN)
    network = NetworkPilot("ppo", policy).fly(scenarios, seed=seeds)
    asked = PredictorPilot("ppo", policy, policy.config).fly(scenarios, seed=seeds)
    np.testing.assert_allclose(asked["tip_error_rms"], network["tip_error_rms"], rtol=0.05)


def test_batches_do_not_matter(monkeypatch: pytest.MonkeyPatch, module: str) -> None:
    (mine,) = submitted([f"{module}:made"])
    assert mine.pilot is not None
    scenarios = load("rough").scenarios[:5]
    whole = mine.pilot.fly(scenarios, seed=7)
    assert BATCH > 5
    monkeypatch.setattr("drm_baselines.evaluation.predictors.BATCH", 2)
    told: list[tuple[int, int]] = []
    parts = mine.pilot.fly(scenarios, seed=7, progress=lambda *done: told.append(done))
    assert told == [(2, 5), (4, 5), (5, 5)]
    for name, values in whole.items():
        np.testing.assert_array_equal(parts[name], values)


def test_state_and_starts_of_episodes_are_given_back(module: str) -> None:
    (mine,) = submitted([f"mine={module}:remembering"])
    assert mine.pilot is not None
    mine.pilot.fly(load("thesis").scenarios[:2], seed=0)
    policy: Any = sys.modules[module].remembering
    # 30 s at 100 Hz; the last decision of an episode is counted, none is twice
    period = mine.pilot.control_period
    assert policy.longest == round(30.0 / period)


# --- who is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("mine=", BaselineError, "expected NAME=DIRECTORY"),
        ("Mine!=x", BaselineError, "a name has up to 40"),
        ("../x=y", BaselineError, "a name has up to 40"),
        ("ppo=x", BaselineError, "'ppo' is a policy of the package"),
        ("learned=x", BaselineError, "'learned' is a policy of the package"),
        ("mine=nowhere", RunError, "no run directory nowhere"),
        ("mine=no_such_module:policy", PolicyError, "ModuleNotFoundError"),
        ("mine=stranger_s_code:nobody", PolicyError, "AttributeError"),
        ("mine=stranger_s_code:number", PolicyError, "TypeError"),
        ("mine=stranger_s_code:elsewhere", PolicyError, "env_id must be one of"),
    ],
)
@pytest.mark.usefixtures("module")
def test_what_cannot_fly_is_refused_by_name(
    text: str, error: type[BaselineError], message: str
) -> None:
    with pytest.raises(error, match=message):
        submitted([text])


def test_two_of_a_name_are_refused(module: str) -> None:
    with pytest.raises(BaselineError, match="two policies are called 'made'"):
        submitted([f"{module}:made", f"made={module}:made"])


@pytest.mark.parametrize("attribute", ["rude", "wide"])
def test_a_policy_that_fails_ends_with_its_name(
    module: str, attribute: str, tmp_path: Path
) -> None:
    run = CliRunner().invoke(
        app,
        ["benchmark", "--suite", "thesis", "--submit", f"{module}:{attribute}",
         "--out", str(tmp_path / "out")],
    )  # fmt: skip
    assert run.exit_code == 2
    assert "Traceback" not in run.output
    expected = "no mood today" if attribute == "rude" else "shape"
    assert expected in run.output.replace("\n", " ")


@pytest.mark.parametrize("harm", ["link", "weights", "huge", "pickle"])
def test_hostile_directories_are_refused(tmp_path: Path, harm: str) -> None:
    directory = tmp_path / "theirs"
    shutil.copytree(RUN, directory)
    weights, about = directory / "policy.safetensors", directory / "policy.json"
    if harm == "link":
        weights.unlink()
        weights.symlink_to(RUN / "policy.safetensors")
    elif harm == "weights":
        weights.write_bytes(weights.read_bytes()[:-4] + b"\0\0\0\0")
    elif harm == "huge":
        about.write_text(json.dumps({**json.loads(about.read_text()), "layers": [[10**9, 1]]}))
    else:
        weights.write_bytes(b"\x80\x04cos\nsystem\n.")
    run = CliRunner().invoke(
        app,
        ["benchmark", "--suite", "thesis", "--submit", str(directory),
         "--out", str(tmp_path / "out")],
    )  # fmt: skip
    assert run.exit_code == 2, run.output
    assert "Traceback" not in run.output
    assert not (tmp_path / "out" / "records").exists()


# --- the row --------------------------------------------------------------------------------------


def test_a_row_is_added_with_its_provenance(tmp_path: Path, module: str) -> None:
    directory, out = tmp_path / "my-agent", tmp_path / "out"
    shutil.copytree(RUN, directory)
    records = tmp_path / "kept"
    flown = runner.fly_suite("thesis", [], tmp_path / "none")
    assert flown.records == []
    base = ["benchmark", "--suite", "thesis", "--out", str(out), "--records", str(records)]
    law = CliRunner().invoke(
        app, ["benchmark", "--suite", "thesis", "--policy", "linear", "--out",
              str(tmp_path / "law"), "--keep", str(records)],
    )  # fmt: skip
    assert law.exit_code == 0, law.output
    path = tmp_path / "summary.json"
    run = CliRunner().invoke(
        app,
        ["benchmark", "--suite", "thesis", "--out", str(out), "--submit", str(directory),
         "--submit", f"nothing={module}:made", "--json-file", str(path)],
    )  # fmt: skip
    assert run.exit_code == 0, run.output
    mine = read_record(runner.record_file(out, "thesis", "my_agent"))
    assert (mine.kind, mine.control_period, len(mine.episodes)) == (SUBMITTED, 0.1, 108)
    assert mine.details["weights_sha256"] == load_policy(RUN).description["weights_sha256"]
    assert {"versions", "command", "platform", "suite"} <= set(mine.details)
    # flown by the engine as the package's own policy is
    shipped = NetworkPilot("ppo", load_policy(RUN))
    own = shipped.fly(load("thesis").scenarios[:4], seed=list(range(4)))
    np.testing.assert_array_equal(mine.metrics["tip_error_rms"][0, :4], own["tip_error_rms"])
    nothing = read_record(runner.record_file(out, "thesis", "nothing"))
    assert nothing.details["source"] == f"{module}:made"
    assert len(nothing.details["source_sha256"]) == 64
    policies = json.loads(path.read_text())["policies"]
    assert policies["my_agent"]["kind"] == SUBMITTED
    page = (out / "benchmark.html").read_text()
    assert "my_agent" in page and "updates" in page
    # later its row stands there without being flown, beside those of other records
    again = CliRunner().invoke(app, [*base, "--json-file", str(path)])
    assert again.exit_code == 0, again.output
    assert list(json.loads(path.read_text())["policies"]) == ["linear", "my_agent", "nothing"]
    assert [one.policy for one in kept.submissions_in(out, "thesis")] == ["my_agent", "nothing"]
