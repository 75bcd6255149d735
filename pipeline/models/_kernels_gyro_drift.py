"""Compiled loops of `pipeline.models.drift_trajectory`: the gimbal angles of a gyro, step by step.

The steps are those of Cooper & Verner's explicit Runge-Kutta method of order 8 in 11 stages (SIAM Journal on
Numerical Analysis 9, 1972, 389-405), with ``s = sqrt(21)``. They are as long as the solution is smooth: the
angles are analytic in tau as far as alpha2 is from 90 degrees, so a step is shortened by cos alpha2. Between
the steps' ends a polynomial of degree 5 goes through the angles and their first and second derivatives.

What a gyro and its stand are is one array, ``constants``::

    u (3), g (3), m (6), m0 (6), k, e3 (3), theta (2), epsilon (3)

with the drift ``m(tau) = m0 exp(-k tau) + m (1 - exp(-k tau))``. The exact model reads e3, the linear one
theta and epsilon; u and g have the misalignment in them for the exact model, and not for the linear one.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Number = Any  # float; complex where a derivative along a direction is wanted
Pair = tuple[float, float]
Vector = tuple[float, float, float]

U, G, M, M0, DECAY, E3, THETA, EPSILON, SIZE = 0, 3, 6, 12, 18, 19, 22, 24, 27
"""Where each part of the constants begins, and how many there are."""

COLUMNS = 13
"""Of a sensitivity: alpha(0) (2), m (6), theta (2), Delta chi (3)."""

_STEP = 0.016
"""Longest step in units of Earth-rate time, 3.7 min: in 24 h both the steps and the polynomial between
their ends stay below 1e-13 rad (`tests/models/test_models_drift_trajectory.py`)."""

NEAREST = 0.01
"""The least cos alpha2 that is followed, 0.6 degrees before the singularity."""

_IMAGINARY = 1e-30
"""Of the complex step: its square is below rounding, so a derivative loses no digit."""

_S = math.sqrt(21.0)
# fmt: off
_NODES = np.array([
    0, 1 / 2, 1 / 2, (7 + _S) / 14, (7 + _S) / 14, 1 / 2,
    (7 - _S) / 14, (7 - _S) / 14, 1 / 2, (7 + _S) / 14, 1,
])
_ROWS: tuple[tuple[float, ...], ...] = (
    (),
    (1 / 2,),
    (1 / 4, 1 / 4),
    (1 / 7, (-7 - 3 * _S) / 98, (21 + 5 * _S) / 49),
    ((11 + _S) / 84, 0, (18 + 4 * _S) / 63, (21 - _S) / 252),
    ((5 + _S) / 48, 0, (9 + _S) / 36, (-231 + 14 * _S) / 360, (63 - 7 * _S) / 80),
    ((10 - _S) / 42, 0, (-432 + 92 * _S) / 315, (633 - 145 * _S) / 90, (-504 + 115 * _S) / 70,
     (63 - 13 * _S) / 35),
    (1 / 14, 0, 0, 0, (14 - 3 * _S) / 126, (13 - 3 * _S) / 63, 1 / 9),
    (1 / 32, 0, 0, 0, (91 - 21 * _S) / 576, 11 / 72, (-385 - 75 * _S) / 1152, (63 + 13 * _S) / 128),
    (1 / 14, 0, 0, 0, 1 / 9, (-733 - 147 * _S) / 2205, (515 + 111 * _S) / 504, (-51 - 11 * _S) / 56,
     (132 + 28 * _S) / 245),
    (0, 0, 0, 0, (-42 + 7 * _S) / 18, (-18 + 28 * _S) / 45, (-273 - 53 * _S) / 72, (301 + 53 * _S) / 72,
     (28 - 28 * _S) / 45, (49 - 7 * _S) / 18),
    (1 / 20, 0, 0, 0, 0, 0, 0, 49 / 180, 16 / 45, 49 / 180, 1 / 20),
)
# fmt: on
_STAGES = len(_NODES)
_TABLEAU = np.array([[*row, *[0.0] * (_STAGES - len(row))] for row in _ROWS])
"""Row i makes stage i of those before it; the last row makes the step."""


@njit(cache=True)
def _turned(
    v1: float, v2: float, v3: float, s1: Number, c1: Number, s2: Number, c2: Number
) -> tuple[Number, Number, Number]:
    """Components in x of a vector given in zeta; s, c: sines and cosines of alpha1, alpha2."""
    w = -v2 * s1 + v3 * c1
    return v1 * c2 - w * s2, v2 * c1 + v3 * s1, v1 * s2 + w * c2


@njit(cache=True)
def rates(
    s1: Number, c1: Number, s2: Number, c2: Number, fade: Number, k: Float, linear: bool
) -> tuple[Number, Number]:
    """alpha1', alpha2' by the exact model (2.2) or the linear one; fade is exp(-k tau).

    Arithmetic alone, so that complex sines and cosines give the derivative along a direction.
    """
    u1, u2, u3 = _turned(k[U], k[U + 1], k[U + 2], s1, c1, s2, c2)
    g1, g2, g3 = _turned(k[G], k[G + 1], k[G + 2], s1, c1, s2, c2)
    m11 = k[M] + fade * (k[M0] - k[M])
    m12 = k[M + 1] + fade * (k[M0 + 1] - k[M + 1])
    m21 = k[M + 2] + fade * (k[M0 + 2] - k[M + 2])
    m22 = k[M + 3] + fade * (k[M0 + 3] - k[M + 3])
    mc1 = k[M + 4] + fade * (k[M0 + 4] - k[M + 4])
    mc2 = k[M + 5] + fade * (k[M0 + 5] - k[M + 5])
    if linear:
        p, q = m11 + 2 * m12 * g3, m21 + 2 * m22 * g3
        tilt = u3 * c2 - u1 * s2
        across = k[EPSILON + 2] * c1 - k[EPSILON + 1] * s1
        along = k[EPSILON + 1] * c1 + k[EPSILON + 2] * s1
        rate1 = (-u1 - p * g1 + q * g2 - mc2 + tilt / c2 * k[THETA + 1] + s2 * across) / c2 - k[EPSILON]
        return rate1, -u2 - p * g2 - q * g1 + mc1 - tilt / c2 * k[THETA] - along
    e1, e2, e3 = k[E3], k[E3 + 1], k[E3 + 2]
    cos_gamma = -(e1 * g1 + e2 * g2 + e3 * g3)
    p, q = m11 - 2 * m12 * cos_gamma, m21 - 2 * m22 * cos_gamma
    # b = e3 x (e3 x g) = -cos gamma e3 - g; a and b are across e3, and (mc1, mc2, 0) is made so.
    lengthwise = mc1 * e1 + mc2 * e2
    moment1 = p * (e2 * g3 - e3 * g2) - q * (cos_gamma * e1 + g1) + mc1 - lengthwise * e1
    moment2 = p * (e3 * g1 - e1 * g3) - q * (cos_gamma * e2 + g2) + mc2 - lengthwise * e2
    rate1 = (moment2 - u3 * e1 + u1 * e3) / (s2 * e1 - c2 * e3)
    return rate1, (moment1 + (u3 + rate1 * s2) * e2) / e3 - u2


@njit(cache=True)
def partials(s1: float, c1: float, s2: float, c2: float, k: Float, directions: Float, out: Float) -> None:
    """Derivatives of the exact model's rates by alpha1, alpha2, m, theta and Delta chi, with constant m.

    Parameters
    ----------
    directions : ndarray, shape (5, 9)
        Derivatives of u, g (in zeta) and e3 (in x) by theta1, theta2, and the three of Delta chi.
    out : ndarray, shape (2, 13)
        Receives them.
    """
    u1, u2, u3 = _turned(k[U], k[U + 1], k[U + 2], s1, c1, s2, c2)
    g1, g2, g3 = _turned(k[G], k[G + 1], k[G + 2], s1, c1, s2, c2)
    e1, e2, e3 = k[E3], k[E3 + 1], k[E3 + 2]
    mc1, mc2 = k[M + 4], k[M + 5]
    cos_gamma = -(e1 * g1 + e2 * g2 + e3 * g3)
    p, q = k[M] - 2 * k[M + 1] * cos_gamma, k[M + 2] - 2 * k[M + 3] * cos_gamma
    a1, a2 = e2 * g3 - e3 * g2, e3 * g1 - e1 * g3
    b1, b2 = -cos_gamma * e1 - g1, -cos_gamma * e2 - g2
    lengthwise = mc1 * e1 + mc2 * e2
    moment1 = p * a1 + q * b1 + mc1 - lengthwise * e1
    moment2 = p * a2 + q * b2 + mc2 - lengthwise * e2
    below = s2 * e1 - c2 * e3
    rate1 = (moment2 - u3 * e1 + u1 * e3) / below
    inner = moment1 + (u3 + rate1 * s2) * e2

    for j in range(7):
        # alpha1 and alpha2 turn u and g; then theta and Delta chi
        dt2 = 1.0 if j == 1 else 0.0
        f1 = f2 = f3 = 0.0
        if j == 0:
            wu, wg = -k[U + 1] * s1 + k[U + 2] * c1, -k[G + 1] * s1 + k[G + 2] * c1
            v1, v2, v3, h1, h2, h3 = u2 * s2, wu, -u2 * c2, g2 * s2, wg, -g2 * c2
        elif j == 1:
            v1, v2, v3, h1, h2, h3 = -u3, 0.0, u1, -g3, 0.0, g1
        else:
            d = directions[j - 2]
            v1, v2, v3 = _turned(d[0], d[1], d[2], s1, c1, s2, c2)
            h1, h2, h3 = _turned(d[3], d[4], d[5], s1, c1, s2, c2)
            f1, f2, f3 = d[6], d[7], d[8]
        dcos = -(f1 * g1 + f2 * g2 + f3 * g3 + e1 * h1 + e2 * h2 + e3 * h3)
        dp, dq = -2 * k[M + 1] * dcos, -2 * k[M + 3] * dcos
        da1 = f2 * g3 + e2 * h3 - f3 * g2 - e3 * h2
        da2 = f3 * g1 + e3 * h1 - f1 * g3 - e1 * h3
        db1, db2 = -dcos * e1 - cos_gamma * f1 - h1, -dcos * e2 - cos_gamma * f2 - h2
        dlengthwise = mc1 * f1 + mc2 * f2
        dmoment1 = dp * a1 + p * da1 + dq * b1 + q * db1 - dlengthwise * e1 - lengthwise * f1
        dmoment2 = dp * a2 + p * da2 + dq * b2 + q * db2 - dlengthwise * e2 - lengthwise * f2
        dabove = dmoment2 - v3 * e1 - u3 * f1 + v1 * e3 + u1 * f3
        dbelow = (c2 * e1 + s2 * e3) * dt2 + s2 * f1 - c2 * f3
        drate1 = (dabove - rate1 * dbelow) / below
        dinner = dmoment1 + (v3 + drate1 * s2 + rate1 * c2 * dt2) * e2 + (u3 + rate1 * s2) * f2
        column = j if j < 2 else j + 6
        out[0, column] = drate1
        out[1, column] = (dinner - inner * f3 / e3) / e3 - v2
    _by_drift((a1, a2), (b1, b2), cos_gamma, (e1, e2, e3), s2, below, out)


@njit(cache=True)
def _by_drift(a: Pair, b: Pair, cos_gamma: float, axis: Vector, s2: float, below: float, out: Float) -> None:
    """Derivatives of the exact model's rates by m: the moment is linear in it."""
    e1, e2, e3 = axis
    along = -2 * cos_gamma
    moments = (
        a,
        (along * a[0], along * a[1]),
        b,
        (along * b[0], along * b[1]),
        (1 - e1 * e1, -e1 * e2),
        (-e2 * e1, 1 - e2 * e2),
    )
    for j in range(6):
        by_moment1, by_moment2 = moments[j]
        out[0, 2 + j] = by_moment2 / below
        out[1, 2 + j] = (by_moment1 + by_moment2 / below * s2 * e2) / e3


