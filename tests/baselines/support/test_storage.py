"""Results are complete or absent, and never overwritten unless asked."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from drm_baselines.errors import BaselineError, ExistingResultError
from drm_baselines.evaluation.records import Episodes, write_records
from drm_baselines.support import storage


def test_an_interrupted_write_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    storage.write_json(path, {"a": 1})

    def interrupted() -> None:
        with storage.atomic_path(path, overwrite=True) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert json.loads(path.read_text()) == {"a": 1}
    assert [file.name for file in tmp_path.iterdir()] == ["result.json"]


def test_existing_files_and_directories_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    storage.write_json(path, {"a": 1})
    with pytest.raises(ExistingResultError, match=r"result\.json exists"):
        storage.write_json(path, {"a": 2})
    with pytest.raises(ExistingResultError, match="not empty"):
        storage.claim_directory(tmp_path)
    with pytest.raises(ExistingResultError, match="not a directory"):
        storage.claim_directory(path)
    assert json.loads(path.read_text()) == {"a": 1}
    storage.write_json(path, {"a": 3}, overwrite=True)
    assert json.loads(path.read_text()) == {"a": 3}


def test_json_holds_no_nan_and_plain_types_only(tmp_path: Path) -> None:
    path = storage.write_json(
        tmp_path / "x.json",
        {"nan": math.nan, "inf": np.float64(np.inf), "array": np.arange(3), "bool": np.bool_(True)},
    )
    assert json.loads(path.read_text()) == {
        "nan": None, "inf": None, "array": [0, 1, 2], "bool": True,
    }  # fmt: skip


def _flight() -> Episodes:
    return Episodes(
        label="linear",
        control_period=0.002,
        seeds=[3, 4],
        metrics={"tip_error_rms": np.array([0.1, 0.2]), "settling_time": np.array([1.5, np.nan])},
        context={"payload.mass": np.array([50.0, 60.0])},
    )


def test_csv_records_have_one_row_an_episode_and_settings_beside(tmp_path: Path) -> None:
    files = write_records(tmp_path / "e.csv", [_flight()], settings={"seed": 3})
    with files[0].open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["seed"] for row in rows] == ["3", "4"]
    assert rows[1] == {
        "policy": "linear", "control_period": "0.002", "seed": "4", "context/payload.mass": "60.0",
        "metrics/tip_error_rms": "0.2", "metrics/settling_time": "",
    }  # fmt: skip
    assert json.loads(files[1].read_text()) == {"seed": 3}


def test_parquet_records_carry_their_settings(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    (path,) = write_records(tmp_path / "e.parquet", [_flight()], settings={"seed": 3})
    table = parquet.read_table(path)
    assert table.column("metrics/tip_error_rms").to_pylist() == [0.1, 0.2]
    assert json.loads(table.schema.metadata[b"drm_settings"]) == {"seed": 3}


def test_records_of_another_kind_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BaselineError, match="xlsx"):
        write_records(tmp_path / "e.xlsx", [_flight()], settings={})
