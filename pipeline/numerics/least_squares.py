"""Linear least squares by singular values, with named columns, priors, and what the rows do not determine.

For rows ``A p = b + noise`` of standard deviation sigma and priors ``p_i = 0 +- s_i`` the estimate minimises
``|A p - b|^2 / sigma^2 + sum (p_i / s_i)^2``. Never the normal equations: they square the condition number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


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
    """

    names: tuple[str, ...]
    estimate: Float
    covariance: Float
    sigma: float
    residual: Float
    singular_values: Float
    directions: Float
    rank: int

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
    sigma: float | None = None,
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
        Standard deviation of each parameter about 0 before the observations; infinite for none.
    sigma : float, optional
        Standard deviation of a row; without it, that of the residual with ``n - rank`` degrees of freedom.

    Returns
    -------
    Solution
        In null directions (without prior) the estimate is 0: the shortest of all that fit.
    """
    values, directions, rank = _spectrum(A)
    weights = np.zeros(A.shape[1]) if prior is None else 1 / np.asarray(prior, dtype=np.float64)
    scale = sigma if sigma is not None else _residual_sigma(A, b, rank)
    # The priors enter as further rows of the scale of the observations.
    rows = np.vstack([A, scale * np.diag(weights)[weights > 0]])
    U, s, Vt = np.linalg.svd(rows, full_matrices=False)
    kept = s > _tolerance(rows, s)
    inverse = np.where(kept, 1 / np.where(kept, s, 1.0), 0.0)
    right = np.concatenate([b, np.zeros(len(rows) - len(b))])
    estimate = Vt.T @ (inverse * (U.T @ right))
    half = scale * Vt.T * inverse
    return Solution(tuple(names), estimate, half @ half.T, scale, b - A @ estimate, values, directions, rank)


def _spectrum(A: Float) -> tuple[Float, Float, int]:
    _, values, directions = np.linalg.svd(A, full_matrices=A.shape[0] < A.shape[1])
    values = np.pad(values, (0, A.shape[1] - len(values)))
    return values, directions, int(np.sum(values > _tolerance(A, values)))


def _tolerance(A: Float, values: Float) -> float:
    """Below this a singular value is rounding: ``eps max(n, k)`` times the largest."""
    return float(np.finfo(np.float64).eps * max(A.shape) * values[0])


def _residual_sigma(A: Float, b: Float, rank: int) -> float:
    residual = b - A @ np.linalg.lstsq(A, b, rcond=None)[0]
    return float(np.sqrt(residual @ residual / max(len(b) - rank, 1)))
