"""The drift of a non-contact gyro that settles after it was started.

Gubarenko & Kuzmenko, *Mechanics of Solids* (1995), (7.4): ``m(tau) = m0 e^(-k tau) + m* (1 - e^(-k tau))``,
the same after each start, tau from the first sample of each run. For a given k the model is linear in m* and
m0, with the columns ``F (1 - e^(-k tau))`` and ``F e^(-k tau)`` of cumulative least squares; k is found where
they leave the least, first on a grid and by bounded search, in a thinned record, then in the whole one by
Gauss-Newton, whose column for k also gives all parameters their share of its uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import f as f_distribution

from pipeline.models.drift_noise import BELOW, COLOURED, whitened, whiteness
from pipeline.models.drift_problem import Arc, Estimate, Problem
from pipeline.models.drift_regression import Integrals, Quadrature, weighted_integrals
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
    nominal_of,
    nominal_parameters,
    residuals,
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
_MOST_ROUNDS = 10


def transient(
    problem: Problem,
    *,
    quadrature: Quadrature = "quintic_spline",
    sigma: float | None = None,
    decay: float | None = None,
    bracket: tuple[float, float] | None = None,
    autoregression: AutoRegression | None = None,
    coloured: bool = False,
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
    coloured : bool
        Whether residuals of this fit that are not white are allowed for, where no autoregression is given.
        Slow noise passes for a transient where it is taken for white.

    Returns
    -------
    Estimate
        Method ``transient``: parameters m11 to mc2 are m*, m11_0 to mc2_0 are m0; k where it was searched.
        ``figures``: ``condition``, ``decay``, ``decay_standard_error`` (0 where it was given).
        Where a constant drift explains the record as well, that is the estimate, without m0, k and ``decay``,
        and a note says so.
    """

    def told(noise: AutoRegression | None) -> _Told:
        white = sigma if sigma is None or noise is None else sigma / noise.spread
        return _told(problem, quadrature, white, decay, bracket, noise)

    found, measured = told(autoregression), [arc.measured for arc in problem.arcs]
    loud = found.fitted.fit.residual_sigma > BELOW * (sigma or 0.0)
    if coloured and autoregression is None and loud and whiteness(found.residuals, measured) < COLOURED:
        found, _ = whitened(
            found,
            measured,
            residuals=lambda of: of.residuals,
            taken=lambda of: of.taken,
            refitted=lambda _, noise: told(noise),
            most_rounds=_MOST_ROUNDS,
        )
    return _estimate(found)


@dataclass(frozen=True, slots=True)
class _Fitted:
    """A fit with a decay, or of a constant drift; one column is of the decay where it was searched."""

    decay: float | None
    columns: Columns
    rows: tuple[ArcRows, ...]
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

    def steady(self, *, priors: bool) -> _Fitted:
        """The fit of a constant drift."""
        columns = _with(columns_of(self.problem), priors)
        return self._fit(None, columns, self.plain, [self.nominal[arc.run] for arc in self.problem.arcs])

    def decaying(self, k: float, *, priors: bool) -> _Fitted:
        """The fit of a drift with a given decay."""
        columns = _with(columns_of(self.problem, (*DRIFT, *STARTING)), priors)
        steps = [self._steps(number, k, None) for number in range(len(self.plain))]
        return self._fit(k, columns, steps, [self.nominal[arc.run] for arc in self.problem.arcs])

    def refined(self, k: float, bounds: tuple[float, float] | None) -> _Fitted:
        """The fit about parameters as they change in time; k itself by Gauss-Newton within bounds."""
        found = self.decaying(k, priors=True)
        searched = () if bounds is None else (DECAY,)
        columns = columns_of(self.problem, (*DRIFT, *STARTING, *searched))
        for _ in range(_MOST_STEPS):
            excess = found.fit.solution.estimate[6:12] - found.fit.solution.estimate[:6]
            steps = [self._steps(i, k, excess if searched else None) for i in range(len(self.plain))]
            found = self._fit(k, columns, steps, self._changing(found, k, excess))
            if bounds is None:
                break
            # the step of k, at most to half or double, within the bracket
            step, error = found.fit.solution.estimate[12], found.fit.solution.standard_errors[12]
            before, k = k, float(np.clip(k + step, *np.clip((k / 2, 2 * k), *bounds)))
            found = replace(found, decay=k)
            if abs(k - before) <= _CONVERGED * error:
                break
        return found

    def probability_of_steadiness(self, k: float) -> float:
        """Probability that white noise alone lets the transient explain as much (F test, without priors)."""
        steady, decaying = self.steady(priors=False).fit, self.decaying(k, priors=False).fit
        left = decaying.residual_sigma**2
        explained = steady.residual_sigma**2 * steady.freedom - left * decaying.freedom
        more = len(STARTING) + 1
        variance = max(left, (self.sigma or 0.0) ** 2, np.finfo(np.float64).tiny)
        return float(f_distribution.sf(explained / more / variance, more, decaying.freedom))

    def _fit(
        self, k: float | None, columns: Columns, steps: Sequence[Integrals], nominal: Sequence[Float]
    ) -> _Fitted:
        rows = tuple(
            cumulative_rows(arc, s, arc_transitions(arc, self.problem, p))
            for arc, s, p in zip(self.problem.arcs, steps, nominal, strict=True)
        )
        fit = fit_rows(self.problem, columns, rows, noise=self.noise, sigma=self.sigma)
        return _Fitted(k, columns, rows, fit)

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

    def _changing(self, found: _Fitted, k: float, excess: Float) -> list[Float]:
        """Nominal parameters at each sample of each arc, each of shape (n, 11)."""
        estimate = as_estimate("transient", found.columns, found.fit.solution, (), 0.0, {})
        changing = []
        for arc in self.problem.arcs:
            p = np.tile(nominal_of(estimate, arc.run), (len(arc.tau), 1))
            p[:, : len(DRIFT)] += np.exp(-k * arc.tau)[:, np.newaxis] * excess
            changing.append(p)
        return changing


