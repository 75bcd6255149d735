"""The spiral that a gyro's axis describes about the Earth's pole.

Gubarenko & Kuzmenko, Mechanics of Solids (1995), (4.1) to (4.4), corrected. Scheme I: the base's third axis
points to the pole, and the gimbal angles, while they are small, are where the rotor's axis is beside it::

    alpha' = A alpha + b,   alpha(tau) = alpha_c + e^{-lambda tau} (P cos nu tau + Q sin nu tau)       (4.1)
    z = alpha1 + i alpha2 = z_c + r e^{-i psi} e^{-(lambda + i nu) tau}                                (4.4)

The first is an ellipse that shrinks, the second the circle that is left of it without its counter-rotating
part of O(m r). Both are fitted by variable projection: for given lambda and nu the rest is linear, and only
those two are sought (Golub & Pereyra, 1973, with Kaufman's Jacobian).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares

from pipeline.errors import ExitCode, GyrostandError
from pipeline.models.drift_problem import Arc

Float = NDArray[np.float64]
Columns = NDArray[Any]  # real, or complex
Basis = Callable[[Float, Float], tuple[Columns, tuple[Columns, Columns]]]
"""Of (lambda, nu) and tau: columns, shape (n, p), and their derivatives by lambda and by nu."""

SPIRAL = ("alpha_c1", "alpha_c2", "r", "lambda", "nu", "psi")
"""The figures of (4.4), in order."""

_GUESS = (0.0, 1.0)
"""lambda and nu of a gyro without drift."""
_FEWEST = 5
"""Samples of two angles each: more than the eight coefficients of the ellipse."""
_SIGNIFICANT = 10.0
"""Standard errors that the amplitude has at least: with fewer, noise has spirals too."""
_CONVERGED = 1e-14
"""Relative step and decrease at which the search ends, and amplitude that is none: rounding."""


class SpiralError(GyrostandError):
    """An arc is no spiral about the pole, or does not tell what is asked."""

    exit_code = ExitCode.NOT_MET


@dataclass(frozen=True, slots=True)
class Spiral:
    """The spiral (4.4) of an arc.

    Attributes
    ----------
    alpha_c1, alpha_c2 : float
        Its centre [rad].
    r, psi : float
        Amplitude [rad] and phase [rad] where tau is 0.
    lambda_, nu : float
        Decay and frequency in units of the Earth rate.
    covariance : ndarray, shape (6, 6)
        In the order of `SPIRAL`.
    sigma : float
        Standard deviation of one angle from the residuals [rad].
    predicted : ndarray, shape (n, 2)
        Its angles at all samples of the arc [rad].
    """

    alpha_c1: float
    alpha_c2: float
    r: float
    lambda_: float
    nu: float
    psi: float
    covariance: Float
    sigma: float
    predicted: Float

    @property
    def value(self) -> Float:
        """The figures in the order of `SPIRAL`, shape (6,)."""
        return np.array([self.alpha_c1, self.alpha_c2, self.r, self.lambda_, self.nu, self.psi])


@dataclass(frozen=True, slots=True)
class Ellipse:
    """The linear form ``alpha' = A alpha + b`` of an arc.

    Attributes
    ----------
    A : ndarray, shape (2, 2)
        In units of the Earth rate.
    b : ndarray, shape (2,)
        In units of the Earth rate [rad].
    covariance : ndarray, shape (6, 6)
        Of (A11, A12, A21, A22, b1, b2).
    sigma : float
        Standard deviation of one angle from the residuals [rad].
    predicted : ndarray, shape (n, 2)
        Its angles at all samples of the arc [rad].
    """

    A: Float
    b: Float
    covariance: Float
    sigma: float
    predicted: Float


def fit_spiral(arc: Arc, *, guess: tuple[float, float] = _GUESS) -> Spiral:
    """Fit the spiral (4.4) to the measured angles of an arc.

    Parameters
    ----------
    arc : Arc
        Of the polar scheme, angles small; what is not measured is no observation.
    guess : tuple of float
        lambda and nu to start from.

    Raises
    ------
    SpiralError
        If there are too few samples, or no spiral is in them.
    """
    z = (arc.alpha[:, 0] + 1j * arc.alpha[:, 1])[:, np.newaxis]
    x, coefficients = _variable_projection(_circle, arc, z, guess)
    centre, amplitude = coefficients[:, 0]
    tau, r, psi = arc.tau, abs(amplitude), -float(np.angle(amplitude))
    unit = np.exp(-1j * psi - (x[0] + 1j * x[1]) * tau)
    one, turning = np.ones_like(unit), r * unit
    # d z / d (alpha_c1, alpha_c2, r, lambda, nu, psi)
    J = np.stack([one, 1j * one, unit, -tau * turning, -1j * tau * turning, -1j * turning], axis=1)
    fitted = np.stack([z[:, 0], centre + turning], axis=1)
    alpha, predicted = np.stack([fitted.real, fitted.imag], axis=1).transpose(2, 0, 1)
    covariance, sigma = _uncertainty(np.stack([J.real, J.imag], axis=1), alpha - predicted, arc)
    amplitude_error = float(np.sqrt(covariance[2, 2]))
    _refuse_unless(r > _SIGNIFICANT * amplitude_error, "a spiral that stands out of the noise", arc)
    return Spiral(
        alpha_c1=float(centre.real),
        alpha_c2=float(centre.imag),
        r=float(r),
        lambda_=float(x[0]),
        nu=float(x[1]),
        psi=psi,
        covariance=covariance,
        sigma=sigma,
        predicted=predicted,
    )


def fit_ellipse(arc: Arc, *, guess: tuple[float, float] = _GUESS) -> Ellipse:
    """Fit ``alpha' = A alpha + b`` to the measured angles of an arc, by its solution (4.1).

    ::

        W = (P, Q),   A = W K W^-1,   K = ((-lambda, -nu), (nu, -lambda)),   b = -A alpha_c

    Parameters
    ----------
    arc : Arc
        Of the polar scheme, angles small; what is not measured is no observation.
    guess : tuple of float
        lambda and nu to start from.

    Raises
    ------
    SpiralError
        If there are too few samples, or no ellipse is in them.
    """
    x, coefficients = _variable_projection(_oscillation, arc, arc.alpha, guess)
    basis, by_x = _oscillation(x, arc.tau)
    predicted = basis @ coefficients
    # d alpha / d (lambda, nu; alpha_c, P, Q of alpha1; the same of alpha2)
    J = np.zeros((len(basis), 2, 8))
    J[:, :, :2] = np.stack([d @ coefficients for d in by_x], axis=2)
    J[:, 0, 2:5] = J[:, 1, 5:] = basis
    fitted, sigma = _uncertainty(J, arc.alpha - predicted, arc)
    A, b, by_fit = _matrix_form(x, coefficients)
    return Ellipse(A, b, by_fit @ fitted @ by_fit.T, sigma, predicted)


def _circle(x: Float, tau: Float) -> tuple[Columns, tuple[Columns, Columns]]:
    """Columns ``1, e^{-(lambda + i nu) tau}``."""
    turning = np.exp(-(x[0] + 1j * x[1]) * tau)
    zero = np.zeros_like(turning)
    by_decay = np.stack([zero, -tau * turning], axis=1)
    return np.stack([zero + 1, turning], axis=1), (by_decay, 1j * by_decay)


def _oscillation(x: Float, tau: Float) -> tuple[Columns, tuple[Columns, Columns]]:
    """Columns ``1, e^{-lambda tau} cos nu tau, e^{-lambda tau} sin nu tau``."""
    turning = np.exp((-x[0] + 1j * x[1]) * tau)
    c, s = turning.real, turning.imag
    zero = np.zeros_like(c)
    by_decay = np.stack([zero, -tau * c, -tau * s], axis=1)
    by_frequency = np.stack([zero, -tau * s, tau * c], axis=1)
    return np.stack([zero + 1, c, s], axis=1), (by_decay, by_frequency)


def _variable_projection(
    basis: Basis, arc: Arc, y: Columns, guess: tuple[float, float]
) -> tuple[Float, Columns]:
    """(lambda, nu) that leave least of y, shape (n, q), beside the basis; and the coefficients, shape (p, q).

    With Q an orthonormal basis of the columns Phi and c the coefficients the residual is ``y - Q Q* y``, and
    its derivative, without the part that the residual does not see, ``-(1 - Q Q*) (d Phi) c`` (Kaufman).
    """
    _refuse_unless(int(arc.measured.sum()) >= _FEWEST, f"{_FEWEST} measured samples or more", arc)
    tau, seen = arc.tau[arc.measured], y[arc.measured]
    span = tau[-1] - tau[0]

    def projected(x: Float) -> tuple[Columns, Columns, Columns]:
        # Time counts from where the columns are largest, so that no trial step overflows.
        Phi, by_x = basis(x, tau - (tau[-1] if x[0] < 0 else tau[0]))
        Q, R = np.linalg.qr(Phi)
        parts = Q.conj().T @ seen
        c = np.linalg.lstsq(R, parts, rcond=None)[0]
        J = np.stack([-(d @ c) for d in by_x], axis=2).reshape(len(tau), -1)
        return seen - Q @ parts, J - Q @ (Q.conj().T @ J), c

    def jacobian(x: Float) -> Float:
        return _real(projected(x)[1].reshape(-1, 2))

    def residual(x: Float) -> Float:
        return _real(projected(x)[0].reshape(-1, 1))[:, 0]

    end = _CONVERGED
    found = least_squares(
        residual, guess, jacobian, method="lm", x_scale=[1 / span] * 2, ftol=end, xtol=end, gtol=end
    )
    _refuse_unless(found.status > 0, "a spiral about the pole", arc)
    Phi, _ = basis(found.x, tau)
    coefficients = np.linalg.lstsq(Phi, seen, rcond=None)[0]
    turning = np.linalg.svd(coefficients[1:], compute_uv=False)
    some = bool(turning[-1] > _CONVERGED * np.abs(seen).max())
    _refuse_unless(some, "a spiral about the pole, of some amplitude", arc)
    return found.x, coefficients


def _real(columns: Columns) -> Float:
    """Complex rows as twice as many real ones; real ones as they are."""
    if np.iscomplexobj(columns):
        return np.concatenate([columns.real, columns.imag])
    return columns


def _uncertainty(J: Float, residual: Float, arc: Arc) -> tuple[Float, float]:
    """Covariance of k coefficients, and sigma, by Jacobian (n, 2, k) and residual (n, 2) of the angles."""
    rows, left = J[arc.measured].reshape(-1, J.shape[2]), residual[arc.measured].ravel()
    sigma = float(np.sqrt(left @ left / (len(left) - J.shape[2])))
    scale = np.linalg.norm(rows, axis=0)
    R = np.linalg.qr(rows / scale, mode="r")
    half = sigma * solve_triangular(R, np.eye(len(R))) / scale[:, np.newaxis]
    return half @ half.T, sigma


def _matrix_form(x: Float, coefficients: Columns) -> tuple[Float, Float, Float]:
    """A, b, and the derivative of (A, b), shape (6, 8), by (lambda, nu; alpha_c, P, Q of each angle).

    ``d A = (dW K + W dK - A dW) W^-1``, ``d b = -dA alpha_c - A d alpha_c``.
    """
    centre, W = coefficients[0].real, coefficients[1:].real.T
    K = np.array([[-x[0], -x[1]], [x[1], -x[0]]])
    inverse = np.linalg.inv(W)
    A = W @ K @ inverse
    by_fit = np.empty((6, 8))
    for k in range(8):
        unit = np.zeros(8)
        unit[k] = 1.0
        dK = np.array([[-unit[0], -unit[1]], [unit[1], -unit[0]]])
        of_coefficients = unit[2:].reshape(2, 3)
        dW = of_coefficients[:, 1:]
        dA = (dW @ K + W @ dK - A @ dW) @ inverse
        by_fit[:4, k] = dA.ravel()
        by_fit[4:, k] = -dA @ centre - A @ of_coefficients[:, 0]
    return A, -A @ centre, by_fit


def _refuse_unless(condition: bool, expected: str, arc: Arc) -> None:
    if not condition:
        raise SpiralError(
            f"spiral of run {arc.run}",
            expected=expected,
            found=f"{int(arc.measured.sum())} measured samples over {np.ptp(arc.tau):.2g} Earth radians",
            remedy="start further from the pole, record longer, or leave the method spiral out",
        )
