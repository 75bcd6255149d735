"""Noise coefficients against the truth of simulated records, by their own intervals."""

import numpy as np
import pytest
from power_law import PowerLaw
from scipy.stats import binom

from pipeline.numerics.allan import UnusableRecordError, from_integral, from_rates
from pipeline.numerics.noise_coefficients import NAMES, allan_terms, fit_coefficients, in_datasheet_units

STEP = 0.1
SAMPLES = 20_000
SEEDS = 100
N = 1e-5  # rad/sqrt(s)


def white(rng, n=SAMPLES):
    """Means over a step of white noise N."""
    return N / np.sqrt(STEP) * rng.standard_normal(n)


def walk(rng, K, n=SAMPLES):
    """Means over a step of a continuous random walk K: its value at the step's middle, and a bridge."""
    ends, bridge = rng.standard_normal((2, n))
    return K * np.sqrt(STEP) * (ends.cumsum() - ends / 2 + bridge / np.sqrt(12))


def fits(draw, present=None, seeds=SEEDS):
    return [fit_coefficients(draw(np.random.default_rng(seed), present)) for seed in range(seeds)]


def column(found, name, attribute):
    values = [getattr(fit.coefficients[NAMES.index(name)], attribute) for fit in found]
    return np.array([np.nan if value is None else value for value in values])


def held(found, name, truth):
    """Which intervals hold the truth."""
    return (column(found, name, "lower") <= truth) & (truth <= column(found, name, "upper"))


def judge(found, name, truth):
    """95 % intervals hold the truth as often as they say, and are no wider than three times the errors."""
    value, error = column(found, name, "value"), column(found, name, "standard_error")
    lower, upper = column(found, name, "lower"), column(found, name, "upper")
    # but once in a thousand sets of seeds
    assert np.sum(held(found, name, truth)) >= binom.ppf(1e-3, len(found), 0.95)
    rms = np.sqrt(np.nanmean((value - truth) ** 2))
    assert np.nanmean(upper - lower) / 2 <= 3 * rms  # asked for
    # 100 seeds know a spread to 7 %
    assert 0.79 < np.nanstd((value - truth) / error) < 1.21
    assert abs(np.nanmean(value - truth)) < 0.4 * rms  # 0.1 one sigma, and the bias of a few long tau


