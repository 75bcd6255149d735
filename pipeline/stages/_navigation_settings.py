"""Settings of the stage `navigate`: methods, the start, the Earth's field, and what the methods are told."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from pipeline.models.air_data import Lift
from pipeline.models.correction_gains import (
    PRINTED,
    TUNED,
    AirGains,
    AttitudeGains,
    ChannelGains,
    LoopGains,
)
from pipeline.models.correction_loops import LoopSettings
from pipeline.models.navigation_problem import AidName, EarthField
from pipeline.plan_faults import Fault, refuse
from pipeline.stages._navigation_filter_plan import FilterPlan
from pipeline.stages.base import Settings as _Settings

Method = Literal["strapdown", "loops", "filter", "smoother"]
Triple = tuple[float, float, float]

_LOOPS = LoopSettings()


class StartState(_Settings):
    """The state at the first inertial sample, as far as the plan states it."""

    latitude_deg: float | None = Field(None, ge=-90, le=90, description="geodetic latitude, degrees north")
    longitude_deg: float | None = Field(None, ge=-360, le=360, description="longitude, degrees east")
    height_m: float | None = Field(None, description="height above the ellipsoid, m")
    velocity_m_s: Triple | None = Field(None, description="velocity north, east, down, m/s")
    yaw_deg: float | None = Field(None, ge=-360, le=360, description="from true north to the east, degrees")
    pitch_deg: float | None = Field(None, ge=-90, le=90, description="nose up, degrees")
    roll_deg: float | None = Field(None, ge=-180, le=180, description="to the right, degrees")


class EarthFieldPlan(_Settings):
    """The magnetic field of the Earth at the place; see https://www.ngdc.noaa.gov/geomag."""

    strength_ut: float = Field(ge=15, le=100, description="magnetic flux density, uT")
    dip_deg: float = Field(ge=-90, le=90, description="inclination, positive down, degrees")
    declination_deg: float = Field(
        ge=-180, le=180, description="of magnetic from true north, positive to the east, degrees"
    )

    @property
    def field(self) -> EarthField:
        """The same in SI."""
        dip, declination = np.deg2rad([self.dip_deg, self.declination_deg])
        return EarthField(self.strength_ut * 1e-6, float(dip), float(declination))


class SatelliteGains(_Settings):
    """Gains of the velocity and position channel."""

    T_s: float = Field(description="time constant T of the position correction, s")
    T_V_s: float = Field(description="time constant T_V of the velocity correction, s")
    k_L: float = Field(description="gain of the position correction, 1")
    k_V: float = Field(description="gain of the velocity correction, 1")
    K: float = Field(description="damping, 1/s")
    k_LV: float = Field(description="gain from the position correction to the velocity, 1/s")
    k_n: float = Field(description="gain of the accelerometers' bias, 1/s")

    @property
    def gains(self) -> ChannelGains:
        """The same for the model."""
        return ChannelGains(self.T_s, self.T_V_s, self.k_L, self.k_V, self.K, self.k_LV, self.k_n)


class AirDataGains(_Settings):
    """Gains of the velocity channel by air data, in an outage."""

    T_V_s: float = Field(description="time constant T_V of the velocity correction, s")
    k_V: float = Field(description="gain of the velocity correction, 1")
    K: float = Field(description="damping, 1/s")

    @property
    def gains(self) -> AirGains:
        """The same for the model."""
        return AirGains(self.T_V_s, self.k_V, self.K)


class AttitudeChannelGains(_Settings):
    """Gains of the attitude channel."""

    T_U_s: float = Field(description="time constant T_U of the attitude correction, s")
    k_U: float = Field(description="gain of the attitude correction, 1")
    K_U: float = Field(description="damping, 1/s")
    k_omega: float = Field(description="gain of the gyros' bias, 1/s")

    @property
    def gains(self) -> AttitudeGains:
        """The same for the model."""
        return AttitudeGains(self.T_U_s, self.k_U, self.K_U, self.k_omega)


class LiftPlan(_Settings):
    """The lift curve of an aircraft, which tells its angle of attack."""

    zero_lift_deg: float = Field(-2.0, gt=-45, lt=45, description="angle of attack without lift, degrees")
    cruise_deg: float = Field(2.0, gt=-45, lt=45, description="angle of attack in level flight, degrees")
    cruise_speed_m_s: float = Field(gt=0, le=1000, description="true air speed of that flight, m/s")
    stall_speed_m_s: float = Field(
        gt=0, le=1000, description="true air speed below which the wing does not carry, m/s"
    )

    @property
    def lift(self) -> Lift:
        """The same in SI."""
        zero, cruise = np.deg2rad([self.zero_lift_deg, self.cruise_deg])
        return Lift(
            zero_lift=float(zero),
            cruise=float(cruise),
            cruise_speed=self.cruise_speed_m_s,
            stall_speed=self.stall_speed_m_s,
        )


