"""How the samples of a navigation are recorded: the messages, and the columns, of each stream.

Messages hold north, east, down and body axes forward, right, down as they are: the test plan says so by its
channels. Positions are in degrees and metres, as `sensor_msgs/NavSatFix` wants them; all else is in SI.
A text file has angles in the unit that is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from pipeline import units as known
from pipeline.formats.base import Series
from pipeline.models.navigation_problem import AidName
from pipeline.models.strapdown import yaw_pitch_roll
from pipeline.simulate.navigation_settings import ImuOutput
from pipeline.simulate.streams import AngleUnit, Recorded, RecordedStream

_XYZ = ("x", "y", "z")
_ANGLES = ("angle", "angular rate")


@dataclass(frozen=True, slots=True)
class _Quantity:
    """A quantity: its channels with the dimension of each, and the message that carries it."""

    dimensions: Mapping[str, str]
    type: str
    paths: tuple[str, ...]


def _vector(channels: tuple[str, ...], dimension: str, type_: str, path: str) -> _Quantity:
    return _Quantity(dict.fromkeys(channels, dimension), type_, tuple(f"{path}.{axis}" for axis in _XYZ))


_IMU, _TRIPLE, _TWIST = (
    "sensor_msgs/msg/Imu",
    "geometry_msgs/msg/Vector3Stamped",
    "geometry_msgs/msg/TwistStamped",
)
_QUANTITIES: Mapping[str, _Quantity] = MappingProxyType(
    {
        "angular_rate": _vector(("p", "q", "r"), "angular rate", _IMU, "angular_velocity"),
        "specific_force": _vector(_XYZ, "acceleration", _IMU, "linear_acceleration"),
        "angle_increment": _vector(("p", "q", "r"), "angle", _TRIPLE, "vector"),
        "velocity_increment": _vector(_XYZ, "speed", _TRIPLE, "vector"),
        "geodetic_position": _Quantity(
            {"latitude": "angle", "longitude": "angle", "height": "length"},
            "sensor_msgs/msg/NavSatFix",
            ("latitude", "longitude", "altitude"),
        ),
        "ned_velocity": _vector(("north", "east", "down"), "speed", _TWIST, "twist.linear"),
        "airspeed": _Quantity({"airspeed": "speed"}, _TWIST, ("twist.linear.x",)),
        "pressure_altitude": _Quantity(
            {"altitude": "length"}, "geometry_msgs/msg/PointStamped", ("point.z",)
        ),
        "magnetic_field": _vector(
            _XYZ, "magnetic flux density", "sensor_msgs/msg/MagneticField", "magnetic_field"
        ),
        "quaternion": _Quantity(
            dict.fromkeys("wxyz", "pure number"),
            "geometry_msgs/msg/QuaternionStamped",
            tuple(f"quaternion.{channel}" for channel in "wxyz"),
        ),
        "yaw_pitch_roll": _Quantity(dict.fromkeys(("yaw", "pitch", "roll"), "angle"), "", ()),
    }
)
_SI: Mapping[str, str] = MappingProxyType(
    {
        "angle": "rad",
        "angular rate": "rad/s",
        "acceleration": "m/s^2",
        "speed": "m/s",
        "length": "m",
        "magnetic flux density": "T",
        "pure number": "1",
    }
)
AID_STREAMS: Mapping[AidName, tuple[str, str]] = MappingProxyType(
    {
        "position": ("gnss_position", "geodetic_position"),
        "velocity": ("gnss_velocity", "ned_velocity"),
        "airspeed": ("airspeed", "airspeed"),
        "altitude": ("barometer", "pressure_altitude"),
        "magnetic_field": ("magnetometer", "magnetic_field"),
        "attitude": ("external_attitude", "quaternion"),
    }
)
"""Stream and quantity of each aid."""

TRUTH_STREAMS = (
    ("truth_position", "geodetic_position"),
    ("truth_velocity", "ned_velocity"),
    ("truth_attitude", "quaternion"),
)
"""Stream and quantity of the truth."""


def inertial_streams(
    recorded: Recorded, output: ImuOutput, *, text: bool, angle_unit: AngleUnit
) -> list[RecordedStream]:
    """Gyros and accelerometers, in one message or in two.

    Parameters
    ----------
    recorded : Recorded
        Rates and specific forces, or their increments, shape (n, 6).
    output : {"rates", "increments"}
        Which of them.
    text : bool
        For a text file: columns with their units in the header. Else ROS messages.
    angle_unit : {"rad", "deg"}
        Unit of angles in a text file.
    """
    quantities = ("angular_rate", "specific_force")
    if output == "increments":
        quantities = ("angle_increment", "velocity_increment")
    streams = [
        stream(name, quantity, _part(recorded, columns), text=text, angle_unit=angle_unit)
        for name, quantity, columns in zip(
            ("gyro", "accelerometer"), quantities, (slice(3), slice(3, 6)), strict=True
        )
    ]
    if text or output == "increments":
        return streams
    columns = {path: values for one in streams for path, values in one.series.columns.items()}
    both = Series("/imu", _IMU, recorded.log_time, recorded.header_stamp, columns)
    return [
        RecordedStream(one.name, one.quantity, both.topic, one.fields, one.units, both) for one in streams
    ]


def stream(
    name: str, quantity: str, recorded: Recorded, *, text: bool, angle_unit: AngleUnit
) -> RecordedStream:
    """One stream as it is recorded; in a text file an attitude is in yaw, pitch, roll.

    Parameters
    ----------
    name, quantity : str
        As in the test plan.
    recorded : Recorded
        Values in SI and radians, an attitude as quaternions.
    text, angle_unit
        As of `inertial_streams`.
    """
    values = recorded.values
    if text and quantity == "quaternion":
        quantity, values = "yaw_pitch_roll", yaw_pitch_roll(values)
    what = _QUANTITIES[quantity]
    units = {channel: _unit(quantity, of, text, angle_unit) for channel, of in what.dimensions.items()}
    factors = np.array([known.FACTORS[of][units[channel]] for channel, of in what.dimensions.items()])
    paths = [f"{name}_{channel} ({unit})" for channel, unit in units.items()] if text else what.paths
    columns = dict(zip(paths, (values / factors).T, strict=True))
    series = Series(f"/{name}", "" if text else what.type, recorded.log_time, recorded.header_stamp, columns)
    fields = dict(zip(units, paths, strict=True))
    return RecordedStream(name, quantity, "" if text else series.topic, fields, units, series)


def _unit(quantity: str, dimension: str, text: bool, angle_unit: AngleUnit) -> str:
    """The unit of a channel."""
    if not text and quantity == "geodetic_position" and dimension == "angle":
        return "deg"
    if text and dimension in _ANGLES:
        return _SI[dimension].replace("rad", angle_unit)
    return _SI[dimension]


def _part(recorded: Recorded, columns: slice) -> Recorded:
    return Recorded(recorded.log_time, recorded.header_stamp, recorded.values[:, columns])
