"""The demodulation test on simulated records of a turning table."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.models.random_error import Noise1, Noise2, RandomError, White
from pipeline.models.rotation_record import Demodulation, demodulate, without_harmonics

Float = NDArray[np.float64]

RATE = np.radians(3.0)
WINDOWS = 24
N_POINTS = WINDOWS * 600
WHITE = RandomError((White(1e-4),))
NOISE1 = RandomError((Noise1(0.01, 0.01), White(1e-4)))
NOISE2 = RandomError((Noise2(0.01, 0.01, 0.05), White(1e-4)))


def turning(model: RandomError, seed: int, rate: float = RATE) -> tuple[Float, Float]:
    """Rate with the Earth's line, the table's second harmonic and a bias; and the angle."""
    angle = rate * np.arange(N_POINTS, dtype=np.float64)
    error = model.generate(N_POINTS, 1.0, np.random.default_rng(seed))
    return error + 0.3 + 0.5 * np.cos(angle + 1) + 0.2 * np.sin(2 * angle), angle


def demodulated(model: RandomError, seed: int, told: RandomError | None = None) -> Demodulation:
    rate, angle = turning(model, seed)
    there = np.ones(N_POINTS, dtype=np.bool_)
    found = demodulate(told or model, without_harmonics(rate, angle, there), angle, 1.0, there)
    assert found is not None
    return found


def test_harmonics_are_taken_out_to_rounding() -> None:
    angle = RATE * np.arange(5000.0)
    there = np.arange(5000) % 7 != 0
    line = 2 + np.cos(angle) - 3 * np.sin(2 * angle) + np.cos(3 * angle + 0.2)
    left = without_harmonics(np.where(there, line, np.nan), angle, there)
    # of seven unknowns by normal equations of a condition near 1
    assert np.abs(left).max() < 1e-12


@pytest.mark.parametrize("model", [WHITE, NOISE1, NOISE2])
def test_the_true_model_is_within_what_chance_allows(model: RandomError) -> None:
    found = [demodulated(model, seed) for seed in range(40)]
    assert {one.windows for one in found} == {WINDOWS}
    ratios = np.array([one.ratio for one in found])
    # 3.3 standard errors of the mean; windows cut by the line that is taken out, and neighbours that share a
    # colour of 100 s, lower it by up to 4 %
    assert abs(ratios.mean() - 1) < 3.3 * found[0].ratio_error / np.sqrt(40) + 0.04
    # 0.9 to 1.1 would need 200 records; of 40 the standard deviation is known to a ninth
    assert 0.6 < ratios.std() / found[0].ratio_error < 1.4
    assert np.mean([one.probability < 0.05 for one in found]) < 0.2
    assert np.mean([one.probability > 0.5 for one in found]) > 0.25


def test_a_wrong_model_is_found_out() -> None:
    twice = RandomError((White(2e-4),))
    for seed in range(5):
        found = demodulated(WHITE, seed, told=twice)
        # half of the prediction, of a standard error of 0.21
        assert found.ratio < 0.85
        assert found.probability < 0.1
        # without rotation the colour is 200 times the white noise; the prediction holds it at 3 deg/s only
        assert demodulated(NOISE1, seed, told=WHITE).probability < 1e-6


def test_gaps_leave_windows_out() -> None:
    rate, angle = turning(WHITE, 1)
    there = np.ones(N_POINTS, dtype=np.bool_)
    there[1000:1500] = False
    found = demodulate(WHITE, without_harmonics(rate, angle, there), angle, 1.0, there)
    assert found is not None
    # 500 s that lie in two windows
    assert found.windows == WINDOWS - 2
    assert found.probability > 1e-3


def test_windows_are_whole_turns() -> None:
    rate, angle = turning(WHITE, 1, np.radians(-1.7))
    there = np.ones(N_POINTS, dtype=np.bool_)
    found = demodulate(WHITE, without_harmonics(rate, angle, there), angle, 1.0, there)
    assert found is not None
    assert found.rate == pytest.approx(np.radians(-1.7))
    # three turns of 211.8 s, to the step
    assert found.length == pytest.approx(3 * 360 / 1.7, abs=0.5)


@pytest.mark.parametrize("angle", [np.zeros(N_POINTS), 60 * np.sin(np.arange(N_POINTS) / 500)])
def test_a_table_that_rests_or_turns_unevenly_is_no_test(angle: Float) -> None:
    there = np.ones(N_POINTS, dtype=np.bool_)
    assert demodulate(WHITE, np.zeros(N_POINTS), angle, 1.0, there) is None


def test_a_short_record_is_no_test() -> None:
    angle = RATE * np.arange(2000.0)
    there = np.ones(2000, dtype=np.bool_)
    assert demodulate(WHITE, np.zeros(2000), angle, 1.0, there) is None
