"""The criterion (2.5) against closed forms."""

import numpy as np
import pytest

from pipeline.numerics.criterion import relative_rms_error


def test_criterion_of_a_known_error():
    t = np.linspace(0, 1, 2001)
    # ∫ t² dt / ∫ sin²(2πt) dt = (1/3)/(1/2); the trapezoid rule is off by h²/12 of the slope's jump
    assert relative_rms_error(t, t, np.sin(2 * np.pi * t)) == pytest.approx(np.sqrt(2 / 3), rel=1e-6)


def test_uneven_samples_weigh_by_their_time():
    t = np.array([0.0, 1.0, 1.5, 4.0])
    difference, reference = np.array([1.0, 2.0, 0.0, 3.0]), np.full(4, 2.0)
    expected = np.sqrt((5 / 2 + 4 / 4 + 9 * 2.5 / 2) / 16)
    assert relative_rms_error(t, difference, reference) == pytest.approx(expected, rel=1e-15)  # rounding


def test_nothing_is_integrated_across_a_gap():
    t = np.array([0.0, 1.0, 10.0, 11.0])
    segment = np.array([0, 0, 1, 1])
    difference, reference = np.array([1.0, 1.0, 3.0, 3.0]), np.ones(4)
    assert relative_rms_error(t, difference, reference, segment) == pytest.approx(np.sqrt(5), rel=1e-15)


def test_undefined_without_a_reference_to_relate_to():
    t = np.array([0.0, 1.0])
    assert relative_rms_error(t, np.ones(2), np.zeros(2)) is None
    assert relative_rms_error(t[:1], np.ones(1), np.ones(1)) is None
    assert relative_rms_error(t, np.ones(2), np.ones(2), np.array([0, 1])) is None
