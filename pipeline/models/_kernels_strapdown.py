"""Compiled steps of strapdown navigation, and what other compiled loops of navigation take from them.

Signatures (all `njit`; position is latitude, longitude [rad], height [m]; velocity N, E, D [m/s]; C takes
body axes to N, E, D; vectors are float64 of shape (3,), matrices (3, 3), C-contiguous)::

    radii(latitude, height) -> (R_M + h, R_N + h)
    gravity(latitude, height) -> g
    rotation_matrix(vector) -> exp([vector x])
    turn_left(C, x, y, z) -> None            C becomes exp([(x, y, z) x]) C, in place
    turn_right(C, x, y, z) -> None           C becomes C exp([(x, y, z) x]), in place
    orthonormalise(C) -> None                takes back what rounding has done to C, in place
    matrix_from_quaternion(quaternion, C) -> None        fills C
    quaternion_from_matrix(C, quaternion) -> None        fills quaternion, w not negative
    rotation_vector(R) -> vector, as a tuple             of R = exp([vector x])
    cross(a, b) -> a x b, as tuples
    increments(alpha, upsilon, beta, sigma, rotation, velocity) -> None       fills the last two
    step(position, velocity, C, rotation, increment, dt) -> None       in place
    navigate(dt, rotation, increment, position, velocity, quaternion) -> row at a pole or -1

The step is of second order in dt, with everything that varies taken at its middle::

    v1 = v0 + C0 Δv - ½ ζ × C0 Δv + [g - (2 ω_ie + ω_en) × v]_½ dt
    φ1 = φ0 + v̄_N dt/(R_M + h)_½    λ1 = λ0 + v̄_E dt/[(R_N + h) cos φ]_½    h1 = h0 - v̄_D dt,  v̄ = (v0 + v1)/2
    C1 = exp(-[ζ x]) C0 exp([θ x]),   ζ = (ω_ie + ω_en)_½ dt

(Savage, J. Guidance, Control, and Dynamics 21 (1998), 19-28 and 208-221.)
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.models import ellipsoid

Float = NDArray[np.float64]
Vector = tuple[float, float, float]
Elements = tuple[float, float, float, float, float, float, float, float, float]

_A, _E2, _RATE = ellipsoid.A, ellipsoid.E2, ellipsoid.RATE
_GE, _K = ellipsoid.GRAVITY_EQUATOR, ellipsoid.SOMIGLIANA
_FALL, _FALL_SINE = 1 + ellipsoid.FLATTENING + ellipsoid.M, 2 * ellipsoid.FLATTENING
_POLAR_LIMIT = ellipsoid.POLAR_LIMIT

_SERIES = 0.01
"""Below this squared angle [rad^2] five terms of the series are exact to the last digit."""

_FRESH = 1024
"""Steps after which rounding is taken back from C: in so many it comes to 1e-14."""


@njit(cache=True)
def radii(latitude: float, height: float) -> tuple[float, float]:
    """R_M + h and R_N + h [m]."""
    sine = math.sin(latitude)
    x = 1.0 - _E2 * sine * sine
    prime_vertical = _A / math.sqrt(x)
    return prime_vertical * (1.0 - _E2) / x + height, prime_vertical + height


@njit(cache=True)
def gravity(latitude: float, height: float) -> float:
    """Normal gravity, down [m/s^2]."""
    sine = math.sin(latitude)
    square, high = sine * sine, height / _A
    on_ellipsoid = _GE * (1.0 + _K * square) / math.sqrt(1.0 - _E2 * square)
    return on_ellipsoid * (1.0 - 2.0 * (_FALL - _FALL_SINE * square) * high + 3.0 * high * high)


@njit(cache=True)
def _sine_and_cosine(square: float) -> tuple[float, float]:
    """The quotients sin x/x and (1 - cos x)/x², by x²."""
    if square < _SERIES:
        s = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0)))
        c = 0.5 * (
            1.0 - square / 12.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0 * (1.0 - square / 90.0)))
        )
    else:
        angle = math.sqrt(square)
        half = math.sin(angle / 2.0)
        s, c = math.sin(angle) / angle, 2.0 * half * half / square
    return s, c


@njit(cache=True)
def _exponential(x: float, y: float, z: float) -> Elements:
    """Elements of exp([(x, y, z) x]), row by row."""
    s, c = _sine_and_cosine(x * x + y * y + z * z)
    sx, sy, sz, xy, xz, yz = s * x, s * y, s * z, c * x * y, c * x * z, c * y * z
    xx, yy, zz = c * x * x, c * y * y, c * z * z
    return 1.0 - yy - zz, xy - sz, xz + sy, xy + sz, 1.0 - xx - zz, yz - sx, xz - sy, yz + sx, 1.0 - xx - yy


@njit(cache=True)
def rotation_matrix(vector: Float) -> Float:
    """Matrix exp([vector x]) of a rotation vector [rad], shape (3, 3)."""
    E = np.empty((3, 3))
    e = _exponential(vector[0], vector[1], vector[2])
    for i in range(3):
        E[i, 0], E[i, 1], E[i, 2] = e[3 * i], e[3 * i + 1], e[3 * i + 2]
    return E


@njit(cache=True)
def turn_left(C: Float, x: float, y: float, z: float) -> None:
    """Turn C by a rotation vector [rad] in N, E, D, in place."""
    e11, e12, e13, e21, e22, e23, e31, e32, e33 = _exponential(x, y, z)
    for j in range(3):
        a, b, c = C[0, j], C[1, j], C[2, j]
        C[0, j] = e11 * a + e12 * b + e13 * c
        C[1, j] = e21 * a + e22 * b + e23 * c
        C[2, j] = e31 * a + e32 * b + e33 * c


@njit(cache=True)
def turn_right(C: Float, x: float, y: float, z: float) -> None:
    """Turn C by a rotation vector [rad] in body axes, in place."""
    e11, e12, e13, e21, e22, e23, e31, e32, e33 = _exponential(x, y, z)
    for i in range(3):
        a, b, c = C[i, 0], C[i, 1], C[i, 2]
        C[i, 0] = a * e11 + b * e21 + c * e31
        C[i, 1] = a * e12 + b * e22 + c * e32
        C[i, 2] = a * e13 + b * e23 + c * e33


@njit(cache=True)
def orthonormalise(C: Float) -> None:
    """One step of Newton's iteration to the nearest rotation, ``C (3 I - CᵀC)/2``, in place."""
    a = b = c = d = e = f = 0.0
    for i in range(3):
        x, y, z = C[i, 0], C[i, 1], C[i, 2]
        a, b, c = a + x * x, b + x * y, c + x * z
        d, e, f = d + y * y, e + y * z, f + z * z
    a, d, f = 1.5 - a / 2.0, 1.5 - d / 2.0, 1.5 - f / 2.0
    b, c, e = -b / 2.0, -c / 2.0, -e / 2.0
    for i in range(3):
        x, y, z = C[i, 0], C[i, 1], C[i, 2]
        C[i, 0], C[i, 1], C[i, 2] = x * a + y * b + z * c, x * b + y * d + z * e, x * c + y * e + z * f


