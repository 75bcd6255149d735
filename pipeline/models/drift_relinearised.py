"""What the linear model of the drift neglects, from the exact one at an estimate.

The linear model leaves out products of the drift and the installation errors, 3e-3 to 1.3e-2 degrees an hour
for a tilt of 10' and m = 0.01. With the parameters p^ of a fit of the exact model they are known,
``r(alpha) = exact(alpha, p^) - c(alpha) - F(alpha) p^``, and ``alpha' = c + r + F p`` is the exact model to
first order in ``p - p^``: so the linear methods, the filter among them, tell the same gyro as the exact fit.
"""

from __future__ import annotations

from dataclasses import replace

from pipeline.models.drift_exact_rows import DELTA_CHI
from pipeline.models.drift_problem import Estimate, Problem
from pipeline.models.drift_rows import nominal_of
from pipeline.models.gyro_drift import DRIFT, TILT, Gyro, exact_rates, linear_model


def relinearised(problem: Problem, estimate: Estimate) -> Problem:
    """The problem with what the linear model neglects in every arc.

    Parameters
    ----------
    problem : Problem
    estimate : Estimate
        Of `gauss_newton`, with theta and Delta chi.
    """
    gyro = Gyro(estimate.of(DRIFT), estimate.of(TILT))
    arcs = []
    for arc in problem.arcs:
        base = problem.bases[arc.run]
        c, F = linear_model(arc.alpha, base)
        standing = base.misaligned(estimate.of(DELTA_CHI, arc.run))
        linear = c + F @ nominal_of(estimate, arc.run)
        arcs.append(replace(arc, neglected=exact_rates(arc.alpha, gyro, standing) - linear))
    return replace(problem, arcs=tuple(arcs))
