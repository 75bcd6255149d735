"""Cumulative least squares against simulated truth: its errors, its noise, its outliers, several runs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import drift_problems as dp
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.models.drift_linear import LinearFit, cumulative
from pipeline.models.drift_problem import Arc, Parameter, Prior, Problem
from pipeline.models.drift_rows import arc_integrals, arc_transitions, columns_of, cumulative_rows, fit_rows
from pipeline.models.drift_trajectory import linear_trajectory
from pipeline.models.earth import Base, Scheme

Float = NDArray[np.float64]
MINUTES = dp.hours(24)
SEEDS = 200


@cache
def fits(scheme: Scheme) -> tuple[LinearFit, ...]:
    """Of a day by the minute with an arc second of white noise."""
    runs = (dp.noisy(dp.day(scheme), seed) for seed in range(SEEDS))
    return tuple(cumulative(dp.one_run(scheme, alpha, MINUTES)) for alpha in runs)


@pytest.mark.parametrize("scheme", dp.SCHEMES)
def test_error_over_standard_error_is_standard_normal(scheme: Scheme) -> None:
    found = fits(scheme)
    alone = cumulative(dp.without_priors(dp.one_run(scheme, dp.noisy(dp.day(scheme), 0), MINUTES)))
    seen = dp.observable(found[0].estimate, alone.estimate)
    assert seen.sum() >= 5
    scores = [(f.estimate.value - dp.truth(scheme))[seen] / f.estimate.standard_errors[seen] for f in found]
    spread, mean = np.std(scores, axis=0), np.mean(scores, axis=0)
    assert np.all((spread > 0.9) & (spread < 1.1)), spread  # two sigma of what 200 seeds tell
    assert np.all(np.abs(mean) < 3.5 / SEEDS**0.5), mean  # of some 40 means none is 3.5 sigma off
    sigma = [f.estimate.sigma for f in found]
    assert np.mean(sigma) == pytest.approx(dp.ARCSEC, rel=0.005)  # 1.3 % of each of them, over 200


@pytest.mark.parametrize("scheme", dp.SCHEMES)
def test_white_noise_is_taken_for_white(scheme: Scheme) -> None:
    found = fits(scheme)
    # the test is at 1 %: of 200 more than 7 have a probability of 1e-3
    assert sum(f.autoregression is not None for f in found) <= 7
    assert sum(int(f.outliers[0].sum()) for f in found) == 0
    assert np.mean([f.whiteness for f in found]) == pytest.approx(0.5, abs=0.08)  # uniform: 0.29/sqrt(200)


def test_plain_sums_would_not_know_their_error() -> None:
    """The noise of the angles at which the model is evaluated is integrated; the transitions allow for it."""
    columns = columns_of(dp.one_run("polar", dp.day("polar"), MINUTES))
    scores = []
    for seed in range(40):
        problem = dp.one_run("polar", dp.noisy(dp.day("polar"), seed), MINUTES)
        arc = problem.arcs[0]
        rows = cumulative_rows(
            arc, arc_integrals(arc, problem, "quintic_spline"), arc_transitions(arc, problem, None)
        )
        found = fit_rows(problem, columns, [rows], noise=None, sigma=None).solution
        scores.append((found.estimate[:6] - 0.01) / found.standard_errors[:6])
    assert np.std(scores, axis=0).max() > 1.5


def test_rows_tell_what_the_estimate_knows() -> None:
    """Without priors the inverse of the rows' Gram matrix, in eta, is the covariance."""
    problem = replace(dp.one_run("polar", dp.noisy(dp.day("polar"), 0), MINUTES), priors={})
    fit = cumulative(problem)
    T = columns_of(problem).expansion
    R = fit.rows @ T
    covariance = T @ np.linalg.inv(R.T @ R) @ T.T
    # condition 1e3, squared, times eps
    np.testing.assert_allclose(fit.estimate.covariance, covariance, rtol=0, atol=1e-8 * covariance.max())
    assert fit.columns == fit.estimate.parameters
    assert len(fit.rows) == 10
    np.testing.assert_allclose(fit.rows[:, 8:] @ problem.bases[0].u, 0, atol=1e-9 * np.abs(fit.rows).max())


