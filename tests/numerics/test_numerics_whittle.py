"""The debiased Whittle likelihood: expected periodograms against dense covariances, and its maximum."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.numerics import cosine_spectrum, whittle
from pipeline.numerics.cosine_spectrum import Periodogram
from pipeline.numerics.whittle import Process

Float = NDArray[np.float64]

THETA = np.log([1.5, 0.08, 0.4, 0.7])


def oscillation(theta: Float) -> Process:
    """``R_j = white delta_j + a exp(-d j) cos(w j)``; a, d, w and white by their logarithms."""
    a, d, w, white = np.exp(theta)
    d_c, d_p = np.zeros((4, 1), dtype=complex), np.zeros((4, 1), dtype=complex)
    d_c[0], d_p[1], d_p[2] = a, d, -1j * w
    d_levels = np.zeros((4, 3))
    d_levels[3, 0] = white
    return Process(d_levels[3], np.array([a + 0j]), np.array([d - 1j * w]), d_levels, d_c, d_p)


def of_levels(theta: Float) -> Process:
    """White noise, random walk and differenced white noise by the logarithms of their levels."""
    none = np.zeros((3, 0), dtype=complex)
    return Process(np.exp(theta), none[0], none[0], np.diag(np.exp(theta)), none, none)


def autocorrelation(theta: Float, n: int) -> Float:
    a, d, w, white = np.exp(theta)
    j = np.arange(n)
    R: Float = a * np.exp(-d * j) * np.cos(w * j)
    R[0] += white
    return R


def dense_expectation(R: Float, observed: NDArray[np.bool_]) -> Float:
    """E |sum of observed x_j exp(-i omega_k j)|^2 / n from the covariance matrix."""
    n = len(R)
    j = np.arange(n)
    covariance = R[np.abs(np.subtract.outer(j, j))] * np.outer(observed, observed)
    F = np.exp(-2j * np.pi / n * np.outer(np.arange(1, n // 2 + 1), j))
    expectation: Float = np.einsum("ka,ab,kb->k", F, covariance, F.conj(), optimize=True).real / n
    return expectation


def cosines(n: int) -> Float:
    """The rows of the cosine transform but the constant one."""
    return np.sqrt(2 / n) * np.cos(np.pi / n * np.outer(np.arange(1, n), np.arange(n) + 0.5))


def dense_covariance(R: Float) -> Float:
    """Covariance matrix of the cosine transform."""
    j, U = np.arange(len(R)), cosines(len(R))
    return np.asarray(U @ R[np.abs(np.subtract.outer(j, j))] @ U.T)


def simulated(theta: Float, n: int, seed: int) -> Float:
    """A record of `oscillation` by circulant embedding, exact."""
    R = autocorrelation(theta, 2 * n)
    power = np.fft.fft(np.concatenate([R, R[-2:0:-1]])).real
    generator = np.random.default_rng(seed)
    white = generator.standard_normal(len(power)) + 1j * generator.standard_normal(len(power))
    x: Float = np.fft.fft(np.sqrt(np.maximum(power, 0)) * white).real[:n] / np.sqrt(len(power))
    return x


@pytest.mark.parametrize("n", [64, 65, 300])
def test_the_closed_form_is_the_dense_expectation(n: int) -> None:
    f, _ = whittle.expected(cosine_spectrum.grid(n), oscillation(THETA))
    # Rounding of n terms
    np.testing.assert_allclose(f, np.diag(dense_covariance(autocorrelation(THETA, n))), rtol=1e-11)


@pytest.mark.parametrize("n", [64, 65])
def test_white_noise_and_a_walk_are_diagonal_and_their_variances_exact(n: int) -> None:
    """The likelihood of white noise with a random walk is that of the samples themselves."""
    white, walk, difference = theta = np.log([0.3, 0.02, 1.2])
    j, U = np.arange(n), cosines(n)
    of_walk = np.exp(walk) * np.minimum.outer(j, j)
    covariance = U @ (of_walk + np.exp(white) * np.eye(n)) @ U.T
    f, _ = whittle.expected(cosine_spectrum.grid(n), of_levels(np.array([white, walk, -np.inf])))
    # Rounding of the walk's whole variance, n q = 1.3
    np.testing.assert_allclose(covariance, np.diag(f), atol=1e-13)
    R = np.zeros(n)
    R[:2] = np.exp(difference) * np.array([2.0, -1.0])
    f, _ = whittle.expected(cosine_spectrum.grid(n), of_levels(theta))
    np.testing.assert_allclose(f, np.diag(covariance + dense_covariance(R)), rtol=1e-12)


def test_runs_are_transformed_each_by_itself() -> None:
    x = simulated(THETA, 1000, seed=7)
    observed = np.ones(1000, dtype=bool)
    observed[400:500] = observed[990] = False  # what is behind the second gap is too short to be a run
    spectrum = cosine_spectrum.periodogram(np.where(observed, x, np.nan), observed)
    assert spectrum.runs == ((400, 399), (490, 489))
    assert spectrum.samples == 890
    parts = [cosine_spectrum.periodogram(x[:400]), cosine_spectrum.periodogram(x[500:990])]
    np.testing.assert_array_equal(spectrum.value, np.concatenate([one.value for one in parts]))
    f, df = whittle.expected(spectrum, oscillation(THETA))
    for rows, one in zip((slice(0, 399), slice(399, 888)), parts, strict=True):
        of_one, d_of_one = whittle.expected(one, oscillation(THETA))
        np.testing.assert_array_equal(f[rows], of_one)
        np.testing.assert_array_equal(df[:, rows], d_of_one)


@pytest.mark.parametrize("share", [0.8, 0.5])
def test_with_dense_gaps_it_is_the_dense_expectation(share: float) -> None:
    n = 240  # a length of quick FFT, so that no rows are added
    observed = np.random.default_rng(2).random(n) < share
    spectrum = cosine_spectrum.periodogram(np.random.default_rng(3).standard_normal(n), observed)
    assert not spectrum.walks
    f, _ = whittle.expected(spectrum, oscillation(THETA))
    np.testing.assert_allclose(f, dense_expectation(autocorrelation(THETA, n), observed), rtol=1e-10)
    R = np.zeros(n)
    R[:2] = 1.2 * np.array([2.0, -1.0])
    f, _ = whittle.expected(spectrum, of_levels(np.array([-np.inf, -np.inf, np.log(1.2)])))
    np.testing.assert_allclose(f, dense_expectation(R, observed), rtol=1e-10)
    assert spectrum.samples == observed.sum()
    assert spectrum.count.sum() == pytest.approx(observed.sum() - 1)


@pytest.mark.parametrize("gaps", [False, True])
def test_derivatives_are_those_of_the_expected_values(gaps: bool) -> None:
    observed = np.random.default_rng(2).random(256) < (0.8 if gaps else 2)
    spectrum = cosine_spectrum.periodogram(np.random.default_rng(3).standard_normal(256), observed)
    _, df = whittle.expected(spectrum, oscillation(THETA))
    for k, step in enumerate(1e-5 * np.eye(4)):
        above, below = (whittle.expected(spectrum, oscillation(THETA + s))[0] for s in (step, -step))
        # Central differences: eps/1e-5 of f, and 1e-10 of its third derivative
        np.testing.assert_allclose(df[k], (above - below) / 2e-5, atol=1e-8 * np.abs(df[k]).max())


def test_slow_decay_keeps_its_digits() -> None:
    """A line far narrower than the record's resolution: nearly a constant, with little off zero."""
    n, theta = 512, np.log([1.0, 1e-9, 1e-9, 1e-12])
    f, _ = whittle.expected(cosine_spectrum.grid(n), oscillation(theta))
    # R_j = 1 - d j to first order is the walk of q = 2 d. Of odd ordinates the parts of f are 2/(n d) times
    # as large as itself and cancel: 4e6 eps are left
    omega = np.pi / n * np.arange(1, n)
    np.testing.assert_allclose(f - 1e-12, 0.5e-9 / np.sin(0.5 * omega) ** 2, rtol=1e-6, atol=1e-13)


