"""What the linear model of the drift neglects, from the exact one at an estimate.

The linear model leaves out products of the drift and the installation errors, 3e-3 to 1.3e-2 degrees an hour
for a tilt of 10' and m = 0.01. With the parameters p^ of a fit of the exact model they are known,
``r(alpha) = exact(alpha, p^) - c(alpha) - F(alpha) p^``, and ``alpha' = c + r + F p`` is the exact model to
first order in ``p - p^``: so the linear methods, the filter among them, tell the same gyro as the exact fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_exact_rows import misalignment_of, values
from pipeline.models.drift_problem import Arc, Estimate, Parameter, Problem
from pipeline.models.drift_rows import nominal_of
from pipeline.models.drift_transient import STARTING
from pipeline.models.earth import Base
from pipeline.models.gyro_drift import DRIFT, TILT, Gyro, exact_rates, linear_model

Float = NDArray[np.float64]


def relinearised(problem: Problem, estimate: Estimate) -> Problem:
    """The problem with what the linear model neglects in every arc.

    Parameters
    ----------
    problem : Problem
    estimate : Estimate
        With theta and Delta chi, or epsilon. Where it has the m0 of a transient, m changes along the arc.
    """
    arcs = [replace(arc, neglected=_neglected(arc, problem, estimate)) for arc in problem.arcs]
    return replace(problem, arcs=tuple(arcs))


def _neglected(arc: Arc, problem: Problem, estimate: Estimate) -> Float:
    """``r = exact - (c + F p)``, shape (n, 2); both are linear in m, and so in what it was at first."""
    base = problem.bases[arc.run]
    standing = base.misaligned(misalignment_of(estimate, base, arc.run))
    settled = _of(estimate, DRIFT, arc, base, standing)
    if Parameter(STARTING[0]) not in estimate.parameters:
        return settled
    e = np.exp(-estimate.figures["decay"] * arc.tau)[:, np.newaxis]
    return e * _of(estimate, STARTING, arc, base, standing) + (1 - e) * settled


def _of(estimate: Estimate, drift: tuple[str, ...], arc: Arc, base: Base, standing: Base) -> Float:
    """The same with one of the drifts of the estimate throughout."""
    p = nominal_of(estimate, arc.run)
    p[: len(DRIFT)] = values(estimate, drift)
    c, F = linear_model(arc.alpha, base)
    gyro = Gyro(p[: len(DRIFT)], values(estimate, TILT))
    return exact_rates(arc.alpha, gyro, standing) - (c + F @ p)
