"""Coefficients of a rate's noise, from its Allan variances.

The model (IEEE Std 952-1997, annex C)::

    AVAR(tau) = 3 Q^2/tau^2 + N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3 + R^2 tau^2/2

Q is white noise of the integral (quantisation), N white noise of the rate, B its flicker, K its random walk,
R a ramp. The least squares are generalised: Allan variances at neighbouring tau come from the same samples,
and the fewer terms the less they are worth. With ``v_a = (x[i+2a] - 2 x[i+a] + x[i]) / (sqrt(2) a tau0)``, of
noise that is Gaussian but for the ramp's mean ``mu_a``::

    cov(V_a, V_b) = 2/(M_a M_b) sum_l w(l) [C(l)^2 + 2 mu_a mu_b C(l)]

w(l) counts the pairs of terms that are l apart in one run, and ``C(l) = cov(v_a[i], v_b[i + l])`` is a
difference of the generalised covariance of x (J.-P. Chiles & P. Delfiner, *Geostatistics*, 1999, ch. 4)::

    g(t) = Q^2 delta(t) - N^2 |t|/2 + B^2 t^2 ln|t|/(2 pi) + K^2 |t|^3/12

The squares of the coefficients are at least 0 (Lawson & Hanson); covariance and fit follow from each other
until they agree. Of all subsets of p terms the one is taken that has the least ``-2 ln L + p ln n``, L the
likelihood of the variances, whose cube roots are about normal (Wilson & Hilferty, *PNAS* 17 (1931) 684), n
the samples of the record. The intervals are not of that subset alone, which may be the wrong one: each end
is where the probabilities of all subsets, ``exp(-criterion/2)``, times their own tails have the tail asked
for as their sum (D. Turek & D. Fletcher, *Comput. Stat. Data Anal.* 56 (2012) 2809-2815). A term that is
left out has an upper bound: the largest by any subset that is within ln n of the least, or has that term
besides.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, nnls
from scipy.special import gammaincc, gammainccinv, gammaincinv, ndtri

from pipeline.numerics.allan import Record, UnusableRecordError, terms_of_runs, variances

Float = NDArray[np.float64]
Integer = NDArray[np.int64]
Name = Literal["Q", "N", "B", "K", "R"]

NAMES: tuple[Name, ...] = get_args(Name)
"""The coefficients, by the slope of their Allan variance."""

_AN_OCTAVE = 1
"""Factors an octave: closer ones tell the same again, and their covariance is all but singular."""
_ROUNDS = 30
_SETTLED = 1e-5
_RUNS_OF_LAGS = 32
"""Runs whose ends get lags of their own: of more the pairs together bend but slowly."""
_RIDGE = 1e-10
"""Of each variance, added to it: the quadrature of the covariances is no better."""


@dataclass(frozen=True, slots=True)
class Coefficient:
    """One coefficient, SI.

    Attributes
    ----------
    name : str
        Of `NAMES`.
    value, standard_error : float or None
        Q [rad], N [rad/sqrt(s)], B [rad/s], K [rad/s/sqrt(s)], R [rad/s^2] for a rate in rad/s. None where
        the record does not show the term.
    lower, upper : float
        Confidence interval; from 0 where the term was left out.
    """

    name: Name
    value: float | None
    standard_error: float | None
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class NoiseCoefficients:
    """The fitted model.

    Attributes
    ----------
    coefficients : tuple of Coefficient
        In the order of `NAMES`.
    covariance : ndarray, shape (5, 5)
        Of the squares Q^2, N^2, B^2, K^2, R^2; 0 where a term was left out.
    tau, variance, standard_error : ndarray, shape (k,)
        The Allan variances of the fit [s, unit^2], and how well each is known under the fitted model.
    criterion : dict of tuple of str to float
        Of each subset of terms the criterion, less the least: the fitted one has 0.
    """

    coefficients: tuple[Coefficient, ...]
    covariance: Float
    tau: Float
    variance: Float
    standard_error: Float
    criterion: dict[tuple[Name, ...], float]

    @property
    def left_out(self) -> tuple[Name, ...]:
        """Terms that the record does not show."""
        return tuple(c.name for c in self.coefficients if c.value is None)

    def model(self, tau: Float) -> Float:
        """The fitted Allan variance at any tau [s], shape as ``tau``."""
        squares = np.array([0.0 if c.value is None else c.value**2 for c in self.coefficients])
        return np.asarray(allan_terms(tau) @ squares, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class _Fit:
    """Of a subset of terms, in units of samples: squares (5,), covariances of them and of the variances."""

    subset: tuple[int, ...]
    squares: Float
    covariance: Float
    spread: Float
    criterion: float

    def standard_error(self, j: int) -> float:
        """Of square j."""
        return float(np.sqrt(self.covariance[j, j]))


def allan_terms(tau: Float) -> Float:
    """What a unit square of each coefficient adds to the Allan variance, shape (k, 5)."""
    flicker = np.full_like(tau, 2 * np.log(2) / np.pi)
    return np.column_stack([3 / tau**2, 1 / tau, flicker, tau / 3, tau**2 / 2])


def fit_coefficients(record: Record, *, level: float = 0.95) -> NoiseCoefficients:
    """Fit the coefficients that the record shows.

    Parameters
    ----------
    record : Record
    level : float
        Probability that an interval holds the truth.

    Returns
    -------
    NoiseCoefficients

    Raises
    ------
    UnusableRecordError
        If the longest run has too few samples for five tau, or the rate does not vary.
    """
    longest = int(record.runs.max()) // 2
    factors = np.unique(np.round(2 ** np.arange(0, np.log2(max(longest, 1)) + 1e-9, 1 / _AN_OCTAVE)))
    if len(factors) <= len(NAMES):
        raise UnusableRecordError(f"too short for noise coefficients: {2 * longest} samples without a gap")
    observed = variances(record, factors.astype(np.int64))
    if not observed.variance.all():
        raise UnusableRecordError("no noise coefficients of a rate that does not vary")
    lengths, times = np.unique(record.runs, return_counts=True)
    spreads = _spreads(tuple(observed.factor.tolist()), tuple(lengths.tolist()), tuple(times.tolist()))
    # Scaled to about 1, that squares of rad/s are no reason for nnls to stop.
    scale = float(np.median(observed.variance))
    V, A = observed.variance / scale, allan_terms(observed.factor.astype(np.float64))
    penalty = float(np.log(record.runs.sum()))
    subsets = [s for size in range(1, len(NAMES) + 1) for s in combinations(range(len(NAMES)), size)]
    fits = [fit for s in subsets if (fit := _fit(V, A, spreads, s, penalty)) is not None]
    shown = [fit for fit in fits if np.all(fit.squares[list(fit.subset)] > 0)]
    best = min(shown, key=lambda fit: fit.criterion)
    rivals = [
        fit for fit in fits if fit.criterion < best.criterion + penalty or set(fit.subset) > set(best.subset)
    ]
    # A square of the fit is that of a coefficient by these powers of the step.
    units = scale * record.step ** np.array([2.0, 1.0, 0.0, -1.0, -2.0])
    return NoiseCoefficients(
        tuple(_coefficient(j, best, shown, rivals, units[j], level) for j in range(len(NAMES))),
        best.covariance * np.outer(units, units),
        observed.tau,
        observed.variance,
        scale * np.sqrt(np.diag(best.spread)),
        {tuple(NAMES[j] for j in fit.subset): fit.criterion - best.criterion for fit in fits},
    )


def _coefficient(
    j: int, best: _Fit, shown: list[_Fit], rivals: list[_Fit], unit: float, level: float
) -> Coefficient:
    """Coefficient j of the best fit; left out, with the largest bound of the rivals that have it."""
    if j not in best.subset:
        width = float(ndtri(level))
        bounds = [fit.squares[j] + width * fit.standard_error(j) for fit in rivals if j in fit.subset]
        return Coefficient(NAMES[j], None, None, 0.0, float(np.sqrt(max(bounds) * unit)))
    square, error = best.squares[j] * unit, best.standard_error(j) * unit
    value = float(np.sqrt(square))
    lower, upper = np.sqrt(_interval(j, best, shown, level) * unit)
    return Coefficient(NAMES[j], value, float(error / (2 * value)), float(lower), float(upper))


def _interval(j: int, best: _Fit, shown: list[_Fit], level: float) -> Float:
    """Interval of square j, of all subsets by their probabilities ``exp(-criterion/2)``.

    A square of a fit is a weighted sum of squares: about chi-square, of ``nu = 2 (square/error)^2``, and so
    the truth is ``square nu/chi-square`` with the confidence of that; 0 of a subset that does not have the
    term.
    """
    weight = np.exp(-0.5 * np.array([fit.criterion - best.criterion for fit in shown]))
    weight /= weight.sum()
    has = np.array([j in fit.subset for fit in shown])
    square = np.array([fit.squares[j] for fit in shown])[has]
    error = np.array([fit.standard_error(j) for fit in shown])[has]
    nu = np.maximum(2 * (square / error) ** 2, 1.0)  # a square has one normal deviate at least
    tail = 0.5 * (1 - level)
    # chi-square of nu is twice a gamma variable of nu/2
    half, rare = 0.5 * nu, 1e-3 * tail
    lowest, highest = square * half / gammainccinv(half, rare), square * half / gammaincinv(half, rare)
    without = float(weight[~has].sum())

    def below(x: float) -> float:
        return without + float(weight[has] @ gammaincc(half, square * half / np.exp(x)))

    def bound(probability: float) -> float:
        ends = np.log(lowest.min()), np.log(highest.max())
        return float(np.exp(brentq(lambda x: below(x) - probability, *ends, xtol=1e-6)))

    return np.array([bound(tail) if below(np.log(lowest.min())) < tail else 0.0, bound(1 - tail)])


def _fit(V: Float, A: Float, spreads: Float, subset: tuple[int, ...], penalty: float) -> _Fit | None:
    """Generalised least squares of some terms, weighted by the covariance at their own solution."""
    columns = A[:, subset]
    # the first weights: each variance known to a part of itself that grows with tau
    relative = V * np.sqrt(np.arange(1, len(V) + 1))
    squares = np.zeros(len(NAMES))
    squares[list(subset)] = _non_negative(columns / relative[:, np.newaxis], V / relative)
    for _ in range(_ROUNDS):
        if not np.any(squares[:-1]):  # a ramp alone has no noise to weight it by
            return None
        before, spread = squares, _spread(squares, spreads)
        white = np.linalg.solve(np.linalg.cholesky(spread), np.column_stack([columns, V]))
        squares = np.zeros(len(NAMES))
        squares[list(subset)] = _non_negative(white[:, :-1], white[:, -1])
        if np.all(np.abs(A @ (squares - before)) <= _SETTLED * (A @ before)):
            break
    covariance = np.zeros((len(NAMES), len(NAMES)))
    covariance[np.ix_(subset, subset)] = np.linalg.inv(white[:, :-1].T @ white[:, :-1])
    criterion = _deviance(V, A @ squares, spread) + penalty * len(subset)
    return _Fit(subset, squares, covariance, spread, criterion)


def _deviance(V: Float, model: Float, spread: Float) -> float:
    """-2 ln L of the variances V, but for a constant; their cube roots over the model's are normal."""
    if not np.all(model > 0):
        return np.inf
    relative = spread / np.outer(model, model)
    mean = 1 - np.diag(relative) / 9
    factor = np.linalg.cholesky(relative / 9)
    residual = np.linalg.solve(factor, np.cbrt(V / model) - mean)
    volume = 2 * np.sum(np.log(np.diag(factor))) + 2 / 3 * np.sum(np.log(model))
    return float(residual @ residual + volume)


