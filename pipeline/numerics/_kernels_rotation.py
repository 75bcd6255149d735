"""Compiled loops of `pipeline.numerics.rotation` and `pipeline.numerics.integration`.

Arrays are one row a component, ``(3, n)`` or ``(4, n)``, C-contiguous, so that the loops over samples run
over adjacent numbers and the compiler can work on several at once. No ``fastmath``: the same bits on
every machine.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]

_BLOCK = 2048
"""Samples worked on at a time: their scratch arrays, 64 KiB, stay in the second-level cache."""

_SERIES_LIMIT = 1 / 16
"""Largest (|v|/2)**2 [rad**2] for which six terms of the series of sine and cosine of |v|/2 are exact: the
first left out is (1/16)**6/12! = 1e-16."""

_LITTLE_SQUARED = 1 / 64
"""Square of the largest angle [rad**2] whose series for sine and cosine end as `_turned` ends them: the
first terms left out are 2e-17 and 3e-20."""

_FRESH = 64
"""Steps after which the carried sine and cosine are computed anew: each step rounds them a few times."""

_C2, _C4, _C6, _C8, _C10 = -1 / 2, 1 / 24, -1 / 720, 1 / 40320, -1 / 3628800
_S3, _S5, _S7, _S9, _S11 = -1 / 6, 1 / 120, -1 / 5040, 1 / 362880, -1 / 39916800
"""Coefficients of the series of cosine and sine, by the power of the angle."""

_TAN_EIGHTH = math.tan(math.pi / 8)


@njit(cache=True, error_model="numpy")
def _atan2(y: float, x: float) -> float:
    """Arc tangent of y/x in the right quadrant, to 2 units in the last place; 0 at the origin.

    Without a branch, so that the loops around it are vectorised. Argument reduced to [-tan(pi/8),
    tan(pi/8)]; rational approximation of S. L. Moshier, Methods and Programs for Mathematical Functions
    (1989), Cephes ``atan.c``.
    """
    ax, ay = abs(x), abs(y)
    low = ay if ay < ax else ax
    high = ax if ay < ax else ay
    high = 1.0 if high == 0.0 else high
    upper = low > _TAN_EIGHTH * high
    u = (low - high) / (low + high) if upper else low / high
    z = u * u
    num = -8.750608600031904122785e-1 * z - 1.615753718733365076637e1
    num = (num * z - 7.500855792314704667340e1) * z - 1.228866684490136173410e2
    num = num * z - 6.485021904942025371773e1
    den = (z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2
    den = (den * z + 4.328810604912902668951e2) * z + 4.853903996359136964868e2
    den = den * z + 1.945506571482613964425e2
    angle = u + u * (z * num / den)
    angle = math.pi / 4 + angle if upper else angle
    angle = math.pi / 2 - angle if ay >= ax and ay > 0.0 else angle
    angle = math.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@njit(cache=True, error_model="numpy")
def euler_krylov(q: Float, angles: Float) -> None:
    """Euler-Krylov angles ``(3, n)`` of quaternions ``(4, n)``, psi and gamma continuous along the row.

    The formulas are those of `pipeline.numerics.rotation.euler_krylov_from_quaternion`.
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    psi, theta, gamma = angles[0], angles[1], angles[2]
    for i in range(w.size):
        sum_c, sum_s = w[i] + z[i], x[i] + y[i]
        dif_c, dif_s = w[i] - z[i], y[i] - x[i]
        half_sum = _atan2(sum_s, sum_c)
        half_dif = _atan2(dif_s, dif_c)
        psi[i] = half_sum + half_dif
        gamma[i] = half_sum - half_dif
        cosine = math.sqrt((sum_c * sum_c + sum_s * sum_s) * (dif_c * dif_c + dif_s * dif_s))
        theta[i] = _atan2(2.0 * (x[i] * y[i] + w[i] * z[i]), cosine)
    _unwrap(psi)
    _unwrap(gamma)


