"""ROS 2 bags: what is written is what rosbags reads; split, compressed, unclosed and damaged ones."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pipeline import formats
from pipeline.formats.base import RecordingError, Request

REQUEST = [Request("/t", ("data",))]
METADATA = "rosbag2_bagfile_information:\n  relative_file_paths: []\n  topics_with_message_count: []\n  "
CDR_HEADER = b"\0\1\0\0"


def _bag(
    path: Path,
    count: int = 50,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    mode: CompressionMode = CompressionMode.NONE,
) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(path, version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/t", "std_msgs/msg/Float64", typestore=store)
        for index in range(count):
            writer.write(connection, 1000 + index, CDR_HEADER + struct.pack("<d", index / 7))


def _plain_db3(path: Path, rows: list[tuple[int, int, object]], type_: str = "std_msgs/msg/Float64") -> None:
    """A .db3 as recorders before Iron wrote it: without definitions."""
    database = sqlite3.connect(path)
    database.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
    )
    database.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
    )
    database.execute("INSERT INTO topics VALUES (1, '/t', ?, 'cdr')", (type_,))
    database.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    database.commit()
    database.close()


def _row(index: int) -> tuple[int, int, bytes]:
    return (1, index, CDR_HEADER + struct.pack("<d", index / 7))


def test_round_trip_is_exact(tmp_path, series, requests_of, assert_same) -> None:
    path = tmp_path / "run"
    formats.write(path, series)
    assert_same(formats.read(path, requests_of(series)), series)
    assert formats.inspect(path).format == "ROS 2 bag"
    (tmp_path / "other").mkdir()
    again = tmp_path / "other" / "run"
    formats.write(again, series)
    for file in path.iterdir():
        assert (again / file.name).read_bytes() == file.read_bytes()


def test_public_reader_reads_what_is_written(tmp_path, series) -> None:
    path = tmp_path / "run"
    formats.write(path, series)
    with AnyReader([path]) as reader:
        (topic,) = [c for c in reader.connections if c.topic == "/reference"]
        messages = [(time, reader.deserialize(data, c.msgtype)) for c, time, data in reader.messages([topic])]
    w = np.array([message.quaternion.w for _, message in messages])
    assert w.tobytes() == series[1].columns["quaternion.w"].tobytes()
    assert [time for time, _ in messages] == series[1].log_time.tolist()
    assert messages[3][1].header.stamp.nanosec == series[1].header_stamp[3] % 10**9


@pytest.mark.parametrize("storage", list(StoragePlugin))
@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE])
def test_every_storage_and_compression_reads_alike(tmp_path, storage, mode) -> None:
    path = tmp_path / "bag"
    _bag(path, storage=storage, mode=mode)
    samples = formats.read(path, REQUEST)
    assert samples.losses == ()
    assert samples.tables["/t"]["data"].to_pylist() == [i / 7 for i in range(50)]
    assert samples.tables["/t"]["log_time"].to_pylist() == list(range(1000, 1050))


def test_damaged_compression_is_a_loss(tmp_path) -> None:
    for mode, name in ((CompressionMode.FILE, "file"), (CompressionMode.MESSAGE, "message")):
        path = tmp_path / name
        _bag(path, mode=mode)
        (file,) = path.glob("*.db3*")
        data = bytearray(file.read_bytes())
        data[data.index(b"\x28\xb5\x2f\xfd")] ^= 0xFF
        file.write_bytes(data)
        if name == "file":
            with pytest.raises(RecordingError, match="decompressed"):
                formats.read(path, REQUEST)
        else:
            (loss,) = formats.read(path, REQUEST).losses
            assert (loss.topic, loss.count) == ("/t", 1)


def test_missing_file_of_a_split_bag_is_a_loss(tmp_path) -> None:
    path = tmp_path / "bag"
    _bag(path)
    metadata = path / "metadata.yaml"
    text = metadata.read_text()
    assert "- bag.db3\n" in text
    shutil.copy(path / "bag.db3", path / "bag_2.db3")
    split = text.replace("- bag.db3\n", "- bag.db3\n  - ../elsewhere/bag_2.db3\n  - bag_3.db3\n", 1)
    metadata.write_text(split.replace("message_count: 50", "message_count: 150"))
    samples = formats.read(path, REQUEST)
    assert samples.tables["/t"]["data"].to_pylist() == [i / 7 for i in range(50)] * 2
    missing, counted = samples.losses
    assert "bag_3.db3" in missing.detail
    assert (counted.topic, counted.count) == ("/t", 50)


def test_file_without_definitions_takes_the_types_of_humble(tmp_path) -> None:
    path = tmp_path / "a.db3"
    _plain_db3(path, [_row(i) for i in range(5)])
    (topic,) = formats.inspect(path).topics
    assert topic.encoding == "cdr (ROS 2 Humble)"
    assert formats.read(path, REQUEST).tables["/t"]["data"].to_pylist() == [i / 7 for i in range(5)]


def test_rows_that_are_no_messages_are_losses(tmp_path) -> None:
    path = tmp_path / "a.db3"
    _plain_db3(path, [_row(0), (1, 1, None), (1, "noon", b""), (2, 3, b""), (1, 4, b"\0\1\0\0abc"), _row(5)])
    samples = formats.read(path, REQUEST)
    assert samples.tables["/t"]["data"].to_pylist() == [0.0, 5 / 7]
    assert {(loss.topic, loss.count) for loss in samples.losses} == {("/t", 2), ("", 1), ("/t", 1)}


@pytest.mark.parametrize("mode", ["WAL", "DELETE"])
def test_bag_that_was_not_closed_is_read_with_its_journal(tmp_path, mode) -> None:
    path = tmp_path / "a.db3"
    _plain_db3(path, [_row(i) for i in range(5)])
    database = sqlite3.connect(path)
    database.execute(f"PRAGMA journal_mode = {mode}")
    database.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", [_row(5)])
    if mode == "WAL":
        database.commit()
    else:
        database.execute("PRAGMA cache_spill = 1")
        database.execute("PRAGMA cache_size = 1")
        database.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
            [_row(i) for i in range(6, 3000)],
        )
    copy = tmp_path / "crashed"
    copy.mkdir()
    for file in tmp_path.glob("a.db3*"):
        shutil.copy(file, copy / file.name)
    before = {file.name: file.read_bytes() for file in copy.iterdir()}
    assert len(before) > 1
    table = formats.read(copy / "a.db3", REQUEST).tables["/t"]
    database.close()
    assert table.num_rows == (6 if mode == "WAL" else 5)  # what was not committed is rolled back
    assert {file.name: file.read_bytes() for file in copy.iterdir()} == before


def test_cut_database_is_read_as_far_as_it_goes(tmp_path) -> None:
    path = tmp_path / "a.db3"
    _plain_db3(path, [_row(i) for i in range(2000)])
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    samples = formats.read(path, REQUEST)
    count = samples.tables["/t"].num_rows
    assert 0 < count < 2000
    assert samples.tables["/t"]["data"].to_pylist() == [i / 7 for i in range(count)]
    cut, damaged = samples.losses
    assert cut.count == len(data) - len(data) * 2 // 3
    assert "damaged behind" in damaged.detail


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "its keys"),
        ("[", "no YAML"),
        ("rosbag2_bagfile_information: 3", "its keys"),
        (
            METADATA + "storage_identifier: x",
            "storage 'x'",
        ),
        (
            METADATA + "storage_identifier: mcap\n  compression_mode: FILE\n  compression_format: rar",
            "'rar'",
        ),
        ("a: &a [*a]", "its keys"),
        ("a: 2024-99-99", "its keys"),
        ("\0", "no YAML"),
    ],
)
def test_damaged_metadata_is_refused(tmp_path, text, says) -> None:
    (tmp_path / "metadata.yaml").write_text(text)
    with pytest.raises(RecordingError, match=says) as caught:
        formats.inspect(tmp_path)
    assert caught.value.exit_code == 3
    assert str(caught.value).isprintable()


def test_database_that_is_no_bag_is_refused(tmp_path) -> None:
    path = tmp_path / "a.db3"
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE x(y)")
    database.close()
    with pytest.raises(RecordingError, match="tables of a ROS 2 bag"):
        formats.inspect(path)


def test_name_that_sqlite_would_misread_is_refused(tmp_path, series) -> None:
    with pytest.raises(RecordingError, match="name without") as caught:
        formats.write(tmp_path / "run?1", series)
    assert caught.value.exit_code == 2
