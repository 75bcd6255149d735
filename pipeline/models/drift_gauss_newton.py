"""Gauss-Newton on the exact model: the last step of the identification of a non-contact gyro.

The linear model neglects products of the drift and the installation errors: 3e-3 to 1.3e-2 degrees an hour
for a tilt of 10' and m = 0.01. Here the computed trajectory itself is fitted to the measured angles. With the
unknowns x (each arc's alpha(0), m, theta, each run's Delta chi) the estimate minimises::

    cost(x) = sum |W (alpha_measured - alpha(x))|^2 / sigma^2 + sum ((x_i - mean_i) / s_i)^2

over the measured samples and the priors; W makes coloured noise white. Each step solves the rows linearised
by `drift_trajectory.sensitivities`, by orthogonal factorisation; a step that raises the cost is halved.
Delta chi has three components, of which the linear model knows two: the one along u acts by way of gravity.

The noise is told by the residuals of this fit: those of the linear model hold what it neglects, an arc second
or more over a day, which looks like coloured noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_exact_rows import DELTA_CHI, Unknowns, misalignment_of, values
from pipeline.models.drift_noise import COLOURED, whitened, whiteness
from pipeline.models.drift_problem import Estimate, Parameter, Problem
from pipeline.models.drift_trajectory import TrajectoryError, trajectory
from pipeline.models.earth import Base
from pipeline.models.gyro_drift import DRIFT, MISALIGNMENT, TILT, Gyro
from pipeline.numerics.least_squares import triangular
from pipeline.numerics.whiteness import AutoRegression

Float = NDArray[np.float64]

_CONVERGED = 1e-3
"""Length of the last step in standard errors along it: what it leaves is no part of the uncertainty."""

_HALVINGS = 12
"""A step that does not lower the cost when 4000 times shorter has no direction left."""

_DETERMINED = 0.5
"""Beyond this part of its standard deviation beforehand, a standard error tells little of the record."""

_LEAST_SIGMA = 1e-9
"""Radians, a thousand times what the trajectories are computed to: smaller residuals are no noise."""

_SETTLED = 1e-3
"""Change of sigma, relative, at which it has settled: far below its standard error."""

_MOST_ROUNDS = 10

_ILL_DETERMINED = 1e6
"""Condition from which an arc second of error over a day may move the weakest combination by a degree."""


def gauss_newton(
    problem: Problem,
    start: Estimate,
    *,
    sigma: float,
    autoregression: AutoRegression | None = None,
    max_iterations: int = 10,
) -> Estimate:
    """Fit the exact model to all arcs.

    Parameters
    ----------
    problem : Problem
        The runs. Its prior ``epsilon`` holds for each of the three components of Delta chi.
    start : Estimate
        Of a linear method: parameters by name, and the first of each predicted arc as its alpha(0).
    sigma : float
        Standard deviation of one angle [rad].
    autoregression : AutoRegression, optional
        Where the noise is coloured; sigma is then that of the coloured noise.
    max_iterations : int
        Steps at most.

    Returns
    -------
    Estimate
        Parameters m, and with installation errors theta, and each run's Delta chi and epsilon. ``figures``:
        ``iterations``, ``converged`` (1 or 0), ``step`` (the last, in standard errors), ``cost``,
        ``chi_square`` and ``degrees_of_freedom`` of the measured samples, ``residual_sigma`` [rad],
        ``condition`` of the rows without priors, alpha(0) taken out. ``notes`` say what did not converge
        or is not determined.

    Raises
    ------
    TrajectoryError
        If the start itself leads the inner axis to 90 degrees.
    """
    unknowns = Unknowns(problem, float(sigma), autoregression)
    return _result(_iterated(unknowns, unknowns.of_estimate(start), max_iterations))


def gauss_newton_and_noise(
    problem: Problem,
    start: Estimate,
    *,
    sigma: float | None = None,
    coloured: bool = True,
    max_iterations: int = 10,
) -> tuple[Estimate, AutoRegression | None]:
    """Fit the exact model to all arcs, and tell the noise by its residuals.

    As long as the residuals are not white, the fit and the autoregression of its residuals follow each other.

    Parameters
    ----------
    problem, start, max_iterations
        As for `gauss_newton`.
    sigma : float, optional
        Standard deviation of one angle [rad]; by default from the residuals.
    coloured : bool
        Whether coloured residuals are allowed for.

    Returns
    -------
    estimate : Estimate
        Of `gauss_newton`, weighted by the noise found; ``figures`` has also ``whiteness``, the probability
        that white noise leaves residuals as coloured as these, and ``order`` of the autoregression.
    autoregression : AutoRegression or None
        None where the residuals are white.

    Raises
    ------
    TrajectoryError
        If the start itself leads the inner axis to 90 degrees.
    """
    unknowns = Unknowns(problem, max(sigma or start.sigma, _LEAST_SIGMA), None)
    fit = _iterated(unknowns, unknowns.of_estimate(start), max_iterations)
    if sigma is None:
        fit = _levelled(fit, max_iterations)
    probability = whiteness(_deviations(fit), [arc.measured for arc in problem.arcs])
    noise: AutoRegression | None = None
    if coloured and probability < COLOURED and fit.sigma > max((sigma or 0.0) / 2, _LEAST_SIGMA):
        fit, noise = _whitened(fit, sigma, max_iterations)
    estimate = _result(fit)
    figures = {
        **estimate.figures,
        "whiteness": probability,
        "order": 0.0 if noise is None else float(noise.order),
    }
    notes = estimate.notes
    if noise is not None:
        notes += ("coloured residuals are taken for noise; a drift that has not settled looks the same",)
    return replace(estimate, figures=figures, notes=notes), noise


def predict_arc(estimate: Estimate, base: Base, start: Float, tau: Float, run: int) -> Float:
    """Angles by the exact model with the parameters of an estimate, as for samples that it has not seen.

    Parameters
    ----------
    estimate : Estimate
        Of any method: where it has no Delta chi, the part across u that epsilon tells is taken.
    base : Base
        The run's, as it is meant to stand.
    start : ndarray, shape (2,)
        Angles at ``tau[0]`` [rad].
    tau : ndarray, shape (n,)
        Increasing instants in units of the Earth rate.
    run : int
        Index of the run.

    Returns
    -------
    ndarray, shape (n, 2)

    Raises
    ------
    TrajectoryError
        If alpha2 comes to 90 degrees.
    """
    gyro = Gyro(values(estimate, DRIFT), values(estimate, TILT))
    return trajectory(gyro, base.misaligned(misalignment_of(estimate, base, run)), start, tau)


@dataclass(frozen=True, slots=True)
class _Fit:
    """Where the iterations ended: x and its cost; the last rows; a root of the covariance; the last step."""

    unknowns: Unknowns
    x: Float
    cost: float
    rows: Float
    root: Float
    iterations: int
    length: float

    @property
    def freedom(self) -> float:
        """Of the residuals; of what the unknowns cost, the priors pay ``tr(C P^-1)``."""
        known = float(np.sum((self.unknowns.prior_rows(self.x)[:, :-1] @ self.root) ** 2))
        return len(self.unknowns.residuals(self.x)) - (len(self.x) - known)

    @property
    def sigma(self) -> float:
        """Standard deviation of one angle by the residuals [rad]."""
        chi_square = float(np.sum(self.unknowns.residuals(self.x) ** 2))
        return self.unknowns.sigma * math.sqrt(chi_square / max(self.freedom, 1.0))


def _iterated(unknowns: Unknowns, x: Float, max_iterations: int) -> _Fit:
    cost, iterations = unknowns.cost(x), 0
    while True:
        rows = unknowns.linearised(x)
        step, root, length = _solved(np.concatenate([rows, unknowns.prior_rows(x)]))
        lower = _lowered(unknowns, x, step, cost) if iterations < max_iterations else None
        if lower is not None:
            x, cost = lower
            iterations += 1
        if lower is None or length <= _CONVERGED:
            return _Fit(unknowns, x, cost, rows, root, iterations, length)


def _levelled(fit: _Fit, max_iterations: int) -> _Fit:
    """The fit weighted by the sigma of its own residuals: too large a one leaves them the pull of priors."""
    for _ in range(_MOST_ROUNDS):
        level = max(fit.sigma, _LEAST_SIGMA)
        if abs(level / fit.unknowns.sigma - 1) < _SETTLED:
            break
        fit = _iterated(replace(fit.unknowns, sigma=level), fit.x, max_iterations)
    return fit


def _deviations(fit: _Fit) -> list[Float]:
    """Measured less computed angles of each arc."""
    return [arc.alpha - computed for arc, computed in fit.unknowns.computed(fit.x)]


def _whitened(fit: _Fit, sigma: float | None, max_iterations: int) -> tuple[_Fit, AutoRegression | None]:
    """The fit and the autoregression of its residuals in turn, until that settles."""

    def refitted(last: _Fit, noise: AutoRegression) -> _Fit:
        level = replace(last, unknowns=replace(last.unknowns, autoregression=noise)).sigma
        unknowns = replace(last.unknowns, sigma=sigma or level, autoregression=noise)
        return _iterated(unknowns, last.x, max_iterations)

    return whitened(
        fit,
        [arc.measured for arc in fit.unknowns.problem.arcs],
        residuals=_deviations,
        taken=lambda of: of.unknowns.taken(of.x, of.root),
        refitted=refitted,
        most_rounds=_MOST_ROUNDS,
    )


def _solved(rows: Float) -> tuple[Float, Float, float]:
    """Solution of ``J dx = r``, a root S of its covariance ``S S^T``, and ``|J dx|``.

    That is the length of dx in standard errors along it. Where nothing tells, dx is 0.
    """
    J, r = rows[:, :-1], rows[:, -1]
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    kept = s > s[0] * np.finfo(np.float64).eps * max(J.shape)
    root, along = Vt[kept].T / s[kept], U[:, kept].T @ r
    return root @ along, root, float(np.linalg.norm(along))


def _lowered(unknowns: Unknowns, x: Float, step: Float, cost: float) -> tuple[Float, float] | None:
    """The end of the step, or of its half, or half of that, where the cost is lower; None where nowhere."""
    for halving in range(_HALVINGS):
        trial = x + step / 2**halving
        try:
            reached = unknowns.cost(trial)
        except TrajectoryError:  # no such motion: too long a step
            continue
        if reached <= cost * (1 + 1e-9) + 1e-6:  # the sums' rounding, far below one standard error
            return trial, reached
    return None


def _result(fit: _Fit) -> Estimate:
    unknowns, first = fit.unknowns, fit.unknowns.nuisance
    parameters, matrix = _with_epsilon(unknowns)
    estimate = Estimate(
        "gauss_newton",
        parameters,
        matrix @ fit.x[first:],
        matrix @ (fit.root @ fit.root.T)[first:, first:] @ matrix.T,
        unknowns.sigma,
        tuple(alpha for _, alpha in unknowns.computed(fit.x)),
        {
            "iterations": float(fit.iterations),
            "converged": float(fit.length <= _CONVERGED),
            "step": fit.length,
            "cost": fit.cost,
            "chi_square": float(np.sum(unknowns.residuals(fit.x) ** 2)),
            "degrees_of_freedom": fit.freedom,
            "residual_sigma": fit.sigma,
            "condition": _condition(triangular(fit.rows)[first:-1, first:-1]),
        },
    )
    return replace(estimate, notes=tuple(_notes(estimate, unknowns.problem, len(fit.x) - fit.root.shape[1])))


def _with_epsilon(unknowns: Unknowns) -> tuple[tuple[Parameter, ...], Float]:
    """All parameters, ``epsilon = u x Delta chi`` among them, and the matrix that makes them."""
    parameters, count = unknowns.parameters, len(unknowns.parameters)
    blocks = [np.eye(count)]
    for run, base in enumerate(unknowns.problem.bases if unknowns.problem.installation else ()):
        own = [parameters.index(Parameter(name, run)) for name in DELTA_CHI]
        block = np.zeros((3, count))
        block[:, own] = np.cross(base.u, np.eye(3)).T
        blocks.append(block)
        parameters += tuple(Parameter(name, run) for name in MISALIGNMENT)
    return parameters, np.concatenate(blocks)


def _condition(triangle: Float) -> float:
    values = np.linalg.svd(triangle, compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0 else float("inf")


def _notes(estimate: Estimate, problem: Problem, missing: int) -> Iterator[str]:
    """What is to be said of the estimate; ``missing`` directions had neither record nor prior."""
    figures = estimate.figures
    if not figures["converged"]:
        yield (
            f"did not converge in {figures['iterations']:.0f} iterations: "
            f"the next step would be {figures['step']:.2g} standard errors long"
        )
    if missing:
        yield f"nothing determines {missing} directions in the space of the parameters: they stay as begun"
    if figures["condition"] > _ILL_DETERMINED:
        yield f"ill-determined, condition {figures['condition']:.1e}: some combination rests on the priors"
    loose = []
    for parameter, error in zip(estimate.parameters, estimate.standard_errors, strict=True):
        prior = problem.priors.get("epsilon" if parameter.name in MISALIGNMENT else parameter.name)
        if prior is not None and error > _DETERMINED * prior.sigma:
            loose.append(parameter.name + ("" if parameter.run is None else f" of run {parameter.run}"))
    if loose:
        yield f"the record tells little of {', '.join(loose)}: the priors decide"
