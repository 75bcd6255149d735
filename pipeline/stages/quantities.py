"""The streams that a recording may hold, the quantities that each may record, and their channels.

A quantity's channels are measured in units of the dimension beside each (`pipeline.units`). A new stream is a
line here, a contract in ``schemas/`` and its case in `stages._stream_tables`.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

StreamName = Literal[
    "gyro",
    "reference",
    "gimbal",
    "turntable",
    "temperature",
    "accelerometer",
    "gnss_position",
    "gnss_velocity",
    "airspeed",
    "barometer",
    "magnetometer",
    "external_attitude",
    "truth_position",
    "truth_velocity",
    "truth_attitude",
]
Quantity = Literal[
    "angular_rate",
    "angle_increment",
    "euler_krylov",
    "quaternion",
    "gimbal_angles",
    "table_angle",
    "table_rate",
    "temperature",
    "specific_force",
    "velocity_increment",
    "geodetic_position",
    "ned_velocity",
    "airspeed",
    "pressure_altitude",
    "static_pressure",
    "magnetic_field",
    "yaw_pitch_roll",
]

_ANGLE, _RATE, _NUMBER = "angle", "angular rate", "pure number"
_LENGTH, _SPEED, _FORCE, _FIELD = "length", "speed", "acceleration", "magnetic flux density"

QUANTITIES: Mapping[Quantity, Mapping[str, str]] = MappingProxyType(
    {
        "angular_rate": {"p": _RATE, "q": _RATE, "r": _RATE},
        "angle_increment": {"p": _ANGLE, "q": _ANGLE, "r": _ANGLE},
        "euler_krylov": {"psi": _ANGLE, "theta": _ANGLE, "gamma": _ANGLE},
        "quaternion": {"w": _NUMBER, "x": _NUMBER, "y": _NUMBER, "z": _NUMBER},
        "gimbal_angles": {"alpha1": _ANGLE, "alpha2": _ANGLE},
        "table_angle": {"angle": _ANGLE},
        "table_rate": {"rate": _RATE},
        "temperature": {"temperature": "temperature"},
        "specific_force": {"x": _FORCE, "y": _FORCE, "z": _FORCE},
        "velocity_increment": {"x": _SPEED, "y": _SPEED, "z": _SPEED},
        "geodetic_position": {"latitude": _ANGLE, "longitude": _ANGLE, "height": _LENGTH, "fix": _NUMBER},
        "ned_velocity": {"north": _SPEED, "east": _SPEED, "down": _SPEED},
        "airspeed": {"airspeed": _SPEED},
        "pressure_altitude": {"altitude": _LENGTH},
        "static_pressure": {"pressure": "pressure"},
        "magnetic_field": {"x": _FIELD, "y": _FIELD, "z": _FIELD},
        "yaw_pitch_roll": {"yaw": _ANGLE, "pitch": _ANGLE, "roll": _ANGLE},
    }
)
"""The channels of each quantity, in order, and what their units measure."""

OPTIONAL: Mapping[Quantity, tuple[str, ...]] = MappingProxyType({"geodetic_position": ("fix",)})
"""Channels that a quantity may have, and serves without."""

STREAMS: Mapping[StreamName, tuple[Quantity, ...]] = MappingProxyType(
    {
        "gyro": ("angular_rate", "angle_increment"),
        "reference": ("euler_krylov", "quaternion"),
        "gimbal": ("gimbal_angles",),
        "turntable": ("table_angle", "table_rate"),
        "temperature": ("temperature",),
        "accelerometer": ("specific_force", "velocity_increment"),
        "gnss_position": ("geodetic_position",),
        "gnss_velocity": ("ned_velocity",),
        "airspeed": ("airspeed",),
        "barometer": ("pressure_altitude", "static_pressure"),
        "magnetometer": ("magnetic_field",),
        "external_attitude": ("quaternion", "yaw_pitch_roll"),
        "truth_position": ("geodetic_position",),
        "truth_velocity": ("ned_velocity",),
        "truth_attitude": ("quaternion", "yaw_pitch_roll"),
    }
)
"""The quantities that each stream may record."""

IN_PART: tuple[StreamName, ...] = ("gyro",)
"""Streams that need not have all their channels: a sensor may have one axis."""

WRAPPING: tuple[Quantity, ...] = ("gimbal_angles", "table_angle")
"""Quantities of encoders, which may begin again at 0."""

ATTITUDES: tuple[StreamName, ...] = ("reference", "external_attitude", "truth_attitude")
"""Streams that tell an attitude: the axes that it is told in may be turned too."""

TURNED: tuple[StreamName, ...] = ("gyro", "accelerometer", "magnetometer", *ATTITUDES)
"""Streams whose axes a rotation of the plan may turn to those of the body."""
