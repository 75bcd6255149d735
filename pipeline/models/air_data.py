"""The angle of attack that the lift gives, and with it the air velocity in body axes.

An air data sensor gives the true air speed V, a scalar. A wing that carries the specific force n across the
flow does so at an angle of attack that falls with the dynamic pressure, so that V and the accelerometer
along axis 3 tell the direction of the flow in the plane of symmetry::

    alpha = alpha_0 + (alpha_c - alpha_0) (n / g_0) V_c^2 / sqrt(V^4 + V_s^4),      n = -f_3
    V_a   = V (cos alpha, 0, sin alpha)

alpha_0 is the angle without lift, alpha_c that of level flight at V_c. The root in place of V^2 keeps alpha
finite where the wing does not yet carry, below V_s; at V_c it is 1.03 V^2. What the scalar cannot tell is the
sideslip, and what gusts across the flow add. The lift curve is an invention of this project, linear as
every wing's is in its useful range: the source has none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.units import STANDARD_GRAVITY

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Lift:
    """The lift curve of an aircraft.

    Attributes
    ----------
    zero_lift : float
        alpha_0 [rad].
    cruise : float
        alpha_c [rad].
    cruise_speed : float
        V_c, above 0 [m/s].
    stall_speed : float
        V_s, above 0 [m/s].
    """

    zero_lift: float = float(np.deg2rad(-2.0))
    cruise: float = float(np.deg2rad(2.0))
    cruise_speed: float = 40.0
    stall_speed: float = 20.0

    def angle_of_attack(self, load: ArrayLike, speed: ArrayLike) -> Float:
        """The angle of attack.

        Parameters
        ----------
        load : array_like, shape (...)
            Specific force against axis 3, n = -f_3 [m/s^2].
        speed : array_like, shape (...)
            True air speed [m/s].

        Returns
        -------
        ndarray, shape (...)
            [rad].
        """
        n, V = np.asarray(load, dtype=np.float64), np.asarray(speed, dtype=np.float64)
        pressure = self.cruise_speed**2 / np.sqrt(V**4 + self.stall_speed**4)
        alpha = self.zero_lift + (self.cruise - self.zero_lift) * n / STANDARD_GRAVITY * pressure
        return np.asarray(alpha, dtype=np.float64)


def air_velocity(speed: ArrayLike, angle_of_attack: ArrayLike) -> Float:
    """Velocity through the air in body axes, without sideslip.

    Parameters
    ----------
    speed : array_like, shape (...)
        True air speed [m/s].
    angle_of_attack : array_like, shape (...)
        [rad].

    Returns
    -------
    ndarray, shape (..., 3)
        Forward, right, down [m/s].
    """
    V, alpha = np.broadcast_arrays(np.asarray(speed, dtype=np.float64), angle_of_attack)
    return np.stack([V * np.cos(alpha), np.zeros_like(V), V * np.sin(alpha)], axis=-1)
