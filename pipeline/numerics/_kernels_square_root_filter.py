"""Compiled loops of `pipeline.numerics.square_root_filter`.

The state has the k parameters first, those without process noise before those with it, and the two measured
rows last. A factor S of its covariance is kept by columns, ``W[c]`` is column c of S: the loops run over
adjacent numbers, and no sum is in an order of the compiler's choice, so that the bits are the same on every
machine. S is lower triangular save for its last 2 x 2 block, which a transition fills; every loop leaves
out what is zero by that. The columns after the first n take in the process noise.

W may have more rows than the state: they belong to the process noise itself, see
`pipeline.numerics._kernels_square_root_smoother`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.numerics._kernels_householder import reflect

Float = NDArray[np.float64]
Integer = NDArray[np.int64]
Mask = NDArray[np.bool_]


@njit(cache=True, error_model="numpy")
def propagate(x: Float, W: Float, transition: Float, drive: Float, offset: Float) -> None:
    """``a <- Phi a + F p + d`` in the mean, and without d in each column of the factor."""
    n = x.size
    k = n - 2
    p00, p01, p10, p11 = transition[0, 0], transition[0, 1], transition[1, 0], transition[1, 1]
    f0, f1 = drive[0], drive[1]
    a0 = offset[0] + p00 * x[k] + p01 * x[k + 1]
    a1 = offset[1] + p10 * x[k] + p11 * x[k + 1]
    for i in range(k):
        a0 += f0[i] * x[i]
        a1 += f1[i] * x[i]
    x[k], x[k + 1] = a0, a1
    for c in range(n):
        w = W[c]
        a0 = p00 * w[k] + p01 * w[k + 1]
        a1 = p10 * w[k] + p11 * w[k + 1]
        for i in range(c, k):
            a0 += f0[i] * w[i]
            a1 += f1[i] * w[i]
        w[k], w[k + 1] = a0, a1


@njit(cache=True, error_model="numpy")
def spread(W: Float, n: int, noise: Float, work: Float) -> None:
    """Add process noise: ``[S, Gamma D] <- [S', 0]`` by Householder reflections from the right.

    ``noise`` is the diagonal of D, of the last parameters. To the right of its diagonal a row of S is zero,
    the last 2 x 2 block apart, so that a reflection mixes column i with those of the noise that have
    an entry in row i by then.
    """
    rows = W.shape[1]
    first = n - 2 - noise.size
    for c in range(first, n):
        for r in range(n, rows):
            W[c, r] = 0.0
    for q in range(noise.size):
        for r in range(rows):
            W[n + q, r] = 0.0
        W[n + q, first + q] = noise[q]
        if rows > n:
            W[n + q, n + q] = noise[q]
    for i in range(first, n):
        end = n + min(i - first + 1, noise.size)
        begin = n - 1 if i == n - 2 else n
        reflect(W, i, begin, end, rows, work)


@njit(cache=True, error_model="numpy")
def observe(x: Float, W: Float, row: int, innovation: float, variance: float, work: Float) -> float:
    """Take in a measurement of one row of the state by Carlson's update, which keeps S triangular.

    From the last column to the first, with f = S^T h and s = variance + sum f^2 so far::

        A = sqrt(s_before / s_after),  B = f / sqrt(s_before s_after)
        column <- A column - B b,      b <- b + f column

    At the end ``b = P h`` and s is the variance of the innovation, which is returned.
    """
    n = x.size
    f, A, B, b = work[0], work[1], work[2], work[3]
    s = variance
    for c in range(n - 1, -1, -1):
        f[c] = W[c, row]
        A[c] = s
        s += f[c] * f[c]
        B[c] = s
    for c in range(n):
        after = B[c]
        A[c] = math.sqrt(A[c] / after)
        B[c] = f[c] / (A[c] * after)
        b[c] = 0.0
    for c in range(n - 1, -1, -1):
        w = W[c]
        fc, Ac, Bc = f[c], A[c], B[c]
        for r in range(min(c, n - 2), n):
            before = w[r]
            w[r] = Ac * before - Bc * b[r]
            b[r] += fc * before
    share = innovation / s
    for r in range(n):
        x[r] += share * b[r]
    return s


@njit(cache=True, error_model="numpy")
def take_in(x: Float, W: Float, y: Float, variance: Float, work: Float, innovations: Float) -> float:
    """Both measurements of a sample; returns their log-likelihood."""
    likelihood = 0.0
    for i in range(2):
        row = x.size - 2 + i
        innovation = y[i] - x[row]
        s = observe(x, W, row, innovation, variance[i], work)
        innovations[i] = innovation / math.sqrt(s)
        likelihood -= 0.5 * (innovations[i] * innovations[i] + math.log(2.0 * math.pi * s))
    return likelihood


@njit(cache=True, error_model="numpy")
def filter_samples(
    x: Float,
    W: Float,
    transition: Float,
    drive: Float,
    offset: Float,
    noise: Float,
    measurement: Float,
    measured: Mask,
    variance: Float,
    instants: Integer,
    means: Float,
    factors: Float,
    innovations: Float,
) -> float:
    """Filter all samples; x and W are the state before the first, and become that after the last.

    At the ascending ``instants`` the state, its measurement taken in, goes to ``means`` and, by columns, to
    ``factors``. Returns the log-likelihood.
    """
    n = x.size
    work = np.empty((4, n))
    likelihood = 0.0
    kept = 0
    for j in range(measured.size):
        if j > 0:
            propagate(x, W, transition[j - 1], drive[j - 1], offset[j - 1])
            if noise.shape[1] > 0:
                spread(W, n, noise[j - 1], work[0])
        if measured[j]:
            likelihood += take_in(x, W, measurement[j], variance, work, innovations[j])
        if kept < instants.size and instants[kept] == j:
            means[kept] = x
            for c in range(n):
                factors[kept, c] = W[c]
            kept += 1
    return likelihood
