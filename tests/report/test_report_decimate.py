"""A thinned curve looks like the whole one: extremes kept, interruptions kept, nothing drawn across them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pipeline.report.decimate import min_max

COLUMNS = 50


def column_of(time: np.ndarray, of: np.ndarray) -> np.ndarray:
    edges = np.linspace(time[0], time[-1], COLUMNS + 1)[1:-1]
    return np.searchsorted(edges, of, side="right")


def test_a_single_sample_that_spikes_is_kept() -> None:
    time = np.arange(100_000) * 1e-3
    value = np.sin(time)
    value[77_777] = 40.0
    thinned_time, thinned = min_max(time, value, COLUMNS)
    assert thinned.max() == 40.0
    assert thinned_time[thinned.argmax()] == time[77_777]


@given(arrays(np.float64, st.integers(101, 2000), elements=st.floats(-1e6, 1e6) | st.just(np.nan)))
def test_every_column_keeps_its_extremes_in_at_most_four_points(value: np.ndarray) -> None:
    time = np.arange(len(value), dtype=np.float64)
    thinned_time, thinned = min_max(time, value, COLUMNS)
    of_all, of_thinned = column_of(time, time), column_of(time, thinned_time)
    assert np.bincount(of_thinned).max() <= 4
    for column in range(COLUMNS):
        whole, kept = value[of_all == column], thinned[of_thinned == column]
        if np.isfinite(whole).any():
            assert np.nanmin(kept) == np.nanmin(whole)
            assert np.nanmax(kept) == np.nanmax(whole)
        else:
            assert np.isnan(kept).all()


@given(arrays(np.float64, st.integers(0, 300), elements=st.floats(-1e6, 1e6)))
def test_a_short_curve_is_kept_as_it_is(value: np.ndarray) -> None:
    time = np.arange(len(value), dtype=np.float64)
    thinned_time, thinned = min_max(time, value, 150)
    np.testing.assert_array_equal(thinned_time, time)
    np.testing.assert_array_equal(thinned, value)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_interrupts_the_curve(bad: float) -> None:
    time, value = np.arange(10_000.0), np.ones(10_000)
    value[3_000:5_000] = bad
    thinned_time, thinned = min_max(time, value, COLUMNS)
    gone = (thinned_time >= 3_000) & (thinned_time < 5_000)
    assert gone.any()
    assert np.isnan(thinned[gone]).all()
    assert (thinned[~gone] == 1.0).all()


@pytest.mark.parametrize("step", [1.0, 100.0], ids=["thinned", "kept whole"])
def test_no_line_is_drawn_across_a_gap_between_samples(step: float) -> None:
    time = np.arange(0.0, 10_000.0, step)
    time = time[(time < 3_000) | (time >= 5_000)]
    thinned_time, thinned = min_max(time, np.ones_like(time), COLUMNS, gap=2 * step)
    last_before = np.flatnonzero(thinned_time < 3_000)[-1]
    assert np.isnan(thinned[last_before + 1])
    assert np.isnan(thinned).sum() == 1


def test_gaps_too_narrow_to_be_seen_do_not_empty_the_curve() -> None:
    time = np.arange(100_000.0)
    time = time[np.arange(100_000) % 10 != 5]  # every tenth sample is lost: 200 gaps in a column
    thinned_time, thinned = min_max(time, np.cos(time), COLUMNS, gap=1.5)
    assert np.isfinite(thinned).sum() == 2 * COLUMNS
    assert len(thinned_time) <= 4 * COLUMNS


def test_a_curve_without_extent_and_one_without_values() -> None:
    time, value = min_max(np.zeros(1_000), np.arange(1_000.0), COLUMNS)
    np.testing.assert_array_equal(value, [0.0, 999.0])
    time, value = min_max(np.arange(1_000.0), np.full(1_000, np.nan), COLUMNS)
    assert len(time) == COLUMNS
    assert np.isnan(value).all()
    assert len(min_max(np.empty(0), np.empty(0), COLUMNS)[0]) == 0
