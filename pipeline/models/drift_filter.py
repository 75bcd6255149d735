"""Drift of a non-contact gyro by a square-root Kalman filter along its record, and the smoother back.

Gubarenko & Kuzmenko (1995), (7.1) to (7.4). The state is the parameters p and what the angles deviate from
the measured ones, ``delta = alpha - alpha_m``; over a step of the grid::

    delta_(j+1) = Phi_j delta_j + int F p + (alpha_mj + int c - alpha_m(j+1)),    0 = delta_j + v_j

Phi is the identity where nothing is said of the noise of the angles at which the model is evaluated, else
that of `drift_regression.transitions`. As printed, without process noise, the filter tells what least squares
tell; with noise of m that decays with a transient it forgets the transient. The angles of an arc begin with
its first measured sample, as uncertain as that, which is to leave them free. The parameters are carried from
arc to arc and from run to run, the misalignment of every run in one state, so that what a later run tells
of m and theta improves that of an earlier one. Where m walks it walks through the gaps of a run as well, but
not between runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from pipeline.models._kernels_drift_regression import recur
from pipeline.models.drift_problem import Arc, Estimate, Parameter, Problem
from pipeline.models.drift_regression import Quadrature
from pipeline.models.drift_rows import Columns, arc_integrals, arc_transitions, columns_of
from pipeline.models.gyro_drift import DRIFT, PARAMETERS
from pipeline.numerics.square_root_filter import Forward, State, System, run_filter
from pipeline.numerics.square_root_smoother import Backward, before_renewal, checkpoints, run_smoother

Float = NDArray[np.float64]
Integer = NDArray[np.int64]
ProcessNoise = Literal["none", "constant", "decaying"]

WIDE = 1.0
"""Standard deviation where a parameter has no prior: for m the Earth's rate, for angles a radian. The linear
model holds for hundredths of it, so that it decides nothing that the record tells."""

Walk = Callable[[Float], Float]
"""From n instants to the standard deviations of m's steps between them, shape (n - 1, 6), or (n - 1, 0)."""


@dataclass(frozen=True, slots=True)
class Evolution:
    """Estimates as they evolve in time.

    Attributes
    ----------
    arc, index : ndarray of int, shape (t,)
        The instants: arc of the problem, sample in it.
    parameters : tuple of Parameter
        As in `Estimate`.
    value, standard_error : ndarray, shape (t, k)
        m in units of the Earth rate [1], angles [rad].
    """

    arc: Integer
    index: Integer
    parameters: tuple[Parameter, ...]
    value: Float
    standard_error: Float


@dataclass(frozen=True, slots=True)
class Filtered:
    """What filter and smoother tell.

    Attributes
    ----------
    estimate : Estimate
        Method ``filter``: the parameters after the last sample, the angles by the linear model with them.
    smoothed : Estimate or None
        Method ``smoother``: the same parameters, for after the last sample there is nothing to be smoothed,
        but the smoothed angles: the model's with the parameters as they walked.
    history, smoothed_history : Evolution
        The parameters at the instants.
    innovations : tuple of ndarray, each of shape (n, 2)
        Of each arc, over their standard deviation: independent and standard normal if the model is true.
        NaN where there is none: where nothing was measured, and at the arc's first measured sample.
    normalised_innovations_squared : float
        Mean of their squares a pair: 2 if the model is true.
    count : int
        Number of pairs.
    log_likelihood : float
        Of the measurements; differences of it judge between process noises.
    """

    estimate: Estimate
    smoothed: Estimate | None
    history: Evolution
    smoothed_history: Evolution | None
    innovations: tuple[Float, ...]
    normalised_innovations_squared: float
    count: int
    log_likelihood: float

    @property
    def band(self) -> tuple[float, float]:
        """Where ``normalised_innovations_squared`` lies with 95 % if the model is true."""
        freedom = 2 * self.count
        return float(chi2.ppf(0.025, freedom)) / self.count, float(chi2.ppf(0.975, freedom)) / self.count


