"""What every method of navigation is given, and what it gives back.

Axes: navigation N, E, D (north, east, down); body 1 forward, 2 right, 3 down. An attitude is the quaternion
(w, x, y, z) that takes body axes to N, E, D. Position is geodetic on the WGS-84 ellipsoid. A `Problem` holds
the increments of the inertial sensors and the aiding, each with its own instants; a `Navigation` is what one
method makes of it, at the instants of the increments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

AidName = Literal["position", "velocity", "airspeed", "altitude", "magnetic_field", "attitude"]


@dataclass(frozen=True, slots=True)
class Imu:
    """Increments of gyros and accelerometers over n steps.

    Attributes
    ----------
    time : ndarray, shape (n + 1,)
        Ends of the steps, strictly increasing [s].
    rotation : ndarray, shape (n, 3)
        Rotation vector of the body over each step against inertial space, coning included [rad].
    velocity : ndarray, shape (n, 3)
        Integral of the specific force over each step, in the body axes at its beginning: rotation and
        sculling included [m/s].
    coasted : ndarray of bool, shape (n,)
        Steps whose samples were missing or not usable, and were bridged.
    """

    time: Float
    rotation: Float
    velocity: Float
    coasted: Mask

    def __len__(self) -> int:
        """How many steps."""
        return len(self.rotation)


@dataclass(frozen=True, slots=True)
class Fixes:
    """Measurements of one aid.

    Attributes
    ----------
    time : ndarray, shape (m,)
        Not decreasing, by the clock of the increments [s].
    value : ndarray, shape (m, k)
        ``position``: latitude, longitude [rad], height [m]. ``velocity``: N, E, D [m/s]. ``airspeed``: true
        air speed [m/s]. ``altitude``: of the barometer [m]. ``magnetic_field``: in body axes [T].
        ``attitude``: quaternion (w, x, y, z).
    usable : ndarray of bool, shape (m,)
        False where the data themselves say that the fix is none: NaN, no satellites, frozen.
    """

    time: Float
    value: Float
    usable: Mask


@dataclass(frozen=True, slots=True)
class EarthField:
    """The magnetic field of the Earth at the place.

    Attributes
    ----------
    strength : float
        [T].
    dip : float
        Below the horizon, positive down [rad].
    declination : float
        Of magnetic from true north, positive to the east [rad].
    """

    strength: float
    dip: float
    declination: float

    @property
    def ned(self) -> Float:
        """Components N, E, D [T], shape (3,)."""
        horizontal = np.cos(self.dip)
        north, east = horizontal * np.cos(self.declination), horizontal * np.sin(self.declination)
        return self.strength * np.array([north, east, np.sin(self.dip)])


@dataclass(frozen=True, slots=True)
class Start:
    """The state at the first instant of the increments.

    Attributes
    ----------
    latitude, longitude : float
        [rad].
    height : float
        Above the ellipsoid [m].
    velocity : ndarray, shape (3,)
        N, E, D [m/s].
    attitude : ndarray, shape (4,)
        Quaternion (w, x, y, z).
    """

    latitude: float
    longitude: float
    height: float
    velocity: Float
    attitude: Float


@dataclass(frozen=True, slots=True)
class Problem:
    """What is navigated with.

    Attributes
    ----------
    imu : Imu
    start : Start
    aids : mapping of str to Fixes
        Those that there are.
    earth_field : EarthField or None
        Needed with a magnetometer.
    """

    imu: Imu
    start: Start
    aids: Mapping[AidName, Fixes] = field(default_factory=dict)
    earth_field: EarthField | None = None


@dataclass(frozen=True, slots=True)
class Innovations:
    """Measurements of one aid against what was predicted.

    Attributes
    ----------
    time : ndarray, shape (m,)
        [s].
    value, sigma : ndarray, shape (m, k)
        Measured less predicted, and the standard deviation that it should have; position as N, E, D [m].
    normalised_squared : ndarray, shape (m,)
        Innovation squared over its covariance, all k components together.
    accepted : ndarray of bool, shape (m,)
        Whether it passed the gate and was used.
    """

    time: Float
    value: Float
    sigma: Float
    normalised_squared: Float
    accepted: Mask


@dataclass(frozen=True, slots=True)
class Deviations:
    """Standard deviations of a navigation, at its instants; each of shape (n + 1, .).

    Attributes
    ----------
    position : ndarray, shape (n + 1, 3)
        N, E, D [m].
    velocity : ndarray, shape (n + 1, 3)
        N, E, D [m/s].
    attitude : ndarray, shape (n + 1, 3)
        Rotation vector of the error about N, E, D [rad].
    gyro_bias, accelerometer_bias : ndarray, shape (n + 1, 3)
        [rad/s], [m/s^2].
    wind : ndarray, shape (n + 1, 2), or None
        N, E [m/s].
    barometer_bias : ndarray, shape (n + 1,), or None
        [m].
    """

    position: Float
    velocity: Float
    attitude: Float
    gyro_bias: Float
    accelerometer_bias: Float
    wind: Float | None = None
    barometer_bias: Float | None = None


@dataclass(frozen=True, slots=True)
class Navigation:
    """What a method of navigation gives, at the n + 1 instants of the increments.

    Attributes
    ----------
    method : str
        ``strapdown``, ``loops``, ``filter`` or ``smoother``.
    time : ndarray, shape (n + 1,)
        [s].
    position : ndarray, shape (n + 1, 3)
        Latitude, longitude [rad], height [m].
    velocity : ndarray, shape (n + 1, 3)
        N, E, D [m/s].
    attitude : ndarray, shape (n + 1, 4)
        Quaternion (w, x, y, z).
    gyro_bias, accelerometer_bias : ndarray, shape (n + 1, 3)
        Estimates in body axes [rad/s], [m/s^2]; zero where the method has none.
    wind : ndarray, shape (n + 1, 2), or None
        Velocity of the air N, E [m/s].
    barometer_bias : ndarray, shape (n + 1,), or None
        [m].
    corrections : mapping of str to ndarray, each of shape (n + 1, 3)
        Of the loops: ``position`` c_X [m], ``velocity`` c_V [m/s], ``attitude`` c_U [rad].
    used : mapping of str to ndarray of bool, each of shape (n + 1,)
        By aid: whether it aids at the instant (its last fix is usable, accepted and not stale).
    deviations : Deviations or None
    innovations : mapping of str to Innovations
        By aid.
    """

    method: str
    time: Float
    position: Float
    velocity: Float
    attitude: Float
    gyro_bias: Float
    accelerometer_bias: Float
    wind: Float | None = None
    barometer_bias: Float | None = None
    corrections: Mapping[str, Float] = field(default_factory=dict)
    used: Mapping[AidName, Mask] = field(default_factory=dict)
    deviations: Deviations | None = None
    innovations: Mapping[AidName, Innovations] = field(default_factory=dict)
