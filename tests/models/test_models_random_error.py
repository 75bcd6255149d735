"""Random errors: what their formulas say, and that the generators make them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

from pipeline.models.random_error import (
    Noise,
    Noise1,
    Noise2,
    Noise3,
    RandomError,
    RandomErrorError,
    RateRandomWalk,
    White,
)
from pipeline.numerics import _kernels_state_recursion as kernels

NOISES = (Noise1(0.01, 0.01), Noise2(0.02, 0.01, 0.05), Noise3(0.02, 0.01, 0.05))


@pytest.mark.parametrize("noise", NOISES, ids=lambda noise: noise.name)
def test_the_autocorrelation_is_the_table_s(noise: Noise) -> None:
    tau = np.linspace(-300, 300, 61)
    size, mu = noise.sigma**2, noise.mu
    decay = size * np.exp(-mu * np.abs(tau))
    lambda_ = -noise.decay.imag
    by_table = decay * (np.cos(lambda_ * tau) if noise.name == "noise2" else 1.0)
    if noise.name == "noise3":
        by_table = decay * (np.cos(lambda_ * tau) + mu / lambda_ * np.sin(lambda_ * np.abs(tau)))
    # Rounding of a complex exponential
    np.testing.assert_allclose(noise.autocorrelation(tau), by_table, atol=1e-14 * size, rtol=1e-13)


@pytest.mark.parametrize("noise", NOISES, ids=lambda noise: noise.name)
@pytest.mark.parametrize("omega", [0.0, 0.01, 0.05, 0.3])
def test_the_density_is_the_transform_of_the_autocorrelation(noise: Noise, omega: float) -> None:
    # exp(-40) of R is left out beyond 40 time constants; the quadrature is asked for 1e-12 of R's integral
    def integrand(tau: float) -> float:
        return float(2 * noise.autocorrelation(np.array(tau)) * np.cos(omega * tau))

    value, _ = quad(integrand, 0, 40 / noise.mu, limit=2000, epsabs=1e-12 * noise.sigma**2 / noise.mu)
    assert noise.psd(np.array(omega)) == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("noise", NOISES, ids=lambda noise: noise.name)
@pytest.mark.parametrize("step", [0.1, 1.0, 25.0, 400.0])
def test_the_transition_is_exact(noise: Noise, step: float) -> None:
    Phi, P, Q = noise.transition(step)
    system = {
        "noise1": np.array([[-noise.mu]]),
        "noise2": np.array([[-noise.mu, noise.decay.imag], [-noise.decay.imag, -noise.mu]]),
        "noise3": np.array([[0.0, 1.0], [-(abs(noise.decay) ** 2), -2 * noise.mu]]),
    }[noise.name]
    np.testing.assert_allclose(Phi, expm(system * step), rtol=1e-11, atol=1e-14)  # of expm's squarings
    # The difference keeps about eps of P
    np.testing.assert_allclose(Q, P - Phi @ P @ Phi.T, atol=20 * np.finfo(float).eps * P.max())
    # The autocorrelation at one step, and P at none, are the state's
    assert (Phi @ P)[0, 0] == pytest.approx(noise.autocorrelation(np.array(step)), abs=1e-14 * noise.sigma**2)
    assert P[0, 0] == noise.autocorrelation(np.array(0.0))


def test_the_noise_of_a_short_step_keeps_its_digits() -> None:
    noise, step = Noise3(0.01, 0.01, 0.02), 1e-4
    _, _, Q = noise.transition(step)
    density = 4 * noise.sigma**2 * noise.mu * (noise.mu**2 + noise.lambda_**2)
    leading = density * np.array([[step**3 / 3, step**2 / 2], [step**2 / 2, step]])
    np.testing.assert_allclose(Q, leading, rtol=1e-5)  # the next terms are 2 mu step = 2e-6 of them
    assert np.isfinite(noise.generate(1000, step, np.random.default_rng(1))).all()


@pytest.mark.parametrize("noise", NOISES, ids=lambda noise: noise.name)
@pytest.mark.parametrize("step", [1.0, 20.0])
def test_generated_noise_has_the_autocorrelation(noise: Noise, step: float) -> None:
    generator = np.random.default_rng(20260101)
    rows = np.stack([noise.generate(6, step, generator) for _ in range(20000)])
    for lag in range(6):
        product = rows[:, 0] * rows[:, lag]
        expected = noise.autocorrelation(np.array(lag * step))
        z = (product.mean() - expected) / (product.std() / np.sqrt(len(rows)))
        assert abs(z) < 3  # at a fixed seed; of a mean of 20000 independent products


def test_generated_white_noise_and_walk_have_their_variances() -> None:
    generator = np.random.default_rng(7)
    white = White(1e-4).generate(40000, 0.5, generator)
    # chi-square: standard deviation sqrt(2/n) of the ratio
    assert abs(np.mean(white**2) / (1e-4 / 0.5) - 1) < 3 * np.sqrt(2 / 40000)
    walks = np.stack([RateRandomWalk(1e-3).generate(101, 2.0, generator) for _ in range(4000)])
    assert (walks[:, 0] == 0).all()
    for j in (1, 50, 100):
        assert abs(np.mean(walks[:, j] ** 2) / (1e-6 * 2.0 * j) - 1) < 3 * np.sqrt(2 / 4000)


def test_the_compiled_recursion_is_the_plain_one() -> None:
    generator = np.random.default_rng(3)
    Phi, L = 0.4 * generator.standard_normal((2, 2)), np.tril(generator.standard_normal((2, 2)))
    start, white = generator.standard_normal(2), generator.standard_normal((50, 2))
    output = np.empty(51)
    kernels.first_state(Phi, L, start, white, output)
    x, plain = start, [start[0]]
    for w in white:
        x = Phi @ x + L @ w
        plain.append(x[0])
    np.testing.assert_allclose(output, plain, rtol=1e-12, atol=1e-14)  # order of summation


def test_a_sum_is_the_sum() -> None:
    model = RandomError((White(1e-4), NOISES[0], NOISES[2]))
    omega, tau = np.array([0.01, 0.1]), np.array([0.0, 5.0])
    np.testing.assert_array_equal(model.psd(omega), 1e-4 + NOISES[0].psd(omega) + NOISES[2].psd(omega))
    np.testing.assert_array_equal(
        model.autocorrelation(tau), NOISES[0].autocorrelation(tau) + NOISES[2].autocorrelation(tau)
    )
    assert model.N == 1e-4
    assert model.coloured == (NOISES[0], NOISES[2])
    generators = np.random.default_rng(5), np.random.default_rng(5)
    parts = [term.generate(20, 1.0, generators[0]) for term in model.terms]
    np.testing.assert_allclose(model.generate(20, 1.0, generators[1]), sum(parts), rtol=1e-12)


def test_parameters_carry_the_papers_names() -> None:
    assert NOISES[2].parameters == {"sigma": 0.02, "mu": 0.01, "lambda": 0.05}
    assert White(2.0).parameters == {"N": 2.0}
    assert RateRandomWalk(3.0).parameters == {"K": 3.0}
    assert RandomError((RateRandomWalk(3.0), RateRandomWalk(4.0))).K == 5.0


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_term_of_no_size_is_refused(value: float) -> None:
    with pytest.raises(RandomErrorError, match="lambda of noise2"):
        Noise2(1.0, 1.0, value)


def test_a_walk_has_no_autocorrelation() -> None:
    with pytest.raises(RandomErrorError, match="stationary"):
        RandomError((White(1.0), RateRandomWalk(1.0))).autocorrelation(np.zeros(3))