def _non_negative(A: Float, b: Float) -> Float:
    size = np.linalg.norm(A, axis=0)
    return np.asarray(nnls(A / size, b)[0] / size, dtype=np.float64)


def _spread(squares: Float, spreads: Float) -> Float:
    """Covariance of the Allan variances of noise with these squares, shape (k, k)."""
    spread = np.einsum("i,ijab,j->ab", squares, spreads, squares)
    return np.asarray(spread + _RIDGE * np.diag(np.diag(spread)), dtype=np.float64)


@lru_cache(maxsize=4)
def _spreads(factors: tuple[int, ...], lengths: tuple[int, ...], times: tuple[int, ...]) -> Float:
    """What the products of two squares add to the covariance of two Allan variances, shape (5, 5, k, k).

    Of runs of so many samples, each so many times. All in units of samples.
    """
    runs, often = np.array(lengths), np.array(times)
    terms = [int(often @ terms_of_runs(runs, m, "allan")) for m in factors]
    spreads = np.zeros((len(NAMES), len(NAMES), len(factors), len(factors)))
    for i, a in enumerate(factors):
        for j, b in enumerate(factors[i:], start=i):
            sums = _sums(a, b, runs, often) / (terms[i] * terms[j])
            spreads[:, :, i, j] = spreads[:, :, j, i] = sums
    return spreads


