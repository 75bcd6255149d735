"""Which further run of a gyro would determine what the present ones do not.

The trajectory of every candidate, a scheme, initial angles and hours, is computed by the exact model with
the parameters as they are estimated now, and with it how its angles depend on all of them. These are the rows
that the further run would add to the present ones, with a misalignment of its own: its standard errors are
known before it is made.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.models.drift_observability import extents, useful_deviations
from pipeline.models.drift_problem import Estimate, Parameter, Problem
from pipeline.models.drift_rows import columns_of, nominal_of
from pipeline.models.drift_trajectory import TrajectoryError, sensitivities
from pipeline.models.earth import RATE, Base, Scheme
from pipeline.models.gyro_drift import DRIFT, TILT, Gyro
from pipeline.numerics.least_squares import triangular
from pipeline.numerics.observability import standard_deviations

Float = NDArray[np.float64]

SCHEMES: tuple[Scheme, ...] = get_args(Scheme)
HOURS = (6.0, 12.0, 24.0)
"""Lengths of a further run."""
_OUTER = np.deg2rad([0.0, 45.0, 90.0])
_INNER = np.deg2rad([-60.0, -30.0, 0.0, 30.0, 60.0])
"""Initial angles of the outer and the inner gimbal [rad]."""
_FARTHEST = np.deg2rad(80.0)
"""Of the inner gimbal: beyond it the outer one turns six times as fast as the axis."""
_INTERVAL = 300.0
"""Of the samples of a candidate [s]: a day of them turns 1.25 degrees a step."""
_BETTER = 0.5
"""A run that determines nothing more is worth a word if it brings an error below this part of it now."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A further run, and what it would tell together with the present ones.

    Attributes
    ----------
    scheme : {"polar", "equatorial", "horizontal", "vertical"}
        Mounting of the base.
    alpha : ndarray, shape (2,)
        Initial gimbal angles [rad].
    duration : float
        [s]
    parameters : tuple of Parameter
        Those of the present runs.
    standard_error_now, standard_error_then : ndarray, shape (k,)
        By the present runs, and with the further one; infinite where they tell nothing.
    determined : ndarray of bool, shape (k,)
        Whether ``standard_error_then`` is useful.
    """

    scheme: Scheme
    alpha: Float
    duration: float
    parameters: tuple[Parameter, ...]
    standard_error_now: Float
    standard_error_then: Float
    determined: NDArray[np.bool_]


def further_runs(
    rows: Float,
    problem: Problem,
    estimate: Estimate,
    *,
    sigma: float,
    interval: float,
    useful: Float,
    count: int = 3,
) -> tuple[Proposal, ...]:
    """Propose further runs that would determine what is missing, the best of each scheme.

    The best determines most, in the fewest hours, to the smallest product of standard errors.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        What the present runs tell: as for `drift_observability`.
    problem : Problem
        The present runs.
    estimate : Estimate
        m and theta with which candidates are computed; what it does not hold is taken as 0.
    sigma : float
        Standard deviation of one angle [rad] ...
    interval : float
        ... of samples so far apart [s], white.
    useful : ndarray, shape (2,)
        Standard errors above which a drift [1] and an angle [rad] are not determined.
    count : int
        How many proposals at most.

    Returns
    -------
    tuple of Proposal
        The best first; none where nothing is missing, or no run would tell it.
    """
    gyro = _gyro(estimate)
    scale = sigma * np.sqrt(interval / _INTERVAL)
    best: dict[Scheme, tuple[tuple[float, ...], Proposal]] = {}
    for scheme in SCHEMES:
        base = Base.mounted(scheme, problem.bases[0].latitude)
        judge = _Judge(rows, problem, base, useful)
        now = judge.errors()
        missing = now > judge.useful
        if not missing.any():
            return ()
        for alpha, hours, added in _candidates(gyro, base):
            then = judge.errors(added / scale)
            determined = then <= judge.useful
            gained = int(np.sum(determined & missing))
            if not gained and not np.any(then[missing] < _BETTER * now[missing]):
                continue
            # few hours are a merit only of what determines more
            rank = (-gained, hours if gained else 0.0, float(np.log(then[then > 0]).sum()))
            if scheme not in best or rank < best[scheme][0]:
                told = Proposal(scheme, alpha, hours * 3600, judge.parameters, now, then, determined)
                best[scheme] = rank, told
    return tuple(proposal for _, proposal in sorted(best.values(), key=lambda item: item[0])[:count])


class _Judge:
    """Standard errors of the present parameters with a further run on a base, misaligned in its own way."""

    def __init__(self, rows: Float, problem: Problem, base: Base, useful: Float) -> None:
        columns = columns_of(replace(problem, bases=(*problem.bases, base)))
        count, total = rows.shape[1], len(columns.parameters)
        self.parameters = columns.parameters[:count]
        self.useful = useful_deviations(self.parameters, useful)
        self._present = np.pad(triangular(rows), ((0, 0), (0, total - count)))
        # where the columns of the further run are: m and theta are common
        common = sum(p.run is None for p in columns.parameters)
        self._place = np.concatenate([np.arange(common), np.arange(count, total)])
        self._all = {
            "useful": useful_deviations(columns.parameters, useful),
            "extent": extents(columns.parameters, problem.priors),
            "basis": columns.expansion,
        }

    def errors(self, added: Float | None = None) -> Float:
        """With the rows of a further run, columns as in `gyro_drift.PARAMETERS`; shape (k,)."""
        rows = self._present
        if added is not None:
            further = np.zeros((len(added), rows.shape[1]))
            further[:, self._place] = added[:, : len(self._place)]
            rows = np.vstack([rows, further])
        return standard_deviations(rows, **self._all)[: len(self.parameters)]


def _candidates(gyro: Gyro, base: Base) -> Iterator[tuple[Float, float, Float]]:
    """Initial angles, hours, and rows of what the angles tell of the parameters, (11, 11), of weight 1."""
    # epsilon = u x Delta chi, and the part of Delta chi across u is epsilon x u
    by_epsilon = np.cross(np.eye(3), base.u).T
    for alpha1, alpha2 in product(_OUTER, _INNER):
        start = np.array([alpha1, alpha2])
        followed = _followed(gyro, base, start)
        if followed is None:
            continue
        alpha, D = followed
        rows = np.concatenate([D[:, :, :-3], D[:, :, -3:] @ by_epsilon], axis=2)
        for hours in HOURS:
            n = round(hours * 3600 / _INTERVAL) + 1
            if n <= len(alpha) and np.abs(alpha[:n, 1]).max() < _FARTHEST:
                # below its first two rows the triangle is free of the initial angles
                yield start, hours, triangular(rows[:n].reshape(2 * n, -1))[2:, 2:]


def _followed(gyro: Gyro, base: Base, start: Float) -> tuple[Float, Float] | None:
    """Angles and their sensitivities over the longest of `HOURS` that a gimbal can follow."""
    for hours in reversed(HOURS):
        tau = np.arange(round(hours * 3600 / _INTERVAL) + 1) * (_INTERVAL * RATE)
        try:
            return sensitivities(gyro, base, np.zeros(3), start, tau)
        except TrajectoryError:
            continue
    return None


def _gyro(estimate: Estimate) -> Gyro:
    p = nominal_of(estimate, 0)
    return Gyro(p[: len(DRIFT)], p[len(DRIFT) : len(DRIFT) + len(TILT)])
