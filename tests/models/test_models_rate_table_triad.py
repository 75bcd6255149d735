"""Three gyros on a rate table: S and b against truth, what is told and what not, and the correction."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import rate_table_records as records

from pipeline.models.rate_table_observations import Observations, Run, joined, observe_runs
from pipeline.models.rate_table_steps import (
    Motion,
    RateTableError,
    Steps,
    TableAxis,
    constant_stretches,
    measure_steps,
)
from pipeline.models.rate_table_triad import Triad, fit_triad

DEGREE = records.DEGREE
AXIS = TableAxis(50 * DEGREE, 0.3, 0.0)
RATES = DEGREE * np.array([0.0, 50.0, -50.0, 100.0, -100.0])
STEP = 0.05
S = np.array([[1.003, 0.002, -0.001], [0.0015, 0.998, 0.0025], [-0.002, 0.0005, 1.001]])
BIAS = DEGREE * np.array([0.01, -0.02, 0.03])
TRUTH = np.concatenate([S.ravel(), BIAS])
SEEDS = 200


def recorded_run(
    rng: np.random.Generator, along: int, share: float, fixture: float, bias: float, *, encoder: bool = True
) -> Run:
    """Steps about one axis of the case, in a fixture and with biases that are not quite known."""
    time, rate, angle = records.table(records.corners(RATES, 30.0), STEP)
    rotor = AXIS.on_rotor(np.stack([np.cos(angle), np.sin(angle)], axis=1))
    rotor[:, 2] += rate
    case = rotor @ records.TO_CASE[along].T
    case = case + np.cross(records.white(rng, (3,), fixture), case) + records.white(rng, (3,), bias)
    sigma = 0.02 * DEGREE
    gyro = case @ S.T + BIAS + records.white(rng, case.shape, sigma)
    if share:
        gyro += records.coloured(rng, case.shape, share * sigma, 2.0, STEP)
    motion = Motion.of_angle(time, angle) if encoder else Motion.of_rate(time, rate)
    stretches = constant_stretches(motion, shortest=20.0, settling=1.0)
    return Run(measure_steps(motion, stretches, time, gyro), records.TO_CASE[along], fixture, bias, AXIS)


def calibrated(seed: int, share: float, fixture: float = 0.0, bias: float = 0.0) -> Triad:
    rng = np.random.default_rng(seed)
    return fit_triad(observe_runs([recorded_run(rng, along, share, fixture, bias) for along in (1, 2, 3)]))


@cache
def errors(share: float, fixture: float, bias: float, seeds: int) -> tuple[np.ndarray, np.ndarray]:
    """Normalised errors of scale factors and of misalignments, shapes (seeds, 3) and (seeds, 6)."""
    found = []
    for seed in range(seeds):
        fit = calibrated(seed, share, fixture, bias)
        told = fit.decomposed()
        truth = replace(fit, value=TRUTH).decomposed()
        found.append((told.value - truth.value) / told.standard_error)
    return np.array(found)[:, :3], np.array(found)[:, 3:9]


def test_errors_over_standard_errors_with_white_noise() -> None:
    for part in errors(0.0, 0.0, 0.0, SEEDS):
        # 600 and 1200 values: the band of the requirement is 3.5 and 5 standard deviations
        assert 0.9 < part.std() < 1.1
        assert np.all(np.abs(part.mean(axis=0)) < 3.5 / np.sqrt(SEEDS))


def test_errors_over_standard_errors_with_coloured_noise() -> None:
    for part in errors(0.2, 0.0, 0.0, SEEDS):
        assert 0.85 < part.std() < 1.2


def test_errors_of_fixture_and_biases_are_in_the_standard_errors() -> None:
    scale, misalignment = errors(0.0, 1e-4, 0.01 * DEGREE, 60)
    # 180 and 360 values: 5.3 % and 3.7 %, three times that
    assert 0.84 < scale.std() < 1.16
    assert 0.88 < misalignment.std() < 1.12


def exact(cases: tuple[int, ...], temperature: np.ndarray | None = None) -> Observations:
    """Means without noise, about axes of the case."""
    rate = np.concatenate([np.outer(RATES, np.eye(3)[along - 1]) for along in cases])
    output = rate @ S.T + BIAS
    return Observations(
        rate, output, np.full(output.shape, 1e-6), np.zeros((len(rate), 3, 0)), (), temperature
    )


def test_without_noise_s_and_b_are_exact() -> None:
    fit = fit_triad(exact((1, 2, 3)))
    np.testing.assert_allclose(fit.S, S, atol=1e-13)  # rounding
    np.testing.assert_allclose(fit.bias, BIAS, atol=1e-13)
    assert set(fit.observability.states) == {"determined"}
    assert fit.determined


def test_decomposition_into_scale_factors_and_angles() -> None:
    told = fit_triad(exact((1, 2, 3))).decomposed()
    n = S / np.linalg.norm(S, axis=1)[:, np.newaxis]
    assert told.of("scale_factor_2")[0] == pytest.approx(np.linalg.norm(S[1]), abs=1e-12)
    assert told.of("misalignment_12")[0] == pytest.approx(n[0, 1], abs=1e-12)
    between = np.arccos(n[0] @ n[2])
    assert told.of("nonorthogonality_13")[0] == pytest.approx(np.pi / 2 - between, abs=1e-12)


def test_a_triad_turned_as_a_whole_has_a_mounting_and_no_nonorthogonality() -> None:
    phi = np.array([0.001, -0.002, 0.0015])
    turned = np.eye(3) - np.cross(np.eye(3), phi)  # n = 1 - [phi x]
    observed = exact((1, 2, 3))
    told = fit_triad(replace(observed, output=observed.rate @ turned.T + BIAS)).decomposed()
    for i in (1, 2, 3):
        # of first order in the angles
        assert told.of(f"mounting_{i}")[0] == pytest.approx(phi[i - 1], abs=1e-5)
    for pair in ("12", "13", "23"):
        assert told.of(f"nonorthogonality_{pair}")[0] == pytest.approx(0.0, abs=1e-5)


def test_a_negative_gyro_has_a_negative_scale_factor_and_small_angles() -> None:
    observed = exact((1, 2, 3))
    flipped = replace(observed, output=observed.output * [-1.0, 1.0, 1.0])
    told, plain = fit_triad(flipped).decomposed(), fit_triad(observed).decomposed()
    assert told.of("scale_factor_1")[0] == pytest.approx(-plain.of("scale_factor_1")[0], abs=1e-12)
    assert told.of("misalignment_12")[0] == pytest.approx(plain.of("misalignment_12")[0], abs=1e-12)


def test_what_two_axes_do_not_tell_is_named() -> None:
    fit = fit_triad(exact((1, 2)))
    unknown = {n for n, e in zip(fit.names, fit.standard_error, strict=True) if np.isinf(e)}
    assert unknown == {"S13", "S23", "S33"}
    states = dict(zip(fit.observability.names, fit.observability.states, strict=True))
    assert states["S33"] == "undetermined"
    assert states["S11"] == states["S21"] == states["bias_3"] == "determined"
    told = fit.decomposed
    with pytest.raises(RateTableError, match="gyro 3: expected a response"):
        told()
    with pytest.raises(RateTableError, match="nothing that tells S13, S23, S33"):
        fit.apply(np.zeros((1, 3)))


def test_an_unknown_fixture_leaves_only_scale_factors() -> None:
    rng = np.random.default_rng(2)
    runs = [recorded_run(rng, along, 0.0, 0.0, 0.0) for along in (1, 2, 3)]
    loose = [replace(run, orientation_error=0.05) for run in runs]
    told = fit_triad(observe_runs(loose)).decomposed()
    # Misalignments are hardly better known than the fixture (the Earth's rate at rest tells it to 0.3 rad,
    # which takes 3 % off), scale factors to the fixture's error times the misalignment.
    assert told.of("misalignment_12")[1] == pytest.approx(0.05, rel=0.05)
    assert told.of("nonorthogonality_12")[1] == pytest.approx(0.05 * np.sqrt(2), rel=0.05)
    assert told.of("scale_factor_1")[1] < 0.05**2


def test_correction_and_its_uncertainty() -> None:
    rng = np.random.default_rng(7)
    rate = records.white(rng, (50, 3), 50 * DEGREE)
    raw = rate @ S.T + BIAS
    normalised = []
    for seed in range(40):
        corrected, error = calibrated(seed, 0.0).apply(raw)
        normalised.append((corrected - rate) / error)
    # 40 calibrations of 12 parameters: 480 independent values, 3.2 %, three times that
    assert 0.9 < np.std(normalised) < 1.1
    # and it is small: 0.02 deg/s a sample over 500 samples is 0.001 deg/s
    assert np.abs(corrected - rate).max() < 0.02 * DEGREE


def test_bias_temperature() -> None:
    temperature = np.tile(293.15 + np.array([0.0, 10.0, -10.0, 5.0, -5.0]), 3)
    observed = exact((1, 2, 3), temperature)
    d = DEGREE * np.array([1e-3, -2e-3, 0.0])
    observed = replace(observed, output=observed.output + np.outer(temperature - 293.15, d))
    fit = fit_triad(observed, bias_temperature=True, reference_temperature=293.15)
    np.testing.assert_allclose(fit.bias_temperature_sensitivity, d, atol=1e-13)  # rounding
    np.testing.assert_allclose(fit.bias, BIAS, atol=1e-13)
    corrected, _ = fit.apply(observed.output, temperature)
    np.testing.assert_allclose(corrected, observed.rate, atol=1e-12)
    with pytest.raises(RateTableError, match="a temperature, for a calibration"):
        fit.apply(observed.output)
    with pytest.raises(RateTableError, match="a temperature, for a calibration"):
        fit_triad(exact((1, 2, 3)), bias_temperature=True)


def test_a_step_at_rest_of_unknown_angle_counts_with_the_earth_rate_as_its_uncertainty() -> None:
    rng = np.random.default_rng(8)
    known = recorded_run(rng, 3, 0.0, 0.0, 0.0)
    blind = recorded_run(rng, 3, 0.0, 0.0, 0.0, encoder=False)
    assert np.isnan(blind.steps.turn[0]).all()
    assert not np.isnan(known.steps.turn).any()
    observed = observe_runs([blind])
    assert observed.unknowns == ("earth_rate_1_run_1_step_1", "earth_rate_2_run_1_step_1")
    expected = AXIS.across / np.sqrt(2) * np.eye(3)[:, :2]
    np.testing.assert_allclose(observed.unknown[0], expected, rtol=1e-12)
    assert not observed.unknown[1:].any()


def test_too_little_is_an_error() -> None:
    few = exact((1, 2, 3))
    few = Observations(few.rate[:3], few.output[:3], few.standard_error[:3], few.unknown[:3], ())
    with pytest.raises(RateTableError, match="at least 4 mean rates") as caught:
        fit_triad(few)
    assert caught.value.exit_code == 1
    still = exact((1, 2, 3))
    with pytest.raises(RateTableError, match="rotation that is known"):
        fit_triad(replace(still, rate=np.zeros_like(still.rate)))
    with pytest.raises(RateTableError, match="gyro 2: expected an output that changes"):
        fit_triad(replace(still, output=still.output * [1.0, 0.0, 1.0]))
    with pytest.raises(RateTableError, match="1 of 2 runs with one"):
        joined([still, replace(still, temperature=np.full(len(still), 300.0))])


def test_steps_of_runs_are_turned_into_the_case() -> None:
    steps = Steps(
        np.zeros(1), np.ones(1), np.array([2.0]), np.zeros((1, 2)), np.zeros((1, 3)), np.ones((1, 3))
    )
    for along in (1, 2, 3):
        observed = observe_runs([Run(steps, records.TO_CASE[along], 0.0, 0.0, None)])
        np.testing.assert_array_equal(observed.rate[0], 2.0 * np.eye(3)[along - 1])
