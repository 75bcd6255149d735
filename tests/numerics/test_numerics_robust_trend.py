"""The robust trend survives what the weighted one does not."""

import numpy as np
import pytest

from pipeline.numerics.robust_trend import huber, robust, winsorised
from pipeline.numerics.trend import harmonic
from pipeline.numerics.vibration import fundamental, harmonic_design

RATE = 400.0
ROWS = 10
T = np.arange(4001) / (RATE * ROWS)
BLOCK = 2 * ROWS
A, B = -0.0135, 4.7e-5
ANGLE = A * T + B + 7.6e-5 * np.sin(2 * np.pi * 100 * T)
RUNS = 60


def noisy_angle(rng, share):
    """White noise of 1e-5 rad, and a share of rows that are off by some 1e-2 rad, all to one side."""
    noise = 1e-5 * rng.standard_normal(T.size)
    wrong = rng.random(T.size) < share
    noise[wrong] += np.abs(1e-2 * rng.standard_normal(wrong.sum()))
    return ANGLE + noise


def noisy_rate(rng, share):
    """The integral of rates with noise of 1e-3 rad/s, a share of which is off by some 0.1 rad/s."""
    rates = 1e-3 * rng.standard_normal(401)
    wrong = rng.random(401) < share
    rates[wrong] += 0.1 * rng.standard_normal(wrong.sum())
    grid = np.arange(401) / RATE
    steps = np.interp(0.5 * (T[1:] + T[:-1]), grid, rates) * np.diff(T)
    return ANGLE + np.append(0.0, steps.cumsum())


def collected(method, make, share):
    trends = [method(T, make(np.random.default_rng(s), share), 100.0, 1, BLOCK) for s in range(RUNS)]
    errors = np.array([trend.a - A for trend in trends])
    return trends, errors, errors / [trend.a_standard_error for trend in trends]


@pytest.mark.parametrize("make", [noisy_angle, noisy_rate])
def test_five_percent_outliers_are_survived(make):
    _, clean, _ = collected(harmonic, make, 0.0)
    _, broken, _ = collected(harmonic, make, 0.05)
    trends, errors, scores = collected(robust, make, 0.05)
    assert np.std(broken) > 10 * np.std(clean)
    assert np.std(errors) < 3 * np.std(clean)  # part of the record is given up, and small outliers stay
    assert abs(np.mean(scores)) < 0.4  # 60 runs: 0.13 one sigma
    assert 0.7 < np.std(scores) < 1.3  # 60 runs: 0.09 one sigma
    if make is noisy_angle:
        wrong = 0.05 * T.size
        assert np.mean([trend.left_out for trend in trends]) == pytest.approx(wrong, rel=0.05)
    else:
        assert min(trend.jumps for trend in trends) > 10


@pytest.mark.parametrize("make", [noisy_angle, noisy_rate])
def test_without_outliers_it_is_the_weighted_trend(make):
    trends, errors, _ = collected(robust, make, 0.0)
    _, weighted, _ = collected(harmonic, make, 0.0)
    assert np.std(errors) < 1.1 * np.std(weighted)  # the last part of a period is left out
    assert np.mean([trend.left_out for trend in trends]) < 1  # a row in 2e6, in 4000
    assert np.mean([trend.jumps for trend in trends]) < 1


def test_clean_record_is_exact():
    trend = robust(T, ANGLE, 100.0, 1, BLOCK)
    assert trend.a == pytest.approx(A, rel=1e-9)  # rounding


def test_without_a_vibration_the_whole_record_counts():
    y = A * T + B + 1e-6 * np.random.default_rng(1).standard_normal(T.size)
    trend = robust(T, y, None, 0, BLOCK)
    assert abs(trend.a - A) < 5 * trend.a_standard_error


def test_huber_is_little_moved_by_outliers_and_stops_where_nothing_is_left():
    design = harmonic_design(T, None, 0)
    rng = np.random.default_rng(2)
    y = A * T + B + 1e-4 * rng.standard_normal(T.size)
    y[rng.random(T.size) < 0.05] += 10.0
    b, a = huber(design, y)
    # one-sided contamination of 5 % moves Huber's estimate by less than 0.1 sigma
    assert b == pytest.approx(B, abs=2e-5)
    assert a == pytest.approx(A, abs=2e-5)
    np.testing.assert_allclose(huber(design, A * T + B), [B, A], rtol=1e-9)  # rounding


def test_frequency_is_found_in_spite_of_outliers():
    y = noisy_angle(np.random.default_rng(3), 0.05)
    assert fundamental(winsorised(y), T[1]) == pytest.approx(100, abs=0.1)  # a tenth of a line
