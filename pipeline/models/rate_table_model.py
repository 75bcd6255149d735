"""The model of one gyro, and the inverse of it that corrects its rates.

The model is that of the IEEE standards for gyro tests (Std 517, 952, 1431; terms of Std 528), for the input
rate w about the input axis, at the temperature T::

    y = K { w + a |w| / 2 + sum_k c_k w_m (w / w_m)^k + e (T - T0) w } + b + d (T - T0)

    b    bias                       the output without input
    K    scale_factor               slope of output over input, mean of both directions
    a    scale_factor_asymmetry     (K+ - K-) / K, slopes of either direction
    c_k  scale_factor_nonlinearity  of order k, at the largest input rate w_m, as part of it
    d    bias_temperature_sensitivity
    e    scale_factor_temperature_sensitivity

It is linear in b, K, K a, K c, d, K e.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.models.rate_table_fit import warmth

Float = NDArray[np.float64]

_NONLINEARITY = "scale_factor_nonlinearity_"
_ITERATIONS = 50
_CONVERGED = 1e-14
"""Of the largest input rate and the rate: steps of the inversion that are rounding."""
_SEEN = 1e-9
"""Of the same: a step that has not settled to it is no rounding."""


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
    def divided(self) -> NDArray[np.bool_]:
        """Which parameters are coefficients of the linear model over the scale factor, shape (k,)."""
        return np.array([name.startswith("scale_factor_") for name in self.names])

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
            Both are NaN where the output is none that the model can have.

        Raises
        ------
        RateTableError
            If the temperature is missing.
        """
        warm = warmth(temperature, self.reference_temperature, len(raw), needed=self.terms.thermal)
        rate, columns, slope = self.inverted(raw, warm)
        variance = np.einsum("ni,ij,nj->n", columns, self.coefficient_covariance, columns)
        return rate, np.sqrt(np.maximum(variance, 0.0)) / np.abs(slope)

    def inverted(self, raw: Float, warm: Float) -> tuple[Float, Float, Float]:
        """The input rate that an output tells, and how the output depends on what the model is made of.

        Parameters
        ----------
        raw : ndarray, shape (n,)
            [out].
        warm : ndarray, shape (n,)
            T - T0 [K].

        Returns
        -------
        rate : ndarray, shape (n,)
            [rad/s]; NaN where the output is none that the model can have.
        columns : ndarray, shape (n, k)
            Derivatives of the output by the linear coefficients.
        slope : ndarray, shape (n,)
            Its derivative by the rate [out s/rad].
        """
        offset = self.terms.columns(np.zeros(len(raw)), self.largest_rate, warm) @ self.coefficients
        rate = (raw - offset) / self.coefficients[1]
        with np.errstate(all="ignore"):  # an output without a root leads anywhere
            for _ in range(_ITERATIONS):
                columns = self.terms.columns(rate, self.largest_rate, warm)
                slope = self.terms.slopes(rate, self.largest_rate, warm) @ self.coefficients
                step = (raw - columns @ self.coefficients) / slope
                rate = rate + step
                if not np.any(np.abs(step) > _CONVERGED * (self.largest_rate + np.abs(rate))):
                    break
            # Where the model turns back on itself a root is not the rate.
            back = slope * self.coefficients[1] <= 0
            settled = np.abs(step) <= _SEEN * (self.largest_rate + np.abs(rate))
        none = back | ~settled  # a lost sample has not settled either
        rate, slope = (np.where(none, np.nan, of) for of in (rate, slope))
        return rate, np.where(none[:, np.newaxis], np.nan, columns), slope


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
    divided, K = terms.divided, value[1]
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
