"""Generalised least squares under white noise plus a random walk, in O(n).

The integral of a noisy rate wanders: its error is a random walk, to which a sensor of angle would add
white noise. The rows of the model are::

    y_i = x_i beta + mu_i + e_i,     mu_i = mu_(i-1) + eta_i,     var e = R,  var eta = q

Its increments are a moving average of order one. With theta its coefficient and s2 the variance of its
innovations, ``q = (1 + theta)^2 s2`` and ``R = -theta s2``: theta = -1 is white noise, 0 a random walk.
A theta above 0, that is a negative R, is a random walk seen through an average: the mean over a block
has R = -q/6, the mean of its two ends R = -q/4. The Kalman filter of the scalar level mu holds for all of
them, and its innovations are the whitened rows (Harvey, *Forecasting, Structural Time Series Models and
the Kalman Filter*, 1989, ch. 3-4).

The rows are means over blocks of equal length and the walk begins at the beginning of the first, half a
block before its centre: ``var mu_0 = q/2``. The levels are those of the largest restricted likelihood,
s2 in closed form and theta by a one-dimensional search.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from pipeline.numerics._kernels_trend import jump_statistics, whitened_gram

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_SEARCH = np.arange(-16.0, 7.0)
"""Grid for log((1 + theta) / (1 - theta)): from q = 5e-14 R, white for any record, to theta = 0.995."""

_RANK = 1e-12
"""Eigenvalue of the scaled Gram matrix below which its combination of columns is not determined."""

_SMALLEST = np.finfo(np.float64).tiny


@dataclass(frozen=True, slots=True)
class Fit:
    """Coefficients with their covariance, and the noise they were weighted by.

    Attributes
    ----------
    coefficients : (p,) array
    covariance : (p, p) array
    white : float
        R, the variance of the white part of one row; negative as the module's text says.
    walk : float
        q, the variance that the random walk gains from one row to the next.
    """

    coefficients: Vector
    covariance: Matrix
    white: float
    walk: float


def ordinary_least_squares(design: Matrix, values: Vector) -> Vector:
    """Coefficients (p,) of least squares without weights; the smallest where they are not determined."""
    return np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)


def generalised_least_squares(
    design: Matrix,
    values: Vector,
    *,
    observed: NDArray[np.bool_] | None = None,
    jumps: NDArray[np.bool_] | None = None,
) -> Fit:
    """Least squares weighted by the residual's own noise, whose two levels it estimates.

    Parameters
    ----------
    design : (n, p) array
        Columns; n > p + 2 rows in use. A combination that they do not determine is left at its smallest.
    values : (n,) array
        The rows, at equal steps.
    observed : (n,) bool array, optional
        False where a row is missing.
    jumps : (n,) bool array, optional
        True where the level may have jumped by any amount since the row before.

    Returns
    -------
    Fit
    """
    n = values.size
    seen = np.ones(n, dtype=np.bool_) if observed is None else observed
    free = np.zeros(n, dtype=np.bool_) if jumps is None else jumps
    # The ordinary solution is taken out first: what is left has no digits to lose in the Gram matrix.
    start = ordinary_least_squares(design[seen], values[seen])
    columns = np.ascontiguousarray(np.column_stack([design, values - design @ start]))

    def criterion(u: float) -> float:
        return _restricted(columns, seen, free, u)[0]

    best = float(_SEARCH[int(np.argmin([criterion(float(u)) for u in _SEARCH]))])
    found = minimize_scalar(
        criterion, bounds=(best - 1.0, best + 1.0), method="bounded", options={"xatol": 1e-3}
    )
    u = float(found.x) if float(found.fun) <= criterion(best) else best
    _, correction, covariance, variance = _restricted(columns, seen, free, u)
    walk, white = _levels(u)
    return Fit(start + correction, variance * covariance, variance * white, variance * walk)


def jump_scores(
    residual: Vector, fit: Fit, *, observed: NDArray[np.bool_], jumps: NDArray[np.bool_]
) -> Vector:
    """How many standard deviations the level's step before each row is off, by all the other rows.

    Parameters
    ----------
    residual : (n,) array
        Rows less the fitted design.
    fit : Fit
        Whose noise levels count.
    observed, jumps : (n,) bool arrays
        As in `generalised_least_squares`.

    Returns
    -------
    (n,) array
        The auxiliary residuals of Harvey & Koopman (Biometrika 79, 1992); 0 where a jump is allowed.
    """
    scores: Vector = jump_statistics(np.ascontiguousarray(residual), observed, jumps, fit.walk, fit.white)
    return scores


def memory(fit: Fit) -> float:
    """Share of the last row in the estimate of the level: the filter's steady gain, 1 + theta, up to 1.

    Its inverse is the number of rows over which the estimates of the level hang together.
    """
    if fit.white <= 0:
        return 1.0
    ratio = fit.walk / fit.white
    return float((np.sqrt(ratio**2 + 4 * ratio) - ratio) / 2)


def _levels(u: float) -> tuple[float, float]:
    """Walk q and white R in units of the innovations' variance, for u = log((1 + theta) / (1 - theta))."""
    theta = np.tanh(u / 2)
    one_plus_theta = 2.0 / (1.0 + np.exp(-u))  # without the cancellation near theta = -1
    return float(one_plus_theta**2), float(-theta)


def _restricted(
    columns: Matrix, observed: NDArray[np.bool_], jumps: NDArray[np.bool_], u: float
) -> tuple[float, Vector, Matrix, float]:
    """-2 log restricted likelihood, coefficients, their covariance over s2, and s2, at a given u."""
    walk, white = _levels(u)
    gram, log_variances, count = whitened_gram(columns, observed, jumps, walk, white)
    size = np.sqrt(np.diag(gram)[:-1])
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    eigenvalues, vectors = np.linalg.eigh(scale[:, None] * gram[:-1, :-1] * scale)
    kept = eigenvalues > _RANK
    half = vectors[:, kept] / np.sqrt(eigenvalues[kept])  # the inverse is half halfᵀ
    projection = half.T @ (scale * gram[:-1, -1])
    degrees = count - int(np.count_nonzero(kept))
    variance = max((gram[-1, -1] - projection @ projection) / degrees, _SMALLEST)
    log_determinant = np.sum(np.log(eigenvalues[kept])) + 2.0 * np.sum(np.log(size[size > 0]))
    value = degrees * np.log(variance) + log_variances + log_determinant
    root = scale[:, None] * half
    return float(value), root @ projection, root @ root.T, float(variance)
