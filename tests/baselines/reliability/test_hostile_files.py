"""Files from strangers run no code: nothing that is read can, but for a sealed checkpoint.

Every kind of file that a command reads is replaced by a pickle that leaves a mark when it is
loaded, also inside a NumPy archive. And the sources are searched for what could run a file's
content: a new place fails the test until it is listed here with its reason, and in SECURITY.md.
"""

from __future__ import annotations

import ast
import io
import json
import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import drm_env
from drm_baselines.cli import app
from drm_baselines.errors import BaselineError
from drm_baselines.evaluation.environments import environment_config
from drm_baselines.policies.policy_file import load_policy
from drm_baselines.policies.registry import shipped_policy
from drm_baselines.support import storage

ROOT = Path(__file__).parents[3]


class Payload:
    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return os.mkdir, (str(self.mark),)


@pytest.fixture
def mark(tmp_path: Path) -> Path:
    return tmp_path / "code was run"


def forms(mark: Path) -> dict[str, bytes]:
    """Return ways to wrap a payload up."""
    raw = pickle.dumps(Payload(mark))
    array = np.empty(1, dtype=object)
    array[0] = Payload(mark)
    npz, npy, torch = io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.savez(npz, digest=array, seeds0=array)
    np.save(npy, array)
    with zipfile.ZipFile(torch, "w") as archive:  # as torch.save lays it out
        archive.writestr("archive/data.pkl", raw)
        archive.writestr("archive/version", "3\n")
    return {
        "pickle": raw,
        "npz": npz.getvalue(),
        "npy": npy.getvalue(),
        "zip of torch": torch.getvalue(),
        "python": f"__import__('os').mkdir({str(mark)!r})".encode(),
        "yaml": f"!!python/object/apply:os.mkdir [{str(mark)!r}]".encode(),
    }


FORMS = ("pickle", "npz", "npy", "zip of torch", "python", "yaml")


def test_the_payload_is_one(mark: Path) -> None:
    pickle.loads(forms(mark)["pickle"])  # noqa: S301
    assert mark.exists()


def _policy(name: str) -> Callable[[Path, bytes], None]:
    def read(folder: Path, content: bytes) -> None:
        for file in ("policy.json", "policy.safetensors"):
            (folder / file).write_bytes((shipped_policy() / file).read_bytes())
        (folder / name).write_bytes(content)
        load_policy(folder)

    return read


def _command(file: str, *arguments: str) -> Callable[[Path, bytes], None]:
    def read(folder: Path, content: bytes) -> None:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(content)
        words = [word.replace("FOLDER", str(folder)) for word in arguments]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 2, (result.exit_code, result.stderr, result.exception)
        raise BaselineError(result.stderr)

    return read


def _curve(folder: Path, content: bytes) -> None:
    from drm_baselines.benchmark.report.documents import curves_of

    run = folder / "ppo" / "seed_0"
    run.mkdir(parents=True)
    for file in ("policy.json", "policy.safetensors"):
        (run / file).write_bytes((shipped_policy() / file).read_bytes())
    (run / "evaluations.csv").write_bytes(content)
    try:
        curves_of(folder)
    except (ValueError, KeyError) as error:
        raise BaselineError(str(error)) from error
    raise BaselineError("nothing was found in it")


def _record(folder: Path, content: bytes) -> None:
    from drm_baselines.benchmark.records import read_record

    (folder / "linear.parquet").write_bytes(content)
    read_record(folder / "linear.parquet")


def _archive(folder: Path, content: bytes) -> None:
    (folder / "plans.npz").write_bytes(content)
    if storage.load_arrays(folder / "plans.npz", "digest") is None:
        raise BaselineError("made with other settings")


def _snapshot(folder: Path, content: bytes) -> None:
    env = drm_env.DrmEnv()
    env.reset(seed=0)
    env.set_state(content)


def _vector_snapshot(folder: Path, content: bytes) -> None:
    env = drm_env.DrmVectorEnv(2)
    env.reset(seed=0)
    env.set_state(content)