def kalman(
    problem: Problem,
    *,
    sigma: float,
    quadrature: Quadrature = "quintic_spline",
    nominal: Float | None = None,
    process_noise: ProcessNoise = "none",
    process_sigma: float = 0.1,
    decay: float | None = None,
    smooth: bool = True,
    instants: int = 500,
) -> Filtered:
    """Filter the runs of a gyro, and smooth them.

    Parameters
    ----------
    problem : Problem
        The runs. A parameter without prior gets one of standard deviation `WIDE` about 0.
    sigma : float
        Standard deviation of one angle [rad].
    quadrature : str
        How the model is integrated along the angles.
    nominal : ndarray, shape (11,) or (runs, 11), optional
        Parameters for `drift_regression.transitions`; without them Phi = I.
    process_noise : {"none", "constant", "decaying"}
        Random walk of each m a step: none, ``s sqrt(d tau)``, or ``s sqrt(d tau) e^(-k tau)``.
    process_sigma : float
        s [1].
    decay : float, optional
        k, in units of the Earth rate; wanted where the noise decays.
    smooth : bool
        Whether to go back as well.
    instants : int
        Number of instants a run at which to keep the estimates.

    Returns
    -------
    Filtered
    """
    columns = columns_of(problem)
    # What has process noise stands last in the filter's state: m, the first columns of the regression.
    order = np.roll(np.arange(len(columns.names)), -len(DRIFT))
    walk = _walk(process_noise, process_sigma, decay)
    runs = len(problem.bases)
    nominals = [None] * runs if nominal is None else list(np.broadcast_to(nominal, (runs, len(PARAMETERS))))
    systems = [
        _system(problem, columns, order, arc, sigma, quadrature, nominals[arc.run], walk)
        for arc in problem.arcs
    ]
    legs = list(_forward(problem.arcs, systems, _start(columns, order, sigma), walk, instants))
    back = _backward(legs) if smooth else None
    return _told(problem, columns.parameters, columns.expansion[:, order], systems, legs, back)


def _walk(process_noise: ProcessNoise, s: float, k: float | None) -> Walk:
    if process_noise == "none":
        return lambda tau: np.empty((len(tau) - 1, 0))
    if process_noise == "decaying" and k is None:
        raise ValueError("decay: expected a number where the process noise decays, found None")
    rate = k if process_noise == "decaying" and k is not None else 0.0

    def steps(tau: Float) -> Float:
        sigma = s * np.sqrt(np.diff(tau)) * np.exp(-rate * tau[:-1])
        return np.repeat(sigma[:, np.newaxis], len(DRIFT), axis=1)

    return steps


def _system(
    problem: Problem,
    columns: Columns,
    order: Integer,
    arc: Arc,
    sigma: float,
    quadrature: Quadrature,
    nominal: Float | None,
    walk: Walk,
) -> System:
    """An arc as the filter sees it, the columns of other runs zero."""
    steps = arc_integrals(arc, problem, quadrature)
    drive = np.zeros((len(steps.F), 2, len(order)))
    drive[:, :, np.argsort(order)[columns.of_run(arc.run)]] = steps.F
    return System(
        arc_transitions(arc, problem, nominal),
        drive,
        steps.c - np.diff(arc.alpha, axis=0),
        walk(arc.tau),
        np.zeros_like(arc.alpha),
        arc.measured,
        np.full(2, sigma),
    )


def _gap(before: float, after: float, step: float, k: int, walk: Walk, sigma: float) -> System:
    """Nothing but the walk of m between two arcs of a run."""
    n = max(round((after - before) / step), 1)
    return System(
        np.broadcast_to(np.eye(2), (n, 2, 2)),
        np.zeros((n, 2, k)),
        np.zeros((n, 2)),
        walk(np.linspace(before, after, n + 1)),
        np.zeros((n + 1, 2)),
        np.zeros(n + 1, dtype=np.bool_),
        np.full(2, sigma),
    )


def _start(columns: Columns, order: Integer, sigma: float) -> State:
    prior = np.where(np.isfinite(columns.prior), columns.prior, WIDE)[order]
    return State.started(columns.prior_mean[order], np.diag(prior), np.zeros(2), np.full(2, sigma))


@dataclass(frozen=True, slots=True)
class _Leg:
    """A stretch of the way: an arc from its first measured sample on, or the gap after one (``arc`` None)."""

    arc: int | None
    first: int
    kept: Integer
    """Samples of the stretch, not of the arc, that are instants of the history."""
    system: System
    forward: Forward


def _forward(
    arcs: Sequence[Arc], systems: Sequence[System], state: State, walk: Walk, instants: int
) -> Iterator[_Leg]:
    """Filter one stretch after the other."""
    before: Arc | None = None
    none = np.empty(0, dtype=np.int64)
    for number, kept in _instants(arcs, instants).items():
        arc, system = arcs[number], systems[number]
        first = int(np.argmax(arc.measured))
        if before is not None and before.run == arc.run and system.noise.shape[1]:
            k, sigma = system.drive.shape[2], float(system.sigma[0])
            gap = _gap(before.tau[-1], arc.tau[first], arc.step, k, walk, sigma)
            leg = _Leg(None, 0, none, gap, run_filter(gap, state, checkpoints(len(gap.measured))))
            state = leg.forward.state
            yield leg
        system = _begun(system, first)
        state = state.renewed(np.zeros(2), system.sigma)
        recorded = np.union1d(checkpoints(len(system.measured)), kept)
        forward = run_filter(system, state, recorded)
        state, before = forward.state, arc
        yield _Leg(number, first, kept, system, forward)


def _begun(system: System, first: int) -> System:
    """The system from its first measured sample on, that measurement being in the state at the start."""
    measured = system.measured[first:].copy()
    measured[0] = False
    return System(
        system.transition[first:],
        system.drive[first:],
        system.offset[first:],
        system.noise[first:],
        system.measurement[first:],
        measured,
        system.sigma,
    )


