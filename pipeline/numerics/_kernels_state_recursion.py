"""Compiled recursion of a linear system with noise."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]


@njit(cache=True)
def first_state(Phi: Float, L: Float, start: Float, white: Float, output: Float) -> None:
    """``x_0 = start, x_(j+1) = Phi x_j + L w_j``; the first state to ``output``.

    Parameters
    ----------
    Phi, L : ndarray, shape (d, d)
        L lower triangular.
    start : ndarray, shape (d,)
    white : ndarray, shape (n - 1, d)
    output : ndarray, shape (n,)
        Filled.
    """
    d = len(start)
    x, following = start.copy(), np.empty(d)
    output[0] = x[0]
    for j in range(len(white)):
        for a in range(d):
            value = 0.0
            for b in range(d):
                value += Phi[a, b] * x[b]
            for b in range(a + 1):
                value += L[a, b] * white[j, b]
            following[a] = value
        x[:] = following
        output[j + 1] = x[0]
