"""Whether residuals are white, and the autoregression that whitens them when they are not.

Ljung & Box, *Biometrika* 65 (1978) 297-303, for the test; Box, Jenkins & Reinsel, *Time Series Analysis*,
for the autoregression ``e_j = phi_1 e_(j-1) + ... + phi_p e_(j-p) + w_j`` with white w.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from pipeline.numerics.least_squares import triangular

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

LARGEST_ORDER = 12
"""Orders of the autoregression that are tried."""

_ROWS_A_COEFFICIENT = 10
"""Rows that a coefficient of the autoregression needs at least."""

_ROWS_OF_TAKEN = 500
"""Of an arc's rows so many tell what fitting took out of the noise."""

_LARGEST_ROOT = 0.999
"""An autoregression fitted beyond it is drawn in: without a standard deviation it would weigh nothing."""


def ljung_box(residual: Float, lags: int, observed: Mask | None = None) -> tuple[float, float]:
    """Test by Ljung & Box whether the autocorrelations of lags 1 to ``lags`` are zero.

    ``Q = n (n + 2) sum_k r_k^2 / n_k``, n_k pairs a lag; chi-square with ``lags`` degrees of freedom for each
    channel.

    Parameters
    ----------
    residual : ndarray, shape (n,) or (n, channels)
        Of mean about zero. The statistics of channels are added.
    lags : int
        Fewer than n.
    observed : ndarray of bool, shape (n,), optional
        Rows that count; pairs with any other are left out.

    Returns
    -------
    statistic : float
    p_value : float
        Probability of a statistic as large from white noise; 1 where there is nothing to test.
    """
    there = np.ones(len(residual), dtype=np.bool_) if observed is None else observed
    e = np.where(there[:, np.newaxis], residual.reshape(len(residual), -1), 0.0)
    n, power = int(there.sum()), np.sum(e**2, axis=0)
    e = e[:, power > 0]
    power = power[power > 0]
    statistic, degrees = 0.0, 0
    for k in range(1, lags + 1):
        pairs = int(np.sum(there[k:] & there[:-k]))
        if pairs:
            r = np.einsum("ij,ij->j", e[k:], e[:-k]) / power
            statistic += n * (n + 2) * float(r @ r) / pairs
            degrees += len(power)
    return statistic, float(chi2.sf(statistic, degrees)) if degrees else 1.0


@dataclass(frozen=True, slots=True)
class AutoRegression:
    """Coloured noise as an autoregression of white noise.

    Attributes
    ----------
    coefficients : ndarray, shape (p,)
        phi_1 to phi_p; all roots inside the unit circle.
    """

    coefficients: Float

    @property
    def order(self) -> int:
        """P."""
        return len(self.coefficients)

    @property
    def gain(self) -> float:
        """Of the slowest noise: its amplitude over that of the white noise behind it, ``1/(1 - sum phi)``."""
        return float(1 / (1 - self.coefficients.sum()))

    @property
    def spread(self) -> float:
        """Standard deviation of the coloured noise over that of the white noise behind it.

        ``sigma_e^2 / sigma_w^2 = prod 1 / (1 - k_i^2)`` over the partial autocorrelations k_i, found from the
        highest order down (Durbin & Levinson): positive however near to the unit circle the roots are.
        """
        phi, ratio = self.coefficients, 1.0
        while len(phi):
            k = phi[-1]
            left = max(1 - k**2, np.finfo(np.float64).eps)
            phi, ratio = (phi[:-1] + k * phi[-2::-1]) / left, ratio / left
        return float(np.sqrt(ratio))

    @property
    def memory(self) -> int:
        """Steps after which what is left of a disturbance is a thousandth, ``e^-7``."""
        return math.ceil(7 / (1 - _largest_root(self.coefficients)))

    def whiten(self, rows: Float, observed: Mask | None = None) -> Float:
        """``y_j - sum phi_k y_(j-k)`` along axis 0, of the rows all whose p predecessors are there.

        Parameters
        ----------
        rows : ndarray, shape (n, ...)
        observed : ndarray of bool, shape (n,), optional
            Rows that are there; by default all.

        Returns
        -------
        ndarray, shape (m, ...)
            ``m = n - p`` where all are observed.
        """
        p, n = self.order, len(rows)
        white = rows[p:].copy()
        for k, phi in enumerate(self.coefficients, start=1):
            white -= phi * rows[p - k : n - k]
        return white if observed is None else white[self.whole(observed)]

    def whole(self, observed: Mask) -> Mask:
        """Which rows of ``whiten(rows)`` have all they are made of, shape (n - p,)."""
        return _runs(observed, self.order)


