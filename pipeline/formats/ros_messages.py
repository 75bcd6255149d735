"""The messages that the writers know, in each serialisation.

All messages of a series have the same length, since their one string, ``frame_id``, is empty: ROS
serialisations are written as one NumPy record a message, with the offsets that alignment gives.
"""

from __future__ import annotations

import heapq
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from pipeline.errors import ExitCode
from pipeline.formats.base import RecordingError, Series, unknown_name
from pipeline.formats.payload import Schema, join_path
from pipeline.formats.ros_types import Array, Node, Primitive, Struct, Text, distribution_type

TYPES = (
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/MagneticField",
    "sensor_msgs/msg/NavSatFix",
    "geometry_msgs/msg/PointStamped",
    "geometry_msgs/msg/QuaternionStamped",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/Vector3Stamped",
    "sensor_msgs/msg/Temperature",
)
"""The message types that can be written."""

_LATEST = 2**31 * 10**9
"""ROS 2 keeps whole seconds in 32 bits, signed."""
_NOT_MEASURED = -1.0
"""What `sensor_msgs/Imu` asks for as first covariance of a quantity that is not measured."""
_PACKAGE = "gyrostand"


@dataclass(frozen=True, slots=True)
class Encoded:
    """A series ready for a container."""

    schema: Schema
    messages: Sequence[bytes]


def encode(series: Series, encoding: str) -> Encoded:
    """Serialise a series.

    Parameters
    ----------
    series : Series
        Its ``message_type`` is one of `TYPES`; fields without a column are zero.
    encoding : {"cdr", "ros1", "json", "protobuf"}
        The serialisation.

    Raises
    ------
    RecordingError
        If the type, a column or a time cannot be written.
    """
    if series.message_type not in TYPES:
        raise unknown_name(f"topic {series.topic!r}", "type", series.message_type, TYPES)
    return _ENCODERS[encoding](series, _columns(series))


def md5sum(message_type: str) -> str:
    """The checksum by which ROS 1 knows a type."""
    return get_typestore(Stores.ROS1_NOETIC).generate_msgdef(message_type)[1]


def in_time_order(series: Sequence[Series]) -> Iterator[tuple[int, int, int]]:
    """Number of the series, index and log time of each message, as a recorder would have met them.

    A series whose own log times step back keeps its order.
    """
    return iter(heapq.merge(*(_numbered(*one) for one in enumerate(series)), key=lambda message: message[2]))


def _numbered(number: int, series: Series) -> Iterator[tuple[int, int, int]]:
    for index, time in enumerate(series.log_time.tolist()):
        yield number, index, time


def _columns(series: Series) -> dict[str, NDArray[Any]]:
    """The values of each leaf that is not constant zero."""
    for times in (series.log_time, series.header_stamp):
        if len(times) and not 0 <= times.min() <= times.max() < _LATEST:
            raise RecordingError(
                f"topic {series.topic!r}",
                expected="times from 1970 to 2038, as ROS can hold",
                found=f"{times.min()} to {times.max()} ns",
                remedy="move the record in time",
                exit_code=ExitCode.USAGE,
            )
    leaves = [path for path, _ in _leaves(distribution_type(series.message_type, ros1=False), "")]
    for path in series.columns:
        if path not in leaves:
            raise unknown_name(f"topic {series.topic!r}", "field", path, leaves)
    second, fraction = np.divmod(series.header_stamp, 10**9)
    columns: dict[str, NDArray[Any]] = {"header.stamp.sec": second, "header.stamp.nanosec": fraction}
    columns |= {path: np.asarray(values, dtype=np.float64) for path, values in series.columns.items()}
    if series.message_type == "sensor_msgs/msg/Imu":
        for quantity in ("orientation", "angular_velocity", "linear_acceleration"):
            if not any(path.startswith(quantity) for path in series.columns):
                columns[f"{quantity}_covariance[0]"] = np.full(len(series.log_time), _NOT_MEASURED)
    return columns


def _leaves(node: Node, path: str) -> Iterator[tuple[str, Primitive | Text]]:
    """The numbers and strings of a type, in order."""
    if isinstance(node, Struct):
        for name, member in node.members:
            yield from _leaves(member, join_path(path, name))
    elif isinstance(node, Array):
        for index in range(node.length or 0):
            yield from _leaves(node.element, f"{path}[{index}]")
    else:
        yield path, node


def _encode_ros(series: Series, columns: dict[str, NDArray[Any]], *, cdr: bool) -> Encoded:
    type_ = distribution_type(series.message_type, ros1=not cdr)
    records = np.zeros(len(series.log_time), _record_type(type_, cdr=cdr))
    if cdr:
        records["encapsulation"] = 256  # the bytes 0, 1: plain CDR, little endian
        records["header.frame_id"] = 1  # the length of "" counts its closing zero
    else:
        records["header.seq"] = np.arange(len(records))
    for path, values in columns.items():
        records[path] = values
    store = get_typestore(Stores.ROS2_HUMBLE if cdr else Stores.ROS1_NOETIC)
    definition, _ = store.generate_msgdef(series.message_type, ros_version=2 if cdr else 1)
    name = series.message_type if cdr else series.message_type.replace("/msg/", "/")
    schema = Schema("cdr" if cdr else "ros1", "ros2msg" if cdr else "ros1msg", name, definition.encode())
    data, size = records.tobytes(), records.itemsize
    return Encoded(schema, [data[at : at + size] for at in range(0, len(data), size)])


