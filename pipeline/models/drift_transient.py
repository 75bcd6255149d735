"""The drift of a non-contact gyro that settles after it was started.

Gubarenko & Kuzmenko, *Mechanics of Solids* (1995), (7.4): ``m(tau) = m0 e^(-k tau) + m* (1 - e^(-k tau))``,
the same after each start, tau from the first sample of each run. For a given k the model is linear in m* and
m0, with the columns ``F (1 - e^(-k tau))`` and ``F e^(-k tau)`` of cumulative least squares; k is found where
they leave the least, first on a grid and by bounded search, in a thinned record, then in the whole one by
Gauss-Newton, whose column for k also gives all parameters their share of its uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import f as f_distribution

from pipeline.models.drift_problem import Arc, Estimate, Problem
from pipeline.models.drift_regression import Integrals, Quadrature, weighted_integrals
from pipeline.models.drift_rows import (
    Columns,
    Fit,
    arc_integrals,
    arc_transitions,
    as_estimate,
    columns_of,
    cumulative_rows,
    fit_rows,
    nominal_of,
    nominal_parameters,
)
from pipeline.models.gyro_drift import DRIFT
from pipeline.numerics.whiteness import AutoRegression

Float = NDArray[np.float64]

STARTING = tuple(f"{name}_0" for name in DRIFT)
"""The drift at first, m0."""
DECAY = "k"

_SCANNED = 800
"""Samples of an arc in which k is searched: enough for the functions, if not for their last digits."""
_RATIOS = 1.5, 1.06
"""Of neighbours on the first grid and on the second: where the noise is little the least sum of squares is a
notch, a tenth of k wide, in a flat valley of a factor 5."""
_VALLEY = 3.0
"""Factor about the best of the first grid that the second covers."""
_SLOWEST = 0.2
"""Over the record's length, the slowest decay of the default bracket: then it is hardly more than a line."""
_FASTEST = 0.5
"""Over the thinned step, the fastest: then an e-fold has two steps."""
_STEADY = 0.01
"""Probability above which what the transient explains may be noise."""
_CONVERGED = 1e-3
"""Last step of k over its standard error."""
_MOST_STEPS = 20


def transient(
    problem: Problem,
    *,
    quadrature: Quadrature = "quintic_spline",
    sigma: float | None = None,
    decay: float | None = None,
    bracket: tuple[float, float] | None = None,
    autoregression: AutoRegression | None = None,
) -> Estimate:
    """Cumulative least squares for a drift that decays from m0 to m*.

    Parameters
    ----------
    problem : Problem
        Its priors of m hold for m* and for m0.
    quadrature : {"trapezoid", "simpson", "cubic_spline", "quintic_spline"}
    sigma : float, optional
        Standard deviation of an angle [rad], coloured noise included; by default from the residuals.
    decay : float, optional
        k, over a unit of Earth-rate time (1/U, 3.82 h); by default it is searched.
    bracket : (float, float), optional
        Where; by default from a fifth of the inverse of the longest run to what the samples resolve.
    autoregression : AutoRegression, optional
        Of the noise of the angles; by default it is white.

    Returns
    -------
    Estimate
        Method ``transient``: parameters m11 to mc2 are m*, m11_0 to mc2_0 are m0; k where it was searched.
        ``figures``: ``condition``, ``decay``, ``decay_standard_error`` (0 where it was given).
        Where a constant drift explains the record as well, that is the estimate, without m0, k and ``decay``,
        and a note says so.
    """
    white = sigma if sigma is None or autoregression is None else sigma / autoregression.spread
    record = _Record.of(problem, quadrature, white, autoregression)
    if decay is not None:
        found = record.refined(decay, None)
        return _estimate(record, found, (), {"decay_standard_error": 0.0})
    thinned, bounds = _thinned(problem, bracket)
    scanned = _Record.of(thinned, quadrature, white, autoregression)
    k = _searched(scanned, bounds)
    probability = record.probability_of_steadiness(k)
    if probability > _STEADY:
        note = (
            "no transient: a constant drift explains the record as well "
            f"(probability {probability:.2g}), and the decay is undetermined"
        )
        return _estimate(record, None, (note,), {})
    found = record.refined(k, bounds)
    error = float(found.fit.solution.standard_errors[found.columns.names.index(DECAY)])
    return _estimate(record, found, _remarks(found.decay, error, bounds), {"decay_standard_error": error})


