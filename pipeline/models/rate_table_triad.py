"""Three gyros in a case: scale factors, biases and the directions of their input axes.

The model is that of `rate_table_triad_model`. What depends on the rate about an input axis in another way
than straight is by the S of the round before. What is not known of the input, ``w = w_known + B xi``
(`rate_table_observations`), is to first order ``S B xi`` in the outputs, the same xi in all three of them,
and is solved for with xi of unit variance.

A gyro that was never turned about its own axis has no terms of its own that could be told; one that was, but
at rates that do not tell them apart, is refused.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.models.rate_table import told_apart
from pipeline.models.rate_table_fit import reference, scatter, usable, warmth, weighted
from pipeline.models.rate_table_model import Terms
from pipeline.models.rate_table_observations import AXES, Observations
from pipeline.models.rate_table_scatter import covariance_of_means
from pipeline.models.rate_table_steps import RateTableError
from pipeline.models.rate_table_triad_model import TriadCalibration, triad_names
from pipeline.numerics.least_squares import Solution, solve
from pipeline.numerics.observability import Observability, analyse

Float = NDArray[np.float64]

_ROUNDS = 4
"""Solutions by the S of the one before: with terms of a hundredth the last changes it by 1e-8 of it."""
_TURNED = 0.01
"""Of the largest rate: a gyro about whose axis the case turned less has no terms that could be told."""
_ALONG = 0.5
"""Part of the rate that must be about a gyro's axis for the observation to tell its terms."""
USEFUL = 0.01
"""Of scale factor or full scale: the standard deviation up to which a parameter is called determined."""


@dataclass(frozen=True, slots=True)
class Triad(TriadCalibration):
    """A calibration of three gyros by observations.

    Attributes
    ----------
    observability : Observability
        States by name, and combinations that are told though their terms are not; the unknowns of the input
        among them.
    residual, residual_error : ndarray, shape (m, 3)
        Output of each observation less the model, and the standard deviation it should have [out].
    scatter : ndarray, shape (3,)
        Standard deviation of each gyro between observations beyond their own noise [out].
    """

    observability: Observability[str]
    residual: Float
    residual_error: Float
    scatter: Float


def fit_triad(
    observed: Observations, terms: Terms | None = None, *, reference_temperature: float | None = None
) -> Triad:
    """Calibrate three gyros.

    Parameters
    ----------
    observed : Observations
        Of one method, or of several joined.
    terms : Terms, optional
        Of each gyro, beside bias and scale factor; by default none.
    reference_temperature : float, optional
        T0 [K]; by default the mean of the observations.

    Returns
    -------
    Triad
        What the observations do not tell is 0, has infinite standard errors and is named in
        ``observability``.

    Raises
    ------
    RateTableError
        If the observations are fewer than the unknowns of one gyro or do not tell its terms apart, the case
        never turns, or the temperature is missing.
    """
    terms = terms or Terms()
    names = triad_names(terms)
    _enough(observed, names)
    error = np.stack(
        [usable(observed.output[:, i], observed.standard_error[:, i], f"gyro {AXES[i]}") for i in range(3)],
        axis=1,
    )
    observed = replace(observed, standard_error=error)
    T0 = reference(observed.temperature, reference_temperature) if terms.thermal else float("nan")
    warm = warmth(observed.temperature, T0, len(observed), needed=terms.thermal)
    k, q = len(names), len(observed.unknowns)
    prior = np.concatenate([np.full(k, np.inf), np.ones(q)]) if q else None
    S = _alone(observed)
    for _ in range(_ROUNDS if q or terms.names[2:] else 1):
        inputs = _inputs(terms, S, observed, warm)
        effect = np.einsum("ij,mjq->miq", S, observed.unknown)
        tau = np.array([_scatter(inputs[:, i], effect[:, i], observed, i) for i in range(3)])
        noise = [_noise(inputs[:, i], effect[:, i], observed, i, tau[i]) for i in range(3)]
        full = np.concatenate([_design(inputs), effect], axis=2)
        white = np.linalg.inv(np.linalg.cholesky(np.stack(noise)))
        rows = np.einsum("imn,nik->mik", white, full).reshape(-1, k + q)
        y = np.einsum("imn,ni->mi", white, observed.output).ravel()
        solution = solve(rows, y, (*names, *observed.unknowns), prior=prior, sigma=1.0)
        S = solution.estimate[:9].reshape(3, 3)
    told = _told(rows, solution, names, observed, float(np.ptp(warm)))
    total = np.stack([np.diag(of) for of in noise], axis=1)
    spent = np.sum((full @ solution.factor) ** 2, axis=2)
    open_ = np.isinf(told.standard_errors[:k])
    own = np.sqrt(np.maximum(np.diag(solution.covariance)[:k], 0.0))
    return Triad(
        terms=terms,
        names=names,
        value=np.where(open_, 0.0, solution.estimate[:k]),
        covariance=solution.covariance[:k, :k],
        standard_error=np.where(open_, np.inf, own),
        reference_temperature=T0,
        largest_rate=_largest(observed),
        observability=told,
        residual=observed.output - full @ solution.estimate,
        residual_error=np.sqrt(np.maximum(total - spent, 0.0)),
        scatter=tau,
    )


