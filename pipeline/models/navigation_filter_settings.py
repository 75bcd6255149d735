"""What the error-state filter of navigation is told of the errors: P0, Q, R, and colour.

Defaults are the published ones for a light aircraft with a tactical inertial unit: sigmas of measurements are
larger than their noise, because a filter of 15 or 18 states takes coloured errors for white ones. Position is
safe by that, but standard deviations and innovations are not what they are said to be. `ColouredErrors` gives
each error its own states instead; then R is the white noise alone, and all are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from pipeline.models.navigation_problem import AidName


@dataclass(frozen=True, slots=True)
class StartDeviations:
    """Standard deviations of the state at the start, P0.

    Attributes
    ----------
    position : float
        Of each of N, E, D [m].
    velocity : float
        Of each of N, E, D [m/s].
    tilt : float
        Of the attitude about north and about east [rad].
    yaw : float
        About down [rad].
    accelerometer_bias : float
        Of each axis [m/s^2].
    gyro_bias : float
        Of each axis [rad/s].
    wind : float
        Of north and of east [m/s].
    barometer_bias : float
        [m].
    """

    position: float = 3.0
    velocity: float = 0.3
    tilt: float = 0.02
    yaw: float = 0.02
    accelerometer_bias: float = 0.2
    gyro_bias: float = 1e-3
    wind: float = 6.0
    barometer_bias: float = 5.0


@dataclass(frozen=True, slots=True)
class ProcessNoise:
    """Standard deviations of what the state gathers in a second, growing with the root of time: Q.

    Attributes
    ----------
    velocity : float
        White noise of the accelerometers [m/s/sqrt(s)].
    attitude : float
        White noise of the gyros [rad/sqrt(s)].
    accelerometer_bias, gyro_bias, wind, barometer_bias : float
        Random walks [m/s^2/sqrt(s)], [rad/s/sqrt(s)], [m/s/sqrt(s)], [m/sqrt(s)].
    coasted_velocity, coasted_attitude : float
        In place of the first two on steps whose samples were missing.
    """

    velocity: float = 0.004
    attitude: float = 1.5e-4
    accelerometer_bias: float = 1e-4
    gyro_bias: float = 1e-6
    wind: float = 0.0245
    barometer_bias: float = 0.02
    coasted_velocity: float = 0.5
    coasted_attitude: float = 0.02


@dataclass(frozen=True, slots=True)
class MeasurementNoise:
    """Standard deviations of one measurement, taken as white: R.

    Attributes
    ----------
    position : float
        Of each of N, E, D [m].
    velocity : float
        Of each of N, E, D [m/s].
    airspeed : float
        [m/s]. 8.6 at 5 Hz is a gust of 1.06 m/s that lasts 6.6 s, made white.
    altitude : float
        [m].
    magnetic_field : float
        Of each axis [T].
    attitude : float
        Of each axis [rad].
    sideslip : float
        Of the air across the plane of symmetry, which is taken to be none wherever the air speed is used
        [m/s]: an aircraft keeps its nose in the air's way, but for gusts. Infinite: nothing is taken of it,
        as of a vehicle that does not.
    """

    position: float = 1.5
    velocity: float = 0.08
    airspeed: float = 8.6
    altitude: float = 0.5
    magnetic_field: float = 0.6e-6
    attitude: float = 0.01
    sideslip: float = math.inf


@dataclass(frozen=True, slots=True)
class GaussMarkov:
    """An error with autocovariance ``sigma^2 exp(-|t|/time_constant)``.

    Attributes
    ----------
    sigma : float
        In the unit of what it is an error of; 0 where there is none.
    time_constant : float
        [s].
    """

    sigma: float = 0.0
    time_constant: float = 1.0


@dataclass(frozen=True, slots=True)
class ColouredErrors:
    """Errors that are the same, or nearly, from one measurement to the next: each gets states of its own.

    A sigma of 0 gives none.

    Attributes
    ----------
    position : GaussMarkov
        Of GNSS, along each of N, E, D [m].
    wind : GaussMarkov
        Of the wind about its mean, north and east [m/s]. The mean is the wind of the 18 states.
    gust : GaussMarkov
        Of the air about the wind, north and east [m/s].
    airspeed_scale, airspeed_bias : float
        Constant errors of the air speed [1], [m/s].
    hard_iron : float
        Constant error of the magnetometer along each body axis [T].
    attitude : GaussMarkov
        Of the external attitude, about each of N, E, D [rad].
    attitude_bias : float
        Constant part of the same [rad].
    """

    position: GaussMarkov = GaussMarkov()
    wind: GaussMarkov = GaussMarkov()
    gust: GaussMarkov = GaussMarkov()
    airspeed_scale: float = 0.0
    airspeed_bias: float = 0.0
    hard_iron: float = 0.0
    attitude: GaussMarkov = GaussMarkov()
    attitude_bias: float = 0.0


USUAL = ColouredErrors(
    position=GaussMarkov(0.5, 30.0),
    hard_iron=0.15e-6,
    attitude=GaussMarkov(5e-3, 10.0),
    attitude_bias=5e-3,
)
"""Errors of a differential GNSS, a magnetometer calibrated in place and an external attitude of 0.3 degrees.

No sigma of white noise, however large, stands for an error that is constant or nearly: taken for white it is
believed more with each measurement. In the simulated flights with fixes of 0.5 m the filter's errors of
attitude are then 4.5 standard deviations with a magnetometer, 6.5 with an external attitude besides, and 0.8
with these states.
"""


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """All that the filter and its smoother are told.

    Attributes
    ----------
    states : {15, 18}
        Errors of position, velocity, attitude, gyro and accelerometer bias; 18: and the wind, north and east,
        and the bias of the barometer. With 15, air speed and barometer are calibrated while position or
        velocity is measured (wind and bias by a low-pass) and aid when it is not.
    start, noise, measurement : StartDeviations, ProcessNoise, MeasurementNoise
        P0, Q, R.
    coloured : ColouredErrors or None
        Further states.
    lever_arm : tuple of float
        Of the GNSS antenna from the inertial unit, body axes [m].
    covariance_step : float
        The state is propagated at every step of the inertial sensors, its covariance at every measurement
        and at least this often [s].
    gate : float
        Probability with which a good measurement is refused for its size; 0 refuses none.
    reseat_after : int
        Measurements of one aid refused in a row, after which the state is taken to be what is wrong, and is
        made as uncertain as the last of them says; 0: never.
    least_interval : mapping of str to float
        By aid: measurements that follow one another closer are left out [s].
    stale : float
        An aid counts as lost after so many of its median intervals without a measurement.
    calibration_time : float
        Time constant of the low-pass of the 15 states [s].
    least_airspeed : float
        Below it [m/s] there is no direction of the flow to speak of, and air speed is not used.
    """

    states: Literal[15, 18] = 18
    start: StartDeviations = StartDeviations()
    noise: ProcessNoise = ProcessNoise()
    measurement: MeasurementNoise = MeasurementNoise()
    coloured: ColouredErrors | None = None
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    covariance_step: float = 0.1
    gate: float = 1e-5
    reseat_after: int = 30
    least_interval: Mapping[AidName, float] = field(
        default_factory=lambda: {"airspeed": 0.2, "altitude": 0.1, "magnetic_field": 0.1, "attitude": 0.1}
    )
    stale: float = 2.5
    calibration_time: float = 100.0
    least_airspeed: float = 5.0
