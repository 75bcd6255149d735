"""The door to all containers: detection, and faults told in one line with the right exit code."""

from __future__ import annotations

import os
import resource
from dataclasses import replace

import numpy as np
import pytest

from pipeline import formats
from pipeline.formats.base import RecordingError


def _refused(path, code: int = 3) -> str:
    with pytest.raises(RecordingError) as caught:
        formats.inspect(path)
    assert caught.value.exit_code == code
    assert str(caught.value).isprintable()
    return str(caught.value)


def test_missing_file(tmp_path) -> None:
    assert "no such file" in _refused(tmp_path / "run.mcap")


def test_empty_file(tmp_path) -> None:
    (tmp_path / "run.mcap").touch()
    assert "empty file" in _refused(tmp_path / "run.mcap")


def test_unknown_content_names_the_formats(tmp_path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"\x7fELF\x02\x01\x01" + bytes(200))
    message = _refused(path)
    assert "MCAP" in message
    assert "ROS 1 bag" in message
    assert "7fELF" in message


@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run.DB3"])
def test_text_under_the_name_of_another_format(tmp_path, name) -> None:
    path = tmp_path / name
    path.write_text("t,p\n0.0,1.5\n0.1,2.5\n")
    assert "a binary recording" in _refused(path)
    path.rename(tmp_path / "run.log")
    assert formats.inspect(tmp_path / "run.log").topics[0].count == 2


def test_folder_that_is_no_bag(tmp_path, series) -> None:
    assert "metadata.yaml" in _refused(tmp_path)
    formats.write(tmp_path / "a.mcap", series)
    assert "'a.mcap'" in _refused(tmp_path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_file_without_rights(tmp_path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"x")
    path.chmod(0)
    assert "Permission denied" in _refused(path)


def test_name_of_a_file_stays_in_one_line(tmp_path) -> None:
    assert "no such file" in _refused(tmp_path / "run\n\x1b[31m.mcap")


@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run", "run.csv"])
def test_format_is_found_by_content_not_by_name(tmp_path, series, name) -> None:
    path = tmp_path / name
    formats.write(path, series[:1])
    container = formats.detect(path)
    other = tmp_path / "strange.name"
    path.rename(other)
    assert formats.detect(other) is container


def test_writing_replaces_a_file_whole_or_not_at_all(tmp_path, series) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"old")
    wrong = replace(series[0], columns={"angular_velocity.w": np.zeros(200)})
    with pytest.raises(RecordingError, match="did you mean 'angular_velocity"):
        formats.write(path, [wrong])
    assert path.read_bytes() == b"old"
    formats.write(path, series)
    assert formats.inspect(path).format == "MCAP"
    assert [p.name for p in tmp_path.iterdir()] == ["run.mcap"]


@pytest.mark.parametrize(
    ("name", "encoding", "says"),
    [
        ("run.xyz", "cdr", "a name that ends"),
        ("run.bag", "json", "MCAP"),
        ("nowhere/run.mcap", "cdr", "a folder that can be written"),
        (".", "cdr", "a name that is free"),
    ],
)
def test_what_cannot_be_written_is_the_users_fault(tmp_path, series, name, encoding, says) -> None:
    with pytest.raises(RecordingError, match=says) as caught:
        formats.write(tmp_path / name, series, encoding)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    "change",
    [
        {"message_type": "sensor_msgs/msg/Imus"},
        {"header_stamp": np.full(200, -1)},
        {"log_time": np.full(200, 2**62)},
    ],
)
def test_series_that_ros_cannot_hold_is_refused(tmp_path, series, change) -> None:
    with pytest.raises(RecordingError) as caught:
        formats.write(tmp_path / "run.mcap", [replace(series[0], **change)])
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run", "run.csv"])
def test_disk_that_takes_no_more_leaves_nothing_behind(tmp_path, series, name) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))  # less than any of the files takes
    try:
        with pytest.raises(RecordingError, match="room to write") as caught:
            formats.write(tmp_path / name, series[:1])
        assert caught.value.exit_code == 4
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []
