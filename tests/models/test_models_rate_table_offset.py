"""The time offset between gyro and table: within its standard error, whatever the clocks and the noise."""

from __future__ import annotations

import numpy as np
import pytest
import rate_table_records as records

from pipeline.models.rate_table_offset import TimeOffset, time_offset
from pipeline.models.rate_table_steps import Motion, RateTableError

DEGREE = records.DEGREE
CORNERS = records.corners(DEGREE * np.array([10.0, -10.0, 30.0, -30.0, 60.0, -60.0]), 10.0, 2.0)
GAIN, STEP = 1.01, 0.02


def estimated(
    seed: int, offset: float, *, tachometer: float, memory: float, gain: float = GAIN
) -> TimeOffset:
    """A gyro at 200 Hz by a clock of its own, begun 1 s before the table's record at 50 Hz."""
    rng = np.random.default_rng(seed)
    time, rate, angle = records.table(CORNERS, STEP)
    at = np.arange(-1.0, time[-1] + 1.0, 0.005) + 0.0003
    gyro = gain * np.interp(at - offset, CORNERS[:, 0], CORNERS[:, 1]) + 0.01
    gyro += records.white(rng, gyro.shape, 0.05 * DEGREE)
    if memory:
        gyro += records.coloured(rng, gyro.shape, 0.03 * DEGREE, memory, 0.005)
    if tachometer:
        motion = Motion.of_rate(time, rate + records.white(rng, rate.shape, tachometer))
    else:
        motion = Motion.of_angle(time, angle + records.white(rng, angle.shape, 1e-6))
    return time_offset(motion, at, gyro, longest=0.5)


@pytest.mark.parametrize(
    ("offset", "tachometer", "memory"),
    [(0.0137, 0.0, 0.0), (-0.2514, 0.0, 0.5), (0.01, 0.05 * DEGREE, 0.0)],
)
def test_offset_within_its_error(offset: float, tachometer: float, memory: float) -> None:
    found = [estimated(s, offset, tachometer=tachometer, memory=memory) for s in range(80)]
    errors = np.array([(f.offset - offset) / f.standard_error for f in found])
    # 1 / sqrt(160) = 8 %, three times that
    assert 0.76 < errors.std() < 1.24
    assert abs(errors.mean()) < 3 / np.sqrt(80)
    # ramps of 10 to 60 deg/s/s against 0.05 deg/s of noise: far below a sample
    assert all(f.standard_error < 0.05 * STEP for f in found)
    gains = np.array([(f.gain - GAIN) / f.gain_standard_error for f in found])
    assert gains.std() < 1.4


def test_a_gyro_mounted_upside_down_has_the_same_offset() -> None:
    found = estimated(1, 0.1, tachometer=0.0, memory=0.0, gain=-1.0)
    assert found.gain == pytest.approx(-1.0, abs=5 * found.gain_standard_error)
    assert found.offset == pytest.approx(0.1, abs=5 * found.standard_error)


def test_what_tells_no_offset_is_an_error() -> None:
    time = np.arange(0.0, 60.0, STEP)
    constant = Motion.of_rate(time, np.full(len(time), 0.5))
    rng = np.random.default_rng(1)
    gyro = 0.5 + records.white(rng, time.shape, 1e-3)
    with pytest.raises(RateTableError, match="a rate that changes") as caught:
        time_offset(constant, time, gyro, longest=0.5)
    assert caught.value.exit_code == 1
    with pytest.raises(RateTableError, match="at least 20 beside the offset"):
        time_offset(constant, time, gyro, longest=40.0)
    time, rate, _ = records.table(CORNERS, STEP)
    with pytest.raises(RateTableError, match="time offset"):
        time_offset(Motion.of_rate(time, rate), time, records.white(rng, time.shape, 1e-3), longest=0.5)
