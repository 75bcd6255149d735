"""Rows of a regression for all runs of one gyro: which columns are common, which are a run's own.

Inside, the misalignment of a run is two columns eta, ``epsilon = B eta``, so that ``u.epsilon = 0`` holds;
outside it is epsilon1 to epsilon3 with the covariance ``B C B^T``. The initial angles of an arc are free and
no parameters: the triangle of an arc's rows has them in its first two columns, and what is below tells all of
the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.models import _kernels_drift_regression as _kernels
from pipeline.models.drift_problem import Arc, Estimate, Parameter, Problem
from pipeline.models.drift_regression import ETA, Integrals, Quadrature, integrals, transitions
from pipeline.models.gyro_drift import DRIFT, MISALIGNMENT, PARAMETERS, TILT, misalignment_basis
from pipeline.numerics.least_squares import Solution, solve, triangular
from pipeline.numerics.whiteness import AutoRegression

Float = NDArray[np.float64]

NOMINAL_SIGMA = 1.0
"""Earth rates, or radians: bounds what the rows do not determine; no gyro on a stand comes near it."""

_INVOLVED = 1e-6
"""Component of a direction from which a parameter has part in it, rounding aside."""


@dataclass(frozen=True, slots=True)
class Columns:
    """The columns of all runs together.

    Attributes
    ----------
    names : tuple of str
        Of the k columns: m.., theta.., then eta1, eta2 of each run.
    parameters : tuple of Parameter
        What they stand for outside, K of them: m.., theta.., then epsilon1 to epsilon3 of each run.
    expansion : ndarray, shape (K, k)
        Takes columns to parameters; its own are orthonormal.
    prior, prior_mean : ndarray, shape (k,)
        Standard deviation, infinite for none, and mean.
    common : int
        How many of the columns are common to all runs.
    """

    names: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    expansion: Float
    prior: Float
    prior_mean: Float
    common: int

    def of_run(self, run: int) -> NDArray[np.intp]:
        """Which columns the rows of a run have, in the order of `Integrals`."""
        own = (len(self.names) - self.common) and len(ETA)
        first = self.common + run * own
        return np.concatenate([np.arange(self.common), np.arange(first, first + own)])


def columns_of(problem: Problem, drift: tuple[str, ...] = DRIFT) -> Columns:
    """The columns of a problem, with the priors that it has for them.

    Parameters
    ----------
    problem : Problem
    drift : tuple of str
        Names of the columns of the drift; ``m11_0``, the drift at first, has the prior of ``m11``.
    """
    names: list[str] = list(drift)
    parameters = [Parameter(name) for name in drift]
    blocks = [np.eye(len(drift))]
    common = len(drift)
    if problem.installation:
        common += len(TILT)
        names += TILT
        parameters += [Parameter(name) for name in TILT]
        blocks.append(np.eye(len(TILT)))
        for run, base in enumerate(problem.bases):
            names += [f"{eta} of run {run}" for eta in ETA]
            parameters += [Parameter(name, run) for name in MISALIGNMENT]
            blocks.append(misalignment_basis(base))
    expansion = np.zeros((len(parameters), len(names)))
    row = column = 0
    for block in blocks:
        expansion[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    prior, mean = np.full(len(names), np.inf), np.zeros(len(names))
    for k, name in enumerate(names):
        known = problem.priors.get(name.removesuffix("_0") if k < common else "epsilon")
        if known is not None:
            prior[k], mean[k] = known.sigma, known.mean
    return Columns(tuple(names), tuple(parameters), expansion, prior, mean, common)


@dataclass(frozen=True, slots=True)
class ArcRows:
    """Cumulative rows of an arc: ``alpha_j = S_j alpha_0 + A_j p + d_j`` at each of its samples.

    Attributes
    ----------
    A : ndarray, shape (n, 2, 2 + k)
        S, then the columns of `Integrals`.
    offset : ndarray, shape (n, 2)
        d, what the angles would be without drift.
    """

    A: Float
    offset: Float

    def predicted(self, start: Float, p: Float) -> Float:
        """Angles by the model, shape (n, 2) [rad]."""
        return np.asarray(self.A @ np.concatenate([start, p]) + self.offset, dtype=np.float64)

    def fitted(self, arc: Arc, p: Float) -> Float:
        """Angles by the model, shape (n, 2) [rad], from the initial ones that fit best to the measured."""
        S = self.A[arc.measured][:, :, :2].reshape(-1, 2)
        left = (arc.alpha - self.predicted(np.zeros(2), p))[arc.measured].ravel()
        start = np.asarray(np.linalg.lstsq(S, left, rcond=None)[0], dtype=np.float64)
        return self.predicted(start, p)

    def triangle(self, arc: Arc, noise: AutoRegression | None) -> tuple[Float, int]:
        """Triangle of the whitened rows ``[S, A, alpha - d]`` of the measured samples, and how many rows."""
        rows = np.concatenate([self.A, (arc.alpha - self.offset)[:, :, np.newaxis]], axis=2)
        kept = rows[arc.measured] if noise is None else noise.whiten(rows, arc.measured)
        flat = kept.reshape(-1, rows.shape[2])
        return triangular(flat), len(flat)


def arc_integrals(arc: Arc, problem: Problem, quadrature: Quadrature) -> Integrals:
    """Integrals over the steps of an arc."""
    return integrals(
        arc.tau,
        arc.alpha,
        problem.bases[arc.run],
        quadrature,
        errors=problem.installation,
        neglected=arc.neglected,
    )


def arc_transitions(arc: Arc, problem: Problem, nominal: Float | None) -> Float:
    """`transitions` with the nominal parameters, shape (11,) or (n, 11); the identity without any."""
    if nominal is None:
        return np.broadcast_to(np.eye(2), (len(arc.tau) - 1, 2, 2)).copy()
    return transitions(arc.tau, arc.alpha, problem.bases[arc.run], nominal)


def cumulative_rows(arc: Arc, steps: Integrals, phi: Float) -> ArcRows:
    """Cumulative rows by the recursion of `transitions`.

    ``A_(j+1) = Phi_j A_j + int_j F``,  ``d_(j+1) = Phi_j (d_j - alpha_mj) + alpha_mj + int_j c``.
    """
    n, k = len(arc.tau), steps.F.shape[2]
    # The offset is carried as its difference from the measured angles, which keeps its digits.
    rows = np.zeros((n, 2, 2 + k + 1))
    rows[0, :, :2] = np.eye(2)
    rows[0, :, -1] = -arc.alpha[0]
    added = np.zeros((n - 1, 2, 2 + k + 1))
    added[:, :, 2:-1] = steps.F
    added[:, :, -1] = steps.c - np.diff(arc.alpha, axis=0)
    _kernels.recur(phi, added, rows)
    return ArcRows(rows[:, :, :-1], rows[:, :, -1] + arc.alpha)


@dataclass(frozen=True, slots=True)
class Fit:
    """Least squares on the rows of all arcs.

    Attributes
    ----------
    solution : Solution
        Of the columns; its sigma is that of a whitened row.
    rows : ndarray, shape (m, k)
        Triangles of the arcs without the initial angles: all that the observations tell of the columns.
    triangles : tuple of ndarray, each of shape (k + 3, k + 3)
        Of each arc, with its own columns: initial angles, parameters, right-hand side.
    predicted : tuple of ndarray, each of shape (n, 2)
        Angles of each arc [rad].
    freedom : int
        Whitened rows less what was fitted to them.
    residual_sigma : float
        Standard deviation of the whitened residuals, ``freedom`` their count [rad].
    """

    solution: Solution
    rows: Float
    triangles: tuple[Float, ...]
    predicted: tuple[Float, ...]
    freedom: int
    residual_sigma: float

    def spread(self, problem: Problem, columns: Columns, rows: Sequence[ArcRows]) -> tuple[Float, ...]:
        """Factor U of the covariance ``U U^T`` of each arc's predicted angles, each of shape (n, 2, q)."""
        parts = []
        for arc, arc_rows, R in zip(problem.arcs, rows, self.triangles, strict=True):
            # alpha_0 = R11^-1 (z - R12 p): its own uncertainty, and that of p.
            p = self.solution.factor[columns.of_run(arc.run)]
            inverse = np.linalg.pinv(R[:2, :2])
            of_start = np.vstack([self.solution.sigma * inverse, np.zeros((len(p), 2))])
            of_p = np.vstack([-inverse @ R[:2, 2:-1] @ p, p])
            joint = np.hstack([of_start, of_p])
            parts.append(np.asarray(arc_rows.A @ joint, dtype=np.float64))
        return tuple(parts)


