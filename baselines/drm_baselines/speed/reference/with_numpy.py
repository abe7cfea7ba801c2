"""Closed-loop episodes in NumPy: every operation over all episodes at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drm_baselines.speed.reference.model import (
    PIECES,
    ROOT_LIMIT,
    TIP_LIMIT,
    Payloads,
    advance,
    coefficients,
    law,
    legs,
    slope,
)


def fly(payloads: Payloads, samples: int) -> NDArray[np.float64]:
    """Fly the thesis manoeuvre under the Lyapunov law, a decision every 2 ms.

    The length of the arm is the same in all episodes, so what depends on it alone is computed
    once and not per episode.

    Returns
    -------
    state
        theta, alpha, beta and their rates after the last sample, shape (6, episodes).
    """
    plan = legs(samples)
    m, lp, j, mr, jr = payloads.columns()
    zeros = np.zeros(len(payloads))
    y: tuple[Any, ...] = (zeros,) * 6
    before: tuple[Any, Any] = (zeros, zeros)
    root = tip = zeros
    started = 0.0

    def instant(piece: int, u: float) -> tuple[Any, ...]:
        _, _, rate, accel, a, ad, add = PIECES[piece]
        return coefficients(
            a + u * (ad + 0.5 * u * add), ad + u * add, add, rate + u * accel, accel,
            m, lp, j, mr, jr,
        )  # fmt: skip

    for piece, begin, h, steps, first in zip(
        plan.piece.tolist(), plan.begin.tolist(), plan.h.tolist(), plan.steps.tolist(),
        plan.first.tolist(), strict=True,
    ):  # fmt: skip
        if first:
            _, angle, rate, accel, a, ad, add = PIECES[piece]
            root, tip, error_rate, beta_rate = law(
                y,
                angle + begin * (rate + 0.5 * begin * accel),
                rate + begin * accel,
                a + begin * (ad + 0.5 * begin * add),
                mr,
                jr,
                before,
                started,
            )
            root, tip = root.clip(-ROOT_LIMIT, ROOT_LIMIT), tip.clip(-TIP_LIMIT, TIP_LIMIT)
            before, started = (error_rate, beta_rate), 1.0
        now = instant(piece, begin)
        for step in range(steps):
            u = begin + step * h
            middle, end = instant(piece, u + 0.5 * h), instant(piece, u + h)
            k1 = slope(now, y, root, tip)
            k2 = slope(middle, advance(y, 0.5 * h, k1), root, tip)
            k3 = slope(middle, advance(y, 0.5 * h, k2), root, tip)
            k4 = slope(end, advance(y, h, k3), root, tip)
            y = tuple(
                value + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
                for value, a1, a2, a3, a4 in zip(y, k1, k2, k3, k4, strict=True)
            )
            now = end
    return np.stack(np.broadcast_arrays(*y))