def _sums(a: int, b: int, runs: Integer, often: Integer) -> Float:
    """Sums over the lags of ``2 w C_p C_q`` and, with the ramp, ``2 w mu_a mu_b C_p``; shape (5, 5)."""
    lag = _lags(a, b, runs[runs >= 2 * b])
    # of the shifts k b - k' a, with the products of the weights of two second differences
    shift = (np.arange(3)[:, np.newaxis] * b - np.arange(3) * a).ravel()
    weight = np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0]).ravel() / (2.0 * a * b)
    t = np.abs(lag + shift[:, np.newaxis])
    logarithm = np.log(np.where(t > 0, t, 1.0))
    smooth = np.stack([weight @ g for g in (-t / 2, t**2 * logarithm / (2 * np.pi), t**3 / 12)])
    w = _pairs(lag, a, b, runs, often)
    between = _trapezoids(lag) * w
    sums = np.zeros((len(NAMES), len(NAMES)))
    sums[1:4, 1:4] = 2 * (smooth * between) @ smooth.T
    sums[1:4, 4] = sums[4, 1:4] = smooth @ between * (a * b)
    # white noise of x: at the lags alone where two of the points are one
    at, which = np.unique(-shift, return_inverse=True)
    peak = np.bincount(which, weights=weight)
    there = np.searchsorted(lag, at)
    sums[0, 0] = 2 * np.sum(w[there] * peak**2)
    sums[0, 1:4] = sums[1:4, 0] = 2 * smooth[:, there] @ (w[there] * peak)
    sums[0, 4] = sums[4, 0] = np.sum(w[there] * peak) * (a * b)
    return sums