@njit(cache=True)
def _slope(
    tau: float, y: Float, k: Float, linear: bool, directions: Float, work: Float, slope: Float
) -> None:
    """Fill y' of the angles and, where there are directions, of their sensitivities."""
    s1, c1, s2, c2 = math.sin(y[0]), math.cos(y[0]), math.sin(y[1]), math.cos(y[1])
    fade = math.exp(-k[DECAY] * tau)
    slope[0], slope[1] = rates(s1, c1, s2, c2, fade, k, linear)
    if directions.shape[0]:
        partials(s1, c1, s2, c2, k, directions, work)
        for j in range(COLUMNS):
            # D' = J D + F; alpha(0) has no column in F
            first, second = y[2 + j], y[2 + COLUMNS + j]
            own1, own2 = (work[0, j], work[1, j]) if j >= 2 else (0.0, 0.0)
            slope[2 + j] = work[0, 0] * first + work[0, 1] * second + own1
            slope[2 + COLUMNS + j] = work[1, 0] * first + work[1, 1] * second + own2


@njit(cache=True)
def _accelerations(tau: float, y: Float, slope: Float, k: Float, linear: bool) -> Pair:
    """alpha1'', alpha2'' by a complex step along the trajectory."""
    s1, c1, s2, c2 = math.sin(y[0]), math.cos(y[0]), math.sin(y[1]), math.cos(y[1])
    fade = math.exp(-k[DECAY] * tau)
    i1, i2 = _IMAGINARY * slope[0], _IMAGINARY * slope[1]
    turn1, turn2 = rates(
        complex(s1, c1 * i1),
        complex(c1, -s1 * i1),
        complex(s2, c2 * i2),
        complex(c2, -s2 * i2),
        complex(fade, -k[DECAY] * fade * _IMAGINARY),
        k,
        linear,
    )
    return turn1.imag / _IMAGINARY, turn2.imag / _IMAGINARY


