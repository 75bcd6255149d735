"""Compiled loops of the interpolants.

Samples are one row a channel, ``(channels, n)``; coefficients of a piecewise polynomial are
``(channels, pieces, degree + 1)`` in ascending powers of u = (t - t_i)/(t_{i+1} - t_i).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def local_coefficients(t: Float, y: Float, degree: int, coefficients: Float) -> None:
    """Coefficients of the local polynomials: see `pipeline.numerics.local_polynomial`.

    Newton's divided differences on the nodes of each interval, then the change to powers of u by
    Horner's rule.
    """
    lead = (degree - 1) // 2
    nodes = np.empty(degree + 1)
    newton = np.empty(degree + 1)
    power = np.empty(degree + 1)
    for i in range(t.size - 1):
        first = min(max(i - lead, 0), t.size - 1 - degree)
        h = t[i + 1] - t[i]
        for k in range(degree + 1):
            nodes[k] = (t[first + k] - t[i]) / h
        for channel in range(y.shape[0]):
            for k in range(degree + 1):
                newton[k] = y[channel, first + k]
                power[k] = 0.0
            for order in range(1, degree + 1):
                for k in range(degree, order - 1, -1):
                    newton[k] = (newton[k] - newton[k - 1]) / (nodes[k] - nodes[k - order])
            power[0] = newton[degree]
            for k in range(degree - 1, -1, -1):
                # power ← power (u - nodes[k]) + newton[k]
                for j in range(degree - k, 0, -1):
                    power[j] = power[j - 1] - nodes[k] * power[j]
                power[0] = newton[k] - nodes[k] * power[0]
            for k in range(degree + 1):
                coefficients[channel, i, k] = power[k]


@njit(cache=True, error_model="numpy")
def sample_piecewise(
    breaks: Float, coefficients: Float, times: Float, values: Float, increments: Float
) -> None:
    """Values at ascending times, and integrals from each time to the next, piece by piece.

    Times outside the breaks belong to the first or the last piece, which is continued.
    """
    channels, pieces, order = coefficients.shape
    for channel in range(channels):
        piece = 0
        before = 0.0  # integral from the piece's start to the time before
        for row in range(times.size):
            total = 0.0
            while piece < pieces - 1 and times[row] >= breaks[piece + 1]:
                if row > 0:
                    c = coefficients[channel, piece]
                    whole = 0.0
                    for k in range(order - 1, -1, -1):
                        whole += c[k] / (k + 1)
                    total += whole * (breaks[piece + 1] - breaks[piece]) - before
                    before = 0.0
                piece += 1
            h = breaks[piece + 1] - breaks[piece]
            u = (times[row] - breaks[piece]) / h
            c = coefficients[channel, piece]
            value = 0.0
            integral = 0.0
            for k in range(order - 1, -1, -1):
                value = value * u + c[k]
                integral = integral * u + c[k] / (k + 1)
            integral *= u * h
            values[channel, row] = value
            increments[channel, row] = total + integral - before if row > 0 else 0.0
            before = integral


@njit(cache=True, error_model="numpy")
def increments_uniform(y: Float, weights: tuple[float, ...], lead: int, increments: Float) -> None:
    """Increments over the inner intervals of one channel: weights · y[i - lead …], i = lead ….

    ``y`` and ``increments`` are one channel; the increment over [i, i+1] goes to row i + 1. The weights
    are a tuple, so that their number is known to the compiler and the loop over them is unrolled.
    """
    inner = increments[lead + 1 :]  # counted from its first row, the loop is vectorised
    for i in range(y.size + 1 - len(weights)):
        total = 0.0
        for k in range(len(weights)):
            total += weights[k] * y[i + k]
        inner[i] = total


@njit(cache=True, error_model="numpy")
def steps_within(t: Float, step: float, tolerance: float) -> bool:
    """Whether every step of t is the given one within the tolerance."""
    outside = 0  # counted, not returned at the first: only so is the loop vectorised
    for i in range(t.size - 1):
        outside += not abs(t[i + 1] - t[i] - step) <= tolerance
    return outside == 0