@njit(cache=True)
def matrix_from_quaternion(quaternion: Float, C: Float) -> None:
    """Fill C from a quaternion (w, x, y, z), which need not be exactly unit."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    two = 2.0 / (w * w + x * x + y * y + z * z)
    C[0, 0], C[0, 1], C[0, 2] = 1.0 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)
    C[1, 0], C[1, 1], C[1, 2] = two * (x * y + w * z), 1.0 - two * (x * x + z * z), two * (y * z - w * x)
    C[2, 0], C[2, 1], C[2, 2] = two * (x * z - w * y), two * (y * z + w * x), 1.0 - two * (x * x + y * y)


@njit(cache=True)
def quaternion_from_matrix(C: Float, quaternion: Float) -> None:
    """Fill a quaternion (w, x, y, z), unit and w not negative (Shepperd, J. Guidance 1 (1978) 223)."""
    c11, c22, c33 = C[0, 0], C[1, 1], C[2, 2]
    trace = c11 + c22 + c33
    x, y, z = C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]
    if trace >= max(c11, c22, c33):
        w = 1.0 + trace
    elif c11 >= max(c22, c33):
        w, x, y, z = x, 1.0 + c11 - c22 - c33, C[0, 1] + C[1, 0], C[0, 2] + C[2, 0]
    elif c22 >= c33:
        w, x, y, z = y, C[0, 1] + C[1, 0], 1.0 - c11 + c22 - c33, C[1, 2] + C[2, 1]
    else:
        w, x, y, z = z, C[0, 2] + C[2, 0], C[1, 2] + C[2, 1], 1.0 - c11 - c22 + c33
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    if w < 0.0:
        scale = -scale
    quaternion[0], quaternion[1], quaternion[2], quaternion[3] = w * scale, x * scale, y * scale, z * scale


@njit(cache=True)
def rotation_vector(R: Float) -> Vector:
    """Rotation vector of a matrix [rad]."""
    q = np.empty(4)
    quaternion_from_matrix(R, q)
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 2.0 * math.atan2(sine, q[0]) / sine if sine > 0.0 else 2.0
    return q[1] * scale, q[2] * scale, q[3] * scale


@njit(cache=True)
def cross(a: Vector, b: Vector) -> Vector:
    """The product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def increments(
    alpha: Float, upsilon: Float, beta: Float, sigma: Float, rotation: Float, velocity: Float
) -> None:
    """Fill the rotation vectors and the velocity increments of steps; see `pipeline.models.strapdown`.

    Parameters
    ----------
    alpha, upsilon : ndarray, shape (n, 3)
        Integrals of rate [rad] and specific force [m/s] over each step.
    beta, sigma : ndarray, shape (n, 3)
        Their first moments about the middle of the step, divided by its length [rad], [m/s].
    rotation, velocity : ndarray, shape (n, 3)
        Receive φ and u.
    """
    for i in range(alpha.shape[0]):
        a, u = (alpha[i, 0], alpha[i, 1], alpha[i, 2]), (upsilon[i, 0], upsilon[i, 1], upsilon[i, 2])
        b, s = (beta[i, 0], beta[i, 1], beta[i, 2]), (sigma[i, 0], sigma[i, 1], sigma[i, 2])
        coning, rotated, sculled = cross(a, b), cross(a, s), cross(u, b)
        phi = (a[0] + coning[0], a[1] + coning[1], a[2] + coning[2])
        eta = (
            u[0] + rotated[0] + sculled[0],
            u[1] + rotated[1] + sculled[1],
            u[2] + rotated[2] + sculled[2],
        )
        square = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
        sine, cosine = _sine_and_cosine(square)
        if square < _SERIES:
            third = (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0))) / 6.0
        else:
            third = (1.0 - sine) / square
        once = cross(phi, eta)
        twice = cross(phi, once)
        for j in range(3):
            rotation[i, j] = phi[j]
            velocity[i, j] = eta[j] + cosine * once[j] + third * twice[j]