def test_what_nothing_determines_has_no_standard_error() -> None:
    """MATH 2.4, erratum 8: in the equatorial scheme the columns of theta are zero."""
    problem = replace(dp.one_run("equatorial", dp.noisy(dp.day("equatorial"), 0), MINUTES), priors={})
    estimate = cumulative(problem).estimate
    lost = [p.name for p, s in zip(estimate.parameters, estimate.standard_errors, strict=True) if np.isinf(s)]
    assert lost == ["theta1", "theta2"]
    assert any("theta1, theta2" in note for note in estimate.notes)
    assert estimate.figures["condition"] == np.inf


def test_a_prior_mean_is_what_the_record_leaves() -> None:
    known = dp.PRIORS | {"theta1": Prior(3 * dp.ARCMIN, dp.ARCMIN)}
    problem = replace(dp.one_run("equatorial", dp.noisy(dp.day("equatorial"), 0), MINUTES), priors=known)
    estimate = cumulative(problem).estimate
    k = estimate.parameters.index(Parameter("theta1"))
    # its column is zero but for rounding
    assert estimate.value[k] == pytest.approx(3 * dp.ARCMIN, rel=1e-9)
    assert estimate.standard_errors[k] == pytest.approx(dp.ARCMIN, rel=1e-9)


def coloured(seed: int, phi: float, shape: tuple[int, int]) -> Float:
    """AR(1) noise of innovations of an arc second."""
    white = np.random.default_rng(seed).standard_normal((shape[0] + 500, shape[1]))
    # the start decays: 0.9^500 = 1e-23
    return dp.ARCSEC * lfilter([1.0], [1.0, -phi], white, axis=0)[500:]


def test_coloured_noise_is_allowed_for() -> None:
    """phi = 0.9: its slow part is 10 times the innovations, four times the standard deviation."""
    exact, truth = dp.day("horizontal"), dp.truth("horizontal")
    scores, without, gains, sigma = [], [], [], []
    for seed in range(100):
        problem = dp.one_run("horizontal", exact + coloured(seed, 0.9, exact.shape), MINUTES)
        fit = cumulative(problem)
        assert fit.autoregression is not None
        scores.append((fit.estimate.value - truth) / fit.estimate.standard_errors)
        gains.append(fit.autoregression.gain)
        sigma.append(fit.estimate.sigma)
        if seed < 30:
            plain = cumulative(problem, coloured=False).estimate
            without.append((plain.value - truth) / plain.standard_errors)
    spread = np.std(scores, axis=0)
    assert np.all((spread > 0.85) & (spread < 1.15)), spread  # the asked band: two sigma of 100 seeds
    assert np.std(without, axis=0).min() > 2.5
    # each gain is known to 9 %: (1 - phi) sqrt(2 n / (1 - phi^2)) = 12
    assert np.mean(gains) == pytest.approx(10, rel=0.04)
    assert np.mean(sigma) == pytest.approx(dp.ARCSEC / (1 - 0.81) ** 0.5, rel=0.04)


