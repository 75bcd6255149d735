"""The frequency of a vibration and its onset, against simulated truth."""

import numpy as np
import pytest

from pipeline.models.coning import ConingMotion
from pipeline.numerics.onset import find_onset, power_rise
from pipeline.numerics.vibration import fundamental, harmonic_design

STEP = 1 / 2000
T = np.arange(4001) * STEP


def walk(seed, level=1e-4):
    """A random walk of the level [1/sqrt(s)], as an integrated noisy rate has."""
    return level * np.sqrt(STEP) * np.random.default_rng(seed).standard_normal(T.size).cumsum()


def test_design_has_the_trend_first_and_two_columns_a_harmonic():
    design = harmonic_design(T, 20.0, 2)
    assert design.shape == (T.size, 6)
    np.testing.assert_array_equal(design[:, :2], np.column_stack([np.ones_like(T), T]))
    np.testing.assert_allclose(design[:, 5], np.sin(2 * np.pi * 40 * T), atol=1e-12)  # rounding of the phase


@pytest.mark.parametrize("frequency", [7.3, 100.0, 333.7, 980.0])
def test_frequency_of_a_clean_vibration_beside_a_large_trend(frequency):
    y = 1e-4 * np.sin(2 * np.pi * frequency * T + 0.4) - 0.0135 * T + 0.2
    # the samples determine it to rounding; the trend is a hundred times the vibration
    assert fundamental(y, STEP) == pytest.approx(frequency, rel=1e-9)


def test_frequency_in_noise_is_as_good_as_the_bound():
    noise, amplitude = 0.3, 1.0
    y = amplitude * np.sin(2 * np.pi * 50 * T) + noise * np.random.default_rng(1).standard_normal(T.size)
    duration = T[-1]
    bound = np.sqrt(6 / T.size) * noise / amplitude / (np.pi * duration)  # Rife & Boorstyn (1974)
    assert fundamental(y, STEP) == pytest.approx(50, abs=4 * bound)


def test_strongest_line_wins_and_harmonics_help():
    y = np.sin(2 * np.pi * 50 * T) + 0.5 * np.cos(2 * np.pi * 100 * T)
    assert fundamental(y, STEP, harmonics=2) == pytest.approx(50, rel=1e-9)  # rounding


@pytest.mark.parametrize("seed", range(20))
def test_noise_is_no_vibration(seed):
    rng = np.random.default_rng(seed)
    assert fundamental(walk(seed) + 1e-6 * rng.standard_normal(T.size), STEP) is None


def test_straight_line_and_short_records_have_no_vibration():
    assert fundamental(0.3 + 0.1 * T, STEP) is None
    assert fundamental(np.sin(np.arange(5.0)), STEP) is None


def vibration_from(start, frequency=100.0):
    """Three angles: smooth, then coning from `start` on."""
    on = start <= T
    phase = 2 * np.pi * frequency * (T - start)
    smooth = np.column_stack([0 * T, 0 * T, 0.5 - 0.05 * T])
    shaking = 1e-2 * np.column_stack([np.cos(phase) - 1, np.sin(phase), 1e-2 * np.sin(2 * phase)])
    return smooth + on[:, None] * shaking


@pytest.mark.parametrize("frequency", [20.0, 100.0, 400.0])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_onset_is_found_within_its_accuracy(frequency, noise):
    angles = vibration_from(0.8, frequency) + noise * np.column_stack([walk(s, 1.0) for s in (1, 2, 3)])
    onset = find_onset([angles], STEP, 1)
    assert onset is not None
    assert T[onset.row] == pytest.approx(0.8, abs=onset.accuracy)
    assert onset.accuracy <= max(1.01 / frequency, 2 * STEP)  # one period; its frequency is known to 1 %


def test_onset_is_counted_from_the_stretch_that_holds_it():
    angles = vibration_from(1.2)
    onset = find_onset([angles[:1500], angles[1600:]], STEP, 1)
    assert onset is not None
    assert onset.stretch == 1
    assert T[1600 + onset.row] == pytest.approx(1.2, abs=onset.accuracy)


@pytest.mark.parametrize("angles", [vibration_from(-1.0), np.zeros((T.size, 3)), vibration_from(0.8)[::-1]])
def test_without_a_rise_there_is_no_onset(angles):
    assert find_onset([angles], STEP, 1) is None


def test_too_short_a_record_has_no_rise():
    assert power_rise(np.arange(12.0)[:, None], 8) is None


@pytest.mark.parametrize("rows", [50, 400, 2000])
def test_noise_has_no_onset(rows):
    """Also where the angle that is sampled at its zeros is noise beside two that vibrate all along."""
    motion = ConingMotion(np.deg2rad(1.0), 100.0).angles(np.arange(rows) / 400)
    for seed in range(50):
        wandering = 1e-3 / 400 * np.cumsum(np.random.default_rng(seed).standard_normal((rows, 3)), axis=0)
        assert find_onset([wandering], 1 / 400, 1) is None
        assert find_onset([motion + wandering], 1 / 400, 1) is None