@njit(cache=True, error_model="numpy")
def _unwrap(angle: Float) -> None:
    """Add whole turns so that no step exceeds half a turn, from a first value within half a turn."""
    turn = 2.0 * math.pi
    if angle.size == 0:
        return
    turns = -round(angle[0] / turn)
    before = angle[0]
    angle[0] += turns * turn
    for i in range(1, angle.size):
        step = angle[i] - before
        before = angle[i]
        if abs(step) > math.pi:
            turns -= round(step / turn)
        angle[i] += turns * turn


@njit(cache=True, error_model="numpy")
def integrate_quaternion(rates: Float, increments: Float, steps: Float, initial: Float, q: Float) -> None:
    """Fill ``q`` (4, n): see `pipeline.numerics.integration.integrate_quaternion`."""
    # Rows are taken before they are sliced: a slice of a row is known to be contiguous, a row of a
    # slice is not, and only loops over contiguous rows are vectorised.
    p_row, q_row, r_row = rates[0], rates[1], rates[2]
    a_row, b_row, c_row = increments[0], increments[1], increments[2]
    w, x, y, z = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    q[:, 0] = initial
    for first in range(1, steps.size, _BLOCK):
        last = min(first + _BLOCK, steps.size)
        n = last - first
        small = _rotations(
            p_row[first - 1 : last], q_row[first - 1 : last], r_row[first - 1 : last],
            a_row[first:last], b_row[first:last], c_row[first:last], steps[first:last],
            w[:n], x[:n], y[:n], z[:n],
        )  # fmt: skip
        if not small:
            _large_rotations(rates, increments, steps, first, w[:n], x[:n], y[:n], z[:n])
        _running_product(w[:n], x[:n], y[:n], z[:n], first, q)


@njit(cache=True, error_model="numpy")
def _rotation_vector(
    k: float, dp: float, dq: float, dr: float, a: float, b: float, c: float
) -> tuple[float, float, float]:
    """The vector a + a × b1, b1 = k (w1 - w0), k = h/12.

    ``(a, b, c)`` stands for a, ``(dp, dq, dr)`` for w1 - w0.
    """
    dp, dq, dr = k * dp, k * dq, k * dr
    return a + (b * dr - c * dq), b + (c * dp - a * dr), c + (a * dq - b * dp)


@njit(cache=True, error_model="numpy")
def _rotations(
    p: Float, q: Float, r: Float, a: Float, b: Float, c: Float, steps: Float,
    w: Float, x: Float, y: Float, z: Float,
) -> bool:  # fmt: skip
    """Quaternions of the steps by the series of sine and cosine; whether it is exact for all of them."""
    p0, q0, r0 = p[:-1], q[:-1], r[:-1]
    p1, q1, r1 = p[1:], q[1:], r[1:]
    beyond = 0  # counted, not returned at the first: only so is the loop vectorised
    for i in range(steps.size):
        v1, v2, v3 = _rotation_vector(
            steps[i] / 12.0, p1[i] - p0[i], q1[i] - q0[i], r1[i] - r0[i], a[i], b[i], c[i]
        )
        # Horner in s = (|v|/2)**2; reciprocals, since a division takes as long as four products.
        s = 0.25 * (v1 * v1 + v2 * v2 + v3 * v3)
        beyond += not s <= _SERIES_LIMIT
        half_sinc = 0.5 * (1.0 + s * (_S3 + s * (_S5 + s * (_S7 + s * (_S9 + s * _S11)))))
        w[i] = 1.0 + s * (_C2 + s * (_C4 + s * (_C6 + s * (_C8 + s * _C10))))
        x[i], y[i], z[i] = half_sinc * v1, half_sinc * v2, half_sinc * v3
    return beyond == 0


