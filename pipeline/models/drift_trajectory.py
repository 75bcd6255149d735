"""The gimbal angles of a gyro over hours, by the exact model or its linear form, and what they depend on.

The right-hand sides are those of `pipeline.models.gyro_drift` (Gubarenko & Kuzmenko, 1995, corrected); the
integration is compiled, in steps of order 8, and its error over 24 h is below 1e-12 rad.
The drift may have a transient, (7.4)::

    m(tau) = m0 exp(-k tau) + m (1 - exp(-k tau))

The sensitivities solve the equations of variation ``D' = J D + F`` along the same steps, so that they are the
derivative of the computed trajectory.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ExitCode, GyrostandError
from pipeline.models import _kernels_gyro_drift as kernels
from pipeline.models.earth import RATE, Base
from pipeline.models.gyro_drift import DRIFT, Gyro

Float = NDArray[np.float64]

SENSITIVITIES = (
    *("alpha1_0", "alpha2_0"),
    *DRIFT,
    *("theta1", "theta2"),
    *("delta_chi1", "delta_chi2", "delta_chi3"),
)
"""Columns of `sensitivities`, in order."""

_NO_DIRECTIONS, _NO_SENSITIVITIES = np.zeros((0, 9)), np.zeros((0, 2, kernels.COLUMNS))
_RATE_OF = np.array([1.0, 2.0, 1.0, 2.0, 1.0, 1.0])  # most that a unit of each m turns the rotor


class TrajectoryError(GyrostandError):
    """A trajectory that a two-axis gimbal cannot follow: the inner axis comes to 90 degrees."""

    exit_code = ExitCode.USAGE


@dataclass(frozen=True, slots=True)
class Transient:
    """A drift that has not settled: ``m(tau) = m0 exp(-k tau) + m (1 - exp(-k tau))``.

    Attributes
    ----------
    m0 : ndarray, shape (6,)
        Drift at tau = 0, in the order of `DRIFT` [1].
    decay : float
        k, in units of the Earth rate.
    """

    m0: Float
    decay: float


def trajectory(gyro: Gyro, base: Base, start: Float, tau: Float, transient: Transient | None = None) -> Float:
    """Gimbal angles by the exact model.

    Parameters
    ----------
    gyro : Gyro
        Drift and tilt.
    base : Base
        The base as it stands, its misalignment included.
    start : ndarray, shape (2,)
        Angles at ``tau[0]`` [rad].
    tau : ndarray, shape (n,)
        Increasing instants in units of the Earth rate; a transient begins at 0.
    transient : Transient, optional
        Else the drift is constant.

    Returns
    -------
    ndarray, shape (n, 2)
        alpha1 (unwrapped), alpha2 [rad].

    Raises
    ------
    TrajectoryError
        If alpha2 comes to 90 degrees.
    """
    return _followed(tau, start, _constants(base, gyro.m, transient, axis=gyro.rotor_axis), linear=False)


def linear_trajectory(
    p: Float, base: Base, start: Float, tau: Float, transient: Transient | None = None
) -> Float:
    """Gimbal angles by the linear model ``alpha' = c + F p``.

    Parameters
    ----------
    p : ndarray, shape (11,)
        In the order of `gyro_drift.PARAMETERS`; with a transient its m is where the drift settles.
    base : Base
        The base as it is meant to stand; its misalignment is in p.
    start, tau, transient
        As for `trajectory`.

    Returns
    -------
    ndarray, shape (n, 2)
        alpha1 (unwrapped), alpha2 [rad].

    Raises
    ------
    TrajectoryError
        If alpha2 comes to 90 degrees.
    """
    constants = _constants(base, p[:6], transient, theta=p[6:8], epsilon=p[8:])
    return _followed(tau, start, constants, linear=True)


def sensitivities(
    gyro: Gyro, base: Base, misalignment: Float, start: Float, tau: Float
) -> tuple[Float, Float]:
    """Gimbal angles by the exact model, and their derivatives by all that they depend on.

    Parameters
    ----------
    gyro : Gyro
        Drift and tilt.
    base : Base
        The base as it is meant to stand.
    misalignment : ndarray, shape (3,)
        Delta chi [rad]: the base stands as ``base.misaligned(misalignment)``.
    start : ndarray, shape (2,)
        Angles at ``tau[0]`` [rad].
    tau : ndarray, shape (n,)
        Increasing instants in units of the Earth rate.

    Returns
    -------
    alpha : ndarray, shape (n, 2)
    D : ndarray, shape (n, 2, 13)
        Columns in the order of `SENSITIVITIES`.

    Raises
    ------
    TrajectoryError
        If alpha2 comes to 90 degrees.
    """
    standing = base.misaligned(misalignment)
    constants = _constants(standing, gyro.m, None, axis=gyro.rotor_axis)
    directions = np.zeros((5, 9))
    directions[:2, 6:] = _axis_by_tilt(gyro.theta)
    # d(R v) = (R v) x (Jl dchi), with Jl the left Jacobian of Exp(-[Delta chi]x)
    turns = _left_jacobian(-misalignment).T
    directions[2:, :3] = np.cross(standing.u, turns)
    directions[2:, 3:6] = np.cross(standing.g, turns)
    D = np.empty((len(tau), 2, kernels.COLUMNS))
    return _followed(tau, start, constants, linear=False, directions=directions, D=D), D


def _constants(
    base: Base,
    m: Float,
    transient: Transient | None,
    *,
    axis: Float | tuple[float, ...] = (0.0, 0.0, 1.0),
    theta: Float | tuple[float, ...] = (0.0, 0.0),
    epsilon: Float | tuple[float, ...] = (0.0, 0.0, 0.0),
) -> Float:
    """The kernels' constants."""
    m0, decay = (m, 0.0) if transient is None else (transient.m0, transient.decay)
    return np.concatenate([base.u, base.g, m, m0, [decay], axis, theta, epsilon]).astype(np.float64)


