"""Compiled recursion of the rows of cumulative least squares."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]


@njit(cache=True)
def recur(transitions: Float, steps: Float, rows: Float) -> None:
    """``rows[j + 1] = transitions[j] @ rows[j] + steps[j]``; the first rows are given.

    Shapes (n - 1, 2, 2), (n - 1, 2, k) and (n, 2, k).
    """
    for j in range(steps.shape[0]):
        p11, p12 = transitions[j, 0, 0], transitions[j, 0, 1]
        p21, p22 = transitions[j, 1, 0], transitions[j, 1, 1]
        for k in range(steps.shape[2]):
            upper, lower = rows[j, 0, k], rows[j, 1, k]
            rows[j + 1, 0, k] = p11 * upper + p12 * lower + steps[j, 0, k]
            rows[j + 1, 1, k] = p21 * upper + p22 * lower + steps[j, 1, k]
