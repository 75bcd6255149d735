"""One gyro against a rate table: scale factor, bias and what they depend on.

The model is that of the IEEE standards for gyro tests (Std 517, 952, 1431; terms of Std 528), for the input
rate w about the input axis, at the temperature T::

    y = K { w + a |w| / 2 + sum_k c_k w_m (w / w_m)^k + e (T - T0) w } + b + d (T - T0)

    b    bias                       the output without input
    K    scale_factor               slope of output over input, mean of both directions
    a    scale_factor_asymmetry     (K+ - K-) / K, slopes of either direction
    c_k  scale_factor_nonlinearity  of order k, at the largest input rate w_m, as part of it
    d    bias_temperature_sensitivity
    e    scale_factor_temperature_sensitivity

It is linear in b, K, K a, K c, d, K e, which are solved for. The input rate is the table's and the Earth's,
in the direction of the input axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.models.rate_table_fit import reference, scatter, usable, warmth, weighted
from pipeline.models.rate_table_steps import RateTableError, Steps, TableAxis
from pipeline.numerics.observability import analyse

Float = NDArray[np.float64]

_NONLINEARITY = "scale_factor_nonlinearity_"
_ITERATIONS = 50
_CONVERGED = 1e-14
"""Of the largest input rate: steps of the inversion that are rounding."""
_SEEN = 1e-9
"""Of the largest input rate: a step that has not settled to it is no rounding."""
_OPEN = 1e3
"""Useful standard deviation of a parameter, in its own scale: any that is estimated at all is better."""


@dataclass(frozen=True, slots=True)
class Terms:
    """Which terms the model has beside bias and scale factor.

    Attributes
    ----------
    asymmetry : bool
    nonlinearity : tuple of int
        Orders k, 2 or more.
    bias_temperature, scale_factor_temperature : bool
    """

    asymmetry: bool = False
    nonlinearity: tuple[int, ...] = ()
    bias_temperature: bool = False
    scale_factor_temperature: bool = False

    @classmethod
    def of_names(cls, names: Sequence[str]) -> Terms | None:
        """The terms that have these parameters, in this order; None where there are none such."""
        orders = [name.removeprefix(_NONLINEARITY) for name in names if name.startswith(_NONLINEARITY)]
        terms = cls(
            asymmetry="scale_factor_asymmetry" in names,
            nonlinearity=tuple(int(k) for k in orders if k.isdecimal() and int(k) > 1),
            bias_temperature="bias_temperature_sensitivity" in names,
            scale_factor_temperature="scale_factor_temperature_sensitivity" in names,
        )
        return terms if terms.names == tuple(names) else None

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters in order; bias and scale factor first."""
        return (
            "bias",
            "scale_factor",
            *(["scale_factor_asymmetry"] if self.asymmetry else []),
            *(f"{_NONLINEARITY}{k}" for k in self.nonlinearity),
            *(["bias_temperature_sensitivity"] if self.bias_temperature else []),
            *(["scale_factor_temperature_sensitivity"] if self.scale_factor_temperature else []),
        )

    @property
    def thermal(self) -> bool:
        """Whether a temperature is needed."""
        return self.bias_temperature or self.scale_factor_temperature

    def columns(self, rate: Float, largest: float, warmth: Float) -> Float:
        """Derivatives of the output by the linear coefficients, shape (n, k).

        Parameters
        ----------
        rate : ndarray, shape (n,)
            Input rate [rad/s].
        largest : float
            w_m [rad/s].
        warmth : ndarray, shape (n,)
            T - T0 [K].
        """
        powers = [largest * (rate / largest) ** k for k in self.nonlinearity]
        columns = [
            np.ones_like(rate),
            rate,
            *([np.abs(rate) / 2] if self.asymmetry else []),
            *powers,
            *([warmth] if self.bias_temperature else []),
            *([warmth * rate] if self.scale_factor_temperature else []),
        ]
        return np.stack(columns, axis=1)

    def slopes(self, rate: Float, largest: float, warmth: Float) -> Float:
        """Derivatives of `columns` by the input rate, shape (n, k)."""
        powers = [k * (rate / largest) ** (k - 1) for k in self.nonlinearity]
        columns = [
            np.zeros_like(rate),
            np.ones_like(rate),
            *([np.sign(rate) / 2] if self.asymmetry else []),
            *powers,
            *([np.zeros_like(rate)] if self.bias_temperature else []),
            *([warmth] if self.scale_factor_temperature else []),
        ]
        return np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True)