def fit_rows(
    problem: Problem,
    columns: Columns,
    rows: Sequence[ArcRows],
    *,
    noise: AutoRegression | None,
    sigma: float | None,
) -> Fit:
    """Weighted least squares with the priors, the initial angle of each arc free.

    Parameters
    ----------
    problem : Problem
    columns : Columns
    rows : sequence of ArcRows
        One an arc.
    noise : AutoRegression, optional
        By which the rows are whitened.
    sigma : float, optional
        Standard deviation of a whitened row [rad]; by default that of the residual.
    """
    k = len(columns.names)
    triangles, count = [], 0
    for arc, arc_rows in zip(problem.arcs, rows, strict=True):
        triangle, n = arc_rows.triangle(arc, noise)
        triangles.append(triangle)
        count += max(n - 2, 0)
    places = [columns.of_run(arc.run) for arc in problem.arcs]
    together = [placed(R[2:, 2:], place, k) for R, place in zip(triangles, places, strict=True)]
    stacked = np.concatenate(together)
    A, b = stacked[:, :k], stacked[:, k]
    solution = solve(
        A,
        b,
        columns.names,
        prior=columns.prior,
        prior_mean=columns.prior_mean,
        sigma=sigma,
        observations=count,
    )
    predicted = []
    for arc_rows, R, place in zip(rows, triangles, places, strict=True):
        p = solution.estimate[place]
        found = np.linalg.lstsq(R[:2, :2], R[:2, -1] - R[:2, 2:-1] @ p, rcond=None)[0]
        start = np.asarray(found, dtype=np.float64)
        predicted.append(arc_rows.predicted(start, p))
    freedom = max(count - solution.rank, 1)
    residual_sigma = float(np.linalg.norm(solution.residual)) / freedom**0.5
    return Fit(solution, A, tuple(triangles), tuple(predicted), freedom, residual_sigma)


