"""Compiled algebra of an error-state filter of navigation: transition, noise, factor of the covariance.

States stand as in `pipeline.models.navigation_states`: n in all, the last fifteen gyro bias, accelerometer
bias, φ, δv, δp. A factor S of the covariance, ``P = S S^T``, is lower triangular and kept by columns:
``W[c]`` is column c of S. Rows of W after the first n are columns of the process noise, until the reflections
of `triangularise` have taken them in.

Between two instants of the covariance, T apart, the errors move as::

    φ' = -ω_in x φ - δω_in - C δb_g
    δv' = -(C f) x φ - (2 ω_ie + ω_en) x δv - (2 δω_ie + δω_en) x v + (0, 0, 2 g δp_D/R) - C δb_a
    δp_N' = δv_N + (v_N δp_D - v_D δp_N)/R_M,   δp_D' = δv_D
    δp_E' = δv_E + (v_E (δp_D + δp_N tan L) - (v_D + v_N tan L) δp_E)/R_N

(P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems*, 2nd ed., 2013,
14.2.4, in the signs of above.) The terms in C and f are summed up at every step of the inertial sensors,
`accumulate`; those of the Earth, 1e-4 of them, are taken once over T. White noise of the sensors enters in
the middle of T, and what other states gather at its end.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.models import ellipsoid
from pipeline.models._kernels_strapdown import gravity, radii
from pipeline.numerics._kernels_householder import reflect

Float = NDArray[np.float64]

_RATE = ellipsoid.RATE

# Sums over the steps since the last instant of the covariance, in one array; f stands for C f.
T = 0
F1 = 1
"""int f, 3"""
F2 = 4
"""int int f, 3"""
C1 = 7
"""int C, 9"""
C2 = 16
"""int int C, 9"""
X1 = 25
"""int [f x] int C, 9"""
X2 = 34
"""int of that, 9"""
VELOCITY_VARIANCE = 43
ATTITUDE_VARIANCE = 44
SUMS = 45


@njit(cache=True, error_model="numpy")
def accumulate(sums: Float, before: Float, after: Float, increment: Float, dt: float) -> None:
    """Take one step of the inertial sensors into the sums.

    ``before`` and ``after`` are C at the ends of the step, ``increment`` its velocity increment [m/s].
    """
    half = dt / 2.0
    f0 = before[0, 0] * increment[0] + before[0, 1] * increment[1] + before[0, 2] * increment[2]
    f1 = before[1, 0] * increment[0] + before[1, 1] * increment[1] + before[1, 2] * increment[2]
    f2 = before[2, 0] * increment[0] + before[2, 1] * increment[1] + before[2, 2] * increment[2]
    for j in range(3):
        c0 = half * (before[0, j] + after[0, j])
        c1 = half * (before[1, j] + after[1, j])
        c2 = half * (before[2, j] + after[2, j])
        a, b, c = C1 + j, C1 + 3 + j, C1 + 6 + j
        m0, m1, m2 = sums[a] + 0.5 * c0, sums[b] + 0.5 * c1, sums[c] + 0.5 * c2
        x0, x1, x2 = f1 * m2 - f2 * m1, f2 * m0 - f0 * m2, f0 * m1 - f1 * m0
        sums[C2 + j] += dt * m0
        sums[C2 + 3 + j] += dt * m1
        sums[C2 + 6 + j] += dt * m2
        sums[a] += c0
        sums[b] += c1
        sums[c] += c2
        sums[X2 + j] += dt * (sums[X1 + j] + 0.5 * x0)
        sums[X2 + 3 + j] += dt * (sums[X1 + 3 + j] + 0.5 * x1)
        sums[X2 + 6 + j] += dt * (sums[X1 + 6 + j] + 0.5 * x2)
        sums[X1 + j] += x0
        sums[X1 + 3 + j] += x1
        sums[X1 + 6 + j] += x2
    sums[F2] += dt * (sums[F1] + 0.5 * f0)
    sums[F2 + 1] += dt * (sums[F1 + 1] + 0.5 * f1)
    sums[F2 + 2] += dt * (sums[F1 + 2] + 0.5 * f2)
    sums[F1] += f0
    sums[F1 + 1] += f1
    sums[F1 + 2] += f2
    sums[T] += dt


@njit(cache=True, error_model="numpy")
def minus_cross(a: float, b: float, c: float, out: Float, column: int, row: int) -> None:
    """Put ``-[(a, b, c) x]`` into ``out[column + j, row + i]``: out is kept by columns."""
    out[column, row], out[column, row + 1], out[column, row + 2] = 0.0, -c, b
    out[column + 1, row], out[column + 1, row + 1], out[column + 1, row + 2] = c, 0.0, -a
    out[column + 2, row], out[column + 2, row + 1], out[column + 2, row + 2] = -b, a, 0.0


@njit(cache=True, error_model="numpy")
def transition(sums: Float, position: Float, velocity: Float, out: Float) -> None:
    """Fill ``out (15, 9)``: column j of the transition of φ, δv, δp, from the last fifteen states."""
    out[:] = 0.0
    for j in range(3):
        for i in range(3):
            k = 3 * i + j
            out[j, i], out[j, 3 + i], out[j, 6 + i] = -sums[C1 + k], sums[X1 + k], sums[X2 + k]
            out[3 + j, 3 + i], out[3 + j, 6 + i] = -sums[C1 + k], -sums[C2 + k]
        out[6 + j, j] = out[9 + j, 3 + j] = out[12 + j, 6 + j] = 1.0
        out[9 + j, 6 + j] = sums[T]
    minus_cross(sums[F1], sums[F1 + 1], sums[F1 + 2], out, 6, 3)
    minus_cross(sums[F2], sums[F2 + 1], sums[F2 + 2], out, 6, 6)
    earth(sums[T], position, velocity, out)


@njit(cache=True, error_model="numpy")
def earth(duration: float, position: Float, velocity: Float, out: Float) -> None:
    """The slow terms over a duration, to the first order, on each of the columns of ``out``."""
    meridian, prime_vertical = radii(position[0], position[2])
    sine, cosine = math.sin(position[0]), math.cos(position[0])
    tangent = sine / cosine
    north, east, down = velocity[0], velocity[1], velocity[2]
    ie_n, ie_d = _RATE * cosine, -_RATE * sine
    en_n, en_e = east / prime_vertical, -north / meridian
    en_d = -en_n * tangent
    sink = down / prime_vertical
    fall = 2.0 * gravity(position[0], position[2]) / prime_vertical
    for j in range(out.shape[0]):
        o = out[j]
        a, b, c = o[0], o[1], o[2]
        vn, ve, vd = o[3], o[4], o[5]
        pn, pe, pd = o[6], o[7], o[8]
        dL = pn / meridian
        die_n, die_d = -_RATE * sine * dL, -_RATE * cosine * dL
        den_n = (ve + en_n * pd) / prime_vertical
        den_e = -(vn - en_e * pd) / meridian
        den_d = -den_n * tangent - en_n * dL / (cosine * cosine)
        wn, we, wd = ie_n + en_n, en_e, ie_d + en_d
        o[0] = a - duration * (we * c - wd * b + die_n + den_n)
        o[1] = b - duration * (wd * a - wn * c + den_e)
        o[2] = c - duration * (wn * b - we * a + die_d + den_d)
        wn, wd = wn + ie_n, wd + ie_d
        dn, de, dd = 2.0 * die_n + den_n, den_e, 2.0 * die_d + den_d
        o[3] = vn - duration * (we * vd - wd * ve + de * down - dd * east)
        o[4] = ve - duration * (wd * vn - wn * vd + dd * north - dn * down)
        o[5] = vd - duration * (wn * ve - we * vn + dn * east - de * north - fall * pd)
        o[6] = pn - duration * (en_e * pd + sink * pn)
        o[7] = pe + duration * (en_n * (pd + tangent * pn) + (en_e * tangent - sink) * pe)


@njit(cache=True, error_model="numpy")
def sensor_noise(sums: Float, out: Float) -> None:
    """Fill ``out (6, 9)``: factor of the noise of φ, δv, δp that the sensors' white noise makes."""
    out[:] = 0.0
    duration = sums[T]
    sigma = math.sqrt(sums[VELOCITY_VARIANCE])
    for j in range(3):
        out[j, 3 + j] = sigma
        out[j, 6 + j] = 0.5 * duration * sigma
    sigma = math.sqrt(sums[ATTITUDE_VARIANCE])
    for j in range(3):
        out[3 + j, j] = sigma
    s = 0.5 * sigma
    minus_cross(s * sums[F1], s * sums[F1 + 1], s * sums[F1 + 2], out, 3, 3)
    s = 0.125 * duration * sigma
    minus_cross(s * sums[F1], s * sums[F1 + 1], s * sums[F1 + 2], out, 3, 6)