@njit(cache=True)
def _stepped(
    now: float,
    h: float,
    y: Float,
    k: Float,
    linear: bool,
    directions: Float,
    work: Float,
    slopes: Float,
    out: Float,
) -> None:
    """Fill y at ``now + h``; of the slopes the first is given, the others are overwritten."""
    for i in range(1, _STAGES + 1):
        out[:] = y
        for j in range(i):
            weight = h * _TABLEAU[i, j]
            if weight != 0.0:
                for w in range(y.size):
                    out[w] += weight * slopes[j, w]
        if i < _STAGES:
            _slope(now + _NODES[i] * h, out, k, linear, directions, work, slopes[i])


@njit(cache=True)
def _quintic(x: float, h: float, y0: float, v0: float, a0: float, y1: float, v1: float, a1: float) -> float:
    """Polynomial of degree 5 through values, first and second derivatives at both ends, at x in 0..1."""
    v, a = h * v0, h * h * a0 / 2
    rise, speed, bend = y1 - y0 - v - a, h * v1 - v - 2 * a, h * h * a1 - 2 * a
    x3 = 10 * rise - 4 * speed + bend / 2
    x4 = -15 * rise + 7 * speed - bend
    x5 = 6 * rise - 3 * speed + bend / 2
    return y0 + x * (v + x * (a + x * (x3 + x * (x4 + x * x5))))