def _instants(arcs: Sequence[Arc], count: int) -> dict[int, Integer]:
    """Of each arc with a measurement: ``count`` instants a run, from the arc's first measured sample on."""
    lengths = {
        i: len(arc.tau) - int(np.argmax(arc.measured)) for i, arc in enumerate(arcs) if arc.measured.any()
    }
    kept: dict[int, Integer] = {}
    for run in {arcs[i].run for i in lengths}:
        numbers = [i for i in lengths if arcs[i].run == run]
        total = sum(lengths[i] for i in numbers)
        chosen = np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(np.int64))
        begin = 0
        for i in numbers:
            kept[i] = chosen[(chosen >= begin) & (chosen < begin + lengths[i])] - begin
            begin += lengths[i]
    return dict(sorted(kept.items()))


def _backward(legs: Sequence[_Leg]) -> list[Backward]:
    """Smooth one stretch after the other, from the last."""
    end = legs[-1].forward.state
    found = []
    for i in range(len(legs) - 1, -1, -1):
        found.append(run_smoother(legs[i].system, legs[i].forward, end))
        end = found[-1].state
        if i > 0 and legs[i].arc is not None:
            end = before_renewal(legs[i - 1].forward.state, end)
    return found[::-1]


def _told(
    problem: Problem,
    parameters: tuple[Parameter, ...],
    T: Float,
    systems: Sequence[System],
    legs: Sequence[_Leg],
    back: Sequence[Backward] | None,
) -> Filtered:
    """All of it in the parameters of outside, to which T takes those of the state."""
    k = T.shape[1]
    state, sigma = legs[-1].forward.state, float(systems[0].sigma[0])
    half = T @ state.factor[:k]
    predicted = tuple(_predicted(a, s, state.mean[:k]) for a, s in zip(problem.arcs, systems, strict=True))
    innovations = tuple(np.full_like(arc.alpha, np.nan) for arc in problem.arcs)
    for leg in legs:
        if leg.arc is not None:
            innovations[leg.arc][leg.first :] = leg.forward.innovations
    count = sum(int(np.isfinite(nu).all(axis=1).sum()) for nu in innovations)
    squared = sum(float(np.nansum(nu**2)) for nu in innovations) / max(count, 1)
    likelihood = sum(leg.forward.log_likelihood for leg in legs)
    figures = {"normalised_innovations_squared": squared, "log_likelihood": likelihood}
    estimate = Estimate("filter", parameters, T @ state.mean[:k], half @ half.T, sigma, predicted, figures)
    history = _evolution(legs, [leg.forward for leg in legs], parameters, T)
    smoothed = smoothed_history = None
    if back is not None:
        angles = _smoothed_angles(problem.arcs, predicted, legs, back)
        smoothed = replace(estimate, method="smoother", predicted=angles)
        smoothed_history = _evolution(legs, back, parameters, T)
    return Filtered(estimate, smoothed, history, smoothed_history, innovations, squared, count, likelihood)


def _predicted(arc: Arc, system: System, p: Float) -> Float:
    """Angles of an arc by the model with parameters p, from the initial angles that fit them best."""
    rows, added = np.zeros((len(arc.tau), 2, 3)), np.zeros((len(arc.tau) - 1, 2, 3))
    rows[0, :, :2] = np.eye(2)
    added[:, :, 2] = system.drive @ p + system.offset
    recur(system.transition, added, rows)
    A = rows[arc.measured].reshape(-1, 3)
    start = np.linalg.lstsq(A[:, :2], -A[:, 2], rcond=None)[0]
    return np.asarray(arc.alpha + rows @ np.append(start, 1.0), dtype=np.float64)


def _smoothed_angles(
    arcs: Sequence[Arc], predicted: Sequence[Float], legs: Sequence[_Leg], back: Sequence[Backward]
) -> tuple[Float, ...]:
    """Smoothed angles from each arc's first measured sample on; before it, those predicted."""
    angles = [values.copy() for values in predicted]
    for leg, backward in zip(legs, back, strict=True):
        if leg.arc is not None:
            angles[leg.arc][leg.first :] = arcs[leg.arc].alpha[leg.first :] + backward.rows
    return tuple(angles)


def _evolution(
    legs: Sequence[_Leg], passes: Sequence[Forward | Backward], parameters: tuple[Parameter, ...], T: Float
) -> Evolution:
    """The states at the instants of the history."""
    k = T.shape[1]
    arc, index, value, error = [], [], [], []
    for leg, states in zip(legs, passes, strict=True):
        if leg.arc is not None:
            at = np.searchsorted(leg.forward.instants, leg.kept)
            arc.append(np.full(len(at), leg.arc))
            index.append(leg.first + leg.kept)
            value.append(states.means[at, :k] @ T.T)
            error.append(np.linalg.norm(T @ states.factors[at, :k], axis=2))
    return Evolution(
        np.concatenate(arc), np.concatenate(index), parameters, np.concatenate(value), np.concatenate(error)
    )
