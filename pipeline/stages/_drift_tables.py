"""Between the tables of the procedure `drift` and the arrays of its models."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline import contracts
from pipeline.models.drift_advice import Proposal
from pipeline.models.drift_filter import Evolution
from pipeline.models.drift_observability import expression
from pipeline.models.drift_problem import Arc, Estimate, Mask, Parameter, Prior, Problem
from pipeline.models.drift_transient import STARTING
from pipeline.models.earth import DEGREES_PER_HOUR, RATE, Base
from pipeline.models.gyro_drift import DRIFT
from pipeline.models.spiral_inversion import INVERSIONS
from pipeline.numerics.observability import Observability, correlation
from pipeline.stages.base import rows

Time = NDArray[np.int64]
Float = NDArray[np.float64]

SPIRALS = ("spiral", *INVERSIONS)
"""Methods that neglect the squares of the angles: a first guess and a picture, whatever their error says."""

RATES = ("lambda", "nu", "k")
"""Rates and frequencies of what decays or turns, in units of the Earth rate."""

PURE = (*DRIFT, *STARTING, *RATES)
"""Parameters without unit; the others are angles."""


def problem(
    tables: Mapping[str, pa.Table], priors: Mapping[str, Prior], *, installation: bool
) -> tuple[Problem, tuple[Time, ...]]:
    """The runs of a recording as the methods want them, and the times of each arc [ns]."""
    mountings = tables["runs"].to_pylist()
    bases = tuple(Base.at(row["latitude"], (row["chi1"], row["chi2"], row["chi3"])) for row in mountings)
    trajectory = tables["trajectory"]
    run, arc, time = (trajectory[name].to_numpy() for name in ("run", "arc", "time"))
    alpha = np.column_stack([trajectory[name].to_numpy() for name in ("alpha1", "alpha2")])
    measured = trajectory["measured"].to_numpy()
    edges = [0, *(np.flatnonzero(np.diff(arc)) + 1), len(arc)]
    first: dict[int, int] = {}
    arcs, times = [], []
    for start, stop in pairwise(edges):
        here, number = slice(start, stop), int(run[start])
        origin = first.setdefault(number, int(time[start]))
        tau = (time[here] - origin) * (1e-9 * RATE)
        arcs.append(Arc(number, tau, alpha[here], measured[here]))
        times.append(time[here])
    return Problem(bases, tuple(arcs), priors, installation), tuple(times)


def parameter_rows(
    estimates: Iterable[Estimate], states: Mapping[Parameter, str], priors: Mapping[str, Prior], useful: Float
) -> pa.Table:
    """The table `drift_parameters`.

    Parameters
    ----------
    estimates : iterable of Estimate
    states : mapping of Parameter to str
        What the record says of each parameter; one that is not in it is judged by its own standard error.
    priors : mapping of str to Prior
    useful : ndarray, shape (2,)
        Standard errors above which a drift [1] and an angle [rad] are not determined.
    """
    return rows(
        "drift_parameters", [row for e in estimates for row in _parameters(e, states, priors, useful)]
    )


def _parameters(
    estimate: Estimate, states: Mapping[Parameter, str], priors: Mapping[str, Prior], useful: Float
) -> Iterable[dict[str, Any]]:
    # What the record tells of a constant drift is another matter than what it tells of one that settles.
    judged = {p: s for p, s in states.items() if estimate.method != "transient" or p.name not in DRIFT}
    # What is bound to be zero is so but for rounding.
    free = np.array([states.get(parameter) != "given" for parameter in estimate.parameters])
    values, errors = np.where(free, [estimate.value, estimate.standard_errors], 0.0)
    for parameter, value, error in zip(estimate.parameters, values, errors, strict=True):
        pure = parameter.name in PURE
        drift = parameter.name in DRIFT or parameter.name in STARTING
        of_misalignment = parameter.name.startswith(("epsilon", "delta_chi"))
        prior = priors.get("epsilon" if of_misalignment else parameter.name)
        # An error near what was known before tells nothing of the record, nor one near the value of a k.
        least = abs(value) / 3 if parameter.name in RATES else useful[0 if pure else 1]
        told = bool(error <= min(least, np.inf if prior is None else prior.sigma / 2))
        yield {
            "method": estimate.method,
            "run": parameter.run,
            "parameter": parameter.name,
            "value": value,
            "standard_error": error,
            "unit": unit(parameter.name),
            "drift": value * DEGREES_PER_HOUR if drift else None,
            "drift_standard_error": error * DEGREES_PER_HOUR if drift else None,
            "prior": None if prior is None else prior.sigma,
            "state": "approximate"
            if estimate.method in SPIRALS
            else judged.get(parameter, "determined" if told else "undetermined"),
        }


def unit(parameter: str) -> str:
    """Unit of a parameter's value."""
    return "1" if parameter in PURE else "rad"


def observability_rows(told: Observability[Parameter]) -> pa.Table:
    """The table `observability`: each component of each direction."""
    return rows(
        "observability",
        [
            {
                "direction": number,
                "singular_value": told.singular_values[number],
                "standard_deviation": _finite(told.standard_deviations[number]),
                "state": told.direction_states[number],
                "run": parameter.run,
                "parameter": parameter.name,
                "component": component,
            }
            for number, direction in enumerate(told.directions)
            for parameter, component in zip(told.names, direction, strict=True)
        ],
    )


