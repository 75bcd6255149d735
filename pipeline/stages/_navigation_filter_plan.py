"""What a test plan tells the filter of a navigation of the errors to expect: P0, Q, R and colour."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any, Literal

from pydantic import Field

from pipeline.models.navigation_filter_settings import (
    USUAL,
    ColouredErrors,
    FilterSettings,
    GaussMarkov,
    MeasurementNoise,
    ProcessNoise,
    StartDeviations,
)
from pipeline.stages.base import Settings as _Settings

Triple = tuple[float, float, float]

_P0, _Q, _R = StartDeviations(), ProcessNoise(), MeasurementNoise()
_FILTER = FilterSettings()


class StartSigmas(_Settings):
    """1 sigma of the state at the start: P0."""

    position_m: float = Field(_P0.position, gt=0, description="of north, east and down, m")
    velocity_m_s: float = Field(_P0.velocity, gt=0, description="of north, east and down, m/s")
    tilt_rad: float = Field(_P0.tilt, gt=0, description="of the attitude about north and east, rad")
    yaw_rad: float = Field(_P0.yaw, gt=0, description="of the attitude about down, rad")
    accelerometer_bias_m_s2: float = Field(_P0.accelerometer_bias, gt=0, description="of each axis, m/s^2")
    gyro_bias_rad_s: float = Field(_P0.gyro_bias, gt=0, description="of each axis, rad/s")
    wind_m_s: float = Field(_P0.wind, gt=0, description="of north and east, m/s")
    barometer_bias_m: float = Field(_P0.barometer_bias, gt=0, description="of the barometer, m")


class ProcessSigmas(_Settings):
    """1 sigma of what errors gather in a second, growing with the root of time: Q."""

    velocity_m_s: float = Field(_Q.velocity, gt=0, description="noise of the accelerometers, m/s/sqrt(s)")
    attitude_rad: float = Field(_Q.attitude, gt=0, description="noise of the gyros, rad/sqrt(s)")
    accelerometer_bias_m_s2: float = Field(
        _Q.accelerometer_bias, gt=0, description="walk of the accelerometers' bias, m/s^2/sqrt(s)"
    )
    gyro_bias_rad_s: float = Field(_Q.gyro_bias, gt=0, description="walk of the gyros' bias, rad/s/sqrt(s)")
    wind_m_s: float = Field(_Q.wind, gt=0, description="walk of the wind, m/s/sqrt(s)")
    barometer_bias_m: float = Field(
        _Q.barometer_bias, gt=0, description="walk of the barometer's bias, m/sqrt(s)"
    )
    coasted_velocity_m_s: float = Field(
        _Q.coasted_velocity, gt=0, description="of the velocity while samples are missing, m/s/sqrt(s)"
    )
    coasted_attitude_rad: float = Field(
        _Q.coasted_attitude, gt=0, description="of the attitude while samples are missing, rad/sqrt(s)"
    )


class MeasurementSigmas(_Settings):
    """1 sigma of one measurement, taken as white: R."""

    position_m: float = Field(_R.position, gt=0, description="of north, east and down by satellites, m")
    velocity_m_s: float = Field(_R.velocity, gt=0, description="of north, east and down by satellites, m/s")
    airspeed_m_s: float = Field(_R.airspeed, gt=0, description="of the air speed, gusts included, m/s")
    altitude_m: float = Field(_R.altitude, gt=0, description="of the barometer, m")
    magnetic_field_ut: float = Field(
        _R.magnetic_field * 1e6, gt=0, description="of each axis of the magnetometer, uT"
    )
    attitude_rad: float = Field(_R.attitude, gt=0, description="of the external attitude, rad")
    sideslip_m_s: float | None = Field(
        None,
        gt=0,
        description="of the air across an aircraft, taken to be none at each air speed, m/s; None: it is not",
    )


class ColouredSigmas(_Settings):
    """1 sigma of errors that last from one measurement to the next, each with states of its own; 0: none.

    Beside them the noise of the measurement is what is white alone.
    """

    position_m: float = Field(USUAL.position.sigma, ge=0, description="of satellites, north, east, down, m")
    position_time_s: float = Field(
        USUAL.position.time_constant,
        gt=0,
        description="in which that of the position falls to 1/e of its correlation, s",
    )
    wind_m_s: float = Field(
        USUAL.wind.sigma, ge=0, description="of the wind about its mean, north and east, m/s"
    )
    wind_time_s: float = Field(300.0, gt=0, description="in which the wind does, s")
    gust_m_s: float = Field(
        USUAL.gust.sigma, ge=0, description="of the air about the wind, north and east, m/s"
    )
    gust_time_s: float = Field(6.6, gt=0, description="in which a gust does, s")
    airspeed_scale: float = Field(
        USUAL.airspeed_scale, ge=0, description="relative error of the air speed, constant, 1"
    )
    airspeed_bias_m_s: float = Field(USUAL.airspeed_bias, ge=0, description="of the air speed, constant, m/s")
    hard_iron_ut: float = Field(
        round(USUAL.hard_iron * 1e6, 9),
        ge=0,
        description="of each axis of the magnetometer, constant, uT",
    )
    attitude_rad: float = Field(
        USUAL.attitude.sigma, ge=0, description="of the external attitude, about north, east, down, rad"
    )
    attitude_time_s: float = Field(
        USUAL.attitude.time_constant, gt=0, description="in which the external attitude does, s"
    )
    attitude_bias_rad: float = Field(
        USUAL.attitude_bias, ge=0, description="of the external attitude, constant, rad"
    )

    @property
    def errors(self) -> ColouredErrors:
        """The same for the model."""
        return ColouredErrors(
            position=_gauss_markov(self.position_m, self.position_time_s),
            wind=_gauss_markov(self.wind_m_s, self.wind_time_s),
            gust=_gauss_markov(self.gust_m_s, self.gust_time_s),
            airspeed_scale=self.airspeed_scale,
            airspeed_bias=self.airspeed_bias_m_s,
            hard_iron=self.hard_iron_ut * 1e-6,
            attitude=_gauss_markov(self.attitude_rad, self.attitude_time_s),
            attitude_bias=self.attitude_bias_rad,
        )


def _gauss_markov(sigma: float, time: float) -> GaussMarkov:
    return GaussMarkov(sigma, time) if sigma else GaussMarkov()


class FilterPlan(_Settings):
    """The error-state filter and its smoother."""

    states: Literal[15, 18] = Field(
        _FILTER.states, description="18: wind and the barometer's bias among them"
    )
    start: StartSigmas = Field(default_factory=StartSigmas, description="1 sigma at the start (P0)")
    noise: ProcessSigmas = Field(default_factory=ProcessSigmas, description="process noise (Q)")
    measurement: MeasurementSigmas = Field(
        default_factory=MeasurementSigmas, description="noise of the measurements (R)"
    )
    coloured: ColouredSigmas = Field(
        default_factory=ColouredSigmas, description="errors that are not white, in states of their own"
    )
    lever_arm_m: Triple = Field(
        (0.0, 0.0, 0.0), description="of the antenna from the inertial unit, body axes, m"
    )
    gate: float = Field(
        _FILTER.gate,
        ge=0,
        lt=1,
        description="probability with which a good measurement is refused; 0: none is",
    )
    reseat_after: int = Field(
        _FILTER.reseat_after, ge=0, description="refused in a row, after which the state is doubted; 0: never"
    )

    def settings(self, stale: float) -> FilterSettings:
        """The same for the model, which counts an aid as lost after so many of its intervals."""
        return FilterSettings(
            states=self.states,
            start=StartDeviations(*_values(self.start, StartDeviations)),
            noise=ProcessNoise(*_values(self.noise, ProcessNoise)),
            measurement=MeasurementNoise(
                self.measurement.position_m,
                self.measurement.velocity_m_s,
                self.measurement.airspeed_m_s,
                self.measurement.altitude_m,
                self.measurement.magnetic_field_ut * 1e-6,
                self.measurement.attitude_rad,
                math.inf if self.measurement.sideslip_m_s is None else self.measurement.sideslip_m_s,
            ),
            coloured=self.coloured.errors,
            lever_arm=self.lever_arm_m,
            gate=self.gate,
            reseat_after=self.reseat_after,
            stale=stale,
        )


def _values(section: _Settings, model: type[Any]) -> list[float]:
    """What a section states for each field of a model: the key that begins with its name."""
    stated = section.model_dump()
    return [next(v for key, v in stated.items() if key.startswith(f"{f.name}_")) for f in fields(model)]
