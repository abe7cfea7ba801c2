"""Closed-loop episodes compiled by numba: one episode after the other, on every core.

Importing this module needs numba, which the extra ``bench`` installs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.speed.reference import model
from drm_baselines.speed.reference.model import (
    ROOT_LIMIT,
    TIP_LIMIT,
    Payloads,
    legs,
)
from drm_baselines.support.extras import needing

with needing("the section rollout", "bench"):
    import numba

_compile = numba.njit(fastmath=True, inline="never")
_coefficients: Any = _compile(model.coefficients)
_slope: Any = _compile(model.slope)
_advance: Any = _compile(model.advance)
_law: Any = _compile(model.law)


@numba.njit(fastmath=True)
def _instant(piece: Any, u: float, payload: Any) -> Any:
    a, ad, add = piece[4], piece[5], piece[6]
    return _coefficients(
        a + u * (ad + 0.5 * u * add), ad + u * add, add, piece[2] + u * piece[3], piece[3],
        payload[0], payload[1], payload[2], payload[3], payload[4],
    )  # fmt: skip


@numba.njit(fastmath=True)
def _episode(
    payload: Any, pieces: Any, index: Any, begin: Any, h: Any, steps: Any, first: Any
) -> Any:
    y = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    before = (0.0, 0.0)
    root, tip, started = 0.0, 0.0, 0.0
    for leg in range(index.size):
        piece, b, dt = pieces[index[leg]], begin[leg], h[leg]
        if first[leg]:
            root, tip, error_rate, beta_rate = _law(
                y,
                piece[1] + b * (piece[2] + 0.5 * b * piece[3]),
                piece[2] + b * piece[3],
                piece[4] + b * (piece[5] + 0.5 * b * piece[6]),
                payload[3],
                payload[4],
                before,
                started,
            )
            root = min(max(root, -ROOT_LIMIT), ROOT_LIMIT)
            tip = min(max(tip, -TIP_LIMIT), TIP_LIMIT)
            before, started = (error_rate, beta_rate), 1.0
        now = _instant(piece, b, payload)
        for step in range(steps[leg]):
            u = b + step * dt
            middle = _instant(piece, u + 0.5 * dt, payload)
            end = _instant(piece, u + dt, payload)
            k1 = _slope(now, y, root, tip)
            k2 = _slope(middle, _advance(y, 0.5 * dt, k1), root, tip)
            k3 = _slope(middle, _advance(y, 0.5 * dt, k2), root, tip)
            k4 = _slope(end, _advance(y, dt, k3), root, tip)
            y = _advance(y, dt / 6.0, k1)
            y = _advance(y, dt / 3.0, k2)
            y = _advance(y, dt / 3.0, k3)
            y = _advance(y, dt / 6.0, k4)
            now = end
    return y


@numba.njit(parallel=True, fastmath=True)
def _all(
    payloads: Any, pieces: Any, index: Any, begin: Any, h: Any, steps: Any, first: Any, out: Any
) -> None:
    for episode in numba.prange(payloads.shape[0]):
        y = _episode(payloads[episode], pieces, index, begin, h, steps, first)
        for row in range(6):
            out[row, episode] = y[row]


def fly(payloads: Payloads, samples: int) -> NDArray[np.float64]:
    """Fly the thesis manoeuvre under the Lyapunov law, a decision every 2 ms.

    The first call compiles. Returns theta, alpha, beta and their rates after the last sample,
    shape (6, episodes).
    """
    plan = legs(samples)
    out = np.empty((6, len(payloads)))
    _all(
        np.ascontiguousarray(np.column_stack(payloads.columns())), np.array(model.PIECES),
        plan.piece, plan.begin, plan.h, plan.steps, plan.first, out,
    )  # fmt: skip
    return out


def threads() -> int:
    """Return the number of threads that numba uses."""
    return int(numba.get_num_threads())
