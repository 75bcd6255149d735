"""Attitude of a body at rest: pitch and roll from gravity, yaw from the Earth's magnetic field.

At rest the accelerometers measure the specific force ``f = -g C^T e_3``, so that ``d = -f/|f|`` is the
direction down in body axes::

    pitch = atan2(-d_1, sqrt(d_2^2 + d_3^2))        roll = atan2(d_2, d_3)
    yaw   = D - atan2(h_2, h_1),        h = R_2(pitch) R_1(roll) B

with B the magnetic field in body axes and D its declination. A bias b of an accelerometer tilts by b/g.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def pitch_and_roll(force: ArrayLike) -> tuple[float, float]:
    """Pitch and roll of a body at rest.

    Parameters
    ----------
    force : array_like, shape (3,)
        Specific force in body axes [m/s^2], not zero.

    Returns
    -------
    pitch, roll : float
        [rad].
    """
    d1, d2, d3 = -np.asarray(force, dtype=np.float64)
    return float(np.arctan2(-d1, np.hypot(d2, d3))), float(np.arctan2(d2, d3))


def yaw_of_field(field: ArrayLike, pitch: float, roll: float, declination: float) -> float:
    """Yaw from true north of a body of known pitch and roll.

    Parameters
    ----------
    field : array_like, shape (3,)
        Magnetic flux density in body axes, in any unit.
    pitch, roll : float
        [rad].
    declination : float
        Of magnetic from true north, positive to the east [rad].

    Returns
    -------
    float
        [rad].
    """
    B1, B2, B3 = np.asarray(field, dtype=np.float64)
    across = B2 * np.cos(roll) - B3 * np.sin(roll)
    below = B2 * np.sin(roll) + B3 * np.cos(roll)
    along = B1 * np.cos(pitch) + below * np.sin(pitch)
    return float(declination - np.arctan2(across, along))
