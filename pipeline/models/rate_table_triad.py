"""Three gyros in a case: scale factors, biases and the directions of their input axes.

For the rate w of the case and the temperature T the outputs are ::

    y = S w + b + d (T - T0)

Row i of S is the scale factor K_i times the unit vector n_i of input axis i in the axes of the case.
What is not known of the input, ``w = w_known + B xi`` (`rate_table_observations`), is to first order
``S B xi`` in the outputs, the same xi in all three of them, and is solved for with xi of unit variance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from pipeline.models.rate_table_fit import reference, scatter, usable, warmth, weighted
from pipeline.models.rate_table_observations import AXES, Observations
from pipeline.models.rate_table_steps import RateTableError
from pipeline.numerics.least_squares import Solution
from pipeline.numerics.observability import Observability, analyse

Float = NDArray[np.float64]

SENSITIVITY = tuple(f"S{i}{j}" for i in AXES for j in AXES)
BIAS = tuple(f"bias_{i}" for i in AXES)
BIAS_TEMPERATURE = tuple(f"bias_temperature_sensitivity_{i}" for i in AXES)
PAIRS = ((0, 1), (0, 2), (1, 2))

_ROUNDS = 3
"""Solutions with the unknowns of the input, whose effect is by the S of the one before."""
USEFUL = 0.01
"""Of scale factor or full scale: the standard deviation up to which S or b is called determined."""


@dataclass(frozen=True, slots=True)
class Decomposition:
    """S in terms of the gyros.

    Attributes
    ----------
    names : tuple of str
        ``scale_factor_i``: K_i. ``misalignment_ij``: component of n_i along axis j of the case, the small
        angle towards it [rad]. ``nonorthogonality_ij``: 90 degrees less the angle between input axes i and j
        [rad].
        ``mounting_i``: rotation of the triad as a whole from the axes of the case, about axis i [rad], the
        antisymmetric part of the misalignments.
    value, standard_error : ndarray, shape (15,)
        Infinite errors where S does not tell.
    covariance : ndarray, shape (15, 15)
        Of what is told.
    """

    names: tuple[str, ...]
    value: Float
    standard_error: Float
    covariance: Float

    def of(self, name: str) -> tuple[float, float]:
        """Value and standard error by name."""
        k = self.names.index(name)
        return float(self.value[k]), float(self.standard_error[k])


@dataclass(frozen=True, slots=True)
class TriadCalibration:
    """What corrects three gyros, with its uncertainty.

    Attributes
    ----------
    names : tuple of str
        Of the k parameters: S11 to S33, bias_1 to bias_3, and the bias temperature sensitivities if asked
        for.
    value : ndarray, shape (k,)
        S [out s/rad], bias [out], its sensitivity [out/K].
    covariance : ndarray, shape (k, k)
        Of what is told.
    standard_error : ndarray, shape (k,)
        Infinite where the observations tell nothing.
    reference_temperature : float
        T0 [K]; NaN without terms of temperature.
    """

    names: tuple[str, ...]
    value: Float
    covariance: Float
    standard_error: Float
    reference_temperature: float

    @property
    def S(self) -> Float:  # noqa: N802 - the symbol of the model
        """Sensitivity, shape (3, 3) [out s/rad]."""
        return self.value[:9].reshape(3, 3)

    @property
    def bias(self) -> Float:
        """Output without input at the reference temperature, shape (3,) [out]."""
        return self.value[9:12]

    @property
    def bias_temperature_sensitivity(self) -> Float:
        """Shape (3,) [out/K]; zero where it was not asked for."""
        return self.value[12:] if len(self.value) > 12 else np.zeros(3)

    @property
    def determined(self) -> bool:
        """Whether all of S and b are told."""
        return bool(np.isfinite(self.standard_error).all())

    def decomposed(self) -> Decomposition:
        """Scale factors and small angles, with the errors that those of S give them.

        Raises
        ------
        RateTableError
            If a gyro responds to no rate at all.
        """
        S, K = self.S, np.linalg.norm(self.S, axis=1) * np.sign(np.diag(self.S))
        if not np.all(K != 0):
            raise RateTableError(
                f"gyro {AXES[int(np.flatnonzero(K == 0)[0])]}",
                expected="a response to the rate about its own axis of the case",
                found="none",
                remedy="turn the case about that axis, and check the order of the channels",
            )
        n = S / K[:, np.newaxis]
        dK = block_diag(*n)
        # dn_i / dS_i = (1 - n_i n_i^T) / K_i
        dn = block_diag(*[(np.eye(3) - np.outer(v, v)) / k for v, k in zip(n, K, strict=True)])
        dn = dn.reshape(3, 3, 9)
        off = [(i, j) for i in range(3) for j in range(3) if i != j]
        sine = np.array([n[i] @ n[j] for i, j in PAIRS])
        dsine = np.stack([n[j] @ dn[i] + n[i] @ dn[j] for i, j in PAIRS])
        # n = 1 - [phi x] for a triad turned by phi
        turned = [(1, 2), (2, 0), (0, 1)]
        value = [
            K,
            [n[i, j] for i, j in off],
            np.arcsin(sine),
            [(n[i, j] - n[j, i]) / 2 for i, j in turned],
        ]
        J = [
            dK,
            [dn[i, j] for i, j in off],
            dsine / np.sqrt(1 - sine**2)[:, np.newaxis],
            [(dn[i, j] - dn[j, i]) / 2 for i, j in turned],
        ]
        names = (
            *(f"scale_factor_{i}" for i in AXES),
            *(f"misalignment_{i + 1}{j + 1}" for i, j in off),
            *(f"nonorthogonality_{i + 1}{j + 1}" for i, j in PAIRS),
            *(f"mounting_{i}" for i in AXES),
        )
        derivatives = np.concatenate(J)
        covariance = derivatives @ self.covariance[:9, :9] @ derivatives.T
        untold = np.any(derivatives[:, np.isinf(self.standard_error[:9])] != 0, axis=1)
        error = np.where(untold, np.inf, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
        return Decomposition(names, np.concatenate(value), error, covariance)

    def apply(self, raw: Float, temperature: Float | None = None) -> tuple[Float, Float]:
        """The rate of the case that outputs tell: ``S^-1 (raw - b(T))``.

        Parameters
        ----------
        raw : ndarray, shape (n, 3)
            [out].
        temperature : ndarray, shape (n,), optional
            [K]; must be there if the calibration has terms of it.

        Returns
        -------
        rate : ndarray, shape (n, 3)
            In the axes of the case [rad/s].
        standard_error : ndarray, shape (n, 3)
            That the uncertainty of the calibration gives it; the gyros' own noise is not in it. It is the
            same error throughout a record, not a new one in each sample.

        Raises
        ------
        RateTableError
            If part of the calibration is not told, or the temperature is missing.
        """
        warmth = self._warmth(temperature, len(raw))
        inverse = np.linalg.inv(self._whole())
        offset = self.bias + np.outer(warmth, self.bias_temperature_sensitivity)
        rate = (raw - offset) @ inverse.T
        # d rate = -S^-1 Theta z with z = (rate, 1, T - T0) and Theta the errors of (S, b, d), 3 by 4 or 5
        z = np.column_stack([rate, np.ones(len(raw)), warmth])[:, : len(self.names) // 3]
        variance = [np.einsum("np,pq,nq->n", z, self._blocks(row), z, optimize=True) for row in inverse]
        return rate, np.sqrt(np.maximum(np.stack(variance, axis=1), 0.0))

    def _blocks(self, row: Float) -> Float:
        """Covariance of ``row @ Theta``, shape (p, p)."""
        p = len(self.names) // 3
        places = np.concatenate([np.arange(9).reshape(3, 3), np.arange(9, 3 * p).reshape(-1, 3).T], axis=1)
        L = np.zeros((3 * p, p))
        for gyro, columns in enumerate(places):
            L[columns, np.arange(p)] = row[gyro]
        return np.asarray(L.T @ self.covariance @ L, dtype=np.float64)

    def _whole(self) -> Float:
        """S, where all of the calibration is told."""
        if not self.determined:
            untold = [n for n, e in zip(self.names, self.standard_error, strict=True) if np.isinf(e)]
            raise RateTableError(
                "calibration",
                expected="all of S and b, to correct a record",
                found=f"nothing that tells {', '.join(untold)}",
                remedy="calibrate with rotation about all three axes of the case",
            )
        return self.S

    def _warmth(self, temperature: Float | None, count: int) -> Float:
        return warmth(temperature, self.reference_temperature, count, needed=len(self.names) > 12)


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
    observed: Observations, *, bias_temperature: bool = False, reference_temperature: float | None = None
) -> Triad:
    """Calibrate three gyros.

    Parameters
    ----------
    observed : Observations
        Of one method, or of several joined.
    bias_temperature : bool
        Whether the biases depend on the temperature.
    reference_temperature : float, optional
        T0 [K]; by default the mean of the observations.

    Returns
    -------
    Triad
        What the observations do not tell has infinite standard errors and is named in ``observability``.

    Raises
    ------
    RateTableError
        If the observations are fewer than the unknowns of one gyro, the case never turns, or the temperature
        is missing.
    """
    names = SENSITIVITY + BIAS + (BIAS_TEMPERATURE if bias_temperature else ())
    _enough(observed, names)
    error = np.stack(
        [usable(observed.output[:, i], observed.standard_error[:, i], f"gyro {AXES[i]}") for i in range(3)],
        axis=1,
    )
    observed = replace(observed, standard_error=error)
    T0 = reference(observed.temperature, reference_temperature) if bias_temperature else float("nan")
    warm = warmth(observed.temperature, T0, len(observed), needed=bias_temperature)
    inputs = np.column_stack([observed.rate, np.ones(len(observed)), warm])[:, : len(names) // 3]
    A = _design(inputs)
    k, q = len(names), len(observed.unknowns)
    prior = np.concatenate([np.full(k, np.inf), np.ones(q)]) if q else None
    S = _alone(inputs, observed)
    for _ in range(_ROUNDS if q else 1):
        effect = np.einsum("ij,mjq->miq", S, observed.unknown)
        tau = np.array([_scatter(inputs, effect[:, i], observed, i) for i in range(3)])
        total = np.hypot(observed.standard_error, tau)
        full = np.concatenate([A, effect], axis=2).reshape(-1, k + q)
        y, deviation = observed.output.ravel(), total.ravel()
        solution = weighted(full, y, deviation, (*names, *observed.unknowns), prior)
        S = solution.estimate[:9].reshape(3, 3)
    told = _told(full / deviation[:, np.newaxis], solution, names, observed, float(np.ptp(warm)))
    spent = np.sum((full @ solution.factor) ** 2, axis=1)
    own = np.sqrt(np.maximum(np.diag(solution.covariance)[:k], 0.0))
    return Triad(
        names=names,
        value=solution.estimate[:k],
        covariance=solution.covariance[:k, :k],
        standard_error=np.where(np.isinf(told.standard_errors[:k]), np.inf, own),
        reference_temperature=T0,
        observability=told,
        residual=(solution.residual * deviation).reshape(-1, 3),
        residual_error=np.sqrt(np.maximum(deviation**2 - spent, 0.0)).reshape(-1, 3),
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


def _design(inputs: Float) -> Float:
    """Derivatives of the outputs by S, b, d, shape (m, 3, k), from those of one gyro, shape (m, p)."""
    m, p = inputs.shape
    A = np.zeros((m, 3, 3 * p))
    for i in range(3):
        A[:, i, 3 * i : 3 * i + 3] = inputs[:, :3]
        A[:, i, 9 + i :: 3] = inputs[:, 3:]
    return A


def _alone(inputs: Float, observed: Observations) -> Float:
    """S by each gyro alone, the input taken as known."""
    names = [str(j) for j in range(inputs.shape[1])]
    rows = [
        weighted(inputs, observed.output[:, i], observed.standard_error[:, i], names).estimate[:3]
        for i in range(3)
    ]
    return np.stack(rows)


def _scatter(inputs: Float, effect: Float, observed: Observations, gyro: int) -> float:
    """Scatter of one gyro; the unknowns of the input may explain what they can."""
    p, q = inputs.shape[1], effect.shape[1]
    prior = np.concatenate([np.full(p, np.inf), np.ones(q)]) if q else None
    A = np.concatenate([inputs, effect], axis=1)
    return scatter(A, observed.output[:, gyro], observed.standard_error[:, gyro], prior)


def _told(
    rows: Float, solution: Solution, names: tuple[str, ...], observed: Observations, warmth_range: float
) -> Observability[str]:
    """What the rows tell of S, b, d and the unknowns of the input."""
    k, q = len(names), len(observed.unknowns)
    K = float(np.abs(solution.estimate[:9]).max())
    full_scale = K * float(np.linalg.norm(observed.rate, axis=1).max())
    useful = np.ones(k + q)
    useful[:9], useful[9:12] = USEFUL * K, USEFUL * full_scale
    useful[12:k] = USEFUL * full_scale / (warmth_range or 1.0)
    extent = np.concatenate([np.full(k, np.inf), np.ones(q)])
    return analyse(rows, (*names, *observed.unknowns), useful, extent=extent)
