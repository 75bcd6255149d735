"""Piecewise polynomials, and what every interpolant can do: be sampled with its exact integrals.

On the piece [t_i, t_{i+1}] with ``u = (t - t_i)/h``, ``h = t_{i+1} - t_i``::

    x(t) = Σ_k c_k u^k,      ∫ x dt from t_i = h Σ_k c_k u^{k+1}/(k + 1)

Integrals are taken piece by piece, never as differences of one running antiderivative, so that they keep
their digits in a long record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, PPoly

from pipeline.numerics import _kernels_interpolation as _kernels

Float = NDArray[np.float64]


class Interpolant(Protocol):
    """A function of time through samples of several channels."""

    def sample(self, times: Float) -> tuple[Float, Float]:
        """Values, and exact integrals from each time to the next.

        Parameters
        ----------
        times : ndarray, shape (m,)
            Ascending [s].

        Returns
        -------
        values, increments : ndarray, shape (m, channels)
            The integral over the step that ends at the row; 0 in the first row.
        """
        ...


@dataclass(frozen=True, slots=True)
class PiecewisePolynomial:
    """Polynomials of one degree between ascending breaks.

    Attributes
    ----------
    breaks : ndarray, shape (pieces + 1,)
        Strictly ascending [s].
    coefficients : ndarray, shape (channels, pieces, degree + 1)
        Of ascending powers of u, so that each has the unit of the value.
    """

    breaks: Float
    coefficients: Float

    @classmethod
    def from_powers(cls, powers: PPoly) -> PiecewisePolynomial:
        """The same function as a SciPy ``PPoly`` in powers of t - t_i, of values (channels,)."""
        order = powers.c.shape[0]
        widths = np.diff(powers.x) ** np.arange(order - 1, -1, -1)[:, np.newaxis]
        ascending = (powers.c * widths[:, :, np.newaxis])[::-1]
        return cls(powers.x, np.ascontiguousarray(np.transpose(ascending, (2, 1, 0))))

    @classmethod
    def from_spline(cls, spline: BSpline) -> PiecewisePolynomial:
        """The same function as a SciPy ``BSpline`` of values (channels,): ``c_k = h^k x^(k)(t_i)/k!``."""
        breaks = np.unique(spline.t)
        widths = np.diff(breaks)
        coefficients = np.empty((spline.c.shape[1], len(widths), spline.k + 1))
        for k in range(spline.k + 1):
            taylor = spline(breaks[:-1], nu=k) * (widths**k / math.factorial(k))[:, np.newaxis]
            coefficients[:, :, k] = taylor.T
        return cls(breaks, coefficients)

    def sample(self, times: Float) -> tuple[Float, Float]:
        """Values, and exact integrals from each time to the next; the end pieces are continued."""
        shape = (self.coefficients.shape[0], len(times))
        values, increments = np.empty(shape), np.empty(shape)
        _kernels.sample_piecewise(self.breaks, self.coefficients, times, values, increments)
        return values.T, increments.T

    def derivative(self) -> PiecewisePolynomial:
        """The derivative by time, on the same breaks."""
        order = self.coefficients.shape[2]
        scaled = self.coefficients[:, :, 1:] * np.arange(1, order)
        return PiecewisePolynomial(self.breaks, scaled / np.diff(self.breaks)[np.newaxis, :, np.newaxis])