@njit(cache=True)
def step(position: Float, velocity: Float, C: Float, rotation: Float, increment: Float, dt: float) -> None:
    """One step of the strapdown equations, in place; see the module.

    Parameters
    ----------
    position : ndarray, shape (3,)
        Latitude, longitude [rad], height [m]; longitude is not wrapped.
    velocity : ndarray, shape (3,)
        N, E, D [m/s].
    C : ndarray, shape (3, 3)
        Body to N, E, D.
    rotation : ndarray, shape (3,)
        Rotation vector of the body over the step against inertial space [rad].
    increment : ndarray, shape (3,)
        Integral of the specific force in the body axes of the step's beginning [m/s].
    dt : float
        [s].
    """
    north, east, down = velocity[0], velocity[1], velocity[2]
    half = dt / 2.0
    meridian, prime_vertical = radii(position[0], position[2])
    latitude, height = position[0] + north * half / meridian, position[2] - down * half
    meridian, prime_vertical = radii(latitude, height)
    g = gravity(latitude, height)
    sine, cosine = math.sin(latitude), math.cos(latitude)
    tangent = sine / cosine
    earth_n, earth_d = _RATE * cosine, -_RATE * sine

    a, b, c = increment[0], increment[1], increment[2]
    dv_n = C[0, 0] * a + C[0, 1] * b + C[0, 2] * c
    dv_e = C[1, 0] * a + C[1, 1] * b + C[1, 2] * c
    dv_d = C[2, 0] * a + C[2, 1] * b + C[2, 2] * c

    # Velocity at the middle: half a step with the rates of the beginning.
    rate_n, rate_e = east / prime_vertical, -north / meridian
    w_n, w_e, w_d = rate_n + 2.0 * earth_n, rate_e, 2.0 * earth_d - rate_n * tangent
    mid_n = north + 0.5 * dv_n + half * (w_d * east - w_e * down)
    mid_e = east + 0.5 * dv_e + half * (w_n * down - w_d * north)
    mid_d = down + 0.5 * dv_d + half * (w_e * north - w_n * east + g)

    rate_n, rate_e = mid_e / prime_vertical, -mid_n / meridian
    rate_d = -rate_n * tangent
    w_n, w_e, w_d = rate_n + 2.0 * earth_n, rate_e, 2.0 * earth_d + rate_d
    z_n, z_e, z_d = half * (rate_n + earth_n), half * rate_e, half * (rate_d + earth_d)
    velocity[0] = north + dv_n + (z_d * dv_e - z_e * dv_d) + dt * (w_d * mid_e - w_e * mid_d)
    velocity[1] = east + dv_e + (z_n * dv_d - z_d * dv_n) + dt * (w_n * mid_d - w_d * mid_n)
    velocity[2] = down + dv_d + (z_e * dv_n - z_n * dv_e) + dt * (w_e * mid_n - w_n * mid_e + g)

    # The frame turns by as much as the position moves, so both take the same mean velocity.
    mean_n, mean_e = 0.5 * (north + velocity[0]), 0.5 * (east + velocity[1])
    turn_n, turn_e = mean_e * dt / prime_vertical, -mean_n * dt / meridian
    position[0] -= turn_e
    position[1] += turn_n / cosine
    position[2] -= half * (down + velocity[2])
    turn_right(C, rotation[0], rotation[1], rotation[2])
    turn_left(C, -(turn_n + earth_n * dt), -turn_e, turn_n * tangent - earth_d * dt)


@njit(cache=True)
def navigate(
    dt: Float, rotation: Float, increment: Float, position: Float, velocity: Float, quaternion: Float
) -> int:
    """Fill position, velocity and attitude from their first rows on.

    Parameters
    ----------
    dt : ndarray, shape (n,)
        [s].
    rotation, increment : ndarray, shape (n, 3)
        As for `step`.
    position, velocity : ndarray, shape (n + 1, 3)
    quaternion : ndarray, shape (n + 1, 4)

    Returns
    -------
    int
        The row at which the latitude passes the polar limit or is not a number, else -1.
    """
    here, speed, C = position[0].copy(), velocity[0].copy(), np.empty((3, 3))
    matrix_from_quaternion(quaternion[0], C)
    if not abs(here[0]) <= _POLAR_LIMIT:
        return 0
    for i in range(dt.size):
        step(here, speed, C, rotation[i], increment[i], dt[i])
        if not abs(here[0]) <= _POLAR_LIMIT:
            return i + 1
        if i % _FRESH == _FRESH - 1:
            orthonormalise(C)
        for j in range(3):
            position[i + 1, j], velocity[i + 1, j] = here[j], speed[j]
        quaternion_from_matrix(C, quaternion[i + 1])
    return -1
