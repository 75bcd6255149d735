"""MCAP: what is written is what the public reader reads; what is damaged is said."""

from __future__ import annotations

import io
import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex, DataEnd, Footer, Header
from mcap.writer import CompressionType, IndexType, RecordBuilder, Writer

from pipeline import formats
from pipeline.formats.base import RecordingError, Request, TimeField
from pipeline.formats.compression import MAX_CHUNK

MAGIC = b"\x89MCAP0\r\n"
SCHEMA = json.dumps({"type": "object", "properties": {"x": {"type": "number"}}}).encode()


def _json_file(path: Path, rows: list[dict], topic: str = "/t", schema: bytes = SCHEMA, **options) -> None:
    """An MCAP file of JSON messages, one a millisecond, by the public writer."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start()
        schema_id = writer.register_schema("gyro", "jsonschema", schema) if schema else 0
        channel = writer.register_channel(topic, "json", schema_id)
        for index, row in enumerate(rows):
            writer.add_message(channel, index * 10**6, json.dumps(row).encode(), index * 10**6 + 5)
        writer.finish()


@pytest.mark.parametrize("encoding", ["cdr", "ros1", "json", "protobuf"])
def test_round_trip_is_exact(tmp_path, series, requests_of, assert_same, encoding) -> None:
    path = tmp_path / "run.mcap"
    formats.write(path, series, encoding)
    assert_same(formats.read(path, requests_of(series)), series)
    inspection = formats.inspect(path)
    assert inspection.format == "MCAP"
    assert [(t.name, t.count, t.problem) for t in inspection.topics] == [
        ("/gyro", 200, None),
        ("/reference", 50, None),
    ]
    assert inspection.topics[0].clocks["header_stamp"] == (
        series[0].header_stamp[0],
        series[0].header_stamp[-1],
    )
    assert "angular_velocity.x" in [field.path for field in inspection.topics[0].fields]


@pytest.mark.parametrize("encoding", ["cdr", "ros1", "json", "protobuf"])
def test_public_reader_reads_what_is_written(tmp_path, series, encoding) -> None:
    path = tmp_path / "run.mcap"
    formats.write(path, series, encoding)
    with path.open("rb") as file:
        messages = list(make_reader(file, validate_crcs=True).iter_messages())
    assert len(messages) == sum(len(one.log_time) for one in series)
    assert [m.log_time for _, _, m in messages] == sorted(m.log_time for _, _, m in messages)
    assert {channel.message_encoding for _, channel, _ in messages} == {encoding}


def test_same_input_gives_same_bytes(tmp_path, series) -> None:
    for encoding in ("cdr", "json", "protobuf"):
        first, second = tmp_path / f"{encoding}1.mcap", tmp_path / f"{encoding}2.mcap"
        formats.write(first, series, encoding)
        formats.write(second, series, encoding)
        assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize(
    "options",
    [
        {"use_chunking": False},
        {"compression": CompressionType.NONE},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.ZSTD},
        {"index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False},
        {"repeat_channels": False, "repeat_schemas": False},
        {"enable_crcs": False},
    ],
)
def test_every_shape_of_file_reads_alike(tmp_path, options) -> None:
    path = tmp_path / "a.mcap"
    _json_file(path, [{"x": i / 3} for i in range(300)], chunk_size=500, **options)
    samples = formats.read(path, [Request("/t", ("x",))])
    assert samples.losses == ()
    assert samples.tables["/t"]["x"].to_pylist() == [i / 3 for i in range(300)]
    assert samples.tables["/t"].column_names == ["log_time", "publish_time", "x"]


def test_rows_stand_in_the_order_of_the_file(tmp_path) -> None:
    path = tmp_path / "a.mcap"
    times = [5, 3, 9, 9, 1]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/t", "json", 0)
        for time in times:
            writer.add_message(channel, time, b'{"x": %d}' % time, time)
        writer.finish()
    table = formats.read(path, [Request("/t", ("x",))]).tables["/t"]
    assert table["log_time"].to_pylist() == times
    assert table["x"].to_pylist() == times


def test_topic_of_two_types_and_an_absent_field(tmp_path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        one = writer.register_channel("/t", "json", 0)
        two = writer.register_channel("/t", "ros1", writer.register_schema("a/B", "ros1msg", b"float64 x\n"))
        bad = writer.register_channel("/bad", "cdr", writer.register_schema("a/B", "unknown", b""))
        writer.register_channel("/none", "json", 0)
        writer.add_message(one, 1, b'{"x": 1, "y": 2}', 1)
        writer.add_message(two, 2, struct.pack("<d", 2.5), 2)
        writer.add_message(one, 3, b"{}", 3)
        writer.add_message(bad, 3, b"", 3)
        writer.finish()
    table = formats.read(path, [Request("/t", ("x",)), Request("/t", ("y",))]).tables["/t"]
    assert table["x"].to_pylist() == [1.0, 2.5, None]
    assert table["y"].to_pylist() == [2.0, None, None]
    topics = {topic.name: topic for topic in formats.inspect(path).topics}
    assert "no decoder" in topics["/bad"].problem
    assert topics["/none"].count == 0
    with pytest.raises(RecordingError, match="no decoder") as caught:
        formats.read(path, [Request("/bad", ("x",))])
    assert caught.value.exit_code == 3


def test_times_from_fields(tmp_path) -> None:
    path = tmp_path / "a.mcap"
    rows = [{"x": 1, "t": 1700000000000001 + i, "s": {"sec": i, "nanosec": 7}} for i in range(3)]
    _json_file(path, rows)
    request = Request("/t", ("x",), (TimeField("t", "us"), TimeField("s", "ns")))
    table = formats.read(path, [request]).tables["/t"]
    assert table["t"].to_pylist() == [1700000000000001000 + i * 1000 for i in range(3)]
    assert table["s"].to_pylist() == [i * 10**9 + 7 for i in range(3)]


@pytest.mark.parametrize(
    ("request_", "says"),
    [
        (Request("/tt", ("x",)), "did you mean '/t'"),
        (Request("/t", ("X1",)), "found the field 'X1'"),
        (Request("/t", ("x",), (TimeField("x", "fortnight"),)), "unit of time"),
        (Request("/t", ("log_time",)), "name of a clock"),
    ],
)
def test_wrong_request_is_the_plans_fault(tmp_path, request_, says) -> None:
    path = tmp_path / "a.mcap"
    _json_file(path, [{"x": 1}])
    with pytest.raises(RecordingError, match=says) as caught:
        formats.read(path, [request_])
    assert caught.value.exit_code == 2


def test_one_time_field_in_two_units_is_the_plans_fault(tmp_path) -> None:
    path = tmp_path / "a.mcap"
    _json_file(path, [{"x": 1, "y": 2, "t": 3}])
    requests = [Request("/t", (field,), (TimeField("t", unit),)) for field, unit in (("x", "s"), ("y", "ms"))]
    with pytest.raises(RecordingError, match="one unit of time") as caught:
        formats.read(path, requests)
    assert caught.value.exit_code == 2


def test_hostile_names_stay_as_they_are_and_errors_stay_one_line(tmp_path) -> None:
    path = tmp_path / "a.mcap"
    topic = "/a\n\x1b[31m<script>"
    _json_file(path, [{"x\n": 1}], topic=topic, schema=b"")
    (found,) = formats.inspect(path).topics
    assert found.name == topic
    with pytest.raises(RecordingError) as caught:
        formats.read(path, [Request(topic, ("y",))])
    assert str(caught.value).isprintable()


def _with_chunk(path: Path, chunk: Chunk) -> None:
    """A file of one chunk, made record by record."""
    builder = RecordBuilder()
    Header("", "").write(builder)
    chunk.write(builder)
    DataEnd(0).write(builder)
    Footer(0, 0, 0).write(builder)
    path.write_bytes(MAGIC + builder.end() + MAGIC)


@pytest.mark.parametrize("declared", [2**30, 2**63, 1000, MAX_CHUNK])
def test_chunk_that_inflates_beyond_measure_is_refused(tmp_path, declared) -> None:
    # 1 GiB of zeros in 33 kB, and the same with a smaller size declared
    path = tmp_path / "bomb.mcap"
    packed = zstandard.compress(bytes(2**30))
    assert len(packed) < 40_000
    _with_chunk(path, Chunk("zstd", packed, 0, 0, 0, declared))
    with pytest.raises(RecordingError, match="bytes"):
        formats.inspect(path)


def test_lost_chunk_is_counted_by_its_index_and_the_rest_is_read(tmp_path) -> None:
    path = tmp_path / "a.mcap"
    _json_file(path, [{"x": i} for i in range(100)], chunk_size=500, compression=CompressionType.NONE)
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    second: ChunkIndex = summary.chunk_indexes[1]
    data[second.chunk_start_offset + second.chunk_length - 3] ^= 1
    path.write_bytes(data)
    samples = formats.read(path, [Request("/t", ("x",))])
    (loss,) = samples.losses
    assert (loss.topic, loss.unit) == ("/t", "messages")
    assert "checksum" in loss.detail
    kept = samples.tables["/t"]["x"].to_numpy()
    lost = sorted(set(range(100)) - set(kept.astype(int).tolist()))
    assert loss.count == len(lost) > 0
    assert (loss.start, loss.end) == (lost[0] * 10**6, lost[-1] * 10**6)
    assert np.all(np.diff(kept) > 0)


def test_cut_file_is_read_as_far_as_it_goes(tmp_path) -> None:
    path = tmp_path / "a.mcap"
    _json_file(path, [{"x": i} for i in range(100)], chunk_size=500)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 3])
    samples = formats.read(path, [Request("/t", ("x",))])
    count = samples.tables["/t"].num_rows
    assert 0 < count < 100
    assert samples.tables["/t"]["x"].to_pylist() == list(range(count))
    assert sum(loss.count for loss in samples.losses) > 0
    assert formats.inspect(path).topics[0].count == count


def test_reading_goes_on_behind_a_record_with_a_wrong_length(tmp_path) -> None:
    path = tmp_path / "a.mcap"
    _json_file(path, [{"x": i} for i in range(100)], chunk_size=500)
    with path.open("rb") as file:
        first, second = make_reader(file).get_summary().chunk_indexes[:2]
    data = bytearray(path.read_bytes())
    data[first.chunk_start_offset + 8] = 0xFF  # the highest byte of the record's length
    path.write_bytes(data)
    samples = formats.read(path, [Request("/t", ("x",))])
    by_bytes, by_count = samples.losses
    assert by_bytes.count == second.chunk_start_offset - first.chunk_start_offset
    assert by_count.count == 100 - samples.tables["/t"].num_rows
    assert samples.tables["/t"]["x"].to_pylist()[-1] == 99


def test_damage_without_chunks_fails_the_data_sections_checksum(tmp_path) -> None:
    path = tmp_path / "a.mcap"
    _json_file(path, [{"x": 1.25}], use_chunking=False, enable_data_crcs=True)
    data = path.read_bytes()
    path.write_bytes(data.replace(b"1.25", b"7.25"))
    samples = formats.read(path, [Request("/t", ("x",))])
    assert "checksum of the data section" in samples.losses[0].detail


def test_message_of_no_channel_and_time_beyond_64_bits(tmp_path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/t", "json", 0)
        writer.add_message(channel, 1, b'{"x": 1}', 1)
        writer.add_message(channel, 2**63, b'{"x": 2}', 1)
        writer.add_message(9, 1, b"{}", 1)
        writer.finish()
    samples = formats.read(path, [Request("/t", ("x",))])
    assert samples.tables["/t"]["x"].to_pylist() == [1.0]
    assert sorted(loss.count for loss in samples.losses) == [1, 1]


def test_checksum_of_the_written_data_section_is_there(tmp_path, series) -> None:
    path = tmp_path / "run.mcap"
    formats.write(path, series)
    data = path.read_bytes()
    with path.open("rb") as file:
        end = make_reader(file).get_summary().chunk_indexes[-1]
    at = end.chunk_start_offset + end.chunk_length + end.message_index_length
    opcode, length, stored = struct.unpack_from("<BQI", data, at)
    assert (opcode, length) == (0x0F, 4)
    assert stored == zlib.crc32(data[:at])
    assert io.BytesIO(data).read(8) == MAGIC
