"""The model of three gyros in a case, and what it makes of a rate.

For the rate w of the case and the temperature T output i is that of one gyro (`rate_table_model`) ::

    y = K { w + a |w| / 2 + sum_k c_k w_m (w / w_m)^k + e (T - T0) w } + b + d (T - T0),   K w = S w_case

w the rate about its input axis, S its row of the 3 by 3 sensitivity: the scale factor K times the unit vector
n of the input axis in the axes of the case. Asymmetry a, nonlinearity c, and the sensitivities d and e are
each gyro's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from pipeline.models.rate_table_fit import warmth
from pipeline.models.rate_table_model import AxisCalibration, Terms, axis_calibration
from pipeline.models.rate_table_observations import AXES
from pipeline.models.rate_table_steps import RateTableError

Float = NDArray[np.float64]

SENSITIVITY = tuple(f"S{i}{j}" for i in AXES for j in AXES)
PAIRS = ((0, 1), (0, 2), (1, 2))

_PART = 2**16
"""Samples that are corrected at a time: their derivatives by all parameters stay small."""


def triad_names(terms: Terms, axes: Sequence[int | str] = AXES) -> tuple[str, ...]:
    """Parameters of a triad: S11 to S33, then each of one gyro for all three: bias_1 to bias_3, and so on.

    Parameters
    ----------
    terms : Terms
        Of each gyro.
    axes : sequence of three
        What ends the names.
    """
    own = [name for name in terms.names if name != "scale_factor"]
    return (*SENSITIVITY, *(f"{name}_{axis}" for name in own for axis in axes))


def triad_terms(names: Sequence[str], axes: Sequence[int | str] = AXES) -> Terms | None:
    """The terms of a triad that has these parameters, in this order; None where there are none such."""
    end = f"_{axes[0]}"
    bias, *own = [name.removesuffix(end) for name in names[9:] if name.endswith(end)] or [""]
    terms = Terms.of_names((bias, "scale_factor", *own))
    return terms if terms is not None and triad_names(terms, axes) == tuple(names) else None


@dataclass(frozen=True, slots=True)
class Decomposition:
    """S in terms of the gyros.

    Attributes
    ----------
    names : tuple of str
        ``scale_factor_i``: K_i. ``misalignment_ij``: component of n_i along axis j of the case, the small
        angle towards it [rad]. ``nonorthogonality_ij``: 90 degrees less the angle between input axes i and j
        [rad].
        ``triad_rotation_i``: rotation of the triad as a whole from the axes of the case, about axis i [rad],
        the antisymmetric part of the misalignments.
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
    terms : Terms
        Of each gyro.
    names : tuple of str
        Of the k parameters, as of `triad_names`.
    value : ndarray, shape (k,)
        S [out s/rad], bias [out], asymmetry and nonlinearity [1], bias temperature sensitivity [out/K], scale
        factor temperature sensitivity [1/K].
    covariance : ndarray, shape (k, k)
        Of what is told.
    standard_error : ndarray, shape (k,)
        Infinite where the observations tell nothing.
    reference_temperature : float
        T0 [K]; NaN without terms of temperature.
    largest_rate : float
        w_m [rad/s].
    """

    terms: Terms
    names: tuple[str, ...]
    value: Float
    covariance: Float
    standard_error: Float
    reference_temperature: float
    largest_rate: float

    @property
    def S(self) -> Float:  # noqa: N802 - the symbol of the model
        """Sensitivity, shape (3, 3) [out s/rad]."""
        return self.value[:9].reshape(3, 3)

    @property
    def bias(self) -> Float:
        """Output without input at the reference temperature, shape (3,) [out]."""
        return self.of("bias")

    def of(self, name: str) -> Float:
        """A parameter of the three gyros by its name without the axis, shape (3,)."""
        first = self.names.index(f"{name}_{AXES[0]}")
        return self.value[first : first + 3]

    @property
    def scale_factors(self) -> Float:
        """K, negative where a gyro turns against its axis of the case, shape (3,) [out s/rad]."""
        return np.asarray(np.linalg.norm(self.S, axis=1) * np.sign(np.diag(self.S)), dtype=np.float64)

    @property
    def gyros(self) -> Iterator[AxisCalibration]:
        """Each gyro against the rate about its input axis; without the errors, which the triad has."""
        none = np.zeros((len(self.terms.names),) * 2)
        for i, K in enumerate(self.scale_factors):
            own = [K if name == "scale_factor" else self.of(name)[i] for name in self.terms.names]
            yield axis_calibration(
                self.terms,
                np.array(own),
                none,
                reference_temperature=self.reference_temperature,
                largest_rate=self.largest_rate,
            )

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
        S, K = self.S, self.scale_factors
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
            *(f"triad_rotation_{i}" for i in AXES),
        )
        derivatives = np.concatenate(J)
        covariance = derivatives @ self.covariance[:9, :9] @ derivatives.T
        untold = np.any(derivatives[:, np.isinf(self.standard_error[:9])] != 0, axis=1)
        error = np.where(untold, np.inf, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
        return Decomposition(names, np.concatenate(value), error, covariance)

    def apply(self, raw: Float, temperature: Float | None = None) -> tuple[Float, Float]:
        """The rate of the case that outputs tell: that about each input axis by itself, and from these it.

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
            same error throughout a record, not a new one in each sample. All are NaN in a sample of which
            one output is none that the model can have.

        Raises
        ------
        RateTableError
            If part of the calibration is not told, or the temperature is missing.
        """
        warm = warmth(temperature, self.reference_temperature, len(raw), needed=self.terms.thermal)
        inverse = np.asarray(np.linalg.inv(self._whole()), dtype=np.float64)
        rate, error = np.empty(raw.shape), np.empty(raw.shape)
        for first in range(0, len(raw), _PART):
            part = slice(first, first + _PART)
            rate[part], error[part] = self._corrected(raw[part], warm[part], inverse)
        return rate, error

    def _corrected(self, raw: Float, warm: Float, inverse: Float) -> tuple[Float, Float]:
        """As of `apply`, a part of the record.

        By a change dp of the parameters of gyro i, ``dy = (dy/dp) dp`` with ``dy/dS_i = (y' / K) w_case`` for
        ``y' = dy/dw``, the rate of the case changes by ``-S^-1_i (K / y') dy``, S^-1_i a column.
        """
        K, divided = self.scale_factors, self.terms.divided
        solved = [gyro.inverted(of, warm) for gyro, of in zip(self.gyros, raw.T, strict=True)]
        rate = np.stack([K[i] * w for i, (w, _, _) in enumerate(solved)], axis=1) @ inverse.T
        own = []
        for k, (_, columns, slope) in zip(K, solved, strict=True):
            by = np.where(divided, k, 1.0) * columns * (k / slope)[:, np.newaxis]
            own.append(np.concatenate([rate, np.delete(by, 1, axis=1)], axis=1))
        places = np.arange(9, len(self.names)).reshape(-1, 3)
        error = np.empty(rate.shape)
        for axis, row in enumerate(inverse):
            z = np.empty((len(raw), len(self.names)))
            for i, part in enumerate(own):
                z[:, [*range(3 * i, 3 * i + 3), *places[:, i]]] = row[i] * part
            error[:, axis] = np.sqrt(np.maximum(np.sum((z @ self.covariance) * z, axis=1), 0.0))
        return rate, error

    def _whole(self) -> Float:
        """S, where all of the calibration is told."""
        if not self.determined:
            untold = [n for n, e in zip(self.names, self.standard_error, strict=True) if np.isinf(e)]
            raise RateTableError(
                "calibration",
                expected="all of S and b, to correct a record",
                found=f"nothing that tells {', '.join(untold)}",
                remedy="calibrate with rotation about all three axes of the case, or with fewer terms",
            )
        return self.S