def _followed(
    tau: Float,
    start: Float,
    constants: Float,
    *,
    linear: bool,
    directions: Float = _NO_DIRECTIONS,
    D: Float = _NO_SENSITIVITIES,
) -> Float:
    m, m0 = constants[kernels.M : kernels.M0], constants[kernels.M0 : kernels.DECAY]
    drift = float(np.maximum(np.abs(m), np.abs(m0)) @ _RATE_OF)
    bound = float(np.linalg.norm(constants[:3])) + drift + constants[kernels.DECAY]
    alpha = np.empty((len(tau), 2))
    times = np.ascontiguousarray(tau, dtype=np.float64)
    begin = np.ascontiguousarray(start, dtype=np.float64)
    reached, last, alpha2 = kernels.follow(times, begin, constants, linear, bound, directions, alpha, D)
    if reached < len(tau):
        hours = (last - times[0]) / RATE / 3600
        raise TrajectoryError(
            "alpha2 of a trajectory",
            expected=f"no nearer to 90 degrees than {np.rad2deg(np.arcsin(kernels.NEAREST)):.1f}",
            found=f"{np.rad2deg(alpha2):.1f} degrees after {hours:.2f} h",
            remedy="start from other angles, or follow for fewer hours",
        )
    return alpha


def _axis_by_tilt(theta: Float) -> Float:
    """Derivative of ``e3 = (theta2 sigma, -theta1 sigma, cos|theta|)`` by theta1 and theta2, shape (2, 3)."""
    size = float(np.hypot(*theta))
    sigma = float(np.sinc(size / np.pi))
    unit = theta / size if size > 0 else np.zeros(2)
    by_size = (np.cos(size) - sigma) * unit  # d sigma / d theta_k times |theta|
    turned = np.array([unit[1], -unit[0]])
    across = np.array([[0.0, -1.0], [1.0, 0.0]]) * sigma + np.outer(by_size, turned)
    return np.concatenate([across, -sigma * theta[:, np.newaxis]], axis=1)


def _left_jacobian(phi: Float) -> Float:
    """``I + (1 - cos f)/f^2 [phi]x + (f - sin f)/f^3 [phi]x^2``, f the size of phi; shape (3, 3)."""
    f = float(np.linalg.norm(phi))
    K = np.cross(np.eye(3), phi)  # K v = phi x v
    half = 0.5 * np.sinc(f / (2 * np.pi)) ** 2
    # below 1e-4 the series: the difference f - sin f keeps no digits
    third = (f - np.sin(f)) / f**3 if f > 1e-4 else 1 / 6
    return np.eye(3) + half * K + third * (K @ K)