@njit(cache=True, error_model="numpy")
def propagate(W: Float, n: int, Phi: Float, decay: Float, work: Float) -> None:
    """``S <- Phi S``; ``decay (n - 15,)`` are the factors of the states before the fifteen."""
    m = n - 15
    for c in range(n):
        w = W[c]
        for r in range(c, m):
            w[r] *= decay[r]
        for i in range(9):
            work[i] = 0.0
        for j in range(max(c - m, 0), 15):
            x, column = w[m + j], Phi[j]
            for i in range(9):
                work[i] += x * column[i]
        for i in range(9):
            w[n - 9 + i] = work[i]


@njit(cache=True, error_model="numpy")
def put_noise(W: Float, n: int, diagonal: Float, sensors: Float) -> int:
    """Write the columns of the process noise after the first n rows of W; returns their number.

    First those of ``diagonal (n,)`` that are not zero, each in its state, ascending; then ``sensors (6, 9)``.
    """
    k = n
    for r in range(n):
        if diagonal[r] > 0.0:
            W[k] = 0.0
            W[k, r] = diagonal[r]
            k += 1
    for j in range(6):
        W[k] = 0.0
        for i in range(9):
            W[k, n - 9 + i] = sensors[j, i]
        k += 1
    return k - n


@njit(cache=True, error_model="numpy")
def triangularise(W: Float, n: int, width: int, diagonal: Float, noises: int, work: Float) -> None:
    """``[S, noise] <- [S', 0]``, S' lower triangular, by Householder reflections from the right.

    Before the reflections S is lower triangular but for its last 9 x 9 block, and the noise stands as
    `put_noise` wrote it: a row of S meets only the noise of the states up to its own. What stands in the
    rows of W after the first n elements, up to ``width``, is turned with them.
    """
    met = 0
    for i in range(n):
        if diagonal[i] > 0.0:
            met += 1
        begin = n
        if i >= n - 9:
            begin, met = i + 1, noises
        reflect(W, i, begin, n + met, width, work)


