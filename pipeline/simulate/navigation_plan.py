"""What the test plan of a simulated navigation says beside its streams: start, field, lift, known biases."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from pipeline.models.navigation_filter_settings import MeasurementNoise
from pipeline.models.navigation_problem import Start
from pipeline.models.strapdown import yaw_pitch_roll
from pipeline.simulate.navigation_settings import NavigationSettings
from pipeline.simulate.plan import Value

Sections = dict[str, Mapping[str, Value]]


def sections(settings: NavigationSettings, start: Start) -> Sections:
    """Sections of the test plan.

    Parameters
    ----------
    settings : NavigationSettings
    start : Start
        The state that navigation starts from, with its errors.
    """
    latitude, longitude = _degrees([start.latitude, start.longitude], 12)
    yaw, pitch, roll = _degrees(yaw_pitch_roll(start.attitude))
    stated: Sections = {
        "navigate": dict.fromkeys(("start_position", "start_velocity", "start_attitude"), "plan"),
        "navigate.start": {
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "height_m": round(start.height, 6),
            "velocity_m_s": (np.round(start.velocity, 9) + 0.0).tolist(),
            "yaw_deg": yaw,
            "pitch_deg": pitch,
            "roll_deg": roll,
        },
    }
    if "magnetic_field" in settings.aids:
        field = settings.earth_field
        dip, declination = _degrees([field.dip, field.declination])
        stated["navigate.earth_field"] = {
            "strength_ut": round(field.strength * 1e6, 9),
            "dip_deg": dip,
            "declination_deg": declination,
        }
    lift = settings.flight.lift
    if lift is not None:
        zero_lift, cruise = _degrees([lift.zero_lift, lift.cruise])
        stated["navigate.loops.lift"] = {
            "zero_lift_deg": zero_lift,
            "cruise_deg": cruise,
            "cruise_speed_m_s": lift.cruise_speed,
            "stall_speed_m_s": lift.stall_speed,
        }
        if "airspeed" in settings.aids:
            # What flies by such a curve keeps its nose in the air's way: gusts across it are as those along.
            stated["navigate.filter.measurement"] = {"sideslip_m_s": MeasurementNoise().airspeed}
    errors = settings.errors
    known: dict[str, Value] = {}
    if errors.gyro_wander is None:
        known["gyro_bias_deg_s"] = _degrees(errors.gyro_bias, 12)
    if errors.accelerometer_wander is None:
        known["accelerometer_bias_m_s2"] = list(errors.accelerometer_bias)
    return stated | ({"score_navigation": known} if known else {})


def _degrees(angles: ArrayLike, decimals: int = 9) -> list[float]:
    """Angles in degrees, so rounded that the last digits of a machine's sines are not in them."""
    return [float(angle) for angle in np.round(np.rad2deg(angles), decimals)]
