"""Trends with known truth: exact without noise, and as good as their standard errors with it."""

import numpy as np
import pytest

from pipeline.numerics.smooth_motion import fit_smooth_motion
from pipeline.numerics.trend import (
    TooFewRowsError,
    find_extremes,
    harmonic,
    trend_by_extremes,
)

RATE = 400.0  # samples of the gyro, Hz
ROWS = 50  # rows of the attitude in a sample interval
T = np.arange(20001) / (RATE * ROWS)
BLOCK = 2 * ROWS
A, B = -0.0135, 4.7e-5  # the paper's trend
VIBRATION = 7.6e-5 * np.sin(2 * np.pi * 200 * T)  # and its vibration of gamma
ANGLE = A * T + B - VIBRATION

WALK = 1e-3 / np.sqrt(RATE)  # rad/sqrt(s): 1e-3 rad/s of white noise on each rate sample
RUNS = 200


def wandering(rng):
    """The integral of the straight lines between rate samples of white noise."""
    rates = 1e-3 * rng.standard_normal(401)
    angle = np.append(0.0, np.cumsum((rates[1:] + rates[:-1]) / 2)) / RATE
    u = (np.arange(T.size - 1) % ROWS) / ROWS
    i = np.arange(T.size - 1) // ROWS
    within = (rates[i] * u + (rates[i + 1] - rates[i]) * u**2 / 2) / RATE
    return np.append(angle[i] + within, angle[-1])


@pytest.fixture(scope="module")
def noiseless():
    return harmonic(T, ANGLE, 200.0, 1, BLOCK)


def test_extremes_are_those_of_the_curve_between_the_rows():
    t = np.arange(0, 1, 1e-3)
    w = 4 * np.pi
    found = find_extremes(t, np.cos(w * (t - 0.10037)) + 0.2 * t)
    # the derivative is zero where sin w(t - 0.10037) = 0.2/w
    first = 0.10037 + np.arcsin(0.2 / w) / w
    # the parabola is off by (w h)^2 = 2e-4 of its shift within a row of 1e-3 s
    np.testing.assert_allclose(found.t[:2], [first, first + 0.5], rtol=0, atol=2e-7)
    assert found.separation == pytest.approx(0.5, abs=4e-7)


def test_an_extreme_at_the_border_is_taken_as_it_stands():
    t = np.linspace(0, 1, 101)
    found = find_extremes(t, t)
    assert found.t == (0.5, 1.0, 0.0)
    assert found.y == (0.5, 1.0, 0.0)


def test_formulas_of_the_paper(noiseless):
    found = find_extremes(T, ANGLE)
    trend = trend_by_extremes(found, noiseless)
    (t1, t2, t3), (y1, y2, y3) = found.t, found.y
    assert trend.a == (y1 - y2) / (t1 - t2)
    assert trend.b == pytest.approx((y1 + y3 - trend.a * (t1 + t3)) / 2, rel=1e-15)  # rounding
    # all three lie at the same phase of the vibration, so that a is exact but for the parabola, whose
    # error of 1e-4 of a row at both maxima cancels to a part of 1e-6
    assert trend.a == pytest.approx(A, rel=1e-6)
    # maximum and minimum are mirror images: b too
    assert trend.b == pytest.approx(B, rel=1e-3)


def test_harmonic_is_exact_without_noise(noiseless):
    assert noiseless.a == pytest.approx(A, rel=1e-10)  # rounding
    assert noiseless.b == pytest.approx(B, rel=1e-8)  # rounding
    assert noiseless.angle_random_walk < 1e-12


@pytest.mark.parametrize("phase", [0.0, 0.3, np.pi / 2])
def test_vibration_sampled_at_nyquist_is_no_fault(phase):
    t = np.arange(401) / RATE
    y = A * t + B + 7.6e-5 * np.sin(2 * np.pi * 200 * t + phase)
    trend = harmonic(t, y, 200.0, 1, 2)
    assert trend.a == pytest.approx(A, rel=1e-9)  # rounding
    assert trend.b == pytest.approx(B, rel=1e-6)


def test_few_periods_are_told_from_the_trend():
    y = A * T + B + 1e-2 * np.cos(2 * np.pi * 2.7 * T)
    trend = harmonic(T, y, 2.7, 1, BLOCK)
    assert trend.a == pytest.approx(A, rel=1e-9)  # rounding


def test_the_end_intervals_do_not_count():
    """One-sided interpolation puts steps there, as into the paper's gamma."""
    y = ANGLE.copy()
    y[:ROWS] -= 5e-5
    y[-ROWS:] += 5e-5
    trend = harmonic(T, y, 200.0, 1, BLOCK)
    # what is left is their part in the ordinary estimate of the sinusoid, which the blocks extinguish
    assert trend.a == pytest.approx(A, rel=1e-9)


