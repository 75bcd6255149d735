"""A drift that settles: m*, m0 and the decay against the truth, and honesty where there is no transient."""

from __future__ import annotations

from functools import cache

import drift_problems as dp
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.models.drift_problem import Arc, Estimate, Parameter, Problem
from pipeline.models.drift_trajectory import Transient, linear_trajectory
from pipeline.models.drift_transient import STARTING, transient
from pipeline.models.earth import Base, Scheme
from pipeline.models.gyro_drift import DRIFT
from pipeline.numerics.whiteness import AutoRegression

Float = NDArray[np.float64]
MINUTES = dp.hours(24)


@cache
def settling(scheme: Scheme, e_fold: float) -> Float:
    """Angles of a day by the minute, m from 0.05 to 0.01, no installation errors."""
    p = np.concatenate([np.full(6, 0.01), np.zeros(5)])
    base, start = Base.mounted(scheme, dp.LATITUDE), np.array(dp.STARTS[scheme])
    return linear_trajectory(p, base, start, MINUTES, Transient(np.full(6, 0.05), dp.decay(e_fold)))


def error_of(estimate: Estimate) -> float:
    """Largest error of m* [deg/h]."""
    return float(np.abs(estimate.value[:6] - 0.01).max()) * dp.DEG_H


@pytest.mark.parametrize("scheme", dp.SCHEMES)
@pytest.mark.parametrize(("e_fold", "bound"), [(0.5, 4e-9), (1, 5e-9), (2, 5e-9), (4, 7e-9)])
def test_exponential_augmented_least_squares(scheme: Scheme, e_fold: float, bound: float) -> None:
    """The last column of MATH 2.7, noise-free and weighted with 1e-3 arcsec; k given, and k searched."""
    problem = dp.one_run(scheme, settling(scheme, e_fold), MINUTES, installation=False)
    sigma = 1e-3 * dp.ARCSEC
    assert error_of(transient(problem, sigma=sigma, decay=dp.decay(e_fold))) < bound
    searched = transient(problem, sigma=sigma)
    assert error_of(searched) < bound
    # noise-free, so by far within the standard error
    error = abs(searched.figures["decay"] - dp.decay(e_fold))
    assert error < 0.1 * searched.figures["decay_standard_error"]
    start = searched.of(STARTING)
    np.testing.assert_allclose(start, 0.05, atol=1e-5)  # m0 acts for an e-fold only


@pytest.mark.parametrize("scheme", ["polar", "horizontal"])
def test_error_over_standard_error_is_standard_normal(scheme: Scheme) -> None:
    """Samples each 5 minutes, installation errors, an e-fold of 2 h: k's uncertainty is in all of them."""
    tau, exact = dp.hours(24, 5), dp.day(scheme, 5, 2.0)
    expected = dict(zip(STARTING, np.full(6, 0.05), strict=True)) | {"k": dp.decay(2.0)}
    scores = []
    for seed in range(60):
        problem = dp.one_run(scheme, dp.noisy(exact, seed), tau)
        estimate = transient(problem)
        scores.append((estimate.value - _truth(scheme, estimate, expected)) / estimate.standard_errors)
    seen = dp.observable(estimate, transient(dp.without_priors(problem)))
    assert seen.sum() >= 8
    assert seen[estimate.parameters.index(Parameter("k"))]
    spread = np.std(np.array(scores)[:, seen], axis=0)
    assert np.all((spread > 0.75) & (spread < 1.25)), spread  # 60 seeds spread by 0.09


def _truth(scheme: Scheme, estimate: Estimate, further: dict[str, float]) -> Float:
    names = ("m11", "m12", "m21", "m22", "mc1", "mc2", "theta1", "theta2", "epsilon1", "epsilon2", "epsilon3")
    known = dict(zip(names, dp.truth(scheme), strict=True)) | further
    return np.array([known[p.name] for p in estimate.parameters])


