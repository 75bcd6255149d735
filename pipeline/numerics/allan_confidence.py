"""How well an Allan variance is known: power law of the noise, degrees of freedom, confidence interval.

The noise of a rate is taken as a power law ``S(f) ~ f^alpha`` about each tau: 2 white noise of the integral
(quantisation), 1 flicker of the integral, 0 white, -1 flicker, -2 random walk; `hadamard` bears -3 and -4.
A variance of M overlapping terms z is distributed about as chi-square with nu degrees of freedom::

    1/nu = (1/M) sum_l (1 - |l|/M) rho_l^2,     rho_l the autocorrelation of the terms

C. A. Greenhall & W. J. Riley, *Uncertainty of stability variances based on finite differences*, PTTI 2003:
``rho_l = s_z(l/m) / s_z(0)``, s_z the difference of order 2d, at spacing 1, of ``s_x``, which is::

    s_x(t) = F^2 (2 s_w(t) - s_w(t - 1/F) - s_w(t + 1/F)),   F = m; for modified variances F = 1
    s_w(t) = |t|^(3 - alpha),  for odd alpha times ln|t|

Their tables and cases are approximations of the sum above, which is taken as it stands here, over lags that
lie closely where s_z bends. The terms of different runs are independent (for white noise and a random walk
they are; for flicker nearly). For `total` the fit of SP 1065, table 7: ``nu = b T/tau - c``.

alpha comes from the lag-1 autocorrelation r of the rate averaged over tau (W. J. Riley & C. A. Greenhall,
*Power law noise identification using the lag 1 autocorrelation*, EFTF 2004): difference d times until
``delta = r/(1 + r) < 1/4``. For d = 0 then ``alpha = -2 delta``. Beyond, theirs holds for noise that is
made of samples; that of means over tau has other r, -0.217 for flicker and 1/4 for a random walk at d = 1,
and the alpha of the nearest is taken. Of M means r is known to about 1/sqrt(M), of thirty to 0.18, which is
as much as neighbouring laws are apart: the law of the tau before is kept unless r is farther from it than
chance makes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from pipeline.numerics import _kernels_allan as kernels
from pipeline.numerics.allan import Kind, Record, Variances, terms_of_runs

Float = NDArray[np.float64]
Integer = NDArray[np.int64]

FEWEST_MEANS = 30
"""Averages below which an autocorrelation tells nothing: the power law of the next smaller tau holds on."""

_CHANCE = 2.0
"""Standard deviations of r from its power law's up to which that is kept."""
_ALL_LAGS = 400
"""Lags up to which each is taken."""
_STATIONARY = 1 / 3
"""Autocorrelation, delta = 1/4, from which on the averages are differenced once more."""

_TOTAL = {0: (1.50, 0.0), -1: (1.17, 0.22), -2: (0.93, 0.36)}
"""b and c of table 7, by alpha."""
_TOTAL_BIAS = {-1: 1 / (3 * np.log(2)), -2: 0.75}
"""a of ``E total = allan (1 - a tau/T)``, SP 1065 (26), by alpha; else 0."""


@dataclass(frozen=True, slots=True)
class Confidence:
    """What is known of each variance of a `Variances`; all of shape (k,).

    Attributes
    ----------
    alpha : ndarray of int64
        Power law of the noise about tau.
    degrees_of_freedom : ndarray
        Nu.
    bias : ndarray
        Expected variance over the Allan variance that it estimates; below 1 for `total` alone.
    lower, upper : ndarray
        Bounds of the deviation, its bias removed, in the rate's unit.
    """

    alpha: Integer
    degrees_of_freedom: Float
    bias: Float
    lower: Float
    upper: Float


