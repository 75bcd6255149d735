import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.numerics.sampling import MAD_TO_SIGMA, compare_clocks, gaps, intervals, runs

REGULAR = np.arange(1000) * 2_500_000  # ns: 400 Hz


@given(st.lists(st.booleans()))
def test_runs_cover_exactly_the_true_samples(mask: list[bool]) -> None:
    found = runs(np.array(mask, dtype=np.bool_))
    covered = np.zeros(len(mask), dtype=np.bool_)
    for start, stop in zip(found.start, found.stop, strict=True):
        assert start < stop
        covered[start:stop] = True
    assert covered.tolist() == mask
    # No two runs touch: they would be one.
    assert np.all(found.start[1:] > found.stop[:-1])


def test_a_regular_record_has_no_jitter_and_no_gap() -> None:
    found = intervals(REGULAR)
    assert (found.nominal, found.jitter, found.batched) == (0.0025, 0.0, False)
    assert len(gaps(REGULAR, found.nominal, 1.8)) == 0


def test_jitter_is_the_standard_deviation_of_normal_intervals() -> None:
    rng = np.random.default_rng(1)
    n, sigma = 100_000, 1e-5
    steps = 0.0025 + sigma * rng.normal(size=n)
    found = intervals(np.cumsum(np.rint(steps * 1e9).astype(np.int64)))
    # The standard error of a scaled MAD is 1.17 sigma/sqrt(n); five of them.
    assert found.jitter == pytest.approx(sigma, rel=5 * 1.17 / np.sqrt(n))
    assert pytest.approx(1.4826, abs=1e-5) == MAD_TO_SIGMA


def test_gaps_say_where_how_long_and_how_many_were_lost() -> None:
    time = np.delete(REGULAR, [100, 500, 501, 502])
    found = gaps(time, 0.0025, 1.8)
    assert time[found.before].tolist() == [REGULAR[99], REGULAR[499]]
    assert time[found.after].tolist() == [REGULAR[101], REGULAR[503]]
    assert found.lost.tolist() == [1, 3]
    assert found.length.tolist() == pytest.approx([0.005, 0.010], rel=1e-12)  # rounding of ns * 1e-9


def test_a_stamp_that_steps_back_makes_no_gap_and_no_interval() -> None:
    time = REGULAR.copy()
    time[300] = time[299] - 7_000_000
    found = gaps(time, intervals(time).nominal, 1.8)
    # Sample 300 does not advance: between 299 and 301 one sample is missing.
    assert (found.before.tolist(), found.after.tolist(), found.lost.tolist()) == ([299], [301], [1])


def test_batches_are_told_from_gaps() -> None:
    batch = np.arange(100)[:, None] * 25_000_000 + np.arange(10) * 10_000
    found = intervals(batch.ravel())
    assert found.batched
    # Ten samples each 25 ms; the trimmed hundredth takes up to 10 of the 99 long intervals, so 10 % off.
    assert found.nominal == pytest.approx(0.0025, rel=0.11)


def test_an_interval_needs_two_stamps_that_advance() -> None:
    with pytest.raises(ValueError, match="two samples"):
        intervals(np.array([5, 5, 5]))


class TestClocks:
    def test_offset_jump_and_batches(self) -> None:
        clock = REGULAR + 3_000_000
        clock[600:] += 40_000_000
        found = compare_clocks(clock, REGULAR)
        assert found.offset == pytest.approx(0.003, abs=1e-12)  # 600 of the 1000 samples
        assert found.jump == pytest.approx(0.04, abs=1e-12)
        assert found.batch == 1.0
        batched = REGULAR // 25_000_000 * 25_000_000
        assert compare_clocks(batched, REGULAR).batch == 10.0

    def test_far_apart_epochs_keep_their_nanoseconds(self) -> None:
        """Boot time against Unix time: 1.7e18 ns apart, where float64 has a resolution of 256 ns."""
        clock = REGULAR + 1_700_000_000_000_000_000
        clock[700:] += 100
        assert compare_clocks(clock, REGULAR).jump == pytest.approx(100e-9, abs=1e-15)

    def test_drift_errs_as_it_says(self) -> None:
        """A clock 20 ppm fast whose stamps come late by a skewed, correlated delay."""
        errors = []
        n, seeds = 6400, 400
        time = np.arange(n) * 10_000_000
        for seed in range(seeds):
            rng = np.random.default_rng(seed)
            late = np.convolve(rng.exponential(1e-3, size=n + 9), np.ones(10) / 10, mode="valid")
            clock = np.rint(time * (1 + 20e-6) + late * 1e9).astype(np.int64)
            found = compare_clocks(clock, time)
            errors.append((found.drift - 20e-6) / found.drift_standard_error)
        # 400 seeds: the mean has a standard error of 0.05, the standard deviation of 0.036; three of each.
        assert abs(np.mean(errors)) < 0.15
        assert 0.9 < np.std(errors) < 1.1

    def test_a_drift_needs_some_samples(self) -> None:
        assert np.isnan(compare_clocks(np.array([1, 2, 4]), np.array([1, 2, 3])).drift)
