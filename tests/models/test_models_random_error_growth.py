"""Rotation: the paper's closed forms, against tables, quadrature and generated records."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.linalg import matmul_toeplitz

from pipeline.models.random_error import (
    Noise1,
    Noise2,
    Noise3,
    Quantisation,
    RandomError,
    RandomErrorError,
    RateRandomWalk,
    Term,
    White,
)
from pipeline.models.random_error_growth import (
    SCHULER,
    allan_variance,
    growth,
    kernel,
    peak,
    recommended_rate,
    reversing_coefficients,
    reversing_growth,
    schuler_growth,
    variance,
    variance_by_axis,
    worse_band,
    worse_bands,
)

Float = NDArray[np.float64]

RATE = np.deg2rad(3.0)
ORACLE = {
    Noise1(0.01, 0.01): (
        (7.357588823e-1, 18.00009080, 198.0000000),
        (1.320426640e-1, 7.692700525e-1, 7.103825398),
        7.038395345e-4,
        1.86,
    ),
    Noise2(0.01, 0.01, 0.01): (
        (6.904401243e-1, 10.00002470, 100.0000000),
        (1.559558571e-1, 8.496167138e-1, 7.856906707),
        7.785878192e-4,
        2.16,
    ),
    Noise3(0.01, 0.01, 0.01): (
        (8.892062347e-1, 18.99998660, 199.0000000),
        (9.629483444e-2, 1.926709155e-1, 1.145540093),
        1.058742534e-4,
        5.87,
    ),
}
TERMS = (*ORACLE, White(1e-4), RateRandomWalk(1e-4))


def by_name(term: Term) -> str:
    return term.name


@pytest.mark.parametrize("noise", ORACLE, ids=by_name)
def test_the_variance_is_the_oracle_s(noise: Term) -> None:
    at_rest, turning, coefficient, _ = ORACLE[noise]
    model, t = RandomError((noise,)), np.array([100.0, 1000.0, 10000.0])
    # The tables give ten digits
    np.testing.assert_allclose(variance(model, t), at_rest, rtol=1e-9)
    np.testing.assert_allclose(variance(model, t, RATE), turning, rtol=1e-9)
    assert growth(model, RATE) == pytest.approx(coefficient, rel=1e-9)


@pytest.mark.parametrize(
    ("noise", "at_rest", "turning"),
    [
        (Noise2(0.01, 0.01, 0.05), 0.8402339281, 9.108759897),
        (Noise3(0.01, 0.01, 0.05), 1.603547966, 9.306387640),
    ],
    ids=["noise2", "noise3"],
)
def test_resonance_is_the_oracle_s(noise: Term, at_rest: float, turning: float) -> None:
    model, t = RandomError((noise,)), np.array([1000.0])
    assert variance(model, t)[0] == pytest.approx(at_rest, rel=1e-9)
    assert variance(model, t, 0.05)[0] == pytest.approx(turning, rel=1e-9)


@pytest.mark.parametrize("phase", [0.0, 1.0, -1.5])
@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 0.9e-3, 0.999e-3, 1.001e-3, 1e-2, 0.3, 1.0])
def test_the_kernel_keeps_its_digits(size: float, phase: float) -> None:
    t, z = 7.0, size * np.exp(1j * phase)
    series = t**2 * sum((-z) ** k / math.factorial(k + 2) for k in range(30))
    # Beside the change of forms, 2 eps / |z| is lost by the closed one and |z|^4 / 360 by the series
    assert abs(kernel(np.array(z / t), np.array(t)) / series - 1) < 1e-12


@pytest.mark.parametrize("term", TERMS, ids=by_name)
@pytest.mark.parametrize("t", [3.0, 100.0])
def test_the_split_by_axis_is_the_double_integral(term: Term, t: float) -> None:
    def by_quadrature(wave: Callable[[Float], Float]) -> float:
        """E (int_0^t x(s) wave(s) ds)^2 = 2 int_0^t ds int_0^s du R(s, u) wave(s) wave(u)."""
        node, weight = np.polynomial.legendre.leggauss(80)
        s = 0.5 * t * (node + 1)
        if isinstance(term, White):
            return float(0.5 * t * weight @ (term.N * wave(s) ** 2))
        u = 0.5 * s[:, np.newaxis] * (node + 1)
        R = term.K**2 * u if isinstance(term, RateRandomWalk) else term.autocorrelation(s[:, np.newaxis] - u)
        inner = 0.5 * s * ((R * wave(u)) @ weight)
        return float(2 * 0.5 * t * weight @ (inner * wave(s)))

    model = RandomError((term,))
    along, across = variance_by_axis(model, np.array([t]), RATE)
    # 80 nodes are exact to rounding for these waves; rounding is that of the sum of both
    whole = along[0] + across[0]
    assert along[0] == pytest.approx(by_quadrature(lambda s: np.cos(RATE * s)), abs=1e-11 * whole)
    assert across[0] == pytest.approx(by_quadrature(lambda s: np.sin(RATE * s)), abs=1e-11 * whole)
    assert whole == pytest.approx(variance(model, np.array([t]), RATE)[0], rel=1e-12)


@pytest.mark.parametrize("term", TERMS, ids=by_name)
def test_a_slow_turn_is_none(term: Term) -> None:
    model, t = RandomError((term,)), np.array([50.0])
    at_rest = variance_by_axis(model, t, 0.0)
    slow = variance_by_axis(model, t, 2.1e-7)  # a turn of 1.05e-5, where the closed form of J2 begins
    assert at_rest[1][0] == 0
    assert slow[0][0] == pytest.approx(at_rest[0][0], rel=1e-9)  # its rounding is eps/1e-5
    assert abs(slow[1][0]) < 1e-9 * at_rest[0][0]


@pytest.mark.parametrize("term", TERMS, ids=by_name)
@pytest.mark.parametrize("omega", [0.0, RATE])
def test_generated_records_grow_as_predicted(term: Term, omega: float) -> None:
    # 1000 s in steps of 1 s: the sums differ from the integrals by (omega step)^2/12 = 2e-4 of them, the
    # deviation of a variance from 1500 records is 4e-2
    records, n, generator = 1500, 1001, np.random.default_rng(638)
    t = np.arange(n, dtype=np.float64)
    weights = np.ones(n)
    weights[[0, -1]] = 0.5  # the trapezium's; samples of white noise are means over the second that follows
    if isinstance(term, White):
        t, weights[:] = t + 0.5, 1.0
        weights[-1] = 0.0
    x = np.stack([term.generate(n, 1.0, generator) for _ in range(records)]) * weights
    components = x @ np.cos(omega * t), x @ np.sin(omega * t)
    model, end = RandomError((term,)), np.array([1000.0])
    total = components[0] ** 2 + components[1] ** 2
    z = (total.mean() - variance(model, end, omega)[0]) / (total.std() / np.sqrt(records))
    assert abs(z) < 3
    for component, expected in zip(components, variance_by_axis(model, end, omega), strict=True):
        if expected[0] > 0:
            assert abs(np.mean(component**2) / expected[0] - 1) < 3 * np.sqrt(2 / records)


@pytest.mark.parametrize("omega", [0.0, 1e-3])
def test_quantisation_leaves_its_first_and_last_reading(omega: float) -> None:
    # over 1000 s in steps of 0.1 s: what the turn within a step leaves of each reading is (omega step)^2 n
    # = 1e-4
    step, n, records = 0.1, 10_000, 1500
    term, generator = Quantisation(0.02), np.random.default_rng(639)
    model, end = RandomError((term,)), np.array([n * step])
    x = np.stack([step * term.generate(n, step, generator) for _ in range(records)])
    t = step * (np.arange(n) + 0.5)
    along, across = x @ np.cos(omega * t), x @ np.sin(omega * t)
    for component, expected in zip((along, across), variance_by_axis(model, end, omega), strict=True):
        # a variance from 1500 records, but for 1e-4 of the whole
        allowed = 3 * np.sqrt(2 / records) * expected[0] + 1e-3 * term.Q**2
        assert abs(np.mean(component**2) - expected[0]) < allowed
    assert variance(model, end, omega)[0] == pytest.approx(2 * term.Q**2, rel=1e-14)
    assert growth(model, omega) == schuler_growth(model, omega) == reversing_growth(model, RATE) == 0


@pytest.mark.parametrize("term", TERMS, ids=by_name)
def test_growth_is_the_slope_after_long_time(term: Term) -> None:
    model = RandomError((term,))
    turn = 2 * np.pi / RATE
    early, late = variance(model, np.array([100 * turn, 200 * turn]), RATE)
    # What is left of the transient after 120 time constants is below rounding; whole turns have no sine
    assert (late - early) / (100 * turn) == pytest.approx(float(growth(model, RATE)), rel=1e-9)


@pytest.mark.parametrize("omega", [0.0, 1e-6, 4.9e-3, 5.1e-3, 0.3])
def test_the_walk_is_the_integral(omega: float) -> None:
    t, K = 100.0, 2e-3

    def square(v: float) -> float:
        return K**2 * (v**2 if omega == 0 else (2 * np.sin(0.5 * omega * v) / omega) ** 2)

    value, _ = quad(square, 0, t, limit=200, epsrel=1e-12, epsabs=0)
    assert variance(RandomError((RateRandomWalk(K),)), np.array([t]), omega)[0] == pytest.approx(
        value, rel=1e-11
    )


@pytest.mark.parametrize("term", TERMS, ids=by_name)
@pytest.mark.parametrize("omega", [0.0, 0.06])
def test_schuler_s_growth_is_that_of_the_oscillator(term: Term, omega: float) -> None:
    schuler = 0.02  # shorter than the Earth's, so that a matrix of the record is small
    period = 2 * np.pi / schuler

    def power(periods: int) -> float:
        step = period / 300
        s = (np.arange(300 * periods) + 0.5) * step
        wave = np.cos(schuler * (periods * period - s)) * np.exp(1j * omega * s) * step
        if isinstance(term, White):
            return float(term.N / step * np.sum(np.abs(wave) ** 2))
        if isinstance(term, RateRandomWalk):
            return float((wave.conj() @ (term.K**2 * np.minimum.outer(s, s)) @ wave).real)
        R = term.autocorrelation(np.arange(len(wave)) * step)
        return float((wave.conj() @ matmul_toeplitz(R, wave)).real)

    slope = (power(8) - power(4)) / (4 * period)
    # Midpoints in steps of 1 s: (omega + schuler)^2/24, and the kink of R (mu step)^2/6, below 1e-3 of the
    # whole
    assert float(schuler_growth(RandomError((term,)), omega, schuler)) == pytest.approx(slope, rel=2e-3)


def test_schuler_s_growth_at_rest_is_half_the_density() -> None:
    model = RandomError(TERMS)
    assert float(schuler_growth(model, 0.0)) == pytest.approx(
        0.5 * float(model.psd(np.array(SCHULER))), rel=1e-14
    )


@pytest.mark.parametrize("noise", ORACLE, ids=by_name)
def test_a_reversing_carousel_costs_what_the_oracle_says(noise: Term) -> None:
    model = RandomError((noise,))
    ratio = reversing_growth(model, RATE) / float(growth(model, RATE))
    assert ratio == pytest.approx(ORACLE[noise][3], abs=0.006)  # three digits are given


@pytest.mark.parametrize("turns", [0.5, 1.0, 2.0])
def test_reversing_coefficients_are_the_transform(turns: float) -> None:
    n = 2**14
    phase = 2 * np.pi * turns * (1 - np.abs(1 - 2 * np.arange(n) / n))
    by_fft = np.fft.fft(np.exp(1j * phase)) / n
    k = np.arange(-20, 21)
    # The kinks alias by (turns/n)^2
    np.testing.assert_allclose(reversing_coefficients(turns, 20), by_fft[k], atol=1e-6)
    assert np.sum(np.abs(reversing_coefficients(turns)) ** 2) == pytest.approx(
        1, abs=1e-9
    )  # k^-4 beyond 4000


@pytest.mark.parametrize("term", TERMS[:-1], ids=by_name)
def test_reversing_growth_is_the_slope_of_the_double_sum(term: Term) -> None:
    period = 4 * np.pi / RATE

    def power(periods: int) -> float:
        step = period / 300
        wave = carousel((np.arange(300 * periods) + 0.5) / 300) * step
        if isinstance(term, White):
            return float(term.N / step * np.sum(np.abs(wave) ** 2))
        R = term.autocorrelation(np.arange(len(wave)) * step)
        return float((wave.conj() @ matmul_toeplitz(R, wave)).real)

    slope = (power(10) - power(5)) / (5 * period)
    # Midpoints in steps of 0.8 s, as above
    assert reversing_growth(RandomError((term,)), RATE) == pytest.approx(slope, rel=2e-3)


def test_reversing_growth_of_the_walk_is_the_mean_slope() -> None:
    K, period, n = 1e-4, 4 * np.pi / RATE, 4000
    # Var(t) = K^2 int_0^t |W(t) - W(u)|^2 du, W the integral of the wave: periodic, so that the slope over a
    # period is the mean over u, and depends on where in it t is
    W = np.cumsum(carousel((np.arange(n) + 0.5) / n)) * period / n
    slope = K**2 * 2 * np.var(W)
    # Sums in steps of period/4000: their square of the turn a step
    assert reversing_growth(RandomError((RateRandomWalk(K),)), RATE) == pytest.approx(slope, rel=1e-5)


def carousel(periods: Float) -> NDArray[np.complex128]:
    """exp(i theta) after so many periods of one turn each way."""
    return np.asarray(np.exp(2j * np.pi * (1 - np.abs(1 - 2 * (periods % 1)))))


def test_a_walk_under_a_carousel_of_broken_turns_grows_without_bound() -> None:
    assert reversing_growth(RandomError((RateRandomWalk(1e-4),)), RATE, turns=0.8) == np.inf


@pytest.mark.parametrize("kind", [Noise2, Noise3])
@pytest.mark.parametrize("ratio", [0.3, 0.7, 1.3, 3.0])
def test_bands_and_peaks(kind: type[Noise2] | type[Noise3], ratio: float) -> None:
    term = kind(0.01, 0.01, 0.01 * ratio)
    band, top = worse_band(term), peak(term)
    omega = np.linspace(1e-5, 0.1, 20001)
    worse = term.psd(omega) > term.psd(np.array(0.0)) * (1 + 1e-12)
    if band is None:
        assert not worse.any()
        assert top == 0
    else:
        np.testing.assert_array_equal(worse, omega < band.high)
        assert term.psd(np.array(band.high)) == pytest.approx(float(term.psd(np.array(0.0))), rel=1e-12)
        assert top == pytest.approx(omega[np.argmax(term.psd(omega))], abs=5.1e-6)  # the grid's half step
    lambda_, mu = term.lambda_, term.mu
    square = 3 * lambda_**2 - mu**2 if kind is Noise2 else 2 * (lambda_**2 - mu**2)
    assert (band is not None) == (square > 0)


@pytest.mark.parametrize("term", [Noise1(0.01, 0.01), White(1e-4), RateRandomWalk(1e-4)], ids=by_name)
def test_no_band_where_rotation_never_harms(term: Term) -> None:
    assert worse_band(term) is None
    assert peak(term) == 0
    assert worse_bands(RandomError((term, White(1.0)))) == ()


@pytest.mark.parametrize(
    "terms",
    [
        (Noise2(0.01, 0.01, 0.05), Noise1(0.01, 0.003)),
        (Noise2(0.01, 0.002, 0.02), Noise3(0.03, 0.002, 0.1), Noise1(0.02, 0.02)),
        (Noise3(0.01, 0.002, 0.02), Noise3(0.01, 0.002, 0.2)),
    ],
)
def test_the_bands_of_a_sum_are_where_it_is_worse(terms: tuple[Term, ...]) -> None:
    model = RandomError((*terms, White(1e-4)))
    omega = np.linspace(1e-5, 0.5, 50001)
    worse = growth(model, omega) > float(growth(model, 0.0)) * (1 + 1e-9)
    inside = np.zeros(len(omega), dtype=bool)
    for band in worse_bands(model):
        inside |= (omega > band.low) & (omega < band.high)
    np.testing.assert_array_equal(worse, inside)


def test_the_recommended_rate_of_noise_1_is_the_closed_form() -> None:
    sigma, mu, N, fraction = 0.01, 0.01, 1e-4, 0.1
    expected = np.sqrt(2 * sigma**2 * mu / (fraction * N) - mu**2)
    assert recommended_rate(RandomError((Noise1(sigma, mu), White(N))), fraction) == pytest.approx(
        expected, rel=1e-12
    )


@pytest.mark.parametrize(
    "terms",
    [
        (Noise2(0.01, 0.01, 0.05),),
        (Noise3(0.01, 0.01, 0.05),),
        (Noise2(0.01, 0.002, 0.02), Noise3(0.03, 0.002, 0.1)),
        (Noise1(0.01, 0.01), RateRandomWalk(1e-4)),
    ],
)
@pytest.mark.parametrize("fraction", [0.01, 0.3, 8.0])
def test_the_recommended_rate_is_the_smallest(terms: tuple[Term, ...], fraction: float) -> None:
    model, colour = RandomError((*terms, White(1e-4))), RandomError(terms)
    rate = recommended_rate(model, fraction)
    omega = np.linspace(0, 5, 500001)[1:]
    fits = growth(colour, omega) <= fraction * 1e-4
    for band in worse_bands(model):
        fits &= omega >= band.high
    if growth(colour, 0.0) <= fraction * 1e-4:
        assert rate == 0
    else:
        assert rate == pytest.approx(omega[np.argmax(fits)], abs=1.01e-5)  # the grid's step


def test_without_white_noise_there_is_no_rate_to_recommend() -> None:
    with pytest.raises(RandomErrorError, match="white noise"):
        recommended_rate(RandomError((Noise1(1.0, 1.0),)), 0.1)


def test_white_noise_alone_needs_no_rotation() -> None:
    assert recommended_rate(RandomError((White(1.0),)), 0.1) == 0


def test_the_allan_variance_has_its_slopes() -> None:
    tau = np.array([0.5, 10.0, 400.0])
    np.testing.assert_allclose(allan_variance(RandomError((White(1e-4),)), tau), 1e-4 / tau, rtol=1e-13)
    np.testing.assert_allclose(
        allan_variance(RandomError((RateRandomWalk(2e-3),)), tau), 4e-6 * tau / 3, rtol=1e-13
    )
    np.testing.assert_allclose(
        allan_variance(RandomError((Quantisation(2e-3),)), tau), 12e-6 / tau**2, rtol=1e-13
    )
    # Gauss-Markov noise, IEEE Std 952: Q_c^2 T_c^2 / tau (1 - T_c/(2 tau) (3 - 4 e^(-tau/T_c) + e^(-2
    # tau/T_c)))
    sigma, mu = 0.01, 0.02
    x = mu * tau
    by_standard = 2 * sigma**2 / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x))
    # The standard's form loses eps / x^3 where x is small, here 2e-10
    np.testing.assert_allclose(allan_variance(RandomError((Noise1(sigma, mu),)), tau), by_standard, rtol=1e-9)