@njit(cache=True, error_model="numpy")
def observe(x: Float, W: Float, n: int, h: Float, innovation: float, variance: float, b: Float) -> None:
    """Take in a measurement ``h . x`` of the state by Carlson's update, which keeps S triangular.

    From the last column to the first, with f = S^T h and s = variance + sum f^2 so far::

        A = sqrt(s_before / s_after),  B = f / sqrt(s_before s_after)
        column <- A column - B b,      b <- b + f column

    At the end ``b = P h`` and s is the variance of the innovation (N. A. Carlson, *AIAA Journal* 11, 1973).
    """
    for r in range(n):
        b[r] = 0.0
    s = variance
    for c in range(n - 1, -1, -1):
        w = W[c]
        f = 0.0
        for r in range(c, n):
            f += h[r] * w[r]
        if f == 0.0:
            continue
        after = s + f * f
        A, B = math.sqrt(s / after), f / math.sqrt(s * after)
        for r in range(c, n):
            old = w[r]
            w[r] = A * old - B * b[r]
            b[r] += f * old
        s = after
    share = innovation / s
    for r in range(n):
        x[r] += share * b[r]


@njit(cache=True, error_model="numpy")
def deviations(W: Float, n: int, out: Float) -> None:
    """Standard deviations of the states, from a lower triangular factor by columns."""
    out[:] = 0.0
    for c in range(n):
        for r in range(c, n):
            out[r] += W[c, r] * W[c, r]
    for r in range(n):
        out[r] = math.sqrt(out[r])