@pytest.mark.parametrize("scheme", ["polar", "horizontal"])
def test_outliers_are_marked_and_do_no_harm(scheme: Scheme) -> None:
    """One sample in a hundred is a degree wrong, the first and the last among them, five are 20 sigma."""
    rng = np.random.default_rng(7)
    clean = dp.noisy(dp.day(scheme), 3)
    wrong = np.concatenate([[0, len(clean) - 1], 1 + rng.permutation(len(clean) - 2)[:17]])
    alpha, signs = clean.copy(), rng.choice([-1.0, 1.0], 19)
    alpha[wrong, rng.integers(0, 2, 19)] += signs * np.repeat([np.deg2rad(1), 20 * dp.ARCSEC], [14, 5])
    fit = cumulative(dp.one_run(scheme, alpha, MINUTES))
    np.testing.assert_array_equal(np.flatnonzero(fit.outliers[0]), np.sort(wrong))
    np.testing.assert_array_equal(fit.cleaned.arcs[0].measured, ~fit.outliers[0])
    without = cumulative(dp.one_run(scheme, clean, MINUTES)).estimate
    # the 19 samples that are not there move the estimates by sqrt(19/1441) = 0.11 standard errors
    shift = (fit.estimate.value - without.value) / np.maximum(without.standard_errors, 1e-30)
    assert np.all(np.abs(shift[np.abs(dp.truth(scheme)) > 0]) < 1), shift
    assert fit.estimate.sigma == pytest.approx(without.sigma, rel=0.02)
    robust = cumulative(dp.one_run(scheme, alpha, MINUTES), robust=False)
    assert not robust.outliers[0].any()
    assert robust.estimate.sigma > 50 * dp.ARCSEC


@pytest.mark.parametrize("scheme", dp.SCHEMES)
def test_a_drift_that_settles_loses_no_angles_to_the_model_of_a_constant_one(scheme: Scheme) -> None:
    """Each five minutes, an e-fold of an hour: the residuals begin with a bend of 40 to 60 arcmin."""
    for seed in range(5):
        alpha = dp.noisy(dp.day(scheme, 5, 1.0), seed)
        fit = cumulative(dp.one_run(scheme, alpha, dp.hours(24, 5)))
        assert fit.outliers[0].sum() <= 1  # the first sample, by what a parabola leaves of the bend
        residual = np.abs(alpha - fit.estimate.predicted[0]).max()
        # of e^-x a parabola over x up to 8/12 leaves x^3/6 = 0.05 at its worst
        assert np.abs(fit.cleaned.arcs[0].alpha - alpha).max() < 0.05 * residual


def two_runs(seed: int) -> Problem:
    """A polar run with a gap of an hour, and a vertical one every third sample of which is bridged."""
    rng = np.random.default_rng(seed)
    polar, vertical = dp.noisy(dp.day("polar"), 1000 + seed), dp.noisy(dp.day("vertical"), 2000 + seed)
    measured = rng.random(len(vertical)) > 1 / 3
    inside = np.flatnonzero(~measured)
    for channel in range(2):
        vertical[inside, channel] = np.interp(MINUTES[inside], MINUTES[measured], vertical[measured, channel])
    everywhere = np.ones(len(polar), dtype=np.bool_)
    arcs = (
        Arc(0, MINUTES[:700], polar[:700], everywhere[:700]),
        Arc(0, MINUTES[760:], polar[760:], everywhere[760:]),
        Arc(1, MINUTES, vertical, measured),
    )
    return Problem(tuple(Base.mounted(s, dp.LATITUDE) for s in ("polar", "vertical")), arcs, dp.PRIORS)


def test_several_runs_and_arcs() -> None:
    truth = np.concatenate([dp.truth("polar"), dp.truth("vertical")[8:]])
    scores = []
    for seed in range(60):
        problem = two_runs(seed)
        fit = cumulative(problem)
        scores.append((fit.estimate.value - truth) / np.maximum(fit.estimate.standard_errors, 1e-30))
    assert fit.estimate.parameters[8:] == tuple(
        Parameter(f"epsilon{i}", run) for run in range(2) for i in (1, 2, 3)
    )
    seen = dp.observable(fit.estimate, cumulative(dp.without_priors(problem)).estimate)
    assert seen.sum() >= 10
    spread = np.std(np.array(scores)[:, seen], axis=0)
    assert np.all((spread > 0.75) & (spread < 1.25)), spread  # 1/sqrt(120) = 0.09 a standard deviation
    measured = sum(int(arc.measured.sum()) for arc in problem.arcs)
    marked = sum(int(o.sum()) for o in fit.outliers)
    # the initial angles of three arcs and 12 columns are fitted
    assert fit.estimate.figures["degrees_of_freedom"] == 2 * (measured - marked) - 6 - 12
    assert [len(p) for p in fit.estimate.predicted] == [len(arc.tau) for arc in problem.arcs]