def residuals(problem: Problem, predicted: Sequence[Float]) -> list[Float]:
    """Measured less predicted angles of each arc, each of shape (n, 2) [rad]."""
    return [arc.alpha - angles for arc, angles in zip(problem.arcs, predicted, strict=True)]


def placed(rows: Float, place: NDArray[np.intp], k: int) -> Float:
    """Rows of a run among the columns of all runs; the right-hand side stays last."""
    wide = np.zeros((len(rows), k + 1))
    wide[:, place] = rows[:, :-1]
    wide[:, k] = rows[:, -1]
    return wide


def as_estimate(
    method: str,
    columns: Columns,
    solution: Solution,
    predicted: tuple[Float, ...],
    sigma: float,
    figures: Mapping[str, float],
    notes: Sequence[str] = (),
) -> Estimate:
    """The estimate of a solution in the parameters of outside.

    A parameter that neither the record nor a prior determines has an infinite standard error, and a note.
    """
    T = columns.expansion
    covariance = T @ solution.covariance @ T.T
    unknown = np.abs(T @ solution.unknown.T).max(axis=1, initial=0.0) > _INVOLVED
    covariance[unknown, unknown] = np.inf
    named = [_title(p, columns) for p, lost in zip(columns.parameters, unknown, strict=True) if lost]
    said = [f"neither the record nor a prior determines {', '.join(named)}"] if named else []
    return Estimate(
        method,
        columns.parameters,
        T @ solution.estimate,
        covariance,
        sigma,
        predicted,
        {"condition": solution.condition, **figures},
        (*notes, *said),
    )


def _title(parameter: Parameter, columns: Columns) -> str:
    """A parameter in a note, with its run where there are several."""
    several = any(p.run not in (None, 0) for p in columns.parameters)
    return (
        f"{parameter.name} of run {parameter.run}"
        if several and parameter.run is not None
        else parameter.name
    )


def nominal_of(estimate: Estimate, run: int) -> Float:
    """Parameters of a run in the order of `PARAMETERS`, shape (11,); what was not estimated is 0."""
    value = dict(zip(estimate.parameters, estimate.value, strict=True))
    return np.array(
        [value.get(Parameter(n, run if n in MISALIGNMENT else None), 0.0) for n in PARAMETERS],
        dtype=np.float64,
    )


def nominal_parameters(problem: Problem, columns: Columns, steps: Sequence[Integrals]) -> tuple[Float, ...]:
    """Parameters of each run by plain sums, to evaluate `transitions` with, each of shape (11,)."""
    rows = [
        cumulative_rows(arc, s, arc_transitions(arc, problem, None))
        for arc, s in zip(problem.arcs, steps, strict=True)
    ]
    bounded = replace(columns, prior=np.minimum(columns.prior, NOMINAL_SIGMA))
    fit = fit_rows(problem, bounded, rows, noise=None, sigma=None)
    estimate = as_estimate("cumulative", columns, fit.solution, (), fit.solution.sigma, {})
    return tuple(nominal_of(estimate, run) for run in range(len(problem.bases)))