@njit(cache=True, error_model="numpy")
def _large_rotations(
    rates: Float, increments: Float, steps: Float, first: int, w: Float, x: Float, y: Float, z: Float
) -> None:
    """The same for steps of any size, by sine and cosine; the first of them is column ``first``."""
    for i in range(w.size):
        row = first + i
        v1, v2, v3 = _rotation_vector(
            steps[row] / 12.0,
            rates[0, row] - rates[0, row - 1],
            rates[1, row] - rates[1, row - 1],
            rates[2, row] - rates[2, row - 1],
            increments[0, row],
            increments[1, row],
            increments[2, row],
        )
        angle = math.sqrt(v1 * v1 + v2 * v2 + v3 * v3)
        half_sinc = math.sin(angle / 2.0) / angle if angle > 0.0 else 0.5
        w[i] = math.cos(angle / 2.0)
        x[i], y[i], z[i] = half_sinc * v1, half_sinc * v2, half_sinc * v3


@njit(cache=True, error_model="numpy")
def quaternion_product(
    w: float, x: float, y: float, z: float, a: float, b: float, c: float, d: float
) -> tuple[float, float, float, float]:
    """Hamilton product (w, x, y, z) (a, b, c, d)."""
    return (
        (w * a - x * b) - (y * c + z * d),
        (w * b + x * a) + (y * d - z * c),
        (w * c + y * a) + (z * b - x * d),
        (w * d + z * a) + (x * c - y * b),
    )


@njit(cache=True, error_model="numpy")
def _running_product(fw: Float, fx: Float, fy: Float, fz: Float, first: int, q: Float) -> None:
    """Fill ``q`` from column ``first`` on by the column before times f0, f0 f1 and so on.

    Each product waits for the one before it. So the second half of the block is multiplied up from the
    identity at the same time as the first half from the start, and then turned by the first half's end. The
    start is brought to unit norm: it drifts by rounding alone, so once a block will do.
    """
    qw, qx, qy, qz = q[0], q[1], q[2], q[3]
    w, x, y, z = qw[first - 1], qx[first - 1], qy[first - 1], qz[first - 1]
    norm = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w * norm, x * norm, y * norm, z * norm
    half = fw.size // 2
    a, b, c, d = 1.0, 0.0, 0.0, 0.0
    for i in range(half):
        w, x, y, z = quaternion_product(w, x, y, z, fw[i], fx[i], fy[i], fz[i])
        row = first + i
        qw[row], qx[row], qy[row], qz[row] = w, x, y, z
        j = half + i
        a, b, c, d = quaternion_product(a, b, c, d, fw[j], fx[j], fy[j], fz[j])
        row = first + j
        qw[row], qx[row], qy[row], qz[row] = a, b, c, d
    last = fw.size - 1
    if last == 2 * half:  # of an odd number of factors one is left
        row = first + last
        qw[row], qx[row], qy[row], qz[row] = quaternion_product(
            a, b, c, d, fw[last], fx[last], fy[last], fz[last]
        )
    begin, end = first + half, first + fw.size
    _multiply_from_left(w, x, y, z, qw[begin:end], qx[begin:end], qy[begin:end], qz[begin:end])


@njit(cache=True, error_model="numpy")
def _multiply_from_left(
    w: float, x: float, y: float, z: float, qw: Float, qx: Float, qy: Float, qz: Float
) -> None:
    """Quaternions become (w, x, y, z) times them, in place."""
    for i in range(qw.size):
        qw[i], qx[i], qy[i], qz[i] = quaternion_product(w, x, y, z, qw[i], qx[i], qy[i], qz[i])


@njit(cache=True, error_model="numpy")
def _turned(sine: float, cosine: float, by: float) -> tuple[float, float]:
    """Sine and cosine of an angle that is turned by a little more.

    The next step waits for them, so the polynomials are split in two halves (Estrin) that are computed at the
    same time: half the delay of a call of sin and cos.
    """
    z = by * by
    if z < _LITTLE_SQUARED:
        zz = z * z
        s = by * (((1.0 + _S3 * z) + zz * (_S5 + _S7 * z)) + (zz * zz) * _S9)
        c = ((1.0 + _C2 * z) + zz * (_C4 + _C6 * z)) + (zz * zz) * (_C8 + _C10 * z)
    else:
        s, c = math.sin(by), math.cos(by)
    return sine * c + cosine * s, cosine * c - sine * s