@pytest.mark.parametrize("n", [500, 501])
def test_the_periodogram_is_of_the_deviations_from_the_mean(n: int) -> None:
    x = np.random.default_rng(1).standard_normal(n) + 1e3
    spectrum = cosine_spectrum.periodogram(x)
    by_product = (cosines(n) @ (x - x.mean())) ** 2
    np.testing.assert_allclose(spectrum.value, by_product, rtol=1e-9, atol=1e-9)  # of 1e3 eps
    # Parseval: the n - 1 ordinates hold all of the variance
    assert spectrum.count @ spectrum.value == pytest.approx(n * np.var(x), rel=1e-12)
    assert spectrum.count.sum() == n - 1


def test_a_long_record_is_binned_without_loss() -> None:
    n = 10**6
    x = np.random.default_rng(1).standard_normal(n)
    spectrum = cosine_spectrum.periodogram(x)
    assert spectrum.length == n
    assert (
        len(spectrum.omega)
        < cosine_spectrum.SINGLE
        + 1.01 * cosine_spectrum.BINS_AN_E_FOLD * np.log(n / cosine_spectrum.SINGLE)
        + 2
    )
    assert spectrum.count @ spectrum.value == pytest.approx(n * np.var(x), rel=1e-12)
    # At the mean frequency of a bin f is its mean but for width^2 f''/(24 f): 1e-3 for a line ten times the
    # width of its bin
    theta = np.log([1.5, 3e-3, 0.3, 0.7])
    f, _ = whittle.expected(spectrum, oscillation(theta))
    mean = np.add.reduceat(by_transforms(autocorrelation(theta, n)), spectrum.first)
    mean /= np.diff(np.append(spectrum.first, n - 1))
    np.testing.assert_allclose(f, mean, rtol=2e-3)


