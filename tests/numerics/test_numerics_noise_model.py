"""The O(n) weighted regression against dense matrices, and its noise levels against the truth."""

import numpy as np
import pytest

from pipeline.numerics._kernels_trend import whitened_gram
from pipeline.numerics.noise_model import (
    Fit,
    generalised_least_squares,
    jump_scores,
    memory,
)

N = 40


def covariance(walk, white, jumps=(), jump_variance=0.0):
    """The model as a dense matrix: the walk begins half a step before the first row."""
    i = np.arange(N)
    dense = walk * (0.5 + np.minimum.outer(i, i)) + white * np.eye(N)
    for at in jumps:
        after = (i >= at).astype(float)
        dense += jump_variance * np.outer(after, after)
    return dense


def columns(seed=1):
    t = np.linspace(0, 1, N)
    rng = np.random.default_rng(seed)
    return np.column_stack([np.ones(N), t, np.cos(40 * t), rng.standard_normal(N).cumsum()])


@pytest.mark.parametrize("white", [2.0, 0.0, -0.16, -0.25])  # times q; -1/4 is the least there can be
def test_whitening_is_that_of_the_dense_covariance(white):
    observed = np.ones(N, dtype=bool)
    observed[[0, 7, 8, N - 1]] = False
    x = columns()
    gram, log_variances, count = whitened_gram(x, observed, np.zeros(N, dtype=bool), 1.0, white)
    dense = covariance(1.0, white)[np.ix_(observed, observed)]
    expected = x[observed].T @ np.linalg.solve(dense, x[observed])
    # rounding of a 36-row solve
    np.testing.assert_allclose(gram, expected, rtol=1e-11)
    assert log_variances == pytest.approx(np.linalg.slogdet(dense)[1], abs=1e-10)
    assert count == observed.sum()


def test_a_free_jump_is_one_of_unlimited_variance():
    free = np.zeros(N, dtype=bool)
    free[[10, 11, 30]] = True
    x = columns()
    gram, _, count = whitened_gram(x, np.ones(N, dtype=bool), free, 1.0, 0.3)
    dense = covariance(1.0, 0.3, jumps=(10, 11, 30), jump_variance=1e8)
    # the finite variance of the dense jumps leaves 1e-8 of their weight
    np.testing.assert_allclose(gram, x.T @ np.linalg.solve(dense, x), rtol=1e-6)
    assert count == N - 3


def test_scores_are_the_standardised_steps_of_the_dense_model():
    rng = np.random.default_rng(3)
    residual = rng.standard_normal(N).cumsum()
    fit = Fit(np.zeros(1), np.zeros((1, 1)), white=0.5, walk=1.0)
    everywhere, nowhere = np.ones(N, dtype=bool), np.zeros(N, dtype=bool)
    scores = jump_scores(residual, fit, observed=everywhere, jumps=nowhere)
    inverse = np.linalg.inv(covariance(1.0, 0.5))
    for i in range(1, N):
        step = (np.arange(N) >= i).astype(float)
        expected = step @ inverse @ residual / np.sqrt(step @ inverse @ step)
        assert scores[i] == pytest.approx(expected, abs=1e-11)  # rounding


def simulated(rng, n, walk, white):
    start = np.sqrt(walk / 2) * rng.standard_normal()
    steps = np.append(start, np.sqrt(walk) * rng.standard_normal(n - 1))
    return steps.cumsum() + np.sqrt(white) * rng.standard_normal(n)


@pytest.mark.parametrize(("walk", "white"), [(1.0, 0.0), (1.0, 1.0), (0.01, 1.0)])
def test_levels_and_errors_are_those_of_the_truth(walk, white):
    n, runs = 400, 100
    t = np.linspace(0, 1, n)
    design = np.column_stack([np.ones(n), t])
    fits = [
        generalised_least_squares(design, simulated(np.random.default_rng(seed), n, walk, white) + 3 - 5 * t)
        for seed in range(runs)
    ]
    # 400 rows know a variance to about 10 %, 100 runs its mean to 1 %; 5 % allows for the small walk,
    # which shows in every tenth row only
    assert np.mean([fit.walk for fit in fits]) == pytest.approx(walk, rel=0.05)
    assert np.mean([fit.white for fit in fits]) == pytest.approx(white, abs=0.05 * max(walk, white))
    scores = [(fit.coefficients - [3, -5]) / np.sqrt(np.diag(fit.covariance)) for fit in fits]
    # 100 runs: the mean to 0.1 and the deviation to 0.07, one sigma
    assert np.all(np.abs(np.mean(scores, axis=0)) < 0.3)
    assert np.all(np.abs(np.std(scores, axis=0) - 1) < 0.2)


def test_white_noise_alone_gives_ordinary_least_squares():
    n = 500
    t = np.linspace(0, 1, n)
    design = np.column_stack([np.ones(n), t])
    ordinary = np.sqrt(np.linalg.inv(design.T @ design)[1, 1])
    fits = [generalised_least_squares(design, np.random.default_rng(s).standard_normal(n)) for s in range(41)]
    # sigma itself is known to 3 %; in the minority of records that look as if they wandered it is larger
    assert np.median([np.sqrt(fit.covariance[1, 1]) for fit in fits]) == pytest.approx(ordinary, rel=0.05)
    assert np.median([memory(fit) for fit in fits]) < 0.01


def test_a_column_that_says_nothing_stays_at_zero():
    rng = np.random.default_rng(6)
    t = np.linspace(0, 1, 100)
    y = 2 * t + rng.standard_normal(100).cumsum() * 1e-3
    alone = generalised_least_squares(np.column_stack([np.ones(100), t]), y)
    beside = generalised_least_squares(np.column_stack([np.ones(100), t, np.zeros(100)]), y)
    assert beside.coefficients[2] == 0
    np.testing.assert_allclose(beside.coefficients[:2], alone.coefficients, rtol=1e-9)  # rounding


def test_a_residual_of_nothing_is_no_fault():
    t = np.linspace(0, 1, 50)
    fit = generalised_least_squares(np.column_stack([np.ones(50), t]), np.zeros(50))
    np.testing.assert_array_equal(fit.coefficients, 0)
    assert np.all(np.isfinite(fit.covariance))