def test_stacking_is_what_makes_the_equatorial_scheme_observable() -> None:
    """MATH 2.5: two runs of 12 h from alpha2 = 0 and 0.8, no installation errors; segments of 10, Simpson."""
    base, tau = Base.mounted("equatorial", dp.LATITUDE), dp.hours(12)
    p = np.concatenate([np.full(6, 0.01), np.zeros(5)])
    arcs = tuple(
        Arc(run, tau, linear_trajectory(p, base, np.array([0.0, start]), tau), np.ones(len(tau), np.bool_))
        for run, start in enumerate((0.0, 0.8))
    )
    problem = Problem((base, base), arcs)
    columns = columns_of(problem)
    parts = [arc_integrals(arc, problem, "simpson").segments(arc.alpha, 10)[0] for arc in arcs]
    own = np.zeros((len(parts[0]) + len(parts[1]), len(columns.names)))
    own[: len(parts[0]), columns.of_run(0)] = parts[0]
    own[len(parts[0]) :, columns.of_run(1)] = parts[1]

    def condition(rows: Float) -> float:
        return float(np.linalg.cond(np.delete(rows, [6, 7], axis=1)))  # theta has no part in this scheme

    # to a unit of the last digit given
    assert condition(own) == pytest.approx(29.6, abs=0.1)
    assert condition(np.concatenate(parts)) == pytest.approx(22.5, abs=0.1)
    assert condition(parts[0]) == pytest.approx(4.1e4, rel=0.02)
    assert condition(parts[1]) == pytest.approx(1.8e3, rel=0.03)


@pytest.mark.parametrize("scheme", dp.SCHEMES)
def test_noise_free_angles_give_the_truth(scheme: Scheme) -> None:
    """An even number of samples, with the noise stated: priors of 0.1 against 1e-3 arc seconds."""
    tau = MINUTES[:-1]
    problem = dp.one_run(scheme, dp.day(scheme)[:-1], tau)
    fit = cumulative(problem, sigma=1e-3 * dp.ARCSEC)
    seen = dp.observable(
        fit.estimate, cumulative(dp.without_priors(problem), sigma=1e-3 * dp.ARCSEC).estimate
    )
    error = np.abs(fit.estimate.value - dp.truth(scheme))[seen]
    # the priors bias by the square of the standard error over that of the prior
    assert np.all(error < 1e-2 * fit.estimate.standard_errors[seen]), error
    assert fit.autoregression is None
    assert not fit.outliers[0].any()
    simpson = cumulative(problem, sigma=1e-3 * dp.ARCSEC, quadrature="simpson").estimate
    # MATH 2.5: 2e-8 deg/h for an odd number of samples; the last step alone is of one order less
    assert np.abs(simpson.value - dp.truth(scheme))[:6].max() * dp.DEG_H < 1e-6


def test_an_arc_of_few_samples_is_no_harm() -> None:
    """A splinter of a few samples at the end of a run tells nothing, and says so by its weight."""
    whole = dp.one_run("polar", dp.noisy(dp.day("polar"), 0), MINUTES)
    arc = whole.arcs[0]
    for few in (2, 3, 5):
        cut = len(arc.tau) - few
        arcs = tuple(
            Arc(0, arc.tau[part], arc.alpha[part], arc.measured[part])
            for part in (slice(0, cut), slice(cut, None))
        )
        broken = cumulative(replace(whole, arcs=arcs)).estimate
        first = cumulative(replace(whole, arcs=arcs[:1])).estimate
        np.testing.assert_allclose(broken.value[:6], first.value[:6], rtol=1e-3)
