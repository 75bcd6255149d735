"""What ``gyrostand inspect`` says of a recording, against one whose content is known."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pipeline.describe import as_dict, as_text
from pipeline.formats.base import Field, Inspection, Loss, Topic

MESSAGES = Topic(
    name="/gyro",
    message_type="sensor_msgs/msg/Imu",
    encoding="cdr (ros2msg)",
    count=401,
    fields=(Field("angular_velocity.x", "float64"), Field("temperature", "float32", "K")),
    clocks={"header_stamp": (0, 999_000_000), "log_time": (500, 1_000_000_500)},
)
SILENT = Topic("/silent", "a/msg/B", "cdr", 0, (), {}, problem="it has no decoder")
LOSS = Loss("/gyro", "the file ends early", 7, "messages")


def inspection(*topics: Topic, losses: tuple[Loss, ...] = ()) -> Inspection:
    return Inspection(Path("run7.mcap"), "MCAP", topics, losses)


def test_as_dict_is_json_and_has_everything() -> None:
    held = json.loads(json.dumps(as_dict(inspection(MESSAGES, SILENT, losses=(LOSS,)))))
    assert (held["recording"], held["format"]) == ("run7.mcap", "MCAP")
    assert held["duration"] == 1.0  # of the log time, though the stamps span less
    gyro, silent = held["topics"]
    assert (gyro["name"], gyro["type"], gyro["count"]) == ("/gyro", "sensor_msgs/msg/Imu", 401)
    assert gyro["clocks"]["log_time"] == {"first": 500, "last": 1_000_000_500, "rate": 400.0}
    assert gyro["clocks"]["header_stamp"]["rate"] == pytest.approx(400 / 0.999, rel=1e-15)
    assert gyro["fields"][1] == {"path": "temperature", "type": "float32", "unit": "K"}
    assert (silent["clocks"], silent["problem"]) == ({}, "it has no decoder")
    assert held["losses"] == [
        {"topic": "/gyro", "detail": "the file ends early", "count": 7, "unit": "messages"}
    ]


def test_as_text_is_for_reading() -> None:
    lines = as_text(inspection(MESSAGES, SILENT, losses=(LOSS,))).splitlines()
    assert lines[0] == "run7.mcap: MCAP, 2 topics, 1 s"
    assert lines[1] == "/gyro  sensor_msgs/msg/Imu  cdr (ros2msg)  401 samples"
    assert lines[3] == "    log_time      500 … 1000000500 ns, 1 s, mean 400 Hz"
    assert lines[5] == "    temperature  float32  K"
    assert lines[-2] == "    cannot be decoded: it has no decoder"
    assert lines[-1] == "lost: /gyro: the file ends early (7 messages)"


def test_what_no_clock_tells_has_no_duration_and_no_rate() -> None:
    text = Topic("", "row", "text", 3, (Field("t (s)", "float64", "s"),), {})
    assert as_dict(inspection(text))["duration"] is None
    assert as_text(inspection(text)).startswith("run7.mcap: MCAP, 1 topics, no clock\n(the file)  row")
    once = Topic("/once", "a/msg/B", "cdr", 1, (), {"log_time": (5, 5)})
    assert as_dict(inspection(once))["topics"][0]["clocks"]["log_time"]["rate"] is None


def test_a_hostile_name_reaches_no_terminal() -> None:
    hostile = Topic("/a\n\x1b[31m", "x", "json", 0, (Field("\x07bell", "number", "\x1b"),), {})
    lines = as_text(inspection(hostile)).splitlines()
    assert len(lines) == 3
    assert all(line.isprintable() for line in lines)
    assert lines[1].startswith(r"/a\n\x1b[31m  x")
    assert as_dict(inspection(hostile))["topics"][0]["name"] == "/a\n\x1b[31m"  # JSON escapes it itself
