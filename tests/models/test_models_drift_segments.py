"""Regression over segments: the paper's method with the covariance that differenced noise has."""

from __future__ import annotations

import drift_problems as dp
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.models.drift_problem import Arc, Problem
from pipeline.models.drift_segments import segments
from pipeline.models.drift_trajectory import Transient, linear_trajectory
from pipeline.models.earth import Base, Scheme
from pipeline.numerics.whiteness import AutoRegression

Float = NDArray[np.float64]
MINUTES = dp.hours(24)
SEEDS = 400


@pytest.mark.parametrize("scheme", dp.SCHEMES)
def test_error_over_standard_error_is_standard_normal(scheme: Scheme) -> None:
    scores, sigma = [], []
    for seed in range(SEEDS):
        problem = dp.one_run(scheme, dp.noisy(dp.day(scheme), seed), MINUTES)
        estimate = segments(problem, length=10)
        scores.append((estimate.value - dp.truth(scheme)) / np.maximum(estimate.standard_errors, 1e-30))
        sigma.append(estimate.sigma)
    seen = dp.observable(estimate, segments(dp.without_priors(problem), length=10))
    assert seen.sum() >= 3
    spread = np.std(np.array(scores)[:, seen], axis=0)
    # 400 seeds spread by 0.035; of the four schemes' 25 none is 3.4 sigma off
    assert np.all((spread > 0.88) & (spread < 1.12)), spread
    assert np.mean(sigma) == pytest.approx(dp.ARCSEC, rel=0.02)  # 288 rows: 5 % each, over 400
    assert estimate.figures["segments"] == 144


def test_coloured_noise_widens_the_errors() -> None:
    """AR(1), phi = 0.9: with it the standard errors are honest, without they are not."""
    exact, truth = dp.day("horizontal"), dp.truth("horizontal")
    noise = AutoRegression(np.array([0.9]))
    sigma = dp.ARCSEC * noise.spread
    scores: dict[bool, list[Float]] = {True: [], False: []}
    for seed in range(SEEDS // 2):
        white = np.random.default_rng(seed).standard_normal((len(exact) + 500, 2))
        alpha = exact + dp.ARCSEC * lfilter([1.0], [1.0, -0.9], white, axis=0)[500:]
        problem = dp.one_run("horizontal", alpha, MINUTES)
        for told in (True, False):
            estimate = segments(problem, length=10, sigma=sigma, autoregression=noise if told else None)
            scores[told].append((estimate.value - truth) / estimate.standard_errors)
    spread = np.std(scores[True], axis=0)
    assert np.all((spread > 0.85) & (spread < 1.15)), spread  # three sigma of 200 seeds
    assert np.std(scores[False], axis=0)[:6].max() > 1.25


@pytest.mark.parametrize(
    ("e_fold", "expected"),
    [(0.5, (0.055, 0.040, 0.16, 0.051)), (1, (0.10, 0.086, 0.28, 0.13)), (2, (0.16, 0.19, 0.42, 0.32))],
)
def test_a_transient_spoils_it(e_fold: float, expected: tuple[float, ...]) -> None:
    """MATH 2.7, the column of the regression: m from 0.05 to 0.01, six parameters, segments of 10."""
    p = np.concatenate([np.full(6, 0.01), np.zeros(5)])
    transient = Transient(np.full(6, 0.05), dp.decay(e_fold))
    for scheme, error in zip(dp.SCHEMES, expected, strict=True):
        base, start = Base.mounted(scheme, dp.LATITUDE), np.array(dp.STARTS[scheme])
        alpha = linear_trajectory(p, base, start, MINUTES, transient)
        problem = dp.one_run(scheme, alpha, MINUTES, installation=False)
        found = np.abs(segments(problem, length=10).value - 0.01).max() * dp.DEG_H
        assert found == pytest.approx(error, rel=0.06)  # two digits are given


def test_runs_and_arcs_and_what_was_not_measured() -> None:
    """A segment whose end was bridged is left out; a sample wrong within one is an observation of none."""
    alpha = dp.noisy(dp.day("polar"), 0)
    measured = np.ones(len(alpha), dtype=np.bool_)
    measured[[0, 50, 333]] = False  # the end of three segments, and inside a fourth
    arcs = (
        Arc(0, MINUTES[:700], alpha[:700], measured[:700]),
        Arc(0, MINUTES[700:], alpha[700:], measured[700:]),
        Arc(1, MINUTES, dp.noisy(dp.day("vertical"), 1), np.ones(len(alpha), dtype=np.bool_)),
    )
    bases = tuple(Base.mounted(s, dp.LATITUDE) for s in ("polar", "vertical"))
    problem = Problem(bases, arcs, dp.PRIORS)
    estimate = segments(problem, length=10)
    assert estimate.figures["segments"] == 69 - 3 + 74 + 144
    truth = np.concatenate([dp.truth("polar"), dp.truth("vertical")[8:]])
    seen = dp.observable(estimate, segments(dp.without_priors(problem), length=10))
    assert seen.sum() >= 5
    scores = ((estimate.value - truth) / np.maximum(estimate.standard_errors, 1e-30))[seen]
    assert np.abs(scores).max() < 4  # of five standard normals or more
    for arc, predicted in zip(arcs, estimate.predicted, strict=True):
        # predicted to the errors of the estimate, a few arc seconds at a day's end
        assert np.abs(predicted - arc.alpha).max() < 20 * dp.ARCSEC


def test_no_segment_leaves_the_priors() -> None:
    problem = dp.one_run("polar", dp.day("polar")[:8], MINUTES[:8])
    estimate = segments(problem, length=10)
    assert "no segment of 10 steps" in estimate.notes[0]
    np.testing.assert_allclose(estimate.standard_errors[:6], 0.1, rtol=1e-12)
    nothing = segments(dp.without_priors(problem), length=10)
    assert np.isinf(nothing.standard_errors[:8]).all()
