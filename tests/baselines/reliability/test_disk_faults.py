"""A full disk, a place that is read-only, files that were cut short or are of another version.

The error names the file, and what was good before is untouched.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drm_baselines.benchmark.records import Record, read_record, write_record
from drm_baselines.errors import BaselineError, RunError, WriteError
from drm_baselines.evaluation.records import Episodes, write_records
from drm_baselines.policies.policy_file import load_policy, save_policy
from drm_baselines.policies.registry import shipped_policy
from drm_baselines.support import storage, workplace

POLICY = load_policy(shipped_policy())
RECORD = Record(
    policy="linear", title="linear", kind="law", knows="nothing", control_period=0.002,
    seeds=[0], episodes=np.arange(2000), strata=["a"] * 2000,
    metrics={"tip_error_rms": np.random.default_rng(0).random((1, 2000))},
)  # fmt: skip
EPISODES = Episodes(
    label="linear", control_period=0.002, seeds=list(range(2000)),
    metrics={"tip_error_rms": np.linspace(0.0, 1.0, 2000)}, context={},
)  # fmt: skip

WRITERS: dict[str, Callable[[Path], Any]] = {
    "text": lambda folder: storage.write_text(folder / "t.txt", "x" * 50_000, overwrite=True),
    "json": lambda folder: storage.write_json(folder / "t.json", ["x" * 50_000], overwrite=True),
    "arrays": lambda folder: storage.save_arrays(folder / "a.npz", {"x": np.ones(9000)}, "d"),
    "policy": lambda folder: save_policy(folder, POLICY.network, POLICY.description),
    "record": lambda folder: write_record(folder / "linear.parquet", RECORD),
    "csv": lambda folder: write_records(folder / "e.csv", [EPISODES], settings={}, overwrite=True),
    "parquet": lambda folder: write_records(
        folder / "e.parquet", [EPISODES], settings={}, overwrite=True
    ),
}


def files_in(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def small_files() -> Iterator[None]:
    """No file of this process can be larger than 4 KiB: the system refuses in mid-write."""
    import signal

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("name", WRITERS)
def test_a_write_that_the_system_ends_half_way_leaves_the_old_file(
    tmp_path: Path, small_files: None, name: str
) -> None:
    with pytest.raises(WriteError, match=r"cannot be written: .*File too large"):
        WRITERS[name](tmp_path)
    assert files_in(tmp_path) == {}, "no half of a file"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    WRITERS[name](tmp_path)
    before = files_in(tmp_path)
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    with pytest.raises(WriteError, match=r"cannot be written: .*File too large"):
        WRITERS[name](tmp_path)
    assert files_in(tmp_path) == before


TMPFS = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[2].split(":")
import test_disk_faults as faults
from drm_baselines.errors import WriteError

folder = Path(sys.argv[1])
for name, write in faults.WRITERS.items():
    place = folder / name.replace(" ", "_")
    place.mkdir()
    if sys.argv[3] == "full":
        write(place)
        before = faults.files_in(place)
        filler = folder / "filler"
        try:
            with filler.open("wb", buffering=0) as stream:
                while True:
                    stream.write(b"x" * 4096)
        except OSError:
            pass
    else:
        before = {}
    try:
        write(place)
    except WriteError as error:
        reason = "No space left" if sys.argv[3] == "full" else "Read-only"
        assert reason in str(error) and str(place) in str(error), error
    else:
        raise AssertionError(f"{name} was written to a full disk")
    assert faults.files_in(place) == before, name
    if sys.argv[3] == "full":
        filler.unlink()
print("done")
"""


def test_a_full_disk_leaves_every_old_file_and_no_half_of_one(tmp_path: Path) -> None:
    """A real file system that is full, in a mount namespace of its own."""
    disk = tmp_path / "disk"
    disk.mkdir()
    script = (
        f"mount -t tmpfs -o size=2m none {disk} && "
        f'exec "$0" -c "$1" {disk} {Path(__file__).parent} full'
    )
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", script, sys.executable, TMPFS],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if "unshare" in done.stderr or "mount:" in done.stderr:
        pytest.skip(f"no file system can be mounted here: {done.stderr.strip()}")
    assert done.stdout == "done\n", done.stderr