def _enough(observed: Observations, names: tuple[str, ...]) -> None:
    least = len(names) // 3
    if len(observed) < least:
        raise RateTableError(
            "triad",
            expected=f"at least {least} mean rates, for the {least} unknowns of each gyro",
            found=f"{len(observed)}",
            remedy="record more steps, turns or positions, rest among them",
        )
    if not np.any(observed.rate != 0):
        raise RateTableError(
            "triad",
            expected="rotation that is known",
            found="a rate of zero throughout",
            remedy="name the rates, the turns, or the latitude",
        )


def _largest(observed: Observations) -> float:
    """w_m [rad/s]."""
    return float(np.linalg.norm(observed.rate, axis=1).max())


def _inputs(terms: Terms, S: Float, observed: Observations, warm: Float) -> Float:
    """Derivatives of each gyro's output by its own row of S and its other parameters, shape (m, 3, p)."""
    largest, along = _largest(observed), np.abs(observed.rate)
    straight = along > _ALONG * np.linalg.norm(observed.rate, axis=1)[:, np.newaxis]
    inputs = []
    for i in range(3):
        K = float(np.linalg.norm(S[i]) * np.sign(S[i, i]))
        turned = K != 0 and along[:, i].max() > _TURNED * largest
        w = observed.rate @ S[i] / K if turned else np.zeros(len(observed))
        columns = terms.columns(w, largest, warm) * np.where(terms.divided, K, 1.0)
        if turned and terms.names[2:]:
            # what a run about another axis tells of this gyro's axis is its misalignment
            alone = terms.columns(np.where(straight[:, i], w, 0.0), largest, warm)
            told_apart(alone, terms.names, f"rate table, gyro {AXES[i]}")
        inputs.append(np.concatenate([observed.rate, np.delete(columns, 1, axis=1)], axis=1))
    return np.stack(inputs, axis=1)


def _design(inputs: Float) -> Float:
    """Derivatives of the outputs by all parameters, shape (m, 3, k), from those of each, shape (m, 3, p)."""
    m, _, p = inputs.shape
    A = np.zeros((m, 3, 3 * p))
    for i in range(3):
        A[:, i, 3 * i : 3 * i + 3] = inputs[:, i, :3]
        A[:, i, 9 + i :: 3] = inputs[:, i, 3:]
    return A


def _alone(observed: Observations) -> Float:
    """S by each gyro alone, without its terms, the input taken as known."""
    columns = np.column_stack([observed.rate, np.ones(len(observed))])
    names = [str(j) for j in range(columns.shape[1])]
    rows = [
        weighted(columns, observed.output[:, i], observed.standard_error[:, i], names).estimate[:3]
        for i in range(3)
    ]
    return np.stack(rows)


def _scatter(inputs: Float, effect: Float, observed: Observations, gyro: int) -> float:
    """Scatter of one gyro; the unknowns of the input may explain what they can."""
    p, q = inputs.shape[1], effect.shape[1]
    prior = np.concatenate([np.full(p, np.inf), np.ones(q)]) if q else None
    A = np.concatenate([inputs, effect], axis=1)
    return scatter(A, observed.output[:, gyro], observed.standard_error[:, gyro], prior)


def _noise(inputs: Float, effect: Float, observed: Observations, gyro: int, scatter: float) -> Float:
    """Covariance of the outputs of one gyro; without times between them its scatter is independent."""
    error = observed.standard_error[:, gyro]
    average = None
    if observed.apart is not None:
        average = covariance_of_means(inputs, observed.output[:, gyro], error, effect, observed.apart)
    return np.diag(error**2 + scatter**2) if average is None else average


def _told(
    rows: Float, solution: Solution, names: tuple[str, ...], observed: Observations, warmth_range: float
) -> Observability[str]:
    """What the rows tell of the parameters and the unknowns of the input."""
    k, q = len(names), len(observed.unknowns)
    K = float(np.abs(solution.estimate[:9]).max())
    useful = [USEFUL * _unit(name, K, K * _largest(observed), warmth_range or 1.0) for name in names]
    extent = np.concatenate([np.full(k, np.inf), np.ones(q)])
    all_useful = np.concatenate([useful, np.ones(q)])
    return analyse(rows, (*names, *observed.unknowns), all_useful, extent=extent)


def _unit(name: str, K: float, full_scale: float, warmth_range: float) -> float:
    """What a parameter comes to that changes an output by all of it."""
    if name.startswith("S"):
        return K
    scale = full_scale if name.startswith("bias") else 1.0
    return scale / warmth_range if "temperature" in name else scale
