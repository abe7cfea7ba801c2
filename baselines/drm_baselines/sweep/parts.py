"""The episodes of a sweep on disk: Parquet files, one a block, that together are one table.

    episodes/policy=linear/part-000000.parquet
    episodes/policy=linear/part-000001.parquet
    episodes/policy=lqr/part-000000.parquet

``pandas.read_parquet("episodes")`` (or Polars, DuckDB, pyarrow) reads all of them, with a column
``policy``. A file is there whole or not at all, and says in its metadata what it was made from.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.errors import RunError
from drm_baselines.support import storage
from drm_baselines.support.extras import needing
from drm_baselines.sweep.request import Block

EPISODES = "episodes"
_DIGEST = b"drm_sweep"

Columns = dict[str, NDArray[Any]]


def folder_of(directory: Path, policy: str) -> Path:
    """Return where the episodes of a policy are."""
    return directory / EPISODES / f"policy={policy}"


def part_of(directory: Path, block: Block) -> Path:
    """Return the file of a block."""
    return folder_of(directory, block.policy) / f"part-{block.index:06d}.parquet"


def write_part(path: Path, columns: Mapping[str, NDArray[Any]], digest: str) -> Path:
    """Write the columns of a block, replacing an older file in one rename."""
    pyarrow, parquet = _parquet()
    table = pyarrow.table(dict(columns)).replace_schema_metadata({_DIGEST: digest.encode()})
    with storage.atomic_path(path, overwrite=True) as temporary:
        parquet.write_table(table, temporary, compression="zstd")
    return path


def is_there(path: Path, block: Block, digest: str) -> bool:
    """Return whether a block has been flown and its file is whole."""
    pyarrow, parquet = _parquet()
    try:
        found = parquet.read_metadata(path)
    except (OSError, ValueError, pyarrow.ArrowException):
        return False
    made_from = (found.metadata or {}).get(_DIGEST, b"")
    return bool(found.num_rows == block.episodes and made_from == digest.encode())


def read_columns(directory: Path, blocks: Sequence[Block], names: Sequence[str]) -> Columns:
    """Return some columns of a policy's blocks, in the order of the episodes.

    Raises
    ------
    RunError
        A file that is missing or damaged.
    """
    pyarrow, parquet = _parquet()
    pieces: dict[str, list[NDArray[Any]]] = {name: [] for name in names}
    for block in blocks:
        path = part_of(directory, block)
        try:
            table = parquet.read_table(path, columns=list(names), partitioning=None)
        except (OSError, ValueError, pyarrow.ArrowException) as error:
            raise RunError(f"{path} cannot be read: {error}") from error
        for name in names:
            pieces[name].append(table[name].to_numpy())
    return {name: np.concatenate(found) for name, found in pieces.items()}


def _parquet() -> tuple[Any, Any]:
    with needing("the episodes of a sweep", "report"):
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
