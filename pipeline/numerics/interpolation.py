"""Interpolants of sampled rates, or of rates recorded as angle increments.

====================  ==========  =====================================================================
method                degree      function
====================  ==========  =====================================================================
``linear``            —           straight lines between samples
``local_polynomial``  1 … 5       polynomial through the nearest samples (`local_polynomial`)
``spline``            2, 3, 5, 7  not-a-knot spline (SciPy ``make_interp_spline``)
``pchip``             —           monotone cubic of Fritsch & Butland (SciPy)
``akima``             —           cubic of Akima (SciPy)
``harmonic``          2, 3, 5, 7  sinusoids (`harmonic`) plus a spline of this degree through what they leave
====================  ==========  =====================================================================

All are O(n) in time and memory, for uniform and other times.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import Akima1DInterpolator, PchipInterpolator, make_interp_spline

from pipeline.numerics.harmonic import Harmonic, fit_harmonic
from pipeline.numerics.local_polynomial import LocalPolynomial
from pipeline.numerics.piecewise import Interpolant, PiecewisePolynomial

Float = NDArray[np.float64]
MethodName = Literal["linear", "local_polynomial", "spline", "pchip", "akima", "harmonic"]

DEGREES: Mapping[MethodName, tuple[int, ...]] = MappingProxyType(
    {"local_polynomial": (1, 2, 3, 4, 5), "spline": (2, 3, 5, 7), "harmonic": (2, 3, 5, 7)}
)
"""The degrees of each method that has a choice."""


@dataclass(frozen=True, slots=True)
class Method:
    """Which interpolant, as in the module's table.

    Attributes
    ----------
    name : str
    degree : int
        Of no meaning for linear, pchip and akima.
    harmonics : int
        Number of harmonics of the harmonic method.
    frequency : float, optional
        Where the harmonic method begins its search [Hz]; by default at the spectrum's peak.
    """

    name: MethodName
    degree: int = 3
    harmonics: int = 1
    frequency: float | None = None

    @property
    def samples_needed(self) -> int:
        """The fewest samples through which the interpolant is defined, of rates or of angles."""
        match self.name:
            case "local_polynomial" | "spline":
                return self.degree + 2
            case "harmonic":
                return max(self.degree + 2, 2 * self.harmonics + 4)
            case _:
                return 3


@dataclass(frozen=True, slots=True)
class HarmonicInterpolant:
    """The sinusoids plus the spline through what they leave: it passes through every sample."""

    harmonic: Harmonic
    remainder: PiecewisePolynomial

    def sample(self, times: Float) -> tuple[Float, Float]:
        """Values, and exact integrals from each time to the next."""
        values, increments = self.harmonic.sample(times)
        rest, rest_increments = self.remainder.sample(times)
        return values + rest, increments + rest_increments


def fit(method: Method, t: Float, y: Float) -> Interpolant:
    """The interpolant of samples.

    Parameters
    ----------
    method : Method
    t : ndarray, shape (n,)
        Strictly ascending times [s]; n at least ``method.samples_needed``.
    y : ndarray, shape (n, channels)
        Finite.

    Raises
    ------
    pipeline.numerics.harmonic.HarmonicError
        If the harmonic model is not determined by the samples.
    """
    match method.name:
        case "linear":
            return LocalPolynomial(t, y, 1)
        case "local_polynomial":
            return LocalPolynomial(t, y, method.degree)
        case "harmonic":
            found = fit_harmonic(t, y, method.harmonics, frequency=method.frequency)
            return HarmonicInterpolant(found.model, _spline(t, found.residual, method.degree))
        case _:
            return _smooth(method, t, y, method.degree)


def fit_from_angle(method: Method, t: Float, angle: Float) -> Interpolant:
    """The interpolant of rates whose integrals between the samples are those of the angle.

    It is the derivative of the interpolant of the angle, of one degree more; the harmonic model of the
    angle has a term linear in time besides.

    Parameters
    ----------
    method : Method
    t : ndarray, shape (n,)
        Strictly ascending times [s]; n at least ``method.samples_needed``.
    angle : ndarray, shape (n, channels)
        Sum of the increments up to each sample [rad].

    Raises
    ------
    pipeline.numerics.harmonic.HarmonicError
        If the harmonic model is not determined by the samples.
    """
    match method.name:
        case "linear":
            return LocalPolynomial(t, angle, 2).piecewise().derivative()
        case "local_polynomial":
            return LocalPolynomial(t, angle, method.degree + 1).piecewise().derivative()
        case "harmonic":
            found = fit_harmonic(t, angle, method.harmonics, frequency=method.frequency, with_slope=True)
            remainder = _spline(t, found.residual, method.degree + 1).derivative()
            return HarmonicInterpolant(found.model.derivative(found.slope), remainder)
        case _:
            return _smooth(method, t, angle, method.degree + 1).derivative()


def _smooth(method: Method, t: Float, y: Float, degree: int) -> PiecewisePolynomial:
    """The interpolants that SciPy builds."""
    match method.name:
        case "pchip":
            return PiecewisePolynomial.from_powers(PchipInterpolator(t, y))
        case "akima":
            return PiecewisePolynomial.from_powers(Akima1DInterpolator(t, y))
        case _:
            return _spline(t, y, degree)


def _spline(t: Float, y: Float, degree: int) -> PiecewisePolynomial:
    return PiecewisePolynomial.from_spline(make_interp_spline(t, y, k=degree))
