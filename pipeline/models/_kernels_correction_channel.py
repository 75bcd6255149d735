"""One axis of the correction loops over one step of the sensors, compiled.

The equations are those of `correction_response`, the state x is ``(L_k, V_kV, c_X, c_V, n, dX, dV)``. In
navigation the sensors' own step is made by the strapdown equations and x holds what the loops add to it:
``L_k = 0``, ``V_kV = k_LV c_X`` and ``n = 0`` at its beginning. The gains stand as
``(T, k_L, T_V, k_V, K, k_LV, k_n)``.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
State = tuple[float, float, float, float, float, float, float]

PROPAGATED, HELD, HELD_DIFFERENCE = range(3)
"""What the differences do between fixes."""

L, V, CX, CV, N, DX, DV = range(7)
"""Places in the state."""

T_, KL_, TV_, KV_, K_, KLV_, KN_ = range(7)
"""Places in the gains."""


@njit(cache=True)
def _slope(x: State, g: State, reference: int, v: float, a: float) -> State:
    """x'; v, a: velocity and acceleration by the sensors alone, which a reference that stays falls behind."""
    _, speed, c_X, c_V, n, dX, dV = x
    T, k_L, T_V, k_V, K, k_LV, k_n = g
    c_X_rate = (k_L * dX - c_X) / T
    c_V_rate = (k_V * dV - c_V) / T_V
    damped = K * (c_V + k_LV * c_X)
    V_rate = -n - damped - c_V_rate
    L_rate = speed - k_LV * c_X - c_X_rate
    if reference == PROPAGATED:
        dX_rate, dV_rate = dV - k_LV * c_X - c_X_rate, -damped - c_V_rate
    elif reference == HELD:
        dX_rate, dV_rate = L_rate + v, V_rate + a
    else:
        dX_rate, dV_rate = 0.0, 0.0
    return L_rate, V_rate, c_X_rate, c_V_rate, k_n * damped, dX_rate, dV_rate


@njit(cache=True)
def _moved(x: State, h: float, k: State) -> State:
    return (
        x[0] + h * k[0],
        x[1] + h * k[1],
        x[2] + h * k[2],
        x[3] + h * k[3],
        x[4] + h * k[4],
        x[5] + h * k[5],
        x[6] + h * k[6],
    )


@njit(cache=True)
def channel(
    x: Float,
    gains: Float,
    position: bool,
    velocity: bool,
    frozen: bool,
    reference: int,
    v: float,
    a: float,
    dt: float,
    longest: float,
) -> None:
    """Move x by dt, in place, by steps of Runge and Kutta's fourth order.

    Parameters
    ----------
    x : ndarray, shape (7,)
    gains : ndarray, shape (7,)
    position, velocity : bool
        Validity J_L, J_V of the differences.
    frozen : bool
        Whether the bias is left as it is.
    reference : int
        `PROPAGATED`, `HELD` or `HELD_DIFFERENCE`.
    v, a : float
        Velocity [m/s] and acceleration [m/s^2] by the sensors alone; used with `HELD`.
    dt, longest : float
        The step, and the longest that is made at once [s].
    """
    g = (
        gains[T_],
        gains[KL_] if position else 0.0,
        gains[TV_],
        gains[KV_] if velocity else 0.0,
        gains[K_],
        gains[KLV_],
        0.0 if frozen else gains[KN_],
    )
    count = int(dt / longest) + 1
    h = dt / count
    y = (x[0], x[1], x[2], x[3], x[4], x[5], x[6])
    for _ in range(count):
        k1 = _slope(y, g, reference, v, a)
        k2 = _slope(_moved(y, h / 2, k1), g, reference, v, a)
        k3 = _slope(_moved(y, h / 2, k2), g, reference, v, a)
        k4 = _slope(_moved(y, h, k3), g, reference, v, a)
        y = _moved(_moved(_moved(_moved(y, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)
    for i in range(7):
        x[i] = y[i]


@njit(cache=True)
def response(
    x: Float,
    gains: Float,
    position: bool,
    velocity: bool,
    frozen: bool,
    reference: int,
    every: int,
    dt: float,
    longest: float,
    out: Float,
) -> None:
    """Fill the states of one axis at rest, with fixes of no error each so many steps, from the second row on.

    Parameters
    ----------
    x : ndarray, shape (7,)
        The start; moved on.
    every : int
        Steps between fixes; 0 for none after the start.
    out : ndarray, shape (n, 7)
    """
    for i in range(out.shape[0]):
        if i:
            channel(x, gains, position, velocity, frozen, reference, 0.0, 0.0, dt, longest)
        if every and i % every == 0:
            x[DX], x[DV] = x[L], x[V]
        out[i] = x
