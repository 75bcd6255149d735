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
from pipeline.models.gyro_drift import DRIFT, PARAMETERS, TILT, linear_model, misalignment_basis
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


def integrals(tau: Float, alpha: Float, base: Base, quadrature: Quadrature, *, errors: bool) -> Integrals:
    """Integrate c and F along the measured angles, over each step.

    Parameters
    ----------
    tau : ndarray, shape (n,)
        Time in units of the Earth rate, evenly spaced; for Simpson's rule n is odd.
    alpha : ndarray, shape (n, 2)
        Gimbal angles, unwrapped [rad].
    base : Base
        The base as it is meant to stand.
    quadrature : {"trapezoid", "simpson", "cubic_spline", "quintic_spline"}
        Simpson's rule has its full order over pairs of steps; segments of even length use no other.
    errors : bool
        Whether the installation errors theta and eta are among the parameters; else the drift alone.
    """
    c, F = linear_model(alpha, base)
    names: tuple[str, ...] = DRIFT
    columns = F[:, :, : len(DRIFT)]
    if errors:
        tilt = F[:, :, len(DRIFT) : len(DRIFT) + len(TILT)]
        misalignment = F[:, :, PARAMETERS.index("epsilon1") :] @ misalignment_basis(base)
        columns, names = np.concatenate([columns, tilt, misalignment], axis=2), (*DRIFT, *TILT, *ETA)
    together = np.concatenate([c[:, :, np.newaxis], columns], axis=2)
    steps = _over_steps(tau, together.reshape(len(tau), -1), quadrature).reshape(-1, *together.shape[1:])
    return Integrals(names, steps[:, :, 0], steps[:, :, 1:])


def _over_steps(tau: Float, y: Float, quadrature: Quadrature) -> Float:
    """Integral of each column of y, shape (n, k), from each sample to the next, shape (n - 1, k)."""
    if quadrature in _SPLINE_DEGREES:
        _, increments = fit(Method("spline", _SPLINE_DEGREES[quadrature]), tau, y).sample(tau)
        return np.asarray(increments[1:], dtype=np.float64)
    h = (tau[-1] - tau[0]) / (len(tau) - 1)
    steps = h / 2 * (y[:-1] + y[1:])
    if quadrature == "simpson":
        # The parabola through three samples, integrated over its first and its second half.
        left, middle, right = y[:-2:2], y[1:-1:2], y[2::2]
        steps[0::2] = h / 12 * (5 * left + 8 * middle - right)
        steps[1::2] = h / 12 * (5 * right + 8 * middle - left)
    return np.asarray(steps, dtype=np.float64)


def _cumulated(steps: Float) -> Float:
    """Sum of the steps up to each sample: one row more than there are steps, the first 0."""
    return np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])
