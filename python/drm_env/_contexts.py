"""The true contexts of a batch, which change at resets alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_env import _engine
from drm_env._infos import CONTEXT_KEYS, finite

Row = NDArray[np.float64]


class Contexts:
    """A row of shape (num_envs,) a parameter, in the order of the keys of the info.

    What is the same in every sub-environment is kept once (as a view whose entries are one number).
    Rows are read-only and never written again: what changes is a new object that shares the others.
    """

    def __init__(
        self, num_envs: int, rows: list[Row] | None = None, shown: list[Row] | None = None
    ) -> None:
        """Of ``num_envs`` sub-environments; zero everywhere without ``rows``.

        ``shown`` are the rows as an info has them, which is without infinite limits.
        """
        self._num_envs = num_envs
        self.rows = [self._same(0.0)] * len(CONTEXT_KEYS) if rows is None else rows
        self.shown = [self._finite(row) for row in self.rows] if shown is None else shown

    def _finite(self, row: Row) -> Row:
        return row if np.isfinite(row.max()) else self._packed(finite(row))

    def _same(self, value: float) -> Row:
        return np.broadcast_to(np.float64(value), (self._num_envs,))

    def _packed(self, row: Row) -> Row:
        if (row == row[0]).all():
            return self._same(row[0])
        row = row.copy()
        row.flags.writeable = False
        return row

    def read(self, engine: _engine.Batch) -> Contexts:
        """The contexts of all sub-environments as the engine has them."""
        whole = np.empty((len(CONTEXT_KEYS), self._num_envs))
        engine.contexts(whole)
        return Contexts(self._num_envs, [self._packed(row) for row in whole])

    def after_resets(self, engine: _engine.Batch) -> Contexts:
        """These contexts with those of the sub-environments that began an episode just now."""
        places, values = engine.began_contexts()
        rows, shown = list(self.rows), list(self.shown)
        for index, (row, new) in enumerate(zip(self.rows, values, strict=True)):
            if (row[places] != new).any():
                changed = row.copy()
                changed[places] = new
                rows[index] = self._packed(changed)
                shown[index] = self._finite(rows[index])
        return Contexts(self._num_envs, rows, shown)

    def matrix(self) -> NDArray[np.float64]:
        """All rows as the engine has them, shape (parameters, num_envs), read-only."""
        matrix = np.stack(self.rows)
        matrix.flags.writeable = False
        return matrix

    def info(self, index: int) -> dict[str, Any]:
        """The context of one sub-environment by the keys of the info."""
        return {key: float(row[index]) for key, row in zip(CONTEXT_KEYS, self.shown, strict=True)}

    def infos(self) -> list[dict[str, Any]]:
        """`info` of each sub-environment."""
        columns = zip(*(row.tolist() for row in self.shown), strict=True)
        return [dict(zip(CONTEXT_KEYS, column, strict=True)) for column in columns]