def confidence(
    record: Record, variances: Variances, *, level: float = 0.95, alpha: Integer | None = None
) -> Confidence:
    """Degrees of freedom and confidence intervals.

    Parameters
    ----------
    record : Record
    variances : Variances
        Of this record.
    level : float
        Probability that an interval holds the truth.
    alpha : ndarray of int, shape (k,), optional
        Power law about each tau; by default `identify`.
    """
    if alpha is None:
        alpha = identify(record, variances.factor, -4 if variances.kind == "hadamard" else -2)
    pairs = [(int(a), int(m)) for a, m in zip(alpha, variances.factor, strict=True)]
    nu = np.array([degrees_of_freedom(record.runs, m, variances.kind, a) for a, m in pairs])
    bias = np.array([_bias(record.runs, m, variances.kind, a) for a, m in pairs])
    tail = 0.5 * (1 - level)
    unbiased = variances.variance / bias
    lower = np.sqrt(unbiased * nu / chi2.isf(tail, nu))
    upper = np.sqrt(unbiased * nu / chi2.ppf(tail, nu))
    return Confidence(np.asarray(alpha, dtype=np.int64), nu, bias, lower, upper)


def identify(record: Record, factors: Integer, steepest: int = -2) -> Integer:
    """Power law of the noise about each tau, by the lag-1 autocorrelation.

    Parameters
    ----------
    record : Record
    factors : ndarray of int, shape (k,)
        Ascending.
    steepest : int
        Least alpha to tell: -2, or -4 for the Hadamard variance.

    Returns
    -------
    ndarray of int64, shape (k,)
        From 2 to ``steepest``. Where fewer than `FEWEST_MEANS` averages are left, or they do not contradict
        it, the one before holds on; before the first it is 0, white noise.
    """
    found, last = [], 0
    for m in factors:
        if not _holds(record, int(m), last):
            for order in range(-steepest // 2 + 1):
                r, count = kernels.lag_one(record.integral, record.starts, record.stops, int(m), order)
                if count + order < FEWEST_MEANS:
                    break
                if r < _STATIONARY or order == -steepest // 2:
                    last = _power_law(r, order)
                    break
        found.append(last)
    return np.array(found, dtype=np.int64)


def _holds(record: Record, m: int, alpha: int) -> bool:
    """Whether the averages may be of that power law: it is not given up for what chance does to r."""
    order = _order(alpha)
    r, count = kernels.lag_one(record.integral, record.starts, record.stops, m, order)
    if count + order < FEWEST_MEANS:
        return True
    # of m normal numbers that are about white r has the variance 1/m, and is biased by -1/m
    return bool(abs(r + 1 / count - _lag_one(alpha, order)) < _CHANCE / np.sqrt(count))


def _order(alpha: int) -> int:
    """How often averages of that power law are differenced."""
    return max(0, (1 - alpha) // 2)


def _power_law(r: float, order: int) -> int:
    """The power law whose averages, differenced so often, have a lag-1 autocorrelation next to r."""
    if order == 0:
        return int(np.clip(np.round(-2 * r / (1 + r)), -1, 2))
    candidates = range(2 - 2 * order, -2 * order - 1, -1)
    apart = [abs(_lag_one(alpha, order) - r) for alpha in candidates]
    return candidates[int(np.argmin(apart))]


def _lag_one(alpha: int, order: int) -> float:
    """Lag-1 autocorrelation of averages of a power law, differenced so often."""
    if order == 0:
        return -alpha / (2 + alpha)
    weights = _alternating_binomials(2 * order + 2)
    k = np.arange(-order - 1.0, order + 2)
    return float((weights @ _s_w(np.abs(k + 1), 1 - alpha)) / (weights @ _s_w(np.abs(k), 1 - alpha)))


def degrees_of_freedom(runs: Integer, m: int, kind: Kind, alpha: int) -> float:
    """Equivalent degrees of freedom of a variance.

    Parameters
    ----------
    runs : ndarray of int, shape (r,)
        Samples between gaps.
    m : int
        Factor; at least one run has a term.
    kind : str
        Of `allan.KINDS`.
    alpha : int
        From 2 to -2, for "hadamard" to -4.
    """
    lengths, times = np.unique(runs, return_counts=True)
    terms = terms_of_runs(lengths, m, kind)
    lengths, times, terms = lengths[terms > 0], times[terms > 0], terms[terms > 0]
    share = terms / (times @ terms)
    order = 3 if kind == "hadamard" else 2
    lag, squared = _squared_autocorrelation(m, order, kind == "modified" and m > 1, alpha)
    inverse = np.array([_mean_square(lag, squared, int(M)) for M in terms])
    if kind == "total":
        inverse = _of_total(inverse, lengths, m, alpha)
    return float(1 / (times @ (share**2 * inverse)))


def _of_total(inverse: Float, runs: Integer, m: int, alpha: int) -> Float:
    """1/nu of `total` in single runs, from that of as many terms without images."""
    if alpha <= 0:
        b, c = _TOTAL[alpha]
        return np.maximum(inverse, 1 / (b * runs / m - c))
    # White noise of the integral, of variance 1: a term has the variance 6, one with an image 10, of which 4
    # are of the end point, common to all m - 1 images of an end.
    terms, images = runs - 1, m - 1
    variance = 72 * terms**2 * inverse + 64 * images**2 + 320 * images
    return np.asarray(variance / (2 * (6 * terms + 8 * images) ** 2), dtype=np.float64)


def _mean_square(lag: Float, squared: Float, M: int) -> float:
    """``(1/M) sum_l (1 - |l|/M) rho_l^2``: rho^2 at the lags, straight lines between them, 0 beyond."""
    near = np.append(lag[lag < M], min(M, lag[-1]))
    f = np.interp(near, lag, squared) * (1 - near / M)
    return float(2 * np.trapezoid(f, near) + f[-1]) / M


def _squared_autocorrelation(m: int, order: int, modified: bool, alpha: int) -> tuple[Float, Float]:
    """Lags from 0 to (order + 1) m, and rho^2 at them."""
    lag = _lags(m, order)
    F = 1.0 if modified else np.inf if alpha <= 0 else float(m)
    t = lag / m
    k = np.arange(-order, order + 1)
    weights = _alternating_binomials(2 * order)
    z = weights @ _s_x(np.abs(t + k[:, np.newaxis]), F, 3 - alpha)
    return lag, (z / z[0]) ** 2


def _lags(m: int, order: int) -> Float:
    """Whole lags from 0 to (order + 1) m: all, or closely about the multiples of m, where s_z bends."""
    last = (order + 1) * m
    if last <= _ALL_LAGS:
        return np.arange(last + 1.0)
    away = np.unique(np.round(np.concatenate([np.arange(4), np.geomspace(4, m / 2, 24)])))
    near = np.arange(order + 2)[:, np.newaxis] * m + np.concatenate([-away, away])
    even = np.round(np.linspace(0, last, 24 * (order + 1) + 1))
    lag = np.unique(np.concatenate([near.ravel(), even]))
    return np.asarray(lag[(lag >= 0) & (lag <= last)], dtype=np.float64)


def _s_x(t: Float, F: float, power: int) -> Float:
    """Of t >= 0; for infinite F minus the second derivative of s_w, but for what z does not depend on."""
    if np.isinf(F):
        return -_s_w(t, power - 2)
    return F**2 * (2 * _s_w(t, power) - _s_w(np.abs(t - 1 / F), power) - _s_w(t + 1 / F, power))


def _s_w(t: Float, power: int) -> Float:
    if power % 2:
        return t**power
    return t**power * np.log(np.where(t > 0, t, 1.0))


def _alternating_binomials(n: int) -> Float:
    """Weights of the difference of order n."""
    weights = np.ones(1)
    for _ in range(n):
        weights = np.convolve(weights, [1.0, -1.0])
    return weights


def _bias(runs: Integer, m: int, kind: Kind, alpha: int) -> float:
    """Expected value over that of the Allan variance."""
    if kind != "total" or alpha == 0:
        return 1.0
    terms = terms_of_runs(runs, m, kind)
    used = terms > 0
    if alpha > 0:
        return float(1 + 8 * (m - 1) * used.sum() / (6 * terms.sum()))
    return float(1 - _TOTAL_BIAS[alpha] * m * np.sum(terms[used] / runs[used]) / terms.sum())