def fit_autoregression(
    residuals: Sequence[Float],
    observed: Sequence[Mask] | None = None,
    taken: Sequence[Float] | None = None,
    largest: int = LARGEST_ORDER,
) -> AutoRegression | None:
    """The autoregression of residuals, of the order by Schwarz' criterion.

    Least squares on the rows all whose predecessors are there; channels and arcs share the coefficients.

    Parameters
    ----------
    residuals : sequence of ndarray, each of shape (n,) or (n, channels)
        One an arc.
    observed : sequence of ndarray of bool, each of shape (n,), optional
    taken : sequence of ndarray, each of shape (n, channels, q), optional
        Factor U of the covariance ``U U^T`` of what was fitted and so taken out of the noise. Without it slow
        noise is underrated, for the fitted columns are slow. This estimate and least squares weighted by it
        in turn are the EM algorithm (Dempster, Laird & Rubin, *J. R. Stat. Soc. B* 39 (1977) 1-38).
    largest : int
        Largest order.

    Returns
    -------
    AutoRegression or None
        None where white noise explains the residuals best, or there are too few rows to tell.
    """
    rows, corrections = [], []
    for number, residual in enumerate(residuals):
        there = np.ones(len(residual), dtype=np.bool_) if observed is None else observed[number]
        rows.append(_lagged(residual.reshape(len(residual), -1), there, largest, 1))
        if taken is not None:
            # What was fitted is slow: the mean of its products is known from some of the rows.
            every = max(len(residual) // _ROWS_OF_TAKEN, 1)
            U = taken[number].reshape(len(residual), -1)
            corrections.append(every**0.5 * _lagged(U, there, largest, every))
    n = sum(map(len, rows))
    if n < _ROWS_A_COEFFICIENT * (largest + 1):
        return None
    together = np.concatenate(rows + corrections)
    R = triangular(together)
    # Of order p the columns beyond are not used: what they would have explained stays in the residual.
    left = np.cumsum(R[::-1, -1] ** 2)[::-1]
    if left[-1] <= 0:
        return None
    orders = np.arange(largest + 1)
    order = int(np.argmin(n * np.log(left / n) + orders * np.log(n)))
    if order == 0:
        return None
    phi = np.linalg.solve(R[:order, :order], R[:order, -1])
    return AutoRegression(_stationary(np.asarray(phi, dtype=np.float64)))


def _lagged(e: Float, observed: Mask, order: int, every: int) -> Float:
    """Rows ``(e_(j-1), ..., e_(j-p), e_j)`` of each channel, of every so many j with all of them there."""
    if len(e) <= order:
        return np.empty((0, order + 1))
    j = order + np.flatnonzero(_runs(observed, order))[::every]
    return np.stack([e[j - k] for k in (*range(1, order + 1), 0)], axis=-1).reshape(-1, order + 1)


def _stationary(phi: Float) -> Float:
    """The coefficients, their roots drawn into the unit circle: ``phi_k <- phi_k rho^k``."""
    size = _largest_root(phi)
    if size <= _LARGEST_ROOT:
        return phi
    return phi * (_LARGEST_ROOT / size) ** np.arange(1, len(phi) + 1)


def _largest_root(phi: Float) -> float:
    return float(np.abs(np.roots([1.0, *-phi])).max())


def _runs(observed: Mask, order: int) -> Mask:
    """Which rows from ``order`` on are there with all ``order`` rows before them."""
    count = np.concatenate([[0], np.cumsum(observed)])
    return np.asarray(count[order + 1 :] - count[: -order - 1] == order + 1)
