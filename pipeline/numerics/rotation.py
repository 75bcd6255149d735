"""Rotations as quaternions, Euler-Krylov angles, matrices and rotation vectors.

Conventions are those of the package: a quaternion is ``(w, x, y, z)``, unit, and takes body components
to reference components; the body-to-reference matrix of the angles is ``R2(psi) R3(theta) R1(gamma)``.
Every function takes arrays whose last axis holds the components and works on all leading axes at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float = NDArray[np.float64]

_SMALL_ANGLE = 1e-4
"""Below this [rad] the two-term series of sin(x)/x is exact to the last digit: the third is x**4/120."""


def quaternion_multiply(left: ArrayLike, right: ArrayLike) -> Float:
    """Hamilton product: the rotation ``right`` followed by ``left``.

    Parameters
    ----------
    left, right : array_like, shape (..., 4)
        Quaternions; leading axes broadcast.

    Returns
    -------
    ndarray, shape (..., 4)
    """
    aw, ax, ay, az = np.moveaxis(np.asarray(left, dtype=np.float64), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(right, dtype=np.float64), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def quaternion_conjugate(quaternion: ArrayLike) -> Float:
    """The inverse rotation of unit quaternions, shape (..., 4)."""
    signs = np.array([1.0, -1.0, -1.0, -1.0])
    return np.asarray(np.multiply(quaternion, signs), dtype=np.float64)


def quaternion_from_euler_krylov(angles: ArrayLike) -> Float:
    """Quaternion ``q2(psi) q3(theta) q1(gamma)`` of Euler-Krylov angles.

    Parameters
    ----------
    angles : array_like, shape (..., 3)
        psi, theta, gamma [rad].

    Returns
    -------
    ndarray, shape (..., 4)
    """
    half = np.moveaxis(np.asarray(angles, dtype=np.float64), -1, 0) / 2
    (c2, c3, c1), (s2, s3, s1) = np.cos(half), np.sin(half)
    return np.stack(
        [
            c2 * c3 * c1 - s2 * s3 * s1,
            c2 * c3 * s1 + s2 * s3 * c1,
            s2 * c3 * c1 + c2 * s3 * s1,
            c2 * s3 * c1 - s2 * c3 * s1,
        ],
        axis=-1,
    )


def euler_krylov_from_quaternion(quaternion: ArrayLike) -> Float:
    """Euler-Krylov angles of quaternions, accurate up to the singularity theta = ±90°.

    With the half angles, ``w + z`` and ``x + y`` are proportional to the cosine and sine of
    (psi + gamma)/2 by the factor cos(theta/2) + sin(theta/2), and ``w - z``, ``y - x`` to those of
    (psi - gamma)/2 by cos(theta/2) - sin(theta/2). At the singularity one of the two is lost, and only
    the sum or the difference of psi and gamma is determined.

    Parameters
    ----------
    quaternion : array_like, shape (..., 4)
        Need not be exactly unit.

    Returns
    -------
    ndarray, shape (..., 3)
        psi and gamma in [-pi, pi], theta in [-pi/2, pi/2] [rad].
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    half_sum = np.arctan2(x + y, w + z)
    half_difference = np.arctan2(y - x, w - z)
    theta = np.arctan2(2 * (x * y + w * z), np.hypot(w + z, x + y) * np.hypot(w - z, y - x))
    return np.stack(
        [wrapped(half_sum + half_difference), theta, wrapped(half_sum - half_difference)], axis=-1
    )


def wrapped(angle: ArrayLike) -> Float:
    """The angle plus whole turns, in [-pi, pi] [rad]; one within half a turn loses no digit."""
    value = np.asarray(angle, dtype=np.float64)
    return np.asarray(value - 2 * np.pi * np.round(value / (2 * np.pi)), dtype=np.float64)


def matrix_from_quaternion(quaternion: ArrayLike) -> Float:
    """Body-to-reference matrices, shape (..., 3, 3), of unit quaternions, shape (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_from_matrix(matrix: ArrayLike) -> Float:
    """Quaternion of one body-to-reference matrix, w not negative.

    The matrix ``B = 4 q qᵀ`` is linear in the rotation matrix, so its row with the largest diagonal element
    is q but for its length (Shepperd, *J. Guidance and Control* 1 (1978) 223).

    Parameters
    ----------
    matrix : array_like, shape (3, 3)
        Orthonormal, determinant +1.

    Returns
    -------
    ndarray, shape (4,)
    """
    (m11, m12, m13), (m21, m22, m23), (m31, m32, m33) = np.asarray(matrix, dtype=np.float64)
    B = np.array(
        [
            [1 + m11 + m22 + m33, m32 - m23, m13 - m31, m21 - m12],
            [m32 - m23, 1 + m11 - m22 - m33, m12 + m21, m13 + m31],
            [m13 - m31, m12 + m21, 1 - m11 + m22 - m33, m23 + m32],
            [m21 - m12, m13 + m31, m23 + m32, 1 - m11 - m22 + m33],
        ]
    )
    q = B[np.argmax(np.diag(B))]
    return np.asarray(np.copysign(1.0, q[0]) * q / np.sqrt(q @ q), dtype=np.float64)


def quaternion_from_rotation_vector(rotation_vector: ArrayLike) -> Float:
    """Exponential map: ``(cos |v|/2, v sin(|v|/2) / |v|)``.

    Parameters
    ----------
    rotation_vector : array_like, shape (..., 3)
        Axis times angle [rad].

    Returns
    -------
    ndarray, shape (..., 4)
    """
    vector = np.asarray(rotation_vector, dtype=np.float64)
    angle = np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True))
    # np.sinc(x) is sin(pi x)/(pi x), and exact at zero.
    return np.concatenate([np.cos(angle / 2), vector * (np.sinc(angle / (2 * np.pi)) / 2)], axis=-1)


def rotation_vector_from_quaternion(quaternion: ArrayLike) -> Float:
    """Logarithm: the shortest rotation vector, angle in [0, pi].

    Parameters
    ----------
    quaternion : array_like, shape (..., 4)
        Need not be exactly unit.

    Returns
    -------
    ndarray, shape (..., 3)
        [rad].
    """
    q = np.asarray(quaternion, dtype=np.float64)
    scalar, vector = q[..., :1], q[..., 1:]
    sine = np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True))
    shortest = np.where(scalar < 0, -1.0, 1.0)
    angle = 2 * np.arctan2(sine, np.abs(scalar))
    tiny = sine < _SMALL_ANGLE
    # angle/sine = 2/|w| (1 - tan²/3 + …), tan = sine/|w|: the quotient itself is 0/0 at no rotation.
    series = 2 / np.maximum(np.abs(scalar), 0.5) * (1 - np.square(sine / np.maximum(np.abs(scalar), 0.5)) / 3)
    return np.asarray(
        shortest * vector * np.where(tiny, series, angle / np.where(tiny, 1.0, sine)), dtype=np.float64
    )