@njit(cache=True)
def follow(
    tau: Float, start: Float, k: Float, linear: bool, bound: float, directions: Float, alpha: Float, D: Float
) -> tuple[int, float, float]:
    """Angles, and their sensitivities where there are directions, at increasing instants.

    Parameters
    ----------
    tau : ndarray, shape (n,)
        Instants; the first is the one of ``start``.
    start : ndarray, shape (2,)
    k : ndarray, shape (27,)
        The constants.
    bound : float
        Of the angular rate, in units of the Earth's: steps are shortened by it.
    directions : ndarray, shape (5, 9) or (0, 9)
        As for `partials`; none for no sensitivities.
    alpha : ndarray, shape (n, 2)
        Receives the angles.
    D : ndarray, shape (n, 2, 13) or (0, 2, 13)
        Receives the sensitivities.

    Returns
    -------
    reached : int
        How many instants were reached: n, or fewer where alpha2 came too near to 90 degrees.
    tau, alpha2 : float
        The last knot.
    """
    width = 2 + 2 * COLUMNS if directions.shape[0] else 2
    y, following = np.zeros(width), np.zeros(width)
    slopes, end_slope, work = np.zeros((_STAGES, width)), np.zeros(width), np.zeros((2, COLUMNS))
    y[0], y[1] = start[0], start[1]
    if width > 2:
        y[2] = y[3 + COLUMNS] = 1.0
    now, done = tau[0], 0
    _slope(now, y, k, linear, directions, work, slopes[0])
    bend1, bend2 = _accelerations(now, y, slopes[0], k, linear)
    while math.cos(y[1]) > NEAREST and done < tau.size:
        h = _STEP * math.cos(y[1]) / bound
        last = now + h >= tau[-1]
        after = tau[-1] if last else now + h
        h = after - now
        _stepped(now, h, y, k, linear, directions, work, slopes, following)
        if not math.cos(following[1]) > NEAREST:  # NaN too
            return done, after, following[1]
        _slope(after, following, k, linear, directions, work, end_slope)
        next1, next2 = _accelerations(after, following, end_slope, k, linear)
        while done < tau.size and (last or tau[done] <= after):
            x = (tau[done] - now) / h if h > 0 else 0.0
            alpha[done, 0] = _quintic(x, h, y[0], slopes[0, 0], bend1, following[0], end_slope[0], next1)
            alpha[done, 1] = _quintic(x, h, y[1], slopes[0, 1], bend2, following[1], end_slope[1], next2)
            if width > 2:
                _cubic(x, h, y, slopes[0], following, end_slope, D[done])
            done += 1
        now, bend1, bend2 = after, next1, next2
        y[:], slopes[0] = following, end_slope
    return done, now, y[1]


@njit(cache=True)
def _cubic(x: float, h: float, y0: Float, v0: Float, y1: Float, v1: Float, out: Float) -> None:
    """Sensitivities at x in 0..1 of a step: Hermite's cubic, 1e-9 of them, which no estimate feels."""
    square = x * x
    last = square * (3 - 2 * x)
    first, start, end = 1 - last, h * x * (1 - x) * (1 - x), h * square * (x - 1)
    for j in range(COLUMNS):
        a, b = 2 + j, 2 + COLUMNS + j
        out[0, j] = first * y0[a] + last * y1[a] + start * v0[a] + end * v1[a]
        out[1, j] = first * y0[b] + last * y1[b] + start * v0[b] + end * v1[b]
