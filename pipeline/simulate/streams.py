"""How simulated samples are recorded: as ROS messages in SI, or as columns of a text file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline import units
from pipeline.formats.base import Series

Float = NDArray[np.float64]
Time = NDArray[np.int64]
AngleUnit = Literal["rad", "deg"]
TableQuantity = Literal["table_angle", "table_rate"]
COUNTS = "counts"
"""In the column's name of a text file, of an encoder that gives whole counts."""


@dataclass(frozen=True, slots=True)
class _Message:
    """The message that carries a quantity: its type, the field of each channel, their unit."""

    type: str
    fields: Mapping[str, str]
    unit: str


_MESSAGES: Mapping[str, _Message] = MappingProxyType(
    {
        "angular_rate": _Message(
            "sensor_msgs/msg/Imu",
            {"p": "angular_velocity.x", "q": "angular_velocity.y", "r": "angular_velocity.z"},
            "rad/s",
        ),
        "angle_increment": _Message(
            "geometry_msgs/msg/Vector3Stamped", {"p": "vector.x", "q": "vector.y", "r": "vector.z"}, "rad"
        ),
        "quaternion": _Message(
            "geometry_msgs/msg/QuaternionStamped",
            {channel: f"quaternion.{channel}" for channel in "wxyz"},
            "1",
        ),
    }
)
_COLUMNS: Mapping[str, tuple[tuple[str, str, str], str]] = MappingProxyType(
    {
        "angular_rate": (("p", "q", "r"), "/s"),
        "angle_increment": (("p", "q", "r"), ""),
        "euler_krylov": (("psi", "theta", "gamma"), ""),
    }
)
"""The columns of a quantity in a text file, and what their unit has after that of the angle."""
_GIMBAL = ("vector.x", "vector.y")
"""Where a message carries alpha1 and alpha2."""
_TABLE = "vector.z"
"""Where a message carries the angle, or the rate, of a table."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """Samples as recorded: clocks [ns], shape (n,), and values in SI, shape (n, k)."""

    log_time: Time
    header_stamp: Time
    values: Float


@dataclass(frozen=True, slots=True)
class RecordedStream:
    """A stream of a simulated recording.

    Attributes
    ----------
    name, quantity : str
        As in the test plan.
    topic : str
        Topic; "" in a text file.
    fields : mapping of str to str
        Field, or column of a text file, of each channel.
    units : mapping of str to str
        Unit of each channel, after the scale.
    series : Series
        What is written; streams of one topic share it.
    scale : float
        Units a count.
    wraps_at : float, optional
        Value at which the channels begin again at 0, before the scale; None: nowhere.
    """

    name: str
    quantity: str
    topic: str
    fields: Mapping[str, str]
    units: Mapping[str, str]
    series: Series
    scale: float = 1.0
    wraps_at: float | None = None


def as_messages(
    name: str, quantity: str, recorded: Recorded, only: Sequence[str] | None = None
) -> RecordedStream:
    """A stream of ROS messages, in SI, on the topic of its name; of all channels, or of some."""
    message = _MESSAGES[quantity]
    fields = {channel: path for channel, path in message.fields.items() if only is None or channel in only}
    series = Series(
        topic=f"/{name}",
        message_type=message.type,
        log_time=recorded.log_time,
        header_stamp=recorded.header_stamp,
        columns={path: recorded.values[:, k] for k, path in enumerate(fields.values())},
    )
    units = dict.fromkeys(fields, message.unit)
    return RecordedStream(name, quantity, series.topic, fields, units, series)


def as_columns(
    name: str,
    quantity: str,
    recorded: Recorded,
    angle_unit: AngleUnit,
    only: Sequence[str] | None = None,
) -> RecordedStream:
    """Columns of a text file, with their unit in the header; of all channels, or of some."""
    channels, per = _COLUMNS[quantity]
    unit = f"{angle_unit}{per}"
    values = recorded.values if angle_unit == "rad" else np.degrees(recorded.values)
    fields = {channel: f"{channel} ({unit})" for channel in channels if only is None or channel in only}
    series = Series(
        topic=f"/{name}",
        message_type="",
        log_time=recorded.log_time,
        header_stamp=recorded.header_stamp,
        columns={path: values[:, k] for k, path in enumerate(fields.values())},
    )
    return RecordedStream(name, quantity, "", fields, dict.fromkeys(fields, unit), series)


def gimbal(
    recorded: Recorded, unit: AngleUnit, *, text: bool, counts: int | None, wraps_at: float | None
) -> RecordedStream:
    """The gimbal angles as their encoders give them.

    Parameters
    ----------
    recorded : Recorded
        Clocks and alpha1, alpha2, in the unit or in counts.
    unit : {"rad", "deg"}
        Unit of an angle.
    text : bool
        For a text file: columns; else ROS messages.
    counts : int, optional
        Counts a turn, where the values are counts.
    wraps_at : float, optional
        Value at which they begin again at 0.
    """
    channels = ("alpha1", "alpha2")
    paths = [f"{c} {COUNTS}" if counts else f"{c} ({unit})" for c in channels] if text else _GIMBAL
    fields = dict(zip(channels, paths, strict=True))
    series = Series(
        topic="/gimbal",
        message_type="" if text else "geometry_msgs/msg/Vector3Stamped",
        log_time=recorded.log_time,
        header_stamp=recorded.header_stamp,
        columns={path: recorded.values[:, k] for k, path in enumerate(paths)},
    )
    topic = "" if text else series.topic
    turn = 360.0 if unit == "deg" else 2 * np.pi
    scale = turn / counts if counts else 1.0
    units = dict.fromkeys(fields, unit)
    return RecordedStream("gimbal", "gimbal_angles", topic, fields, units, series, scale, wraps_at)


def turntable(
    recorded: Recorded,
    quantity: TableQuantity,
    unit: str,
    *,
    text: bool,
    wraps_at: float | None,
    counts: int | None = None,
) -> RecordedStream:
    """The angle or the rate of a table.

    Parameters
    ----------
    recorded : Recorded
        Clocks and values in the unit, shape (n, 1).
    quantity : {"table_angle", "table_rate"}
        Which of them.
    unit : str
        Of the values.
    text : bool
        For a text file: a column; else ROS messages.
    wraps_at : float, optional
        Value at which an angle begins again at 0.
    counts : int, optional
        Counts a turn, where the values are counts.
    """
    channel = "angle" if quantity == "table_angle" else "rate"
    path = (f"table {channel} {COUNTS}" if counts else f"table {channel} ({unit})") if text else _TABLE
    series = Series(
        topic="/turntable",
        message_type="" if text else "geometry_msgs/msg/Vector3Stamped",
        log_time=recorded.log_time,
        header_stamp=recorded.header_stamp,
        columns={path: recorded.values[:, 0]},
    )
    topic = "" if text else series.topic
    turn = 360.0 if unit == "deg" else 2 * np.pi
    scale = turn / counts if counts else 1.0
    fields, units = {channel: path}, {channel: unit}
    return RecordedStream("turntable", quantity, topic, fields, units, series, scale, wraps_at)


def thermometer(recorded: Recorded, *, text: bool) -> RecordedStream:
    """The temperature of a gyro, from values in K: recorded in degrees Celsius."""
    unit = "degC"
    path = f"temperature ({unit})" if text else "temperature"
    series = Series(
        topic="/temperature",
        message_type="" if text else "sensor_msgs/msg/Temperature",
        log_time=recorded.log_time,
        header_stamp=recorded.header_stamp,
        columns={path: recorded.values[:, 0] - units.zero(unit)},
    )
    topic = "" if text else series.topic
    fields, stated = {"temperature": path}, {"temperature": unit}
    return RecordedStream("temperature", "temperature", topic, fields, stated, series)


def in_counts(stream: RecordedStream, unit: str, counts_per_unit: float) -> RecordedStream:
    """A stream of columns or messages whose values are counts of which so many are one of the unit."""
    scale, units = 1 / counts_per_unit, dict.fromkeys(stream.fields, unit)
    if stream.topic:
        return replace(stream, units=units, scale=scale)
    fields = {channel: f"{channel} {COUNTS}" for channel in stream.fields}
    columns = dict(zip(fields.values(), stream.series.columns.values(), strict=True))
    return replace(
        stream, fields=fields, units=units, scale=scale, series=replace(stream.series, columns=columns)
    )
