"""ROS 1 bags: what is written is what rosbags reads; without an index, or damaged, they are read too."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Reader, Writer

from pipeline import formats
from pipeline.formats.base import RecordingError, Request, TimeField

REQUEST = [Request("/t", ("x",))]


def _bag(path: Path, count: int = 100, compression: Writer.CompressionFormat | None = None) -> None:
    """A bag of numbers in several chunks, by the public writer."""
    writer = Writer(path)
    writer.chunk_threshold = 500
    if compression:
        writer.set_compression(compression)
    with writer:
        connection = writer.add_connection("/t", "a/msg/B", msgdef="float64 x\n", md5sum="0" * 32)
        for index in range(count):
            writer.write(connection, index * 10**6, struct.pack("<d", index))


def test_round_trip_is_exact(tmp_path, series, requests_of, assert_same) -> None:
    path = tmp_path / "run.bag"
    formats.write(path, series)
    assert_same(formats.read(path, requests_of(series)), series)
    again = tmp_path / "again.bag"
    formats.write(again, series)
    assert again.read_bytes() == path.read_bytes()


def test_public_reader_reads_what_is_written(tmp_path, series) -> None:
    path = tmp_path / "run.bag"
    formats.write(path, series)
    with AnyReader([path]) as reader:
        (gyro,) = [c for c in reader.connections if c.topic == "/gyro"]
        assert gyro.msgtype == "sensor_msgs/msg/Imu"
        messages = [(time, reader.deserialize(data, c.msgtype)) for c, time, data in reader.messages([gyro])]
    x = np.array([message.angular_velocity.x for _, message in messages])
    assert x.tobytes() == series[0].columns["angular_velocity.x"].tobytes()
    assert [time for time, _ in messages] == series[0].log_time.tolist()
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in messages]
    assert stamps == series[0].header_stamp.tolist()
    assert messages[0][1].orientation_covariance[0] == -1.0  # not measured, as sensor_msgs/Imu says it


@pytest.mark.parametrize("compression", [None, Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
def test_every_compression_reads_alike(tmp_path, compression) -> None:
    path = tmp_path / "a.bag"
    _bag(path, compression=compression)
    samples = formats.read(path, REQUEST)
    assert samples.losses == ()
    assert samples.tables["/t"]["x"].to_pylist() == list(range(100))
    assert samples.tables["/t"]["log_time"].to_pylist() == [i * 10**6 for i in range(100)]
    assert samples.tables["/t"].column_names == ["log_time", "x"]


def test_bag_that_was_not_closed_is_read(tmp_path) -> None:
    path = tmp_path / "a.bag"
    _bag(path)
    data = bytearray(path.read_bytes())
    with Reader(path) as reader:
        second = reader.chunk_infos[1].pos
    at = data.index(b"index_pos=") + len("index_pos=")
    data[at : at + 8] = bytes(8)
    path.write_bytes(data[: second + 200])
    samples = formats.read(path, REQUEST)
    count = samples.tables["/t"].num_rows
    assert 0 < count < 100
    assert samples.tables["/t"]["x"].to_pylist() == list(range(count))
    no_index, cut = samples.losses
    assert "no index" in no_index.detail
    assert (cut.count, cut.unit) == (200, "bytes")


def test_lost_chunk_is_counted_by_its_index_and_the_rest_is_read(tmp_path) -> None:
    path = tmp_path / "a.bag"
    _bag(path, compression=Writer.CompressionFormat.BZ2)
    with Reader(path) as reader:
        chunk = reader.chunks[reader.chunk_infos[1].pos]
        count = reader.chunk_infos[1].connection_counts[0]
    data = bytearray(path.read_bytes())
    data[chunk.datapos + chunk.datasize // 2] ^= 0x10
    path.write_bytes(data)
    samples = formats.read(path, REQUEST)
    (loss,) = samples.losses
    assert (loss.topic, loss.count, loss.unit) == ("/t", count, "messages")
    kept = samples.tables["/t"]["x"].to_pylist()
    lost = sorted(set(range(100)) - {int(x) for x in kept})
    assert len(lost) == count
    assert (loss.start, loss.end) == (lost[0] * 10**6, lost[-1] * 10**6)


def test_reading_goes_on_behind_a_damaged_record(tmp_path) -> None:
    path = tmp_path / "a.bag"
    _bag(path)
    with Reader(path) as reader:
        first, second = (info.pos for info in reader.chunk_infos[:2])
        count = reader.chunk_infos[0].connection_counts[0]
    data = bytearray(path.read_bytes())
    data[first + 3] = 0xFF  # the highest byte of the header's length
    path.write_bytes(data)
    samples = formats.read(path, REQUEST)
    damaged, counted = samples.losses
    assert damaged.count == second - first
    assert counted.count == count
    assert samples.tables["/t"]["x"].to_pylist() == list(range(count, 100))


def test_times_of_ros1_are_read_by_the_names_of_ros2(tmp_path) -> None:
    path = tmp_path / "a.bag"
    with Writer(path) as writer:
        connection = writer.add_connection(
            "/t", "a/msg/B", msgdef="time when\nduration long\n", md5sum="0" * 32
        )
        writer.write(connection, 1, struct.pack("<IIii", 2**32 - 1, 5, -1, -7))
    request = Request("/t", ("long.nanosec",), (TimeField("when", "ns"), TimeField("long", "ns")))
    table = formats.read(path, [request]).tables["/t"]
    assert table["when"].to_pylist() == [(2**32 - 1) * 10**9 + 5]  # seconds are unsigned in ROS 1
    assert table["long"].to_pylist() == [-(10**9) - 7]
    assert table["long.nanosec"].to_pylist() == [-7.0]


def test_messages_of_two_connections_of_one_topic_are_one_table(tmp_path) -> None:
    path = tmp_path / "a.bag"
    with Writer(path) as writer:
        connections = [
            writer.add_connection("/t", "a/msg/B", msgdef="float64 x\n", md5sum="0" * 32, callerid=caller)
            for caller in ("/one", "/two")
        ]
        for index in range(6):
            writer.write(connections[index % 2], index, struct.pack("<d", index))
    assert formats.read(path, REQUEST).tables["/t"]["x"].to_pylist() == list(range(6))
    assert len(formats.inspect(path).topics) == 1


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"#ROSBAG V1.2\n" + bytes(100), "version 2.0"),
        (b"#ROSBAG V2.0\n", "at least a part"),
        (b"#ROSBAG V2.0\n" + b"\xff" * 100, "at least a part"),
    ],
)
def test_bag_of_which_nothing_can_be_read_is_refused(tmp_path, content, says) -> None:
    path = tmp_path / "a.bag"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=says) as caught:
        formats.inspect(path)
    assert caught.value.exit_code == 3
