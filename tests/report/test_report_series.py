from __future__ import annotations

import numpy as np
import pytest
from report_tables import START, angles, raw

from pipeline.report import series
from pipeline.report.base import Clock
from pipeline.report.series import Series

CLOCK = Clock(START, 1.0)


def uniform(n: int, step: float, **values: np.ndarray) -> Series:
    return Series(np.arange(n) * step, values, step)


def test_read_sorts_keeps_to_the_record_and_turns_infinity_into_nan() -> None:
    time = np.array([0.2, 0.1, 0.3, 5.0, -0.1])
    table = raw("gyro", time, dict.fromkeys("pqr", np.array([2.0, 1.0, np.inf, 4.0, 5.0])))
    found = series.read({"gyro": table}, "gyro", CLOCK, ("p",))
    assert found is not None
    np.testing.assert_allclose(found.time, [0.1, 0.2, 0.3], rtol=1e-12)  # nanoseconds to float64 seconds
    np.testing.assert_array_equal(found.values["p"], [1.0, 2.0, np.nan])
    assert series.read({"gyro": table.slice(0, 0)}, "gyro", CLOCK, ("p",)) is None
    assert series.read({}, "gyro", CLOCK, ("p",)) is None


def test_an_angle_is_unknown_inside_a_gap_and_outside_the_record() -> None:
    made = Series(np.array([0.0, 0.1, 0.2, 0.8, 0.9]), {"psi": np.arange(5.0)}, 0.1)
    found = series.at(made, np.array([-0.1, 0.0, 0.15, 0.2, 0.5, 0.8, 0.9, 1.0]), "psi")
    np.testing.assert_allclose(found, [np.nan, 0, 1.5, 2, np.nan, 3, 4, np.nan], rtol=1e-12)


def test_a_reference_that_jumps_by_a_turn_is_drawn_on_the_branch_of_the_attitude() -> None:
    t = np.linspace(0, 1, 101)
    attitude = Series(t, {"psi": 10 * t}, 0.01)
    reference = Series(t, {"psi": np.angle(np.exp(1j * (10 * t + 0.1)))}, 0.01)
    # 1e-13: a few roundings of angles below 10 rad
    np.testing.assert_allclose(series.difference(attitude, reference).values["psi"], -0.1, atol=1e-13)
    np.testing.assert_allclose(series.on_branch(reference, attitude).values["psi"], 10 * t + 0.1, atol=1e-13)


def test_a_line_of_the_spectrum_reads_the_amplitude_of_its_sinusoid() -> None:
    n, step = 400, 1 / 400
    t = np.arange(n) * step
    frequency, amplitude = series.spectrum(uniform(n, step, p=3.0 * np.sin(2 * np.pi * 100 * t) + 7.0))
    assert frequency[amplitude["p"].argmax()] == pytest.approx(100.0, rel=1e-12)
    assert amplitude["p"].max() == pytest.approx(3.0, rel=1e-12)


def test_the_longest_stretch_ends_at_gaps_nan_and_repeated_stamps() -> None:
    t = np.delete(np.arange(0, 1, 0.01), 60)
    t[90] = t[89]
    value = np.ones_like(t)
    value[20] = np.nan
    found = series.longest_stretch(Series(t, {"p": value}, 0.01))
    assert found is not None
    np.testing.assert_array_equal(found.time, t[21:60])
    assert series.longest_stretch(Series(t[:10], {"p": value[:10]}, 0.01)) is None


def test_a_part_has_both_its_ends() -> None:
    part = uniform(101, 0.01, **angles(np.arange(101) * 0.01)).within(0.25, 0.5)
    assert (part.time[0], part.time[-1], len(part.values["psi"])) == (0.25, 0.5, 26)
