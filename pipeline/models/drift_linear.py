"""Cumulative least squares for the drift of a non-contact gyro, with outliers and coloured noise.

The linear model is integrated along the measured angles and compared with them at every sample,
``alpha_j = alpha_0 + int_0^j c + int_0^j F p``: what the Kalman filter without process noise gives, and
three to fourteen times better than the differences over segments of Gubarenko & Kuzmenko (1995), (6.3).
In turn:

1. plain sums give nominal parameters, and with them the rows of `drift_regression.transitions`;
2. samples far from the running median of their residual are marked and their angles brought back to it,
   for a wrong angle corrupts the integrals too; until the marks stay the same;
3. residuals that are not white are whitened by an autoregression, fitted in turn with the parameters
   (Cochrane & Orcutt, *J. Am. Stat. Assoc.* 44 (1949) 32-61).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.stats import theilslopes

from pipeline.models.drift_noise import BELOW, COLOURED, whitened, whiteness
from pipeline.models.drift_problem import Arc, Estimate, Mask, Parameter, Problem
from pipeline.models.drift_regression import Quadrature
from pipeline.models.drift_rows import (
    ArcRows,
    Columns,
    Fit,
    arc_integrals,
    arc_transitions,
    as_estimate,
    columns_of,
    cumulative_rows,
    fit_rows,
    nominal_parameters,
    residuals,
)
from pipeline.numerics.least_squares import triangular
from pipeline.numerics.whiteness import AutoRegression

Float = NDArray[np.float64]

_OUTLYING = 6.0
"""Robust standard deviations from the running median; of 4e5 samples of white noise none passes 5."""
_SCALE = 0.9, 1.6449
"""That part of Gaussian deviations is within so many standard deviations. From a running median those of
slow noise are mostly nothing, and their median absolute deviation says too little."""
_WINDOW = 9
"""Samples of the running median: four outliers of nine still show, and a bend of the residual stays small."""
_SMOOTH = 0.05
"""Part of the residual itself that its deviation from the running median may have, noise or none."""
_REPLACED = 0.1
"""Standard deviations by which a replaced angle may still move when the passes end."""
_MOST_PASSES = 10
_MOST_ROUNDS = 50


@dataclass(frozen=True, slots=True)
class LinearFit:
    """Cumulative least squares and what it tells the other methods.

    Attributes
    ----------
    estimate : Estimate
        Method ``cumulative``. ``sigma`` is that of an angle, coloured noise included. ``figures``:
        ``condition`` of the rows without priors, initial angles taken out; ``whiteness``;
        ``innovation_sigma`` [rad], of the white noise behind the coloured; ``order`` of the autoregression;
        ``degrees_of_freedom``; ``passes``.
    outliers : tuple of ndarray of bool, one an arc
        Measured samples that were marked.
    cleaned : Problem
        The problem with them as samples that are not measured, their angles as those around them tell.
    autoregression : AutoRegression, optional
        By which the rows were whitened; None where they are white.
    nominal : tuple of ndarray, each of shape (11,)
        Parameters of each run of which the transitions were computed.
    rows : ndarray, shape (N, k)
        All that the observations tell of the parameters, as triangles (N is some twelve an arc): of unit
        variance, initial angles projected out, without priors.
    columns : tuple of Parameter
        Of ``rows``. These are blind along u of each run's epsilon: no direction ``epsilon = B eta`` has it.
    whiteness : float
        Probability of residuals as coloured as these from white noise (Ljung & Box).
    """

    estimate: Estimate
    outliers: tuple[Mask, ...]
    cleaned: Problem
    autoregression: AutoRegression | None
    nominal: tuple[Float, ...]
    rows: Float
    columns: tuple[Parameter, ...]
    whiteness: float


def cumulative(
    problem: Problem,
    *,
    quadrature: Quadrature = "quintic_spline",
    sigma: float | None = None,
    robust: bool = True,
    coloured: bool = True,
) -> LinearFit:
    """Cumulative least squares on all arcs of all runs.

    Parameters
    ----------
    problem : Problem
    quadrature : {"trapezoid", "simpson", "cubic_spline", "quintic_spline"}
    sigma : float, optional
        Standard deviation of an angle [rad]; by default from the residuals.
    robust : bool
        Whether outliers are marked and left out.
    coloured : bool
        Whether coloured residuals are allowed for.
    """
    columns = columns_of(problem)
    marking = _marked(problem, columns, quadrature, sigma, robust)
    cleaned, rows, fit = marking.problem, marking.rows, marking.fit
    probability = whiteness(residuals(cleaned, fit.predicted), [arc.measured for arc in cleaned.arcs])
    noise = None
    if coloured and probability < COLOURED and fit.residual_sigma > BELOW * (sigma or 0.0):
        fit, noise = _whitened(cleaned, columns, rows, fit, sigma)
    return _result(columns, marking, fit, noise, probability)


@dataclass(frozen=True, slots=True)
class _Marking:
    """Where the passes over the outliers ended."""

    problem: Problem
    outliers: tuple[Mask, ...]
    nominal: tuple[Float, ...]
    rows: tuple[ArcRows, ...]
    fit: Fit
    passes: int
    settled: bool


def _marked(
    problem: Problem, columns: Columns, quadrature: Quadrature, sigma: float | None, robust: bool
) -> _Marking:
    """Steps 1 and 2 of the module's text."""
    steps = tuple(arc_integrals(arc, problem, quadrature) for arc in problem.arcs)
    nominal = nominal_parameters(problem, columns, steps)
    outliers: tuple[Mask, ...] = tuple(np.zeros(len(arc.tau), dtype=np.bool_) for arc in problem.arcs)
    now, passes = problem, 0
    while True:
        rows = tuple(
            cumulative_rows(arc, s, arc_transitions(arc, now, nominal[arc.run]))
            for arc, s in zip(now.arcs, steps, strict=True)
        )
        fit = fit_rows(now, columns, rows, noise=None, sigma=sigma)
        passes += 1
        if not robust:
            return _Marking(now, outliers, nominal, rows, fit, passes, settled=True)
        found, deviations = _outliers(problem, fit, sigma)
        cleaned = _replaced(problem, found, deviations)
        moved = max(
            float(np.abs(a.alpha - b.alpha).max()) for a, b in zip(cleaned.arcs, now.arcs, strict=True)
        )
        same = all(np.array_equal(a, b) for a, b in zip(found, outliers, strict=True))
        settled = same and moved <= _REPLACED * fit.solution.sigma
        if settled or passes == _MOST_PASSES:
            return _Marking(now, outliers, nominal, rows, fit, passes, settled)
        steps = tuple(
            s if a.alpha is b.alpha else arc_integrals(b, cleaned, quadrature)
            for s, a, b in zip(steps, now.arcs, cleaned.arcs, strict=True)
        )
        now, outliers = cleaned, found