def _record_type(type_: Struct, *, cdr: bool) -> np.dtype[np.void]:
    """One message as a NumPy record; offsets count from the message's first byte."""
    head = 4 if cdr else 0
    names, formats, offsets = (["encapsulation"], ["<u4"], [0]) if cdr else ([], [], [])
    end = head
    for path, leaf in _leaves(type_, ""):
        size, code = (4, "u4") if isinstance(leaf, Text) else (leaf.size, _code(leaf))
        if cdr:
            end += -(end - head) % size
        names.append(path)
        formats.append(f"<{code}")
        offsets.append(end)
        end += size + (1 if cdr and isinstance(leaf, Text) else 0)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": end})


def _code(leaf: Primitive) -> str:
    return np.dtype(leaf.code).str.lstrip("<|=")


def _encode_json(series: Series, columns: dict[str, NDArray[Any]]) -> Encoded:
    type_ = distribution_type(series.message_type, ros1=False)
    values = {path: column.tolist() for path, column in columns.items()}
    messages = [
        json.dumps(_json_value(type_, "", values, index), separators=(",", ":")).encode()
        for index in range(len(series.log_time))
    ]
    data = json.dumps(_json_schema(type_), separators=(",", ":")).encode()
    return Encoded(Schema("json", "jsonschema", series.message_type, data), messages)


def _json_value(node: Node, path: str, values: dict[str, list[Any]], index: int) -> Any:
    if isinstance(node, Struct):
        return {
            name: _json_value(member, join_path(path, name), values, index) for name, member in node.members
        }
    if isinstance(node, Array):
        return [_json_value(node.element, f"{path}[{i}]", values, index) for i in range(node.length or 0)]
    if isinstance(node, Text):
        return ""
    value = values[path][index] if path in values else 0
    return value if math.isfinite(value) else None  # JSON has no NaN


def _json_schema(node: Node) -> dict[str, Any]:
    if isinstance(node, Struct):
        return {"type": "object", "properties": {name: _json_schema(member) for name, member in node.members}}
    if isinstance(node, Array):
        return {"type": "array", "items": _json_schema(node.element)}
    if isinstance(node, Text):
        return {"type": "string"}
    return {"type": "number" if node.name.startswith("float") else "integer"}


def _encode_protobuf(series: Series, columns: dict[str, NDArray[Any]]) -> Encoded:
    type_ = distribution_type(series.message_type, ros1=False)
    file = descriptor_pb2.FileDescriptorProto(name=f"{_PACKAGE}.proto", package=_PACKAGE, syntax="proto3")
    _describe(type_, file, set())
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    full_name = f"{_PACKAGE}.{_last(type_)}"
    message_class = message_factory.GetMessageClass(pool.FindMessageTypeByName(full_name))
    values = {path: column.tolist() for path, column in columns.items()}
    messages = []
    for index in range(len(series.log_time)):
        message = message_class()
        _fill(message, type_, "", values, index)
        messages.append(message.SerializeToString(deterministic=True))
    data = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)
    return Encoded(Schema("protobuf", "protobuf", full_name, data), messages)


def _describe(type_: Struct, file: Any, done: set[str]) -> None:
    """Add a type, and those that it holds, to a protobuf file."""
    if type_.name in done:
        return
    done.add(type_.name)
    message = descriptor_pb2.DescriptorProto(name=_last(type_))
    kinds = descriptor_pb2.FieldDescriptorProto
    for number, (name, member) in enumerate(type_.members, 1):
        label = kinds.LABEL_REPEATED if isinstance(member, Array) else kinds.LABEL_OPTIONAL
        inner = member.element if isinstance(member, Array) else member
        field = message.field.add(name=name, number=number, label=label)
        if isinstance(inner, Struct):
            _describe(inner, file, done)
            field.type, field.type_name = kinds.TYPE_MESSAGE, f".{_PACKAGE}.{_last(inner)}"
        elif isinstance(inner, Primitive):
            field.type = {"i": kinds.TYPE_INT32, "u": kinds.TYPE_UINT32, "f": kinds.TYPE_DOUBLE}[
                np.dtype(inner.code).kind
            ]
        else:
            field.type = kinds.TYPE_STRING
    file.message_type.append(message)


def _last(type_: Struct) -> str:
    return type_.name.rpartition("/")[2]


def _fill(message: Any, type_: Struct, path: str, values: dict[str, list[Any]], index: int) -> None:
    for name, member in type_.members:
        here = join_path(path, name)
        if isinstance(member, Struct):
            inner = getattr(message, name)
            inner.SetInParent()
            _fill(inner, member, here, values, index)
        elif isinstance(member, Array):
            elements = (f"{here}[{i}]" for i in range(member.length or 0))
            getattr(message, name).extend(values[e][index] if e in values else 0.0 for e in elements)
        elif here in values:
            setattr(message, name, values[here][index])


_ENCODERS: dict[str, Callable[[Series, dict[str, NDArray[Any]]], Encoded]] = {
    "cdr": partial(_encode_ros, cdr=True),
    "ros1": partial(_encode_ros, cdr=False),
    "json": _encode_json,
    "protobuf": _encode_protobuf,
}