class AxisCalibration:
    """What corrects one gyro. The output is in units of its own, written [out] here.

    Attributes
    ----------
    terms : Terms
    names : tuple of str
        Of the k parameters.
    value : ndarray, shape (k,)
        bias [out], scale_factor [out s/rad], asymmetry and nonlinearity [1], bias temperature sensitivity
        [out/K], scale factor temperature sensitivity [1/K].
    covariance : ndarray, shape (k, k)
    coefficients, coefficient_covariance : ndarray, shape (k,) and (k, k)
        Of the linear model: the terms of the braces not divided by the scale factor.
    reference_temperature : float
        T0 [K]; NaN where no term needs it.
    largest_rate : float
        w_m [rad/s].
    """

    terms: Terms
    names: tuple[str, ...]
    value: Float
    covariance: Float
    coefficients: Float
    coefficient_covariance: Float
    reference_temperature: float
    largest_rate: float

    @property
    def standard_errors(self) -> Float:
        """Of each parameter, shape (k,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def full_scale(self) -> float:
        """Output that the largest input rate makes by the scale factor alone [out]."""
        return abs(float(self.coefficients[1])) * self.largest_rate

    def apply(self, raw: Float, temperature: Float | None = None) -> tuple[Float, Float]:
        """The input rate that an output tells.

        Parameters
        ----------
        raw : ndarray, shape (n,)
            [out].
        temperature : ndarray, shape (n,), optional
            [K]; must be there if the calibration has a term of temperature.

        Returns
        -------
        rate : ndarray, shape (n,)
            Input rate [rad/s].
        standard_error : ndarray, shape (n,)
            That the uncertainty of the calibration gives it; the gyro's own noise is not in it.

        Raises
        ------
        RateTableError
            If the temperature is missing, or the output is none that the model can have.
        """
        warm = warmth(temperature, self.reference_temperature, len(raw), needed=self.terms.thermal)
        offset = self.terms.columns(np.zeros(len(raw)), self.largest_rate, warm) @ self.coefficients
        rate = (raw - offset) / self.coefficients[1]
        for _ in range(_ITERATIONS):
            columns = self.terms.columns(rate, self.largest_rate, warm)
            slope = self.terms.slopes(rate, self.largest_rate, warm) @ self.coefficients
            step = (raw - columns @ self.coefficients) / slope
            rate = rate + step
            if not np.any(np.abs(step) > _CONVERGED * (self.largest_rate + np.abs(rate))):
                break
        # Where the model turns back on itself a root is not the rate. A lost sample has neither.
        if not np.any((slope * self.coefficients[1] <= 0) | (np.abs(step) > _SEEN * self.largest_rate)):
            variance = np.einsum("ni,ij,nj->n", columns, self.coefficient_covariance, columns)
            return rate, np.sqrt(np.maximum(variance, 0.0)) / np.abs(slope)
        raise RateTableError(
            "gyro",
            expected=f"outputs within the calibrated range of {self.largest_rate:.6g} rad/s",
            found=f"{float(np.nanmax(np.abs(raw))):.6g}, where the non-linear terms cannot be inverted",
            remedy="calibrate over the range that is used, or with fewer terms",
        )


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


def axis_calibration(
    terms: Terms, value: Float, covariance: Float, *, reference_temperature: float, largest_rate: float
) -> AxisCalibration:
    """What corrects one gyro, from its parameters as they were published.

    Parameters
    ----------
    terms : Terms
    value, covariance : ndarray, shape (k,) and (k, k)
        Of the parameters, in the order of ``terms.names``.
    reference_temperature : float
        T0 [K]; NaN where no term needs it.
    largest_rate : float
        w_m [rad/s].
    """
    divided, K = _divided(terms), value[1]
    J = np.diag(np.where(divided, K, 1.0))
    J[divided, 1] += value[divided]
    return AxisCalibration(
        terms=terms,
        names=terms.names,
        value=value,
        covariance=covariance,
        coefficients=np.where(divided, K * value, value),
        coefficient_covariance=J @ covariance @ J.T,
        reference_temperature=reference_temperature,
        largest_rate=largest_rate,
    )


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
    _told_apart(A, names)
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
    divided, K = _divided(terms), beta[1]
    value = np.where(divided, beta / K, beta)
    J = np.diag(np.where(divided, 1 / K, 1.0))
    J[divided, 1] -= value[divided] / K
    return value, J


def _divided(terms: Terms) -> NDArray[np.bool_]:
    """Which parameters are coefficients divided by the scale factor, shape (k,)."""
    return np.array([name.startswith("scale_factor_") for name in terms.names])


def _enough(steps: Steps, names: tuple[str, ...]) -> None:
    if len(steps) < len(names):
        raise RateTableError(
            "rate table",
            expected=f"at least {len(names)} steps for {', '.join(names)}",
            found=f"{len(steps)}",
            remedy="record more rates, accept shorter steps, or ask for fewer terms",
        )


def _told_apart(A: Float, names: tuple[str, ...]) -> None:
    """Refuse columns that the steps cannot tell apart, by their names."""
    size = np.linalg.norm(A, axis=0)
    empty = [n for n, s in zip(names, size, strict=True) if s == 0]
    if empty:
        raise RateTableError(
            "rate table",
            expected=f"steps that tell {', '.join(empty)}",
            found="none: that input never changes",
            remedy="record steps in which it does, or leave the term out",
        )
    told = analyse(A / size, names, np.full(len(names), _OPEN))
    if "null" in told.direction_states:
        null = told.directions[told.direction_states.index("null")]
        mixed = [n for n, v in zip(names, null, strict=True) if abs(v) > 1e-6]
        raise RateTableError(
            "rate table",
            expected=f"steps that tell {' from '.join(mixed)}",
            found="none: the steps only tell a sum of them",
            remedy="record steps at other rates (both directions, another temperature), or leave terms out",
        )
