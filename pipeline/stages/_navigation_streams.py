"""The tables of the streams of a navigation: inertial sensors, aids and truth."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from pipeline.models.standard_atmosphere import altitude_of_pressure
from pipeline.stages._axes import in_body_axes, named, turned, unit_quaternions
from pipeline.stages._samples import Float, Samples

POSITION = ("latitude", "longitude", "height")
VELOCITY = ("north", "east", "down")
ATTITUDE = ("yaw", "pitch", "roll")

CHANNELS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "accelerometer": ("x", "y", "z"),
        "accelerometer_increments": ("increment_x", "increment_y", "increment_z"),
        "gnss_position": POSITION,
        "gnss_velocity": VELOCITY,
        "airspeed": ("airspeed",),
        "barometer": ("altitude",),
        "magnetometer": ("x", "y", "z"),
        "external_attitude": ATTITUDE,
        "truth_position": POSITION,
        "truth_velocity": VELOCITY,
        "truth_attitude": ATTITUDE,
    }
)
"""The channels of each table that a sample cannot do without."""

TABLES = tuple(CHANNELS)
"""The tables that these streams become."""


def navigation_columns(samples: Samples) -> tuple[str, Mapping[str, Float]]:
    """The table that the stream becomes, and its channels in body axes, or north, east and down."""
    match samples.stream.quantity:
        case "velocity_increment":
            names = CHANNELS["accelerometer_increments"]
            return "accelerometer_increments", named(names, in_body_axes(samples))
        case "specific_force" | "magnetic_field":
            return samples.name, named(samples.channels, in_body_axes(samples))
        case "static_pressure":
            pressure = samples.values[:, 0]
            return "barometer", {"pressure": pressure, "altitude": altitude_of_pressure(pressure)}
        case "quaternion":
            quaternion = turned(unit_quaternions(samples), samples.stream)
            return samples.name, named(ATTITUDE, _yaw_pitch_roll(quaternion))
        case "yaw_pitch_roll":
            return samples.name, named(ATTITUDE, _angles(samples))
        case _:
            return samples.name, named(samples.channels, samples.values)


def _angles(samples: Samples) -> Float:
    """The angles as recorded, unless axes are to be turned: then through quaternions."""
    if samples.stream.rotation is None and samples.stream.reference_rotation is None:
        return samples.values
    from pipeline.models.strapdown import quaternion_from_yaw_pitch_roll  # compiled: see below

    quaternion = quaternion_from_yaw_pitch_roll(samples.values)
    return _yaw_pitch_roll(turned(quaternion, samples.stream))


def _yaw_pitch_roll(quaternion: Float) -> Float:
    """The angles of attitudes. Plans are read without what is compiled, which takes long to import."""
    from pipeline.models.strapdown import yaw_pitch_roll

    return yaw_pitch_roll(quaternion)
