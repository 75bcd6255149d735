"""Compiled loops of `pipeline.models.navigation_filter`.

The nominal state is carried over every step of the inertial sensors. At *nodes* - rows at which a measurement
arrives, and as many between as the settings ask for - the factor of the covariance is carried on from the
node before, the measurements are taken in one after the other, and the nominal state is corrected by each.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.models import ellipsoid
from pipeline.models._kernels_error_state import (
    ATTITUDE_VARIANCE,
    SUMS,
    VELOCITY_VARIANCE,
    T,
    accumulate,
    deviations,
    propagate,
    put_noise,
    sensor_noise,
    transition,
    triangularise,
)
from pipeline.models._kernels_navigation_aids import CALIBRATION, LAST_GNSS
from pipeline.models._kernels_navigation_update import Nominal, take_in
from pipeline.models._kernels_strapdown import (
    matrix_from_quaternion,
    orthonormalise,
    quaternion_from_matrix,
    step,
)

Float = NDArray[np.float64]
Integer = NDArray[np.int64]
Mask = NDArray[np.bool_]
_POLAR_LIMIT = ellipsoid.POLAR_LIMIT


@njit(cache=True)
def mark_nodes(time: Float, event_row: Integer, covariance_step: float) -> Mask:
    """Rows of a measurement, or ``covariance_step`` after the last such row, and both ends."""
    nodes = np.zeros(time.size, dtype=np.bool_)
    nodes[0] = nodes[-1] = True
    for row in event_row:
        nodes[row] = True
    last = time[0]
    for i in range(1, time.size):
        # half a step early is nearer than half a step late
        if time[i] - last + 0.5 * (time[i] - time[i - 1]) >= covariance_step:
            nodes[i] = True
        if nodes[i]:
            last = time[i]
    return nodes


@njit(cache=True)
def spaced(time: Float, interval: float) -> Mask:
    """Which of ascending instants to keep, so that they follow one another at least ``interval`` apart."""
    keep = np.zeros(time.size, dtype=np.bool_)
    last = -math.inf
    for i in range(time.size):
        if time[i] - last >= interval:
            keep[i] = True
            last = time[i]
    return keep


@njit(cache=True, error_model="numpy")
def between_nodes(time: Float, rows: Integer, before: Float, after: Float, out: Float) -> None:
    """Fill ``out`` at all instants: at nodes what is after their measurements, else linear to the next."""
    for k in range(rows.size - 1):
        first, last = rows[k], rows[k + 1]
        for i in range(first, last):
            share = (time[i] - time[first]) / (time[last] - time[first])
            for r in range(out.shape[1]):
                out[i, r] = after[k, r] + share * (before[k + 1, r] - after[k, r])
    out[rows[-1]] = after[-1]


@njit(cache=True, error_model="numpy")
def advance(
    i: int,
    time: Float,
    rotation: Float,
    increment: Float,
    coasted: Mask,
    noise: Float,
    nominal: Nominal,
    moved: Float,
    sums: Float,
    work: Float,
) -> None:
    """Carry the nominal state over step i, and the sums with it.

    ``noise`` holds the variances that velocity and attitude gather in a second, then the same for coasted
    steps; ``work (4, 3)``.
    """
    position, velocity, C, bias, _ = nominal
    dt = time[i + 1] - time[i]
    turn, gain, before = moved[6:9], work[0], work[1:4]
    for j in range(3):
        turn[j] = rotation[i, j] - dt * bias[j]
        # what the biased sensors saw was turned with them within the step
        k, m = (j + 1) % 3, (j + 2) % 3
        turned = bias[k] * increment[i, m] - bias[m] * increment[i, k]
        turned += rotation[i, k] * bias[3 + m] - rotation[i, m] * bias[3 + k]
        gain[j] = increment[i, j] - dt * (bias[3 + j] + 0.5 * turned)
        moved[j], moved[3 + j] = -position[j], -velocity[j]
        for column in range(3):
            before[j, column] = C[j, column]
    moved[9] = dt
    step(position, velocity, C, turn, gain, dt)
    for j in range(3):
        moved[j] += position[j]
        moved[3 + j] += velocity[j]
    accumulate(sums, before, C, gain, dt)
    first = 2 if coasted[i] else 0
    sums[VELOCITY_VARIANCE] += dt * noise[first]
    sums[ATTITUDE_VARIANCE] += dt * noise[first + 1]


@njit(cache=True, error_model="numpy")
def carry(
    W: Float,
    n: int,
    sums: Float,
    nominal: Nominal,
    walk: Float,
    stationary: Float,
    rate: Float,
    jolt: Float,
    Phi: Float,
    sensors: Float,
    diagonal: Float,
    work: Float,
) -> None:
    """Carry the factor to this node from the one before; Phi, sensors and diagonal get what it was done with.

    ``jolt (n,)`` is further noise of the interval, and is cleared.
    """
    position, velocity, C, _, other = nominal
    transition(sums, position, velocity, Phi)
    sensor_noise(sums, sensors)
    m = n - 15
    decay = np.ones(m)
    for r in range(n - 9):
        variance = walk[r] * walk[r] * sums[T]
        if rate[r] > 0.0:
            kept = math.exp(-rate[r] * sums[T])
            variance += stationary[r] * stationary[r] * (1.0 - kept * kept)
            decay[r] = kept
            other[r] *= kept
        diagonal[r] = math.sqrt(variance + jolt[r] * jolt[r])
    for r in range(n - 9, n):
        diagonal[r] = jolt[r]
    propagate(W, n, Phi, decay, work)
    triangularise(W, n, n, diagonal, put_noise(W, n, diagonal, sensors), work)
    orthonormalise(C)
    sums[:] = 0.0
    jolt[:] = 0.0


@njit(cache=True, error_model="numpy")
def filter_steps(
    steps: tuple[Float, Float, Float, Mask],
    nodes: Mask,
    events: tuple[Integer, Integer, Float, Float],
    model: tuple[Integer, Float, Float, Float],
    sensor_variance: Float,
    options: Float,
    variance: Float,
    gate: Float,
    field: Float,
    W: Float,
    path: tuple[Float, Float, Float],
    kept: tuple[Float, Float, Float],
    innovations: tuple[Float, Float, Float, Float],
    history: tuple[Float, Float, Float, Float, Float],
) -> int:
    """Filter all steps.

    Parameters
    ----------
    steps : time (N + 1,), rotation (N, 3), velocity increment (N, 3), coasted (N,)
    nodes : ndarray of bool, shape (N + 1,)
        From `mark_nodes`.
    events : row, kind (e,), lag [s] (e,), value (e, 4), by ascending row
    model : slots, walk, stationary, rate
        As in `States`.
    sensor_variance : ndarray, shape (4,)
        See `advance`.
    options, variance, gate, field
        See `_kernels_navigation_aids`; variance of a measurement and its largest normalised square, by kind.
    W : ndarray, shape (n + 6 + n, n)
        The factor of the covariance at the start, by columns, and room for noise.
    path : position, velocity (N + 1, 3), quaternion (N + 1, 4)
        First rows are the start; the others are filled.
    kept : states before φ (K, n - 9), standard deviations before and after measurements (K, n)
        At the K nodes; the first row of the first is the start.
    innovations : value, sigma (e, 3), normalised squared (e,), state (e,)
        Filled; state is 1 accepted, 0 refused, -1 not tried.
    history : position, velocity and quaternion before measurements (K, 10), factor after them (K, n, n),
        transition (K, 15, 9), noise of sensors (K, 6, 9), of states (K, n)
        Filled where the first is not empty.

    Returns
    -------
    int
        The row at which the state passes the polar limit or is no number, else -1.
    """
    time, rotation, increment, coasted = steps
    slots, walk, stationary, rate = model
    positions, velocities, quaternions = path
    slow, sigma_before, sigma_after = kept
    n = W.shape[1]
    m = n - 15
    nominal = (
        positions[0].copy(),
        velocities[0].copy(),
        np.empty((3, 3)),
        slow[0, m:].copy(),
        slow[0, :m].copy(),
    )
    position, velocity, C, bias, other = nominal
    matrix_from_quaternion(quaternions[0], C)
    sums, moved, jolt, small = np.zeros(SUMS), np.zeros(10), np.zeros(n), np.empty((4, 3))
    Phi, sensors, diagonal, work = np.zeros((15, 9)), np.zeros((6, 9)), np.zeros(n), np.empty(n + 9)
    refused, calibration = np.zeros(6), np.zeros(CALIBRATION)
    calibration[LAST_GNSS] = -math.inf
    event, node = 0, 0
    for i in range(time.size):
        if i > 0:
            advance(i - 1, time, rotation, increment, coasted, sensor_variance, nominal, moved, sums, small)
        if not abs(position[0]) <= _POLAR_LIMIT:
            return i
        if nodes[i]:
            if i > 0:
                carry(W, n, sums, nominal, walk, stationary, rate, jolt, Phi, sensors, diagonal, work)
            remember(node, nominal, W, n, Phi, sensors, diagonal, sigma_before, history)
            while event < events[0].size and events[0][event] == i:
                take_in(
                    event, time[i], events, nominal, moved, slots, options, variance, gate, field, W,
                    innovations, refused, calibration, jolt,
                )  # fmt: skip
                event += 1
            deviations(W, n, sigma_after[node])
            for r in range(m):
                slow[node, r] = other[r]
            for r in range(6):
                slow[node, m + r] = bias[r]
            if history[0].size > 0:
                history[1][node] = W[:n]
            node += 1
        for j in range(3):
            positions[i, j], velocities[i, j] = position[j], velocity[j]
        quaternion_from_matrix(C, quaternions[i])
    return -1


@njit(cache=True, error_model="numpy")
def remember(
    node: int,
    nominal: Nominal,
    W: Float,
    n: int,
    Phi: Float,
    sensors: Float,
    diagonal: Float,
    sigma_before: Float,
    history: tuple[Float, Float, Float, Float, Float],
) -> None:
    """Keep what stands at a node before its measurements, and how it came from the node before."""
    deviations(W, n, sigma_before[node])
    if history[0].size == 0:
        return
    position, velocity, C, _, _ = nominal
    for j in range(3):
        history[0][node, j], history[0][node, 3 + j] = position[j], velocity[j]
    quaternion_from_matrix(C, history[0][node, 6:])
    history[2][node] = Phi
    history[3][node] = sensors
    history[4][node] = diagonal