def _configuration(folder: Path, content: bytes) -> None:
    (folder / "env.json").write_bytes(content)
    drm_env.resolve(config=folder / "env.json")


DOORS: dict[str, Callable[[Path, bytes], None]] = {
    "policy's description": _policy("policy.json"),
    "policy's weights": _policy("policy.safetensors"),
    "snapshot": _snapshot,
    "snapshot of a batch": _vector_snapshot,
    "configuration": _configuration,
    "record of the benchmark": _record,
    "teacher's archive": _archive,
    "learning curve": _curve,
    "run directory": _command("run.json", "train", "--resume", "--out", "FOLDER"),
    "hyperparameters": _command(
        "ppo.toml", "train", "--out", "FOLDER/run", "--hyperparameters", "FOLDER/ppo.toml"
    ),
    "search's settings": _command(
        "settings.json", "tune", "linear", "--scenarios", "4", "--trials", "1", "--out", "FOLDER"
    ),
    "scenario": _command("scenario.json", "simulate", "--scenario", "FOLDER/scenario.json"),
    "start of a training": _command(
        "policy.json", "train", "--out", "FOLDER/run", "--start", "FOLDER"
    ),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("door", DOORS)
def test_nothing_that_is_read_runs_code(tmp_path: Path, mark: Path, door: str, form: str) -> None:
    content = forms(mark)[form]
    with pytest.raises((BaselineError, drm_env.DrmError)):
        DOORS[door](tmp_path, content)
    assert not mark.exists()


def test_a_hostile_journal_of_a_search_runs_nothing(tmp_path: Path, mark: Path) -> None:
    arguments = ["tune", "linear", "--scenarios", "4", "--trials", "1", "--out", str(tmp_path)]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    for content in forms(mark).values():
        (tmp_path / "journal.log").write_bytes(content + b"\n")
        CliRunner().invoke(app, arguments)
        assert not mark.exists()


def test_an_environment_that_a_file_names_imports_no_module(
    tmp_path: Path, mark: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ids may name a module before a colon, which Gymnasium imports; those of files may not."""
    (tmp_path / "hostile.py").write_text(f"import os; os.mkdir({str(mark)!r})")
    monkeypatch.syspath_prepend(str(tmp_path))
    for file in ("policy.json", "policy.safetensors"):
        (tmp_path / file).write_bytes((shipped_policy() / file).read_bytes())
    description = json.loads((tmp_path / "policy.json").read_text())
    description["env_id"] = "hostile:drm_env/SlewResidual-v0"
    (tmp_path / "policy.json").write_text(json.dumps(description))
    policy = load_policy(tmp_path)
    result = CliRunner().invoke(
        app, ["evaluate", "--policy", str(tmp_path), "--episodes", "2", "--set", "horizon=0.4"]
    )
    assert result.exit_code in (0, 2), result.exception
    with pytest.raises(BaselineError, match="no environment 'hostile:"):
        environment_config(policy.env_id, {})
    assert not mark.exists()


# -- The sources ------------------------------------------------------------------------------

MODULES = {
    "pickle", "_pickle", "cloudpickle", "dill", "joblib", "shelve", "marshal", "yaml", "runpy",
    "code", "jsonpickle", "copyreg",
}  # fmt: skip
"""What runs what it reads."""
CALLS = {
    "eval", "exec", "compile", "__import__", "import_module", "system", "popen", "read_pickle",
    "load_replay_buffer", "load_from_zip_file", "load_module", "spec_from_file_location",
}  # fmt: skip
ALLOWED = {
    # checkpoints: opened by run_record.open_checkpoint, sealed or --trust
    ("baselines/drm_baselines/rl/training.py", "load"),
    ("baselines/drm_baselines/rl/training.py", "load_replay_buffer"),
    # safetensors.numpy.load, arrays alone, of checked bytes
    ("baselines/drm_baselines/policies/policy_file.py", "load"),
    # suites.load: a table that comes with the package
    ("baselines/drm_baselines/benchmark/runner.py", "load"),
    ("baselines/drm_baselines/benchmark/report/targets.py", "load"),
    ("baselines/drm_baselines/benchmark/report/example.py", "load"),
    ("baselines/drm_baselines/benchmark/pieces.py", "load"),
    ("baselines/drm_baselines/benchmark/recording.py", "load"),
    # how large something is once it is pickled; nothing is read
    ("baselines/drm_baselines/sweep/cost.py", "pickle"),
    # modules by names that are in the sources
    ("baselines/drm_baselines/_moved.py", "import_module"),
    ("baselines/drm_baselines/benchmark/records.py", "import_module"),
    ("baselines/drm_baselines/benchmark/kept.py", "import_module"),
    ("baselines/drm_baselines/evaluation/records.py", "import_module"),
    ("baselines/drm_baselines/speed/sections/training.py", "import_module"),
    ("baselines/drm_baselines/policies/pilots.py", "import_module"),
    ("baselines/drm_baselines/speed/sections/__init__.py", "import_module"),
    ("baselines/drm_baselines/support/lazy.py", "import_module"),
    ("baselines/drm_baselines/rl/algorithms.py", "import_module"),
    ("baselines/drm_baselines/sweep/parts.py", "import_module"),
    ("baselines/drm_baselines/tuning/learners.py", "import_module"),
    ("python/drm_env/__init__.py", "import_module"),
    ("python/drm_env/_exports.py", "import_module"),
    # the module that an environment's id names before a colon, as Gymnasium's own make imports it
    ("python/drm_env/resolution.py", "import_module"),
    # the module that drm benchmark --submit names before a colon, as python -m does (SECURITY.md)
    ("baselines/drm_baselines/benchmark/submissions.py", "import_module"),
    ("tools/fuzz_bindings.py", "import_module"),
    ("tools/learning_trials.py", "import_module"),
    ("tools/reference.py", "import_module"),
}
"""File and call, each with why it runs nothing that a stranger wrote."""


def doors_of(path: Path) -> set[str]:
    """Return what in a source file could run the content of another file."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name.split(".")[0] in MODULES}
        elif isinstance(node, ast.ImportFrom):
            if node.module and node.level == 0 and node.module.split(".")[0] in MODULES:
                found.add(node.module)
        elif isinstance(node, ast.Call):
            function = node.func
            name = function.attr if isinstance(function, ast.Attribute) else ""
            name = function.id if isinstance(function, ast.Name) else name
            owner = function.value if isinstance(function, ast.Attribute) else None
            owned = owner.id if isinstance(owner, ast.Name) else ""
            options = {word.arg: word.value for word in node.keywords}
            if (owned, name) in (("re", "compile"), ("json", "load"), ("json", "loads")) or (
                owned in ("tomllib", "platform")
            ):
                continue
            if owned == "np" and name == "load":
                kept = options.get("allow_pickle")
                if not (isinstance(kept, ast.Constant) and kept.value is False):
                    found.add("np.load")
            elif name in CALLS or name in ("load", "loads"):
                found.add(name)
            if "shell" in options:
                found.add("shell")
    return found


def test_the_sources_have_no_other_door() -> None:
    found = {
        (path.relative_to(ROOT).as_posix(), door)
        for folder in ("baselines/drm_baselines", "python/drm_env", "tools", "examples")
        for path in (ROOT / folder).rglob("*.py")
        for door in doors_of(path)
    }
    assert found - ALLOWED == set()
    assert ALLOWED - found == set(), "no longer there"


@pytest.mark.parametrize(
    "text",
    [
        "import pickle", "from pickle import loads", "import yaml", "torch.load(path)",
        "np.load(path)", "np.load(path, allow_pickle=True)", "eval(text)", "exec(text)",
        "subprocess.run(text, shell=True)", "os.system(text)", "pandas.read_pickle(path)",
        "import joblib", "PPO.load(path)",
    ],
)  # fmt: skip
def test_the_search_finds(tmp_path: Path, text: str) -> None:
    path = tmp_path / "source.py"
    path.write_text(text)
    assert doors_of(path)
