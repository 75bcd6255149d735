"""Three gyros on a rate table: S and b against truth, what is told and what not, and the correction."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import rate_table_records as records

from pipeline.models.rate_table_model import Terms
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
from pipeline.models.rate_table_triad_model import triad_names, triad_terms

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
    steps = measure_steps(motion, stretches, time, gyro)
    return Run(f"run_{along}", steps, records.TO_CASE[along], fixture, bias, AXIS)


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


def test_a_triad_turned_as_a_whole_has_a_rotation_and_no_nonorthogonality() -> None:
    phi = np.array([0.001, -0.002, 0.0015])
    turned = np.eye(3) - np.cross(np.eye(3), phi)  # n = 1 - [phi x]
    observed = exact((1, 2, 3))
    told = fit_triad(replace(observed, output=observed.rate @ turned.T + BIAS)).decomposed()
    for i in (1, 2, 3):
        # of first order in the angles
        assert told.of(f"triad_rotation_{i}")[0] == pytest.approx(phi[i - 1], abs=1e-5)
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
    fit = fit_triad(observed, Terms(bias_temperature=True), reference_temperature=293.15)
    np.testing.assert_allclose(fit.of("bias_temperature_sensitivity"), d, atol=1e-13)  # rounding
    np.testing.assert_allclose(fit.bias, BIAS, atol=1e-13)
    corrected, _ = fit.apply(observed.output, temperature)
    np.testing.assert_allclose(corrected, observed.rate, atol=1e-12)
    with pytest.raises(RateTableError, match="a temperature, for a calibration"):
        fit.apply(observed.output)
    with pytest.raises(RateTableError, match="a temperature, for a calibration"):
        fit_triad(exact((1, 2, 3)), Terms(bias_temperature=True))


TERMS = Terms(True, (2, 3), bias_temperature=True, scale_factor_temperature=True)
OWN = np.array([[3e-4, -2e-4, 1e-4], [1e-4, 2e-4, -3e-4], [2e-4, -1e-4, 3e-4]])
"""Asymmetry and nonlinearities of orders 2 and 3 of the three gyros."""
WARM = np.array([DEGREE * np.array([1e-3, -2e-3, 5e-4]), [3e-5, -2e-5, 4e-5]])
"""Sensitivities of bias and scale factor to the temperature."""
LARGEST = 100 * DEGREE


def bent(rate: np.ndarray, warmth: np.ndarray) -> np.ndarray:
    """What the gyros give for rates of the case, by the formula of the standards."""
    K = np.linalg.norm(S, axis=1)
    w = rate @ (S / K[:, np.newaxis]).T
    a, c2, c3 = OWN
    d, e = WARM
    t = warmth[:, np.newaxis]
    braces = w + a * np.abs(w) / 2 + c2 * w**2 / LARGEST + c3 * w**3 / LARGEST**2 + e * t * w
    return np.asarray(K * braces + BIAS + d * t)


def bent_steps(rates: np.ndarray = RATES, cases: tuple[int, ...] = (1, 2, 3)) -> Observations:
    """Means without noise of gyros with all terms, each rate twice, at another temperature."""
    rate = np.concatenate([np.outer(np.tile(rates, 2), np.eye(3)[along - 1]) for along in cases])
    temperature = np.tile(np.repeat([288.15, 300.15], len(rates)), len(cases))
    output = bent(rate, temperature - 293.15)
    error = np.full(output.shape, 1e-6)
    return Observations(rate, output, error, np.zeros((len(rate), 3, 0)), (), temperature)


def test_every_term_of_a_gyro_without_noise_is_exact() -> None:
    fit = fit_triad(bent_steps(), TERMS, reference_temperature=293.15)
    assert fit.names == triad_names(TERMS)
    np.testing.assert_allclose(fit.S, S, atol=1e-12)  # what the rounds leave of terms of 3e-4
    np.testing.assert_allclose(fit.bias, BIAS, atol=1e-13)  # rounding
    for name, truth in zip(TERMS.names[2:], [*OWN, *WARM], strict=True):
        np.testing.assert_allclose(fit.of(name), truth, atol=1e-11, err_msg=name)
    assert set(fit.observability.states) == {"determined"}


def test_an_asymmetry_that_is_left_out_is_in_the_biases() -> None:
    """What the terms are for: 200 ppm of |w| / 2 at 60 deg/s on the mean is 20 deg/h."""
    plain = fit_triad(bent_steps(), Terms(bias_temperature=True), reference_temperature=293.15)
    assert np.abs(plain.bias - BIAS).max() > 5 * DEGREE / 3600
    whole = fit_triad(bent_steps(), TERMS, reference_temperature=293.15)
    assert np.abs(whole.bias - BIAS).max() < 1e-6 * DEGREE / 3600


def test_the_correction_inverts_every_term() -> None:
    fit = fit_triad(bent_steps(), TERMS, reference_temperature=293.15)
    rng = np.random.default_rng(9)
    rate = rng.uniform(-0.9 * LARGEST, 0.9 * LARGEST, (200, 3))
    temperature = rng.uniform(280.0, 310.0, 200)
    corrected, error = fit.apply(bent(rate, temperature - 293.15), temperature)
    np.testing.assert_allclose(corrected, rate, atol=1e-10 * LARGEST)  # as exact as the calibration
    assert np.all(error > 0)


def test_the_standard_error_of_a_correction_is_that_of_its_parameters() -> None:
    """By finite differences of the correction, parameter by parameter."""
    fit = fit_triad(bent_steps(), TERMS, reference_temperature=293.15)
    raw, temperature = bent(np.array([[1.2, -0.9, 0.4]]), np.array([7.0])), np.array([300.15])
    J = []
    for k, size in enumerate(fit.standard_error):
        up, down = fit.value.copy(), fit.value.copy()
        up[k] += size
        down[k] -= size
        moved = [replace(fit, value=value).apply(raw, temperature)[0] for value in (up, down)]
        J.append((moved[0] - moved[1]) / (2 * size))
    wanted = np.sqrt(np.einsum("kna,kl,lna->na", np.array(J), fit.covariance, np.array(J)))
    # products of terms of 3e-4 are left out of the one, second differences of 1e-6 of the other
    np.testing.assert_allclose(fit.apply(raw, temperature)[1], wanted, rtol=2e-3)


@cache
def errors_with_terms(seeds: int) -> np.ndarray:
    """Normalised errors of S, biases and the gyros' own terms, shape (seeds, 18)."""
    terms = Terms(asymmetry=True, nonlinearity=(3,))
    exactly = bent_steps()
    exactly = replace(exactly, temperature=None, output=bent(exactly.rate, np.zeros(len(exactly))))
    straight = bent(exactly.rate, np.zeros(len(exactly))) - np.linalg.norm(S, axis=1) * OWN[1] * (
        (exactly.rate @ (S / np.linalg.norm(S, axis=1)[:, np.newaxis]).T) ** 2 / LARGEST
    )
    truth = np.concatenate([S.ravel(), BIAS, OWN[0], OWN[2]])
    found = []
    for seed in range(seeds):
        noise = records.white(np.random.default_rng(seed), straight.shape, 1e-6)
        fit = fit_triad(replace(exactly, output=straight + noise), terms)
        found.append((fit.value - truth) / fit.standard_error)
    return np.array(found)


