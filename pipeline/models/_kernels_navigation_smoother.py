"""Compiled loop of `pipeline.models.navigation_smoother`, from the last node to the first.

States and factors as in `pipeline.models._kernels_error_state`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.models._kernels_error_state import deviations, propagate, put_noise, triangularise
from pipeline.models._kernels_strapdown import (
    matrix_from_quaternion,
    radii,
    rotation_vector,
    turn_left,
)
from pipeline.numerics._kernels_householder import reflect

Float = NDArray[np.float64]

_EPS = float(np.finfo(np.float64).eps)


@njit(cache=True, error_model="numpy")
def joint_factor(
    W: Float, n: int, factor: Float, Phi: Float, decay: Float, diagonal: Float, sensors: Float, work: Float
) -> int:
    """Triangular factor of the state predicted at a node and that at the node before it, together.

    ``W (2 n + 6, 2 n)`` gets, by columns, ``[[A, 0], [B, C]]`` with ``A A^T`` the covariance of what is
    predicted, ``B A^T`` that between the two and ``B B^T + C C^T`` that before. Returns the number of
    columns.
    """
    predicted = W[:, :n]
    for c in range(n):
        for r in range(n):
            W[c, r] = W[c, n + r] = factor[c, r]
    propagate(predicted, n, Phi, decay, work)
    noises = put_noise(predicted, n, diagonal, sensors)
    for c in range(n, n + noises):
        for r in range(n, 2 * n):
            W[c, r] = 0.0
    triangularise(W, n, 2 * n, diagonal, noises, work)
    return n + noises


@njit(cache=True, error_model="numpy")
def negligible(W: Float, n: int, tolerance: Float) -> None:
    """What is rounding on the diagonal of A: n eps times the size of its row."""
    for r in range(n):
        squares = 0.0
        for c in range(r + 1):
            squares += W[c, r] * W[c, r]
        tolerance[r] = n * _EPS * math.sqrt(squares)


@njit(cache=True, error_model="numpy")
def regress(W: Float, n: int, begin: int, tolerance: Float, v: Float) -> None:
    """``v[n:] = B A^-1 v[:n]`` by forward substitution; ``v[:begin]`` is zero, ``v[:n]`` is overwritten.

    A direction in which A has no size has no deviation to explain: it is left out.
    """
    for r in range(n, 2 * n):
        v[r] = 0.0
    for c in range(begin, n):
        column = W[c]
        if abs(column[c]) > tolerance[c]:
            share = v[c] / column[c]
            for r in range(c + 1, n):
                v[r] -= share * column[r]
            for r in range(n, 2 * n):
                v[r] += share * column[r]


@njit(cache=True, error_model="numpy")
def difference(
    before: Float, slow_before: Float, position: Float, velocity: Float, C: Float, slow: Float, out: Float
) -> None:
    """Fill out with the error of ``before`` (position, velocity, quaternion) against another whole state."""
    n = out.size
    meridian, prime_vertical = radii(0.5 * (position[0] + before[0]), 0.5 * (position[2] + before[2]))
    for r in range(n - 9):
        out[r] = slow[r] - slow_before[r]
    then, turn = np.empty((3, 3)), np.empty((3, 3))
    matrix_from_quaternion(before[6:], then)
    for i in range(3):
        for j in range(3):
            turn[i, j] = C[i, 0] * then[j, 0] + C[i, 1] * then[j, 1] + C[i, 2] * then[j, 2]
    rotated = rotation_vector(turn)
    for i in range(3):
        out[n - 9 + i] = rotated[i]
        out[n - 6 + i] = velocity[i] - before[3 + i]
    turned = position[1] - before[1]
    turned -= 2.0 * math.pi * np.round(turned / (2.0 * math.pi))
    out[n - 3] = (position[0] - before[0]) * meridian
    out[n - 2] = turned * prime_vertical * math.cos(0.5 * (position[0] + before[0]))
    out[n - 1] = before[2] - position[2]


@njit(cache=True, error_model="numpy")
def corrected(
    x: Float,
    position_at: Float,
    velocity_at: Float,
    quaternion_at: Float,
    slow_at: Float,
    position: Float,
    velocity: Float,
    C: Float,
    slow: Float,
) -> None:
    """Fill a whole state, the last four, with another put right by its error x."""
    n = x.size
    for r in range(n - 9):
        slow[r] = slow_at[r] + x[r]
    matrix_from_quaternion(quaternion_at, C)
    turn_left(C, x[n - 9], x[n - 8], x[n - 7])
    meridian, prime_vertical = radii(position_at[0], position_at[2])
    middle = position_at[0] + 0.5 * x[n - 3] / meridian
    for i in range(3):
        velocity[i] = velocity_at[i] + x[n - 6 + i]
    position[0] = position_at[0] + x[n - 3] / meridian
    position[1] = position_at[1] + x[n - 2] / (prime_vertical * math.cos(middle))
    position[2] = position_at[2] - x[n - 1]


@njit(cache=True, error_model="numpy")
def smooth_nodes(
    node_time: Float,
    rate: Float,
    path: tuple[Float, Float, Float],
    slow: Float,
    history: tuple[Float, Float, Float, Float, Float],
    error_after: Float,
    error_before: Float,
    sigma: Float,
    factors: Float,
) -> None:
    """Smooth all K nodes.

    Parameters
    ----------
    node_time : ndarray, shape (K,)
    rate : ndarray, shape (n - 9,)
        As in `States`.
    path : position, velocity (K, 3), quaternion (K, 4)
        The filter's, measurements taken in.
    slow : ndarray, shape (K, n - 9)
        The filter's states before φ, likewise.
    history : as in `History`
    error_after, error_before : ndarray, shape (K, n)
        Get the smoothed errors of the filter's state after and before the measurements of each node.
    sigma : ndarray, shape (K, n)
        Gets the standard deviations.
    factors : ndarray, shape (K, n, n) or (0, n, n)
        Gets the factors of the covariance, by columns, unless it is empty.
    """
    before, factor, transition, sensors, diagonal = history
    K, n = error_after.shape
    m = n - 15
    W, S, work = np.zeros((2 * n + 6, 2 * n)), np.zeros((2 * n + 6, n)), np.empty(2 * n)
    decay, tolerance, v = np.ones(m), np.empty(n), np.zeros(2 * n)
    position, velocity, C = np.empty(3), np.empty(3), np.empty((3, 3))
    whole, predicted = slow[K - 1].copy(), np.empty(n - 9)
    S[:n] = factor[K - 1]
    keep = len(factors) > 0
    for k in range(K - 1, -1, -1):
        if k < K - 1:
            for r in range(m):
                decay[r] = math.exp(-rate[r] * (node_time[k + 1] - node_time[k]))
            columns = joint_factor(
                W, n, factor[k], transition[k + 1], decay, diagonal[k + 1], sensors[k + 1], work
            )
            negligible(W, n, tolerance)
            for r in range(n - 9):
                predicted[r] = slow[k, r] * (decay[r] if r < m else 1.0)
            difference(before[k + 1], predicted, position, velocity, C, whole, v[:n])
            error_before[k + 1] = v[:n]
            regress(W, n, 0, tolerance, v)
            error_after[k] = v[n:]
            carry_back(W, S, n, columns, tolerance, v, work)
        else:
            error_after[k] = 0.0
        corrected(error_after[k], path[0][k], path[1][k], path[2][k], slow[k], position, velocity, C, whole)
        deviations(S, n, sigma[k])
        if keep:
            factors[k] = S[:n]
    difference(before[0], slow[0], position, velocity, C, whole, error_before[0])


@njit(cache=True, error_model="numpy")
def carry_back(W: Float, S: Float, n: int, columns: int, tolerance: Float, v: Float, work: Float) -> None:
    """``S <- [B A^-1 S, C]``, made lower triangular by reflections from the right."""
    for c in range(n):
        v[:n] = S[c]
        regress(W, n, c, tolerance, v)
        S[c] = v[n:]
    for c in range(n, columns):
        S[c] = W[c, n:]
    for i in range(n):
        reflect(S, i, i + 1, columns, n, work)