def test_a_constant_drift_has_no_transient() -> None:
    tau, exact = dp.hours(24, 5), dp.day("horizontal", 5)
    constant = 0
    for seed in range(20):
        estimate = transient(dp.one_run("horizontal", dp.noisy(exact, seed), tau))
        if "decay" not in estimate.figures:
            constant += 1
            assert "no transient" in estimate.notes[0]
            assert estimate.parameters == tuple(p for p in estimate.parameters if p.name not in STARTING)
            assert np.abs((estimate.value - dp.truth("horizontal")) / estimate.standard_errors).max() < 5
    assert constant >= 18  # the test is at 1 %: three of twenty have a probability of 1e-3


def test_the_transient_begins_anew_in_each_run() -> None:
    """Two runs, an hour of the first missing: tau counts from each run's first sample."""
    sigma, everywhere = 1e-3 * dp.ARCSEC, np.ones(len(MINUTES), dtype=np.bool_)
    polar, vertical = settling("polar", 1), settling("vertical", 1)
    arcs = (
        Arc(0, MINUTES[:90], polar[:90], everywhere[:90]),
        Arc(0, MINUTES[150:], polar[150:], everywhere[150:]),
        Arc(1, MINUTES, vertical, everywhere),
    )
    bases = tuple(Base.mounted(s, dp.LATITUDE) for s in ("polar", "vertical"))
    problem = Problem(bases, arcs, dp.PRIORS, installation=False)
    estimate = transient(problem, sigma=sigma)
    assert error_of(estimate) < 5e-9  # as in MATH 2.7
    assert estimate.figures["decay"] == pytest.approx(dp.decay(1), rel=1e-6)


def test_the_bracket_is_kept_and_its_end_is_said() -> None:
    problem = dp.one_run("polar", settling("polar", 1), MINUTES, installation=False)
    k = dp.decay(1)
    estimate = transient(problem, sigma=dp.ARCSEC, bracket=(2 * k, 8 * k))
    assert estimate.figures["decay"] >= 2 * k
    assert "the decay is at an end of its bracket" in estimate.notes


def test_coloured_noise_widens_the_errors() -> None:
    """AR(1), phi = 0.8, given: its slow part is five times the innovations, and so are the errors."""
    noise, exact, tau = AutoRegression(np.array([0.8])), dp.day("horizontal", 5, 2.0), dp.hours(24, 5)
    white = dp.ARCSEC * np.random.default_rng(5).standard_normal((len(tau) + 200, 2))
    quiet = transient(dp.one_run("horizontal", exact + white[200:], tau), sigma=dp.ARCSEC)
    coloured = exact + lfilter([1.0], [1.0, -0.8], white, axis=0)[200:]
    sigma = dp.ARCSEC * noise.spread
    loud = transient(dp.one_run("horizontal", coloured, tau), sigma=sigma, autoregression=noise)
    assert loud.sigma == pytest.approx(sigma, rel=1e-12)
    ratio = loud.standard_errors[:6] / quiet.standard_errors[:6]
    assert np.all((ratio > 3.5) & (ratio < 5.5)), (
        ratio
    )  # a day's slow functions are not quite at zero frequency


def test_coloured_noise_is_recognised() -> None:
    """AR(1), phi = 0.7, not given: errors over standard errors are 3 and more where it is taken for white."""
    tau, exact = dp.hours(12, 5), dp.day("polar", 5, 1.0)[: 12 * 12 + 1]
    scores = []
    for seed in range(12):
        white = dp.ARCSEC * np.random.default_rng(seed).standard_normal((len(tau) + 100, 2))
        alpha = exact + lfilter([1.0], [1.0, -0.7], white, axis=0)[100:]
        estimate = transient(dp.one_run("polar", alpha, tau), coloured=True)
        scores.append((estimate.of(DRIFT) - 0.01) / estimate.standard_errors[: len(DRIFT)])
    # 12 seeds of six parameters, correlated: 72 scores that are as good as some 30, which spread by 0.13
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4
