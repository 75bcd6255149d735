"""Series to be written, and the comparison of what was read with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from pipeline.formats.base import Request, Samples, Series


def _series(count: int = 200) -> list[Series]:
    rng = np.random.default_rng(20240229)
    header = 1_700_000_000_000_000_001 + np.arange(count, dtype=np.int64) * 2_500_000
    rates = {f"angular_velocity.{axis}": rng.normal(size=count) for axis in "xyz"}
    # what a text or a zero-suppressing encoding would lose
    rates["angular_velocity.x"][:3] = (-0.0, 5e-324, np.nextafter(1.0, 2.0))
    quaternion = {f"quaternion.{part}": rng.normal(size=count // 4) for part in "wxyz"}
    return [
        Series("/gyro", "sensor_msgs/msg/Imu", header + 7, header, rates),
        Series(
            "/reference",
            "geometry_msgs/msg/QuaternionStamped",
            header[::4][: count // 4] + 3,
            header[::4][: count // 4],
            quaternion,
        ),
    ]


@pytest.fixture
def series() -> list[Series]:
    """Two topics whose messages interleave, one with a stamp that steps back."""
    gyro, reference = _series()
    header = gyro.header_stamp.copy()
    header[50] = header[10]
    return [replace(gyro, header_stamp=header), reference]


@pytest.fixture
def requests_of() -> Callable[[Sequence[Series]], list[Request]]:
    return lambda series: [Request(one.topic, tuple(one.columns)) for one in series]


@pytest.fixture
def assert_same() -> Callable[[Samples, Sequence[Series]], None]:
    """Check that what was read is what was written, double for double and nanosecond for nanosecond."""

    def check(samples: Samples, series: Sequence[Series]) -> None:
        assert samples.losses == ()
        for one in series:
            table = samples.tables[one.topic]
            assert table.num_rows == len(one.log_time)
            for path, values in one.columns.items():
                assert table[path].null_count == 0
                assert table[path].to_numpy().tobytes() == values.tobytes(), path
            assert table["header_stamp"].to_pylist() == one.header_stamp.tolist()
            assert table["log_time"].to_pylist() == one.log_time.tolist()

    return check
