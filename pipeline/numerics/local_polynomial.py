"""Local polynomial interpolation: on each interval, the polynomial through the nearest samples.

On [t_i, t_{i+1}] a polynomial of degree d passes through the d + 1 samples from ``i - (d - 1)//2`` on:
the two ends for d = 1, i … i+2 for 2, i-1 … i+2 for 3, i-1 … i+3 for 4, i-2 … i+3 for 5; near the ends
of the record the samples are shifted inward (Godorov & Lutmanov 2016 use d = 3). It is continuous, not
smooth, and O(n) with no system to solve.

On a uniform grid, u = (t - t_i)/h, the value at u is Σ_k L_k(u) y_k with the Lagrange polynomials L_k of
the integers, so the integral over an interval has constant weights, ``h ∫₀¹ L_k du``: for d = 3 inside the
record ``h (-1, 13, 13, -1)/24``.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics import _kernels_interpolation as _kernels
from pipeline.numerics.piecewise import PiecewisePolynomial

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LocalPolynomial:
    """The interpolant of samples ``y``, shape (n, channels), at strictly ascending times ``t``.

    Raises
    ------
    ValueError
        If there are fewer than degree + 1 samples.
    """

    t: Float
    y: Float
    degree: int

    def __post_init__(self) -> None:
        if len(self.t) <= self.degree:
            raise ValueError(f"degree {self.degree} needs {self.degree + 1} samples, found {len(self.t)}")

    def sample(self, times: Float) -> tuple[Float, Float]:
        """Values, and exact integrals from each time to the next."""
        on_samples = times is self.t or np.array_equal(times, self.t)
        if on_samples and len(self.t) > 2 * self.degree and is_uniform(self.t):
            return self.y, self._increments_at_samples()
        return self.piecewise().sample(times)

    def piecewise(self) -> PiecewisePolynomial:
        """The same function by its coefficients."""
        y = np.ascontiguousarray(self.y.T)
        coefficients = np.empty((y.shape[0], len(self.t) - 1, self.degree + 1))
        _kernels.local_coefficients(self.t, y, self.degree, coefficients)
        return PiecewisePolynomial(self.t, coefficients)

    def _increments_at_samples(self) -> Float:
        """Integrals between the samples of a uniform record, by constant weights."""
        y = np.ascontiguousarray(self.y.T)
        h = (self.t[-1] - self.t[0]) / (len(self.t) - 1)
        d, lead = self.degree, (self.degree - 1) // 2
        weights = [tuple(h * w for w in row) for row in integral_weights(d)]
        increments = np.empty_like(y)
        increments[:, 0] = 0.0
        for channel in range(y.shape[0]):
            _kernels.increments_uniform(y[channel], weights[lead], lead, increments[channel])
        for position in range(lead):
            increments[:, position + 1] = y[:, : d + 1] @ weights[position]
        for position in range(lead + 1, d):
            increments[:, position - d] = y[:, -d - 1 :] @ weights[position]
        return increments.T


def is_uniform(t: Float) -> bool:
    """Whether the steps differ by no more than the rounding of the times themselves."""
    step = (t[-1] - t[0]) / (len(t) - 1)
    rounding = 4 * np.finfo(np.float64).eps * max(abs(float(t[0])), abs(float(t[-1])))
    return bool(_kernels.steps_within(t, step, rounding))


@cache
def integral_weights(degree: int) -> tuple[tuple[float, ...], ...]:
    """``∫ L_k du`` over the interval [position, position + 1] of nodes 0 … degree, in exact fractions.

    Parameters
    ----------
    degree : int
        Of the polynomial through degree + 1 samples.

    Returns
    -------
    tuple of tuples
        One row a position 0 … degree - 1, one weight a node.
    """
    bases = [_lagrange(degree, node) for node in range(degree + 1)]
    return tuple(
        tuple(float(_integral(basis, position + 1) - _integral(basis, position)) for basis in bases)
        for position in range(degree)
    )


def _lagrange(degree: int, node: int) -> list[Fraction]:
    """Ascending coefficients of the polynomial that is 1 at the node and 0 at the others."""
    coefficients = [Fraction(1)]
    for other in set(range(degree + 1)) - {node}:
        shifted = [Fraction(0), *coefficients]
        scaled = [-other * c for c in coefficients] + [Fraction(0)]
        coefficients = [(a + b) / (node - other) for a, b in zip(shifted, scaled, strict=True)]
    return coefficients


def _integral(coefficients: list[Fraction], upper: int) -> Fraction:
    """Integral from 0 of a polynomial in ascending coefficients."""
    return sum((c * Fraction(upper) ** (k + 1) / (k + 1) for k, c in enumerate(coefficients)), Fraction(0))