@dataclass(frozen=True, slots=True)
class _Transient:
    """A fit with a decay, and its columns: with one of the decay itself where it was searched."""

    decay: float
    columns: Columns
    fit: Fit


@dataclass(frozen=True, slots=True)
class _Record:
    """A problem with what no decay changes: integrals of its arcs, nominal parameters of its runs."""

    problem: Problem
    quadrature: Quadrature
    sigma: float | None
    noise: AutoRegression | None
    plain: tuple[Integrals, ...]
    nominal: tuple[Float, ...]

    @classmethod
    def of(
        cls, problem: Problem, quadrature: Quadrature, sigma: float | None, noise: AutoRegression | None
    ) -> _Record:
        plain = tuple(arc_integrals(arc, problem, quadrature) for arc in problem.arcs)
        nominal = nominal_parameters(problem, columns_of(problem), plain)
        return cls(problem, quadrature, sigma, noise, plain, nominal)

    def steady(self, *, priors: bool) -> Fit:
        """The fit of a constant drift."""
        columns = _with(columns_of(self.problem), priors)
        return self._fit(columns, self.plain, [self.nominal[arc.run] for arc in self.problem.arcs])

    def decaying(self, k: float, *, priors: bool) -> _Transient:
        """The fit of a drift with a given decay."""
        columns = _with(columns_of(self.problem, (*DRIFT, *STARTING)), priors)
        steps = [self._steps(number, k, None) for number in range(len(self.plain))]
        fit = self._fit(columns, steps, [self.nominal[arc.run] for arc in self.problem.arcs])
        return _Transient(k, columns, fit)

    def refined(self, k: float, bounds: tuple[float, float] | None) -> _Transient:
        """The fit about parameters as they change in time; k itself by Gauss-Newton within bounds."""
        found = self.decaying(k, priors=True)
        searched = () if bounds is None else (DECAY,)
        columns = columns_of(self.problem, (*DRIFT, *STARTING, *searched))
        for _ in range(_MOST_STEPS):
            excess = found.fit.solution.estimate[6:12] - found.fit.solution.estimate[:6]
            steps = [
                self._steps(i, found.decay, excess if searched else None) for i in range(len(self.plain))
            ]
            fit = self._fit(columns, steps, self._changing(found, excess))
            k = found.decay
            if bounds is not None:
                # the step of k, at most to half or double, within the bracket
                step, error = fit.solution.estimate[12], fit.solution.standard_errors[12]
                k = float(np.clip(found.decay + step, *np.clip((k / 2, 2 * k), *bounds)))
            small = bounds is None or abs(k - found.decay) <= _CONVERGED * error
            found = _Transient(k, columns, fit)
            if small:
                break
        return found

    def probability_of_steadiness(self, k: float) -> float:
        """Probability that white noise alone lets the transient explain as much (F test, without priors)."""
        steady, decaying = self.steady(priors=False), self.decaying(k, priors=False).fit
        left = decaying.residual_sigma**2
        explained = steady.residual_sigma**2 * steady.freedom - left * decaying.freedom
        more = len(STARTING) + 1
        variance = max(left, (self.sigma or 0.0) ** 2, np.finfo(np.float64).tiny)
        return float(f_distribution.sf(explained / more / variance, more, decaying.freedom))

    def _fit(self, columns: Columns, steps: Sequence[Integrals], nominal: Sequence[Float]) -> Fit:
        rows = [
            cumulative_rows(arc, s, arc_transitions(arc, self.problem, p))
            for arc, s, p in zip(self.problem.arcs, steps, nominal, strict=True)
        ]
        return fit_rows(self.problem, columns, rows, noise=self.noise, sigma=self.sigma)

    def _steps(self, number: int, k: float, excess: Float | None) -> Integrals:
        """Integrals of ``F (1 - e), F e`` with e = e^(-k tau), and of ``d/dk = -tau F e (m0 - m*)``."""
        arc, plain = self.problem.arcs[number], self.plain[number]
        base, e = self.problem.bases[arc.run], np.exp(-k * arc.tau)
        weights = e[:, np.newaxis] if excess is None else np.stack([e, -arc.tau * e], axis=1)
        W = weighted_integrals(arc.tau, arc.alpha, base, self.quadrature, weights)
        settled, rest = plain.F[:, :, : len(DRIFT)], plain.F[:, :, len(DRIFT) :]
        of_k = [] if excess is None else [(W[..., 1] @ excess)[:, :, np.newaxis]]
        F = np.concatenate([settled - W[..., 0], W[..., 0], *of_k, rest], axis=2)
        return Integrals((), plain.c, F)

    def _changing(self, found: _Transient, excess: Float) -> list[Float]:
        """Nominal parameters at each sample of each arc, each of shape (n, 11)."""
        estimate = as_estimate("transient", found.columns, found.fit.solution, (), 0.0, {})
        changing = []
        for arc in self.problem.arcs:
            p = np.tile(nominal_of(estimate, arc.run), (len(arc.tau), 1))
            p[:, : len(DRIFT)] += np.exp(-found.decay * arc.tau)[:, np.newaxis] * excess
            changing.append(p)
        return changing


