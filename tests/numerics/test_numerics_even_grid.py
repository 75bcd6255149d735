import numpy as np
import pytest

from pipeline.numerics.even_grid import as_they_are, averaged, interpolated

SECOND = 10**9
START = 1_700_000_000 * SECOND


def wave(time: np.ndarray) -> np.ndarray:
    """Two smooth channels of period 1000 s."""
    phase = 2 * np.pi * (time - START) / (1000 * SECOND)
    return np.stack([np.sin(phase), np.cos(phase)], axis=1)


class TestAsTheyAre:
    def test_bit_for_bit_with_gaps_bridged(self) -> None:
        time = START + SECOND * np.arange(200)
        keep = np.ones(200, dtype=bool)
        keep[50:55] = keep[100] = False
        found = as_they_are(time[keep], wave(time[keep]), SECOND, 0.0)
        assert found is not None
        assert np.array_equal(found.time, time)
        assert np.array_equal(found.measured, keep)
        assert np.array_equal(found.values[keep], wave(time[keep]))
        # The cubic over six seconds of a wave of 1000 s: (3.5 h)^4/4! of its fourth derivative at most.
        assert np.abs(found.values - wave(time)).max() < (3.5 * 2 * np.pi / 1000) ** 4 / 24

    def test_an_interval_that_is_not_whole(self) -> None:
        time = START + np.rint(np.arange(1000) * SECOND / 30).astype(np.int64)
        found = as_they_are(time, wave(time), SECOND / 30, 1.0)
        assert found is not None
        assert np.abs(found.time - time).max() <= 1

    def test_what_is_not_even(self) -> None:
        time = START + SECOND * np.arange(200)
        time[70] += 2000
        assert as_they_are(time, wave(time), SECOND, 1999.0) is None
        assert as_they_are(time, wave(time), SECOND, 2001.0) is not None


class TestInterpolated:
    def test_a_smooth_signal(self) -> None:
        rng = np.random.default_rng(0)
        time = START + np.sort(rng.integers(0, 2000 * SECOND, size=2000))
        found = interpolated(time, wave(time), SECOND, SECOND)
        # Samples at random leave holes of up to ten seconds: (h/2)^2 (3h/2)^2/4! with h = 10 s.
        assert np.abs(found.values - wave(found.time)).max() < (8.7 * 2 * np.pi / 1000) ** 4 / 24
        assert np.array_equal(np.diff(found.time), np.full(len(found.time) - 1, SECOND))
        after = np.searchsorted(time, found.time)
        holes = np.diff(time)[np.maximum(after, 1) - 1] > 1.8 * SECOND
        assert np.array_equal(~found.measured[1:], holes[1:])

    def test_another_interval(self) -> None:
        time = START + SECOND * np.arange(100)
        found = interpolated(time, wave(time), 1.25 * SECOND, SECOND)
        assert found.time[1] - found.time[0] == 1.25 * SECOND
        assert found.time[-1] <= time[-1]
        assert found.measured.all()


class TestAveraged:
    @pytest.mark.parametrize("interval", [10, 25, 7])
    def test_no_bias_of_second_order(self, interval: int) -> None:
        """The mean alone would be off by H^2/24 times the curvature; what is left is of order H^4."""
        time = START + SECOND * np.arange(3000)
        found = averaged(time, wave(time), interval * SECOND, SECOND)
        assert found is not None
        angle = 2 * np.pi * interval / 1000
        error = np.abs(found.values - wave(found.time))
        # 0.016 H^4 |x''''| inside; at the two ends the parabola is not centred, 2 H^3 |x'''| H/24 at most.
        assert error[2:-2].max() < 0.02 * angle**4
        assert error.max() < angle**3 / 5
        assert error[2:-2].max() < 0.1 * angle**2 / 24

    def test_the_middles_are_those_of_the_samples(self) -> None:
        time = START + SECOND * np.arange(100)
        found = averaged(time, wave(time), 10 * SECOND, SECOND)
        assert found is not None
        assert found.time.tolist() == [START + (10 * k + 4.5) * SECOND for k in range(10)]
        assert found.measured.all()

    def test_uneven_and_missing_samples(self) -> None:
        rng = np.random.default_rng(1)
        time = START + SECOND * np.arange(3000) + rng.integers(-200_000_000, 200_000_001, size=3000)
        keep = rng.random(3000) > 0.1
        keep[1000:1040] = False
        found = averaged(time[keep], wave(time[keep]), 20 * SECOND, SECOND)
        assert found is not None
        missing = np.flatnonzero(~found.measured)
        assert missing.tolist() in ([50], [50, 51], [49, 50], [49, 50, 51])
        # Off-centre windows have the slope taken off; what is left of it is of third order, 1e-4 here.
        assert np.abs(found.values - wave(found.time))[found.measured].max() < 1e-3

    def test_noise_stays_white(self) -> None:
        time = START + SECOND * np.arange(200_000)
        noise = np.random.default_rng(2).normal(size=(len(time), 2))
        found = averaged(time, noise, 10 * SECOND, SECOND)
        assert found is not None
        values = found.values
        # 40,000 values: 0.35 % for the standard deviation, 0.5 % for a correlation, three sigma of each;
        # 0.6 % and 1 % are the parabola's.
        assert values.std() * np.sqrt(10) == pytest.approx(1.006, abs=0.011)
        for lag in (1, 2):
            correlation = np.mean(values[lag:] * values[:-lag]) / np.mean(values**2)
            assert abs(correlation) < 0.01 + 0.015

    def test_too_few_windows(self) -> None:
        time = START + SECOND * np.arange(49)
        assert averaged(time, wave(time), 10 * SECOND, SECOND) is None
