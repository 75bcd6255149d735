"""Payloads: each serialisation against bytes laid out by hand, or by the public libraries."""

from __future__ import annotations

import json
import struct
from contextlib import suppress
from decimal import Decimal

import numpy as np
import pyarrow as pa
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pipeline.formats.messages import payload_of
from pipeline.formats.payload import (
    Decoder,
    PayloadError,
    Schema,
    join_path,
    nanoseconds,
    numbers,
    parse_path,
)

NESTED = """\
std_msgs/Header header
bool ready
string label
uint8 flag
float64[3] fixed
Part[2] pair
Part[] parts
int16[] counts
int64 nanos
================================================================================
MSG: test/Part
int8 small
float32 value
string[] names
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def _store(ros1: bool):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(NESTED, "test/msg/Nested"))
    return store


def _nested(store, names: list[list[str]]):
    types = store.types
    part = types["test/msg/Part"]
    parts = [
        part(small=-i, value=np.float32(i + 0.5), names=strings) for i, strings in enumerate(names, start=1)
    ]
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](7, 8), "frame")
    return types["test/msg/Nested"](
        header, True, "a label", 9, np.array([1.0, -2.0, 3.5]), parts[:2], parts[2:],
        np.array([5, -6, 7], dtype=np.int16), -(2**62) - 1,
    )  # fmt: skip


@pytest.mark.parametrize(("encoding", "schema"), [("cdr", "ros2msg"), ("ros1", "ros1msg")])
@pytest.mark.parametrize(
    "names", [[[], []], [["x"], ["yy", "zzz"], ["wwww"]], [[], ["five5"], [], ["", "a"], ["b"]]]
)
def test_ros_payload_agrees_with_rosbags(encoding: str, schema: str, names: list[list[str]]) -> None:
    # the strings' lengths move everything behind them through all positions modulo 8
    store = _store(encoding == "ros1")
    message = _nested(store, names)
    serialise = store.serialize_cdr if encoding == "cdr" else store.serialize_ros1
    data = bytes(serialise(message, "test/msg/Nested"))
    payload = payload_of(Schema(encoding, schema, "test/msg/Nested", NESTED.encode()))
    paths = [field.path for field in payload.fields(data)]
    assert paths[:4] == ["header.stamp.sec", "header.stamp.nanosec", "ready", "flag"]
    row = dict(zip(paths, payload.extractor(paths, ())(data), strict=True))
    assert row["fixed[1]"] == -2.0
    assert row["ready"] == 1
    assert row["pair[1].value"] == 2.5
    assert [row[f"counts[{i}]"] for i in range(3)] == [5, -6, 7]
    assert row["nanos"] == -(2**62) - 1
    for index in range(len(names) - 2):
        assert row[f"parts[{index}].small"] == -(index + 3)
    assert f"parts[{len(names) - 2}].small" not in row
    times = payload.extractor((f"parts[{len(names)}].value",), (("header.stamp", 1), ("nanos", 1)))(data)
    assert times == [None, 7 * 10**9 + 8, -(2**62) - 1]  # a short sequence is null; integers are exact
    assert payload.header_stamp(data) == "header.stamp"


def test_big_endian_cdr_is_read() -> None:
    store = _store(ros1=False)
    data = bytes(store.serialize_cdr(_nested(store, [["x"], []]), "test/msg/Nested", little_endian=False))
    payload = payload_of(Schema("cdr", "ros2msg", "test/msg/Nested", NESTED.encode()))
    assert payload.extractor(("fixed[2]", "pair[0].value"), ())(data) == [3.5, 1.5]


@pytest.mark.parametrize("cut", [0, 3, 4, 11, -8, -1])
def test_ros_message_of_another_length_is_refused(cut: int) -> None:
    store = _store(ros1=False)
    data = bytes(store.serialize_cdr(_nested(store, [["x"], ["y"], ["z"]]), "test/msg/Nested"))
    payload = payload_of(Schema("cdr", "ros2msg", "test/msg/Nested", NESTED.encode()))
    with pytest.raises(PayloadError):
        payload.extractor(("fixed[0]",), ())(data[:cut])
    with pytest.raises(PayloadError, match="bytes"):
        payload.extractor(("fixed[0]",), ())(data + b"\0" * 8)
    assert payload.extractor(("fixed[0]",), ())(data + b"\0" * 3) == [1.0]  # CDR may pad to four bytes


@given(st.binary(max_size=200))
def test_hostile_ros_message_only_raises_payload_errors(data: bytes) -> None:
    for encoding, schema in (("cdr", "ros2msg"), ("ros1", "ros1msg")):
        payload = payload_of(Schema(encoding, schema, "test/msg/Nested", NESTED.encode()))
        prefix = b"\0\1\0\0" if encoding == "cdr" else b""
        extract = payload.extractor(("pair[1].value", "parts[3].value", "counts[1]"), (("header.stamp", 1),))
        for look in (extract, payload.fields):
            with suppress(PayloadError):
                look(prefix + data)


DOUBLING = "\n".join(
    ["T0 a\nT0 b"] + [f"{'=' * 80}\nMSG: test/T{i}\nT{i + 1} a\nT{i + 1} b" for i in range(60)]
    + [f"{'=' * 80}\nMSG: test/T60\nfloat64 x"]
)  # fmt: skip


@pytest.mark.parametrize(
    ("encoding", "text", "says"),
    [
        ("ros2msg", "float64 x\nnonsense!", "parsed"),
        ("ros2msg", "Self x\n" + "=" * 80 + "\nMSG: test/Self\nSelf y", "holds itself"),
        ("ros2msg", "Missing x", "lacks the type"),
        ("ros2msg", "wstring x", "lacks the type"),
        ("ros2msg", "int32 a\n---\nint32 b", "service"),
        ("ros2msg", DOUBLING, "too many members"),
        ("ros2msg", "int32 a\nfloat64[2] a", "two members"),
        ("ros2msg", "int32[-2] a", "-2 elements"),
        ("ros2idl", "module a { module msg { struct B { long double x; }; }; };", "float128"),
        ("ros2idl", "struct {", "parsed"),
        ("flatbuffer", "", "no decoder here"),
        ("", "", "does not define"),
    ],
)
def test_definition_that_cannot_be_used_is_refused(encoding: str, text: str, says: str) -> None:
    name = "a/msg/B" if encoding == "ros2idl" else "test/msg/Root"
    with pytest.raises(PayloadError, match=says):
        payload_of(Schema("cdr", encoding, name, text.encode()))


def test_members_without_bytes_cost_no_time() -> None:
    text = "Nothing[] many\n" + "=" * 80 + "\nMSG: test/Nothing\n"
    payload = payload_of(Schema("ros1", "ros1msg", "test/Root", text.encode()))
    assert payload.fields(struct.pack("<I", 2**32 - 1)) == ()


def test_idl_with_includes_is_read() -> None:
    text = (
        "=" * 80 + "\nIDL: a/msg/B\n// generated\n\n#include \"a/msg/C.idl\"\n\n"
        "module a { module msg { struct B { a::msg::C c; sequence<double> d; }; }; };\n"
        + "=" * 80 + "\nIDL: a/msg/C\nmodule a { module msg { struct C { int32 x; }; }; };\n"
    )  # fmt: skip
    payload = payload_of(Schema("cdr", "ros2idl", "a/msg/B", text.encode()))
    data = b"\0\1\0\0" + struct.pack("<iI2d", -3, 2, 0.5, 0.25)
    assert payload.extractor(("c.x", "d[1]"), ())(data) == [-3, 0.25]


def test_json_payload() -> None:
    schema = {"type": "object", "properties": {"gx": {"type": "number"}, "late": {"type": "number"}}}
    payload = payload_of(Schema("json", "jsonschema", "gyro", json.dumps(schema).encode()))
    message = (
        b'{"gx": 0.1, "nested": {"a": [1, {"b": true}]}, "dotted.key": 2, "word": "x", "none": null,'
        b' "t": 1700000000.123456789, "text": "1700000000.123456789",'
        b' "header": {"stamp": {"sec": 3, "nsec": 4}}}'
    )
    assert [field.path for field in payload.fields(message)] == [
        "gx", "late", "nested.a[0]", "nested.a[1].b", "dotted.key", "t", "header.stamp.sec",
        "header.stamp.nsec",
    ]  # fmt: skip
    fields = ("gx", "late", "nested.a[1].b", "dotted.key", "word", "none", "nested.a[7]")
    times = (("t", 10**9), ("text", 10**9), ("header.stamp", 1), ("gone", 1))
    row = payload.extractor(fields, times)(message)
    assert row == [
        0.1, None, 1.0, 2.0, None, None, None,
        1700000000123456789, 1700000000123456789, 3 * 10**9 + 4, None,
    ]  # fmt: skip
    assert payload.header_stamp(message) == "header.stamp"
    assert payload.header_stamp(b'{"timestamp": {"sec": 1, "nsec": 2}}') == "timestamp"


@pytest.mark.parametrize(
    "message",
    [b"", b"{", b"\xff", b"[" * 10**5, b'{"t": 1e999999999}', b'{"t": ' + b"9" * 5000 + b"}", b'{"t": 1e30}'],
)
def test_hostile_json_is_refused(message: bytes) -> None:
    payload = payload_of(Schema("json", "", "", b""))
    with pytest.raises(PayloadError):
        payload.extractor((), (("t", 1),))(message)


def _protobuf() -> tuple[Schema, type]:
    stamps = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamps)
    file = descriptor_pb2.FileDescriptorProto(name="a.proto", package="a", syntax="proto3")
    file.dependency.append(stamps.name)
    kinds = descriptor_pb2.FieldDescriptorProto
    vector = file.message_type.add(name="V")
    vector.field.add(name="x", number=1, type=kinds.TYPE_DOUBLE, label=kinds.LABEL_OPTIONAL)
    vector.field.add(
        name="self", number=2, type=kinds.TYPE_MESSAGE, type_name=".a.V", label=kinds.LABEL_OPTIONAL
    )
    root = file.message_type.add(name="Root")
    for number, (name, type_, type_name, label) in enumerate(
        (
            ("timestamp", kinds.TYPE_MESSAGE, ".google.protobuf.Timestamp", kinds.LABEL_OPTIONAL),
            ("rate", kinds.TYPE_MESSAGE, ".a.V", kinds.LABEL_OPTIONAL),
            ("many", kinds.TYPE_MESSAGE, ".a.V", kinds.LABEL_REPEATED),
            ("values", kinds.TYPE_FLOAT, "", kinds.LABEL_REPEATED),
            ("tick", kinds.TYPE_UINT64, "", kinds.LABEL_OPTIONAL),
            ("word", kinds.TYPE_STRING, "", kinds.LABEL_OPTIONAL),
        ),
        start=1,
    ):
        root.field.add(name=name, number=number, type=type_, type_name=type_name or None, label=label)
    files = descriptor_pb2.FileDescriptorSet(file=[file, stamps])  # the import stands behind its user
    pool = descriptor_pool.DescriptorPool()
    pool.Add(stamps)
    pool.Add(file)
    root_class = message_factory.GetMessageClass(pool.FindMessageTypeByName("a.Root"))
    return Schema("protobuf", "protobuf", "a.Root", files.SerializeToString()), root_class


def test_protobuf_payload() -> None:
    schema, root_class = _protobuf()
    message = root_class(tick=2**62 + 1, values=[0.5, 0.25])
    message.timestamp.seconds, message.timestamp.nanos = 5, 6
    message.many.add().x = -1.5
    data = message.SerializeToString()
    payload = payload_of(schema)
    assert [field.path for field in payload.fields(data)] == [
        "timestamp.seconds", "timestamp.nanos", "rate.x", "many[0].x", "values[0]", "values[1]", "tick",
    ]  # fmt: skip
    row = payload.extractor(
        ("rate.x", "many[0].x", "many[1].x", "values[1]"), (("timestamp", 1), ("tick", 1))
    )(data)
    assert row == [None, -1.5, None, 0.25, 5 * 10**9 + 6, 2**62 + 1]  # an absent message is null
    assert payload.extractor(("many[0].x",), ())(root_class(many=[{}]).SerializeToString()) == [0.0]
    assert payload.header_stamp(data) == "timestamp"
    for path, known in (
        ("rate", False),
        ("word", False),
        ("many.x", False),
        ("tick[0]", False),
        ("tick", True),
    ):
        assert payload.has(path) is known


def test_hostile_protobuf_is_refused() -> None:
    schema, _ = _protobuf()
    with pytest.raises(PayloadError):
        payload_of(schema).extractor(("tick",), ())(b"\xff\xff\xff")
    for data in (b"\xff", b"", schema.data[:-20]):
        with pytest.raises(PayloadError, match="descriptors"):
            payload_of(Schema("protobuf", "protobuf", "a.Root", data))


def test_columns_tell_null_from_nan() -> None:
    column = numbers([1, None, float("nan"), True])
    assert column.to_pylist()[:2] == [1.0, None]
    assert column.null_count == 1
    assert np.isnan(column[2].as_py())
    assert column.type == pa.float64()
    assert numbers([2**64]).to_pylist() == [2.0**64]


def test_decoder_reports_which_messages_fail() -> None:
    payload = payload_of(Schema("json", "", "", b""))
    batch = Decoder(payload.extractor(("a",), (("t", 1),)), 1, 1).decode([b'{"a":1,"t":2}', b"x", b'{"a":3}'])
    assert [column.to_pylist() for column in batch.columns] == [[1.0, 3.0], [2, None]]
    assert list(batch.failures) == [1]


@given(st.integers(-(2**63), 2**63 - 1))
def test_integer_times_are_exact(value: int) -> None:
    assert nanoseconds(value, 1) == value
    assert nanoseconds(Decimal(value).scaleb(-9), 10**9) == value
    assert nanoseconds(f"{Decimal(value).scaleb(-9):f}", 10**9) == value


def test_times_that_are_none() -> None:
    assert nanoseconds(float("nan"), 1) is None
    assert nanoseconds("noon", 1) is None
    assert nanoseconds(0.25, 10**9) == 250_000_000
    with pytest.raises(PayloadError, match="64-bit"):
        nanoseconds(2**63, 1)
    with pytest.raises(PayloadError, match="64-bit"):
        nanoseconds(1e300, 10**9)


def test_paths() -> None:
    assert parse_path("imu[1].gyro[0]") == ("imu", 1, "gyro", 0)
    assert parse_path("a") == ("a",)
    for wrong in ("", "[0]", "a..b", "a[", "a[x]", "a]", "a[-1]", ".a"):
        assert parse_path(wrong) is None
    assert join_path("", "a") == "a"
    assert join_path("a[1]", "b") == "a[1].b"