def _outliers(problem: Problem, fit: Fit, sigma: float | None) -> tuple[tuple[Mask, ...], tuple[Float, ...]]:
    """Measured samples far from the running median of the residual, either angle, by a common scale.

    And how far each sample is.
    """
    left = residuals(problem, fit.predicted)
    deviations = tuple(np.column_stack([_deviation(channel) for channel in r.T]) for r in left)
    kept = [arc.measured for arc in problem.arcs]
    scale = max(_scale(deviations, kept), _SMOOTH * _scale(left, kept), sigma or 0.0)
    marks = (m & (np.abs(d) > _OUTLYING * scale).any(axis=1) for d, m in zip(deviations, kept, strict=True))
    return tuple(marks), deviations


def _deviation(residual: Float) -> Float:
    """From the running median; at the ends from a robust line or parabola, the nearer of them, shape (n,).

    A drift that settles bends the residual where the record begins, as no line does.
    """
    n, half = len(residual), _WINDOW // 2
    if n < _WINDOW:
        return residual - np.median(residual)
    deviation = residual - median_filter(residual, size=_WINDOW)
    x = np.arange(_WINDOW)
    for first, of_end in ((0, slice(0, half)), (n - _WINDOW, slice(_WINDOW - half, _WINDOW))):
        y = residual[first : first + _WINDOW]
        slope, level, _, _ = theilslopes(y, x)
        straight, bent = y - level - slope * x, y - _parabola(y)
        nearer = np.where(np.abs(straight) < np.abs(bent), straight, bent)
        deviation[first : first + _WINDOW][of_end] = nearer[of_end]
    return np.asarray(deviation, dtype=np.float64)


