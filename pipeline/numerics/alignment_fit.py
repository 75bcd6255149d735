"""Clock offset and mounting rotation between gyro and reference: the estimate, with its covariance.

The model is that of `pipeline.numerics.alignment`::

    x_k = C y_k(tau) + b Dt_k + e_k

Plain least squares is biased here: both sides are noisy, and the noise in y(tau) that interpolation leaves
depends on tau, so that half-sample offsets look better than they are. Hence instrumental variables
(Söderström & Stoica, *Instrumental Variable Methods for System Identification*, 1983): the equations
``sum Z_k^T e_k = 0`` with Z made from x alone (its derivative for tau, e_a × x for a small rotation) have no
such bias, since the noise of the gyro is independent of that of the reference, and the product of a noise
with its own derivative has mean zero.

The residuals are whitened: e_k is the gyro's white noise over the interval plus the reference's white angle
noise differenced, together a moving average of one step, whose correlation is that of greatest likelihood.
They are taken to the reference axes before, since in turning axes differences do not telescope.
The covariance is ``H^-1 V H^-T`` with ``H = sum Z^T A``, A the derivatives of the model, and V the sum of
s² Z^T A over the axes. (Z^T Z in its place would count the product of the reference's noise with its own
derivative, which has no variance to speak of, since its sum telescopes.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky_banded, solve_banded
from scipy.optimize import minimize_scalar

from pipeline.numerics.alignment import Cumulative, Float, Increments
from pipeline.numerics.rotation import (
    matrix_from_quaternion,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotation_vector_from_quaternion,
)

_ITERATIONS = 50
_CONVERGED = 1e-3
"""Steps smaller than this part of the standard errors do not matter."""

_STEEPEST = 10.0
"""Bound of u, with tanh(u) twice the correlation: 1 - tanh(10) = 4e-9 is as near to a pure difference as a
record of 10,000 intervals can tell."""


@dataclass(frozen=True, slots=True)
class Fit:
    """Offset and rotation with their covariance; what was held fixed has none (zero rows and columns).

    Attributes
    ----------
    offset : float
        tau [s].
    quaternion : ndarray, shape (4,)
        Of C.
    covariance : ndarray, shape (4, 4)
        Of tau [s] and of a small rotation vector in body axes that turns C further [rad].
    """

    offset: float
    quaternion: Float
    covariance: Float

    @property
    def matrix(self) -> Float:
        """C: from case axes to body axes, shape (3, 3)."""
        return matrix_from_quaternion(self.quaternion)

    @property
    def rotation_vector(self) -> Float:
        """The rotation vector of C [rad], shape (3,); called rho below."""
        return rotation_vector_from_quaternion(self.quaternion)

    @property
    def rotation_vector_errors(self) -> Float:
        """Standard errors of rho [rad], shape (3,).

        A small turn d of C changes rho by J d with the inverse left Jacobian of SO(3) ::

            J = 1 - [rho]×/2 + (1/|rho|² - (1 + cos|rho|)/(2 |rho| sin|rho|)) [rho]×²
        """
        rho = self.rotation_vector
        cross = np.cross(np.eye(3), rho)
        half = float(np.linalg.norm(rho)) / 2
        # (1 + cos 2h)/(2 sin 2h) is cot(h)/2; the bracket tends to 1/12.
        bracket = (1 - half / np.tan(half)) / (4 * half * half) if half > 1e-4 else 1 / 12
        jacobian = np.eye(3) - cross / 2 + bracket * cross @ cross
        errors: Float = np.sqrt(np.diag(jacobian @ self.covariance[1:, 1:] @ jacobian.T))
        return errors


def fit(
    reference: Increments,
    gyro: Cumulative,
    offset: float,
    quaternion: Float,
    *,
    free_offset: bool,
    free_rotation: bool,
) -> Fit:
    """Estimate offset and rotation from a first guess, as the module's docstring says.

    Parameters
    ----------
    reference, gyro
        Intervals that the gyro covers (see `covered`), and the gyro's cumulative angle.
    offset, quaternion
        First guess: tau [s] and the quaternion of C. What is not free keeps it.

    Raises
    ------
    ValueError
        If the equations are singular or do not converge: the motion does not determine what is free.
    """
    free = np.array([free_offset, *[free_rotation] * 3, True, True, True])
    instrument = _to_reference_axes(_instruments(reference), reference)
    bias, correlation_1 = np.zeros(3), 0.0
    for _ in range(_ITERATIONS):
        residual, slope = _model(reference, gyro, offset, matrix_from_quaternion(quaternion), bias)
        residual, slope = _to_reference_axes(residual, reference), _to_reference_axes(slope, reference)
        factor = _correlation_factor(correlation_1, reference)
        e, z, a = (_whitened(factor, v) for v in (residual, instrument[:, :, free], slope[:, :, free]))
        step, covariance = _solve(e, z, a)
        full = np.zeros(7)
        full[free] = step
        offset += float(full[0])
        quaternion = quaternion_multiply(quaternion_from_rotation_vector(full[1:4]), quaternion)
        bias = bias + full[4:]
        previous, correlation_1 = correlation_1, _neighbour_correlation(residual, reference)
        small = np.all(np.abs(step) <= _CONVERGED * np.sqrt(np.diag(covariance)))
        if small and abs(correlation_1 - previous) < 1e-2 * (0.5 - abs(correlation_1)):
            whole = np.zeros((7, 7))
            whole[np.ix_(free, free)] = covariance
            return Fit(offset, quaternion, whole[:4, :4])
    raise ValueError("the estimate does not converge")


def _model(
    reference: Increments, gyro: Cumulative, offset: float, rotation: Float, bias: Float
) -> tuple[Float, Float]:
    """Residuals (n, 3) and derivatives of the model (n, 3, 7) by tau, small rotation and bias."""
    start, stop, length = reference.start + offset, reference.stop + offset, reference.length[:, None]
    turned = gyro.over(start, stop) @ rotation.T
    slope = np.empty((len(turned), 3, 7))
    slope[:, :, 0] = gyro.rate_change(start, stop) @ rotation.T
    slope[:, :, 1:4] = _crossed_axes(turned)
    slope[:, :, 4:] = length[:, :, None] * np.eye(3)
    return reference.angle - turned - length * bias, slope


def _instruments(reference: Increments) -> Float:
    """The derivatives as the reference alone gives them, shape (n, 3, 7)."""
    instrument = np.empty((len(reference.angle), 3, 7))
    instrument[:, :, 0] = np.gradient(reference.angle, axis=0) / reference.length[:, None]
    instrument[:, :, 1:4] = _crossed_axes(reference.angle)
    instrument[:, :, 4:] = reference.length[:, None, None] * np.eye(3)
    return instrument


def _to_reference_axes(values: Float, reference: Increments) -> Float:
    """Values (n, 3) or (n, 3, columns) in body axes, in the reference axes."""
    turned: Float = np.einsum("kij,kj...->ki...", reference.axes, values)
    return turned


def _crossed_axes(vector: Float) -> Float:
    """e_a × v in column a, shape (n, 3, 3)."""
    return np.stack([np.cross(axis, vector) for axis in np.eye(3)], axis=2)


def _solve(e: Float, z: Float, a: Float) -> tuple[Float, Float]:
    """The step H^-1 sum Z^T e, and the covariance, of columns scaled to unit size."""
    size = np.sqrt(np.sum(z * z, axis=(0, 1)))
    if not np.all(size > 0):
        raise ValueError("the reference does not move")
    z, a = z / size, a / size
    h = np.einsum("kai,kaj->ij", z, a)
    if not np.linalg.cond(h) < 1e8:
        raise ValueError("the motion leaves a combination free")
    variance = np.sum(e * e, axis=0) / max(len(e) - z.shape[2] / 3, 1)
    inner = np.einsum("a,kai,kaj->ij", variance, z, a)
    inner = (inner + inner.T) / 2
    if not np.linalg.eigvalsh(inner)[0] > 0:
        raise ValueError("the noise leaves a combination free")
    inverse = np.linalg.inv(h)
    step = inverse @ np.einsum("kai,ka->i", z, e)
    return step / size, inverse @ inner @ inverse.T / np.outer(size, size)


def _neighbour_correlation(residual: Float, reference: Increments) -> float:
    """Correlation c of neighbouring residuals, in (-0.5, 0.5), of the greatest likelihood.

    The scale s² is profiled out of the normal likelihood; the three axes share c. Whittle's approximation
    would not do: a differenced noise has no power at frequency 0, and the ends of the record leak some there.
    """
    if not residual.any():
        return 0.0

    def cost(u: float) -> float:
        factor = _correlation_factor(math.tanh(u) / 2, reference)
        white = _whitened(factor, residual)
        return float(np.log(np.mean(white * white)) + 2 * np.mean(np.log(factor[0])))

    found = minimize_scalar(cost, bounds=(-_STEEPEST, _STEEPEST), method="bounded", options={"xatol": 1e-3})
    return math.tanh(float(found.x)) / 2


def _correlation_factor(c: float, reference: Increments) -> Float:
    """L of the residuals' correlation L L^T, banded: 1, and c between adjoining intervals."""
    bands = np.ones((2, len(reference.start)))
    bands[1, :-1] = np.where(reference.start[1:] <= reference.stop[:-1], c, 0.0)
    return np.asarray(cholesky_banded(bands, lower=True), dtype=np.float64)


def _whitened(factor: Float, values: Float) -> Float:
    """L^-1 times the values, along their first axis."""
    white = solve_banded((1, 0), factor, values.reshape(len(values), -1))
    return np.asarray(white, dtype=np.float64).reshape(values.shape)
