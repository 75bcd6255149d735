"""Slow noise between the steps of a triad: errors over standard errors, what too few steps do not tell."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pipeline.models.rate_table_model import Terms
from pipeline.models.rate_table_observations import Observations
from pipeline.models.rate_table_scatter import covariance_of_means
from pipeline.models.rate_table_triad import fit_triad

DEGREE = np.pi / 180
RATES = DEGREE * np.array([0.0, 20.0, -20.0, 60.0, -60.0, 100.0, -100.0])
"""About each axis in turn: |w| rises with time."""
SPACING = 12.0
COUNT = 3 * len(RATES)
MIDDLE = SPACING * np.arange(COUNT)
RUN = np.repeat(np.arange(3), len(RATES))
APART = np.where(RUN[:, np.newaxis] == RUN, np.abs(MIDDLE[:, np.newaxis] - MIDDLE), np.inf)
ERROR = DEGREE / 3600
SEEDS = 80


def observed(rng: np.random.Generator, slow: float, *, apart: bool = True) -> Observations:
    """Gyros without errors: white noise of 1 deg/h in each mean, and ``slow`` times as much of 20 s."""
    rate = np.concatenate([np.outer(RATES, axis) for axis in np.eye(3)])
    noise = ERROR * rng.standard_normal((COUNT, 3))
    noise += slow * ERROR * np.linalg.cholesky(np.exp(-APART / 20.0)) @ rng.standard_normal((COUNT, 3))
    error = np.full((COUNT, 3), ERROR)
    known = APART if apart else None
    return Observations(rate, rate + noise, error, np.zeros((COUNT, 3, 0)), (), apart=known)


@cache
def normalised(slow: float, apart: bool = True) -> np.ndarray:
    """Errors over standard errors of S, biases and asymmetries, shape (seeds, 15)."""
    truth = np.concatenate([np.eye(3).ravel(), np.zeros(6)])
    fits = [
        fit_triad(observed(np.random.default_rng(seed), slow, apart=apart), Terms(asymmetry=True))
        for seed in range(SEEDS)
    ]
    return np.array([(fit.value - truth) / fit.standard_error for fit in fits])


def test_errors_over_standard_errors_with_slow_noise() -> None:
    errors = normalised(1.0)
    # the band of the requirement: 720 values, 2.6 %
    assert 0.9 < errors[:, :9].std() < 1.1
    # 240 values, 4.6 %, three times that
    assert 0.85 < errors[:, 12:].std() < 1.15


def test_errors_over_standard_errors_with_white_noise() -> None:
    errors = normalised(0.0)
    # Whether the noise is slow too 21 steps do not tell: what slow noise would add to S is little,
    # to an asymmetry a quarter, for which its standard error is too large rather than too small.
    assert 0.87 < errors[:, :9].std() < 1.1
    assert 0.7 < errors[:, 12:].std() < 1.1


def test_without_the_times_slow_noise_makes_the_asymmetry_look_too_sure() -> None:
    assert normalised(1.0, apart=False)[:, 12:].std() > 1.2


def test_of_much_slow_noise_the_covariance_is_that_of_it() -> None:
    rng = np.random.default_rng(1)
    found = []
    for _ in range(100):
        one = observed(rng, 10.0)
        A = np.column_stack([one.rate, np.ones(COUNT)])
        found.append(
            covariance_of_means(A, one.output[:, 0], one.standard_error[:, 0], np.zeros((COUNT, 0)), APART)
        )
    mean = np.mean([of for of in found if of is not None], axis=0) / ERROR**2
    # a variance from 17 degrees of freedom in runs of seven: 35 %, its average is pulled up by the long tail
    assert 70 < np.diag(mean).mean() < 200
    correlation = mean[0, 1] / mean[0, 0]
    assert correlation == pytest.approx(np.exp(-SPACING / 20.0), abs=0.15)
    assert not mean[RUN[:, np.newaxis] != RUN].any()  # of other runs nothing is told


def test_few_observations_do_not_tell_it() -> None:
    one = observed(np.random.default_rng(2), 1.0)
    few = slice(0, 11)
    A = np.column_stack([one.rate[few, :2], np.ones(11)])
    given = (one.output[few, 0], one.standard_error[few, 0], np.zeros((11, 0)), APART[few, few])
    assert covariance_of_means(A, *given) is None
