"""Regression over segments for the drift of a non-contact gyro, with the covariance that it has in truth.

Gubarenko & Kuzmenko, *Mechanics of Solids* (1995), (6.3) to (6.5): over each segment ``A_q p = b_q`` with
``A_q = int F``, ``b_q = Delta alpha - int c``, by ordinary least squares. Neighbouring segments share the
angle at their border, and the model is evaluated at measured angles: of the angles' noise v the rows have ::

    e = D v,    e_q = v_end - v_start - sum over the segment of w_i J_i v_i,    J = d(c + F p)/d alpha,

w the weights of the trapezoid rule. Of ``A = U S V^T`` ordinary least squares knows ``U^T b`` alone, whose
noise has the covariance ``sigma^2 U^T D D^T U``: by it these few rows are weighted against the priors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.models.drift_problem import Arc, Estimate, Mask, Problem
from pipeline.models.drift_regression import Integrals, Quadrature, jacobian
from pipeline.models.drift_rows import (
    NOMINAL_SIGMA,
    Columns,
    arc_integrals,
    arc_transitions,
    as_estimate,
    columns_of,
    cumulative_rows,
    nominal_of,
    placed,
)
from pipeline.numerics.least_squares import Solution, solve
from pipeline.numerics.whiteness import AutoRegression

Float = NDArray[np.float64]

_UNKNOWN = 1.0
"""Standard deviation of an angle [rad] that no residual tells: the rows weigh nothing beside a prior."""


def segments(
    problem: Problem,
    *,
    length: int,
    quadrature: Quadrature = "quintic_spline",
    sigma: float | None = None,
    autoregression: AutoRegression | None = None,
) -> Estimate:
    """Least squares on the differences over segments of all arcs of all runs.

    Parameters
    ----------
    problem : Problem
        A segment begins and ends with a measured sample; one that does not is left out, and so is what is
        shorter than a segment at the end of an arc.
    length : int
        Steps a segment.
    quadrature : {"trapezoid", "simpson", "cubic_spline", "quintic_spline"}
    sigma : float, optional
        Standard deviation of an angle [rad], coloured noise included; by default from the residuals.
    autoregression : AutoRegression, optional
        Of the noise of the angles; by default it is white. The estimate is the same, its covariance is not.

    Returns
    -------
    Estimate
        Method ``segments``. ``figures``: ``condition`` of the rows without priors; ``segments``, how many.
        Where there is no segment at all the estimate is the priors', and a note says so.
    """
    columns = columns_of(problem)
    steps = [arc_integrals(arc, problem, quadrature) for arc in problem.arcs]
    rows = [_rows(arc, s, columns, length) for arc, s in zip(problem.arcs, steps, strict=True)]
    A, b = np.concatenate([A for A, _ in rows]), np.concatenate([b for _, b in rows])
    nominal = _nominal(A, b, columns, len(problem.bases))
    noises = [_Noise.of(arc, problem, nominal[arc.run], length, autoregression) for arc in problem.arcs]
    plain = solve(A, b, columns.names, sigma=1.0)
    U = A @ plain.factor
    if sigma is None:
        sigma = _residual_sigma(plain, U, noises)
    solution = _weighted(A, b, U, columns, noises, sigma)
    predicted = []
    for arc, s in zip(problem.arcs, steps, strict=True):
        phi = arc_transitions(arc, problem, nominal[arc.run])
        fitted = cumulative_rows(arc, s, phi).fitted(arc, solution.estimate[columns.of_run(arc.run)])
        predicted.append(fitted)
    notes = [] if len(b) else [f"no segment of {length} steps begins and ends with a measured sample"]
    figures = {"condition": plain.condition, "segments": len(b) / 2}
    return as_estimate("segments", columns, solution, tuple(predicted), sigma, figures, notes)


def _used(arc: Arc, length: int) -> Mask:
    """Which whole segments of an arc begin and end with a measured sample."""
    ends = arc.measured[::length]
    return np.asarray(ends[:-1] & ends[1:])


def _rows(arc: Arc, steps: Integrals, columns: Columns, length: int) -> tuple[Float, Float]:
    """Rows of the segments of an arc, among the columns of all runs."""
    used = np.repeat(_used(arc, length), 2)
    k = len(columns.names)
    if not used.any():
        return np.empty((0, k)), np.empty(0)
    A, b = steps.segments(arc.alpha, length)
    wide = placed(np.column_stack([A[used], b[used]]), columns.of_run(arc.run), k)
    return wide[:, :k], wide[:, k]


def _nominal(A: Float, b: Float, columns: Columns, runs: int) -> tuple[Float, ...]:
    """Parameters of each run to evaluate J with, shape (11,) each."""
    bounded = np.minimum(columns.prior, NOMINAL_SIGMA)
    plain = solve(A, b, columns.names, prior=bounded, prior_mean=columns.prior_mean)
    estimate = as_estimate("segments", columns, plain, (), plain.sigma, {})
    return tuple(nominal_of(estimate, run) for run in range(runs))


@dataclass(frozen=True, slots=True)
class _Noise:
    """What the noise of an arc's angles does to the rows of its segments: D; ``growth`` is h J."""

    measured: Mask
    used: Mask
    length: int
    growth: Float
    colour: AutoRegression | None

    @classmethod
    def of(
        cls, arc: Arc, problem: Problem, nominal: Float, length: int, colour: AutoRegression | None
    ) -> _Noise:
        growth = arc.step * jacobian(arc.alpha, problem.bases[arc.run], nominal)
        return cls(arc.measured, _used(arc, length), length, growth, colour)

    def transposed(self, y: Float) -> Float:
        """``L^T D^T y`` for y of shape (2 m, r), a row an angle of a used segment; v = L w with white w.

        Shape (2 n, r) where the noise is white; coloured it has begun before the arc.
        """
        n = len(self.measured)
        of_segment = np.zeros((len(self.used), 2, y.shape[1]))
        of_segment[self.used] = y.reshape(int(self.used.sum()), 2, y.shape[1])
        over = np.zeros((n + 1, 2, y.shape[1]))  # over each step, with one before and one after the arc
        over[1 : 1 + len(self.used) * self.length] = np.repeat(of_segment, self.length, axis=0)
        z = -np.einsum("iba,ibr->iar", self.growth, (over[1:] + over[:-1]) / 2)
        z[: len(self.used) * self.length : self.length] -= of_segment
        z[self.length : len(self.used) * self.length + 1 : self.length] += of_segment
        z[~self.measured] = 0.0
        if self.colour is not None:
            # L is the recursion forward in time, L^T runs backward.
            z = np.concatenate([np.zeros((self.colour.memory, *z.shape[1:])), z])
            z = lfilter([1.0], [1.0, *-self.colour.coefficients], z[::-1], axis=0) / self.colour.spread
        return np.asarray(z.reshape(2 * len(z), -1), dtype=np.float64)

    @property
    def power(self) -> float:
        """Sum of the squares of D's elements."""
        m, s = len(self.used), self.length
        inside = np.sum(self.growth**2, axis=(1, 2)) * self.measured
        inside[::s] = 0.0
        total = np.sum(inside[: m * s].reshape(m, s).sum(axis=1)[self.used])
        starts, ends = self.growth[: m * s : s][self.used], self.growth[s : m * s + 1 : s][self.used]
        return float(total + np.sum((np.eye(2) + starts / 2) ** 2) + np.sum((np.eye(2) - ends / 2) ** 2))


