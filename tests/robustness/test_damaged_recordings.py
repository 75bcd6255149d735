"""Damaged recordings: of each container a small file is cut at 50 places, and 200 single bytes are changed.

The only outcomes allowed are the right values, a `Loss` beside values, or a `RecordingError` in one line with
exit code 3; where the container has checksums over its payloads, no row that is returned may be wrong.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pipeline import formats
from pipeline.errors import ExitCode
from pipeline.formats import mcap
from pipeline.formats.base import RecordingError, Request, Samples, Series

COUNT = 60
CUTS = 50
FLIPS = 200
SEED = 20240229


def _series() -> list[Series]:
    rng = np.random.default_rng(SEED)
    time = 1_700_000_000_000_000_000 + np.arange(COUNT, dtype=np.int64) * 2_500_000
    rates = {f"vector.{axis}": rng.normal(size=COUNT) for axis in "xyz"}
    quaternion = {f"quaternion.{part}": rng.normal(size=COUNT // 2) for part in "wxyz"}
    return [
        Series("/gyro", "geometry_msgs/msg/Vector3Stamped", time + 5, time, rates),
        Series(
            "/reference",
            "geometry_msgs/msg/QuaternionStamped",
            time[::2] + 3,
            time[::2],
            quaternion,
        ),
    ]


REQUESTS = [Request(one.topic, tuple(one.columns)) for one in _series()]


def _mcap(folder: Path, monkeypatch: pytest.MonkeyPatch, encoding: str) -> Path:
    monkeypatch.setattr(mcap, "_CHUNK_SIZE", 1500)  # several chunks, so that a part can be lost
    path = folder / "run.mcap"
    formats.write(path, _series(), encoding)
    return path


def _unchunked(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    from mcap.writer import Writer

    path = folder / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False, enable_data_crcs=True)
        writer.start()
        for one in _series():
            channel = writer.register_channel(one.topic, "json", 0)
            for index, time in enumerate(one.log_time.tolist()):
                row = {path.split(".")[1]: column[index] for path, column in one.columns.items()}
                data = json.dumps({next(iter(one.columns)).split(".")[0]: row}).encode()
                writer.add_message(channel, time, data, time)
        writer.finish()
    return path


def _bag(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = folder / "run.bag"
    formats.write(path, _series())
    return path


def _db3(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    formats.write(folder / "run", _series())
    return folder / "run" / "run.db3"


def _metadata(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    formats.write(folder / "run", _series())
    return folder / "run" / "metadata.yaml"


MAKERS: dict[str, tuple[Callable[..., Path], bool]] = {
    "MCAP, CDR": (lambda f, m: _mcap(f, m, "cdr"), True),
    "MCAP, ROS 1": (lambda f, m: _mcap(f, m, "ros1"), True),
    "MCAP, JSON": (lambda f, m: _mcap(f, m, "json"), True),
    "MCAP, protobuf": (lambda f, m: _mcap(f, m, "protobuf"), True),
    "MCAP, no chunks": (_unchunked, False),
    "ROS 1 bag": (_bag, True),
    "db3": (_db3, False),
    "metadata.yaml": (_metadata, True),
}
"""How each file is made, and whether a checksum covers each payload, so that no row may be wrong."""


def _damages(data: bytes) -> Iterator[tuple[str, bytes]]:
    rng = np.random.default_rng(SEED)
    for at in np.linspace(0, len(data) - 1, CUTS).astype(int):
        yield f"cut at {at}", data[:at]
    for at in rng.integers(0, len(data), FLIPS):
        changed = bytearray(data)
        changed[at] ^= int(rng.integers(1, 256))
        yield f"byte {at} changed to {changed[at]}", bytes(changed)


def _rows(samples: Samples, topic: str) -> set[tuple[object, ...]]:
    table = samples.tables[topic]
    return set(zip(*(table[name].to_pylist() for name in sorted(table.column_names)), strict=True))


@pytest.mark.parametrize("kind", list(MAKERS))
def test_damage_is_never_silent(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make, checked = MAKERS[kind]
    file = make(tmp_path, monkeypatch)
    recording = file.parent if file.name == "metadata.yaml" else file
    sound = formats.read(recording, REQUESTS)
    assert sound.losses == ()
    truth = {request.topic: _rows(sound, request.topic) for request in REQUESTS}
    refused: list[tuple[str, RecordingError]] = []
    lossy = 0
    for what, data in _damages(file.read_bytes()):
        file.write_bytes(data)
        try:
            inspection = formats.inspect(recording)
            samples = formats.read(recording, REQUESTS)
        except RecordingError as error:
            refused.append((what, error))
            continue
        assert all(loss.detail.isprintable() and loss.count >= 0 for loss in inspection.losses), what
        rows = {topic: _rows(samples, topic) for topic in truth}
        lossy += bool(samples.losses)
        if checked:
            assert all(rows[topic] <= truth[topic] for topic in truth), what
        if not samples.losses and kind != "db3":  # SQLite has no checksum
            assert rows == truth, what
    for what, error in refused:
        # a name that was itself damaged makes the request wrong
        assert error.exit_code in (ExitCode.INPUT, ExitCode.USAGE), what
        assert str(error).isprintable(), what
    assert len(refused) + lossy > CUTS // 2  # the damage did reach the readers


@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run"])
def test_recording_without_its_end_keeps_its_beginning(name: str, tmp_path: Path) -> None:
    """A recorder that is killed leaves a file without an end; of three quarters, half must come back."""
    path = tmp_path / name
    rng = np.random.default_rng(SEED)
    count = 20_000  # several chunks of a megabyte
    time = np.arange(count, dtype=np.int64) * 10**6 + 10**9
    columns = {f"angular_velocity.{axis}": rng.normal(size=count) for axis in "xyz"}
    series = Series("/gyro", "sensor_msgs/msg/Imu", time, time, columns)
    formats.write(path, [series])
    file = path / "run.db3" if name == "run" else path
    with file.open("r+b") as open_file:
        open_file.truncate(file.stat().st_size * 3 // 4)
    samples = formats.read(path, [Request("/gyro", ("angular_velocity.x",))])
    table = samples.tables["/gyro"]
    assert table.num_rows > count // 2
    which = np.searchsorted(time, table["log_time"].to_numpy())
    assert np.all(np.diff(which) > 0)
    assert table["angular_velocity.x"].to_numpy().tobytes() == columns["angular_velocity.x"][which].tobytes()
    assert samples.losses
