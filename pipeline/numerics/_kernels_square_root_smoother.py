"""Compiled loops of `pipeline.numerics.square_root_smoother`.

States lie as in `pipeline.numerics._kernels_square_root_filter`: by columns, the parameters first, those with
process noise after those without it, the two measured rows last.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.numerics._kernels_square_root_filter import propagate, spread, take_in

Float = NDArray[np.float64]
Integer = NDArray[np.int64]
Mask = NDArray[np.bool_]

_EPS = float(np.finfo(np.float64).eps)


@njit(cache=True, error_model="numpy")
def predict_samples(
    x: Float,
    W: Float,
    transition: Float,
    drive: Float,
    offset: Float,
    noise: Float,
    measurement: Float,
    measured: Mask,
    variance: Float,
    means: Float,
    joint: Float,
) -> None:
    """Filter on from a sample, and keep what is predicted of each after it.

    The arrays begin with that sample, x and W are its state. W, ``(n + m, n + m)``, has m further rows for
    the process noise, so that ``joint`` gets the factor of the predicted state and of the step of the noise.
    """
    n = x.size
    work = np.empty((4, W.shape[1]))
    innovations = np.empty(2)
    for j in range(len(drive)):
        propagate(x, W, transition[j], drive[j], offset[j])
        if noise.shape[1] > 0:
            spread(W, n, noise[j], work[0])
        means[j] = x
        joint[j] = W
        if measured[j + 1]:
            take_in(x, W, measurement[j + 1], variance, work, innovations)


@njit(cache=True, error_model="numpy")
def smooth_samples(
    x: Float,
    W: Float,
    transition: Float,
    drive: Float,
    offset: Float,
    noise: Float,
    means: Float,
    joint: Float,
    rows: Float,
) -> None:
    """Go back from the smoothed state of a block's last sample, ``W (n + m, n)``, to that of its first.

    ``means`` and ``joint`` are from `predict_samples`; ``rows`` gets the smoothed means of the measured rows.
    """
    n = x.size
    work = np.empty((2, max(joint.shape[2], n)))
    rows[len(drive)] = x[n - 2 :]
    for j in range(len(drive) - 1, -1, -1):
        if np.any(noise[j] > 0.0):
            take_back(x, W, means[j], joint[j], work)
        move_back(x, W, transition[j], drive[j], offset[j])
        rows[j] = x[n - 2 :]


@njit(cache=True, error_model="numpy")
def take_back(x: Float, W: Float, mean: Float, joint: Float, work: Float) -> None:
    """From the smoothed state after a step w of the process noise to that before it.

    The predicted state and w have the joint factor ``[[A, 0], [B, C]]``, so that given the state w is
    ``N(B A^-1 (x - mean), C C^T)``, and what is smoothed before it is::

        x <- x - Gamma B A^-1 (x - mean),   S <- [S - Gamma B A^-1 S, -Gamma C]
    """
    n = x.size
    m = W.shape[0] - n
    first = n - 2 - m
    tolerance, v = work[0], work[1]
    negligible(joint, n, tolerance)
    v[:n] = x - mean
    regress(joint, n, 0, tolerance, v)
    for q in range(m):
        x[first + q] += v[n + q]
    for c in range(n):
        v[:n] = W[c]
        regress(joint, n, min(c, first), tolerance, v)
        for q in range(m):
            W[c, first + q] += v[n + q]
    for c in range(m):
        W[n + c] = 0.0
        for q in range(m):
            W[n + c, first + q] = -joint[n + c, n + q]
    triangularise(W, first, n, v)


@njit(cache=True, error_model="numpy")
def negligible(joint: Float, n: int, tolerance: Float) -> None:
    """What is rounding on the diagonal of A: n eps times the size of its row."""
    for r in range(n):
        squares = 0.0
        for c in range(r + 1):
            squares += joint[c, r] * joint[c, r]
        tolerance[r] = n * _EPS * np.sqrt(squares)


@njit(cache=True, error_model="numpy")
def regress(joint: Float, n: int, begin: int, tolerance: Float, v: Float) -> None:
    """``v[n:] = -B A^-1 v[:n]`` for the joint factor ``[[A, 0], [B, C]]``, by forward substitution.

    ``v[:begin]`` is zero. A direction in which A has no size has no deviation to explain: it is left out.
    """
    end = joint.shape[1]
    for r in range(n, end):
        v[r] = 0.0
    for c in range(begin, n):
        column = joint[c]
        if abs(column[c]) > tolerance[c]:
            share = v[c] / column[c]
            for r in range(c + 1, end):
                v[r] -= share * column[r]


@njit(cache=True, error_model="numpy")
def triangularise(W: Float, first: int, n: int, work: Float) -> None:
    """Make columns ``first`` on of a factor lower triangular, by Householder reflections from the right.

    Rows before ``first`` are zero in them; those after the first n become zero.
    """
    for i in range(first, n):
        squares = 0.0
        for c in range(i + 1, len(W)):
            squares += W[c, i] * W[c, i]
        if squares == 0.0:
            continue
        diagonal = -np.copysign(np.sqrt(W[i, i] * W[i, i] + squares), W[i, i])
        W[i, i] -= diagonal
        scale = -1.0 / (diagonal * W[i, i])
        for r in range(i + 1, n):
            work[r] = 0.0
        for c in range(i, len(W)):
            w = W[c]
            v = scale * w[i]
            for r in range(i + 1, n):
                work[r] += v * w[r]
        for c in range(i, len(W)):
            w = W[c]
            v = w[i]
            w[i] = 0.0
            for r in range(i + 1, n):
                w[r] -= v * work[r]
        W[i, i] = diagonal


@njit(cache=True, error_model="numpy")
def move_back(x: Float, W: Float, transition: Float, drive: Float, offset: Float) -> None:
    """The inverse of a transition: ``a <- Phi^-1 (a - F p - d)``, in the factor without d."""
    n = x.size
    k = n - 2
    p00, p01, p10, p11 = transition[0, 0], transition[0, 1], transition[1, 0], transition[1, 1]
    determinant = p00 * p11 - p01 * p10
    a0, a1 = x[k] - offset[0], x[k + 1] - offset[1]
    for i in range(k):
        a0 -= drive[0, i] * x[i]
        a1 -= drive[1, i] * x[i]
    x[k], x[k + 1] = (p11 * a0 - p01 * a1) / determinant, (p00 * a1 - p10 * a0) / determinant
    for c in range(n):
        w = W[c]
        a0, a1 = w[k], w[k + 1]
        for i in range(c, k):
            a0 -= drive[0, i] * w[i]
            a1 -= drive[1, i] * w[i]
        w[k], w[k + 1] = (p11 * a0 - p01 * a1) / determinant, (p00 * a1 - p10 * a0) / determinant
