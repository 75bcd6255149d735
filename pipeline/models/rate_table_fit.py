"""Least squares on the means of steps, whose scatter may exceed their own noise.

The standard error of a step's mean is that of the noise within the step. What changes from step to step only
(a bias that wanders, a rate the table did not keep) shows in the residuals. Its variance tau^2 is that for
which the weighted squares of the residuals come to their degrees of freedom (Paule & Mandel, *J. Res. Nat.
Bur. Stand.* 87 (1982) 377-385) ::

    sum r_i^2 / (s_i^2 + tau^2) = n - k

It counts where chance would seldom (one in twenty) have made the sum as large with tau = 0; to count it where
chance often does would overrate every standard error.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import chi2

from pipeline.models.rate_table_steps import RateTableError
from pipeline.numerics.least_squares import Solution, solve

Float = NDArray[np.float64]

_ROUNDING = 1e-12
"""Of the largest output: a mean of many samples, each of them rounded."""
_CHANCE = 0.05
_PRECISION = 1e-3
"""Of tau^2 over its upper bound, where it is sought; a standard error changes by half as much."""


def weighted(A: Float, y: Float, error: Float, names: Sequence[str], prior: Float | None = None) -> Solution:
    """Solve rows of unequal standard deviation; ``residual`` is in units of these.

    Parameters
    ----------
    A : ndarray, shape (n, k)
    y, error : ndarray, shape (n,)
        Observations and their standard deviations.
    names : sequence of str
        Of the columns.
    prior : ndarray, shape (k,), optional
        Standard deviation of each parameter about 0; infinite for none.
    """
    return solve(A / error[:, np.newaxis], y / error, names, prior=prior, sigma=1.0)


def scatter(A: Float, y: Float, error: Float, prior: Float | None = None) -> float:
    """Standard deviation tau between steps, beyond that of their means; parameters as of `weighted`."""
    names = [str(k) for k in range(A.shape[1])]
    known = np.zeros(A.shape[1], dtype=np.bool_) if prior is None else np.isfinite(prior)

    def excess(variance: float) -> float:
        solution = weighted(A, y, np.sqrt(error**2 + variance), names, prior)
        square = float(solution.residual @ solution.residual)
        if prior is not None:
            square += float(np.sum((solution.estimate[known] / prior[known]) ** 2))
        return square - freedom

    start = weighted(A, y, error, names, prior)
    freedom = len(y) + int(known.sum()) - (start.rank if prior is None else A.shape[1] - len(start.unknown))
    if freedom < 1 or chi2.sf(excess(0.0) + freedom, freedom) > _CHANCE:
        return 0.0
    # With this much for each residual of the plain solution the sum is below the degrees of freedom.
    plain = (start.residual * error) ** 2
    most = float(plain.sum() / freedom) + float(error.max() ** 2)
    while excess(most) > 0:
        most *= 4
    return float(np.sqrt(brentq(excess, 0.0, most, xtol=_PRECISION * most)))


def usable(y: Float, error: Float, gyro: str) -> Float:
    """Standard errors of the outputs, shape (n,), none below their rounding.

    Raises
    ------
    RateTableError
        If the output never changes.
    """
    if not np.ptp(y) > 0:
        raise RateTableError(
            gyro,
            expected="an output that changes with the rate",
            found=f"{y[0]:.6g} in every step",
            remedy="check the channel, its unit and its quantisation",
        )
    return np.asarray(np.maximum(error, _ROUNDING * np.abs(y).max()), dtype=np.float64)


def reference(temperature: Float | None, given: float | None) -> float:
    """T0 [K]: as given, or the mean of the observations."""
    if given is not None:
        return given
    return float("nan") if temperature is None else float(temperature.mean())


def warmth(temperature: Float | None, reference: float, count: int, *, needed: bool) -> Float:
    """T - T0 [K], shape (count,); zero where it is not needed.

    Raises
    ------
    RateTableError
        If it is needed and there is no temperature.
    """
    if not needed:
        return np.zeros(count)
    if temperature is None:
        raise RateTableError(
            "temperature",
            expected="a temperature, for a calibration with terms of it",
            found="none",
            remedy="give the temperature of the gyro, or calibrate without these terms",
        )
    return np.asarray(temperature - reference, dtype=np.float64)
