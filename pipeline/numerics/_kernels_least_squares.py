"""Compiled orthogonal factorisation of tall matrices."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]


@njit(cache=True, fastmath={"reassoc", "contract"})
def factorise(rows: Float, R: Float, block: Float) -> None:
    """Take all rows (n, k) into the triangle R (k, k), block by block, by Householder's reflections.

    A reflection of column j acts on row j of R and on the block alone, for the rest of R's column is zero.
    ``block``, shape (k, size), is workspace: a column a row, so that the inner loops run along memory.
    """
    n, k = rows.shape
    size = block.shape[1]
    for first in range(0, n, size):
        count = min(size, n - first)
        for i in range(count):
            for c in range(k):
                block[c, i] = rows[first + i, c]
        for j in range(k):
            v = block[j, :count]
            below = 0.0
            for i in range(count):
                below += v[i] * v[i]
            if below == 0.0:
                continue
            head = R[j, j]
            norm = np.sqrt(head * head + below)
            if head > 0.0:
                norm = -norm
            u = head - norm
            R[j, j] = norm
            scale = -1.0 / (u * norm)  # 2 / |(u, v)|^2
            for c in range(j + 1, k):
                column = block[c, :count]
                dot = u * R[j, c]
                for i in range(count):
                    dot += v[i] * column[i]
                dot *= scale
                R[j, c] -= dot * u
                for i in range(count):
                    column[i] -= dot * v[i]
