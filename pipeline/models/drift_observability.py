"""What the runs of a gyro tell of its parameters.

`pipeline.numerics.observability` on the columns of a problem: drift first, then the rotor's tilt, then the
misalignment of each run with ``u.epsilon = 0`` imposed. Gubarenko & Kuzmenko (1995), after (6.9), corrected:
``m11 = 1, epsilon = -g_zeta`` is a null vector of the rows in every scheme, which that bond alone excludes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_problem import Parameter, Prior, Problem
from pipeline.models.drift_rows import columns_of
from pipeline.models.gyro_drift import DRIFT
from pipeline.numerics.observability import Combination, Observability, analyse

Float = NDArray[np.float64]


def drift_observability(rows: Float, problem: Problem, useful: Float) -> Observability[Parameter]:
    """What rows tell of the parameters of a problem.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        Of unit variance, without priors and without the initial angles; columns as `columns_of` has its
        ``parameters``: m, theta, and epsilon1 to epsilon3 of each run.
    problem : Problem
        Its priors bound what each parameter may be while others are judged.
    useful : ndarray, shape (2,)
        Standard errors above which a drift [1] and an angle [rad] are not determined.
    """
    columns = columns_of(problem)
    return analyse(
        rows,
        columns.parameters,
        useful_deviations(columns.parameters, useful),
        extent=extents(columns.parameters, problem.priors),
        basis=columns.expansion,
    )


def useful_deviations(parameters: Sequence[Parameter], useful: Float) -> Float:
    """Of each parameter: ``useful[0]`` of a drift, ``useful[1]`` of an angle, shape (k,)."""
    return np.array([useful[0] if p.name in DRIFT else useful[1] for p in parameters])


def extents(parameters: Sequence[Parameter], priors: Mapping[str, Prior]) -> Float:
    """Standard deviation of each parameter before the run, infinite for none, shape (k,)."""
    nothing = Prior(0.0, np.inf)
    keys = ("epsilon" if p.name.startswith("epsilon") else p.name for p in parameters)
    return np.array([priors.get(key, nothing).sigma for key in keys])


def expression(combination: Combination[Parameter], runs: int) -> str:
    """A combination in words; of several runs each misalignment says whose it is."""
    return combination.read(lambda p: shown(p, runs))


def shown(parameter: Parameter, runs: int) -> str:
    """Its name; of several runs with the one that it belongs to."""
    return (
        parameter.name if parameter.run is None or runs == 1 else f"{parameter.name} of run {parameter.run}"
    )
