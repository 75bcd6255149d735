"""Recordings of others: each is inspected and, where it holds numbers, read, or refused in one clear line."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Reader

from pipeline import formats
from pipeline.formats.base import Inspection, RecordingError, Request

DATA = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"
FOLDERS = ("mcap", "bags", "malformed", "rosbag2_resources")
REFUSED = {
    "rosbagjs_empty-file.bag": "empty file",
    "rosbagjs_asci-file.bag": "binary recording, as .bag says, found text",
    "empty_dir": "metadata.yaml",
    "multiple_files": "metadata.yaml",
}
FIELDS_READ = 40
"""Fields read of each topic: enough to pass through every kind of member without taking minutes."""

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the recordings of others are not beside this checkout"
)


def _recordings() -> list[Path]:
    found: list[Path] = []
    for folder in FOLDERS:
        for path in sorted((DATA / folder).rglob("*")):
            bag = path.is_dir() and any(
                p.suffix in (".db3", ".mcap") or p.name == ".gitkeep" for p in path.iterdir()
            )
            container = folder == "rosbag2_resources" and path.name == "bags"
            if (bag and not container and folder == "rosbag2_resources") or path.suffix in (
                ".mcap",
                ".db3",
                ".bag",
            ):
                found.append(path)
    return found


def _name(path: Path) -> str:
    return str(path.relative_to(DATA))


@pytest.mark.parametrize("path", _recordings(), ids=_name)
def test_inspected_and_read_or_refused(path: Path) -> None:
    if path.name in REFUSED:
        with pytest.raises(RecordingError, match=REFUSED[path.name]) as caught:
            formats.inspect(path)
        assert caught.value.exit_code == 3
        assert str(caught.value).isprintable()
        return
    inspection = formats.inspect(path)
    assert inspection.losses == ()
    numeric = [topic for topic in inspection.topics if topic.fields and topic.count and not topic.problem]
    requests = [Request(t.name, tuple(f.path for f in t.fields[:FIELDS_READ])) for t in numeric]
    samples = formats.read(path, requests)
    assert samples.losses == ()
    for topic, request in zip(numeric, requests, strict=True):
        table = samples.tables[topic.name]
        assert table.num_rows == topic.count
        assert set(request.fields) <= set(table.column_names)
        for clock, (first, last) in topic.clocks.items():
            assert (table[clock][0].as_py(), table[clock][-1].as_py()) == (first, last)


CONFORMANCE = sorted((DATA / "mcap_conformance").rglob("*.mcap"))


@pytest.mark.parametrize("folder", sorted({path.parent.name for path in CONFORMANCE}))
def test_conformance_files_hold_what_their_records_say(folder: str) -> None:
    paths = [path for path in CONFORMANCE if path.parent.name == folder]
    assert paths
    for path in paths:
        expected: Counter[str] = Counter()
        topics: dict[str, str] = {}
        times: dict[str, list[int]] = {}
        for record in json.loads(path.with_suffix(".json").read_text())["records"]:
            fields = dict(record["fields"])
            if record["type"] == "Channel":
                topics[fields["id"]] = fields["topic"]
            elif record["type"] == "Message":
                topic = topics[fields["channel_id"]]
                expected[topic] += 1
                times.setdefault(topic, []).append(int(fields["log_time"]))
        inspection = formats.inspect(path)
        assert inspection.losses == (), path.name
        assert {t.name: t.count for t in inspection.topics if t.count} == dict(expected), path.name
        for topic in inspection.topics:
            if topic.count:
                assert topic.clocks["log_time"] == (times[topic.name][0], times[topic.name][-1]), path.name


def test_there_are_as_many_conformance_files_as_there_should_be() -> None:
    assert len(CONFORMANCE) == 416


@pytest.mark.parametrize("name", ["plotjuggler_tilt_laser.bag", "robot_localization_test1.bag"])
def test_bag_agrees_with_rosbags(name: str) -> None:
    path = DATA / "bags" / name
    inspection = formats.inspect(path)
    imu = next(topic for topic in inspection.topics if topic.message_type == "sensor_msgs/Imu")
    with Reader(path) as reader:
        assert {t: info.msgcount for t, info in reader.topics.items()} == {
            t.name: t.count for t in inspection.topics
        }
    with AnyReader([path]) as reader:
        connections = [c for c in reader.connections if c.topic == imu.name]
        messages = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections)]
    paths = ("angular_velocity.x", "orientation.w", "angular_velocity_covariance[8]")
    table = formats.read(path, [Request(imu.name, paths)]).tables[imu.name].sort_by("log_time")
    for field, get in zip(
        paths,
        (
            lambda m: m.angular_velocity.x,
            lambda m: m.orientation.w,
            lambda m: m.angular_velocity_covariance[8],
        ),
        strict=True,
    ):
        assert table[field].to_numpy().tobytes() == np.array([get(m) for m in messages]).tobytes()
    assert table["header_stamp"].to_pylist() == [
        m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages
    ]


def _topic(inspection: Inspection, name: str):
    return next(topic for topic in inspection.topics if topic.name == name)


def test_known_oddities() -> None:
    empty = formats.inspect(DATA / "malformed" / "webviz_empty_message_definition.bag")
    assert "does not define" in empty.topics[0].problem
    assert formats.inspect(DATA / "malformed" / "rosbagjs_no-messages.bag").topics == ()
    unsorted = formats.inspect(DATA / "malformed" / "rosbagjs_example-unsorted-chunks.bag")
    assert unsorted.topics[0].clocks["log_time"] == (2 * 10**9, 10**9)  # the order of the file
    mixed = formats.inspect(DATA / "mcap" / "mbp_alternate_bagfile_0.mcap")
    assert "'unknown'" in _topic(mixed, "/recover_fault/_action/feedback").problem
    assert _topic(mixed, "/robot/joint_override").problem is None
    resources = DATA / "rosbag2_resources"
    wrong = formats.inspect(resources / "rosbag2_tests/resources/sqlite3/wrong_rmw_test")
    assert {"'wrong_format'" in topic.problem for topic in wrong.topics} == {True}
    services = formats.inspect(resources / "rosbag2_cpp/test/rosbag2_cpp/bags/topics_and_services.mcap")
    assert "service" in _topic(services, "/add_two_ints/_service_event").problem
    with pytest.raises(RecordingError, match="service") as caught:
        formats.read(
            resources / "rosbag2_cpp/test/rosbag2_cpp/bags/topics_and_services.mcap",
            [Request("/add_two_ints/_service_event", ("info.stamp.sec",))],
        )
    assert caught.value.exit_code == 3


def test_storages_of_the_same_bag_agree() -> None:
    resources = DATA / "rosbag2_resources" / "rosbag2_tests" / "resources"
    request = [
        Request("/test_topic", ("float64_value", "int32_value")),
        Request("/array_topic", ("float32_values[1]",)),
    ]
    one, other = (formats.read(resources / kind / "cdr_test", request) for kind in ("sqlite3", "mcap"))
    for topic in ("/test_topic", "/array_topic"):
        assert one.tables[topic].equals(other.tables[topic].drop_columns("publish_time"))