@dataclass(frozen=True, slots=True)
class _Told:
    """What a record tells, if its noise is what it is taken for: a transient, or a constant drift."""

    record: _Record
    fitted: _Fitted
    notes: tuple[str, ...]
    figures: Mapping[str, float]

    @property
    def residuals(self) -> list[Float]:
        """Of each arc."""
        return residuals(self.record.problem, self.fitted.fit.predicted)

    @property
    def taken(self) -> tuple[Float, ...]:
        """What the fit took out of the noise, as `fit_autoregression` wants it."""
        return self.fitted.fit.spread(self.record.problem, self.fitted.columns, self.fitted.rows)


def _told(
    problem: Problem,
    quadrature: Quadrature,
    sigma: float | None,
    decay: float | None,
    bracket: tuple[float, float] | None,
    noise: AutoRegression | None,
) -> _Told:
    """Search for a transient; sigma is that of a whitened row."""
    record = _Record.of(problem, quadrature, sigma, noise)
    if decay is not None:
        return _Told(record, record.refined(decay, None), (), {"decay_standard_error": 0.0})
    thinned, bounds = _thinned(problem, bracket)
    # The autoregression is one of neighbours; what is thinned has others.
    whole = all(len(a.tau) == len(b.tau) for a, b in zip(thinned.arcs, problem.arcs, strict=True))
    k = _searched(_Record.of(thinned, quadrature, sigma, noise if whole else None), bounds)
    probability = record.probability_of_steadiness(k)
    if probability > _STEADY:
        note = (
            "no transient: a constant drift explains the record as well "
            f"(probability {probability:.2g}), and the decay is undetermined"
        )
        return _Told(record, record.steady(priors=True), (note,), {})
    found = record.refined(k, bounds)
    error = float(found.fit.solution.standard_errors[found.columns.names.index(DECAY)])
    notes = _remarks(found.decay or k, error, bounds)
    return _Told(record, found, notes, {"decay_standard_error": error})


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


def _estimate(told: _Told) -> Estimate:
    """The estimate of a transient, or of a constant drift where there is none."""
    record, found = told.record, told.fitted
    solution, figures = found.fit.solution, dict(told.figures)
    if found.decay is not None:
        figures["decay"] = found.decay
        if DECAY in found.columns.names:  # the column is that of its last step
            value = solution.estimate.copy()
            value[found.columns.names.index(DECAY)] = found.decay
            solution = replace(solution, estimate=value)
    sigma = solution.sigma * (1.0 if record.noise is None else record.noise.spread)
    return as_estimate("transient", found.columns, solution, found.fit.predicted, sigma, figures, told.notes)
