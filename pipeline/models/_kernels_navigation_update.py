"""Compiled update of an error-state filter of navigation by one measurement: gate, correction, doubt."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.models._kernels_error_state import observe
from pipeline.models._kernels_navigation_aids import (
    AIRSPEED,
    ALTITUDE,
    ATTITUDE,
    LAST_GNSS,
    POSITION,
    RESEAT_AFTER,
    SIDESLIP,
    VELOCITY,
    calibrated,
    measure,
    sideslip,
)
from pipeline.models._kernels_strapdown import radii, turn_left
from pipeline.models.navigation_states import SLOTS

Float = NDArray[np.float64]
Integer = NDArray[np.int64]
Nominal = tuple[Float, Float, Float, Float, Float]
"""Position, velocity, C, gyro and accelerometer bias, states before the fifteen."""

_BAROMETER_BIAS, _WIND = SLOTS.index("barometer_bias"), SLOTS.index("wind")


@njit(cache=True, error_model="numpy")
def expected(W: Float, n: int, H: Float, rows: int, variance: float, S: Float, F: Float) -> None:
    """Fill ``S (rows, rows)``, covariance of the innovation ``H P H^T + R``; F gets H times the factor."""
    for k in range(rows):
        for c in range(n):
            f = 0.0
            for r in range(c, n):
                f += H[k, r] * W[c, r]
            F[k, c] = f
        for j in range(k + 1):
            s = variance if j == k else 0.0
            for c in range(n):
                s += F[k, c] * F[j, c]
            S[k, j] = s


@njit(cache=True, error_model="numpy")
def squared(S: Float, z: Float, rows: int) -> float:
    """``z^T S^-1 z`` by Cholesky; the lower half of S is overwritten."""
    total = 0.0
    y = np.empty(3)
    for k in range(rows):
        for j in range(k + 1):
            s = S[k, j]
            for i in range(j):
                s -= S[k, i] * S[j, i]
            S[k, j] = math.sqrt(s) if j == k else s / S[j, j]
        v = z[k]
        for i in range(k):
            v -= S[k, i] * y[i]
        y[k] = v / S[k, k]
        total += y[k] * y[k]
    return total


@njit(cache=True, error_model="numpy")
def correct(nominal: Nominal, x: Float) -> None:
    """Add the estimated errors x to the nominal state."""
    position, velocity, C, bias, other = nominal
    m = other.size
    for r in range(m):
        other[r] += x[r]
    for r in range(6):
        bias[r] += x[m + r]
    turn_left(C, x[m + 6], x[m + 7], x[m + 8])
    meridian, prime_vertical = radii(position[0], position[2])
    for r in range(3):
        velocity[r] += x[m + 9 + r]
    middle = position[0] + 0.5 * x[m + 12] / meridian
    position[0] += x[m + 12] / meridian
    position[1] += x[m + 13] / (prime_vertical * math.cos(middle))
    position[2] -= x[m + 14]


@njit(cache=True, error_model="numpy")
def doubt(kind: int, z: Float, slots: Integer, jolt: Float) -> None:
    """Make uncertain what measurements refused in a row say to be wrong, by as much as they say."""
    n = jolt.size
    first, rows = -1, 3
    if kind == POSITION:
        first = n - 3
    elif kind == VELOCITY:
        first = n - 6
    elif kind == ATTITUDE:
        first = n - 9
    elif kind == ALTITUDE:
        first, rows = (slots[_BAROMETER_BIAS], 1) if slots[_BAROMETER_BIAS] >= 0 else (n - 1, 1)
    elif kind == AIRSPEED and slots[_WIND] >= 0:
        jolt[slots[_WIND]] = jolt[slots[_WIND] + 1] = abs(z[0])
    if first >= 0:
        for i in range(rows):
            jolt[first + i] = abs(z[i])


@njit(cache=True, error_model="numpy")
def take_in(
    event: int,
    time: float,
    events: tuple[Integer, Integer, Float, Float],
    nominal: Nominal,
    moved: Float,
    slots: Integer,
    options: Float,
    variance: Float,
    gate: Float,
    field: Float,
    W: Float,
    innovations: tuple[Float, Float, Float, Float],
    refused: Float,
    calibration: Float,
    jolt: Float,
) -> None:
    """Try one measurement against the gate, and correct state and factor by it."""
    n = W.shape[1]
    kind, lag, value = events[1][event], events[2][event], events[3][event]
    share = lag / moved[9] if moved[9] > 0.0 else 0.0
    if calibrated(kind, value, time, nominal, options, calibration):
        return
    z, H, F, S, x, b = (
        np.empty(3),
        np.empty((3, n)),
        np.empty((3, n)),
        np.empty((3, 3)),
        np.zeros(n),
        np.empty(n),
    )
    rows = measure(kind, value, lag, share, nominal, moved, slots, options, field, calibration, z, H)
    if rows == 0:
        return
    expected(W, n, H, rows, variance[kind], S, F)
    for k in range(rows):
        innovations[0][event, k], innovations[1][event, k] = z[k], math.sqrt(S[k, k])
    normalised = squared(S, z, rows)
    innovations[2][event] = normalised
    if not normalised <= gate[kind]:
        innovations[3][event] = 0.0
        refused[kind] += 1.0
        if refused[kind] == options[RESEAT_AFTER]:
            doubt(kind, z, slots, jolt)
            refused[kind] = 0.0
        return
    innovations[3][event] = 1.0
    refused[kind] = 0.0
    if kind in (POSITION, VELOCITY):
        calibration[LAST_GNSS] = time
    for k in range(rows):
        left = z[k]
        for r in range(n):
            left -= H[k, r] * x[r]
        observe(x, W, n, H[k], left, variance[kind], b)
    correct(nominal, x)
    if kind == AIRSPEED and variance[SIDESLIP] < math.inf:
        x[:] = 0.0
        sideslip(nominal, slots, calibration, z, H)
        expected(W, n, H, 1, variance[SIDESLIP], S, F)
        if squared(S, z, 1) <= gate[kind]:
            observe(x, W, n, H[0], z[0], variance[SIDESLIP], b)
            correct(nominal, x)