def combination_rows(told: Observability[Parameter], estimate: Estimate, runs: int) -> pa.Table:
    """The table `combinations`, with the values that an estimate gives them."""
    items = []
    for number, combination in enumerate(told.combinations):
        # The error of the exact model has the products of the drift with what is not determined in it.
        value, error = combination.evaluate(estimate.parameters, estimate.value, estimate.covariance)
        items += [
            {
                "combination": number,
                "expression": expression(combination, runs),
                "value": value,
                "standard_error": max(error, combination.standard_deviation),
                "run": parameter.run,
                "parameter": parameter.name,
                "coefficient": coefficient,
            }
            for parameter, coefficient in combination.terms.items()
        ]
    return rows("combinations", items)


def proposal_rows(proposals: Sequence[Proposal]) -> pa.Table:
    """The table `further_runs`."""
    return rows(
        "further_runs",
        [
            {
                "rank": rank,
                "scheme": proposal.scheme,
                "alpha1": proposal.alpha[0],
                "alpha2": proposal.alpha[1],
                "duration": proposal.duration,
                "run": parameter.run,
                "parameter": parameter.name,
                "unit": unit(parameter.name),
                "standard_error_now": _finite(proposal.standard_error_now[k]),
                "standard_error_then": _finite(proposal.standard_error_then[k]),
                "determined": bool(proposal.determined[k]),
            }
            for rank, proposal in enumerate(proposals)
            for k, parameter in enumerate(proposal.parameters)
        ],
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def correlation_rows(estimate: Estimate, states: Mapping[Parameter, str]) -> pa.Table:
    """The table `correlation` of one estimate: each pair once, but for what is bound to be zero."""
    free = [k for k, p in enumerate(estimate.parameters) if states.get(p) != "given"]
    coefficients = correlation(estimate.covariance)
    return rows(
        "correlation",
        [
            {
                "method": estimate.method,
                "run_a": a.run,
                "parameter_a": a.name,
                "run_b": b.run,
                "parameter_b": b.name,
                "correlation": coefficients[i, j],
            }
            for i, j in combinations(free, 2)
            for a, b in [(estimate.parameters[i], estimate.parameters[j])]
        ],
    )


def evolution_rows(histories: Mapping[str, Evolution], times: Sequence[Time]) -> pa.Table:
    """The table `drift_estimates`, of each method that has a history."""
    tables = [_evolution(method, history, times) for method, history in histories.items()]
    return pa.concat_tables([rows("drift_estimates", []), *tables])


def _evolution(method: str, history: Evolution, times: Sequence[Time]) -> pa.Table:
    count, names = len(history.index), [p.name for p in history.parameters]
    time = np.array([times[a][i] for a, i in zip(history.arc, history.index, strict=True)], dtype=np.int64)
    run = np.array([-1 if p.run is None else p.run for p in history.parameters], dtype=np.int32)
    # A parameter of a run has no estimate before that run begins.
    there = np.isfinite(history.value).ravel()
    runs = pa.array(np.tile(run, count)[there], mask=np.tile(run, count)[there] < 0)
    columns = {
        "method": pa.array([method]).take(pa.array(np.zeros(int(there.sum()), dtype=np.int64))),
        "time": np.repeat(time, len(names))[there],
        "run": runs,
        "parameter": pa.array(names * count).filter(pa.array(there)),
        "value": history.value.ravel()[there],
        "standard_error": history.standard_error.ravel()[there],
        "unit": pa.array([unit(name) for name in names] * count).filter(pa.array(there)),
    }
    return contracts.table("drift_estimates", columns)


def residual_rows(
    method: str,
    problem: Problem,
    times: Sequence[Time],
    predicted: Sequence[Float],
    outliers: Sequence[Mask],
    held_out: Sequence[Mask] | None = None,
) -> pa.Table:
    """The table `residuals` of one method, of the samples that it predicts.

    Parameters
    ----------
    method : str
    problem : Problem
        With the angles as they were measured.
    times, predicted, outliers : sequences, one a arc
        Times [ns]; angles by the model, shape (n, 2) [rad]; marked samples.
    held_out : sequence of ndarray of bool, one a arc, optional
        Which samples were held out; then only those become rows.
    """
    parts = []
    for number, (arc, time, model, marked) in enumerate(
        zip(problem.arcs, times, predicted, outliers, strict=True)
    ):
        kept = np.isfinite(model).all(axis=1) & (True if held_out is None else held_out[number])
        base = np.where(arc.measured, "used" if held_out is None else "held out", "bridged")
        state = np.where(marked, "outlier", base)[kept]
        count, residual = int(kept.sum()), (arc.alpha - model)[kept]
        columns = {
            "method": [method] * count,
            "run": np.full(count, arc.run, dtype=np.int32),
            "arc": np.full(count, number, dtype=np.int32),
            "time": time[kept],
            "predicted1": model[kept, 0],
            "predicted2": model[kept, 1],
            "residual1": residual[:, 0],
            "residual2": residual[:, 1],
            "state": state,
        }
        parts.append(contracts.table("residuals", columns))
    return pa.concat_tables(parts)