def _parabola(y: Float) -> Float:
    """Of the parabolas through three samples of y that of least median deviation (Rousseeuw), shape (n,)."""
    powers = np.vander(np.arange(len(y)), 3).astype(np.float64)
    three = np.array(list(combinations(range(len(y)), 3)))
    found = np.linalg.solve(powers[three], y[three][:, :, np.newaxis])[:, :, 0] @ powers.T
    best = int(np.argmin(np.median(np.abs(y - found), axis=1)))
    return np.asarray(found[best], dtype=np.float64)


def _scale(arcs: Sequence[Float], kept: Sequence[Mask]) -> float:
    """Standard deviation by a quantile of the absolute values, whatever the outliers beyond it."""
    part, deviations = _SCALE
    together = np.concatenate([a[m] for a, m in zip(arcs, kept, strict=True)])
    return float(np.quantile(np.abs(together), part)) / deviations


def _replaced(problem: Problem, outliers: Sequence[Mask], deviations: Sequence[Float]) -> Problem:
    """The problem as it was given, its outliers brought back to the samples around them.

    Not to the model: where it does not hold they would stand out anew, and spoil the integrals.
    """

    def clean(arc: Arc, marked: Mask, deviation: Float) -> Arc:
        if not marked.any():
            return arc
        alpha = arc.alpha - np.where(marked[:, np.newaxis], deviation, 0.0)
        return replace(arc, alpha=alpha, measured=arc.measured & ~marked)

    arcs = zip(problem.arcs, outliers, deviations, strict=True)
    return replace(problem, arcs=tuple(clean(*arc) for arc in arcs))


def _whitened(
    problem: Problem, columns: Columns, rows: Sequence[ArcRows], fit: Fit, sigma: float | None
) -> tuple[Fit, AutoRegression | None]:
    """Step 3 of the module's text: the parameters and the autoregression in turn until it settles."""

    def refitted(_: Fit, noise: AutoRegression) -> Fit:
        of_white = None if sigma is None else sigma / noise.spread
        return fit_rows(problem, columns, rows, noise=noise, sigma=of_white)

    return whitened(
        fit,
        [arc.measured for arc in problem.arcs],
        residuals=lambda of: residuals(problem, of.predicted),
        taken=lambda of: of.spread(problem, columns, rows),
        refitted=refitted,
        most_rounds=_MOST_ROUNDS,
    )


def _result(
    columns: Columns, marking: _Marking, fit: Fit, noise: AutoRegression | None, probability: float
) -> LinearFit:
    innovation = fit.solution.sigma
    spread = 1.0 if noise is None else noise.spread
    figures = {
        "whiteness": probability,
        "innovation_sigma": innovation,
        "order": 0.0 if noise is None else float(noise.order),
        "degrees_of_freedom": float(fit.freedom),
        "passes": float(marking.passes),
    }
    notes = []
    if not marking.settled:
        notes.append(f"the outliers were still changing after {marking.passes} passes")
    estimate = as_estimate(
        "cumulative", columns, fit.solution, fit.predicted, innovation * spread, figures, notes
    )
    rows = triangular(fit.rows) @ columns.expansion.T / max(innovation, np.finfo(np.float64).tiny)
    return LinearFit(
        estimate,
        marking.outliers,
        marking.problem,
        noise,
        marking.nominal,
        rows,
        columns.parameters,
        probability,
    )
