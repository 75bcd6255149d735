"""Rows of a regression for the drift of a non-contact gyro, from its measured gimbal angles.

The linear model ``alpha' = c(alpha) + F(alpha) p`` is integrated along the measured angles, so that no
angle is ever differentiated: Gubarenko & Kuzmenko (1995), (6.3) to (6.5). The quadrature decides
the accuracy: of samples a minute apart the trapezoid rule leaves 1e-4 degrees an hour, Simpson's 1e-8.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.models.earth import Base
from pipeline.models.gyro_drift import (
    DRIFT,
    PARAMETERS,
    TILT,
    in_platform,
    linear_model,
    misalignment_basis,
)
from pipeline.numerics.interpolation import Method, fit

Float = NDArray[np.float64]
Quadrature = Literal["trapezoid", "simpson", "cubic_spline", "quintic_spline"]

ETA = ("eta1", "eta2")
"""The two degrees of freedom of the misalignment: ``epsilon = B eta``, so that ``u.epsilon = 0``."""

_SPLINE_DEGREES = {"cubic_spline": 3, "quintic_spline": 5}


@dataclass(frozen=True, slots=True)
class Integrals:
    """Integrals of the linear model over each step between samples; sums of them lose no digits.

    Attributes
    ----------
    names : tuple of str
        Of the k parameters.
    c : ndarray, shape (n - 1, 2)
        Integral of c.
    F : ndarray, shape (n - 1, 2, k)
        Integral of F.
    """

    names: tuple[str, ...]
    c: Float
    F: Float

    def segments(self, alpha: Float, length: int) -> tuple[Float, Float]:
        """Rows ``A p = b`` of segments of ``length`` steps: ``A = int F``, ``b = Delta alpha - int c``.

        What is left over at the record's end, shorter than a segment, is not used.

        Parameters
        ----------
        alpha : ndarray, shape (n, 2)
            Gimbal angles, unwrapped [rad].
        length : int
            Steps a segment.

        Returns
        -------
        A : ndarray, shape (2 m, k)
        b : ndarray, shape (2 m,)
        """
        ends = np.arange(0, len(alpha), length)
        used = slice(0, ends[-1])
        A = np.add.reduceat(self.F[used], ends[:-1], axis=0)
        b = np.diff(alpha[ends], axis=0) - np.add.reduceat(self.c[used], ends[:-1], axis=0)
        return A.reshape(-1, len(self.names)), b.ravel()

    def cumulative(self, alpha: Float) -> tuple[Float, Float, tuple[str, ...]]:
        """Rows of ``alpha_j = alpha_0 + int_0^j c + int_0^j F p``, alpha_0 free.

        Parameters
        ----------
        alpha : ndarray, shape (n, 2)
            Gimbal angles, unwrapped [rad].

        Returns
        -------
        A : ndarray, shape (2 n, 2 + k)
        b : ndarray, shape (2 n,)
        names : tuple of str
            ``alpha1_0``, ``alpha2_0``, then the parameters.
        """
        start = np.broadcast_to(np.eye(2), (len(alpha), 2, 2))
        A = np.concatenate([start, _cumulated(self.F)], axis=2)
        b = alpha - _cumulated(self.c)
        return A.reshape(2 * len(alpha), -1), b.ravel(), ("alpha1_0", "alpha2_0", *self.names)


def integrals(
    tau: Float,
    alpha: Float,
    base: Base,
    quadrature: Quadrature,
    *,
    errors: bool,
    neglected: Float | None = None,
) -> Integrals:
    """Integrate c and F along the measured angles, over each step.

    Parameters
    ----------
    tau : ndarray, shape (n,)
        Time in units of the Earth rate, evenly spaced.
    alpha : ndarray, shape (n, 2)
        Gimbal angles, unwrapped [rad].
    base : Base
        The base as it is meant to stand.
    quadrature : {"trapezoid", "simpson", "cubic_spline", "quintic_spline"}
        Simpson's rule has its full order over pairs of steps; segments of even length use no other. Where
        the samples are too few for a spline's degree, it is the highest that they allow.
    errors : bool
        Whether the installation errors theta and eta are among the parameters; else the drift alone.
    neglected : ndarray, shape (n, 2), optional
        What the linear model lacks of the rates, known from elsewhere: added to c.
    """
    c, F = linear_model(alpha, base)
    if neglected is not None:
        c = c + neglected
    names: tuple[str, ...] = DRIFT
    columns = F[:, :, : len(DRIFT)]
    if errors:
        tilt = F[:, :, len(DRIFT) : len(DRIFT) + len(TILT)]
        misalignment = F[:, :, PARAMETERS.index("epsilon1") :] @ misalignment_basis(base)
        columns, names = np.concatenate([columns, tilt, misalignment], axis=2), (*DRIFT, *TILT, *ETA)
    together = np.concatenate([c[:, :, np.newaxis], columns], axis=2)
    steps = _over_steps(tau, together.reshape(len(tau), -1), quadrature).reshape(-1, *together.shape[1:])
    return Integrals(names, steps[:, :, 0], steps[:, :, 1:])


def weighted_integrals(tau: Float, alpha: Float, base: Base, quadrature: Quadrature, weights: Float) -> Float:
    """Integrals over each step of the drift's columns of F times functions of time.

    Parameters
    ----------
    tau, alpha, base, quadrature
        As for `integrals`.
    weights : ndarray, shape (n, q)
        The functions at the samples.

    Returns
    -------
    ndarray, shape (n - 1, 2, 6, q)
    """
    _, F = linear_model(alpha, base)
    y = F[:, :, : len(DRIFT), np.newaxis] * weights[:, np.newaxis, np.newaxis, :]
    return _over_steps(tau, y.reshape(len(tau), -1), quadrature).reshape(-1, *y.shape[1:])


def transitions(tau: Float, alpha: Float, base: Base, p: Float) -> Float:
    """How a small deviation of the angles from the measured ones grows over each step.

    The model is evaluated at measured angles, whose noise is integrated with it. To first order the
    deviation ``delta = alpha - alpha_measured`` obeys ``delta' = J delta``, ``J = d(c + F p)/d alpha``::

        alpha_(j+1) = alpha_mj + int c + int F p + Phi_j (alpha_j - alpha_mj)
        Phi_j = I + h J + (h J)^2 / 2,    J the mean over the step

    With it the rows of cumulative least squares have white residuals; with ``Phi = I``, the plain sums,
    their standard errors are up to two times too small.

    Parameters
    ----------
    tau : ndarray, shape (n,)
        Time in units of the Earth rate, evenly spaced.
    alpha : ndarray, shape (n, 2)
        Gimbal angles [rad].
    base : Base
        The base as it is meant to stand.
    p : ndarray, shape (11,) or (n, 11)
        Nominal parameters, in the order of `PARAMETERS`; a row a sample where they change in time.

    Returns
    -------
    ndarray, shape (n - 1, 2, 2)
    """
    J = jacobian(alpha, base, p)
    hJ = np.diff(tau)[:, np.newaxis, np.newaxis] * (J[:-1] + J[1:]) / 2
    return np.eye(2) + hJ + hJ @ hJ / 2


def jacobian(alpha: Float, base: Base, p: Float) -> Float:
    """``J = d(c + F p)/d alpha``, shape (n, 2, 2); parameters as in `transitions`.

    A vector in x turns with the platform, ``w = v3 cos alpha2 - v1 sin alpha2``::

        d v/d alpha1 = (v2 sin alpha2, w, -v2 cos alpha2),   d v/d alpha2 = (-v3, 0, v1)
    """
    m11, m12, m21, m22, _, mc2, theta1, theta2, _, eps2, eps3 = np.moveaxis(np.asarray(p), -1, 0)
    u, g = in_platform(base.u, alpha).T, in_platform(base.g, alpha).T
    s1, c1 = np.sin(alpha[:, 0]), np.cos(alpha[:, 0])
    C, t = np.cos(alpha[:, 1]), np.tan(alpha[:, 1])
    a, b = m11 + 2 * m12 * g[2], m21 + 2 * m22 * g[2]
    # row 1 of c + F p is N/C - eps1 + t e
    N = -u[0] - a * g[0] + b * g[1] - mc2 + theta2 * (u[2] - u[0] * t)
    e = eps3 * c1 - eps2 * s1
    J = np.empty((len(alpha), 2, 2))
    for k, (du, dg, dt, de) in enumerate(
        [
            (_turned_1(u, alpha), _turned_1(g, alpha), 0.0, -eps3 * s1 - eps2 * c1),
            (_turned_2(u), _turned_2(g), 1 / C**2, 0.0),
        ]
    ):
        da, db = 2 * m12 * dg[2], 2 * m22 * dg[2]
        tilt = du[2] - du[0] * t - u[0] * dt
        dN = -du[0] - da * g[0] - a * dg[0] + db * g[1] + b * dg[1] + theta2 * tilt
        J[:, 0, k] = dN / C + dt * e + t * de
        J[:, 1, k] = -du[1] - da * g[1] - a * dg[1] - db * g[0] - b * dg[0] - theta1 * tilt
    J[:, 0, 1] += N * t / C
    J[:, 1, 0] += eps2 * s1 - eps3 * c1
    return J


def _turned_1(v: Float, alpha: Float) -> Float:
    """Derivative by alpha1 of a vector in x, shape (3, n)."""
    s2, c2 = np.sin(alpha[:, 1]), np.cos(alpha[:, 1])
    return np.stack([v[1] * s2, v[2] * c2 - v[0] * s2, -v[1] * c2])


def _turned_2(v: Float) -> Float:
    """Derivative by alpha2 of a vector in x, shape (3, n)."""
    return np.stack([-v[2], np.zeros_like(v[0]), v[0]])


def _over_steps(tau: Float, y: Float, quadrature: Quadrature) -> Float:
    """Integral of each column of y, shape (n, k), from each sample to the next, shape (n - 1, k)."""
    n = len(tau)
    degree = min(_SPLINE_DEGREES.get(quadrature, 1), n - 1)
    if degree > 1:
        _, increments = fit(Method("spline", degree), tau, y).sample(tau)
        return np.asarray(increments[1:], dtype=np.float64)
    h = (tau[-1] - tau[0]) / max(n - 1, 1)
    steps = h / 2 * (y[:-1] + y[1:])
    if quadrature == "simpson" and n > 2:
        # The parabola through three samples, integrated over its first and its second half.
        left, middle, right = y[:-2:2], y[1:-1:2], y[2::2]
        steps[0 : n - 2 : 2] = h / 12 * (5 * left + 8 * middle - right)
        steps[1::2] = h / 12 * (5 * right + 8 * middle - left)
        # A step left over is the second half of the last three samples.
        steps[-1] = h / 12 * (5 * y[-1] + 8 * y[-2] - y[-3])
    return np.asarray(steps, dtype=np.float64)


def _cumulated(steps: Float) -> Float:
    """Sum of the steps up to each sample: one row more than there are steps, the first 0."""
    return np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])
