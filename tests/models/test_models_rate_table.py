"""One gyro on a rate table: parameters against simulated truth, errors against their standard errors."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import rate_table_records as records

from pipeline.models.rate_table import SingleAxis, fit_single_axis
from pipeline.models.rate_table_model import Terms
from pipeline.models.rate_table_steps import (
    Motion,
    RateTableError,
    Steps,
    TableAxis,
    constant_stretches,
    measure_steps,
)

DEGREE = records.DEGREE
AXIS = TableAxis(50 * DEGREE, 0.3, 0.01)
ALONG = np.array([0.0, 0.0, 1.0])
STEP = 0.04
RATES = DEGREE * np.array([10.0, -10, 30, -30, 60, -60, 100, -100, 50, -50, 0, 80, -80])
LARGEST = 100 * DEGREE
TERMS = Terms(asymmetry=True, nonlinearity=(3,))
TRUTH = np.array([0.01 * DEGREE, 1.002, 200e-6, 150e-6])


def outputs(rate: np.ndarray, largest: float) -> np.ndarray:
    b, K, a, c = TRUTH
    return K * (rate + a * np.abs(rate) / 2 + c * largest * (rate / largest) ** 3) + b


def calibrated(seed: int, share: float) -> SingleAxis:
    """From a simulated record; ``share`` is the coloured noise (2 s) over the white of a sample."""
    rng = np.random.default_rng(seed)
    time, rate, angle = records.table(records.corners(RATES, 30.0), STEP)
    gyro = outputs(rate + AXIS.earth_rate[2], LARGEST + AXIS.earth_rate[2])
    sigma = 0.02 * DEGREE
    gyro += records.white(rng, gyro.shape, sigma)
    if share:
        gyro += records.coloured(rng, gyro.shape, share * sigma, 2.0, STEP)
    motion = Motion.of_angle(time, angle + records.white(rng, time.shape, 1e-6))
    stretches = constant_stretches(motion, shortest=20.0, settling=1.0)
    steps = measure_steps(motion, stretches, time, gyro[:, np.newaxis])
    return fit_single_axis(steps, 0, TERMS, input_axis=ALONG, axis=AXIS)


@cache
def normalised(share: float, seeds: int) -> np.ndarray:
    fits = [calibrated(seed, share) for seed in range(seeds)]
    return np.array([(fit.value - TRUTH) / fit.standard_errors for fit in fits])


def test_errors_over_standard_errors_with_white_noise() -> None:
    errors = normalised(0.0, 600)
    # 1 / sqrt(1200) = 3 % for each parameter: the band of the requirement is three of it
    assert np.all((errors.std(axis=0) > 0.9) & (errors.std(axis=0) < 1.1))
    assert np.all(np.abs(errors.mean(axis=0)) < 3 / np.sqrt(600))


def test_errors_over_standard_errors_with_coloured_noise() -> None:
    errors = normalised(0.2, 200)
    assert np.all((errors.std(axis=0) > 0.85) & (errors.std(axis=0) < 1.2))
    assert np.all(np.abs(errors.mean(axis=0)) < 3 / np.sqrt(200))


def exact_steps(rates: np.ndarray, temperature: np.ndarray | None = None) -> Steps:
    """Steps whose means have no noise; the standard error is what one degree an hour comes to."""
    count = len(rates)
    time = np.arange(count, dtype=np.float64)
    largest = np.abs(rates).max()
    return Steps(
        60 * time,
        60 * time + 50,
        rates,
        np.zeros((count, 2)),
        outputs(rates, largest)[:, np.newaxis],
        np.full((count, 1), DEGREE / 3600),
        temperature,
    )


def test_without_noise_the_parameters_are_exact() -> None:
    fit = fit_single_axis(exact_steps(RATES), 0, TERMS, input_axis=ALONG, axis=None)
    assert fit.names == ("bias", "scale_factor", "scale_factor_asymmetry", "scale_factor_nonlinearity_3")
    np.testing.assert_allclose(fit.value, TRUTH, rtol=1e-9, atol=1e-14)  # rounding of the means
    assert np.abs(fit.residual_ppm).max() < 1e-6
    # from the best straight line a cubic of 150 ppm and half of 200 ppm of asymmetry deviate by this much
    assert 50 < fit.linearity_error_ppm < 150


def test_a_straight_line_leaves_the_nonlinearity_in_the_residuals() -> None:
    fit = fit_single_axis(exact_steps(RATES), 0, Terms(), input_axis=ALONG, axis=None)
    # a residual of 1e-4 keeps twelve digits of the rates' sixteen; two fits of them differ in the last
    assert fit.linearity_error_ppm == pytest.approx(float(np.abs(fit.residual_ppm).max()), rel=1e-9)
    # what the means scatter about the line is in the standard errors, not only their noise
    assert fit.scatter > 10 * DEGREE / 3600
    whole = fit_single_axis(exact_steps(RATES), 0, TERMS, input_axis=ALONG, axis=None)
    assert np.all(fit.standard_errors > 5 * whole.standard_errors[:2])


def test_temperature_coefficients() -> None:
    d, e, T0 = 1e-4 * DEGREE, 30e-6, 293.15
    rates = np.tile(RATES, 3)
    temperature = np.repeat(T0 + np.array([-30.0, 0.0, 30.0]), len(RATES))
    steps = exact_steps(rates, temperature)
    steps.gyro[:, 0] += d * (temperature - T0) + TRUTH[1] * e * (temperature - T0) * rates
    terms = Terms(True, (3,), bias_temperature=True, scale_factor_temperature=True)
    fit = fit_single_axis(steps, 0, terms, input_axis=ALONG, axis=None, reference_temperature=T0)
    np.testing.assert_allclose(fit.value, [*TRUTH, d, e], rtol=1e-8, atol=1e-13)  # rounding of the means
    rate, _ = fit.apply(steps.gyro[:, 0], temperature)
    np.testing.assert_allclose(rate, rates, atol=1e-9 * LARGEST)


def test_apply_inverts_the_model_and_carries_its_uncertainty() -> None:
    fits = [calibrated(seed, 0.0) for seed in range(40)]
    rate = np.linspace(-LARGEST, LARGEST, 21)
    errors = []
    for fit in fits:
        corrected, standard_error = fit.apply(outputs(rate, LARGEST + AXIS.earth_rate[2]))
        errors.append((corrected - rate) / standard_error)
    # 40 calibrations of 4 parameters: 160 independent values, 1 / sqrt(320) = 5.6 %, three times that
    assert 0.83 < np.std(errors) < 1.17


def test_the_earth_rate_is_in_the_bias_unless_the_axis_is_given() -> None:
    steps = exact_steps(RATES)
    earth = AXIS.earth_rate[2]
    steps.gyro[:, 0] += TRUTH[1] * earth
    left = fit_single_axis(steps, 0, TERMS, input_axis=ALONG, axis=None)
    taken = fit_single_axis(steps, 0, TERMS, input_axis=ALONG, axis=AXIS)
    # the asymmetry sees the shift of zero by the Earth's rate: 100 ppm of it
    assert left.value[0] - TRUTH[0] == pytest.approx(TRUTH[1] * earth, rel=1e-3)
    assert taken.value[0] == pytest.approx(TRUTH[0], abs=1e-3 * earth)


def test_fewer_steps_than_unknowns_is_an_error() -> None:
    with pytest.raises(RateTableError, match="at least 4 steps for bias, scale_factor") as caught:
        fit_single_axis(exact_steps(RATES[:3]), 0, TERMS, input_axis=ALONG, axis=None)
    assert caught.value.exit_code == 1
    assert "found 3" in str(caught.value)


def test_steps_that_do_not_tell_terms_apart_are_named() -> None:
    forward = exact_steps(np.abs(RATES))
    with pytest.raises(RateTableError, match="scale_factor from scale_factor_asymmetry"):
        fit_single_axis(forward, 0, Terms(asymmetry=True), input_axis=ALONG, axis=None)
    still = exact_steps(RATES, np.full(len(RATES), 300.0))
    with pytest.raises(RateTableError, match="steps that tell bias_temperature_sensitivity"):
        fit_single_axis(still, 0, Terms(bias_temperature=True), input_axis=ALONG, axis=None)
    with pytest.raises(RateTableError, match="steps that tell scale_factor"):
        fit_single_axis(exact_steps(RATES), 0, Terms(), input_axis=np.array([1.0, 0.0, 0.0]), axis=None)


def test_lost_samples_stay_lost() -> None:
    fit = fit_single_axis(exact_steps(RATES), 0, TERMS, input_axis=ALONG, axis=None)
    rate, error = fit.apply(np.array([0.1, np.nan]))
    assert np.isfinite([rate[0], error[0]]).all()
    assert np.isnan([rate[1], error[1]]).all()


def test_a_missing_temperature_and_a_dead_channel_are_errors() -> None:
    with pytest.raises(RateTableError, match="a temperature, for a calibration with terms of it"):
        fit_single_axis(exact_steps(RATES), 0, Terms(bias_temperature=True), input_axis=ALONG, axis=None)
    steps = exact_steps(RATES)
    steps.gyro[:] = 0.0
    with pytest.raises(RateTableError, match="an output that changes with the rate"):
        fit_single_axis(steps, 0, Terms(), input_axis=ALONG, axis=None)


def test_an_output_beyond_what_the_model_can_have_has_no_rate() -> None:
    steps = exact_steps(RATES)
    steps.gyro[:, 0] -= 0.6 * LARGEST * (RATES / LARGEST) ** 3
    fit = fit_single_axis(steps, 0, Terms(nonlinearity=(3,)), input_axis=ALONG, axis=None)
    beside = np.array([0.1, -0.2])
    rate, error = fit.apply(np.array([10 * LARGEST, beside[0], -10 * LARGEST, beside[1]]))
    assert np.isnan([rate[::2], error[::2]]).all()
    # the others are corrected as without them; products of matrices of other shapes are rounded otherwise
    np.testing.assert_allclose([rate[1::2], error[1::2]], fit.apply(beside), rtol=1e-12)