def _through(y: Float, noises: list[_Noise]) -> Float:
    """``L^T D^T y`` of all arcs, rows of y in their order."""
    edges = np.cumsum([0, *(2 * int(noise.used.sum()) for noise in noises)])
    parts = [noise.transposed(y[a:b]) for noise, a, b in zip(noises, edges[:-1], edges[1:], strict=True)]
    return np.concatenate(parts)


def _residual_sigma(plain: Solution, U: Float, noises: list[_Noise]) -> float:
    """Standard deviation of an angle by the residuals r: ``E r^T r = sigma^2 (|D|^2 - |D^T U|^2)``.

    The colour of the noise is left aside in it.
    """
    white = [replace(noise, colour=None) for noise in noises]
    left = sum(noise.power for noise in white) - float(np.sum(_through(U, white) ** 2))
    return float(np.sqrt(plain.residual @ plain.residual / left)) if left > 0 else _UNKNOWN


def _weighted(A: Float, b: Float, U: Float, columns: Columns, noises: list[_Noise], sigma: float) -> Solution:
    """Ordinary least squares with the priors: the rows ``U^T A p = U^T b``, made white."""
    X = _through(U, noises)
    L = np.linalg.cholesky(X.T @ X)
    rows = np.linalg.solve(L, U.T @ np.column_stack([A, b]))
    return solve(
        rows[:, :-1],
        rows[:, -1],
        columns.names,
        prior=columns.prior,
        prior_mean=columns.prior_mean,
        sigma=sigma,
        observations=len(b),
    )
