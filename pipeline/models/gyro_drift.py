"""Drift of a non-contact gyro in a two-axis gimbal: the exact model and its linear form.

Gubarenko & Kuzmenko, Mechanics of Solids (1995), corrected. A servo keeps the rotor fixed in its case by the
gimbal angles alpha1 (outer) and alpha2 (inner), whose rate, in units of the Earth's, tells the drift.

Frames: ``zeta`` the base, ``x`` the platform that carries the gyro. For v = u (Earth's rotation) or
g (gravity), with ``w = -v2 sin alpha1 + v3 cos alpha1`` (components in zeta on the right)::

    v1x = v1 cos alpha2 - w sin alpha2
    v2x = v2 cos alpha1 + v3 sin alpha1
    v3x = v1 sin alpha2 + w cos alpha2

Parameters: drift ``m11, m12, m21, m22, mc1, mc2`` (dimensionless: in units of the Earth rate), tilt of the
rotor ``theta1, theta2`` [rad], misalignment of the base ``epsilon = u x Delta chi`` [rad]. A prime is d/dtau.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.models.earth import Base

Float = NDArray[np.float64]

DRIFT = ("m11", "m12", "m21", "m22", "mc1", "mc2")
TILT = ("theta1", "theta2")
MISALIGNMENT = ("epsilon1", "epsilon2", "epsilon3")
PARAMETERS = (*DRIFT, *TILT, *MISALIGNMENT)
"""Columns of the linear model, in order."""


@dataclass(frozen=True, slots=True)
class Gyro:
    """A gyro: its drift m (6,) in the order of `DRIFT` [1], and its rotor's tilt theta (2,) [rad]."""

    m: Float
    theta: Float

    @property
    def rotor_axis(self) -> Float:
        """e3 = Exp(theta1, theta2, 0) z in x, shape (3,), exact."""
        size = float(np.hypot(*self.theta))
        sigma = np.sinc(size / np.pi)
        return np.array([self.theta[1] * sigma, -self.theta[0] * sigma, np.cos(size)])


def in_platform(v: Float, alpha: Float) -> Float:
    """Components in x of a vector given in zeta.

    Parameters
    ----------
    v : ndarray, shape (3,)
        Components in zeta.
    alpha : ndarray, shape (n, 2)
        Gimbal angles [rad].

    Returns
    -------
    ndarray, shape (n, 3)
    """
    s1, c1 = np.sin(alpha[:, 0]), np.cos(alpha[:, 0])
    s2, c2 = np.sin(alpha[:, 1]), np.cos(alpha[:, 1])
    w = -v[1] * s1 + v[2] * c1
    return np.stack([v[0] * c2 - w * s2, v[1] * c1 + v[2] * s1, v[0] * s2 + w * c2], axis=1)


def exact_rates(alpha: Float, gyro: Gyro, base: Base) -> Float:
    """Rates of the gimbal angles by the exact model.

    ::

        a = e3 x g,  b = e3 x a,  cos gamma = -e3.g
        M = (m11 - 2 m12 cos gamma) a + (m21 - 2 m22 cos gamma) b + (mc1, mc2, 0),  M <- M - (M.e3) e3
        alpha1' = (M2 - u3 e31 + u1 e33) / (sin alpha2 e31 - cos alpha2 e33)
        alpha2' = (M1 + (u3 + alpha1' sin alpha2) e32) / e33 - u2

    Parameters
    ----------
    alpha : ndarray, shape (n, 2)
        Gimbal angles [rad].
    gyro : Gyro
        Drift and tilt.
    base : Base
        The base as it stands, its misalignment included.

    Returns
    -------
    ndarray, shape (n, 2)
        alpha1', alpha2' in units of the Earth rate. alpha2 = +-90 degrees is singular.
    """
    u, g = in_platform(base.u, alpha), in_platform(base.g, alpha)
    e3 = gyro.rotor_axis
    m11, m12, m21, m22, mc1, mc2 = gyro.m
    a = np.cross(e3, g)
    b = np.cross(e3, a)
    cos_gamma = -(g @ e3)[:, np.newaxis]
    M = (m11 - 2 * m12 * cos_gamma) * a + (m21 - 2 * m22 * cos_gamma) * b + np.array([mc1, mc2, 0.0])
    M -= (M @ e3)[:, np.newaxis] * e3
    s2, c2 = np.sin(alpha[:, 1]), np.cos(alpha[:, 1])
    rate1 = (M[:, 1] - u[:, 2] * e3[0] + u[:, 0] * e3[2]) / (s2 * e3[0] - c2 * e3[2])
    rate2 = (M[:, 0] + (u[:, 2] + rate1 * s2) * e3[1]) / e3[2] - u[:, 1]
    return np.stack([rate1, rate2], axis=1)


def linear_model(alpha: Float, base: Base) -> tuple[Float, Float]:
    """The linear model ``alpha' = c + F p`` along a trajectory: (6.1), (6.7), (6.10), corrected.

    Parameters
    ----------
    alpha : ndarray, shape (n, 2)
        Gimbal angles [rad].
    base : Base
        The base as it is meant to stand; its misalignment is in p.

    Returns
    -------
    c : ndarray, shape (n, 2)
    F : ndarray, shape (n, 2, 11)
        Columns in the order of `PARAMETERS`. Of epsilon only two degrees of freedom are real:
        ``u.epsilon = 0`` is to be imposed, see `misalignment_basis`.
    """
    u1, u2, u3 = in_platform(base.u, alpha).T
    g1, g2, g3 = in_platform(base.g, alpha).T
    s1, c1 = np.sin(alpha[:, 0]), np.cos(alpha[:, 0])
    C, t = np.cos(alpha[:, 1]), np.tan(alpha[:, 1])
    zero, one = np.zeros_like(t), np.ones_like(t)
    tilt = u3 - u1 * t
    row1 = [
        -g1 / C, -2 * g1 * g3 / C, g2 / C, 2 * g2 * g3 / C, zero, -1 / C,
        zero, tilt / C, -one, -t * s1, t * c1,
    ]  # fmt: skip
    row2 = [
        -g2, -2 * g2 * g3, -g1, -2 * g1 * g3, one, zero,
        -tilt, zero, zero, -c1, -s1,
    ]  # fmt: skip
    F = np.stack([np.stack(row1, axis=1), np.stack(row2, axis=1)], axis=1)
    return np.stack([-u1 / C, -u2], axis=1), F


def misalignment_basis(base: Base) -> Float:
    """B, shape (3, 2), orthonormal and orthogonal to u: ``epsilon = B eta`` imposes ``u.epsilon = 0``."""
    _, _, Vt = np.linalg.svd(base.u[np.newaxis, :])
    return np.ascontiguousarray(Vt[1:].T)


def misalignment_from_epsilon(epsilon: Float, base: Base) -> Float:
    """The part of Delta chi [rad] across u that an epsilon with ``u.epsilon = 0`` tells: ``epsilon x u``."""
    return np.cross(epsilon, base.u)