@njit(cache=True, error_model="numpy")
def _angle_rates(
    sin_t: float, cos_t: float, sin_g: float, cos_g: float, p: float, q: float, r: float
) -> tuple[float, float, float]:
    """Right-hand side of (1.1) by sine and cosine of theta and gamma; gamma' = p - sin(theta) psi'."""
    # The reciprocal is ready before its factor: a quotient would begin only when that is there.
    psi_rate = (q * cos_g - r * sin_g) * (1.0 / cos_t)
    return psi_rate, q * sin_g + r * cos_g, p - sin_t * psi_rate


@njit(cache=True, error_model="numpy")
def integrate_euler_krylov(rates: Float, increments: Float, steps: Float, limit: float, angles: Float) -> int:
    """Fill ``angles`` (3, n) from its first column on; the row at which |theta| passes limit, else -1.

    See `pipeline.numerics.integration.integrate_euler_krylov`.
    """
    psi, theta, gamma = angles[0, 0], angles[1, 0], angles[2, 0]
    if not abs(theta) <= limit:
        return 0
    sin_t, cos_t, sin_g, cos_g = 0.0, 1.0, 0.0, 1.0
    for i in range(1, steps.size):
        if i % _FRESH == 1:
            sin_t, cos_t, sin_g, cos_g = math.sin(theta), math.cos(theta), math.sin(gamma), math.cos(gamma)
        h, half = steps[i], steps[i] / 2.0
        p0, q0, r0 = rates[0, i - 1], rates[1, i - 1], rates[2, i - 1]
        p1, q1, r1 = rates[0, i], rates[1, i], rates[2, i]
        # The midpoint from Simpson's rule: a = h (w0 + 4 wm + w1)/6.
        pm = (6.0 * increments[0, i] / h - p0 - p1) / 4.0
        qm = (6.0 * increments[1, i] / h - q0 - q1) / 4.0
        rm = (6.0 * increments[2, i] / h - r0 - r1) / 4.0
        # Within the step sines and cosines are unknowns: (sin x)' = x' cos x, (cos x)' = -x' sin x.
        a1, b1, c1 = _angle_rates(sin_t, cos_t, sin_g, cos_g, p0, q0, r0)
        st, ct = sin_t + half * (b1 * cos_t), cos_t - half * (b1 * sin_t)
        sg, cg = sin_g + half * (c1 * cos_g), cos_g - half * (c1 * sin_g)
        a2, b2, c2 = _angle_rates(st, ct, sg, cg, pm, qm, rm)
        st, ct = sin_t + half * (b2 * ct), cos_t - half * (b2 * st)
        sg, cg = sin_g + half * (c2 * cg), cos_g - half * (c2 * sg)
        a3, b3, c3 = _angle_rates(st, ct, sg, cg, pm, qm, rm)
        st, ct = sin_t + h * (b3 * ct), cos_t - h * (b3 * st)
        sg, cg = sin_g + h * (c3 * cg), cos_g - h * (c3 * sg)
        a4, b4, c4 = _angle_rates(st, ct, sg, cg, p1, q1, r1)
        sixth = h / 6.0
        psi += sixth * ((a1 + a4) + 2.0 * (a2 + a3))
        theta_step = sixth * ((b1 + b4) + 2.0 * (b2 + b3))
        gamma_step = sixth * ((c1 + c4) + 2.0 * (c2 + c3))
        theta += theta_step
        gamma += gamma_step
        sin_t, cos_t = _turned(sin_t, cos_t, theta_step)
        sin_g, cos_g = _turned(sin_g, cos_g, gamma_step)
        angles[0, i], angles[1, i], angles[2, i] = psi, theta, gamma
        if not abs(theta) <= limit:
            return i
    return -1