class LoopPlan(_Settings):
    """The correction loops."""

    gains: Literal["printed", "tuned"] = Field(
        "tuned",
        description="gains where none are stated: those of the source, or ours for sensors with noise",
    )
    satellites: SatelliteGains | None = Field(None, description="gains with satellites, in place of those")
    air: AirDataGains | None = Field(None, description="gains with air data in an outage, in place of those")
    attitude: AttitudeChannelGains | None = Field(
        None, description="gains of the attitude, in place of those"
    )
    references: Literal["propagated", "held", "held_difference"] = Field(
        "propagated", description="what the references do between two measurements"
    )
    attitude_reference: Literal["A", "M", "X", "none"] = Field(
        "A",
        description="A: gravity by accelerometers and air speed, and magnetic yaw; M: the direction of the "
        "magnetic field first, gravity second; X: the external attitude; none: the attitude is left as it is",
    )
    lift: LiftPlan | None = Field(
        None, description="lift curve of an aircraft; None: the air comes along body axis 1"
    )
    wind_time_s: float = Field(_LOOPS.wind_time_constant, gt=0, description="of the mean of the wind, s")
    barometer_time_s: float = Field(
        _LOOPS.barometer_time_constant, gt=0, description="of the mean of the barometer's bias, s"
    )
    reseat_after_s: float = Field(
        _LOOPS.reseat_after, gt=0, description="outage after which the integrators are set anew, s"
    )

    @property
    def loop_gains(self) -> LoopGains:
        """All of them."""
        usual = PRINTED if self.gains == "printed" else TUNED
        return LoopGains(
            self.satellites.gains if self.satellites else usual.gnss,
            self.air.gains if self.air else usual.air,
            self.attitude.gains if self.attitude else usual.attitude,
        )

    def settings(self, stale: float) -> LoopSettings:
        """The same for the model, which counts an aid as lost after so many of its intervals."""
        return LoopSettings(
            gains=self.loop_gains,
            attitude=None if self.attitude_reference == "none" else self.attitude_reference,
            reference=self.references,
            wind_time_constant=self.wind_time_s,
            barometer_time_constant=self.barometer_time_s,
            stale_intervals=stale,
            reseat_after=self.reseat_after_s,
            lift=self.lift.lift if self.lift else None,
        )


class Settings(_Settings):
    """Methods side by side, the start, and what counts as an aid."""

    methods: tuple[Method, ...] = Field(
        ("strapdown", "loops", "filter", "smoother"), min_length=1, description="methods, side by side"
    )
    aids: tuple[AidName, ...] | None = Field(
        None, description="what aids the methods; None: every stream of the plan that can"
    )
    start_position: Literal["gnss", "plan", "truth"] = Field(
        "gnss",
        description="where the position at the start is from: the first fix, [navigate.start] or truth",
    )
    start_velocity: Literal["gnss", "plan", "truth", "rest"] = Field(
        "gnss", description="where the velocity at the start is from; rest: it is none"
    )
    start_attitude: Literal["plan", "external_attitude", "levelled", "truth"] | None = Field(
        None,
        description="where the attitude at the start is from; levelled: gravity and the magnetic field, at "
        "rest; None: [navigate.start], which must state it",
    )
    start: StartState = Field(default_factory=StartState, description="the state at the start")
    level_s: float = Field(10.0, gt=0, description="rest at the start over which it is levelled, s")
    earth_field: EarthFieldPlan | None = Field(
        None, description="the magnetic field of the Earth, needed with a magnetometer"
    )
    min_fix: float = Field(
        0.0,
        description="kind of fix from which on a position counts; of NavSatFix 0, of many receivers 1 or 3",
    )
    frozen_fixes: int = Field(
        10, ge=2, description="fewest measurements of an aid, bit for bit the same, that count as frozen"
    )
    stale: float = Field(
        2.5, ge=1, description="an aid is lost after so many of its intervals without a usable measurement"
    )
    max_coast_s: float = Field(
        1.0, ge=0, description="longest time without inertial samples that is bridged, s"
    )
    output_interval_s: float = Field(0.1, gt=0, description="between the rows of navigation, s")
    loops: LoopPlan = Field(default_factory=LoopPlan, description="the correction loops")
    filter: FilterPlan = Field(default_factory=FilterPlan, description="the filter and the smoother")

    @model_validator(mode="after")
    def _start_is_stated(self) -> Self:
        needed = {
            "start_position": ("latitude_deg", "longitude_deg", "height_m"),
            "start_velocity": ("velocity_m_s",),
            "start_attitude": ("yaw_deg", "pitch_deg", "roll_deg"),
        }
        faults = []
        for key, values in needed.items():
            missing = [value for value in values if getattr(self.start, value) is None]
            if getattr(self, key) == "plan" and missing:
                others = "choose another source" if key == "start_attitude" else "leave it out"
                remedy = f"add {missing[0]} = … to [navigate.start], or {others} for {key}"
                expected = f"{', '.join(values)} beside {key} = 'plan'"
                faults.append(Fault(("start",), expected, f"no {', '.join(missing)}", remedy))
        if faults:
            refuse(faults)
        return self