def test_errors_of_every_term_over_their_standard_errors() -> None:
    errors = errors_with_terms(SEEDS)
    # 18 x 200 values, 3 of a kind: 2.9 %, three and a half times that; scatter that chance makes widens some
    for first in (0, 3, 6, 9, 12, 15):
        assert 0.9 < errors[:, first : first + 3].std() < 1.1
    assert np.all(np.abs(errors.mean(axis=0)) < 3.5 / np.sqrt(SEEDS))


def test_terms_that_the_rates_do_not_tell_are_refused_and_those_of_a_gyro_never_turned_are_said() -> None:
    with pytest.raises(
        RateTableError, match=r"gyro 1: expected steps that tell .* from scale_factor_asymmetry"
    ):
        fit_triad(bent_steps(np.abs(RATES)), Terms(asymmetry=True))
    fit = fit_triad(bent_steps(cases=(1, 2)), Terms(asymmetry=True))
    unknown = {n for n, e in zip(fit.names, fit.standard_error, strict=True) if np.isinf(e)}
    assert unknown == {"S13", "S23", "S33", "scale_factor_asymmetry_3"}
    with pytest.raises(RateTableError, match=r"scale_factor_asymmetry_3; .* fewer terms"):
        fit.apply(np.zeros((1, 3)))


@pytest.mark.parametrize("terms", [Terms(), Terms(True), TERMS, Terms(nonlinearity=(5,))])
def test_names_of_a_triad_tell_its_terms(terms: Terms) -> None:
    assert triad_terms(triad_names(terms)) == terms
    assert triad_terms(triad_names(terms, "pqr"), "pqr") == terms
    assert triad_terms(triad_names(terms)[:-1]) is None
    assert triad_terms(triad_names(terms), "pqr") is None


def test_a_step_at_rest_of_unknown_angle_counts_with_the_earth_rate_as_its_uncertainty() -> None:
    rng = np.random.default_rng(8)
    known = recorded_run(rng, 3, 0.0, 0.0, 0.0)
    blind = recorded_run(rng, 3, 0.0, 0.0, 0.0, encoder=False)
    assert np.isnan(blind.steps.turn[0]).all()
    assert not np.isnan(known.steps.turn).any()
    observed = observe_runs([blind])
    assert observed.unknowns == ("earth_rate_1_run_3_step_0", "earth_rate_2_run_3_step_0")
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
        observed = observe_runs([Run("run_0", steps, records.TO_CASE[along], 0.0, 0.0, None)])
        np.testing.assert_array_equal(observed.rate[0], 2.0 * np.eye(3)[along - 1])
