"""The time offset between gyro and table: within its standard error, whatever the clocks and the noise."""

from __future__ import annotations

from typing import Any

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


LONG = records.corners(DEGREE * np.array([20.0, -20.0, 60.0, -60.0, 100.0, -100.0]), 10.07, 2.03)
"""Ramps of 2 s, the corners at any part of a sample."""


def against_an_encoder(
    seed: int,
    rate: float,
    at: np.ndarray = LONG,
    *,
    means: bool = False,
    bent: float = 0.0,
    lost: tuple[tuple[float, float], ...] = (),
) -> float:
    """Normalised error at one sampling of gyro and encoder; the encoder counts seconds of arc."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0.0, at[-1, 0], 1e-3)
    turned = Motion.of_rate(fine, np.interp(fine, at[:, 0], at[:, 1]))
    time = np.arange(0.0, fine[-1], 1 / rate)
    count = DEGREE / 3600
    motion = Motion.of_angle(time, count * np.round(turned.at(time) / count))
    own = time[2:-2] + 0.37 / rate
    if means:
        told = (turned.at(own) - turned.at(own - 1 / rate)) * rate
    else:
        told = np.interp(own, at[:, 0], at[:, 1])
    told = 1.001 * (told + bent * np.abs(told) / 2) + 0.01
    told = told + records.white(rng, own.shape, 8e-4 * np.sqrt(rate) * DEGREE)
    kept = np.ones(len(own), dtype=np.bool_)
    seen = np.ones(len(time), dtype=np.bool_)
    for place, (begin, end) in enumerate(lost):
        which, instants = ((kept, own), (seen, time))[place % 2]
        which &= (instants < begin) | (instants > end)
    motion = Motion.of_angle(time[seen], motion.angle[seen])
    offset = 0.0437
    found = time_offset(motion, own[kept] + offset, told[kept], longest=0.5)
    return (found.offset - offset - (0.5 / rate if means else 0.0)) / found.standard_error


GAPS = ((14.0, 15.0), (24.5, 26.0), (40.2, 40.9), (50.1, 52.3))
SAMPLED: dict[str, tuple[float, int, dict[str, Any]]] = {
    # rate, seeds, and what else
    "10 Hz": (10.0, 250, {}),
    "20 Hz": (20.0, 250, {}),
    "100 Hz": (100.0, 60, {}),
    "means at 10 Hz": (10.0, 250, {"means": True}),
    "asymmetric at 10 Hz": (10.0, 250, {"bent": 4e-4}),
    "gaps at 10 Hz": (10.0, 250, {"lost": GAPS}),
    "gaps at 100 Hz": (100.0, 60, {"lost": GAPS}),
}


@pytest.mark.parametrize("kind", SAMPLED)
def test_a_standard_error_is_honest_at_any_sampling_and_through_gaps(kind: str) -> None:
    rate, seeds, more = SAMPLED[kind]
    errors = np.array([against_an_encoder(seed, rate, **more) for seed in range(seeds)])
    # 1 / sqrt(500) = 4.5 % and 1 / sqrt(120) = 9 %: the band of the requirement is two of the one at least
    assert 0.8 < errors.std() < 1.2
    assert abs(errors.mean()) < 3.5 / np.sqrt(seeds)


def test_ramps_too_short_for_the_sampling_count_what_is_missed_of_their_corners() -> None:
    """Ramps of two samples: a corner's part of a sample is not known, and is the error of them all."""
    errors = []
    for seed in range(40):
        hold = 10.0 + 0.1 * np.random.default_rng(seed).random()
        short = records.corners(DEGREE * np.array([20.0, -20.0, 60.0, -60.0, 100.0, -100.0]), hold, 0.23)
        errors.append(against_an_encoder(seed, 10.0, short))
    # of a kind that has a bound, not a distribution
    assert 0.1 < np.std(errors) < 1.2
    assert np.abs(errors).max() < 3


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