@pytest.mark.parametrize("name", WRITERS)
def test_a_read_only_directory_is_named(tmp_path: Path, as_a_user: None, name: str) -> None:
    place = tmp_path / "place"
    place.mkdir()
    WRITERS[name](place)
    before = files_in(place)
    place.chmod(0o555)
    try:
        with pytest.raises(WriteError, match=r"place.* cannot be written: Permission denied"):
            WRITERS[name](place)
        with pytest.raises(WriteError, match="Permission denied"):
            workplace.noting(place, workplace.Work("drm tune")).__enter__()
    finally:
        place.chmod(0o755)
    assert files_in(place) == before


READERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "policy's description": ("policy.json", lambda path: load_policy(path.parent)),
    "policy's weights": ("policy.safetensors", lambda path: load_policy(path.parent)),
    "record": ("linear.parquet", read_record),
    "arrays": ("a.npz", lambda path: storage.load_arrays(path, "d")),
}


@pytest.mark.parametrize("name", READERS)
def test_a_file_that_was_cut_short_is_named(tmp_path: Path, name: str) -> None:
    file, read = READERS[name]
    for writer in ("policy", "record", "arrays"):
        WRITERS[writer](tmp_path)
    path = tmp_path / file
    whole = path.read_bytes()
    read(path)
    for length in sorted({0, 1, 7, 8, 100, len(whole) // 2, len(whole) - 9, len(whole) - 1}):
        path.write_bytes(whole[:length])
        if whole[:length].strip() == whole.strip():  # a line's end alone
            continue
        with pytest.raises(RunError, match=file.replace(".", r"\.")):
            read(path)
    path.write_bytes(whole)
    read(path)


def test_files_of_other_versions_are_named_with_their_version(tmp_path: Path) -> None:
    for writer in ("policy", "record"):
        WRITERS[writer](tmp_path)
    description = json.loads((tmp_path / "policy.json").read_text())
    (tmp_path / "policy.json").write_text(json.dumps({**description, "format_version": 99}))
    with pytest.raises(RunError, match=r"policy\.json has format version 99; .* reads 1"):
        load_policy(tmp_path)
    import pyarrow.parquet as parquet

    path = tmp_path / "linear.parquet"
    table = parquet.read_table(path)
    header = json.loads(table.schema.metadata[b"drm_record"])
    text = json.dumps({**header, "format_version": 99})
    parquet.write_table(table.replace_schema_metadata({"drm_record": text}), path)
    with pytest.raises(RunError, match=r"linear\.parquet has format version 99"):
        read_record(path)


@pytest.mark.parametrize("length", [0, -10])
def test_a_checkpoint_that_was_cut_short_is_named_and_the_policy_stays(
    tmp_path: Path, length: int
) -> None:
    pytest.importorskip("stable_baselines3")
    from drm_baselines.rl.hyperparameters import from_data
    from drm_baselines.rl.request import TrainingRequest
    from drm_baselines.rl.training import resume, train

    settings = {
        "algorithm": "ppo", "n_envs": 4, "learning_rate": 1e-3,
        "model": {"n_steps": 16, "batch_size": 32, "n_epochs": 1},
        "network": {"layers": [8], "activation": "tanh"},
    }  # fmt: skip
    request = TrainingRequest(
        algorithm="ppo", env_id="drm_env/SlewResidual-v0", options={"horizon": 0.4}, steps=64,
        seed=1, settings=from_data(settings), evaluations=1, evaluation_episodes=2,
    )  # fmt: skip
    record = train(tmp_path, request)
    assert record.checkpoint is not None
    path = tmp_path / record.checkpoint["model"]["file"]
    path.write_bytes(path.read_bytes()[:length])
    before = files_in_tree(tmp_path)
    with pytest.raises(RunError, match=r"model_64_.*\.zip is not the file that this run wrote"):
        resume(tmp_path, steps=128)
    assert files_in_tree(tmp_path) == before
    load_policy(tmp_path)
    stored = json.loads((tmp_path / "run.json").read_text())
    (tmp_path / "run.json").write_text(json.dumps({**stored, "format_version": 2}))
    with pytest.raises(RunError, match=r"run\.json has format version 2; .* reads 1"):
        resume(tmp_path, steps=128)


def files_in_tree(folder: Path) -> dict[Path, bytes]:
    own = (workplace.LOCK_FILE, workplace.NOTE_FILE)
    return {
        path: path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in own
    }


def test_errors_of_writing_are_ones_that_a_user_can_act_on() -> None:
    assert issubclass(WriteError, BaselineError)
