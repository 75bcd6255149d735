"""The compiled reflection by which square-root filters keep a factor triangular.

A factor S of a covariance, ``P = S S^T``, is kept by columns, ``W[c]`` is column c of S: a reflection from
the right mixes columns and leaves P as it is (T. Kailath, A. H. Sayed, B. Hassibi, *Linear Estimation*, 2000,
ch. 12). Sums are in the order of the loops, so that the bits are the same on every machine.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def reflect(W: Float, i: int, begin: int, end: int, width: int, work: Float) -> None:
    """Zero element i of the rows ``begin`` to ``end`` of W against row i; rows are ``width`` long."""
    squares = 0.0
    for c in range(begin, end):
        squares += W[c, i] * W[c, i]
    if squares == 0.0:
        return
    pivot = W[i]
    diagonal = -math.copysign(math.sqrt(pivot[i] * pivot[i] + squares), pivot[i])
    lead = pivot[i] - diagonal
    # v = (lead, W[begin:end, i]), 2/(v.v) = -1/(diagonal lead)
    scale = -1.0 / (diagonal * lead)
    for r in range(i + 1, width):
        work[r] = lead * pivot[r]
    for c in range(begin, end):
        w = W[c]
        v = w[i]
        for r in range(i + 1, width):
            work[r] += v * w[r]
    for r in range(i + 1, width):
        work[r] *= scale
    pivot[i] = diagonal
    for r in range(i + 1, width):
        pivot[r] -= lead * work[r]
    for c in range(begin, end):
        w = W[c]
        v = w[i]
        w[i] = 0.0
        for r in range(i + 1, width):
            w[r] -= v * work[r]
