"""The exact model of all arcs as rows of a least-squares problem about a point.

The unknowns stand in one vector x: alpha(0) of each arc, then m, theta, and Delta chi of each run. A row is
of a measured angle, white and of unit variance: its derivatives by x, and its residual.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_problem import Arc, Estimate, Parameter, Problem
from pipeline.models.drift_trajectory import sensitivities, trajectory
from pipeline.models.earth import Base
from pipeline.models.gyro_drift import DRIFT, MISALIGNMENT, TILT, Gyro, misalignment_from_epsilon
from pipeline.numerics.least_squares import triangular
from pipeline.numerics.whiteness import AutoRegression

Float = NDArray[np.float64]
Index = NDArray[np.intp]

DELTA_CHI = ("delta_chi1", "delta_chi2", "delta_chi3")
"""Each run's misalignment as a rotation vector, beside its epsilon."""


@dataclass(frozen=True, slots=True)
class Unknowns:
    """The vector x of a problem, and its rows.

    Attributes
    ----------
    problem : Problem
    sigma : float
        Standard deviation of an angle [rad].
    autoregression : AutoRegression or None
        Of coloured noise, of which sigma then is.
    """

    problem: Problem
    sigma: float
    autoregression: AutoRegression | None

    @property
    def nuisance(self) -> int:
        """How many initial angles there are; they come first."""
        return 2 * len(self.problem.arcs)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What follows the initial angles."""
        common = [Parameter(name) for name in (*DRIFT, *(TILT if self.problem.installation else ()))]
        runs = range(len(self.problem.bases)) if self.problem.installation else ()
        return (*common, *(Parameter(name, run) for run in runs for name in DELTA_CHI))

    def columns(self, number: int) -> Index:
        """Places in the vector of an arc's columns of `sensitivities`: the first 8, or all 13."""
        first = self.nuisance
        common = [2 * number, 2 * number + 1, *range(first, first + len(DRIFT))]
        if self.problem.installation:
            turn = first + len(DRIFT) + len(TILT) + 3 * self.problem.arcs[number].run
            common += [first + 6, first + 7, turn, turn + 1, turn + 2]
        return np.array(common)

    def of_estimate(self, start: Estimate) -> Float:
        """The vector at the start."""
        parts = [predicted[0] for predicted in start.predicted]
        parts.append(values(start, DRIFT))
        if self.problem.installation:
            parts.append(values(start, TILT))
            parts += [misalignment_of(start, base, run) for run, base in enumerate(self.problem.bases)]
        return np.concatenate(parts)

    def setting(self, x: Float, number: int) -> tuple[Gyro, Base, Float, Float]:
        """Gyro, base as it is meant to stand, misalignment and alpha(0) of an arc."""
        own = np.zeros(13)
        columns = self.columns(number)
        own[: len(columns)] = x[columns]
        return Gyro(own[2:8], own[8:10]), self.problem.bases[self.problem.arcs[number].run], own[10:], own[:2]

    def computed(self, x: Float) -> Iterator[tuple[Arc, Float]]:
        """Each arc with its trajectory."""
        for number, arc in enumerate(self.problem.arcs):
            gyro, base, misalignment, initial = self.setting(x, number)
            yield arc, trajectory(gyro, base.misaligned(misalignment), initial, arc.tau)

    def weighted(self, arc: Arc, rows: Float) -> Float:
        """Rows (n, 2, ...) of the measured samples, white and of unit variance."""
        if self.autoregression is None:
            return rows[arc.measured] / self.sigma
        return self.autoregression.whiten(rows, arc.measured) * (self.autoregression.spread / self.sigma)

    def residuals(self, x: Float) -> Float:
        """Of the measured samples, white and of unit variance."""
        return np.concatenate([self.weighted(arc, arc.alpha - a).ravel() for arc, a in self.computed(x)])

    def cost(self, x: Float) -> float:
        """What is minimised."""
        return float(np.sum(self.residuals(x) ** 2) + np.sum(self.prior_rows(x)[:, -1] ** 2))

    def prior_rows(self, x: Float) -> Float:
        """One row a prior: the unit vector of its unknown and what is missing to its mean, over its sigma."""
        rows = []
        for column, parameter in enumerate(self.parameters, self.nuisance):
            prior = self.problem.priors.get("epsilon" if parameter.name in DELTA_CHI else parameter.name)
            if prior is not None:
                row = np.zeros(len(x) + 1)
                row[column], row[-1] = 1 / prior.sigma, (prior.mean - x[column]) / prior.sigma
                rows.append(row)
        return np.array(rows).reshape(-1, len(x) + 1)

    def linearised(self, x: Float) -> Float:
        """Rows ``(J, residual)`` of all arcs at x, each arc's turned into a triangle, shape (n, k + 1)."""
        triangles = []
        for number, arc in enumerate(self.problem.arcs):
            gyro, base, misalignment, initial = self.setting(x, number)
            alpha, D = sensitivities(gyro, base, misalignment, initial, arc.tau)
            columns = self.columns(number)
            together = np.concatenate(
                [D[:, :, : len(columns)], (arc.alpha - alpha)[:, :, np.newaxis]], axis=2
            )
            white = self.weighted(arc, together)
            triangle = triangular(white.reshape(-1, white.shape[2]))
            placed = np.zeros((len(triangle), len(x) + 1))
            placed[:, columns], placed[:, -1] = triangle[:, :-1], triangle[:, -1]
            triangles.append(placed)
        return np.concatenate(triangles)

    def taken(self, x: Float, root: Float) -> tuple[Float, ...]:
        """Factor U of the covariance ``U U^T`` of each arc's computed angles, each of shape (n, 2, q).

        Of the noise so much went into the estimate, whose covariance is ``root root^T``.
        """
        parts = []
        for number, arc in enumerate(self.problem.arcs):
            gyro, base, misalignment, initial = self.setting(x, number)
            _, D = sensitivities(gyro, base, misalignment, initial, arc.tau)
            columns = self.columns(number)
            parts.append(np.asarray(D[:, :, : len(columns)] @ root[columns], dtype=np.float64))
        return tuple(parts)


def values(estimate: Estimate, names: tuple[str, ...], run: int | None = None) -> Float:
    """Values by name; 0 for what the estimate does not hold."""
    held = dict(zip(estimate.parameters, estimate.value, strict=True))
    return np.array([held.get(Parameter(name, run), 0.0) for name in names])


def misalignment_of(estimate: Estimate, base: Base, run: int) -> Float:
    """Delta chi of a run; of an estimate that has none, the part across u that its epsilon tells."""
    if Parameter(DELTA_CHI[0], run) in estimate.parameters:
        return values(estimate, DELTA_CHI, run)
    return misalignment_from_epsilon(values(estimate, MISALIGNMENT, run), base)
