"""Attitude from angular rates, along one uninterrupted record.

Both integrators take, for every step, the rates at its two ends and their exact integral over it (the
angle increment), as an interpolant or an integrating gyro gives them. Row ``i`` stands for the step that
ends there; row 0 has none.

`integrate_quaternion`
    The rotation vector of a step, Magnus series of order four (Blanes, Casas, Oteo & Ros, Physics
    Reports 470, 2009, section 5.4; for body rates the commutator changes its sign)::

        v = a + a × b1,    a = ∫ w dt,    b1 = (1/h) ∫ (t - h/2) w dt ≈ h (w1 - w0)/12

    ``b1`` is exact for a quadratic; for a cubic its error is of the order h**4. The term a × b1 is the
    coning term of Bortz's equation (IEEE Trans. AES-7, 1971) as Savage (J. Guidance 21, 1998) uses it:
    ½ ∫ α × w dt. No singularity. Global error O(h**4).
`integrate_euler_krylov`
    Equations (1.1) of Godorov & Lutmanov (2016) by the classical fourth-order Runge-Kutta rule::

        psi'   = (q cos γ - r sin γ)/cos θ
        theta' =  q sin γ + r cos γ
        gamma' =  p - tan θ (q cos γ - r sin γ)

    with the rates at midstep from Simpson's rule, ``wm = (6 a/h - w0 - w1)/4``, exact for a cubic. Within a
    step the sines and cosines are unknowns too, ``(sin x)' = x' cos x``, ``(cos x)' = -x' sin x``, and at its
    end those of the angles again: of fourth order as well, and no stage waits for a sine. Singular at
    theta = ±90°.

Arrays are ``(n, 3)`` and ``(n, 4)``; those returned lie in memory one component after the other, and such
arrays are taken without a copy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.numerics import _kernels_rotation as _kernels

Float = NDArray[np.float64]


class SingularityError(ValueError):
    """The angles came too near to theta = ±90°; ``row`` says where."""

    def __init__(self, row: int) -> None:
        self.row = row
        super().__init__(f"theta passes its limit at row {row}")


def integrate_quaternion(rates: Float, increments: Float, steps: Float, initial: Float) -> Float:
    """Attitude by the running product of the steps' rotations.

    Parameters
    ----------
    rates : ndarray, shape (n, 3)
        Body rates p, q, r at the ends of the steps [rad/s].
    increments : ndarray, shape (n, 3)
        Their integrals over the step that ends at the row [rad]; the first row is not used.
    steps : ndarray, shape (n,)
        Duration of the step that ends at the row [s]; the first is not used.
    initial : ndarray, shape (4,)
        Attitude in the first row; need not be exactly unit.

    Returns
    -------
    ndarray, shape (n, 4)
        Quaternions from body to reference axes, unit to 1e-12.
    """
    quaternion = np.empty((4, len(steps)))
    start = np.asarray(initial, dtype=np.float64)
    _kernels.integrate_quaternion(
        _by_component(rates), _by_component(increments), steps, start / np.linalg.norm(start), quaternion
    )
    return quaternion.T


def integrate_euler_krylov(
    rates: Float, increments: Float, steps: Float, initial: Float, limit: float
) -> Float:
    """Attitude by integration of the Euler-Krylov angles (1.1).

    Parameters
    ----------
    rates, increments, steps
        As for `integrate_quaternion`; every step but the first longer than zero.
    initial : ndarray, shape (3,)
        psi, theta, gamma in the first row [rad].
    limit : float
        Largest absolute theta that is integrated [rad], less than pi/2.

    Returns
    -------
    ndarray, shape (n, 3)
        psi, theta, gamma [rad], continuous.

    Raises
    ------
    SingularityError
        Where the absolute theta exceeds the limit, or is not a number.
    """
    angles = np.empty((3, len(steps)))
    angles[:, 0] = initial
    row = _kernels.integrate_euler_krylov(
        _by_component(rates), _by_component(increments), steps, limit, angles
    )
    if row >= 0:
        raise SingularityError(row)
    return angles.T


def euler_krylov_along(quaternion: Float) -> Float:
    """Euler-Krylov angles of an attitude history, psi and gamma without jumps.

    Parameters
    ----------
    quaternion : ndarray, shape (n, 4)
        Attitude; less than half a turn from one row to the next.

    Returns
    -------
    ndarray, shape (n, 3)
        psi, theta, gamma [rad]; psi and gamma within half a turn in the first row and continuous from
        there, theta in [-pi/2, pi/2].
    """
    angles = np.empty((3, len(quaternion)))
    _kernels.euler_krylov(_by_component(quaternion), angles)
    return angles.T


def _by_component(array: Float) -> Float:
    return np.ascontiguousarray(np.asarray(array, dtype=np.float64).T)