SCATTERED = np.ones(SAMPLES, dtype=bool)
for first in (1234, 1300, 5000, 9000, 15_500):
    SCATTERED[first : first + first // 10] = False


@pytest.mark.parametrize(
    ("crossing", "present"),  # the tau where N and K are equal, over the record's length
    [(0.005, None), (0.005, SCATTERED), (0.02, None)],
)
def test_n_and_k_lie_within_their_intervals(crossing, present):
    K = np.sqrt(3) * N / (crossing * SAMPLES * STEP)

    def draw(rng, present):
        return from_rates(0.3 + white(rng) + walk(rng, K), STEP, present)

    found = fits(draw, present)
    for name, truth in {"N": N, "K": K}.items():
        judge(found, name, truth)
        # asked for: 95 of 100, here of the seeds 0 to 99. Other hundreds hold 91 to 99, as 95 % intervals do
        assert np.sum(held(found, name, truth)[:SEEDS]) >= 95
    # Another slow term that explains the record as well is a near thing where K shows at long tau alone.
    assert np.mean([fit.left_out == ("Q", "B", "R") for fit in found]) >= 0.9


@pytest.mark.nightly
@pytest.mark.parametrize(("crossing", "present"), [(0.005, None), (0.005, SCATTERED), (0.02, None)])
def test_the_intervals_hold_the_truth_as_often_as_they_say(crossing, present):
    K = np.sqrt(3) * N / (crossing * SAMPLES * STEP)
    found = fits(lambda rng, present: from_rates(white(rng) + walk(rng, K), STEP, present), present, 2000)
    for name, truth in {"N": N, "K": K}.items():
        # 2000 seeds know 95 % to 0.5 %: three times that
        assert abs(np.mean(held(found, name, truth)) - 0.95) < 0.015


def test_white_noise_shows_nothing_else():
    found = fits(lambda rng, _: from_rates(0.3 + white(rng), STEP))
    judge(found, "N", N)
    assert sum(fit.left_out == ("Q", "B", "K", "R") for fit in found) >= 97


def test_flicker_beside_white_noise():
    B = 3e-6
    flicker = PowerLaw(-1, SAMPLES)
    found = fits(
        lambda rng, _: from_integral(
            np.append(0, STEP * white(rng).cumsum()) + B * STEP * flicker.draw(rng), STEP
        )
    )
    judge(found, "N", N)
    judge(found, "B", B)
    assert sum(fit.left_out == ("Q", "K", "R") for fit in found) >= 90


def test_quantisation_and_a_ramp_beside_white_noise():
    Q, R = 8e-6, 4e-8  # equal to N at 0.4 s and after 60 s

    def draw(rng, _):
        t = STEP * np.arange(SAMPLES + 1)
        angle = np.append(0, STEP * white(rng).cumsum()) + R * t**2 / 2
        return from_integral(angle + Q * rng.standard_normal(len(t)), STEP)

    found = fits(draw)
    judge(found, "Q", Q)
    judge(found, "N", N)
    judge(found, "R", R)


def test_a_term_that_does_not_show_has_an_upper_bound_that_holds():
    K = np.sqrt(3) * N / (0.2 * SAMPLES * STEP)
    found = fits(lambda rng, _: from_rates(white(rng) + walk(rng, K), STEP))
    hidden = np.isnan(column(found, "K", "value"))
    assert hidden.sum() >= 20
    assert np.mean(column(found, "K", "upper")[hidden] >= K) >= 0.9  # of 95 %, of those with least to show
    assert np.all(column(found, "K", "lower")[hidden] == 0)


def test_the_spread_of_the_variances_is_that_of_the_seeds():
    K = np.sqrt(3) * N / (0.01 * SAMPLES * STEP)
    found = fits(lambda rng, _: from_rates(white(rng) + walk(rng, K), STEP))
    spread = np.std([fit.variance for fit in found], axis=0)
    # 100 seeds know a spread to 7 %, and to twice that where few degrees of freedom make it long-tailed; each
    # record scales it by its own K, which is right on average
    np.testing.assert_allclose(np.mean([fit.standard_error for fit in found], axis=0), spread, rtol=0.35)


def test_the_model_is_the_sum_of_the_terms():
    fit = fit_coefficients(from_rates(white(np.random.default_rng(1)), STEP))
    assert fit.model(np.array([2.0]))[0] == pytest.approx(fit.coefficients[1].value ** 2 / 2, rel=1e-14)
    assert fit.criterion[("N",)] == 0
    assert min(fit.criterion.values()) == 0
    np.testing.assert_allclose(
        allan_terms(np.array([2.0])), [[0.75, 0.5, 2 * np.log(2) / np.pi, 2 / 3, 2]], rtol=1e-15
    )
    assert np.count_nonzero(fit.covariance) == 1


@pytest.mark.parametrize("scale", [1e-12, 1e9])
def test_units_of_the_rate_make_no_difference(scale):
    rates = white(np.random.default_rng(2)) + walk(np.random.default_rng(3), 1e-6)
    plain, scaled = (fit_coefficients(from_rates(factor * rates, STEP)) for factor in (1.0, scale))
    assert plain.left_out == scaled.left_out
    for name in ("N", "K"):
        one, other = (column([fit], name, "value")[0] for fit in (plain, scaled))
        assert other == pytest.approx(scale * one, rel=1e-5)  # the iteration ends at 1e-5


def test_datasheet_units():
    degree = np.pi / 180
    for name, si, unit in (
        ("Q", degree / 3600, "arcsec"),
        ("N", degree / np.sqrt(3600), "deg/sqrt(h)"),
        ("B", degree / 3600, "deg/h"),
        ("K", degree / 3600 / np.sqrt(3600), "deg/h/sqrt(h)"),
        ("R", degree / 3600 / 3600, "deg/h/h"),
    ):
        value, found = in_datasheet_units(name, si)
        assert (pytest.approx(value, rel=1e-14), found) == (1.0, unit)


def test_records_that_tell_nothing_are_refused():
    with pytest.raises(UnusableRecordError, match="too short for noise coefficients: 30 samples"):
        fit_coefficients(from_rates(np.arange(31.0) % 3, STEP))
    with pytest.raises(UnusableRecordError, match="does not vary"):
        fit_coefficients(from_rates(np.full(1000, 0.25), STEP))
