"""One gyro against a rate table: scale factor, bias and what they depend on.

The model is that of `rate_table_model`; its linear coefficients are solved for. The input rate is the table's
and the Earth's, in the direction of the input axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.models.rate_table_fit import reference, scatter, usable, warmth, weighted
from pipeline.models.rate_table_model import AxisCalibration, Terms
from pipeline.models.rate_table_steps import RateTableError, Steps, TableAxis
from pipeline.numerics.observability import analyse

Float = NDArray[np.float64]

_OPEN = 1e3
"""Useful standard deviation of a parameter, in its own scale: any that is estimated at all is better."""


@dataclass(frozen=True, slots=True)
class SingleAxis(AxisCalibration):
    """A calibration of one gyro by the steps of a rate table.

    Attributes
    ----------
    input_rate : ndarray, shape (m,)
        Of each step, the Earth's rate included [rad/s].
    residual, residual_error : ndarray, shape (m,)
        Output of each step less the model, and the standard deviation it should have [out].
    deviation : ndarray, shape (m,)
        Output of each step less the straight line of least squares through all [out].
    scatter : float
        Standard deviation between steps beyond their own noise [out].
    """

    input_rate: Float
    residual: Float
    residual_error: Float
    deviation: Float
    scatter: float

    @property
    def residual_ppm(self) -> Float:
        """Residual of each step in parts per million of full scale."""
        return 1e6 * self.residual / self.full_scale

    @property
    def linearity_error_ppm(self) -> float:
        """Largest deviation from the straight line, in parts per million of full scale."""
        return float(1e6 * np.abs(self.deviation).max() / self.full_scale)


def fit_single_axis(
    steps: Steps,
    channel: int,
    terms: Terms,
    *,
    input_axis: Float,
    axis: TableAxis | None,
    reference_temperature: float | None = None,
) -> SingleAxis:
    """Calibrate one channel from the steps of a rate table.

    Parameters
    ----------
    steps : Steps
    channel : int
        Which of the gyro's.
    terms : Terms
        Beside bias and scale factor.
    input_axis : ndarray, shape (3,)
        Unit vector in the rotor's axes, of which 3 is the axis of rotation.
    axis : TableAxis or None
        To take out the Earth's rate; None leaves it in the bias. A step whose angle has no known zero has
        only the axial part taken out.
    reference_temperature : float, optional
        T0 [K]; by default the mean of the steps.

    Raises
    ------
    RateTableError
        If the steps are fewer than the unknowns or do not tell them apart, or the temperature is missing.
    """
    names = terms.names
    _enough(steps, names)
    rate = np.outer(steps.rate, [0.0, 0.0, 1.0])
    if axis is not None:
        rate += axis.on_rotor(np.nan_to_num(steps.turn))
    w = rate @ input_axis
    largest = float(np.abs(w).max())
    T0 = reference(steps.temperature, reference_temperature) if terms.thermal else float("nan")
    warm = warmth(steps.temperature, T0, len(w), needed=terms.thermal)
    A = terms.columns(w, largest, warm) if largest > 0 else np.tile(np.eye(1, len(names)), (len(w), 1))
    y = steps.gyro[:, channel]
    error = usable(y, steps.standard_error[:, channel], f"gyro, channel {channel + 1}")
    told_apart(A, names, "rate table")
    tau = scatter(A, y, error)
    total = np.hypot(error, tau)
    solution = weighted(A, y, total, names)
    beta, C = solution.estimate, solution.covariance
    value, J = _parameters(terms, beta)
    spent = np.einsum("ni,ij,nj->n", A, C, A)
    line = weighted(A[:, :2], y, total, names[:2])
    return SingleAxis(
        terms=terms,
        names=names,
        value=value,
        covariance=J @ C @ J.T,
        coefficients=beta,
        coefficient_covariance=C,
        reference_temperature=T0,
        largest_rate=largest,
        input_rate=w,
        residual=y - A @ beta,
        residual_error=np.sqrt(np.maximum(total**2 - spent, 0.0)),
        deviation=line.residual * total,
        scatter=tau,
    )


def _parameters(terms: Terms, beta: Float) -> tuple[Float, Float]:
    """The parameters from the linear coefficients, and their derivatives by these, shape (k, k)."""
    divided, K = terms.divided, beta[1]
    value = np.where(divided, beta / K, beta)
    J = np.diag(np.where(divided, 1 / K, 1.0))
    J[divided, 1] -= value[divided] / K
    return value, J


def _enough(steps: Steps, names: tuple[str, ...]) -> None:
    if len(steps) < len(names):
        raise RateTableError(
            "rate table",
            expected=f"at least {len(names)} steps for {', '.join(names)}",
            found=f"{len(steps)}",
            remedy="record more rates, accept shorter steps, or ask for fewer terms",
        )


def told_apart(A: Float, names: Sequence[str], where: str) -> None:
    """Refuse columns that the steps cannot tell apart, by their names.

    Parameters
    ----------
    A : ndarray, shape (n, k)
        Derivatives of the outputs, one row a step.
    names : sequence of str
        Of the columns.
    where : str
        For the error.

    Raises
    ------
    RateTableError
    """
    size = np.linalg.norm(A, axis=0)
    empty = [n for n, s in zip(names, size, strict=True) if s == 0]
    if empty:
        raise RateTableError(
            where,
            expected=f"steps that tell {', '.join(empty)}",
            found="none: that input never changes",
            remedy="record steps in which it does, or leave the term out",
        )
    told = analyse(A / size, names, np.full(len(names), _OPEN))
    if "null" in told.direction_states:
        null = told.directions[told.direction_states.index("null")]
        mixed = [n for n, v in zip(names, null, strict=True) if abs(v) > 1e-6]
        raise RateTableError(
            where,
            expected=f"steps that tell {' from '.join(mixed)}",
            found="none: the steps only tell a sum of them",
            remedy="record steps at other rates (both directions, another temperature), or leave terms out",
        )