def by_transforms(R: Float) -> Float:
    """The expected values as their definition's two sums over the lags, by FFTs of twice the length."""
    n = len(R)
    whole = np.fft.fft((1 - np.arange(n) / n) * R, 2 * n)[1:n]
    across = np.fft.fft(R, 2 * n)[1:n]
    f: Float = 2 * whole.real - R[0] + 2 * across.imag / (n * np.sin(np.pi / n * np.arange(1, n)))
    return f


def test_an_awkward_length_is_trimmed_a_little() -> None:
    x = np.random.default_rng(1).standard_normal(262147)  # a prime
    spectrum = cosine_spectrum.periodogram(x)
    assert 0.99 * len(x) < spectrum.samples <= len(x)


def test_blocks_with_gaps_keep_the_power(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cosine_spectrum, "LONGEST_BLOCK", 1000)
    x = simulated(THETA, 4700, seed=4)
    observed = np.random.default_rng(5).random(4700) < 0.8  # no runs
    spectrum = cosine_spectrum.periodogram(np.where(observed, x, np.nan), observed)
    assert spectrum.length <= 1000
    f, _ = whittle.expected(spectrum, oscillation(THETA))
    # 3760 samples with a correlation of ten: the mean of I/f is known to about sqrt(2/3760) where f is white
    assert np.average(spectrum.value / f, weights=spectrum.count) == pytest.approx(
        1, abs=4 * np.sqrt(2 / 3760)
    )
    assert spectrum.count.sum() == pytest.approx(
        observed.sum(), rel=2e-3
    )  # less one, of each block's ordinates


def test_the_likelihood_of_a_bin_is_that_of_its_ordinates() -> None:
    generator = np.random.default_rng(6)
    value, f = generator.exponential(size=12), np.full(12, 1.3)
    first = np.arange(12)
    single = Periodogram(np.ones(12), value, np.ones(12), 13, 13, ((13, 12),), np.zeros(12), None, first)
    mean, count = value.mean(keepdims=True), np.array([12.0])
    binned = Periodogram(np.ones(1), mean, count, 13, 13, ((13, 1),), np.zeros(1), None, first[:1])
    assert whittle.minus_two_log_likelihood(binned, f[:1]) == pytest.approx(
        whittle.minus_two_log_likelihood(single, f), rel=1e-14
    )


def test_the_maximum_is_found_and_its_errors_are_honest() -> None:
    records, n = 60, 2000
    lower, upper = THETA - 6, THETA + 6
    z = np.empty((records, 4))
    for seed in range(records):
        spectrum = cosine_spectrum.periodogram(simulated(THETA, n, seed))
        fit = whittle.fit(spectrum, oscillation, [THETA + 0.5, THETA - 0.5], lower, upper)
        assert fit.converged
        f, df = whittle.expected(spectrum, oscillation(fit.theta))
        slope = (df / f) @ (spectrum.count * (1 - spectrum.value / f))
        # In units of the information; the search ends at a decrease of 1e-7 in -2 ln L
        assert slope @ np.linalg.solve(fit.information, slope) < 1e-4
        z[seed] = (fit.theta - THETA) / np.sqrt(np.diag(np.linalg.inv(fit.information)))
    # Of 60 normal deviates the mean is 0 +- 0.13 and the square's mean 1 +- 0.18
    assert np.all(np.abs(z.mean(axis=0)) < 4 * 0.13)
    assert np.all(np.abs((z**2).mean(axis=0) - 1) < 4 * 0.18)


def test_a_bound_is_kept() -> None:
    spectrum = cosine_spectrum.periodogram(simulated(THETA, 2000, 1))
    upper = THETA + 6
    upper[1] = THETA[1] - 1
    fit = whittle.fit(spectrum, oscillation, [THETA - 2], THETA - 6, upper)
    assert fit.theta[1] == upper[1]


def test_whiteness_is_a_probability() -> None:
    model, p = oscillation(THETA), []
    half = np.ones(1000, dtype=bool)
    half[500:503] = False
    for seed in range(400):
        observed = half if seed % 2 else None  # of two runs as well
        spectrum = cosine_spectrum.periodogram(simulated(THETA, 1000, seed), observed)
        p.append(whittle.band_whiteness(spectrum, whittle.expected(spectrum, model)[0], 0)[1])
    # Uniform: of 400 below 0.1 there are 40 +- 6
    assert abs(np.sum(np.array(p) < 0.1) - 40) < 3 * 6
    assert abs(np.mean(p) - 0.5) < 4 * np.sqrt(1 / 12 / 400)


def test_whiteness_sees_a_line_that_was_left_out() -> None:
    spectrum = cosine_spectrum.periodogram(simulated(THETA, 1000, 1))
    flat = np.full(len(spectrum.omega), float(np.average(spectrum.value, weights=spectrum.count)))
    assert whittle.band_whiteness(spectrum, flat, 1)[1] < 1e-6