def test_too_few_rows_are_refused():
    with pytest.raises(TooFewRowsError, match="too few"):
        harmonic(T[:750], ANGLE[:750], 200.0, 1, BLOCK)
    with pytest.raises(TooFewRowsError, match="too few"):
        harmonic(T[:950], ANGLE[:950], 200.0, 1, BLOCK)


@pytest.fixture(scope="module")
def runs(noiseless):
    """Errors and standard errors of a, b over seeds, in rates' noise and in angle noise."""
    extremes = trend_by_extremes(find_extremes(T, ANGLE), noiseless)
    collected = {}
    for kind in ("rate", "angle"):
        items = []
        for seed in range(RUNS):
            rng = np.random.default_rng(seed)
            noise = wandering(rng) if kind == "rate" else 1e-5 * rng.standard_normal(T.size)
            weighted = harmonic(T, ANGLE + noise, 200.0, 1, BLOCK)
            three = trend_by_extremes(find_extremes(T, ANGLE + noise), weighted)
            items.append((
                weighted.a - noiseless.a, weighted.a_standard_error,
                weighted.b - noiseless.b, weighted.b_standard_error,
                three.a - extremes.a, three.a_standard_error,
                weighted.angle_random_walk, weighted.white_angle_noise,
            ))  # fmt: skip
        collected[kind] = np.array(items).T
    return collected


def test_spread_in_rate_noise_is_that_of_the_bound(runs):
    weighted, extremes = runs["rate"][0], runs["rate"][4]
    bound = WALK / np.sqrt(T[-1])  # 5e-5 rad/s: no estimate knows more than the walk's two ends
    assert np.std(weighted) <= 0.70 * np.std(extremes)
    # 200 runs know a spread to 5 %
    assert np.std(weighted) == pytest.approx(bound, rel=0.1)
    assert np.std(extremes) == pytest.approx(bound * np.sqrt(2), rel=0.15)


def test_standard_errors_in_rate_noise_are_honest(runs):
    a, a_error, b, b_error, three, three_error, walk, _ = runs["rate"]
    for score in (a / a_error, b / b_error):
        assert abs(np.mean(score)) < 0.2  # 200 runs: 0.07 one sigma
        assert 0.9 < np.std(score) < 1.1  # 0.05 one sigma
    # the choice of the largest sample adds to the noise of the chosen one
    assert 0.85 < np.std(three / three_error) < 1.2
    assert np.mean(walk) == pytest.approx(WALK, rel=0.03)  # 200 blocks, 200 runs: 0.4 %, and 1 % of model


def test_spread_in_angle_noise_is_a_quarter_of_the_extremes(runs):
    a, a_error, *_, three, _, _, white = runs["angle"]
    assert np.std(a) <= 0.25 * np.std(three)
    bound = 1e-5 * np.sqrt(12 / T.size) / T[-1]
    # a walk that the record cannot exclude costs some weight
    assert np.std(a) == pytest.approx(bound, rel=0.25)
    assert 0.75 < np.std(a / a_error) < 0.95  # the same walk is in the standard error: 0.84 over 1500 runs
    assert np.mean(white) == pytest.approx(1e-5, rel=0.02)  # 200 blocks: 5 % a run


def test_smooth_motion_is_the_line_of_least_squares():
    t = 3.0 + T
    smooth = fit_smooth_motion(t, 0.5 - 0.05 * t, 4.1, BLOCK)
    assert smooth.a == pytest.approx(-0.05, rel=1e-10)  # rounding
    np.testing.assert_allclose(smooth(t), 0.5 - 0.05 * t, rtol=1e-11)  # rounding


def test_standard_errors_of_the_smooth_motion_are_honest():
    scores = []
    for seed in range(RUNS):
        noise = wandering(np.random.default_rng(seed))
        smooth = fit_smooth_motion(T, noise, T[-1], BLOCK)
        off = float(smooth(T[-1:])[0]) - noise[-1]
        scores.append((smooth.a / smooth.a_standard_error, off / smooth.end_standard_error))
    assert np.all(np.abs(np.mean(scores, axis=0)) < 0.2)  # 0.07 one sigma
    assert np.all(np.abs(np.std(scores, axis=0) - 1) < 0.12)  # 0.05 one sigma, and the walk's level to 5 %
    assert smooth.standard_error(2.0) == pytest.approx(
        np.hypot(smooth.end_standard_error, smooth.a_standard_error)
    )