def _with(columns: Columns, priors: bool) -> Columns:
    return columns if priors else replace(columns, prior=np.full(len(columns.names), np.inf))


def _thinned(problem: Problem, bracket: tuple[float, float] | None) -> tuple[Problem, tuple[float, float]]:
    """The problem with fewer samples, and where k is searched."""
    step = max(arc.step for arc in problem.arcs)
    every = max(max(len(arc.tau) for arc in problem.arcs) // _SCANNED, 1)
    if bracket is None:
        longest = max(float(arc.tau[-1]) for arc in problem.arcs)
        bracket = _SLOWEST / longest, _FASTEST / (step * every)
    else:
        every = max(min(every, int(_FASTEST / (step * bracket[1]))), 1)

    def thin(arc: Arc) -> Arc:
        lacking = None if arc.neglected is None else arc.neglected[::every]
        return Arc(arc.run, arc.tau[::every], arc.alpha[::every], arc.measured[::every], lacking)

    return replace(problem, arcs=tuple(thin(arc) for arc in problem.arcs)), bracket


def _searched(record: _Record, bounds: tuple[float, float]) -> float:
    """K of the least sum of squares: the best of a grid, of a finer one about it, then between neighbours."""

    def left(log_k: float) -> float:
        fit = record.decaying(float(np.exp(log_k)), priors=False).fit
        return fit.residual_sigma**2 * fit.freedom

    low, high = np.log(bounds)
    for ratio in _RATIOS:
        grid = np.linspace(low, high, int(np.ceil((high - low) / np.log(ratio))) + 1)
        k = int(np.argmin([left(log_k) for log_k in grid]))
        around = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]
        low, high = np.clip(grid[k] + np.log([1 / _VALLEY, _VALLEY]), low, high)
    return float(np.exp(minimize_scalar(left, bounds=around, method="bounded", options={"xatol": 1e-3}).x))


def _remarks(k: float, error: float, bounds: tuple[float, float]) -> tuple[str, ...]:
    notes = []
    if not bounds[0] * 1.01 < k < bounds[1] / 1.01:
        notes.append("the decay is at an end of its bracket")
    if error > k / 2:
        notes.append(f"the drift changes, but its decay is hardly determined: {k:.3g} +- {error:.2g}")
    return tuple(notes)


def _estimate(
    record: _Record, found: _Transient | None, notes: Sequence[str], figures: dict[str, float]
) -> Estimate:
    """The estimate of a transient, or of a constant drift where there is none."""
    fit = record.steady(priors=True) if found is None else found.fit
    columns = columns_of(record.problem) if found is None else found.columns
    solution = fit.solution
    if found is not None:
        figures = {"decay": found.decay, **figures}
        if DECAY in columns.names:  # the column is that of its last step
            value = solution.estimate.copy()
            value[columns.names.index(DECAY)] = found.decay
            solution = replace(solution, estimate=value)
    spread = 1.0 if record.noise is None else record.noise.spread
    sigma = solution.sigma * spread
    return as_estimate("transient", columns, solution, fit.predicted, sigma, figures, notes)