def _lags(a: int, b: int, runs: Integer) -> Float:
    """Lags for the sums, a <= b: close where a window of a lies over a point of one of b, else sparse.

    And where the number of pairs bends, for the runs (of at least 2b samples) next to the shortest.
    """
    near = np.unique(np.round(np.linspace(-a, 3 * a, 65)))
    far = np.round(np.linspace(-3 * b, 2 * a + b, 65))
    bends = (np.arange(3)[:, np.newaxis] * a - np.arange(3) * b).ravel()
    about = (near - np.arange(3)[:, np.newaxis] * b).ravel()
    ends = np.concatenate(
        [[0, 2 * a - 2 * b], *((r - 2 * b + 1, 2 * a - r - 1) for r in runs[:_RUNS_OF_LAGS])]
    )
    lag = np.unique(np.concatenate([about, far, bends, ends]))
    return np.asarray(lag[(lag >= -3 * b) & (lag <= 2 * a + b)], dtype=np.float64)


def _trapezoids(lag: Float) -> Float:
    """Weights that make a sum over some lags one over all whole lags between, by straight lines."""
    gap = np.diff(lag)
    weights = np.zeros_like(lag)
    weights[:-1] += gap / 2
    weights[1:] += gap / 2
    weights[[0, -1]] += 0.5
    return weights


def _pairs(lag: Float, a: int, b: int, runs: Integer, often: Integer) -> Float:
    """Pairs of terms i of a and i + lag of b in the same run, ``runs`` ascending."""
    lost = np.maximum(2.0 * a, 2.0 * b + lag) + np.maximum(0.0, -lag) - 1
    # a run of r samples has r - lost of them, if that is positive: only the longer runs count
    longer = np.searchsorted(runs, lost, side="right")
    count = np.append(np.cumsum(often[::-1])[::-1], 0)
    total = np.append(np.cumsum((often * runs)[::-1])[::-1], 0)
    return np.asarray(total[longer] - lost * count[longer], dtype=np.float64)


DATASHEET: dict[Name, tuple[float, str]] = {
    "Q": (180 / np.pi * 3600, "arcsec"),
    "N": (180 / np.pi * 60, "deg/sqrt(h)"),
    "B": (180 / np.pi * 3600, "deg/h"),
    "K": (180 / np.pi * 3600 * 60, "deg/h/sqrt(h)"),
    "R": (180 / np.pi * 3600**2, "deg/h/h"),
}
"""Factor from SI, of a rate in rad/s, to the unit of a datasheet, and that unit."""


def in_datasheet_units(name: Name, value: float) -> tuple[float, str]:
    """A coefficient of a rate in rad/s, in the unit of a datasheet, and that unit."""
    factor, unit = DATASHEET[name]
    return factor * value, unit
