"""The harmonic model against sinusoids that are known, and what it refuses."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.numerics.harmonic import HarmonicError, fit_harmonic

Float = NDArray[np.float64]
close = partial(np.testing.assert_allclose, rtol=0)

CONSTANT = np.array([-0.1, 0.2, 0.0])
COSINE = np.array([[0.0, 1.0, 0.5], [0.02, 0.0, -0.1]])
SINE = np.array([[0.1, -0.3, 0.0], [0.0, 0.05, 0.03]])


def motion(t: Float, frequency: float, harmonics: int = 1) -> Float:
    x = np.tile(CONSTANT, (len(t), 1))
    for k in range(harmonics):
        phase = 2 * np.pi * (k + 1) * frequency * t[:, np.newaxis]
        x += COSINE[k] * np.cos(phase) + SINE[k] * np.sin(phase)
    return x


@pytest.mark.parametrize("frequency", [2.0, 7.3123, 33.4, 49.0])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_finds_frequency_and_amplitudes(frequency: float, jitter: float) -> None:
    rng = np.random.default_rng(1)
    t = np.asarray((np.arange(600) + jitter * rng.uniform(-1, 1, 600)) / 100, dtype=np.float64)
    found = fit_harmonic(t, motion(t, frequency), 1)
    # noise-free: rounding of the phase, 2 pi 49 Hz 6 s = 1847 rad, alone
    assert found.model.omega == pytest.approx(2 * np.pi * frequency, rel=1e-12)
    close(found.model.constant, CONSTANT, atol=1e-11)
    close(found.model.cosine, COSINE[:1], atol=1e-11)
    close(found.model.sine, SINE[:1], atol=1e-11)
    assert np.abs(found.residual).max() < 1e-11


def test_finds_two_harmonics() -> None:
    t = np.arange(500) / 100
    found = fit_harmonic(t, motion(t, 9.7, harmonics=2), 2)
    close(found.model.cosine, COSINE, atol=1e-11)
    close(found.model.sine, SINE, atol=1e-11)


def test_sample_gives_values_and_exact_integrals() -> None:
    t = np.arange(500) / 100
    w = 2 * np.pi * 9.7
    values, increments = fit_harmonic(t, motion(t, 9.7), 1).model.sample(t)
    integral = (
        CONSTANT * t[:, None] + (COSINE[0] * np.sin(w * t)[:, None] - SINE[0] * np.cos(w * t)[:, None]) / w
    )
    close(values, motion(t, 9.7), atol=1e-11)
    close(increments[1:], np.diff(integral, axis=0), atol=1e-13)


def test_of_an_angle_takes_a_slope_and_gives_the_rates() -> None:
    t = np.arange(500) / 100 + 3.0
    w = 2 * np.pi * 9.7
    angle = (
        CONSTANT * t[:, None] + (COSINE[0] * np.sin(w * t)[:, None] - SINE[0] * np.cos(w * t)[:, None]) / w
    )
    found = fit_harmonic(t, angle, 1, with_slope=True)
    rates, _ = found.model.derivative(found.slope).sample(t)
    close(rates, motion(t, 9.7), atol=1e-11)


def test_frequency_error_is_that_of_the_noise() -> None:
    """Over 60 seeds, error over its standard deviation: var w = 24 s²/(A² n T²), Rife & Boorstyn (1974)."""
    t = np.arange(400) / 100
    power = float(np.sum(COSINE[0] ** 2 + SINE[0] ** 2))
    noise = 0.05
    deviation = np.sqrt(24 * noise**2 / (power * len(t) * t[-1] ** 2))
    errors = []
    for seed in range(60):
        y = motion(t, 9.7) + noise * np.random.default_rng(seed).normal(size=(len(t), 3))
        errors.append((fit_harmonic(t, y, 1).model.omega - 2 * np.pi * 9.7) / deviation)
    # chi-squared of 60: standard deviation within ±25 % (2.7 sigma), mean within ±0.35 (2.7 sigma)
    assert np.std(errors) == pytest.approx(1, abs=0.25)
    assert abs(np.mean(errors)) < 0.35


@pytest.mark.parametrize("harmonics", [2, 3])
def test_refuses_harmonics_that_alias(harmonics: int) -> None:
    """At 100 Hz of 400 Hz the second lies at half the sampling frequency, the third beyond it."""
    t = np.arange(401) / 400
    with pytest.raises(
        HarmonicError, match=r"below half the sampling frequency, 200 Hz.*state harmonics = 1"
    ):
        fit_harmonic(t, motion(t, 100.0), harmonics)


def test_refuses_a_vibration_beyond_half_the_sampling_frequency() -> None:
    t = np.arange(401) / 400
    with pytest.raises(HarmonicError, match="not even the first"):
        fit_harmonic(t, motion(t, 100.0), 1, frequency=260.0)


def test_refuses_constant_rates() -> None:
    t = np.arange(100) / 100
    with pytest.raises(HarmonicError, match="expected a vibration, found constant rates"):
        fit_harmonic(t, np.full((100, 3), 0.1), 1)


def test_refuses_fewer_than_two_periods() -> None:
    t = np.arange(100) / 100
    with pytest.raises(HarmonicError, match="at least 2 periods"):
        fit_harmonic(t, motion(t, 1.3), 1)


def test_begins_where_it_is_told() -> None:
    """The stronger line is at 31 Hz; told to begin near 9.7 Hz, that one is found."""
    t = np.arange(500) / 100
    y = motion(t, 9.7) + 3 * motion(t, 31.0)
    assert fit_harmonic(t, y, 1).model.omega / (2 * np.pi) == pytest.approx(31.0, abs=0.01)
    # the other line disturbs the frequency by a part of the line width 0.2 Hz
    assert fit_harmonic(t, y, 1, frequency=9.6).model.omega / (2 * np.pi) == pytest.approx(9.7, abs=0.05)
