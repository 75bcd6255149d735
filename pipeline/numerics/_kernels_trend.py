"""Compiled recursions of `noise_model`: the innovations of a local level, in one pass each."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def whitened_gram(
    columns: NDArray[np.float64],
    observed: NDArray[np.bool_],
    jumps: NDArray[np.bool_],
    walk: float,
    white: float,
) -> tuple[NDArray[np.float64], float, int]:
    """Gram matrix of the whitened columns, the sum of log variances, and the number of rows used."""
    n, m = columns.shape
    gram = np.zeros((m, m))
    level = np.zeros(m)
    innovation = np.zeros(m)
    P = 0.5 * walk
    log_F = 0.0
    count = 0
    free = False
    for i in range(n):
        if i > 0:
            P += walk
        free = free or jumps[i]
        if not observed[i]:
            continue
        if free:  # the row only says where the level has jumped to
            for j in range(m):
                level[j] = columns[i, j]
            P = white
            free = False
            continue
        F = P + white
        K = P / F
        for j in range(m):
            innovation[j] = columns[i, j] - level[j]
            level[j] += K * innovation[j]
        for j in range(m):
            scaled = innovation[j] / F
            for k in range(j + 1):
                gram[j, k] += scaled * innovation[k]
        log_F += math.log(F)
        count += 1
        P = K * white  # P (1 - K)
    for j in range(m):
        for k in range(j):
            gram[k, j] = gram[j, k]
    return gram, log_F, count


@njit(cache=True)
def jump_statistics(
    residual: NDArray[np.float64],
    observed: NDArray[np.bool_],
    jumps: NDArray[np.bool_],
    walk: float,
    white: float,
) -> NDArray[np.float64]:
    """Standardised smoothed step of the level before each row; 0 where it is free already."""
    n = residual.size
    v = np.zeros(n)
    F = np.ones(n)
    K = np.zeros(n)
    used = np.zeros(n, dtype=np.bool_)
    freed = np.zeros(n, dtype=np.bool_)
    level = 0.0
    P = 0.5 * walk
    free = False
    for i in range(n):
        if i > 0:
            P += walk
        free = free or jumps[i]
        if not observed[i]:
            continue
        if free:
            level = residual[i]
            P = white
            free = False
            freed[i] = True
            continue
        F[i] = P + white
        K[i] = P / F[i]
        v[i] = residual[i] - level
        level += K[i] * v[i]
        P = K[i] * white
        used[i] = True
    statistic = np.zeros(n)
    r = 0.0
    N = 0.0
    for i in range(n - 1, 0, -1):
        if used[i]:
            r = v[i] / F[i] + (1.0 - K[i]) * r
            N = 1.0 / F[i] + (1.0 - K[i]) ** 2 * N
        elif freed[i]:
            r = 0.0
            N = 0.0
        if N > 0.0:
            statistic[i] = r / math.sqrt(N)
    return statistic
