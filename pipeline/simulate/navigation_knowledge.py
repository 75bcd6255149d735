"""What a filter of navigation would be told by one who knows how its record was simulated.

The published tuning makes coloured errors white and large, see `pipeline.models.navigation_filter_settings`:
it navigates well, but its standard deviations and innovations are not what they say. With these settings
they are: each error of the simulation has the states and the sigma that it was drawn with.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from pipeline.models import navigation_filter_settings as told
from pipeline.models.navigation_problem import AidName
from pipeline.simulate.navigation_settings import Aid, GaussMarkov, NavigationSettings

LEAST: Mapping[AidName, float] = {
    "position": 1e-3,
    "velocity": 1e-3,
    "airspeed": 0.025,
    "altitude": 1e-3,
    "magnetic_field": 1e-9,
    "attitude": 1e-4,
}
"""Least white noise of a measurement. Air speed: gusts across the flow, 0.26 m/s in 0.2 s, times the sine of
the angle by which a wind of 5 m/s that it cannot see turns the flow."""

ACCELEROMETER_WALK, GYRO_WALK = 3e-6, 1e-8
"""Random walk of biases that are constant [m/s^2/sqrt(s)], [rad/s/sqrt(s)]: as the estimated attitude wanders
by 1e-3 rad, the axes of a constant bias seem to turn, and a filter that holds it for constant learns from
that."""

ACCELEROMETER_BIAS, GYRO_BIAS, WIND, BAROMETER_BIAS = 0.2, 1e-3, 6.0, 5.0
"""Standard deviations of what is constant in the simulation, and not drawn [m/s^2], [rad/s], [m/s], [m]."""

POSITION, VELOCITY = 0.01, 0.005
"""Least standard deviations of the start [m], [m/s]."""


def honest_settings(simulated: NavigationSettings) -> told.FilterSettings:
    """Settings of the filter that are true of a simulation without wandering biases of the inertial sensors.

    Parameters
    ----------
    simulated : NavigationSettings

    Returns
    -------
    FilterSettings
        18 states and what is coloured. Air speed is used above 20 m/s only: below, what it says of the wind
        is not linear in it.
    """
    aids, errors = simulated.aids, simulated.errors
    begun = simulated.start_errors
    step = math.sqrt(1 / simulated.rate)
    airspeed, magnetometer = aids.get("airspeed", Aid()), aids.get("magnetic_field", Aid())
    attitude = aids.get("attitude", Aid())
    return told.FilterSettings(
        start=told.StartDeviations(
            position=max(begun.position, POSITION),
            velocity=max(begun.velocity, VELOCITY),
            tilt=max(begun.attitude[1:]),
            yaw=begun.attitude[0],
            accelerometer_bias=ACCELEROMETER_BIAS,
            gyro_bias=GYRO_BIAS,
            wind=WIND,
            barometer_bias=BAROMETER_BIAS,
        ),
        noise=told.ProcessNoise(
            velocity=step * errors.accelerometer_noise,
            attitude=step * errors.gyro_noise,
            accelerometer_bias=ACCELEROMETER_WALK,
            gyro_bias=GYRO_WALK,
            wind=0.0,
            barometer_bias=0.0,
        ),
        measurement=told.MeasurementNoise(
            **{name: max(aids.get(name, Aid()).noise, least) for name, least in LEAST.items()}
        ),
        coloured=told.ColouredErrors(
            position=_gauss_markov(aids.get("position", Aid()).wander),
            wind=_gauss_markov(simulated.air.wander),
            gust=_gauss_markov(simulated.air.gust),
            airspeed_scale=abs(airspeed.scale),
            airspeed_bias=abs(airspeed.bias),
            hard_iron=magnetometer.drawn_bias,
            attitude=_gauss_markov(attitude.wander),
            attitude_bias=attitude.drawn_bias,
        ),
        least_airspeed=20.0,
    )


def _gauss_markov(process: GaussMarkov | None) -> told.GaussMarkov:
    return told.GaussMarkov() if process is None else told.GaussMarkov(process.sigma, process.time)
