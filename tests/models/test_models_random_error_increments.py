"""Integrals of random errors over steps: their covariances against the closed forms of the variance."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.models.random_error import (
    Noise1,
    Noise2,
    Noise3,
    Quantisation,
    RandomError,
    RateRandomWalk,
    Term,
    White,
)
from pipeline.models.random_error_growth import variance
from pipeline.models.random_error_increments import increments, transition

TERMS = (Noise1(0.01, 0.01), Noise2(0.02, 0.01, 0.05), Noise3(0.01, 0.02, 0.3), RateRandomWalk(1e-3))
STEPS = (1e-3, 1.0, 37.0, 5000.0)


def of_sum(term: Term, step: float, count: int) -> float:
    """Variance of the sum of so many successive integrals, by the recursion's own matrices."""
    Phi, P, Q = transition(term, step)
    d = len(Phi)
    # the sum as one more state: it takes each new integral, which is row 0 of Phi and noise
    whole = np.zeros((d + 1, d + 1))
    whole[1:, 1:], whole[0, 0], whole[0, 1:] = Phi, 1.0, Phi[0]
    spread = np.vstack([np.eye(d)[:1], np.eye(d)])
    covariance = np.zeros((d + 1, d + 1))
    covariance[2:, 2:] = P
    for _ in range(count):
        covariance = whole @ covariance @ whole.T + spread @ Q @ spread.T
    return float(covariance[0, 0])


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.name)
@pytest.mark.parametrize("count", [1, 2, 7])
def test_variance_of_sums_is_the_closed_form(term: Term, step: float, count: int) -> None:
    # rounding, which at a long step is that of 2^k products: a few 1e-12
    exact = float(variance(RandomError((term,)), np.array([count * step]))[0])
    assert of_sum(term, step, count) == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize("term", [*TERMS, White(1e-4), Quantisation(0.3)], ids=lambda term: term.name)
def test_what_is_drawn_has_that_variance(term: Term) -> None:
    step, block = 2.0, 50
    exact = float(variance(RandomError((term,)), np.array([block * step]))[0])
    rng = np.random.default_rng(5)
    sums = np.array([increments(term, block, step, rng).sum() for _ in range(400)])
    # a variance from 400 independent normal sums: relative standard deviation sqrt(2/400) = 0.071
    assert np.var(sums) == pytest.approx(exact, rel=3 * 0.071)
    assert abs(np.mean(sums)) < 3 * np.sqrt(exact / 400)


def test_the_same_generator_gives_the_same_integrals() -> None:
    first, again = (increments(TERMS[2], 10, 1.0, np.random.default_rng(1)) for _ in range(2))
    np.testing.assert_array_equal(first, again)
