"""Linear least squares by singular values, with named columns, priors, and what the rows do not determine.

For rows ``A p = b + noise`` of standard deviation sigma and priors ``p_i = mu_i +- s_i`` the estimate
minimises ``|A p - b|^2 / sigma^2 + sum ((p_i - mu_i) / s_i)^2``. Never the normal equations: they square the
condition number. Many rows are first turned into a triangle by QR, which keeps what they say of p and the
residual's norm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics import _kernels_least_squares as _kernels

Float = NDArray[np.float64]

_BLOCK = 256
"""Rows factorised at a time: they stay in the processor's cache."""

_TALL = 2
"""Rows a column beyond which QR before the singular values is quicker."""


@dataclass(frozen=True, slots=True)
class Solution:
    """An estimate and its uncertainty.

    Attributes
    ----------
    names : tuple of str
        Of the k columns.
    estimate : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
        Of the determined part; the null directions have none.
    sigma : float
        Standard deviation of the rows: as given, or from the residual.
    residual : ndarray, shape (n,)
        ``b - A p``.
    singular_values : ndarray, shape (k,)
        Of A without the priors, falling.
    directions : ndarray, shape (k, k)
        Row i is the direction in parameter space of singular value i.
    rank : int
        How many directions the rows determine.
    factor : ndarray, shape (k, r)
        ``covariance = factor factor^T``; A times it, over sigma, has orthonormal columns where there are no
        priors.
    unknown : ndarray, shape (k - r, k)
        Directions that neither the rows nor the priors determine.
    """

    names: tuple[str, ...]
    estimate: Float
    covariance: Float
    sigma: float
    residual: Float
    singular_values: Float
    directions: Float
    rank: int
    factor: Float
    unknown: Float

    @property
    def standard_errors(self) -> Float:
        """Of each parameter, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; infinite where there is a null direction."""
        if self.rank < len(self.names):
            return float("inf")
        return float(self.singular_values[0] / self.singular_values[-1])


def solve(
    A: Float,
    b: Float,
    names: Sequence[str],
    *,
    prior: Float | None = None,
    prior_mean: Float | None = None,
    sigma: float | None = None,
    observations: int | None = None,
) -> Solution:
    """Solve for the parameters by SVD.

    Parameters
    ----------
    A : ndarray, shape (n, k)
        One row an observation, one column a parameter.
    b : ndarray, shape (n,)
        Observations.
    names : sequence of str
        Of the columns.
    prior : ndarray, shape (k,), optional
        Standard deviation of each parameter before the observations; infinite for none.
    prior_mean : ndarray, shape (k,), optional
        About which; by default 0.
    sigma : float, optional
        Standard deviation of a row; without it, that of the residual with ``observations - rank`` degrees of
        freedom.
    observations : int, optional
        How many there are, where the rows are triangles that stand for more; by default n.

    Returns
    -------
    Solution
        In null directions (without prior) the estimate is 0: the shortest of all that fit.
    """
    count = len(b) if observations is None else observations
    k = A.shape[1]
    small = np.column_stack([A, b])
    if len(small) > _TALL * (k + 1):
        small = triangular(small)
    values, directions, rank = _spectrum(small[:, :k], count)
    scale = sigma if sigma is not None else _residual_sigma(small[:, :k], small[:, k], count, rank)
    # The priors enter as further rows of the scale of the observations, in units of the priors themselves:
    # where every column has one, none is lost beside much larger singular values.
    deviation = np.full(k, np.inf) if prior is None else np.asarray(prior, dtype=np.float64)
    known = np.isfinite(deviation)
    unit = np.where(known, deviation, 1.0)
    mean = np.zeros(k) if prior_mean is None else np.asarray(prior_mean, dtype=np.float64)
    rows = np.vstack([small[:, :k] * unit, scale * np.eye(k)[known]])
    U, s, Vt = np.linalg.svd(rows, full_matrices=len(rows) < k)
    s = np.pad(s, (0, k - len(s)))
    kept = s > (0.0 if known.all() else _tolerance(max(count, k), s))
    inverse = unit[:, np.newaxis] * Vt[kept].T / s[kept]
    right = np.concatenate([small[:, k], scale * (mean / unit)[known]])
    estimate = inverse @ (U[:, np.flatnonzero(kept)].T @ right)
    factor = scale * inverse
    return Solution(
        tuple(names),
        estimate,
        factor @ factor.T,
        scale,
        b - A @ estimate,
        values,
        directions,
        rank,
        factor,
        unit * Vt[~kept],
    )


def triangular(rows: Float) -> Float:
    """The triangle R of ``rows = Q R``, shape (k, k): the same products of columns, of k rows alone.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        Below k rows some rows of R are zero.
    """
    k = rows.shape[1]
    R = np.zeros((k, k))
    _kernels.factorise(np.ascontiguousarray(rows, dtype=np.float64), R, np.empty((k, _BLOCK)))
    return R


def _spectrum(A: Float, count: int) -> tuple[Float, Float, int]:
    _, values, directions = np.linalg.svd(A, full_matrices=A.shape[0] < A.shape[1])
    values = np.pad(values, (0, A.shape[1] - len(values)))
    return values, directions, int(np.sum(values > _tolerance(max(count, A.shape[1]), values)))


def _tolerance(size: int, values: Float) -> float:
    """Below this a singular value is rounding: ``eps max(n, k)`` times the largest."""
    return float(np.finfo(np.float64).eps * size * values[0])


def _residual_sigma(A: Float, b: Float, count: int, rank: int) -> float:
    residual = b - A @ np.linalg.lstsq(A, b, rcond=None)[0]
    return float(np.sqrt(residual @ residual / max(count - rank, 1)))
